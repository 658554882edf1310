"""Tables: what they claim, their text, Markdown, LaTeX and HTML, and names that look like something else."""

import re
from dataclasses import replace
from pathlib import Path

import diagnoses
import numpy as np
import pytest
import report_contexts
import worlds
from ladders import ladder
from motion_worlds import World, make, robot

from pumaid.cli import output
from pumaid.dataset import Dataset
from pumaid.diagnosis.records import Limit
from pumaid.errors import Note, visible
from pumaid.estimate import Combination
from pumaid.preprocessing.segment import segment
from pumaid.reporting import run_tables, tables
from pumaid.reporting.diagnosis import limit_table
from pumaid.reporting.run_tables import axes_table, plan_tables
from pumaid.reporting.table import Cell, Table
from pumaid.robot import Joint, Robot
from pumaid.trajectory import Motion, Plan, Posture

PUMA = diagnoses.PUMA
WIDE = Table(
    "A title",
    ("link", *map(str, range(1, 8))),
    [[f"row {r}", *(Cell("-0.12345", "0.00067") for _ in range(7))] for r in range(3)],
    (("a", "a reason"), ("-", "another")),
    "How to read it.",
)
HOSTILE = Table("50% & more", ("a_b", "c|d"), [["<b>", Cell("1e-9", "0.1e-9", mark="x")]], (("x", "{} ~ ^ \\"),))


@pytest.fixture(scope="module")
def paper():
    """The paper's arm with the paper's values."""
    return report_contexts.table_one()


def row(table, label):
    """The cells of the row whose head begins with `label`."""
    return next(cells for cells in table.cells if cells[0].text.startswith(label))


# Forms


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
def test_text_is_never_wider_than_asked(width):
    """No line is longer than the terminal, and nothing is lost in a narrow one."""
    text = report_contexts.printed(WIDE, width=width)
    assert max(map(len, text.splitlines())) <= width
    assert text.count("-0.12345") == 21 and text.count("0.00067") == 21
    assert "a reason" in text and "How to read it." in text


def test_long_words_are_wrapped_not_cut():
    path = "logs/" + "x" * 90 + "/end.csv"
    table = Table("", ("file", "size", "what"), [[path, "1", "a b c " * 10]], words=(0, 2))
    text = report_contexts.printed(table, width=60)
    assert "…" not in text and "".join(line.split(" ")[0] for line in text.splitlines()[1:]).startswith(path)


def test_markdown_and_html_escape_names():
    """A bar or an angle bracket in a name does not break the table."""
    rows = [line for line in HOSTILE.markdown().splitlines() if line.startswith("|")]
    assert {line.replace("\\|", "").count("|") for line in rows} == {3}
    assert "<b>" not in HOSTILE.markdown() + HOSTILE.html() and "&lt;b&gt;" in HOSTILE.html()


def test_latex_escapes_what_latex_would_read():
    """Special letters are written, not obeyed; powers of ten are mathematics."""
    text = HOSTILE.latex()
    assert r"50\% \& more" in text and r"a\_b" in text and r"\{\} \textasciitilde{}" in text
    assert r"$1 \cdot 10^{-9} \pm 0.1 \cdot 10^{-9}$" in text
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")


# Parameters


def test_parameters_are_the_papers_numbers(paper):
    """Gravity is shown as the paper prints it, times g in A; viscous friction per degree."""
    table = tables.parameter_table(paper.estimate, paper.robot, "deg")
    scale = float(np.linalg.norm(paper.robot.gravity)) / worlds.table1.TABLE_GRAVITY
    assert float(row(table, "k_x")[2].text) / scale == pytest.approx(2.191535, abs=0.02)
    assert float(row(table, "λ₂⁺")[1].text) == pytest.approx(0.00222, abs=2e-5)
    assert row(table, "λ₂⁺")[0].text == "λ₂⁺ (A s/deg)"


def test_parameters_of_the_whole_arm_have_a_column(paper):
    """Parameters without a joint have their error and unit, or the reason why they have none."""
    tilt = replace(paper.estimate.values[0], name="tilt.x", joint=None, value=0.0123, std_error=0.0011, unit="rad")
    unknown = replace(tilt, name="tilt.y", value=None, std_error=None, reason="level base", next_run="x")
    estimate = replace(paper.estimate, values=(*paper.estimate.values, tilt, unknown))
    table = tables.parameter_table(estimate, paper.robot)
    known, missing = row(table, "tilt x (rad)")[-1], row(table, "tilt y")[-1]
    assert table.header[-1] == "arm" and (known.text, known.error) == ("0.0123", "0.0011")
    assert missing.text == "n/i" and dict(table.notes)[missing.mark].startswith("level base")


def test_reasons_share_letters_and_weak_values_are_faint(paper):
    """Parameters with the same reason share a note; a value whose interval holds zero is faint."""
    changes = {"value": None, "state": "not_identifiable", "reason": "one reason", "next_run": "one run"}
    values = [replace(v, **changes) if v.name.startswith("viscous") else v for v in paper.estimate.values]
    values = [replace(v, ci95=(-1.0, 1.0)) if v.name == "gravity.l2.x" else v for v in values]
    table = tables.parameter_table(replace(paper.estimate, values=tuple(values)), paper.robot)
    assert len({cell.mark for label in ("λ₂⁺", "λ₂⁻") for cell in row(table, label)[1:]}) == 1
    assert (row(table, "k_x")[2].tone, row(table, "k_x")[3].tone) == ("weak", "")


