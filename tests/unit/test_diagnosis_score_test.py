"""Noise of bins, score tests, the spectrum and runs left out, against dense algebra and refits bin by bin."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from monte_carlo import fit_with_replicates
from scipy import stats
from scipy.linalg import block_diag
from scipy.optimize import least_squares, nnls
from searches import LEVER, Din, Lab, covariances, design, left, lever, pendulum, roots, stacked, whitened
from worlds import PENDULUM, course, run_of

from pumaid.dataset import Run, first_motions
from pumaid.diagnosis.candidates import Spectrum, candidates, minus_log10_p, settling, spectrum
from pumaid.diagnosis.cross_validation import leave_out, refit_losses, replicate_folds
from pumaid.diagnosis.score_test import ScoreTest, refine_shape, score_at, score_candidates, score_of, scores_at
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Scope, catalogue
from pumaid.estimation import gls
from pumaid.estimation.fit import Fit, FitRow, Projector, design_of, loaded
from pumaid.estimation.gls import limits
from pumaid.estimation.noise import NoiseModel, noise_of
from pumaid.joint_bins import JointBins, joint_bins
from pumaid.model import Model
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
    for effect in (e for e in catalogue().values() if not (e.base or e.is_free) and e.periodic is None):
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
    lab = Lab.of(LEVER, design(LEVER), Hidden("stribeck", 1, {"a": 0.1, "velocity": 0.3, "exponent": 1.0}))
    solved = lab.fitted(lab.noisy(1))
    folds = replicate_folds(solved, [1])
    expected = [brute(solved, shapes, fold) for fold in folds]
    np.testing.assert_allclose(leave_out(solved, shapes, folds).falls, expected, rtol=1e-3, atol=1e-2)


def test_losses_of_a_refit_are_those_of_the_effect_beside_the_fit():
    """Of a wave, which is linear, it does not matter whether it was in the fit or is tried beside it."""
    wave = EffectTerm(catalogue()["ripple"], 1, {"frequency": 14.0})
    lab = Lab.of(LEVER, design(LEVER), Hidden("ripple", 1, {"cos": 0.02, "sin": 0.01, "frequency": 14.0}))
    without = lab.fitted(lab.noisy(1))
    folds, within = replicate_folds(without, [1]), lab.fitted(lab.noisy(1), [wave], without.noises)
    beside, refitted = leave_out(without, [wave], folds), refit_losses(without, within, folds)
    np.testing.assert_allclose(refitted.falls, beside.falls, rtol=5e-3)
    assert refitted.before == pytest.approx(beside.before, rel=1e-9)
    assert refitted.after == pytest.approx(beside.after, rel=0.03)


def test_falls_of_an_effect_in_several_joints():
    """What bends with joint 2's drive is fitted to the runs of both; a fold of one joint leaves the other's runs in."""
    lab = pendulum()
    solved = lab.fitted(lab.noisy(1))
    bent = [EffectTerm(catalogue()["flexibility"], 2, {})]
    assert all(np.any(bent[0].linear(solved.model.robot, row.bins.samples)) for row in solved.joints)
    folds = replicate_folds(solved, [1, 2])[::6]
    expected = [brute(solved, bent, fold) for fold in folds]
    np.testing.assert_allclose(leave_out(solved, bent, folds).falls, expected, rtol=1e-3, atol=1e-2)


def test_what_the_fit_holds_stays_held_where_runs_leave(monkeypatch):
    """Viscous friction that a fit holds at zero, as where data tell nothing of it, is not let go by a run that leaves.

    Before, a step away from a fit that was none was taken for it, and true effects were told to predict runs worse.
    """
    lab = Lab.of(LEVER, design(LEVER), HIDDEN)
    is_viscous = np.array([column.effect == "viscous" for column in lab.model.columns])
    monkeypatch.setattr(gls, "limits", lambda rows, model: np.where(is_viscous, 1e-9, limits(rows, model)))
    solved, folds = lab.fitted(lab.noisy(1)), [(1, (run,)) for run in range(0, 32, 5)]
    row = solved.by_bin[1]
    assert np.all(np.abs(solved.values[is_viscous]) < 1e-9) and np.all(row.bare[:, is_viscous].any(axis=0))
    without = solved.with_rows({1: replace(row, bare=np.where(is_viscous, 0.0, row.bare))})
    expected = [brute(without, STRIBECK, fold) for fold in folds]
    np.testing.assert_allclose(leave_out(solved, STRIBECK, folds).falls, expected, rtol=1e-3, atol=1e-2)


def test_what_the_model_draws_inside_bins_is_no_error():
    """These bins hold the course of the current and no noise inside; it made the error three quarters larger."""
    lab = Lab.of(LEVER, design(LEVER))
    row = lab.fitted(lab.noisy(1)).by_bin[1]
    of_bins = np.sqrt(np.average(row.misfit**2, weights=row.bins.count))
    assert row.rmse == pytest.approx(of_bins, rel=0.1)


def test_rmse_of_runs_left_out_is_that_of_samples():
    """Before and after are in A, over the samples of every run once, the variance inside bins included."""
    lab = Lab.of(LEVER, design(LEVER), Hidden("spring", 1, {"a": 0.1}))
    solved = lab.fitted(lab.noisy(1))
    row, squares, count = solved.by_bin[1], np.zeros(2), 0.0
    root = block_diag(*roots(row.bins, row.noise))
    inside = row.bins.inside_left(row.bins.current - row.misfit)
    designs = (row.bare, np.column_stack([row.bare, SPRING[0].linear(solved.model.robot, row.bins.samples)]))
    for _, runs in replicate_folds(solved, [1]):
        out = np.isin(row.bins.run, runs)
        for place, whole in enumerate(designs):
            size = np.linalg.norm(whole, axis=0) + 1e-300
            white = root[np.ix_(~out, ~out)]
            fitted = np.linalg.lstsq(white @ whole[~out] / size, white @ row.misfit[~out], rcond=1e-3)[0] / size
            left = row.misfit[out] - whole[out] @ fitted
            squares[place] += float(row.bins.count[out] @ (left**2 + inside[out]))
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
    assert all(len(runs) == 4 and len({alone.by_bin[1].bins.runs[k].speed for k in runs}) == 1 for runs in folds)


def test_what_the_other_runs_do_not_show_is_not_guessed():
    """A step between the first run and all others is seen in that run alone: without it nothing is predicted of it."""
    lab = lever()
    solved = lab.fitted(lab.noisy(0))
    field = solved.by_bin[1].bins
    second = float(field.samples.time[field.first[1]])
    step = [EffectTerm(catalogue()["friction_step"], 1, {"time": second - 0.5})]
    found = leave_out(solved, step, [(1, (0,))])
    assert found.falls[0] == pytest.approx(0.0, abs=1e-6)


BINS = 256
#: A wave of 90 periods a turn along runs of 3 rad, and 0.02 A of noise in a bin.
WAVE, NOISE = 90.0, 0.02


def waves_of(row: FitRow, **more) -> Spectrum | None:
    """The spectrum of what a fit leaves of a joint."""
    return spectrum(("ripple", row.bins.joint), row.bins, row.noise, white=row.residual, **more)


@cache
def lab(amplitude: float = 0.0, frequency: float = 40.0) -> Lab:
    """A lever with fine bins whose motor may have a ripple."""
    values = {"cos": amplitude, "sin": 0.5 * amplitude, "frequency": frequency}
    hidden = [Hidden("ripple", 1, values)] if amplitude else []
    return Lab.of(LEVER, design(LEVER, speeds=(0.5, 1.0)), *hidden, bins=BINS)


def solved_row(some: Lab, runs: tuple[Run, ...]) -> FitRow:
    """The fit of these runs on all their bins."""
    return loaded(fit_with_replicates(some.model, joint_bins(some.robot, runs, most=BINS))).by_bin[1]


@cache
def along(kind: str, runs: int, apart: float = 0.0) -> FitRow:
    """Runs there and back with the wave and noise, 300 bins each, and what the base model leaves of them."""
    # Every other pair of runs is made `apart` (rad) from the others.
    rng, made = np.random.default_rng(0), []
    for number in range(runs):
        start, end = (-1.5, 1.5) if number % 2 else (1.5, -1.5)
        away = apart * (number // 2 % 2)
        path = course(kind, start + away, end + away, duration=3.0, samples=300)
        current = np.sign(path[2]) + 0.05 * np.cos(WAVE * path[1] + 0.7) + rng.normal(0.0, NOISE, 300)
        made.append(run_of(LEVER, 1, [0.0], course=path, current=current, bins=300))
    return fit_with_replicates(Model.of_runs(LEVER, made), joint_bins(LEVER, made, most=300)).by_bin[1]


def dense(row: FitRow, frequency: float) -> tuple[np.ndarray, float]:
    """Scores of cosine and sine, and the fall of the square with both added to the fit, from dense whitening."""
    q = row.bins.samples.position[:, 0]
    waves = np.column_stack([np.cos(frequency * q), np.sin(frequency * q)])
    whole = np.column_stack([row.bare, waves, row.misfit])
    white = whitened(row.bins, row.noise, whole)
    p = row.bare.shape[1]
    fall = left(white[:, :p], white[:, -1]) - left(white[:, :-1], white[:, -1])
    return white[:, p:-1].T @ white[:, -1], fall


@pytest.mark.parametrize("amplitude", [0.0, 0.02])
def test_scores_are_those_of_dense_waves(amplitude):
    """Cosine and sine parts at five frequencies, within 3 % of the scores' own size (the grid's leak)."""
    row = solved_row(lab(amplitude), lab(amplitude).noisy(2))
    found = waves_of(row)
    for place in np.linspace(0, len(found.frequency) - 1, 5).astype(int):
        total, size = found.scores[:, place].sum(), np.sqrt(found.information[place])
        expected = dense(row, float(found.frequency[place]))[0]
        assert abs(complex(*expected) - complex(total.real, total.imag)) < 0.03 * (size + abs(total)) + 0.05 * size


def test_statistics_are_the_fall_of_the_square():
    """At the eight highest, within 6 % (the ends of runs and what the base model absorbs are left out)."""
    row = solved_row(lab(0.02), lab(0.02).noisy(2))
    found = waves_of(row)
    statistic = found.statistic()
    for place in np.argsort(-statistic)[:8]:
        assert statistic[place] == pytest.approx(dense(row, float(found.frequency[place]))[1], rel=0.06, abs=0.3)


@pytest.mark.parametrize("kind", ["constant", "stroke"])
@pytest.mark.parametrize("runs", [1, 3, 12])
def test_a_wave_is_found_where_it_is(kind, runs):
    """Within half a resolution, its size within 20 % (7 by the grid, the rest noise), and no flip comes near."""
    found = waves_of(along(kind, runs))
    top = int(np.argmax(found.statistic()))
    assert found.frequency[top] == pytest.approx(WAVE, abs=np.pi / 3.0)
    assert np.abs(found.scores.sum(axis=0)[top]) / found.information[top] == pytest.approx(0.05, rel=0.2)
    flips = np.random.default_rng(1).choice([-1.0, 1.0], (199, runs))
    assert np.quantile(found.highest(flips), 0.95) < 0.6 * found.statistic()[top]


def test_beside_a_wave_that_is_known_there_is_no_other():
    """The highest of what is left lies two resolutions of a run away from it at least."""
    found = waves_of(along("stroke", 12), without=[WAVE])
    top = found.frequency[int(np.argmax(found.statistic()))]
    assert abs(top - WAVE) >= 2.0 * 2.0 * np.pi / 3.0


def test_in_noise_each_frequency_is_chi_square_of_two():
    """Mean 2 and variance 4 over frequencies and experiments: within 5 and 15 %, correlated noise and all."""
    values = []
    for seed in range(12):
        row = solved_row(lab(), lab().noisy(seed))
        values.append(waves_of(row).statistic() / float(row.residual @ row.residual) * len(row.residual))
    values = np.concatenate(values)
    assert values.mean() == pytest.approx(2.0, rel=0.05)
    assert values.var() == pytest.approx(4.0, rel=0.15)


def test_flips_are_of_whole_runs():
    """The highest of all frequencies under given signs is what a loop over runs and frequencies gives."""
    found = waves_of(solved_row(lab(), lab().noisy(2)))
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(5, len(found.scores)))
    expected = []
    for flip in signs:
        total = sum(sign * scores for sign, scores in zip(flip, found.scores, strict=True))
        expected.append(max(abs(t) ** 2 / i for t, i in zip(total, found.information, strict=True)))
    np.testing.assert_allclose(found.highest(1.1 * signs), expected, rtol=1e-5)


@pytest.mark.parametrize(("amplitude", "is_found"), [(0.0, False), (0.02, True)])
def test_of_few_runs_pieces_are_flipped(amplitude, is_found):
    """Two runs cannot show by whole signs that noise has no ripple; sixteen pieces can, of noise and of ripple."""
    some = lab(amplitude, WAVE)
    found = waves_of(solved_row(some, some.noisy(0, Din(level=0.0))[:2]))
    assert found.is_pieces and len(found.scores) >= 12
    chance = float(np.mean(found.highest(np.ones((199, 2))) >= found.statistic().max()))
    assert chance < 0.01 if is_found else chance > 0.05


#: Draws of noise over which an estimate's mean is taken.
DRAWS = 60


@cache
def uneven() -> JointBins:
    """Runs of 12, 1, 2 and 7 bins."""
    path = course("constant", -1.0, 1.0, duration=2.0, samples=48)
    runs = [run_of(LEVER, 1, [0.0], course=path, current=np.sin(path[1]), bins=bins) for bins in (12, 1, 2, 7)]
    return joint_bins(LEVER, runs, begun=first_motions(runs))[0]


STATED = NoiseModel(
    np.array([0.6, 0.3, 0.9, 0.0]), np.array([0.02, 0.01, 0.03, 0.05]), np.full(4, 0.04), from_replicates=True
)
NO_LEVEL = NoiseModel(STATED.correlation, STATED.spread, np.zeros(4), from_replicates=True)


@pytest.mark.parametrize("stated", [STATED, NO_LEVEL])
def test_whitening_is_an_inverse_root_of_the_covariance(stated):
    """W' W times the covariance that is stated is the identity; unwhitening is W'."""
    root = stated.whiten(uneven(), np.eye(len(uneven())))
    np.testing.assert_allclose(root.T @ root @ block_diag(*covariances(uneven(), stated)), np.eye(22), atol=1e-9)
    v = np.random.default_rng(1).normal(size=len(uneven()))
    np.testing.assert_allclose(stated.unwhiten(uneven(), v), root.T @ v, rtol=1e-10, atol=1e-8)


def estimates(lab: Lab, din: Din, pattern: float = 0.0) -> list[NoiseModel]:
    """What is found in pure noise of a known kind, on a course of the position (A) that every run repeats."""
    (one,) = lab.bins()
    same = pattern * np.sin(5.0 * one.samples.position[:, 0])
    draws = [din.draw(np.random.default_rng(seed), one.lengths) for seed in range(DRAWS)]
    return [noise_of(one, same + drawn) for drawn in draws]


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("pattern", [0.0, 0.1])
def test_replicates_show_the_noise_whatever_the_model_misses(correlation, pattern):
    """Correlation and spread within 3 %, the level's square within 4 standard errors, beside ten times the physics."""
    din = Din(spread=0.01, correlation=correlation, level=0.006)
    found = estimates(lever(), din, pattern)
    assert all(one.from_replicates for one in found)
    assert np.mean([one.correlation.mean() for one in found]) == pytest.approx(correlation, abs=0.03)
    assert np.mean([one.spread.mean() for one in found]) == pytest.approx(0.01, rel=0.03)
    squares = np.array([float(one.level[0]) ** 2 for one in found])
    assert abs(squares.mean() - 0.006**2) < 4.0 * squares.std() / np.sqrt(DRAWS)


