"""Pictures of a finding: before and after at one scale, rivals broken, every direction that was run."""

from __future__ import annotations

from dataclasses import replace

import diagnoses
import numpy as np
import pytest
import stories

from pumaid.errors import ResultError
from pumaid.reporting.plots import findings
from pumaid.reporting.plots.style import styled

PUMA = diagnoses.PUMA


def drawn_curve(found, *, units: str = "rad"):
    """Axes of a finding's figure."""
    with styled():
        return findings.draw_curve(found, found.curves[0], PUMA, units=units).axes


def test_before_and_after_have_one_scale():
    """What is left with the effect is seen against what was left without it."""
    above, below = drawn_curve(diagnoses.stribeck())
    assert above.get_ylim() == below.get_ylim() and above.get_xlim() == below.get_xlim()
    heights = [max(abs(line.get_ydata()).max() for line in axes.lines[1:3]) for axes in (above, below)]
    assert heights[0] == pytest.approx(10.0 * heights[1])


def test_rivals_are_broken_lines():
    """The effect's own line is unbroken, a rival's broken, one of each a direction."""
    above, below = drawn_curve(diagnoses.stribeck())
    strokes = [line.get_linestyle() for line in above.lines if len(line.get_xdata()) == 12]
    assert strokes.count("-") == 2 and strokes.count("--") == 2
    assert not [line for line in below.lines if len(line.get_xdata()) == 12]


def test_degrees_where_asked_for():
    """The axis is in the unit asked for, and says so."""
    above, below = drawn_curve(diagnoses.stribeck(), units="deg")
    assert below.get_xlabel() == "speed (deg/s)"
    assert max(above.lines[1].get_xdata()) == pytest.approx(np.rad2deg(1.0))


def test_long_times_are_in_minutes():
    """A warm-up over an hour is told in minutes, a short one in seconds."""
    assert findings.scaled("s", np.array([0.0, 3600.0]), "rad") == (1 / 60, "min")
    assert findings.scaled("s", np.array([0.0, 100.0]), "rad") == (1.0, "s")


@pytest.mark.parametrize(("form", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_one_picture_of_all(form, start):
    """Findings and shapes without a name in one file."""
    assert findings.drawn(diagnoses.rich(), PUMA, form).startswith(start)


def test_nothing_found_is_nothing_to_draw():
    """A clean arm has no picture, and says so."""
    assert not findings.can_be_drawn(diagnoses.clean())
    with pytest.raises(ResultError, match="nothing-to-draw"):
        findings.drawn(diagnoses.clean(), PUMA, "png")


def test_a_report_has_a_figure_a_finding():
    """Findings, shapes without a name and what was added before each have a figure with a name of its own."""
    told = replace(stories.story(), robot=PUMA, diagnosis=diagnoses.rich())
    names = [drawing.name for drawing in findings.drawings(told)]
    assert names == ["finding_1_j3", "added_1_j3", "unexplained_j5"]
    assert list(findings.drawings(stories.story())) == []
