"""Sentences: what is claimed, of which joint, how surely, in which unit."""

import io
from dataclasses import replace

import budgets
import diagnoses
import numpy as np
import pytest
import report_contexts
import worlds
from ladders import RIPPLE, STRIBECK
from rich.console import Console
from test_compare import KINDS

from pumaid.dataset import Dataset
from pumaid.diagnosis.compare import POINTS_TO
from pumaid.diagnosis.records import Limit, Size
from pumaid.effects import catalogue
from pumaid.errors import Note, Where
from pumaid.estimate import Combination
from pumaid.estimation.evaluate import Budget, BudgetPart, Comparison, JointScore
from pumaid.reporting import text
from pumaid.reporting.diagnosis import (
    diagnosis_parts,
    finding_sentences,
    finding_title,
    form_sentence,
    other_sentences,
    size_sentence,
    step_sentence,
    weaknesses,
)
from pumaid.reporting.table import Paragraph
from pumaid.reporting.tables import BUDGET_BAR, NOISE, SIGNIFICANT, budget_table
from pumaid.reporting.text import in_unit, percent, posture_text, relative_names, with_error
from pumaid.results.history import effect_words
from pumaid.robot import EffectChoice

PUMA = diagnoses.PUMA


# Numbers


@pytest.mark.parametrize(
    ("value", "error", "texts"),
    [
        (0.2236776, 0.0000934, ("0.223678", "0.000093")),
        (12345.6, 310.0, ("12346", "310")),
        (6.5e-9, 1.2e-10, ("6.50e-9", "0.12e-9")),
        (0.2236776, 1.3e-15, ("0.2236776", "1.3e-15")),
        (0.5, None, ("0.50000", "")),
        (0.5, np.inf, ("0.50000", "inf")),
    ],
)
def test_value_and_error_end_at_the_same_digit(value, error, texts):
    """Both are shown to the error's second digit, small ones with one power of ten."""
    assert with_error(value, error) == texts


def test_units_of_angles_change_with_their_numbers():
    """A unit with rad in it becomes one with deg, and the factor keeps the quantity the same."""
    degree = np.pi / 180
    assert in_unit("A s2/rad2", "deg") == (pytest.approx(degree**2, rel=1e-12), "A s2/deg2")
    assert in_unit("rad/s", "deg") == (pytest.approx(1.0 / degree, rel=1e-12), "deg/s")
    assert in_unit("rad/s", "rad") == (1.0, "rad/s") and in_unit("A/grade", "deg") == (1.0, "A/grade")


def test_percentages_and_names_are_short_and_distinct():
    """Near 100 % there are enough digits to see the rest; files lose the folders that all of them share."""
    shares = (0.5, 0.99998, -1e-9, None, -0.2)
    assert [percent(share) for share in shares] == ["50 %", "99.998 %", "0 %", "unknown", "-20 %"]
    assert relative_names(["a/b/c.csv", "a/x.csv"]) == {"a/b/c.csv": "b/c.csv", "a/x.csv": "x.csv"}
    assert relative_names(["/a/b.csv", "x.csv"]) == {"/a/b.csv": "/a/b.csv", "x.csv": "x.csv"}


def test_postures_are_in_the_unit_asked_for():
    """Held positions in rad or deg, a dash for the moving joint, and no minus before a zero."""
    assert posture_text(worlds.PENDULUM, [np.nan, -1e-9], "deg") == "[– 0]"
    assert posture_text(worlds.PENDULUM, [0.3, np.pi / 2], "deg", moving=1) == "[– 90]"
    assert posture_text(worlds.PENDULUM, [np.nan, np.pi / 2]) == "[– 1.57]"


# Notes


def test_the_same_note_of_several_joints_is_one():
    """One line names all joints; other notes stay apart, in their order."""
    few = [Note("few-runs", f"joint {n} has 1 run only: its intervals are wide", Where(joint=n)) for n in (1, 2, 5)]
    (line,) = text.merge_notes([*few, few[0]])
    assert str(line) == "note[few-runs]: each of joints 1, 2 and 5 has 1 run only: its intervals are wide"
    spikes = [Note("spikes", f"Joint {n}: spikes in the current", Where(joint=n)) for n in (1, 2)]
    assert text.merge_notes(spikes)[0].text == "joints 1 and 2: spikes in the current"
    others = [
        few[0],
        Note("gap", "0.2 s are missing", Where(file="a.csv", row=7)),
        replace(few[1], where=Where("b.csv", joint=2)),
        Note("few-runs", "joint 1 has 1 run only: something else", Where(joint=1)),
    ]
    assert text.merge_notes(others) == others


