"""One chance for the whole catalogue: as often wrong as it says, and an effect of the limit's size found in time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats
from searches import LEVER, Din, Lab, design, lever, pendulum
from worlds import PENDULUM

from pumaid.diagnosis.candidates import candidates, settling
from pumaid.diagnosis.detection_limits import detection_limits, needed
from pumaid.diagnosis.records import Limit
from pumaid.diagnosis.score_test import (
    FEW_RUNS,
    LEVEL,
    ScoreTable,
    SignFlips,
    chance_of_pieces,
    score_candidates,
    sign_flips,
)
from pumaid.diagnosis.stepwise import Step, Stepwise
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.simulation import Hidden

NOISES = {"normal": Din(), "heavy": Din(is_heavy=True), "levels": Din(correlation=0.8, level=0.02)}
LABS = {"lever": lever, "pendulum": pendulum}
#: Experiments with each noise in the tests marked slow.
DRAWS = 24
#: One effect of each kind that is looked at by itself: between runs, within runs, in time, with the load.
ALONE = (("viscous_power", 1), ("spring", 1), ("warmup", 1), ("load_friction", 1))


def seen(found: ScoreTable, chances: SignFlips) -> float:
    """Chance of the best candidate of a scan."""
    best = found.best().items()
    return min(chances.p_value(k, v.surprise(found.solved.scale)) for k, v in best)


@cache
def settled(lab: Lab) -> tuple[EffectTerm, ...]:
    """What every experiment of a lab has beside its base model, whatever its noise."""
    return settling(lab.bins())


def clean(lab: Lab, kind: str, seed: int) -> ScoreTable:
    """Every effect tried where nothing is missing."""
    solved = lab.fitted(lab.noisy(seed, NOISES[kind]), settled(lab))
    return score_candidates(solved, candidates(solved))


@cache
def judged(name: str, kind: str, seed: int) -> tuple[float, list[float]]:
    """Chance of the best of the catalogue in one clean experiment, and of each effect that is looked at alone."""
    found = clean(LABS[name](), kind, seed)
    ones = [replace(found, trials=tuple(t for t in found.trials if t.added.key == key)) for key in ALONE]
    return seen(found, sign_flips(found)), [seen(one, sign_flips(one, flips=299)) for one in ones]


def chances(name: str, kind: str, draws: int) -> tuple[np.ndarray, np.ndarray]:
    """(B,) chances of the best of the catalogue, and (B, 4) of effects that are looked at alone, in clean data."""
    whole, alone = zip(*(judged(name, kind, seed) for seed in range(draws)), strict=True)
    return np.array(whole), np.array(alone)


def most(draws: int, level: float) -> int:
    """Alarms beyond which a rate of `level` is not believed: once in a thousand such tests."""
    return int(stats.binom.ppf(0.999, draws, level))


@pytest.mark.parametrize(
    ("name", "draws"), [("lever", 20), pytest.param("pendulum", DRAWS, marks=pytest.mark.slow)], ids=LABS
)
@pytest.mark.parametrize("kind", NOISES)
def test_clean_data_raise_few_alarms(name, draws, kind):
    """Of the whole catalogue and of an effect chosen beforehand: p-values below 0.05 in no more than one in twenty."""
    whole, alone = chances(name, kind, draws)
    for level in (0.05, 0.2):
        assert np.count_nonzero(whole <= level) <= most(draws, level)
        assert np.all(np.count_nonzero(alone <= level, axis=0) <= most(draws, level))


@pytest.mark.slow
def test_power_is_not_thrown_away():
    """In all of these experiments together some p-values are below 0.05: none would be a rate below one in 24."""
    alarms = [np.count_nonzero(chances("pendulum", kind, DRAWS)[0] <= 0.05) for kind in NOISES]
    assert sum(alarms) > 0


@cache
def few() -> Lab:
    """A lever in one posture, nothing repeated."""
    return Lab.of(LEVER, design(LEVER, postures=1, repeats=1))


@pytest.mark.parametrize("kind", NOISES)
def test_pieces_of_few_runs_raise_few_alarms(kind):
    """Of effects chosen beforehand, 30 experiments: p-values below 0.05 in no more than one in twenty."""
    scans = [clean(few(), kind, seed) for seed in range(30)]
    assert len(scans[0].leverage) < FEW_RUNS
    for key in ALONE:
        alone = [(scan.solved, scan.best()[key]) for scan in scans if key in scan.best()]
        p_values = np.array([chance_of_pieces(solved, trial, 1) for solved, trial in alone])
        assert all(np.count_nonzero(p_values <= level) <= most(len(scans), level) for level in (0.05, 0.2))


def test_flips_are_what_a_loop_over_flips_gives():
    """Handicaps and the sorted largest, of each candidate's best shape, one flip and one variant after the other."""
    found = clean(pendulum(), "normal", 3)
    found = replace(found, trials=found.trials[::9])
    fast = sign_flips(found, flips=40)
    signs = np.random.default_rng(20_261).choice([-1.0, 1.0], size=(40, len(found.leverage)))
    best: dict = {}
    for trial in found.trials:
        for number, flip in enumerate(signs):
            total = (flip * found.leverage) @ trial.scores
            statistic = float(total @ np.linalg.pinv(trial.information) @ total) / found.solved.scale
            if trial.width == 1 and total[0] * trial.signs[0] < 0.0:
                statistic = 0.0
            tail = stats.chi2.sf(statistic, trial.width)
            best.setdefault(trial.added.key, np.zeros(40))
            best[trial.added.key][number] = max(best[trial.added.key][number], -np.log10(tail))
    for key, values in best.items():
        assert fast.handicaps[key] == pytest.approx(float(np.quantile(values, 0.98)), rel=1e-6)
    largest = np.max([values - np.quantile(values, 0.98) for values in best.values()], axis=0)
    np.testing.assert_allclose(fast.largest, np.sort(largest), rtol=1e-6, atol=1e-6)


