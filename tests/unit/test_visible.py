"""Names that look like something else to a terminal, to rich or to matplotlib are shown as they are."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from pumaid.cli import output
from pumaid.errors import Note, visible
from pumaid.reporting.figures.experiment import posture_figure
from pumaid.reporting.run_tables import axes_table, plan_tables, session_table
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
    output.show(session_table([(STEERING, 1, 0.0, 1.0)]))
    told = capsys.readouterr()
    assert re.findall("[\x1b\x07\u202e]", told.out + told.err) == [] and (told.out + told.err).count(r"\x1b") == 4
    output.write_result(Path("-"), STEERING)
    assert capsys.readouterr().out == STEERING


@pytest.mark.parametrize("name", ["[/] x", "[bold]x", ":smile:", r"$\foo{}$", "$x", r"\$"])
def test_names_are_not_read_as_markup(name):
    """Plan, axes and pictures with a robot and a joint of that name."""
    robot = Robot(name, (replace(Joint(1, name, "revolute"), limits=(-1.0, 1.0)),))
    plan = Plan(name, (Motion(1, (0.0,), -1.0, 1.0, 0.5),), (Posture(1, (0.0,), (), name),))
    tables = [*plan_tables(plan, robot), axes_table(robot)]
    assert [table.text(200).count(name) for table in tables] == [2, 1, 2]
    assert posture_figure(plan, robot).file("svg").startswith(b"<?xml")