# Comparison


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rmse": 0.006, "noise_floor": 0.01}, "below the floor"),
        ({"rmse": 0.01, "noise_floor": 0.01, "budget": None}, "nothing missing"),
        ({"rmse": 0.012, "noise_floor": 0.01}, "little above"),
        ({"rmse": 0.02, "noise_floor": 0.01}, "the model lacks something"),
        ({"explained": None}, "the measured current is constant"),
        ({"explained": -0.3}, "no better than a constant current"),
        ({"explained": 0.998}, "explains 99.8 % of the current's variance"),
        ({"noise_floor": None}, "noise floor unknown (no repeated run)."),
        ({"noise_floor": None, "noise_inside": 0.0123}, "fast noise 0.0123 A (no repeated run)."),
        ({"rmse": None}, "never moves alone in these logs"),
    ],
)
def test_a_joint_is_judged_by_its_noise_floor(context, changes, words):
    """Whether anything is left to explain; what cannot be judged (no repeated run, a constant current) is said."""
    assert words in text.joint_sentence(replace(context.comparison.joints[0], **changes), context.robot)


def test_parameters_are_counted(context):
    unknown = replace(context.estimate.values[0], state="not_identifiable", value=None, reason="x", next_run="y")
    sums = Combination({"coulomb.j1.plus": 1.0, "viscous.j1.plus": 0.4}, 0.5, 0.01, "A", "friction of joint 1")
    estimate = replace(context.estimate, values=(unknown, *context.estimate.values[1:]), combinations=(sums,))
    words = text.summary_sentences(Dataset(()), estimate)[1]
    assert "not identifiable: 1 " in words and "combinations of these: 1." in words


# Residual budget


def score(budget: Budget | None, joint: int = 2) -> JointScore:
    """A joint's score with this budget."""
    rmse = None if budget is None else budget.mean_square**0.5
    return JointScore(joint, 8, 800, rmse, bias=0.0, explained=0.9, budget=budget)


def made(**parts: float) -> Budget:
    """A budget of these parts (A2), none of them significant."""
    every_part = tuple(BudgetPart(name, parts.get(name, 0.0)) for name in text.PART_NAMES)
    return Budget(sum(parts.values()), every_part, 16, 16)


@pytest.fixture(scope="module")
def rippled():
    """A joint with ripple and friction over position."""

    def left(*at):
        return 1.5 * KINDS["fast", "position"](*at) + KINDS["smooth", "direction"](*at)

    return budgets.split(budgets.campaign(left, seed=8))


def test_parts_are_named_by_size(rippled):
    """The largest significant part first, each with its share and the effects with its pattern, then the noise."""
    comparison = Comparison("arm", (score(None, 1), score(rippled)), ())
    first, second, *rest = budget_table(comparison, worlds.PENDULUM).rows
    shares = {part.name: f"{100.0 * text.part_share(rippled, part):.1f} %" for part in rippled.parts}
    assert first[0].startswith("2 ") and first[1] == shares["fast"] and "is ripple over position: 37.3" in first[3]
    assert second[1] == shares["smooth"] and second[3].startswith("varies smoothly with position and reverses")
    assert (first[4], second[4]) == ("ripple", "position_friction or load_friction")
    assert {row[3] for row in rest} <= set(text.PART_NAMES.values()) and "cycles per turn" in first[3]
    assert budget_table(Comparison("arm", (score(None, 1),), ()), worlds.PENDULUM) is None


def test_each_pattern_has_words():
    """What a budget can find, the text can say; each effect that it points to exists."""
    assert {key for key in POINTS_TO if key[0] != "fast"} == set(text.PATTERNS)
    assert {name for names in POINTS_TO.values() for name in names} <= set(catalogue())


