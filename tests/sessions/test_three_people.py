"""Three people with a recording and no script: how far they are after three minutes.

Each test types what its person would type, with the refusals that meet them; MuJoCo moves the arms, and the recordings
are written as the devices' own programs write them.
"""

import json
import runpy
import shutil
import time
from pathlib import Path
from subprocess import CompletedProcess

import device_logs
import mujoco
import numpy as np
import pytest
from arms_at_work import of_urdf, ur5e, worked
from command import run, shell
from engines import held_by_mujoco

#: What a person takes, s: a key, an answer that is read, a block that is pasted into a file.
KEY, ANSWER, PASTE = 0.3, 15.0, 15.0

pytestmark = pytest.mark.slow


class Session:
    """A person in a folder: `seconds` that went by, `lines` that were typed."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.seconds, self.lines = folder, 0.0, 0

    def types(self, line: str, *, code: int = 0) -> CompletedProcess[str]:
        """What a line answers, which ends with `code`."""
        start = time.perf_counter()
        done = shell(line, self.folder)
        self.seconds += time.perf_counter() - start + KEY * len(line) + ANSWER
        self.lines += 1
        assert done.returncode == code and "Traceback" not in done.stderr, done.stderr
        return done

    def pastes(self, refusal: str) -> None:
        """The block of a refusal goes into the recipe as it stands."""
        recipe = self.folder / "recipe.yaml"
        recipe.write_text(
            recipe.read_text(encoding="utf-8") + "\n" + refusal[refusal.index("log:\n") :], encoding="utf-8"
        )
        self.seconds += PASTE

    def is_right(self, model: mujoco.MjModel, *, friction: list[float], gain: np.ndarray, recipe: str) -> None:
        """Friction, ratios and weights of results/model.json are those of the arm, whose motors draw `gain` (J,)."""
        document = json.loads((self.folder / "results" / "model.json").read_text(encoding="utf-8"))
        values = {item["name"]: item for joint in document["joints"] for item in joint["parameters"]}
        values |= {item["name"]: item for item in document["ratios"]}
        truth = {}
        for n, size in enumerate(gain * friction, 1):
            truth |= {f"coulomb.j{n}.plus": size, f"coulomb.j{n}.minus": -size}
            truth |= {f"viscous.j{n}.plus": size, f"viscous.j{n}.minus": size}
        truth |= {f"gain_ratio.{n}.{n + 1}": gain[n - 1] / gain[n] for n in range(1, len(gain))}
        score = {
            name: (values[name]["value"] - exact) / values[name]["std_error"]
            for name, exact in truth.items()
            if values[name]["state"] == "identified"
        }
        assert len(score) > 4.4 * len(gain) and max(map(abs, score.values())) < 4.5, score
        assert np.std(list(score.values())) < 1.6
        words = ("--recipe", recipe, "--format", "python", "-o", self.folder / "arm.py")
        run("export", self.folder / "results" / "model.json", *words)
        q = np.random.default_rng(9).uniform(-1.5, 1.5, (200, len(gain)))
        true = held_by_mujoco(model, q) * gain
        left = runpy.run_path(str(self.folder / "arm.py"))["gravity"](q) - true
        assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean(true**2))


def described(name: str) -> Path:
    """A URDF of example-robot-data."""
    pytest.importorskip("example_robot_data", reason="it brings the URDFs (pip install pumaid[test])")
    from example_robot_data.robots_loader import getModelPath

    return Path(getModelPath(name)) / name


def test_the_owner_of_a_ur5e_with_an_rtde_recording(tmp_path):
    """Three lines at most: the first refusal names the option that is missing."""
    rng, friction = np.random.default_rng(21), [7.0, 8.0, 6.0, 2.0, 2.0, 1.5]
    gain = 1.0 / np.array([13.0, 13.0, 13.0, 10.0, 10.0, 10.0])
    model, told = worked(ur5e(), middle=[0.3, -1.4, 1.2, -1.0, -1.2, 0.4], friction=friction, rotor=0.1, seed=21)
    device_logs.rtde(tmp_path / "robot_data.csv", told, told.torque * gain + 0.03 * rng.normal(size=told.torque.shape))
    owner = Session(tmp_path)
    assert "--recipe ur5e" in owner.types("pumaid identify robot_data.csv", code=3).stderr
    shown = owner.types("pumaid identify robot_data.csv --recipe ur5e")
    assert "actual_current_{joint0}" in shown.stderr
    owner.is_right(model, friction=friction, gain=gain, recipe="ur5e")
    assert (owner.lines, owner.seconds < 180.0) == (2, True)


def test_a_ros_2_user_with_a_bag_of_joint_states(tmp_path):
    """Three lines: joints are joined by name, and the gripper and other topics are passed over."""
    device = described("xarm_description/urdf/xarm7.urdf")
    rng, friction, gain = np.random.default_rng(22), [4.0, 4.0, 3.0, 3.0, 1.5, 1.0, 1.0], np.ones(7)
    middle = [0.0, 0.2, 0.0, 1.3, 0.0, 0.9, 0.0]
    model, told = worked(of_urdf(device), middle=middle, friction=friction, rotor=0.1, seed=22)
    effort = told.torque + 0.05 * rng.normal(size=told.torque.shape)
    device_logs.joint_states(tmp_path / "rosbag2_2026", told, effort, [f"joint{n}" for n in range(1, 8)])
    shutil.copy(device, tmp_path)
    user = Session(tmp_path)
    assert "pumaid init --urdf" in user.types("pumaid identify rosbag2_2026", code=3).stderr
    assert "then pumaid identify" in user.types("pumaid init --urdf xarm7.urdf").stderr
    user.types("pumaid identify rosbag2_2026")
    user.is_right(model, friction=friction, gain=gain, recipe=str(tmp_path / "recipe.yaml"))
    assert (user.lines, user.seconds < 180.0) == (3, True)


def test_a_hobbyist_with_servos_whose_log_is_ticks_and_raw_currents(tmp_path):
    """Three lines and the block of one refusal, which is that of these servos."""
    device = described("so_arm_description/urdf/so101.urdf")
    rng, friction = np.random.default_rng(23), [0.08, 0.1, 0.09, 0.06, 0.05, 0.04]
    gain = 1.0 / np.array([1.1, 1.1, 1.0, 0.9, 0.9, 0.9])
    middle = [0.0, -0.2, 0.3, 0.2, 0.0, 0.8]
    model, told = worked(of_urdf(device), middle=middle, friction=friction, rotor=0.25, seed=23)
    device_logs.feetech(tmp_path / "log.csv", told, told.torque * gain + 0.01 * rng.normal(size=told.torque.shape))
    shutil.copy(device, tmp_path)
    hobbyist = Session(tmp_path)
    hobbyist.types("pumaid init --urdf so101.urdf")
    refusal = hobbyist.types("pumaid identify log.csv", code=3).stderr
    assert "fix: if your servos are feetech-sts, put this into the recipe" in refusal
    hobbyist.pastes(refusal)
    hobbyist.types("pumaid identify log.csv")
    hobbyist.is_right(model, friction=friction, gain=gain, recipe=str(tmp_path / "recipe.yaml"))
    assert (hobbyist.lines, hobbyist.seconds < 180.0) == (3, True)
