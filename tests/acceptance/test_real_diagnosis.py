"""Missing physics in public recordings: what must stay true of the findings, whatever the program learns."""

from __future__ import annotations

import math
import re
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from click.testing import CliRunner

from pumaid.cli import group

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import real_data_diagnosis as told
import real_data_gen3 as gen3
import real_data_ur3e as ur3e
from recordings import folder, held_out, read, write_recipe

from pumaid.verbs.diagnose import diagnose
from pumaid.verbs.identify import identify

pytestmark = [
    pytest.mark.realdata,
    # What a ripple takes out may pass what there is by the last digits where it is nearly all; it then ranks first.
    pytest.mark.skipif(not folder().is_dir(), reason="no public recordings here: set PUMAID_REAL_DATA to their folder"),
]

BOTH_WAYS = [name for name in ur3e.SPLITS if "backward" not in name]
#: Magnets, pole pairs and slots of the bare motor.
MAGNETS, POLE_PAIRS, SLOTS = 24, 12, 18


@cache
def climbed(kind, split):
    """The ladder of one split, as the report has it."""
    with TemporaryDirectory() as scratch:
        if kind == "UR3e":
            robot, dataset = read("ur3e", [ur3e.wave()], Path(scratch))
            return told.climb(held_out(dataset, ur3e.SPLITS[split]), robot, ur3e.JOINT)
        if split in told.MOTOR:
            files, judged = told.MOTOR[split]
            return told.climb(*told.motor(files, (judged,), Path(scratch)), 1)
        if split.endswith("the later half"):
            return told.climb(*told.halved(split.partition(",")[0], Path(scratch)), 1)
        return told.climb(*told.motor(split.split(), (), Path(scratch)), 1)


def ripples(found):
    """Waves a turn of the ripples that a ladder added, in its order."""
    return [float(step.added.partition("frequency=")[2]) for step in found.steps if step.added.startswith("ripple")]


def test_motor_held_still_needs_current_for_its_magnets_and_slots():
    """Without pumaid: at standstill 72 = lcm(24, 18) waves a turn lead; slots, pole pairs and magnets follow."""
    strongest = [order for order, _, _ in told.waves("stopped_data")][:4]
    assert strongest == [math.lcm(MAGNETS, SLOTS), SLOTS, POLE_PAIRS, MAGNETS]


def test_cogging_of_the_motor_is_found_at_its_multiples():
    """At 5 rad/s: ripples at 72, then 18 and 12 waves a turn, each to 0.01 %; no law of friction."""
    found = climbed("bare motor", " ".join(told.SPEED))
    assert {one.effect for one in found.first.findings} <= {"ripple", "inertia"}
    assert ripples(found)[:3] == pytest.approx([math.lcm(MAGNETS, SLOTS), SLOTS, POLE_PAIRS], rel=1e-4)


def test_fast_rolling_shows_multiples_of_the_pole_pairs():
    """At 51 rad/s: 12 waves a turn lead and 36 follow, which are one and three an electrical turn."""
    found = climbed("bare motor", " ".join(told.ROLLING))
    assert {one.effect for one in found.first.findings} == {"ripple"}
    assert ripples(found)[:2] == pytest.approx([POLE_PAIRS, 3 * POLE_PAIRS], rel=1e-4)


def test_slots_pull_alike_at_rest_and_in_motion():
    """The 18 waves fitted in motion have the size (15 %) and phase (15 degrees) of the map at standstill."""
    found = climbed("bare motor", " ".join(told.SPEED)).first
    own = next(one for one in found.findings if round(one.shape.get("frequency", 0.0)) == SLOTS)
    cos, sin = (size.value for size in own.sizes)
    size, phase = next((size, phase) for order, size, phase in told.waves("stopped_data") if order == SLOTS)
    assert math.hypot(cos, sin) == pytest.approx(size, rel=0.15)
    assert math.degrees(math.atan2(sin, cos)) == pytest.approx(phase, abs=15.0)


def test_rotor_is_as_heavy_in_both_kinds_of_recording(tmp_path):
    """Inertia found where a controlled speed wavers is that of strokes to and fro, within its standard errors."""
    found = climbed("bare motor", " ".join(told.SPEED)).first
    (size,) = [one.sizes[0] for one in found.findings if one.effect == "inertia"]
    robot, strokes = read("motor", [told.recording("acc_current")], tmp_path)
    heavy = identify(strokes, robot).value("inertia.j1.J").value
    assert abs(size.value - heavy) < 3.0 * size.std_error
    assert size.value > 10.0 * size.std_error


@pytest.mark.parametrize("name", told.ROLLING)
def test_each_rolling_file_is_predicted_better_by_the_others_ripples(name):
    """A file that no fit saw: each ripple added lowers its error, all together by a third at least."""
    errors = [step.heldout for step in climbed("bare motor", f"judge {name}").steps]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.67 * errors[0]


def test_earlier_speed_test_is_predicted_twice_as_well():
    """A file of another day, without the rough half: the others' ripple at 72 waves takes half of its error."""
    steps = climbed("bare motor", "judge speed_test_old").steps
    assert ripples(climbed("bare motor", "judge speed_test_old"))[0] == pytest.approx(72, rel=1e-4)
    assert steps[1].heldout < 0.5 * steps[0].heldout


