"""Sentences and tables of a diagnosis: what is claimed, for whom, how surely, in which unit."""

from __future__ import annotations

import io
from dataclasses import replace

import diagnoses
import numpy as np
import pytest
import stories
import worlds
from rich.console import Console

from pumaid.records import Limit, NextRun, Unexplained
from pumaid.reporting import evidence, findings, verdicts
from pumaid.reporting.diagnosis import Told

PUMA = diagnoses.PUMA


@pytest.mark.parametrize(
    ("p", "words"),
    [
        (1e-9, "less than one in a million"),
        (0.0033, "one in 300"),
        (1 / 1450, "one in 1,000"),
        (0.012, "one in 83"),
        (0.3, "three in ten"),
        (1.0, "ten in ten"),
    ],
)
def test_chance_in_words(p, words):
    """A probability is told as people bet."""
    assert findings.chance(p) == words


def test_a_clean_arm_is_told_in_one_sentence():
    """Nothing missing is said as what these data can show, not as a fact."""
    assert verdicts.headline(diagnoses.clean(), PUMA) == "PUMA 560: nothing is missing that these data can show."
    assert verdicts.adequate_sentences(diagnoses.clean(), PUMA) == []


def test_rivals_stand_in_the_title():
    """What these data cannot tell apart is named where the eye falls first."""
    title = findings.finding_title(diagnoses.stribeck(), PUMA)
    assert title == "Joint 3 (elbow): stribeck is missing, or viscous_power, which these data cannot tell from it"


def test_a_doubtful_finding_may_be_missing():
    """What misses a gate is no claim, and says which gate it misses."""
    told = diagnoses.rich()
    assert findings.finding_title(told.findings[1], PUMA) == "The whole arm: tilt may be missing"
    sentences = findings.finding_sentences(told.findings[1], told, PUMA)
    assert "Why it is doubtful: the error on runs left out does not fall." in sentences


def test_sizes_are_in_the_unit_asked_for():
    """Angles in degrees with their errors; currents stay."""
    assert "x = 1.20 ± 0.23 deg" in findings.size_sentence(diagnoses.tilt(), PUMA, "deg")
    assert "velocity 6.875 deg/s" in findings.size_sentence(diagnoses.stribeck(), PUMA, "deg")
    assert "a = 0.120 ± 0.011 A" in findings.size_sentence(diagnoses.stribeck(), PUMA, "deg")


def test_an_effect_from_outside_is_told_by_its_name():
    """An effect that the catalogue lacks has no title and no units of its shape, and is told all the same."""
    foreign = replace(diagnoses.stribeck(), effect="my_brake")
    words = " ".join(findings.finding_sentences(foreign, diagnoses.rich(), PUMA))
    assert "Stribeck" not in words and "velocity 0.12 and" in words


def test_a_suspected_column_is_told_as_one():
    """What follows a column of the logs is told by the column's name and by what it is multiplied with."""
    volts = replace(diagnoses.stribeck(), effect="suspect:supply", shape={"times": 1.0}, rivals=(), next_run=None)
    assert findings.finding_title(volts, PUMA) == "Joint 3 (elbow): what follows column supply is missing"
    assert "A, times the direction." in findings.size_sentence(volts, PUMA)


def test_a_joint_that_others_explain_is_told():
    """A joint without a finding of its own, whose misfit an effect elsewhere explains, is not passed over."""
    told = diagnoses.rich()
    second = replace(told.joints[1], verdict="missing", rmse=0.05)
    spread = replace(told, joints=(told.joints[0], second, *told.joints[2:]))
    (sentence,) = verdicts.other_sentences(spread, PUMA)
    assert sentence.startswith("Joint 2 (shoulder): something is missing. The model misses by 0.0500 A")
    assert sentence.endswith("What it lacks is among the findings.")


def test_a_suspicion_is_answered():
    """Of a suspected column that no finding names it is said whether these data could have shown anything."""
    told = diagnoses.rich()
    limits = (Limit("suspect:oil", 1, "a", 0.02, "A"), Limit("suspect:volt", 1, "a", None, "A", "it stays the same"))
    asked = replace(told, joints=(replace(told.joints[0], limits=limits), *told.joints[1:]))
    oil, volt = verdicts.suspect_sentences(asked)
    assert oil == "Column oil: no joint's current is shown to follow it."
    assert volt == "Column volt: these runs show nothing of it: it hardly changes there, or has no numbers."


