"""What a finding says of itself: what runs held out show of it by dense least squares, sizes that are known, rivals."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from searches import LEVER, Din, Lab, design, lever

from pumaid.dataset import Dataset
from pumaid.diagnosis.diagnose import diagnose, sizes
from pumaid.diagnosis.records import DOUBTFUL, UNEXPLAINED_JOINT, Transfer
from pumaid.diagnosis.score_test import confirmed_share
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.estimation.fit import Fit, elsewhere
from pumaid.simulation import Hidden

SPRING = EffectTerm(catalogue()["spring"], 1, {})
HELD = design(LEVER, postures=1, speeds=(0.4, 0.8), repeats=1, seed=9)


@cache
def sprung() -> Lab:
    """The lever with a spring that the model does not know."""
    return Lab.of(LEVER, design(LEVER), Hidden("spring", 1, {"a": 0.02}))


@cache
def later(is_sprung: bool) -> Lab:
    """Other runs of it, with or without the spring."""
    hidden = [Hidden("spring", 1, {"a": 0.02})] if is_sprung else []
    return Lab.of(LEVER, HELD, *hidden)


def judged(seed: int, *, is_sprung: bool) -> tuple[Transfer | None, Fit, tuple]:
    """A spring fitted to runs that have it, held against others."""
    solved = sprung().fitted(sprung().noisy(seed), [SPRING])
    held = sprung().bins(later(is_sprung).noisy(1000 + seed))
    return confirmed_share(solved, SPRING, held), solved, held


def test_share_is_that_of_least_squares_over_all_runs():
    """One parameter more, the effect in the held-out runs alone, its own size held: by dense algebra."""
    found, solved, (field,) = judged(3, is_sprung=True)
    row, fitted, own = elsewhere(solved, field), solved.row(1), len(solved.inverse) - 1
    only = row.noise.whiten(row.bins, SPRING.linear(solved.model.robot, row.bins.samples) @ solved.sizes(0))
    rest = np.vstack([np.delete(one.jacobian, own, axis=1) for one in (fitted, row)])
    columns = np.column_stack([rest, np.concatenate([0.0 * fitted.residual, only])])
    target = np.concatenate([0.0 * fitted.residual, row.residual])
    size = np.linalg.norm(columns, axis=0) + 1e-300
    inverse = np.linalg.pinv(columns / size, rcond=1e-9)
    assert found is not None
    assert found.share - 1.0 == pytest.approx((inverse @ target)[-1] / size[-1], abs=1e-6)
    weights = inverse[-1][len(fitted.bins) :] / size[-1]
    spread = np.eye(len(row.bins)) + row.jacobian @ solved.inverse @ row.jacobian.T
    assert found.std_error == pytest.approx(np.sqrt(solved.scale * weights @ spread @ weights), rel=1e-4)
    assert found.lost == pytest.approx(
        (row.residual @ row.residual - np.sum((row.residual + only) ** 2)) / solved.scale
    )


def test_what_is_there_is_seldom_denied_and_what_is_not_always():
    """30 experiments: shares scatter about one by their errors; of a spring that the later runs lack none is shown."""
    there = [judged(seed, is_sprung=True)[0] for seed in range(30)]
    gone = [judged(seed, is_sprung=False)[0] for seed in range(10)]
    z = np.array([(one.share - 1.0) / one.std_error for one in there])
    assert abs(z.mean()) < 0.5 and 0.7 < z.std() < 1.4
    assert not any(one.is_denied for one in there)
    assert all(one.is_denied and abs(one.share) < 0.35 for one in gone)


def test_runs_that_cannot_show_it_say_nothing():
    """A spring in noise far larger than itself."""
    solved = sprung().fitted(sprung().noisy(1), [SPRING])
    loud = sprung().fitted(lever().noisy(1, Din(spread=2.0, level=1.0)), [SPRING])
    assert confirmed_share(loud, SPRING, sprung().bins(later(True).noisy(5, Din(spread=2.0, level=1.0)))) is None
    assert confirmed_share(solved, SPRING, ()) is None


def diagnosis():
    """Of a lever that has a spring in the fitted runs only."""
    held = [replace(run, heldout=True, clock=1) for run in later(False).noisy(7)]
    return diagnose(sprung().estimate, Dataset((*sprung().noisy(4), *held)), sprung().robot)


def test_a_denied_effect_is_not_to_be_added_and_the_joint_is_unexplained():
    """It stands among the candidates as doubtful, with what the later runs show of it."""
    found = diagnosis()
    (joint,) = found.joints
    assert all(one.effect != "spring" for one in found.findings)
    (spring,) = (one for one in joint.candidates if one.effect == "spring")
    assert spring.verdict == DOUBTFUL and "runs that were held out" in spring.reason
    assert found.findings or joint.verdict == UNEXPLAINED_JOINT


def found(hidden: Hidden):
    """What one search adds first."""
    lab = Lab.of(LEVER, design(LEVER, postures=3), hidden)
    search = Stepwise(lab.model, lab.noisy(2, Din(spread=0.004, level=0.002)))
    search.run()
    return search.accepted[0]


def test_of_gear_losses_the_weight_leaves_only_the_sum():
    """The weight takes half the difference of the losses and is fitted a tenth too large: of it they are 0.4 / 1.1."""
    # The drawn motor counts its current against the motion, so friction is negative.
    (only,) = sizes(found(Hidden("load_friction", 1, {"drive": 0.3, "back": 0.1})))
    assert only.name == "drive + back" and only.unit == "1"
    assert only.value == pytest.approx(-0.4 / 1.1, abs=3.0 * only.std_error) and only.std_error < 0.02


def test_a_ripples_two_sizes_are_told_apart():
    """Cosine and sine."""
    told = sizes(found(Hidden("ripple", 1, {"cos": 0.02, "sin": -0.01, "frequency": 23.0})))
    assert [one.name for one in told] == ["cos", "sin"]
