"""The parameter table says what is known, what is not, and why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import stories
import worlds

from pumaid.records import Combination
from pumaid.reporting import tables


@pytest.fixture(scope="module")
def puma():
    """The paper's arm with the paper's values."""
    return stories.table_one()


def row(grid, label):
    """The cells of the row whose head begins with `label`."""
    return next(cells for cells in grid.rows if cells[0].text.startswith(label))


def test_prints_the_paper_numbers(puma):
    """Weights are shown as the paper prints them, times gravity in A; viscous friction a degree."""
    grid = tables.parameter_grid(puma.estimate, puma.robot, "deg")
    weight = float(np.linalg.norm(puma.robot.gravity)) / worlds.table1.TABLE_GRAVITY
    assert float(row(grid, "k_x")[2].text) / weight == pytest.approx(2.191535, abs=0.02)
    assert float(row(grid, "λ₂⁺")[1].text) == pytest.approx(0.00222, abs=2e-5)
    assert row(grid, "λ₂⁺")[0].text == "λ₂⁺ (A s/deg)"


def test_radians_and_degrees_are_the_same_quantity(puma):
    """The same parameter in both units differs by the factor of the units."""
    by_unit = [tables.parameter_grid(puma.estimate, puma.robot, unit) for unit in ("rad", "deg")]
    radians, degrees = (float(row(grid, "λ₂⁺")[3].text) for grid in by_unit)
    assert degrees == pytest.approx(radians * np.pi / 180, rel=0.02)


def test_unknown_and_absent_differ(puma):
    """What other runs could show is n/i with a letter; what no motion of the arm shows is a dash."""
    grid = tables.parameter_grid(puma.estimate, puma.robot)
    ratio = row(grid, "ηᵢ/ηᵢ₊₁")
    assert (ratio[5].text, ratio[5].tone) == ("n/i", "unknown")
    assert dict(grid.notes)[ratio[5].mark] == "link 6 is light; to see it: add a payload"
    assert row(grid, "k_x")[1].text == "-" and "-" in dict(grid.notes)


def test_what_is_the_whole_arms_stands_below(puma):
    """Parameters without a joint of their own are told with their error and unit, or with why they are not."""
    known = replace(puma.estimate.values[0], name="tilt.x", joint=None, value=0.0123, std_error=0.0011, unit="rad")
    unknown = replace(known, name="tilt.y", value=None, std_error=None, reason="the base stands level")
    estimate = replace(puma.estimate, values=(*puma.estimate.values, known, unknown))
    caption = tables.parameter_grid(estimate, puma.robot).caption
    assert "Of the whole arm: tilt.x 0.0123 ± 0.0011 rad; tilt.y n/i (the base stands level)." in caption
    assert "whole arm" not in tables.parameter_grid(puma.estimate, puma.robot).caption


def test_one_letter_a_reason(puma):
    """Parameters with the same reason share a note."""
    values = tuple(
        replace(value, value=None, state="not_identifiable", reason="one reason", next_run="one run")
        if value.name.startswith("viscous")
        else value
        for value in puma.estimate.values
    )
    grid = tables.parameter_grid(replace(puma.estimate, values=values), puma.robot)
    marks = {cell.mark for label in ("λ₂⁺", "λ₂⁻") for cell in row(grid, label)[1:]}
    assert len(marks) == 1


def test_values_whose_sign_is_unsure_are_faint(puma):
    """A value whose interval holds zero is marked as weak."""
    values = tuple(
        replace(value, ci95=(-1.0, 1.0)) if value.name == "gravity.l2.x" else value for value in puma.estimate.values
    )
    grid = tables.parameter_grid(replace(puma.estimate, values=values), puma.robot)
    assert (row(grid, "k_x")[2].tone, row(grid, "k_x")[3].tone) == ("weak", "")


def test_effects_beyond_the_paper_get_their_rows(puma):
    """A parameter that the paper does not know stands in a row of its own, after the paper's."""
    extra = replace(puma.estimate.value("coulomb.j3.plus"), name="ripple.j3.sin", symbol="s3", unit="A")
    grid = tables.parameter_grid(replace(puma.estimate, values=(*puma.estimate.values, extra)), puma.robot)
    labels = [cells[0].text for cells in grid.rows]
    assert labels.index("ripple sin (A)") == labels.index("RMSE (A)") - 1
    assert [cell.text for cell in row(grid, "ripple")][1:3] == ["-", "-"]


def test_a_slide_has_a_mass(tmp_path):
    """An arm with a prismatic joint shows its mass as a current, and its friction per metre."""
    told = stories.story(worlds.CRANE)
    grid = tables.parameter_grid(told.estimate, told.robot, "deg")
    assert row(grid, "λ₂⁺")[0].text == "λ₂⁺ (A s/deg | A s/m)"
    assert [cell.text == "-" for cell in row(grid, "m·g")[1:]] == [True, False, True]


def test_sums_leave_out_what_is_rounding(puma):
    """A sum is written with its signs, without terms a million times smaller."""
    found = Combination({"a": 9.8, "b": -4.9, "c": 1e-6}, 1.0, 0.1, "A", "a load")
    grid = tables.combinations_grid(replace(puma.estimate, combinations=(found,)))
    assert grid.rows[0][1].text == "9.800·a − 4.900·b"
    assert tables.combinations_grid(puma.estimate) is None


def test_letters_go_on_after_z():
    """More than 26 reasons still have different letters."""
    notes, value = tables.Notes(), stories.table_one().estimate.value("gain_ratio.5.6")
    letters = [notes.letter(replace(value, reason=f"reason {n}")) for n in range(60)]
    assert len(set(letters)) == 60