def test_without_replicates_missing_physics_passes_for_noise():
    """The residual alone takes what the runs share for noise: twice the spread here; none where nothing hides."""
    din = Din(spread=0.01, correlation=0.5, level=0.006)
    unrepeated = Lab.of(LEVER, design(LEVER, postures=1, speeds=(0.25, 0.35, 0.5, 0.7, 1.0, 1.5), repeats=1))
    clean, missing = (estimates(unrepeated, din, pattern) for pattern in (0.0, 0.03))
    assert not any(one.from_replicates for one in clean + missing)
    assert np.mean([one.spread.mean() for one in clean]) == pytest.approx(0.01, rel=0.05)
    assert np.mean([one.spread.mean() for one in missing]) > 2.0 * 0.01


def test_short_runs_hide_correlation_and_that_is_mended():
    """With 16 bins a run the plain estimate of a correlation of 0.8 is short by 0.2; what is told is within 0.06."""
    short = Lab.of(LEVER, design(LEVER), bins=16)
    (one,) = short.bins()
    plain = []
    for seed in range(DRAWS):
        parts = np.split(Din(correlation=0.8).draw(np.random.default_rng(seed), one.lengths), one.first[1:])
        centred = [part - part.mean() for part in parts]
        plain.append(sum(c[1:] @ c[:-1] for c in centred) / sum(c @ c for c in centred))
    found = estimates(short, Din(correlation=0.8))
    assert np.mean(plain) < 0.62
    assert np.mean([one.correlation.mean() for one in found]) == pytest.approx(0.8, abs=0.06)
    assert np.mean([one.spread.mean() for one in found]) == pytest.approx(0.01, rel=0.1)


