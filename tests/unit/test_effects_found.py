"""Effects that look alike: hidden at twice its detection limit each is named, or stands beside what it looks like."""

from functools import cache

import numpy as np
import pytest
from searches import Din, Lab, design, with_current
from worlds import PENDULUM

from pumaid.diagnosis.detection_limits import detection_limits
from pumaid.diagnosis.diagnose import DiagnosisBuilder
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.simulation import Hidden

DIN = Din(spread=0.01, correlation=0.6, level=0.006)
PLAN = design(PENDULUM, postures=3)
#: Seeds of the noise; none was looked at while the effects were written.
SEEDS = (211, 212)


@cache
def limits() -> dict:
    """Of every effect at both joints, nothing being hidden."""
    lab = Lab.of(PENDULUM, PLAN)
    look = Stepwise(lab.model, lab.noisy(210, DIN)).look([])
    return detection_limits(look.scan, look.family)


def searched(lab: Lab, seed: int) -> DiagnosisBuilder:
    """A finished search in one more draw of noise."""
    search = Stepwise(lab.model, lab.noisy(seed, DIN))
    search.run()
    return DiagnosisBuilder(search, (), search.runs)


@pytest.mark.parametrize(
    ("name", "joint", "values"),
    [
        ("smooth_friction", 2, {"a": 1.0, "velocity": 0.5}),
        ("stribeck_load", 1, {"a": 1.0, "velocity": 0.5}),
        ("load_friction_square", 1, {"a": 1.0}),
        ("load_friction_square", 2, {"a": 1.0}),
    ],
)
def test_twice_its_limit_is_named(name, joint, values):
    """All that is found is the effect, or what it is a rival of; either way its size is right within three errors."""
    names, off = found(name, joint, values, size=2.0 * limits()[name, joint].size)
    assert all(name in told for told in names) and np.abs(off).max() < 3.0


def test_a_ripple_that_grows_with_the_load():
    """Twice the limit of a ripple, its height at the root mean square of the load."""
    load = Lab.of(PENDULUM, PLAN).truth.gravity_current(np.linspace([-1.8, 0.0], [1.8, 0.0]))[:, 0]
    size = 2.0 * limits()["ripple", 1].size / np.sqrt(np.mean(load**2))
    names, off = found("load_ripple", 1, {"cos": 1.0, "sin": 0.0, "frequency": 23.0}, size=size, bins=128)
    assert all("load_ripple" in told for told in names) and np.abs(off).max() < 3.0


def found(
    name: str, joint: int, values: dict[str, float], *, size: float, bins: int = 64
) -> tuple[list[list[str]], list[float]]:
    """Of each seed the name and rivals of the only addition, and how many errors the size is off.

    The effect is hidden with the first of its values times `size`.
    """
    names, off = list[list[str]](), list[float]()
    first = next(iter(values))
    lab = Lab.of(PENDULUM, PLAN, Hidden(name, joint, {**values, first: size}), bins=bins)
    for seed in SEEDS:
        builder = searched(lab, seed)
        (only,) = builder.search.accepted
        names.append([item.key[0] for item in (only, *only.rivals) if item.key[1] == joint])
        sizes = next(one for one in builder.joint(joint, None).candidates if one.effect == name).sizes
        off.append((sizes[0].value - size) / sizes[0].std_error if sizes[0].name == first else np.inf)
    return names, off


def test_a_gear_that_ripples_with_and_without_load():
    """Of one line with both parts both are found, whichever is larger."""
    for constant, loaded in ((0.01, 0.005), (0.004, 0.012)):
        both = {"ripple": {"cos": constant, "sin": 0.0}, "load_ripple": {"cos": 0.0, "sin": loaded}}
        hidden = [Hidden(name, 1, {**values, "frequency": 23.0}) for name, values in both.items()]
        search = searched(Lab.of(PENDULUM, PLAN, *hidden, bins=128), SEEDS[0]).search
        assert {item.key for item in search.accepted} == {("ripple", 1), ("load_ripple", 1)}


@pytest.mark.parametrize(
    ("arm", "effect", "joint", "seed"),
    [("puma560", "spring", 4, 242), ("panda", "spring", 4, 13), ("ur5e", "tilt", None, 231)],
)
def test_a_large_effect_is_named_and_nothing_else(arm, effect, joint, seed):
    """It bends weights and ratios of gains, which scores follow to first order only: refits decide."""
    robot = read_recipe(shipped_recipes()[arm])
    plan = design(robot, postures=3, speeds=(0.3, 0.6, 1.2), reach=1.2, seed=seed)
    lab = Lab.of(robot, plan, Hidden(effect, joint), seed=seed)
    search = Stepwise(lab.model, lab.noisy(seed, Din(spread=0.005, correlation=0.6, level=0.003)))
    search.run()
    assert [item.key for item in search.accepted] == [(effect, joint)]


def test_friction_without_a_jump_is_smooth_and_no_stribeck():
    """A motor of 0.6 tanh(5 v) A in slow runs: one finding, its size, and an error that falls to the noise.

    A Stribeck fall from 3 A, beyond all speeds, has the same course, but Coulomb friction of -3 A beside it.
    """
    plain = Lab.of(PENDULUM, design(PENDULUM, [2], speeds=(0.03, 0.08, 0.15, 0.25, 0.4, 0.6)))
    runs = []
    for run in plain.noisy(211, DIN):
        v = run.bins.velocity
        runs.append(with_current(run, 0.6 * (np.tanh(5.0 * v) - np.sign(v))))
    search = Stepwise(plain.model, runs)
    search.run()
    (item,) = search.accepted
    assert item.key == ("smooth_friction", 2) and item.rivals == ()
    assert item.trial.added.shape["velocity"] == pytest.approx(0.2, rel=0.1)
    assert item.trial.sizes[0] == pytest.approx(0.6, rel=0.1)
    assert item.after[2] < 1.1 * np.hypot(DIN.spread / 0.8, DIN.level)  # the noise is correlated by 0.6


def test_what_is_not_looked_at_again_does_not_change_what_is_added(monkeypatch):
    """Joints whose residuals hardly moved are skipped; looking at all of them anew ends with the same additions."""
    lab = Lab.of(
        PENDULUM,
        PLAN,
        Hidden("stribeck", 2, {"a": 0.4, "velocity": 0.1, "exponent": 1.0}),
        Hidden("spring", 2, {"a": 0.2}),
        Hidden("position_friction", 1, {"cos": 0.1, "sin": 0.0, "harmonic": 1}),
    )
    added = searched(lab, 222).search.added
    monkeypatch.setattr("pumaid.diagnosis.stepwise.MOVED", 0.0)
    assert len(added) > 2 and searched(lab, 222).search.added == added