@pytest.mark.parametrize("name", told.SPEED)
def test_nothing_but_the_motors_multiples_is_added_to_speed_tests(name):
    """Whatever passes is the rotor's inertia or a ripple of slots or pole pairs; the file that was kept gains by it."""
    found = climbed("bare motor", f"judge {name}")
    assert {step.added.partition("@")[0] for step in found.steps[1:]} <= {"ripple", "inertia"}
    for waves in ripples(found):
        nearest = round(waves)
        assert waves == pytest.approx(nearest, rel=1e-4)
        assert nearest % SLOTS == 0 or nearest % POLE_PAIRS == 0
    assert found.steps[-1].heldout <= found.steps[0].heldout


@pytest.mark.parametrize("split", BOTH_WAYS)
def test_ur3e_ripple_is_near_two_waves_a_motor_turn(split):
    """Where a ripple is added to the UR3e it has 198 to 202 waves a turn, and strokes never fitted gain by it."""
    found = climbed("UR3e", split)
    assert all(198.0 < waves < 202.0 for waves in ripples(found)[:1])
    errors = [step.heldout for step in found.steps]
    assert errors == sorted(errors, reverse=True)


def test_ur3e_ripple_is_found_in_most_splits():
    """Two of three splits at the least show it: with five strokes or more both ways it lowers the error by 5 %."""
    gains = [climbed("UR3e", split).steps for split in BOTH_WAYS]
    assert sum(len(steps) > 1 and steps[1].heldout < 0.95 * steps[0].heldout for steps in gains) >= 3


@pytest.mark.parametrize("split", BOTH_WAYS)
def test_ur3e_friction_does_not_rise_towards_rest(split):
    """Below 0.2 rad/s friction is lower than a straight line, so Stribeck friction, which is higher, is never named."""
    found = climbed("UR3e", split)
    for diagnosis in (found.first, found.last):
        assert "stribeck" not in {name for one in diagnosis.findings for name in (one.effect, *one.rivals)}


def test_one_way_strokes_are_called_weak_evidence():
    """Fitted forward only: among what weakens the diagnosis stands that one direction was run."""
    found = climbed("UR3e", "fit forward, judge backward")
    assert any("one direction only" in one for one in found.first.joints[1].weakened)


def test_gen3_shows_no_law_of_friction(tmp_path):
    """One run a joint, one way, at one speed: whatever is named is a ripple at a multiple of 100 waves a turn."""
    robot, dataset = read("kinova_gen3", gen3.one_joint_files(), tmp_path)
    found = diagnose(identify(dataset, robot), dataset, robot)
    assert {one.effect for one in found.findings} <= {"ripple"}
    for one in found.findings:
        waves = one.shape["frequency"]
        assert waves == pytest.approx(100.0 * round(waves / 100.0), abs=0.5)


def test_motions_of_all_joints_are_refused(tmp_path):
    """Logs that a model has not seen are refused, and trusted ones without a run, too: exit code 3, and why."""
    recipe, model = write_recipe("kinova_gen3", tmp_path), tmp_path / "results" / "model.json"
    logs = [str(path) for path in gen3.one_joint_files()]
    run = CliRunner().invoke(group, ["identify", *logs, "--recipe", str(recipe), "-o", str(model)])
    assert run.exit_code == 0
    logs = [str(path) for path in gen3.several_joint_files()]
    asked = ["diagnose", str(model), *logs, "--recipe", str(recipe)]
    for words, message in ((asked, "error[model-other-logs]"), ([*asked, "--trust"], "no run to diagnose")):
        found = CliRunner().invoke(group, words)
        assert found.exit_code == 3
        assert message in found.stderr


def ladder_rows():
    """Rows of the ladder table in docs/real_data.md: recording, split, additions, fitted and held-out errors."""
    page = (Path(__file__).parents[2] / "docs" / "real_data.md").read_text(encoding="utf-8")
    return re.findall(
        r"^\| (UR3e|bare motor) \| ([^|]+) \| ([^|]+) \| ([\d., ]+) \| ([\d., ]+) \|$", page, re.MULTILINE
    )


@pytest.mark.parametrize("row", ladder_rows(), ids=lambda row: row[1])
def test_document_tells_the_ladders(row):
    """Each ladder in docs/real_data.md names what is added today, with its errors to 2 %."""
    kind, split, added, fitted, heldout = row
    steps = climbed(kind, split).steps
    names = [] if added == "nothing" else [one.split()[0] for one in added.split(", ")]
    assert [step.added.partition("@")[0] for step in steps[1:]] == names
    assert [step.fitted for step in steps] == pytest.approx([float(one) for one in fitted.split(", ")], rel=0.02)
    assert [step.heldout for step in steps] == pytest.approx([float(one) for one in heldout.split(", ")], rel=0.02)


def test_document_has_every_split():
    """No split that the report tries is left out of the page, whatever came of it."""
    tried = {*ur3e.SPLITS, *told.MOTOR, *(f"{name}, judge the later half" for name in told.LATER)}
    assert {row[1] for row in ladder_rows()} == tried
