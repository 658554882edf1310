"""The segmentation against logs whose edges are known; seeds that no threshold was chosen on."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from motion_worlds import INERTIA, SCENARIOS, VISCOUS, World, make, robot, score

from pumaid.dataset import Log
from pumaid.estimation.estimate import identify
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.preprocessing.segment import segment
from pumaid.robot import Joint, Robot
from pumaid.simulation import draw, simulate
from pumaid.trajectory import Motion, Plan

SEEDS = (20_001, 20_002)
REAL = Path(os.environ.get("PUMAID_REAL_DATA", Path(__file__).parents[2].parent / "shared" / "data"))


@pytest.mark.parametrize("name", SCENARIOS)
def test_runs_bias_no_friction(name):
    """At signal-to-noise 10, what ramps and ringing put into runs moves friction by under half a standard error.

    Over seven tenths of what is truly at constant speed is in them.
    """
    world = World(**SCENARIOS[name])
    scores = [score(truth, segment(truth.logs, robot(world))) for truth in (make(world, seed) for seed in SEEDS)]
    assert max(s.bias for s in scores) < 0.5
    assert sum(s.right for s in scores) > 0.7 * sum(s.true for s in scores)


def test_what_settles_after_a_ramp_is_no_friction():
    """The heavy first joint of a UR10e, position-controlled, still settles 0.2 s after a ramp: none of it in runs."""
    arm = read_recipe(shipped_recipes()["ur10e"])
    motions = [Motion(1, (0.0,) * 6, -way, way, v) for _ in range(6) for v in (0.12, 1.745) for way in (0.7, -0.7)]
    truth = draw(arm, 41)
    logs = simulate(arm, Plan(arm.name, tuple(motions)), seed=2, truth=truth, rate=250.0)
    estimate = identify(segment(logs, arm), arm)
    joint, known = estimate.joints[0], truth.parameters()
    assert joint.rmse < 1.15 * joint.noise_floor
    for name in ("coulomb.j1.plus", "coulomb.j1.minus", "viscous.j1.plus", "viscous.j1.minus"):
        value = estimate.value(name)
        assert abs(value.value - known[name]) < 3.0 * value.std_error


@pytest.mark.parametrize("rate", [125.0, 1000.0])
def test_strokes_carry_friction_and_inertia_without_bias(rate):
    """Over strokes of many seeds, friction and inertia come back to a few percent from the bins alone."""
    world = World(strokes=True, rate=rate, motions=24, plateau=(1.5, 4.0))
    found = [size for seed in range(20_001, 20_005) for size in _of_strokes(world, make(world, seed).logs)[0]]
    viscous, inertia = np.mean(found, axis=0)
    assert viscous == pytest.approx(VISCOUS, rel=0.05)
    assert inertia == pytest.approx(INERTIA, rel=0.05)


@pytest.mark.parametrize("rate", [137.0, 490.0])
def test_strokes_carry_inertia_where_stamps_are_whole_milliseconds(rate):
    """As with the true instants; by the stamps alone it comes out up to a half too small. A note tells of it."""
    world = World(strokes=True, rate=rate, motions=24, position_noise=1e-5, quantum=1e-5)
    found, true = [], []
    for seed in range(20_001, 20_004):
        logs = make(world, seed).logs
        true += _of_strokes(world, logs)[0]
        sizes, notes = _of_strokes(world, [replace(log, time=np.floor(log.time * 1e3) / 1e3) for log in logs])
        found += sizes
        assert [note.slug for note in notes] == ["clock-evened"]
        # A millisecond over the root of twelve.
        assert re.search(r"are 0\.2\d* ms RMS off", notes[0].text)
    assert np.mean(found, axis=0)[1] == pytest.approx(np.mean(true, axis=0)[1], rel=0.01)
    assert np.mean(found, axis=0)[1] == pytest.approx(INERTIA, rel=0.02)


def _of_strokes(world, logs):
    """Viscous friction and inertia of each joint by its strokes, and the notes."""
    dataset, found = segment(logs, robot(world)), []
    for joint in (1, 2, 3):
        rows = [_stroke_rows(run) for run in dataset.of_joint(joint)]
        normal, target = sum(a for a, _ in rows), sum(b for _, b in rows)
        found.append(np.linalg.lstsq(normal, target, rcond=None)[0][4:])
    return found, dataset.notes


def _stroke_rows(run):
    """A stroke's normal equations over cos, sin, forward, backward, velocity, acceleration, by its bins."""
    bins, joint = run.bins, run.joint - 1
    columns = np.zeros((len(bins), 6))
    columns[:, 0], columns[:, 1] = np.cos(bins.position[:, joint]), np.sin(bins.position[:, joint])
    columns[:, 2 if run.speed > 0 else 3] = 1.0
    columns[:, 4], columns[:, 5] = bins.velocity, bins.acceleration
    weighted = columns.T * bins.count
    return weighted @ columns, weighted @ bins.current


def _arm(n_joints: int) -> Robot:
    return Robot("real", tuple(Joint(n + 1, f"j{n + 1}", "revolute") for n in range(n_joints)))


def _table(name: str):
    if not (REAL / name).exists():
        pytest.skip(f"no public recordings in {REAL} (set PUMAID_REAL_DATA)")
    import pandas as pd

    return pd.read_parquet(REAL / name)


def _log(table, *, time, position, current) -> Log:
    rows = np.arange(len(table)) + 2
    return Log("real", rows, time, table[position].to_numpy(float), None, table[current].to_numpy(float), None, True)


@pytest.mark.realdata
def test_ur3e_goes_in_strokes():
    """The UR3e's shoulder makes eleven strokes of half a turn, none at constant speed."""
    table = _table("ur3e-aurt/wave_currentData_100v_40a.parquet")
    names = {"position": [f"actual_q_{j}" for j in range(6)], "current": [f"actual_current_{j}" for j in range(6)]}
    runs = segment([_log(table, time=table["timestamp"].to_numpy(float), **names)], _arm(6)).runs
    assert [(run.kind, run.joint) for run in runs] == [("stroke", 2)] * 11
    assert all(abs(run.span[1] - run.span[0]) > np.radians(178) for run in runs)


@pytest.mark.realdata
@pytest.mark.parametrize("joint", [1, 2, 3, 4, 5, 7])
def test_kinova_trapezoids_are_one_run_each(joint):
    """Each Kinova log holds one movement at one constant speed: one run, at its speed (times are counts)."""
    table = _table(f"kinova-gen3-jointwise/joint_{joint}_trapez.parquet")
    names = {"position": [f"Position{j}" for j in range(1, 8)], "current": [f"Cur{j}" for j in range(1, 8)]}
    log = _log(table, time=1e-3 * np.arange(len(table)), **names)
    log = Log("real", log.rows, log.time, np.unwrap(log.position, axis=0), None, log.current, None, True)
    (run,) = segment([log], _arm(7)).runs
    assert (run.kind, run.joint) == ("constant", joint)
    assert run.speed == pytest.approx(np.median(table[f"Velocity{joint}"]), rel=0.02)


@pytest.mark.realdata
def test_motion_of_both_joints_is_left_out():
    """The double pendulum swings both joints at once: no run, and the reason is told."""
    table = _table("dfki-double-pendulum-a0/slow_75s_20220812-061157.parquet")
    log = _log(table, time=table["time"].to_numpy(float), position=["pos1", "pos2"], current=["tau1", "tau2"])
    dataset = segment([log], _arm(2))
    several = sum(reject.samples for reject in dataset.rejects if reject.reason == "several-joints")
    assert dataset.runs == ()
    assert several > 0.8 * len(log)