def test_runs_whose_cells_last_otherwise_have_their_own_noise(monkeypatch):
    """Slow runs made noisy and quick ones quiet are told apart, though they repeat in one field."""
    monkeypatch.setattr("pumaid.estimation.noise.FEWEST_BINS", 200)
    (one,) = lever().bins()
    is_slow = np.abs([run.speed for run in one.runs]) < 0.4
    rng, parts = np.random.default_rng(3), []
    for length, slow in zip(one.lengths, is_slow, strict=True):
        parts.append(Din(0.02 if slow else 0.005, 0.7 if slow else 0.2, 0.0).draw(rng, [length]))
    found = noise_of(one, np.concatenate(parts))
    for group, spread, correlation in ((is_slow, 0.02, 0.7), (~is_slow, 0.005, 0.2)):
        np.testing.assert_allclose(found.spread[group], spread, rtol=0.15)
        np.testing.assert_allclose(found.correlation[group], correlation, atol=0.15)


def test_no_noise_at_all_is_not_zero():
    """What a simulation without noise leaves is rounding; a spread of nothing could not be divided by."""
    (one,) = lever().bins()
    assert np.all(noise_of(one, np.zeros(len(one))).spread > 0.0)


FALLING = EffectTerm(catalogue()["stribeck"], 1, {"velocity": 0.3, "exponent": 1.0})
WARMUP = EffectTerm(catalogue()["warmup"], 1, {"time_constant": 60.0})
SPRUNG = EffectTerm(catalogue()["spring"], 1, {})