def test_bars_are_as_long_as_their_shares():
    """What is significant is solid, and a whole residual is as long as the bar."""
    budget = made(noise_inside=0.5, smooth=0.25, odd=0.25)
    parts = [replace(p, is_more=p.name == "smooth", against=("position",)) for p in budget.parts]
    comparison = Comparison("arm", (score(replace(budget, parts=tuple(parts)), 1),), ())
    bars = [row[2] for row in budget_table(comparison, worlds.PENDULUM).rows]
    assert [bar.count(NOISE) for bar in bars] == [0, BUDGET_BAR // 2, BUDGET_BAR // 4]
    assert [bar.count(SIGNIFICANT) for bar in bars] == [BUDGET_BAR // 4, 0, 0]


def test_what_runs_cannot_separate_is_said_once():
    """Without repeats noise is not separated from physics; one line for all joints that lack the same."""
    budget = replace(made(noise_inside=0.8, unassigned=0.2), replicates=0, limits=("no-replicates",))
    table = budget_table(Comparison("arm", (score(budget, 1), score(budget, 2)), ()), worlds.PENDULUM)
    assert "repeated runs would separate them" in table.rows[1][3]
    assert [note for _, note in table.notes] == [f"All joints: {text.BUDGET_LIMITS['no-replicates']}"]
    noise = Comparison("arm", (score(made(noise_inside=1.0), 1), score(made(noise_inside=1.0), 2)), ())
    assert budget_table(noise, worlds.PENDULUM).notes[0][1].startswith("All joints: the residual is noise")


def test_a_significant_part_is_not_denied_at_the_floor(rippled):
    """The summary does not call a joint complete whose budget has a part that is more than noise."""
    at_floor = replace(score(rippled), noise_floor=rippled.mean_square**0.5)
    assert "yet part of it is more than noise" in text.joint_sentence(at_floor, worlds.PENDULUM)
    assert "nothing missing" not in text.joint_sentence(at_floor, worlds.PENDULUM)


# History


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ([STRIBECK, RIPPLE], ["stribeck@1", "ripple@2"]),
        ([replace(STRIBECK, joint=joint) for joint in (3, 1)], ["stribeck@1,3"]),
        ([replace(STRIBECK, joint=joint) for joint in (1, 2, 3)], ["stribeck@all"]),
        ([EffectChoice("tilt")], ["tilt"]),
    ],
)
def test_effects_are_written_as_they_are_typed(effects, words):
    assert effect_words(effects, 3) == words


# Diagnosis


def test_effects_outside_the_catalogue_have_their_name():
    """An effect from a file has no title and no units of its shape; a suspected column is called that."""
    foreign = replace(diagnoses.stribeck(), effect="my_brake")
    words = " ".join(finding_sentences(foreign, diagnoses.rich(), PUMA))
    assert "Stribeck" not in words and "velocity 0.12 and" in words
    volts = replace(diagnoses.stribeck(), effect="suspect:supply", shape={"times": 1.0}, rivals=(), next_run=None)
    assert finding_title(volts, diagnoses.rich(), PUMA) == "Joint 3 (elbow): an effect of column supply is missing"
    assert "A, times the direction." in size_sentence(volts, PUMA)


def test_joints_without_a_finding_are_not_passed_over():
    """A joint that an effect elsewhere explains is named; at its noise floor it is not said to be missed."""
    diagnosis = diagnoses.rich()
    for rmse, floor, words in ((0.05, 0.023, "something is missing. RMSE"), (0.015, 0.0151, "RMSE at the noise floor")):
        second = replace(diagnosis.joints[1], verdict="missing", rmse=rmse, noise_floor=floor)
        spread = replace(diagnosis, joints=(diagnosis.joints[0], second, *diagnosis.joints[2:]))
        sentences = other_sentences(spread, PUMA)
        assert [words in sentence for sentence in sentences if sentence.startswith("Joint 2 (shoulder): ")] == [True]


def test_suspected_columns_are_answered():
    """Of a suspected column that no finding names it is said whether these data could have shown anything."""
    diagnosis = diagnoses.rich()
    limits = (Limit("suspect:oil", 1, "a", 0.02, "A"), Limit("suspect:volt", 1, "a", None, "A", "constant"))
    asked = replace(diagnosis, joints=(replace(diagnosis.joints[0], limits=limits), *diagnosis.joints[1:]))
    oil, volt = other_sentences(asked, PUMA)[-2:]
    assert oil.startswith("Column oil: no joint's current depends on it")
    assert volt.startswith("Column volt: not testable")


