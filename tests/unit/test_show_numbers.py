"""Numbers and units as people read them."""

from __future__ import annotations

import math

import pytest

from pumaid.reporting.numbers import in_unit, percent, shortened, with_error


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.2236776, 0.0000934, ("0.223678", "0.000093")),
        (-0.57450, 0.00102, ("-0.5745", "0.0010")),
        (12345.6, 310.0, ("12346", "310")),
        (2.191535, 0.5, ("2.19", "0.50")),
        (6.5e-9, 1.2e-10, ("6.50e-9", "0.12e-9")),
        (0.2236776, 1.3e-15, ("0.2236776", "1.3e-15")),
        (0.5, None, ("0.50000", "")),
        (0.5, 0.0, ("0.50000", "0")),
        (0.5, math.inf, ("0.50000", "inf")),
    ],
)
def test_value_and_error_end_at_the_same_digit(value, error, text):
    """Both are told to the error's second digit, small ones with one power of ten."""
    assert with_error(value, error) == text


@pytest.mark.parametrize(
    ("unit", "shown", "times"),
    [
        ("A s/rad", "A s/deg", math.pi / 180),
        ("A s2/rad2", "A s2/deg2", (math.pi / 180) ** 2),
        ("rad/s", "deg/s", 180 / math.pi),
        ("rad", "deg", 180 / math.pi),
        ("A s2/m", "A s2/m", 1.0),
        ("A", "A", 1.0),
        ("A/grade", "A/grade", 1.0),
    ],
)
def test_units_of_angles_change_with_their_numbers(unit, shown, times):
    """A unit with rad in it becomes one with deg, and the factor keeps the quantity the same."""
    assert in_unit(unit, "deg") == (pytest.approx(times, rel=1e-12), shown)
    assert in_unit(unit, "rad") == (1.0, unit)


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.5, "50 %"),
        (0.998, "99.8 %"),
        (0.99998, "99.998 %"),
        (1.0, "100.0000 %"),
        (-0.2, "-20 %"),
        (-1e-9, "0 %"),
        (None, "unknown"),
    ],
)
def test_percentages_show_what_is_missing(share, text):
    """Near 100 % there are enough digits to see the rest."""
    assert percent(share) == text


def test_long_names_are_cut():
    """A name above a figure keeps inside it."""
    assert len(shortened("x" * 80)) == 52 and shortened("arm") == "arm"