class Written:
    """The bilinear problem in the paper's words: link parameters of an outer link times a ratio of gains."""

    def __init__(self, fitted: Fit) -> None:
        self.fitted, self.base = fitted, Model(fitted.model.robot)
        self.edges = fitted.gains.edges
        self.begin = np.concatenate([fitted.values, [fitted.gains.edge[edge] for edge in self.edges]])
        self.roots = [block_diag(*roots(row.bins, row.noise)) for row in fitted.joints]
        self.designs = {row.bins.joint: design_of(fitted.model, row.bins, fitted) for row in fitted.joints}

    def predicted(self, joint: int, theta: np.ndarray) -> np.ndarray:
        """(N,) A in a joint, column after column."""
        out = np.zeros(len(self.designs[joint]))
        for number, column in enumerate(self.fitted.model.columns):
            ratio = 1.0
            if column.scope is Scope.LINK:
                for member in range(joint, column.owner):
                    ratio *= theta[len(self.fitted.values) + self.edges.index(member)]
            out += ratio * theta[number] * self.designs[joint][:, number]
        return out

    def misfits(self, theta: np.ndarray) -> np.ndarray:
        """All whitened residuals, and how far effects are from what is likely before any data."""
        parts = [
            root @ (row.bins.current - self.predicted(row.bins.joint, theta))
            for root, row in zip(self.roots, self.fitted.joints, strict=True)
        ]
        return np.concatenate([*parts, (self.fitted.prior * theta)[: len(self.fitted.values)]])

    def least(self) -> np.ndarray:
        """The minimum, from what was found moved by a tenth."""
        return least_squares(self.misfits, 0.9 * self.begin, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).x


