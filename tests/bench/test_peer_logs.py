"""The logs and models that the peers are given say of the arm what pumaid's own say."""

import csv
from pathlib import Path

import numpy as np
import peer_logs
import peers
import pytest

from pumaid.simulation.virtual_robot import Truth


@pytest.fixture(scope="module")
def recipe(tmp_path_factory) -> Path:
    """The recipe of the arm without its wrist."""
    path = tmp_path_factory.mktemp("arm") / "recipe.yaml"
    path.write_text(peer_logs.recipe(3), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def truth(recipe) -> Truth:
    """The virtual arm without its wrist."""
    return peer_logs.arm(recipe)


@pytest.fixture(scope="module")
def rows(truth) -> peer_logs.Rows:
    """A short log in which all joints move."""
    return peer_logs.moving_all(truth, 200)


def test_aurt_is_told_the_recipe_s_geometry(truth):
    """aurt's table, its alpha and a shifted back by one joint, is the recipe's (right angles to 1e-12)."""
    told = list(csv.DictReader(peer_logs.mdh_table(truth.robot).splitlines()))
    angles = {"0": 0.0, "pi/2": np.pi / 2, "-pi/2": -np.pi / 2}
    assert [float(row["d"]) for row in told] == [joint.d for joint in truth.robot.joints]
    assert [float(row["a"]) for row in told[:-1]] == [joint.a for joint in truth.robot.joints[1:]]
    turned = [angles[row["alpha"]] for row in told[:-1]]
    assert turned == pytest.approx([joint.alpha for joint in truth.robot.joints[1:]], abs=1e-12)


def test_four_formats_hold_one_log(tmp_path, rows, truth):
    """What each tool reads are the same positions and torques (nine digits in text)."""
    peer_logs.write(tmp_path, rows, truth)
    figaroh, pumaid = (
        np.genfromtxt(tmp_path / name, delimiter=",", names=True) for name in ("figaroh.csv", "pumaid/log.csv")
    )
    aurt = np.genfromtxt(tmp_path / "aurt.csv", delimiter=" ", names=True)
    mujoco = np.load(tmp_path / "mujoco.npz")
    for j in range(3):
        close = {"rel": 1e-8, "abs": 1e-12}
        for log, name in ((figaroh, f"q{j}"), (pumaid, f"q{j + 1}"), (aurt, f"actual_q_{j}")):
            assert log[name] == pytest.approx(rows.position[:, j], **close)
        torques = figaroh[f"tau{j + 1}"], aurt[f"actual_current_{j}"], pumaid[f"i{j + 1}"] / truth.gain[j]
        assert all(torque == pytest.approx(mujoco["control"][:, j], **close) for torque in torques)


def test_a_right_answer_is_not_off(tmp_path, truth):
    """The score of the truth itself is zero, and that of no answer at all is one."""
    asked = peer_logs.questions(truth)
    np.savez(tmp_path / "questions.npz", **asked)
    for factor in (1.0, 0.0):
        np.savez(tmp_path / "answers.npz", gravity=factor * asked["gravity"], whole=factor * asked["whole"])
        off = peers.errors(tmp_path)
        assert off == {"gravity off": pytest.approx(1.0 - factor), "friction off": pytest.approx(1.0 - factor)}
