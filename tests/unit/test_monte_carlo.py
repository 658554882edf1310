"""Runs without logs are the runs that logs would leave."""

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.joint_bins import joint_bins
from pumaid.simulation import Bench, table1
from pumaid.trajectory import Motion, Plan

PUMA, PAPER = table1.puma560(), table1.experiment()


def test_noise_free_bins_hold_the_truth():
    """Bins have all samples of a run, and are fitted by the cosine, sine and constant of the truth's current."""
    truth = PUMA.with_noise(0.0)
    for run in Bench(truth, PAPER).runs(np.random.default_rng(0))[::7]:
        assert run.bins.count.sum() == run.samples
        (bins,) = joint_bins(truth.robot, [run])
        columns = np.column_stack([bins.harmonic, np.ones(len(bins))])
        fitted = np.linalg.lstsq(columns, bins.current, rcond=None)[0]
        q = np.linspace(*run.span, 1000)
        position = np.tile(np.nan_to_num(run.posture), (1000, 1))
        position[:, run.joint - 1] = q
        current = truth.gravity_current(position)[:, run.joint - 1]
        current += truth.friction.current(run.joint, np.full(1000, run.speed))
        assert np.max(np.abs(np.column_stack([np.cos(q), np.sin(q), np.ones(1000)]) @ fitted - current)) < 1e-8


def test_held_out_runs_are_marked():
    """What the plan keeps for judging is marked in the runs."""
    motions = (Motion(2, (0.0,) * 6, -1.0, 1.0, 0.5), Motion(2, (0.0,) * 6, 1.0, -1.0, 0.5, "heldout"))
    runs = Bench(PUMA, Plan("PUMA 560", motions)).runs(np.random.default_rng(0))
    assert [(run.heldout, run.direction) for run in runs] == [(False, 1), (True, -1)]


def test_levels_differ_between_runs_and_experiments():
    """Two experiments on one bench differ, by the noise that the truth states."""
    bench, rng = Bench(PUMA, PAPER), np.random.default_rng(8)
    first, second = bench.runs(rng), bench.runs(rng)
    means = np.array(
        [[run.bins.current.mean() for run in experiment if run.joint == 2] for experiment in (first, second)]
    )
    # 20 differences of two levels, each of variance 2 x 0.2 x std^2, know their size to 16 %; three sigmas.
    assert np.std(means[0] - means[1]) == pytest.approx(np.sqrt(0.4) * PUMA.noise.std[1], rel=0.5)


def test_a_run_without_constant_speed_is_refused():
    """A span that the ramps fill leaves no run, and the message says which joint."""
    plan = Plan("PUMA 560", (Motion(5, (0.0,) * 6, 0.0, 0.001, 1.0),))
    with pytest.raises(ModelError) as caught:
        Bench(PUMA, plan)
    assert (caught.value.slug, caught.value.where.joint) == ("run-too-short", 5)
