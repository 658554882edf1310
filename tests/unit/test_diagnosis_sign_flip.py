"""One chance for the whole catalogue: as often wrong as it says where nothing is missing, whatever the noise."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats
from searches import Din, Lab, lever, pendulum

from pumaid.diagnosis.candidates import candidates, settling
from pumaid.diagnosis.score_test import ScoreTable, SignFlips, score_candidates, sign_flips
from pumaid.effect_spec import EffectTerm

NOISES = {"normal": Din(), "heavy": Din(is_heavy=True), "levels": Din(correlation=0.8, level=0.02)}
LABS = {"lever": lever, "pendulum": pendulum}
#: Experiments with each noise in the tests marked slow.
DRAWS = 40
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
    ("name", "draws"), [("lever", 25), pytest.param("pendulum", DRAWS, marks=pytest.mark.slow)], ids=LABS
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
    """In all of these experiments together some p-values are below 0.05: none would be a rate below one in 60."""
    alarms = [np.count_nonzero(chances("pendulum", kind, DRAWS)[0] <= 0.05) for kind in NOISES]
    assert sum(alarms) > 0


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
    np.testing.assert_allclose(fast.largest, np.sort(largest), atol=1e-8)
