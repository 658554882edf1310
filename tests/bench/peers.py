"""pumaid beside figaroh, aurt and mujoco.sysid on the same logs, in one run; appended to bench/peers.csv.

python tests/bench/peers.py [--moving 7500 120000] [--rows 20000 100000 500000] [--limit 1200] [--tools figaroh ...]

The virtual arm has the PUMA 560's geometry (or that of its first three joints), drawn masses, and friction that is the
same in both directions, so that the model of each tool can describe it (aurt's has no inertia of rotors). Peers work in
N m: they are told the motors' gains; `figaroh, constants off` is told gains that are 10 to 20 % wrong. Each is
installed from its package into an environment of its own. Processes run one after another. `seconds` leaves out the
start of Python and the loading of modules (aurt: the making of its symbolic model), which `start-up` has. A tool that
does not finish a log in time is not given longer ones. Each has one thread.

`other motion off` is what is left of the torques of picks that no tool was given: see `left`.
"""

import argparse
import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import butter, filtfilt

sys.path.insert(0, str(Path(__file__).parents[1]))

from free_motion import picks, reach, recorded, waves
from pass_speed import append

from pumaid import export, read_model
from pumaid.dataset import Log
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.write import write_log
from pumaid.simulation import Friction, draw, simulate
from pumaid.simulation.mujoco_engine import specification
from pumaid.trajectory import Motion, Plan
from pumaid.units import factor

TABLE = Path(__file__).parents[2] / "bench" / "peers.csv"
#: GiB of address space of a process; last letters of a failed tool's output that are kept.
MEMORY, TAIL = 16, 200
#: Hz, as a UR controller of the CB series logs; s of robot time that a lap over all joints takes, about.
RATE, LAP = 125.0, 150.0
SEED = 3
#: Postures and speeds in which answers are compared.
POINTS = 1000
#: s of other motion, and of the start of a recording, in which the arm catches up with what it is asked to do.
OTHER, CATCHING_UP = 60.0, 1.0
#: Hz up to which torques of other motion are compared, and s around each sample that this smoothing looks at; rad/s
#: above which the sign of a joint's friction is known.
BAND, SETTLING, MOVES = 10.0, 0.16, 0.05
#: What a tool took over what pumaid did; a shared machine hardly changes the second.
RATIOS = {"times pumaid": "seconds", "its processor": "processor"}
ALONE, TOGETHER = "one joint at a time", "all joints at once"
#: Tool -> its driver, what pip installs, the joints of its arm (aurt's symbolic model of six joints is not done in half
#: an hour), and by how much the torque constants that it is told are wrong, least and most.
PEERS = {
    "figaroh": ("figaroh", "figaroh", 6, None),
    "figaroh, constants off": ("figaroh", "figaroh", 6, (0.1, 0.2)),
    "mujoco": ("mujoco", "mujoco[sysid]", 6, None),
    "aurt": ("aurt", "aurt", 3, None),
}
#: figaroh's unified configuration: its template for arms, everything on that its model has, and the log's rate.
FIGAROH = """\
robot:
  name: arm
  properties:
    joints:
      active_joints: [{names}]
    mechanics:
      reduction_ratios: [{ones}]
      friction_coefficients: {{viscous: [{zeros}], static: [{zeros}]}}
      actuator_inertias: [{zeros}]
      joint_offsets: [{zeros}]
    coupling: {{has_coupled_wrist: false}}
tasks:
  identification:
    enabled: true
    problem:
      include_external_forces: false
      use_joint_torques: true
      model_components: {{friction: true, joint_offset: true, actuator_inertia: true}}
    signal_processing: {{sampling_frequency: {rate}, cutoff_frequency: 10.0, filter_type: butterworth, filter_order: 4}}
"""