DIN = Din(spread=0.01, correlation=0.5, level=0.004)


def look(lab: Lab, seed: int, added: EffectTerm | None = None, size: float = 0.0) -> Step:
    """One look at an experiment in which an effect of joint 1 draws `size` times its first column more."""
    search = Stepwise(lab.model, lab.noisy(seed, DIN))
    if added is not None:
        (field,) = search.fits.bins[0]
        loads = lab.fitted(lab.runs).by_bin[1].bins.samples.loads
        column = added.linear(lab.model.robot, replace(field.samples, loads=loads))[:, 0]
        search.fits.bins = 2 * [(replace(field, current=field.current + size * column),)]
    return search.look([])


def test_pieces_show_what_flips_of_few_runs_cannot():
    """Springs that draw ten deviations, in eight runs: named, though to flips of whole runs each may be chance."""
    spring = EffectTerm(catalogue()["spring"], 1, {})
    scan = look(few(), 0).scan
    error = float(np.sqrt(scan.solved.scale / scan.best()["spring", 1].information[0, 0]))
    for seed in (1, 2, 3):
        step = look(few(), seed, spring, 10.0 * error)
        trial = step.scan.best()["spring", 1]
        assert step.family.p_value(trial.added.key, trial.surprise(step.scan.solved.scale)) > LEVEL
        assert step.chosen is not None and step.chosen.p_value <= LEVEL
        assert ("spring", 1) in [item.key for item in (step.chosen, *step.chosen.rivals)]


def told(step: Step) -> dict:
    """All limits of a look."""
    return detection_limits(step.scan, step.family)


def test_an_effect_of_the_limits_size_is_found_four_times_in_five():
    """Found and named (rivals count) as a binomial of 0.8 is in 99.8 % of cases; a third of the size is not."""
    # A spring has one shape, so that the limit is not a median over shapes.
    added = EffectTerm(catalogue()["spring"], 1, {})
    limit = float(np.mean([told(look(lever(), seed))["spring", 1].size for seed in (901, 902, 903)]))
    hits = {}
    for share, draws in ((1.0, 20), (0.33, 6)):
        hits[share] = 0
        for seed in range(draws):
            found = look(lever(), seed, added, (1.0, -1.0)[seed % 2] * share * limit)
            named = [found.chosen, *found.chosen.rivals] if found.chosen is not None else []
            hits[share] += ("spring", 1) in [one.key for one in named]
    low, high = stats.binom.ppf([0.001, 0.999], 20, 0.8)
    assert low <= hits[1.0] <= high
    assert hits[0.33] <= 2


@pytest.mark.parametrize("freedoms", [1, 2, 4])
@pytest.mark.parametrize("alarm", [2.0, 4.0, 6.0])
def test_the_shift_that_is_needed_has_four_fifths_power(freedoms, alarm):
    """Of a non-central chi-square with that shift: exactly so with one degree, and no less than 0.8 with more."""
    beyond = float(stats.chi2.isf(10.0**-alarm, freedoms))
    power = float(stats.ncx2.sf(beyond, freedoms, needed(alarm, freedoms, runs=1e9) ** 2))
    assert power == pytest.approx(0.8, abs=0.005) if freedoms == 1 else 0.8 < power < 0.95


