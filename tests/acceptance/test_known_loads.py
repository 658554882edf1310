"""Torque constants from known loads: a rod with masses, arms at constant speed and in any motion (MuJoCo)."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from command import answer, run
from free_motion import reach, recorded, waves

import pumaid
from pumaid.dataset import Dataset, Run, load_dataset, save_dataset, with_payloads
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.preprocessing.replicates import replicates
from pumaid.preprocessing.segment import segment
from pumaid.results.documents import read_model
from pumaid.simulation import Truth, draw, mujoco_engine, simulate
from pumaid.trajectory import Motion, Plan

#: kg, and m in the last link's frame.
LOAD = (1.0, 0.05, 0.02, 0.1)
ROD = """name: rod
gravity: [0, 0, -9.80665]
units: {angle: deg}
joints:
  - {name: j1, type: revolute, theta: -90, alpha: 90, a: 0, d: 0, limits: [-170, 170], max_velocity: 360}
"""


@pytest.fixture
def carrying(monkeypatch) -> Callable[[bool], None]:
    """Hangs the load on every arm that the engine makes from now on, as a body of its own, or takes it off again."""
    plain = mujoco_engine.specification

    def loaded(truth: Truth, **more: Any) -> Any:
        spec = plain(truth, **more)
        ball = spec.bodies[-1].add_body(pos=LOAD[1:])
        ball.mass, ball.ipos, ball.inertia, ball.explicitinertial = LOAD[0], [0.0] * 3, [1e-9] * 3, True
        return spec

    return lambda is_on: monkeypatch.setattr(mujoco_engine, "specification", loaded if is_on else plain)


def scores(estimate: Estimate, truth: Truth) -> dict[int, float]:
    """Joint -> errors by which its torque constant is off, of those that are identified."""
    values = {joint.number: estimate.value(f"torque_constant.j{joint.number}") for joint in truth.robot.joints}
    assert all((value.unit == "N/A") != truth.robot.joint(joint).is_revolute for joint, value in values.items())
    return {
        joint: (value.value - 1.0 / truth.gain[joint - 1]) / value.std_error
        for joint, value in values.items()
        if value.value is not None and value.std_error is not None
    }


def test_any_motion_with_and_without_a_load_gives_torque_constants(carrying):
    """A minute each of waves of all joints: every constant within 3.5 errors, most known to one per cent."""
    robot = read_recipe(shipped_recipes()["puma560"])
    truth, rng, logs = draw(robot, 61), np.random.default_rng(61), []
    for is_on in (False, True):
        carrying(is_on)
        log = recorded(truth, waves(rng, 60.0, reach(robot)), rng, counts=2e4)
        logs.append(replace(log, origin="tool.csv" if is_on else "bare.csv"))
    estimate = identify(with_payloads(segment(logs, robot), {"tool.csv": LOAD}), robot)
    off = scores(estimate, truth)
    assert len(off) == robot.n_joints and max(map(abs, off.values())) < 3.5
    constants = [estimate.value(f"torque_constant.j{joint}") for joint in range(1, robot.n_joints + 1)]
    assert np.median([abs(value.std_error / value.value) for value in constants]) < 0.01
    # Without a word on loads the arm has ratios only, and the heavier log contradicts the other.
    assert not [value for value in identify(segment(logs, robot), robot).values if "torque" in value.name]


def test_a_slide_that_lifts_a_load_tells_its_force_constant(carrying):
    """A vertical slide's weight is Coulomb friction's; that of a known load tells N/A, where no ratio would."""
    robot = read_recipe(shipped_recipes()["stanford"])
    truth, parts = draw(robot, 62), list[Run]()
    hold = tuple(0.5 * sum(joint.limits) if joint.limits else 0.0 for joint in robot.joints)
    motions = []
    for joint in (2, 3):
        low, high = robot.joint(joint).limits or (-1.0, 1.0)
        ends = (low + 0.2 * (high - low), high - 0.2 * (high - low))
        for share in (0.2, 0.5, 0.2, 0.5):
            for start, end in (ends, ends[::-1]):
                speed = share * (robot.joint(joint).max_velocity or 1.0)
                motions.append(Motion(joint, hold, start, end, speed))
    for is_on in (False, True):
        carrying(is_on)
        logs = list(simulate(robot, Plan(robot.name, tuple(motions)), seed=70 + is_on, truth=truth, rate=200.0))
        runs = with_payloads(segment(logs, robot), {"*": LOAD} if is_on else {}).runs
        parts += [replace(run, clock=int(is_on)) for run in runs]
    assert all(len({parts[n].payload for n in group}) == 1 for group in replicates(parts))  # no repeats of one another
    off = scores(identify(Dataset(tuple(parts)), robot), truth)
    assert {2, 3} <= set(off) and max(map(abs, off.values())) < 3.5


def rod(mass: float, seed: int, share: float = 0.0) -> pd.DataFrame:
    """A servo that swings a rod with a mass at 0.14 m to and fro at four speeds; K is 0.9 N m/A, `share` of the load
    is friction."""
    rng, rows, t = np.random.default_rng(seed), [], 0.0
    for speed in (1.0, 1.5, 2.0, 2.5) * 2:
        for way in (1.0, -1.0):
            time = np.arange(0.0, 4.0 / speed, 0.005)
            q = way * (speed * time - 2.0)
            torque = (0.01 + 0.14 * mass * 9.80665) * np.sin(q)
            friction = way * (0.03 + 0.01 * speed + share * np.abs(torque) / 0.9)
            current = torque / 0.9 + friction + 0.003 * rng.normal(size=len(q))
            rows.append(np.column_stack([t + time, q, np.full(len(q), way * speed), current]))
            rest = np.arange(0.0, 0.4, 0.005)
            zero = 0.0 * rest
            rows.append(np.column_stack([t + time[-1] + 0.005 + rest, zero + q[-1], zero, zero + current[-1]]))
            t = rows[-1][-1, 0] + 0.005
    return pd.DataFrame(np.vstack(rows), columns=["t", "q1", "qd1", "i1"])


@pytest.fixture
def bench(tmp_path):
    """A folder with three logs of a rod, without a mass, with 0.1 and 0.2 kg."""
    (tmp_path / "logs").mkdir()
    for number, mass in enumerate((0.0, 0.1, 0.2)):
        rod(mass, number).to_csv(tmp_path / "logs" / f"mass_{number}.csv", index=False)
    (tmp_path / "recipe.yaml").write_text(ROD, encoding="utf-8")
    return tmp_path


def test_a_rod_with_known_masses_tells_the_torque_constant(bench):
    """The recipe says which file carries what, by name or pattern; masses in kg go into the export."""
    files = "files:\n  mass_1.csv: {payload: {mass: 0.1, at: [0.14, 0, 0]}}\n"
    (bench / "recipe.yaml").write_text(ROD + files + "  mass_2.*: {payload: {mass: 0.2, at: [0.14, 0, 0]}}\n")
    run("identify", bench / "logs")
    constant = read_model(bench / "results/model.json").value("torque_constant.j1")
    assert constant.unit == "N m/A" and constant.value == pytest.approx(0.9, abs=4.0 * constant.std_error)
    assert constant.std_error < 0.005
    told = run("export", bench / "results/model.json", "--format", "urdf", "-o", bench / "rod.urdf").stderr
    assert "no torque constant" not in told
    dataset = pumaid.load(bench).dataset()
    with (bench / "kept.npz").open("wb") as file:
        save_dataset(file, dataset, {})
    assert {run.payload for run in load_dataset(bench / "kept.npz")[0].runs} == {run.payload for run in dataset.runs}


def test_friction_in_proportion_to_a_known_load_hides_the_constant(bench):
    """Gears that lose as much lifting as lowering look like another constant with unequal losses: both are told."""
    files = "files:\n" + "".join(f"  mass_{n}.csv: {{payload: {{mass: 0.{n}, at: [0.14, 0, 0]}}}}\n" for n in (1, 2))
    (bench / "recipe.yaml").write_text(ROD + files)
    for number in range(3):
        rod(0.1 * number, number, 0.15).to_csv(bench / "logs" / f"mass_{number}.csv", index=False)
    run("identify", bench / "logs", "--add", "load_friction@1")
    estimate = read_model(bench / "results/model.json")
    assert "load_friction.j1" in estimate.value("torque_constant.j1").reason
    mean = next(total for total in estimate.combinations if "load_friction" in total.text)
    assert mean.value == pytest.approx(0.15, abs=4.0 * mean.std_error) and mean.std_error < 0.01


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ("'*.csv'", "were alike in all runs"),
        ("mas_1.csv", "payload-unused"),
        ("mass_1.csv, x", "recipe-wrong"),
        ("mass_0.csv", "of friction"),
    ],
    ids=["in all logs", "a wrong name", "a wrong key", "the wrong log"],
)
def test_what_known_loads_cannot_tell_is_told(bench, files, words):
    """The same load in all logs, a name that no log has, and a recipe that cannot be read so."""
    (bench / "recipe.yaml").write_text(ROD + f"files: {{{files}: {{payload: {{mass: 0.1, at: [0.14, 0, 0]}}}}}}\n")
    found = run("identify", bench / "logs", code=3 if words == "recipe-wrong" else 0)
    assert words in found.stdout + found.stderr
    if words == "payload-unused":
        assert "torque_constant" not in found.stdout


def test_a_model_without_constants_says_that_it_leaves_a_load_out(bench):
    """Compared with a log that carried a load, a model of bare logs predicts the bare arm, and says so."""
    (bench / "recipe.yaml").write_text(ROD + "files: {mass_2.csv: {payload: {mass: 0.2, at: [0.14, 0, 0]}}}\n")
    run("identify", bench / "logs/mass_0.csv", "--recipe", bench / "recipe.yaml", "-o", bench / "bare.json")
    words = ("compare", bench / "bare.json", bench / "logs/mass_2.csv", "--recipe", bench / "recipe.yaml")
    assert "without the known load" in run(*words, "--trust").stderr


def test_a_plan_says_which_of_its_runs_carried_a_load(bench):
    """By the order of runs that are planned with and without it; where some are lost it is refused."""
    loads = {"mass_1.csv": "{mass: 0.1, at: [0.14, 0, 0]}", "mass_2.csv": "{mass: 0.2, at: [0.14, 0, 0]}"}
    files = "".join(f"  {name}: {{payload: {load}}}\n" for name, load in loads.items())
    (bench / "recipe.yaml").write_text(f"{ROD}files:\n{files}")
    by_file = answer(f"identify {bench / 'logs'}")
    (bench / "recipe.yaml").write_text(ROD)
    lines = [
        f"  - {{joint: 1, hold: [0], from: {-way * 1.8}, to: {way * 1.8}, velocity: {speed}{load}}}\n"
        for load in ("", *(f", payload: {load}" for load in loads.values()))
        for speed in (1.0, 1.5, 2.0, 2.5) * 2
        for way in (1, -1)
    ]
    (bench / "plan.yaml").write_text("kind: plan\nformat: 1\nruns:\n" + "".join(lines))
    by_plan = answer(f"identify {bench / 'logs'}")
    assert by_plan["joints"] == by_file["joints"] and "torque_constant.j1" in str(by_plan["joints"])
    assert "plan-payload" in run("simulate", bench / "recipe.yaml", "-o", bench / "virtual", code=3).stderr
    (bench / "logs" / "mass_1.csv").unlink()
    assert "payload-unclear" in run("identify", bench / "logs", code=3).stderr