def test_a_joint_at_its_noise_is_not_said_to_be_missed():
    """Where an effect elsewhere acts at a joint whose error is noise, nobody is told that its model fails."""
    told = diagnoses.rich()
    second = replace(told.joints[1], verdict="missing", rmse=0.0150, noise_floor=0.0151)
    spread = replace(told, joints=(told.joints[0], second, *told.joints[2:]))
    (sentence,) = verdicts.other_sentences(spread, PUMA)
    assert sentence == "Joint 2 (shoulder): not missed by more than noise; what is among the findings acts there."


@pytest.mark.parametrize(
    ("variable", "word"), [("q", "position"), ("v", "speed"), ("load", "gravity load"), ("x", "x")]
)
def test_variables_of_shapes_are_words(variable, word):
    """A letter of the engine's is told as a word; a viscous form says that its means are viscous."""
    shape = replace(diagnoses.patch(), variable=variable, form="v f(q)")
    assert f"depends on {word} (" in verdicts.form_sentence(shape)
    assert evidence.shape_lines(shape)[0].split("(")[0].strip() == word
    assert "viscous (A s/rad)" in evidence.shape_lines(shape)[0]


@pytest.mark.parametrize(
    ("form", "kind"), [("s f(q)", "a friction that"), ("v f(q)", "a viscous friction that"), ("f(q)", "a current that")]
)
def test_shapes_without_a_name_are_told_in_words(form, kind):
    """A free form is a friction, a viscous friction or a current that depends on a variable, with its peak."""
    sentence = verdicts.form_sentence(replace(diagnoses.patch(), form=form), "deg")
    assert f"{kind} depends on position ({form}), strongest at 28.6 deg" in sentence and "83 %" in sentence


def test_a_weakness_of_all_joints_is_said_once():
    """What weakens every joint alike is one sentence without joints; of some it names them."""
    told = diagnoses.rich()
    everywhere = replace(told, joints=tuple(replace(one, weakened=("no replicates",)) for one in told.joints))
    assert verdicts.weaknesses(everywhere, PUMA) == ["No replicates."]
    assert "Joints 2 (shoulder) and 6 (wrist3): one posture only." in verdicts.weaknesses(told, PUMA)


def test_a_joint_without_a_floor_is_not_judged():
    """Where no run is repeated, it is not said that the error is above the noise."""
    fourth = diagnoses.rich().joints[3]
    assert "how much of it is noise is not known" in findings.floor_sentence(fourth)


def test_evidence_has_a_row_a_candidate_with_its_reason():
    """Verdict, chance and errors of what explains more than it costs; reasons stand below, each once."""
    table = evidence.evidence_grid(diagnoses.rich(), PUMA)
    assert [row[1].text for row in table.rows] == ["stribeck", "viscous_power", "tilt"]
    assert table.rows[0][2].tone == "alarm" and table.rows[2][2].mark == "a"
    assert [row[0].text for row in table.rows] == ["3 elbow", "3 elbow", "arm"]
    assert ("a", "the error on runs left out does not fall") in table.notes
    assert evidence.evidence_grid(diagnoses.clean(), PUMA) is None


def test_limits_are_told_effect_by_effect():
    """A size a joint in the effect's own unit; what cannot be seen has a reason; the whole arm has its own column."""
    table = evidence.limits_grid(diagnoses.clean(), PUMA)
    assert [head.text for head in table.header][-2:] == ["6 wrist3", "arm"]
    rows = {row[0].text: [cell.text for cell in row] for row in table.rows}
    assert rows["stribeck"][1:4] == ["a (A)", "0.030", "0.015"] and rows["tilt"][-1] == "0.011"
    assert rows["spring"][2] == "-" and table.notes == (("a", "its line is a sinusoid over so short a span"),)
    assert "stribeck at joint 1 (waist) with a larger than 0.030 A would have been found" in table.caption


