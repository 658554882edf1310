"""What must not matter: units of current and gravity, order and names, where a run was cut, how the base lies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from worlds import CRANE, dataset, drawn, experiment

from pumaid.dataset import Dataset, Run
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify

TRUTH = drawn(CRANE)
RUNS = dataset(TRUTH, experiment(CRANE)).runs
PLAIN = identify(Dataset(RUNS), CRANE)
FEW = settings(max_examples=6, deadline=None)
#: Relative: optimisers of variances stop at about 1e-6 of their logarithm, which moves weights and hence values little.
SAME = 1e-4


def assert_same(found: Estimate, *, unit: float = 1.0, ratio_unit: float = 1.0, wanted: Estimate = PLAIN) -> None:
    """Same states, and values apart by `unit` (parameters; ratios by `ratio_unit`), measured by standard errors."""
    assert [(v.name, v.state) for v in found.values] == [(v.name, v.state) for v in wanted.values]
    for new, old in zip(found.values, wanted.values, strict=True):
        if old.state == "identified":
            factor = ratio_unit if old.name.startswith("gain") else unit
            assert new.std_error == pytest.approx(abs(factor) * old.std_error, rel=100 * SAME)
            assert abs(new.value - factor * old.value) < SAME * 100 * new.std_error, old.name


def louder(run: Run, unit: float) -> Run:
    """The run with its current in another unit."""
    bins = replace(run.bins, current=run.bins.current * unit, variance=run.bins.variance * unit**2)
    return replace(run, bins=bins)


@FEW
@given(st.floats(-6.0, 6.0), st.sampled_from([1.0, -1.0]))
def test_unit_and_sign_of_current(power, sign):
    """Currents in another unit, or with the other sign, scale parameters, errors and floors, and leave ratios alone."""
    unit = sign * 10.0**power
    found = identify(Dataset(tuple(louder(run, unit) for run in RUNS)), CRANE)
    assert_same(found, unit=unit)
    for new, old in zip(found.joints, PLAIN.joints, strict=True):
        assert new.rmse == pytest.approx(abs(unit) * old.rmse, rel=1e-5)


@FEW
@given(st.sampled_from([1, 2, 3]), st.floats(-3.0, 3.0))
@example(1, 2.8)  # from the recursion's ratio, which is wrong there, it passed for unknown, and was held at one
def test_unit_of_one_joints_current(joint, power):
    """One joint's current in another unit scales its own parameters and the ratios it is in."""
    unit = 10.0**power
    found = identify(Dataset(tuple(louder(run, unit if run.joint == joint else 1.0) for run in RUNS)), CRANE)
    assert [v.state for v in found.values] == [v.state for v in PLAIN.values]
    for new, old in zip(found.values, PLAIN.values, strict=True):
        if old.state == "identified":
            pair = [int(part) for part in old.name.split(".")[1:]] if old.name.startswith("gain") else [old.joint, 0]
            factor = unit ** ((pair[0] == joint) - (pair[1] == joint))
            # A ratio's prior is in units of gains, and may shift what it hardly holds by a small part of its error.
            assert abs(new.value - factor * old.value) < 0.05 * factor * old.std_error, old.name


@FEW
@given(st.floats(-3.0, 3.0))
def test_how_the_base_lies(angle):
    """Base and gravity turned together, about the axis from which the first twist counts, change nothing."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = CRANE.gravity
    first = replace(CRANE.joints[0], alpha=CRANE.joints[0].alpha + angle)
    turned = replace(CRANE, joints=(first, *CRANE.joints[1:]), gravity=(x, c * y - s * z, s * y + c * z))
    assert_same(identify(Dataset(RUNS), turned))


@FEW
@given(st.floats(-2.0, 2.0))
def test_unit_of_gravity(power):
    """Gravity in another unit scales the constants of weight and their errors by its inverse, nothing else."""
    unit = 10.0**power
    found = identify(Dataset(RUNS), replace(CRANE, gravity=tuple(unit * g for g in CRANE.gravity)))
    for new, old in zip(found.values, PLAIN.values, strict=True):
        factor = 1.0 / unit if old.name.startswith("gravity") else 1.0
        assert new.state == old.state
        if old.state == "identified":
            assert abs(new.value - factor * old.value) < 0.01 * factor * old.std_error, old.name
