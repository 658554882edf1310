"""Runs without logs are the runs that logs would leave."""

from __future__ import annotations

import numpy as np
import pytest

from pumaid.dataset import CONSTANT_COLUMNS
from pumaid.errors import ModelError
from pumaid.maths.triangle import Triangle
from pumaid.robot import Joint, Robot
from pumaid.simulation import Bench, draw, runs, table1
from pumaid.trajectory import Motion, Plan

PUMA, PAPER = table1.puma560(), table1.experiment()


def dense(run, truth) -> tuple[np.ndarray, np.ndarray]:
    """Regressors and noise-free current of a run's samples, from the truth alone, at 1000 positions of its span."""
    q = np.linspace(*run.span, 1000)
    position = np.tile(np.nan_to_num(run.posture), (1000, 1))
    position[:, run.joint - 1] = q
    current = truth.gravity_current(position)[:, run.joint - 1]
    current = current + truth.friction.current(run.joint, np.full(1000, run.speed))
    return np.column_stack([np.cos(q), np.sin(q), np.ones(1000)]), current


def test_noise_free_triangles_hold_the_truth():
    """Every run's triangle solves to the cosine, sine and constant of the truth's own current."""
    truth = PUMA.with_noise(0.0)
    for run in Bench(truth, PAPER).runs(np.random.default_rng(0)):
        rows, target = run.triangle.rows()
        found = np.linalg.lstsq(rows, target, rcond=None)[0]
        regressors, current = dense(run, truth)
        assert np.max(np.abs(regressors @ found - current)) < 1e-9


def test_triangle_is_the_factor_of_its_samples():
    """With noise the triangle equals the QR factor of the very samples from which it was made."""
    bench = Bench(PUMA, PAPER, rate=50.0)
    prepared = bench._runs[37]
    current = prepared.current + np.random.default_rng(5).normal(0.0, 0.1, len(prepared.current))
    q = prepared.position
    wanted = Triangle.of(CONSTANT_COLUMNS, np.column_stack([np.cos(q), np.sin(q), np.ones(len(q))]), current)
    found = bench._run(prepared, current, 0).triangle
    assert found.factor == pytest.approx(wanted.factor, abs=1e-9)
    assert found.count == wanted.count


def test_cells_are_means_of_the_samples():
    """Bins add up to the triangle's sums: count, current, square of the current."""
    for run in Bench(PUMA, PAPER, rate=50.0).runs(np.random.default_rng(2))[::9]:
        own = run.bins.current
        assert run.bins.count.sum() == run.samples
        square = np.sum(run.bins.count * (own**2 + run.bins.variance))
        assert square == pytest.approx(np.sum(run.triangle.factor[:, -1] ** 2), rel=1e-9)


def test_held_out_runs_are_marked():
    """What the plan keeps for judging is marked in the runs."""
    motions = (Motion(2, (0.0,) * 6, -1.0, 1.0, 0.5), Motion(2, (0.0,) * 6, 1.0, -1.0, 0.5, "heldout"))
    found = runs(PUMA, Plan("PUMA 560", motions), np.random.default_rng(0))
    assert [(run.heldout, run.direction) for run in found] == [(False, 1), (True, -1)]


def test_prismatic_runs_have_no_angle():
    """Cosine and sine columns of a sliding joint are zero; the constant carries weight and friction."""
    robot = Robot("lift", (Joint(1, "lift", "prismatic"),))
    truth = draw(robot, 4).with_noise(0.0)
    (run,) = runs(truth, Plan("lift", (Motion(1, (0.0,), 0.0, 0.3, 0.1),)), np.random.default_rng(0))
    rows, target = run.triangle.rows()
    constant = target @ rows[:, 2] / (rows[:, 2] @ rows[:, 2])
    assert np.all(rows[:, :2] == 0.0)
    wanted = truth.gravity_current(np.zeros((1, 1)))[0, 0] + truth.friction.current(1, np.array([0.1]))[0]
    assert constant == pytest.approx(wanted, abs=1e-12)


def test_levels_differ_between_runs_and_experiments():
    """Two experiments on one bench differ, by the noise that the truth states."""
    bench, rng = Bench(PUMA, PAPER), np.random.default_rng(8)
    first, second = bench.runs(rng), bench.runs(rng)
    means = np.array([[run.bins.current.mean() for run in some if run.joint == 2] for some in (first, second)])
    # 20 differences of two levels, each of variance 2 x 0.2 x std^2, know their size to 16 %; three sigmas.
    assert np.std(means[0] - means[1]) == pytest.approx(np.sqrt(0.4) * PUMA.noise.std[1], rel=0.5)


def test_a_run_without_constant_speed_is_refused():
    """A span that the ramps fill leaves no run, and the message says which joint."""
    plan = Plan("PUMA 560", (Motion(5, (0.0,) * 6, 0.0, 0.001, 1.0),))
    with pytest.raises(ModelError) as caught:
        Bench(PUMA, plan)
    assert (caught.value.slug, caught.value.where.joint) == ("run-too-short", 5)
