"""What a score test says of a candidate, and what Gram matrices say of runs left out, against dense refits."""

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag
from scipy.optimize import nnls
from searches import LEVER, Lab, design, left, lever, pendulum, roots, stacked
from worlds import PENDULUM

from pumaid.diagnosis.candidates import candidates, minus_log10_p
from pumaid.diagnosis.score_test import (
    ScoreTest,
    leave_out,
    refine_shape,
    replicate_folds,
    score_at,
    score_candidates,
    score_of,
    scores_at,
)
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Scope, catalogue
from pumaid.estimation.fit import Fit, Projector
from pumaid.simulation import Hidden

HIDDEN = Hidden("stribeck", 1, {"a": 0.1, "velocity": 0.3, "exponent": 1.0})


def solved_of(lab: Lab, seed: int = 1) -> Fit:
    """One experiment with noise."""
    return lab.fitted(lab.noisy(seed))


def gain(solved: Fit, added: EffectTerm, kept: np.ndarray) -> float:
    """By how much a dense refit with a candidate's `kept` columns lowers the square."""
    base, columns, target = stacked(solved, added)
    return left(base, target) - left(np.column_stack([base, columns[:, kept]]), target)


@pytest.mark.parametrize("lab", [lever, pendulum])
def test_statistic_is_the_fall_of_the_square(lab):
    """Of every effect at every joint, at one of its shapes, against a dense refit with what physics allows of it."""
    solved = solved_of(lab())
    trials = score_candidates(solved, candidates(solved)).trials
    chosen = {trial.added.key: trial for trial in trials}
    assert len(chosen) >= 14 * len(solved.joints)
    for trial in chosen.values():
        kept = np.flatnonzero(trial.sizes)
        assert trial.statistic == pytest.approx(gain(solved, trial.added, kept), rel=2e-4, abs=2e-4)


def test_statistic_is_close_to_the_whole_refit_where_ratios_of_gains_are_free():
    """A spring at the inner joint of a pendulum, ratio of gains fitted anew too, not linearised: within 5 %."""
    lab = Lab.of(PENDULUM, design(PENDULUM, postures=3), Hidden("spring", 1, {"a": 0.05}))
    solved = solved_of(lab)
    added = EffectTerm(catalogue()["spring"], 1, {})
    trial = score_at(Projector(solved), added)
    again = lab.fitted(lab.noisy(1), [added], noises=solved.noises)
    assert trial.statistic > 100.0
    assert trial.statistic == pytest.approx(solved.square - again.square, rel=0.05)
    np.testing.assert_allclose(trial.sizes, again.sizes(0), rtol=0.05)


def test_information_and_sizes_are_those_of_the_refit():
    """Parameters and their covariance are those of dense least squares over base and candidate."""
    solved = solved_of(Lab.of(LEVER, design(LEVER), HIDDEN))
    for name, shape in (("stribeck", {"velocity": 0.3, "exponent": 1.0}), ("ripple", {"frequency": 9.0})):
        trial = score_at(Projector(solved), EffectTerm(catalogue()[name], 1, shape))
        base, columns, target = stacked(solved, trial.added)
        whole = np.column_stack([base[:, np.any(base, axis=0)], columns])
        inverse, width = np.linalg.pinv(whole), columns.shape[1]
        np.testing.assert_allclose(trial.sizes, (inverse @ target)[-width:], rtol=1e-4)
        covariance = (inverse @ inverse.T)[-width:, -width:]
        np.testing.assert_allclose(np.linalg.inv(trial.information), covariance, rtol=1e-4, atol=1e-9)


def test_every_effect_is_tried_or_said_not_to_be():
    """Each that is no part of every model is tried, excluded or has a spectrum; one without data gets no test."""
    solved = solved_of(pendulum())
    tried = candidates(solved)
    keys = set(tried.groups) | set(tried.excluded)
    for effect in (effect for effect in catalogue().values() if not effect.base and effect.periodic is None):
        assert {(effect.name, owner) for owner in ((None,) if effect.scope is Scope.ARM else (1, 2))} <= keys
    assert tried.groups["thermal_friction", 1]  # of temperatures that no log has
    assert "thermal_friction" not in {trial.added.effect.name for trial in score_candidates(solved, tried).trials}