def test_other_effects_and_prismatic_joints_have_their_rows(paper):
    """A parameter that the paper does not have follows its rows; a prismatic joint has a mass."""
    extra = replace(paper.estimate.value("coulomb.j3.plus"), name="ripple.j3.sin", symbol="s3", unit="A")
    table = tables.parameter_table(replace(paper.estimate, values=(*paper.estimate.values, extra)), paper.robot)
    labels = [cells[0].text for cells in table.cells]
    assert labels.index("ripple sin (A)") == labels.index("RMSE (A)") - 1
    crane = report_contexts.small(worlds.CRANE)
    table = tables.parameter_table(crane.estimate, crane.robot, "deg")
    assert row(table, "λ₂⁺")[0].text == "λ₂⁺ (A s/deg | A s/m)"
    assert [cell.text == "-" for cell in row(table, "m·g")[1:]] == [True, False, True]


def test_combinations_leave_out_round_off(paper):
    """A combination is written with its signs, without terms a million times smaller."""
    terms = Combination({"a": 9.8, "b": -4.9, "c": 1e-6}, 1.0, 0.1, "A", "a load")
    table = tables.combination_table(replace(paper.estimate, combinations=(terms,)))
    assert table.cells[0][1].text == "9.800·a − 4.900·b"
    assert tables.combination_table(paper.estimate) is None


# Comparison


def test_worst_runs_name_file_and_seconds(context):
    """A user finds the worst run in the log by its file and seconds."""
    first = tables.worst_runs_table(context.comparison, context.robot, count=3).cells[0]
    run = context.comparison.worst(1)[0].run
    assert first[2].text == run.origin and first[3].text.startswith(f"{run.start:.2f} –")


def test_joints_without_runs_and_errors_above_the_floor_are_marked(context):
    """Joints that never move are named below the table; an error well above the floor is an alarm."""
    first, second = context.comparison.joints
    still = replace(second, runs=0, rmse=None, noise_floor=None)
    spoilt = replace(context.comparison, joints=(replace(first, rmse=3.0 * first.noise_floor, bias=1e-17), still))
    table = tables.comparison_table(spoilt, context.robot)
    assert any("never moves alone" in text for _, text in table.notes)
    assert [cells[2].tone for cells in table.cells] == ["alarm", "absent", ""]
    assert table.cells[0][4].text == "0"  # a bias far below the RMSE is round-off


def test_detection_limits_have_a_row_an_effect_and_unit():
    """Sizes per rad and per m have rows of their own; what is not detectable has a reason; the arm its column."""
    joints = diagnoses.clean().joints
    first = (Limit("spring", 1, "a", 0.2, "A/rad"), Limit("tilt", None, "x", 0.1, "rad"))
    second = (Limit("spring", 2, "a", 0.4, "A/m"), Limit("tilt", None, "y", 0.2, "rad"))
    first = (*first, Limit("ripple", 1, "cos", 0.02, "A", up_to=74.4))
    second = (*second, Limit("ripple", 2, "cos", 0.03, "A", up_to=628.3))
    both = replace(diagnoses.clean(), joints=(replace(joints[0], limits=first), replace(joints[1], limits=second)))
    assert [[cell.text for cell in cells] for cells in limit_table(both, worlds.CRANE).cells] == [
        ["ripple", "cos (A)", "0.020", "0.030", ""],
        ["ripple", "up to (waves a turn)", "74", "", ""],
        ["ripple", "up to (waves a m)", "", "100", ""],
        ["spring", "a (A/rad)", "0.20", "", ""],
        ["spring", "a (A/m)", "", "0.40", ""],
        ["tilt", "x (rad)", "", "", "0.10"],
        ["tilt", "y (rad)", "", "", "0.20"],
    ]


def test_history_shows_held_out_errors_where_there_are_any():
    words = [tables.history_table(ladder(2, 2, heldout=heldout)).caption for heldout in (True, False)]
    assert ["No run was held out" in caption for caption in words] == [False, True]


# Runs and plans


def dataset_of(**changes):
    """The dataset of a small world."""
    world = World(motions=4, rate=200.0, **changes)
    return segment(make(world, 3).logs, robot(world)), robot(world)


def test_runs_show_short_names_and_units():
    """Files without their shared folders, times to a hundredth, speeds in the unit of the header."""
    dataset, arm = dataset_of(speeds=(0.5, 0.5001))
    moved = replace(dataset, runs=tuple(replace(run, origin=f"logs/day/{run.origin}") for run in dataset.runs))
    table = run_tables.run_table(moved, arm, units="deg")
    texts = {head: cell.text for head, cell in zip(table.header, table.cells[0], strict=True)}
    run = dataset.runs[0]
    assert texts["file"] == "log_0.csv"
    assert texts["time (s)"] == f"{run.start:.2f} – {run.start + run.duration:.2f}"
    assert np.isclose(float(texts["speed (deg/s)"]), np.degrees(0.5), rtol=0.01)
    assert run_tables.run_table(Dataset(()), arm).rows == [] and run_tables.rejection_table(Dataset(())).rows == []


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
    output.show(Table("", ("file",), [[STEERING]]))
    told = capsys.readouterr()
    assert re.findall("[\x1b\x07\u202e]", told.out + told.err) == [] and (told.out + told.err).count(r"\x1b") == 4
    output.write_result(Path("-"), STEERING)
    assert capsys.readouterr().out == STEERING


@pytest.mark.parametrize("name", ["[/] x", "[bold]x", ":smile:", r"$\foo{}$", "$x", r"\$"])
def test_names_are_not_read_as_markup(name):
    robot = Robot(name, (replace(Joint(1, name, "revolute"), limits=(-1.0, 1.0)),))
    plan = Plan(name, (Motion(1, (0.0,), -1.0, 1.0, 0.5),), (Posture(1, (0.0,), (), name),))
    tables = [*plan_tables(plan, robot), axes_table(robot)]
    assert [report_contexts.printed(table, width=200).count(name) for table in tables] == [2, 1, 2]