@pytest.mark.parametrize(
    ("form", "kind"), [("s f(q)", "a friction that"), ("v f(q)", "a viscous friction that"), ("f(q)", "a current that")]
)
def test_free_forms_are_described(form, kind):
    """A free form is a friction, a viscous friction or a current that depends on a variable, with its peak."""
    shape = replace(diagnoses.patch(), form=form)
    words = form_sentence(shape, "deg")
    assert f"{kind} depends on position ({form}), largest at 28.6 deg" in words and "83 %" in words
    unclear = form_sentence(replace(shape, is_clear=False, variable="load"))
    assert "the closest is" in unclear and "gravity load" in unclear


def test_limits_of_a_diagnosis_are_said_once():
    """What limits all joints alike is one sentence without joints; of some it names them."""
    diagnosis = diagnoses.rich()
    alike = replace(diagnosis, joints=tuple(replace(joint, weakened=("no replicates",)) for joint in diagnosis.joints))
    assert weaknesses(alike, PUMA) == ["All joints: no replicates."]
    assert "Joints 2 (shoulder) and 6 (wrist3): one posture only." in weaknesses(diagnosis, PUMA)
    fourth = diagnosis.joints[3]  # no run is repeated
    assert "noise floor unknown" in text.floor_words(fourth)


def test_a_long_command_can_be_pasted():
    """A command longer than the line goes on behind a backslash."""
    command = "pumaid identify " + " ".join(f"logs/session_{n:02d}.csv" for n in range(9)) + " --add stribeck@3"
    out = io.StringIO()
    Console(file=out, width=60).print(Paragraph(command, 5, is_command=True))
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    assert len(lines) > 2 and all(line.endswith("\\") for line in lines[:-1])
    assert " ".join(line.strip().rstrip("\\").strip() for line in lines) == command


def test_an_added_effect_is_reported_at_the_joint_that_it_changed():
    """RMSE before and after, held out too; a floor that drift has raised is not mentioned."""
    paper = report_contexts.table_one()
    first = paper.estimate.joints[3]
    old = replace(first, rmse=0.08, heldout=0.09, noise_floor=0.021)
    new = replace(first, rmse=0.02, heldout=0.025, noise_floor=0.021)
    before, after = (replace(paper.estimate, joints=(*paper.estimate.joints[:3], fit)) for fit in (old, new))
    words = step_sentence(diagnoses.tilt(), before, after, robot=PUMA, number=2)
    assert words == (
        "2. Added tilt of the whole arm. Joint 4: RMSE 0.0800 A -> 0.0200 A, hold-out 0.0900 A -> 0.0250 A,"
        " noise floor 0.0210 A."
    )
    drifted = replace(after, joints=(*after.joints[:3], replace(new, noise_floor=0.1)))
    assert "floor" not in step_sentence(diagnoses.tilt(), before, drifted, robot=PUMA, number=2)


def test_many_findings_are_a_table_first():
    """The headline counts them and names their joints; each has a row with what runs that were not fitted show."""
    many = [replace(diagnoses.stribeck(), joint=joint) for joint in (1, 3, 3, 6)]
    told = replace(diagnoses.rich(), findings=(*many, replace(many[0], verdict="doubtful")))
    parts = diagnosis_parts(told, diagnoses.PUMA)
    assert "4 effects at joints 1, 3 and 6 are missing" in parts[0].text and "1 (waist) may be missing" in parts[0].text
    beside = replace(
        told, findings=(*(replace(item, joint=3) for item in many), replace(diagnoses.tilt(), verdict="add"))
    )
    assert "5 effects at joint 3 and the arm are missing" in diagnosis_parts(beside, diagnoses.PUMA)[0].text
    (table,) = [part for part in parts if getattr(part, "title", "") == "What is missing"]
    assert [row[1].text for row in table.cells] == ["1 waist", "3 elbow", "3 elbow", "6 wrist3", "1 waist"]
    assert {row[2].text for row in table.cells} == {"stribeck or viscous_power"}
    assert [row[3].text for row in table.cells] == [*["add"] * 4, "may be missing"]


def test_a_size_that_the_refit_will_change_is_called_a_first_estimate():
    """Of an effect of the load, which makes the load heavier or lighter; not of a friction that has none."""
    loss = replace(diagnoses.stribeck(), effect="load_friction", shape={}, sizes=(Size("drive", 0.2, 0.01, "1"),))
    assert size_sentence(loss, PUMA).endswith("0.200 ± 0.010; a first estimate, since the load was fitted without it.")
    assert "estimate" not in size_sentence(diagnoses.stribeck(), PUMA)