def test_limits_are_of_every_effect_and_joint():
    found = told(look(pendulum(), 1))
    assert len(found) >= 2 * 14
    assert {(name, joint) for name in ("ripple", "load_ripple") for joint in (1, 2)} <= found.keys()
    for key, limit in found.items():
        assert isinstance(limit, Limit) and (limit.effect, limit.joint) == key
        assert (limit.size is None) != (limit.reason is None)
        assert limit.size is None or (0.0 < limit.size < np.inf and limit.unit)


def test_more_noise_and_fewer_runs_raise_limits():
    """Over two experiments each: twice the noise twice the limit (15 %), a quarter of the runs half more."""
    few = Lab.of(LEVER, design(LEVER, postures=1, repeats=1))
    loud = replace(DIN, spread=2 * DIN.spread, level=2 * DIN.level)
    sizes = []
    for lab, din in ((lever(), DIN), (lever(), loud), (few, DIN)):
        found = [told(Stepwise(lab.model, lab.noisy(seed, din)).look([])) for seed in (1, 2)]
        sizes.append(np.mean([one["spring", 1].size for one in found]))
    assert sizes[1] / sizes[0] == pytest.approx(2.0, rel=0.15)
    assert 1.5 < sizes[2] / sizes[0] < 8.0


def test_a_ripples_limit_is_the_amplitude_that_is_found():
    """Where the spectrum tells as much as in the median: at it in three of four or more, at three tenths seldom."""
    first = look(lever(), 905)
    limit, spectrum = told(first)["ripple", 1].size, first.scan.spectra[0]
    information = (spectrum.information * spectrum.power)[spectrum.visible]
    place = np.abs(information - np.median(information)).argmin()
    at, remains = float(spectrum.frequency[place]), float(np.sqrt(spectrum.power[place]))  # of a wave, in bins' means
    wave = EffectTerm(catalogue()["ripple"], 1, {"frequency": at})
    hits = {}
    for share in (0.3, 1.0):
        looks = [look(lever(), seed, wave, share * remains * limit) for seed in range(8)]
        hits[share] = sum(one.chosen is not None and one.chosen.key == ("ripple", 1) for one in looks)
    assert hits[0.3] <= 3 and hits[1.0] >= 6


@pytest.mark.parametrize(
    ("name", "lacking"), [("stribeck", {"speeds": (0.5,)}), ("inertia", {}), ("thermal_friction", {})]
)
def test_what_is_absorbed_says_which_runs_show_it(name, lacking):
    """One speed, steady speeds, no temperatures: the reason names the runs in which the effect is seen."""
    step = look(Lab.of(PENDULUM, design(PENDULUM, **lacking)), 1)
    reasons = [limit.reason for key, limit in told(step).items() if key[0] == name and limit.size is None]
    assert len(reasons) == 2 and all(catalogue()[name].seen_in in reason for reason in reasons)


def test_every_effect_says_which_runs_show_it():
    assert [name for name, effect in catalogue().items() if not (effect.base or effect.seen_in)] == []


@pytest.mark.parametrize("seed", [1, 2])
def test_what_a_joint_lacks_is_no_noise_of_it_while_another_joint_leads(seed):
    """Five repeats that differ by warm-up of joint 2 hid it as long as load friction of joint 1 came first."""
    plan = design(PENDULUM, postures=3, speeds=(0.3, 0.6, 1.2), repeats=5)
    warmup = Hidden("warmup", 2, {"a": 0.08, "time_constant": 400.0})
    lab = Lab.of(PENDULUM, plan, Hidden("load_friction", 1), warmup)
    found = Stepwise(lab.model, lab.noisy(seed, DIN)).look([])
    assert found.chosen is not None and found.chosen.key == ("load_friction", 1)
    assert next(item for item in found.evaluated if item.key == ("warmup", 2)).fault is None


def test_what_a_resting_joint_causes_is_looked_for_where_it_can_be():
    """A coupling of a joint that never moved was looked for at joint 25 of the arm, and the program fell."""
    lab = Lab.of(PENDULUM, design(PENDULUM, [1]))
    groups = candidates(lab.fitted(lab.runs)).groups
    assert [term.shape for term in groups["coupling", 2]] == [{"on": 1.0}]
    Stepwise(lab.model, lab.noisy(1, DIN)).look([])