def test_what_the_model_has_is_not_tried_again():
    """An effect that is in the model at a joint is still tried at others, and one of another harmonic at the same."""
    lab = pendulum()
    shapes = {"spring": {}, "position_friction": {"harmonic": 2.0}}
    inside = [EffectTerm(catalogue()[name], 1, shape) for name, shape in shapes.items()]
    keys = candidates(lab.fitted(lab.noisy(1), inside)).groups.keys()
    assert ("spring", 1) not in keys and ("spring", 2) in keys
    assert (("position_friction", 1) in keys) == catalogue()["position_friction"].is_repeatable


def test_of_two_signed_parameters_the_wrong_one_is_held_at_zero():
    """Where one is wrong the gain is that of least squares with bounds, whatever the two share."""
    rng, checked = np.random.default_rng(5), 0
    added = EffectTerm(catalogue()["load_friction"], 1, {})
    for _ in range(200):
        A = rng.normal(size=(6, 2))
        y = rng.normal(size=6)
        plain = np.linalg.lstsq(A, y, rcond=None)[0]
        if np.all(plain < 0.0):
            continue
        scores = A * y[:, None]
        trial = score_of(added, scores, A.T @ A, share=np.ones(2), signs=np.ones(2))
        bounded, rest = nnls(A, y)
        assert trial.statistic == pytest.approx(float(y @ y) - rest**2, abs=1e-9)
        np.testing.assert_allclose(trial.sizes, bounded, atol=1e-9)
        checked += 1
    assert checked > 100


@pytest.mark.parametrize("freedoms", [1, 2, 3])
def test_surprise_is_the_tail_of_chi_square(freedoms):
    """-log10 of the chance where it can be told in numbers; beyond, it still rises as the tail's expansion does."""
    for value in (0.1, 1.0, 5.0, 50.0, 500.0):
        assert float(minus_log10_p(value, freedoms)) == pytest.approx(
            -np.log10(stats.chi2.sf(value, freedoms)), rel=1e-9
        )
    around = minus_log10_p(np.linspace(990.0, 1010.0, 50), freedoms)
    assert np.all(np.diff(around) > 0.0) and np.ptp(np.diff(around)) < 1e-4  # no step where the expansion takes over
    far = 1e5
    shape = far / 2.0 + (1.0 - freedoms / 2.0) * np.log(far / 2.0)
    constant = {1: np.log(np.pi) / 2.0, 2: 0.0, 3: np.log(np.pi) / 2.0 - np.log(2.0)}[freedoms]
    expected = (shape + constant) / np.log(10.0)
    assert float(minus_log10_p(far, freedoms)) == pytest.approx(expected, rel=1e-6)


def best(solved: Fit, name: str) -> tuple[ScoreTest, ScoreTest]:
    """An effect at joint 1 at the best point of its grid, and refined."""
    found = score_candidates(solved, candidates(solved, [catalogue()[name]])).best()[name, 1]
    return found, refine_shape(Projector(solved), found)


def test_refining_finds_the_best_of_a_dense_grid():
    """Stribeck's speed and exponent on 40 x 16 points: none is better by more than a twentieth of a unit."""
    solved = solved_of(Lab.of(LEVER, design(LEVER), HIDDEN))
    grid, found = best(solved, "stribeck")
    points = [{"velocity": v, "exponent": d} for v in np.geomspace(0.05, 2.0, 40) for d in np.linspace(0.5, 2.0, 16)]
    effect = catalogue()["stribeck"]
    dense = [one for one in scores_at(Projector(solved), [EffectTerm(effect, 1, p) for p in points]) if one is not None]
    highest = max(one.statistic for one in dense)
    assert found.statistic >= grid.statistic
    assert found.statistic > highest - 0.05
    # One draw of noise leaves the speed of the fall uncertain by a third.
    assert found.added.shape["velocity"] == pytest.approx(0.3, rel=0.5)


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