def arm(path, joints):
    """The virtual arm of so many joints (its recipe goes to `path`), its friction made the same in both directions."""
    lines = shipped_recipes()["puma560"].read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [text for text in lines if joints > 3 or not text.startswith("  - {name: wrist")]
    path.write_text("".join(kept).partition("\nsafety:")[0], encoding="utf-8")  # whose links may be gone
    drawn = draw(read_recipe(path), SEED)
    dry = 0.5 * (drawn.friction.coulomb_plus - drawn.friction.coulomb_minus)
    viscous = 0.5 * (drawn.friction.viscous_plus + drawn.friction.viscous_minus)
    return replace(drawn, friction=Friction(dry, -dry, viscous, viscous))


def alone(truth, rows):
    """The log of laps over all joints, one at a time, there and back, in postures and at speeds that are always new."""
    rng, motions, robot = np.random.default_rng(SEED), [], truth.robot
    for _ in range(2 * math.ceil(rows / (RATE * LAP))):
        for joint in range(1, robot.n_joints + 1):
            hold = tuple(rng.uniform(-1.5, 1.5, robot.n_joints).tolist())
            speed, half = float(rng.uniform(40, 70)) * factor("deg"), float(rng.uniform(0.8, 1.6))
            motions += [Motion(joint, hold, -way * half, way * half, speed) for way in (1, -1)]
    plan = Plan(robot.name, tuple(motions))
    logs = list(simulate(robot, plan, seed=SEED, truth=truth, rate=RATE, runs_per_file=10**9))
    return Log.joined(logs).part(slice(rows))


def moved(truth, path, seconds, seed):
    """The log of an arm that moves as `path` (waves or picks) draws it, without its first second."""
    rng = np.random.default_rng(seed)
    log = recorded(truth, path(rng, seconds + CATCHING_UP, reach(truth.robot)), rng, counts=1e6)
    log = log.part(slice(0, None, 2)).part(slice(round(CATCHING_UP * RATE), None))  # half of its rate
    return replace(log, velocity=np.gradient(log.position, log.time, axis=0))


def together(truth, rows):
    """The log of the kind that peers are made for: all joints move all the time (Fourier series)."""
    return moved(truth, waves, rows / RATE, SEED).part(slice(rows))


def smooth(signal):
    """(N, J) up to `BAND`, not delayed."""
    return filtfilt(*butter(4, BAND / (RATE / 2)), signal, axis=0)


def other_motion(truth):
    """Motion that no tool is given, as it is given to all to predict: its smoothed torque, N m, and the noise in it."""
    log = moved(truth, picks, OTHER, SEED + 1)
    position, step = smooth(log.position), 1.0 / RATE
    velocity = np.gradient(position, step, axis=0)
    shape, start = position.shape, np.zeros(position.shape[1])
    noise = truth.noise.sample_std * truth.noise.series(np.random.default_rng(SEED), shape, rate=RATE, start=start)
    told = {"position": position, "velocity": velocity, "acceleration": np.gradient(velocity, step, axis=0)}
    return told | {"torque": smooth(log.current / truth.gain), "noise": smooth(noise / truth.gain)}


def questions(truth):
    """Postures, in each of which one joint moves steadily, and what every joint asks there, N m."""
    rng, n = np.random.default_rng(SEED + 1), truth.robot.n_joints
    position, velocity = rng.uniform(-1.5, 1.5, (POINTS, n)), np.zeros((POINTS, n))
    moving = rng.integers(0, n, POINTS)
    velocity[np.arange(POINTS), moving] = rng.uniform(20, 70, POINTS) * factor("deg") * rng.choice([-1, 1], POINTS)
    gravity = truth.gravity_current(position)
    friction = truth.friction.currents(velocity)
    told = {"gravity": gravity / truth.gain, "whole": (gravity + friction) / truth.gain, "gain": truth.gain}
    return {"position": position, "velocity": velocity, "moving": moving} | told