def noisy(lab: Lab, *added: EffectTerm) -> Fit:
    """An experiment with noise, solved."""
    return lab.fitted(lab.noisy(3), added)


@pytest.mark.parametrize("added", [(), (SPRUNG,)])
def test_the_minimum_is_that_of_the_whole_problem(added):
    """Residuals of both joints agree with a general least-squares program on dense, Cholesky-whitened residuals."""
    solved = noisy(pendulum(), *added)
    written = Written(solved)
    theta = written.least()
    for row in solved.joints:
        misfit = row.bins.current - written.predicted(row.bins.joint, theta)
        np.testing.assert_allclose(row.misfit, misfit, atol=1e-6)
    total = float(np.sum(written.misfits(theta)[: solved.size] ** 2))
    assert solved.square == pytest.approx(total, rel=1e-8)


def test_effects_and_their_shapes_are_fitted_with_all_else():
    """One joint is linear: the square is what a dense fit of base, effects and derivatives by their shapes leaves."""
    # To a thousandth: shapes have a prior in the fit.
    solved = noisy(lever(), FALLING, WARMUP)
    row = solved.by_bin[1]
    columns = [Model(lever().robot).design(row.bins)]
    for one in solved.model.effects:
        here = one.linear(solved.model.robot, row.bins.samples)
        near = [replace(one, shape={**one.shape, name: value * 1.0001}) for name, value in one.shape.items()]
        columns += [here, *[other.linear(solved.model.robot, row.bins.samples) - here for other in near]]
    dense = whitened(row.bins, row.noise, np.column_stack([*columns, row.bins.current]))
    assert solved.square == pytest.approx(left(dense[:, :-1], dense[:, -1]), rel=1e-3)


def test_settling_is_free_at_every_speed_and_nowhere_else():
    """A transient of each speed's own size at the start of runs leaves nothing; the same in mid-run stays."""
    lab = lever()
    (field,) = lab.bins()
    t = field.samples.travel / np.abs(field.samples.velocity[:, 0])
    own = np.abs(field.samples.velocity[:, 0]) ** 0.3
    early, late = (0.3 * field.samples.direction * own * np.exp(-np.abs(t - at) / 0.025) for at in (0.0, 1.0))
    (free,) = settling([field])
    columns = np.column_stack([lab.model.design(field), free.linear(lab.model.robot, field.samples)])
    assert left(columns, early) < 1e-6 * float(early @ early)
    assert left(columns, late) > 0.5 * float(late @ late)
