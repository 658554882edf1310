"""The segmentation against logs whose edges are known; seeds that no threshold was chosen on."""

import re
from dataclasses import replace

import numpy as np
import pytest
from motion_worlds import INERTIA, SCENARIOS, VISCOUS, World, make, robot, score

from pumaid.estimation.estimate import identify
from pumaid.estimation.evaluate import predictions, rmse
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.preprocessing.replicates import noise_floor, pairs
from pumaid.preprocessing.segment import segment
from pumaid.simulation import draw, simulate
from pumaid.trajectory import Motion, Plan

SEEDS = (20_001, 20_002)


@pytest.mark.parametrize("name", SCENARIOS)
def test_runs_bias_no_friction(name):
    """At signal-to-noise 10, what ramps and ringing put into runs moves friction by under half a standard error."""
    # Over seven tenths of what is truly at constant speed is in them.
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
    dataset, known = segment(logs, arm), truth.parameters()
    estimate = identify(dataset, arm)
    prediction = predictions(estimate, dataset, arm)[1]
    constant = np.array([run.kind == "constant" for run in prediction.bins.runs])
    floor, _ = noise_floor(pairs([run for run in prediction.bins.runs if run.kind == "constant"]))
    assert constant.sum() == 12
    assert rmse([(prediction, constant)]) < 1.05 * floor
    for name in ("coulomb.j1.plus", "coulomb.j1.minus", "viscous.j1.plus", "viscous.j1.minus"):
        value = estimate.value(name)
        assert abs(value.value - known[name]) < 3.0 * value.std_error


def of_strokes(world, logs):
    """(3, 2) viscous friction and inertia of each joint by the bins of its strokes alone, and the notes."""
    dataset, sizes = segment(logs, robot(world)), []
    for joint in (1, 2, 3):
        rows, currents = [], []
        for run in dataset.of_joint(joint):
            bins, q, weight = run.bins, run.bins.position[:, joint - 1], np.sqrt(run.bins.count)
            ways = [np.full(len(q), float(run.direction == way)) for way in (1, -1)]
            columns = [np.cos(q), np.sin(q), *ways, bins.velocity, bins.acceleration]
            rows.append(np.column_stack(columns) * weight[:, None])
            currents.append(bins.current * weight)
        sizes.append(np.linalg.lstsq(np.concatenate(rows), np.concatenate(currents), rcond=None)[0][4:])
    return np.array(sizes), dataset.notes


@pytest.mark.parametrize("rate", [125.0, 1000.0])
def test_strokes_carry_friction_and_inertia_without_bias(rate):
    """Over strokes of several seeds, friction and inertia come back to a few percent from the bins alone."""
    world = World(strokes=True, rate=rate, motions=24, plateau=(1.5, 4.0))
    sizes = [of_strokes(world, make(world, seed).logs)[0] for seed in range(20_001, 20_005)]
    assert np.mean(sizes, axis=(0, 1)) == pytest.approx([VISCOUS, INERTIA], rel=0.05)


@pytest.mark.parametrize("rate", [137.0, 490.0])
def test_strokes_carry_inertia_where_stamps_are_whole_milliseconds(rate):
    """As with the true instants; by the stamps alone it comes out up to a half too small. A note tells of it."""
    world = World(strokes=True, rate=rate, motions=24, position_noise=1e-5, quantum=1e-5)
    found, true = [], []
    for seed in range(20_001, 20_004):
        logs = make(world, seed).logs
        true.append(of_strokes(world, logs)[0])
        sizes, notes = of_strokes(world, [replace(log, time=np.floor(log.time * 1e3) / 1e3) for log in logs])
        found.append(sizes)
        # A millisecond over the root of twelve.
        assert [note.slug for note in notes] == ["clock-evened"] and re.search(r"are 0\.2\d* ms RMS", notes[0].text)
    found, true = np.mean(found, axis=(0, 1))[1], np.mean(true, axis=(0, 1))[1]
    assert found == pytest.approx(true, rel=0.01) and found == pytest.approx(INERTIA, rel=0.02)