def mdh_table(robot):
    """The arm's geometry as aurt's file: alpha and a of a row are those after its joint, not before it."""
    right = {0.0: "0", 90.0: "pi/2", -90.0: "-pi/2"}
    after = [(joint.a, right[round(joint.alpha / factor("deg"), 9)]) for joint in robot.joints[1:]] + [(0.0, "0")]
    rows = [f"{joint.d},{a},{alpha}" for joint, (a, alpha) in zip(robot.joints, after, strict=True)]
    return "\n".join(["d,a,alpha", *rows, ""])


def mujoco_model(truth):
    """MJCF of the arm as a user might know it: masses a tenth too large, centres off by 2 cm, friction half."""
    links = replace(truth.links, mass=1.1 * truth.links.mass, centre=truth.links.centre + 0.02)
    known = truth.friction
    friction = Friction(0.5 * known.coulomb_plus, 0.5 * known.coulomb_minus, known.viscous_plus, known.viscous_minus)
    guess = replace(truth, links=links, friction=friction, inertia=0.5 * truth.inertia)
    names = [f"joint{joint.number}" for joint in truth.robot.joints]
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in names)
    sensors = "".join(f'<jointpos name="{name}_position" joint="{name}"/>' for name in names)
    parts = f"<actuator>{motors}</actuator>\n<sensor>{sensors}</sensor>\n</mujoco>"
    spec = specification(guess, step=1.0 / RATE)
    spec.option.iterations, spec.option.tolerance = 100, 1e-8  # the engine's defaults are quicker than ours
    spec.compile()
    return str(spec.to_xml()).replace("</mujoco>", parts)


def prepare(folder, joints, log_of, rows):
    """All that the tools read of one log: N m in log.npz, currents in pumaid/log.csv, the arm as each is told of it."""
    folder.mkdir()
    truth = arm(folder / "recipe.yaml", joints)
    log, robot = log_of(truth, rows), truth.robot
    write_log(folder / "pumaid" / "log.csv", [log], robot)
    columns = {"time": log.time, "position": log.position, "velocity": log.velocity}
    np.savez(folder / "log.npz", torque=log.current / truth.gain, **columns)
    np.savez(folder / "questions.npz", **questions(truth))
    np.savez(folder / "other.npz", **other_motion(truth))
    names = ", ".join(joint.name for joint in robot.joints)
    ones, zeros = (", ".join([digit] * joints) for digit in "10")
    (folder / "figaroh.yaml").write_text(FIGAROH.format(names=names, ones=ones, zeros=zeros, rate=RATE))
    (folder / "arm.csv").write_text(mdh_table(robot))
    (folder / "arm.xml").write_text(mujoco_model(truth))
    return truth


def run(python, tool, folder, seconds):
    """The figures of a driver's run, and how it ended (`outcome`)."""
    record, driver = folder / "record.json", Path(__file__).with_name("peer_drivers.py")
    record.unlink(missing_ok=True)
    with (folder / "output.txt").open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            [python, driver, tool, folder],
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ | {"MPLBACKEND": "agg", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY * 1024**3,) * 2),
        )
        try:
            process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return {"outcome": f"not done in {seconds:g} s"}
    if not record.exists():
        text = (folder / "output.txt").read_text(encoding="utf-8", errors="replace")
        return {"outcome": "failed: " + " ".join(text.strip()[-TAIL:].split())}
    return {"outcome": "done", **json.loads(record.read_text(encoding="utf-8")), **errors(folder)}


def errors(folder):
    """RMS errors over the truth's RMS: gravity, friction of the joint that moves, other motion and the noise in it."""
    asked, answers = np.load(folder / "questions.npz"), np.load(folder / "answers.npz")
    moving = np.arange(POINTS), asked["moving"]
    friction, answer = (part["whole"][moving] - part["gravity"][moving] for part in (asked, answers))
    pairs = {"gravity off": (answers["gravity"], asked["gravity"]), "friction off": (answer, friction)}
    shares = {name: float(np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2))) for name, (a, b) in pairs.items()}
    other = np.load(folder / "other.npz")
    joints = left(other, other["torque"] - smooth(answers["other"]))
    noise = float(np.sqrt(np.mean(left(other, other["noise"]) ** 2)))
    whole = {"other motion off": float(np.sqrt(np.mean(joints**2))), "its worst joint": float(joints.max())}
    return shares | whole | {"its noise": noise}


