"""Runs left out: what the Gram matrices say is what refits without those runs predict."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from searches import LEVER, Lab, design, lever, pendulum, roots, stacked

from pumaid.diagnosis.score_test import leave_out, replicate_folds
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.estimation.fit import Fit
from pumaid.simulation import Hidden

STRIBECK = [EffectTerm(catalogue()["stribeck"], 1, {"velocity": v, "exponent": 1.0}) for v in (0.1, 0.3, 0.8)]
SPRING = [EffectTerm(catalogue()["spring"], 1, {})]
LOADED = [EffectTerm(catalogue()["load_friction"], 1, {})]


def brute(solved: Fit, shapes: list[EffectTerm], fold: tuple[int, tuple[int, ...]]) -> float:
    """Fit without the fold, with and without the shape that is best there; the fall of the square in the fold."""
    joint, runs = fold
    out = np.concatenate([(row.bins.joint == joint) & np.isin(row.bins.run, runs) for row in solved.joints])
    squares = []
    for added in shapes:
        base, columns, target = stacked(solved, added)
        whole = np.column_stack([base, columns])
        size = np.linalg.norm(whole, axis=0) + 1e-300
        fitted = np.linalg.lstsq(whole[~out] / size, target[~out], rcond=1e-3)[0] / size
        plain = np.linalg.lstsq(base[~out] / size[: base.shape[1]], target[~out], rcond=1e-3)[0]
        before = target - base @ (plain / size[: base.shape[1]])
        after = target - whole @ fitted
        squares.append((float(after[~out] @ after[~out]), float(before[out] @ before[out] - after[out] @ after[out])))
    return min(squares)[1]


@pytest.mark.parametrize("shapes", [STRIBECK, SPRING, LOADED], ids=["stribeck", "spring", "load_friction"])
def test_falls_are_those_of_refits_without_the_runs(shapes):
    """Fold by fold, shapes chosen anew without it."""
    lab = Lab.of(LEVER, design(LEVER), Hidden("stribeck", 1, {"a": 0.1, "velocity": 0.3, "exponent": 1.0}))
    solved = lab.fitted(lab.noisy(1))
    folds = replicate_folds(solved, [1])
    expected = [brute(solved, shapes, fold) for fold in folds]
    np.testing.assert_allclose(leave_out(solved, shapes, folds).falls, expected, rtol=1e-3, atol=1e-2)


def test_falls_of_an_effect_in_several_joints():
    """What bends with joint 2's drive is fitted to the runs of both; a fold of one joint leaves the other's runs in."""
    lab = pendulum()
    solved = lab.fitted(lab.noisy(1))
    bent = [EffectTerm(catalogue()["flexibility"], 2, {})]
    assert all(np.any(bent[0].linear(solved.model.robot, row.bins.samples)) for row in solved.joints)
    folds = replicate_folds(solved, [1, 2])[::6]
    expected = [brute(solved, bent, fold) for fold in folds]
    np.testing.assert_allclose(leave_out(solved, bent, folds).falls, expected, rtol=1e-3, atol=1e-2)


def test_rmse_of_runs_left_out_is_that_of_samples():
    """Before and after are in A, over the samples of every run once, the variance inside bins included."""
    lab = Lab.of(LEVER, design(LEVER), Hidden("spring", 1, {"a": 0.1}))
    solved = lab.fitted(lab.noisy(1))
    row, squares, count = solved.row(1), np.zeros(2), 0.0
    root = block_diag(*roots(row.bins, row.noise))
    designs = (row.bare, np.column_stack([row.bare, SPRING[0].linear(solved.model.robot, row.bins.samples)]))
    for _, runs in replicate_folds(solved, [1]):
        out = np.isin(row.bins.run, runs)
        for place, whole in enumerate(designs):
            size = np.linalg.norm(whole, axis=0) + 1e-300
            white = root[np.ix_(~out, ~out)]
            fitted = np.linalg.lstsq(white @ whole[~out] / size, white @ row.misfit[~out], rcond=1e-3)[0] / size
            left = row.misfit[out] - whole[out] @ fitted
            squares[place] += float(row.bins.count[out] @ (left**2 + row.bins.inside[out]))
        count += float(row.bins.count[out].sum())
    found = leave_out(solved, SPRING, replicate_folds(solved, [1]))
    np.testing.assert_allclose([found.before, found.after], np.sqrt(squares / count), rtol=1e-4)
    assert found.after < found.before


def test_repeated_runs_leave_together():
    """Else a run's twin would tell what is missing in it; every run leaves once."""
    alone = lever().fitted(lever().noisy(0))
    folds = [runs for _, runs in replicate_folds(alone, [1])]
    assert sorted(run for runs in folds for run in runs) == list(range(32))
    # A single joint has one posture: both "postures" of the design are the same to it.
    assert all(len(runs) == 4 and len({alone.row(1).bins.runs[k].speed for k in runs}) == 1 for runs in folds)


def test_what_the_other_runs_do_not_show_is_not_guessed():
    """A step between the first run and all others is seen in that run alone: without it nothing is predicted of it."""
    lab = lever()
    solved = lab.fitted(lab.noisy(0))
    field = solved.row(1).bins
    second = float(field.samples.time[field.first[1]])
    step = [EffectTerm(catalogue()["friction_step"], 1, {"time": second - 0.5})]
    found = leave_out(solved, step, [(1, (0,))])
    assert found.falls[0] == pytest.approx(0.0, abs=1e-6)