def test_limits_of_turning_and_sliding_joints_have_rows_of_their_own():
    """Sizes per rad and per m do not share a row; an effect with two sizes has two rows."""
    joints = diagnoses.clean().joints
    first = (Limit("spring", 1, "a", 0.2, "A/rad"), Limit("tilt", None, "x", 0.1, "rad"))
    second = (Limit("spring", 2, "a", 0.4, "A/m"), Limit("tilt", None, "y", 0.2, "rad"))
    told = replace(
        diagnoses.clean(), joints=(replace(joints[0], limits=first), replace(joints[1], limits=second), *joints[2:2])
    )
    rows = [[cell.text for cell in row] for row in evidence.limits_grid(told, worlds.CRANE).rows]
    assert rows == [
        ["spring", "a (A/rad)", "0.20", "", ""],
        ["spring", "a (A/m)", "", "0.40", ""],
        ["tilt", "x (rad)", "", "", "0.10"],
        ["tilt", "y (rad)", "", "", "0.20"],
    ]


def test_runs_that_decide_are_rows():
    """Each run with ends, speed and what is held, in the unit asked for; how often is said below."""
    table = evidence.runs_grid(diagnoses.stribeck(), PUMA, "deg")
    assert [cell.text for cell in table.rows[0]][1:] == [
        "3 elbow", "-68.8 deg", "68.8 deg", "2.86 deg/s", "[0 -90.0 – 28.6 0 0]",
    ]  # fmt: skip
    assert "run twice, they decide nine times in ten" in table.caption
    assert evidence.runs_grid(diagnoses.tilt(), PUMA) is None


def test_where_no_run_decides_it_is_said():
    """A finding whose rivals no feasible run separates says so, and offers no plan."""
    stuck = replace(diagnoses.stribeck(), next_run=NextRun("no run within the limits tells them apart"))
    assert findings.decision_sentence(stuck) == "No run within the limits tells them apart."
    assert "--plan FILE" in findings.decision_sentence(diagnoses.stribeck())
    assert findings.decision_sentence(diagnoses.tilt()) == ""


def test_many_bins_are_drawn_as_few_lines():
    """Neighbours are joined by what is known of them: a bin without runs counts for nothing."""
    centres = np.arange(100.0)
    means, errors = np.ones(100), np.full(100, 0.1)
    means[0], errors[0] = np.nan, np.nan
    means[1] = 5.0
    shape = Unexplained("f(q)", "position", "rad", centres, np.nan_to_num(means), errors, 1.0, 0.5, "")
    lines = evidence.shape_lines(shape)
    assert len(lines) == 21 and "+2.0000 ± 0.0500" in lines[1]  # (5 + 1 + 1 + 1) / 4, 0.1 / 2


def test_a_long_command_can_be_pasted():
    """A command longer than the line goes on behind a backslash."""
    out = io.StringIO()
    command = "pumaid identify " + " ".join(f"logs/session_{n:02d}.csv" for n in range(9)) + " --add stribeck@3"
    Console(file=out, width=60, color_system=None).print(Told(command, 5, is_command=True))
    lines = out.getvalue().splitlines()
    assert len(lines) > 2 and all(line.rstrip().endswith("\\") for line in lines[:-1])
    assert " ".join(line.strip().rstrip("\\").strip() for line in lines) == command


def test_a_step_is_told_by_the_joint_that_it_changed_most():
    """Error before and after, on runs that were not fitted too; a floor that drift has raised is no floor."""
    table = stories.table_one()
    first = table.estimate.joints[3]
    old = replace(first, rmse=0.08, heldout=0.09, noise_floor=0.021)
    new = replace(first, rmse=0.02, heldout=0.025, noise_floor=0.021)
    before, after = (replace(table.estimate, joints=(*table.estimate.joints[:3], one)) for one in (old, new))
    told = findings.step_sentence(diagnoses.tilt(), before, after, robot=PUMA, number=2)
    assert told == (
        "2. tilt of the whole arm added: joint 4 is missed by 0.0200 A instead of 0.0800 A; runs that were not fitted"
        " by 0.0250 A instead of 0.0900 A; the noise floor is 0.0210 A."
    )
    drifted = replace(after, joints=(*after.joints[:3], replace(new, noise_floor=0.1)))
    assert "noise floor" not in findings.step_sentence(diagnoses.tilt(), before, drifted, robot=PUMA, number=2)