def left(other, error):
    """(J,) RMS of what is left of the torques of other motion, over their RMS, where the joint moves.

    A share is the same in N m and in amperes, and so with a wrong constant.
    """
    moves = np.abs(other["velocity"]) > MOVES
    at = minimum_filter1d(moves, 2 * round(SETTLING * RATE) + 1, axis=0, mode="constant")
    return np.sqrt(np.mean(error**2, axis=0, where=at) / np.mean(other["torque"] ** 2, axis=0, where=at))


def mistaken(folder, least, most):
    """The same folder for a user whose torque constants are wrong, each by so much either way: all N m are."""
    wrong = folder.with_name(f"{folder.name}_off")
    shutil.copytree(folder, wrong)
    for name in ("log.npz", "other.npz"):
        told, rng = dict(np.load(wrong / name)), np.random.default_rng(SEED)
        n = told["torque"].shape[1]
        share = 1.0 + rng.uniform(least, most, n) * rng.choice([-1.0, 1.0], n)
        np.savez(
            wrong / name, **{key: value * (share if key in ("torque", "noise") else 1.0) for key, value in told.items()}
        )
    return wrong


def measurements(work, logs, limit, tools):
    """Every tool on every log, one after another; pumaid's model of a log gives the URDF that figaroh reads."""
    reference = {}
    for joints in sorted({PEERS[tool][2] for tool in tools}, reverse=True):
        for number, (kind, log_of, rows) in enumerate(logs):
            folder = work / f"{joints}_{number}"
            truth = prepare(folder, joints, log_of, rows)
            record = reference[folder.name] = run(Path(sys.executable), "pumaid", folder, limit)
            yield {"tool": "pumaid", "joints": joints, "log": kind, "rows": rows, **record}
            constants = {j: float(1.0 / gain) for j, gain in enumerate(truth.gain, start=1)}
            model = export(read_model(folder / "model.json"), truth.robot, form="urdf", torque_constants=constants)
            (folder / "arm.urdf").write_text(model.files[".urdf"], encoding="utf-8")
    for tool in tools:
        driver, package, joints, off = PEERS[tool]
        python = work / driver / "bin" / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", work / driver], check=True)
        installed = subprocess.run([python, "-m", "pip", "install", "-q", package], capture_output=True, text=True)
        if installed.returncode:
            yield {"tool": tool, "outcome": f"not installed: {installed.stderr.strip()[-TAIL:]}"}
            continue
        unfinished = dict.fromkeys((ALONE, TOGETHER), math.inf)
        for number, (kind, _, rows) in enumerate(logs):
            if rows > unfinished[kind]:
                continue
            folder = work / f"{joints}_{number}"
            record = run(python, driver, mistaken(folder, *off) if off else folder, limit)
            if record["outcome"] == "done":
                ours = reference[folder.name]
                record |= {name: record[key] / ours[key] for name, key in RATIOS.items()}
            else:
                unfinished[kind] = rows
            yield {"tool": tool, "joints": joints, "log": kind, "rows": rows, **record}


def main():
    """Measure, print and append."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moving", type=int, nargs="*", default=[7_500, 120_000], help="rows of logs: all joints move")
    parser.add_argument("--rows", type=int, nargs="*", default=[20_000, 100_000, 500_000], help="rows: one joint moves")
    parser.add_argument("--limit", type=float, default=1200.0, help="s for each run of a tool")
    parser.add_argument("--tools", nargs="+", choices=list(PEERS), default=list(PEERS))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="pumaid-peers-") as work:
        logs = [(TOGETHER, together, rows) for rows in sorted(options.moving)]
        logs += [(ALONE, alone, rows) for rows in sorted(options.rows)]
        append(TABLE, measurements(Path(work), logs, options.limit, options.tools))


if __name__ == "__main__":
    main()
