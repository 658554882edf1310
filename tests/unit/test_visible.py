"""Names that look like something else to a terminal, to rich or to matplotlib are shown as they are."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console
from rich.text import Text

from pumaid.cli import output
from pumaid.errors import Note
from pumaid.reporting.axes import axes_table
from pumaid.reporting.plans import plan_table, session_table
from pumaid.reporting.plots.style import saved, settle, styled
from pumaid.reporting.timetable import drawn, timetable_table
from pumaid.reporting.visible import Visible, visible
from pumaid.robot import Joint, Robot
from pumaid.trajectory import Motion, Plan, Posture

STEERING = "a\x1b[31mred\x07\u202e.csv"
SHOWN = r"a\x1b[31mred\x07\u202e.csv"


@pytest.mark.parametrize(("text", "shown"), [(STEERING, SHOWN), ("Prüfstand Ω 🤖\n\tλ₁⁺", None), ("\x9b\r", r"\x9b\r")])
def test_what_steers_a_terminal_is_shown(text, shown):
    """Control characters and turns of direction become their names; letters of any script, tab and line end stay."""
    assert visible(text) == (text if shown is None else shown)


def test_all_ways_to_a_terminal_are_guarded(capsys):
    """Sentences, remarks, notes and tables; a file's content is printed to the letter."""
    output.say(STEERING)
    output.remark(STEERING)
    output.notes([Note("odd", STEERING)])
    output.table(session_table([(STEERING, 1, 0.0, 1.0)]))
    told = capsys.readouterr()
    assert re.findall("[\x1b\x07\u202e]", told.out + told.err) == [] and (told.out + told.err).count(r"\x1b") == 4
    output.content(STEERING)
    assert capsys.readouterr().out == STEERING


def test_styles_of_our_own_stay():
    """What a table itself is set in reaches the terminal."""
    out = io.StringIO()
    Console(file=out, force_terminal=True, color_system="standard").print(Visible(Text("bad\x1b[0m", style="red")))
    assert out.getvalue() == "\x1b[31mbad\\x1b[0m\x1b[0m\n"


@pytest.mark.parametrize("name", ["[/] x", "[bold]x", ":smile:", r"$\foo{}$", "$x", r"\$"])
def test_names_are_not_read_as_markup(name):
    """Plan, timetable, axes and pictures with a robot and a joint of that name."""
    robot = Robot(name, (replace(Joint(1, name, "revolute"), limits=(-1.0, 1.0)),))
    plan = Plan(name, (Motion(1, (0.0,), -1.0, 1.0, 0.5),), (Posture(1, (0.0,), (), name),))
    times = np.array([[0.0, 60.0]])
    tables = (plan_table(plan, robot), timetable_table(plan, robot, times=times), axes_table(robot))
    for table, count in zip(tables, (3, 1, 2), strict=True):
        out = io.StringIO()
        Console(file=out, width=200).print(table)
        assert out.getvalue().count(name) == count
    assert drawn(plan, robot, "svg", times=times).startswith(b"<?xml")


def test_dollars_are_no_formula():
    """A name with two of them is written out in a picture of the house's style."""
    with styled(text_as_paths=False):
        figure = Figure(layout="constrained")
        figure.subplots().set(title=r"$\foo{}$", xlabel="$x$")
        settle(figure)
        found = saved(figure, "svg", "")
    assert rb">$\foo{}$<" in found and b">$x$<" in found
