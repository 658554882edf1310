"""Public recordings of real arms, from files to figures: what must stay true of them whatever the program learns."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from pumaid.cli import group
from pumaid.errors import LogError
from pumaid.verbs.compare import compare
from pumaid.verbs.identify import identify

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import real_data_gen3 as gen3
import real_data_others as others
import real_data_ur3e as ur3e
from published_loads import GEN3, UR3E, first_harmonic, loads
from recordings import folder, held_out, read, trial, write_recipe

pytestmark = [
    pytest.mark.realdata,
    pytest.mark.skipif(not folder().is_dir(), reason="no public recordings here: set PUMAID_REAL_DATA to their folder"),
]


def told(*arguments):
    """The JSON document that a command prints."""
    found = CliRunner().invoke(group, [*map(str, arguments), "--json"])
    assert found.exit_code == 0, found.stderr
    return json.loads(found.stdout)


def sums(estimate, text):
    """The determined sum whose description holds `text`."""
    return next(one for one in estimate.combinations if text in one.text)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    """A folder for recipes."""
    return tmp_path_factory.mktemp("recipes")


@pytest.fixture(scope="module")
def shoulder(scratch):
    """The UR3e's robot, evidence and estimate."""
    robot, dataset = read("ur3e", [ur3e.wave()], scratch)
    return robot, dataset, identify(dataset, robot)


@pytest.fixture(scope="module")
def wrist_to_waist(scratch):
    """The Gen3's robot, evidence and estimate from one file a joint."""
    robot, dataset = read("kinova_gen3", gen3.one_joint_files(), scratch)
    return robot, dataset, identify(dataset, robot)


def test_published_load_of_the_ur3e_is_the_sum_of_its_levers():
    """Arm level, wrist as in the recording: masses times their levers from the shoulder, summed by hand."""
    levers = {3.4445: 0.24355 - 0.13, 1.437: 0.24355 + 0.2132 - 0.05, 0.871: 0.24355 + 0.2132 + 0.01}
    by_hand = sum(mass * lever for mass, lever in levers.items()) + (0.805 + 0.261) * (0.24355 + 0.2132 + 0.08535)
    assert loads(UR3E, ur3e.HELD)[1] == pytest.approx(-9.80665 * by_hand, rel=1e-12)


def test_ur3e_goes_through_the_commands(scratch, tmp_path):
    """segment, identify and compare as typed: eleven strokes of half a turn, a model, and a score of that model."""
    recipe, model = write_recipe("ur3e", scratch), tmp_path / "model.json"
    runs = told("segment", ur3e.wave(), "--recipe", recipe)["runs"]
    assert [run["joint"] for run in runs] == [2] * 11
    assert {run["kind"] for run in runs} == {"stroke"}
    fitted = told("identify", ur3e.wave(), "--recipe", recipe, "-o", model)["joints"][1]
    score = told("compare", model, ur3e.wave(), "--recipe", recipe)["joints"][1]
    assert score["rmse"] == pytest.approx(fitted["rmse"], rel=1e-6)


def test_every_ur3e_stroke_is_half_a_turn(shoulder):
    """Each of the eleven strokes covers 180 degrees but for its slow ends, forward and backward in turn."""
    runs = shoulder[1].runs
    assert all(abs(run.span[1] - run.span[0]) == pytest.approx(math.pi, abs=0.03) for run in runs)
    assert [run.direction for run in runs] == [-1, 1] * 5 + [-1]


def test_ur3e_gravity_amplitude(shoulder):
    """The shoulder carries 1.79 A with the arm level (half sums of both ways, which know no friction, say the same)."""
    level = sums(shoulder[2], "joint 2 at position 0")
    assert level.value == pytest.approx(-1.79, abs=0.02)
    assert ur3e.half_sums(shoulder[1])[0][0] == pytest.approx(level.value, abs=0.02)


def test_ur3e_recursion_alone_knows_its_errors(shoulder):
    """With one joint in the logs both steps are one: the recursion's errors are the joint estimate's, within 20 %."""
    robot, dataset, estimate = shoulder
    alone = identify(dataset, robot, recursive=True)
    for one, other in zip(alone.combinations, estimate.combinations, strict=True):
        assert one.std_error == pytest.approx(other.std_error, rel=0.2)
    for value in (value for value in alone.values if value.value is not None):
        assert value.std_error == pytest.approx(estimate.value(value.name).std_error, rel=0.2)


def test_ur3e_load_points_where_the_published_masses_do(shoulder):
    """Direction of the load: within two standard errors of the vendor's centres of mass; half sums: 0.5 degrees."""
    level, quarter = (sums(shoulder[2], f"joint 2 {where}") for where in ("at position 0", "a quarter turn on"))
    known = first_harmonic(UR3E, ur3e.HELD, 2)
    wanted = level.value * known[1] / known[0]
    assert abs(quarter.value - wanted) < 2.0 * quarter.std_error
    cos, sin, _ = ur3e.half_sums(shoulder[1])[0]
    assert math.degrees(math.atan2(sin - cos * known[1] / known[0], -cos)) == pytest.approx(0.0, abs=0.5)


def test_ur3e_torque_constant_is_plausible(shoulder):
    """What published masses and measured amperes imply lies within 15 % of what the controller itself reckons with."""
    implied = first_harmonic(UR3E, ur3e.HELD, 2)[0] / sums(shoulder[2], "joint 2 at position 0").value
    assert implied == pytest.approx(ur3e.controller_model()["joint 2"], rel=0.15)


@pytest.mark.parametrize("split", [name for name in ur3e.SPLITS if "backward" not in name])
def test_ur3e_strokes_not_fitted_are_predicted(shoulder, split):
    """Whole strokes kept from the fit: below 0.065 A, eight times better than without friction or without gravity."""
    scores = trial(held_out(shoulder[1], ur3e.SPLITS[split]), shoulder[0], 2).scores
    errors = {name: score.joints[1].heldout for name, score in scores.items()}
    best = errors.pop("pumaid")
    assert best < 0.065
    assert all(error > 8.0 * best for error in errors.values())
    assert errors["friction only"] > 20.0 * best


def test_ur3e_fitted_one_way_says_nothing_of_the_other(shoulder):
    """Forward strokes alone: backward friction is not identifiable, with that reason; backward strokes are flagged."""
    robot, dataset, _ = shoulder
    one_way = held_out(dataset, [n for n, run in enumerate(dataset.runs, start=1) if run.direction < 0])
    estimate = identify(one_way, robot)
    for name in ("coulomb.j2.minus", "viscous.j2.minus"):
        assert estimate.value(name).state == "not_identifiable"
        assert "never moves backward" in estimate.value(name).reason
    flagged = [score.undetermined for score in compare(estimate, one_way, robot).runs if score.run.direction < 0]
    assert flagged == [True] * 6


def test_ur3e_without_measured_currents_is_refused(scratch):
    """A recording of targets only lacks the recipe's columns; the message names them and the ones that are there."""
    targets = folder() / "ur3e-aurt" / "currentData_100v_40a.parquet"
    found = CliRunner().invoke(group, ["segment", str(targets), "--recipe", str(write_recipe("ur3e", scratch))])
    assert found.exit_code == 3
    assert "column-missing" in found.stderr
    assert "actual_q_0" in found.stderr
    assert "target_q_0" in found.stderr


def test_gen3_runs_are_found_whole(wrist_to_waist):
    """Each file holds one joint at one speed, forward only: nearly all of it but the ramps is kept."""
    robot, dataset, _ = wrist_to_waist
    rows = {int(facts.name.split("_")[-2]): facts.rows for facts in dataset.files}
    for joint in range(1, robot.n_joints + 1):
        own = dataset.of_joint(joint)
        assert {run.kind for run in own} == {"constant"}
        assert all(run.speed == pytest.approx(0.42 if joint <= 4 else 0.367, rel=0.01) for run in own)
        assert sum(run.samples for run in own) > 0.75 * rows[joint]


def test_gen3_single_parameters_are_not_identifiable(wrist_to_waist):
    """One direction, one speed, one posture: no parameter is given a value; the reasons say which of these it is."""
    estimate = wrist_to_waist[2]
    assert [value.name for value in estimate.values if value.value is not None] == []
    for joint in range(1, 8):
        assert "never moves backward" in estimate.value(f"coulomb.j{joint}.minus").reason
        assert "one speed" in estimate.value(f"viscous.j{joint}.plus").reason
    for joint in (2, 4, 6):
        for name in (f"gravity.l{joint}.y", f"gain_ratio.{joint}.{joint + 1}"):
            assert "one posture only" in estimate.value(name).reason


def test_gen3_sums_stand_below_the_parameter_table(scratch, tmp_path):
    """What identify prints for people ends with the friction and the loads that the recordings do determine."""
    recipe, model = write_recipe("kinova_gen3", scratch), tmp_path / "model.json"
    files = [str(path) for path in gen3.one_joint_files()]
    found = CliRunner().invoke(group, ["identify", *files, "--recipe", str(recipe), "-o", str(model)])
    below = found.stdout.partition("Determined only together")[2]
    assert "friction of joint 1 forward, at the one speed that was run" in below
    assert "weight felt by joint 4 a quarter turn on" in below


def test_gen3_loads_stand_in_the_published_proportion(wrist_to_waist):
    """Joints 2 and 4 have the same motor and gear, so their loads' ratio needs no torque constant."""
    second, fourth = (sums(wrist_to_waist[2], f"joint {joint} a quarter turn on") for joint in (2, 4))
    ratio = second.value / fourth.value
    error = ratio * math.hypot(second.std_error / second.value, fourth.std_error / fourth.value)
    known = first_harmonic(GEN3, gen3.HOME, 2)[1] / first_harmonic(GEN3, gen3.HOME, 4)[1]
    assert abs(ratio - known) < 2.0 * error
    assert error < 0.1 * ratio


def test_gen3_joints_moving_together_are_predicted(wrist_to_waist, scratch):
    """Five recordings that the fit never saw hold no run; the model leaves less than 70 % of each joint's current."""
    robot, _, estimate = wrist_to_waist
    _, judged = read("kinova_gen3", gen3.several_joint_files(), scratch)
    assert judged.runs == ()
    outside = compare(estimate, judged, robot).outside
    for joint in range(1, 8):
        own = [part for part in outside if part.joint == joint]
        left = np.average([part.rmse**2 for part in own], weights=[part.samples for part in own])
        assert math.sqrt(left) < 0.7 * gen3.current_size(joint)


def test_gen3_garbage_cells_harm_nothing(scratch):
    """Bins up to 1e298 and NaN stand in columns that the recipe does not name: the file reads like its neighbours."""
    _, dataset = read("kinova_gen3", [gen3.one_joint_files()[4]], scratch)
    assert [run.joint for run in dataset.runs] == [5]
    assert sum(run.samples for run in dataset.runs) > 5000


def test_double_pendulum_yields_no_false_value(scratch):
    """Both joints swing at once or with a motor off: all is left out for that reason, and identify refuses."""
    files = sorted((folder() / "dfki-double-pendulum-a0").glob("*.parquet"))
    robot, dataset = read("pendulum2", files, scratch)
    together = sum(reject.samples for reject in dataset.rejects if reject.reason == "several-joints")
    assert together > 0.8 * sum(facts.rows for facts in dataset.files)
    assert {reject.reason for reject in dataset.rejects} >= {"several-joints", "no-current"}
    with pytest.raises(LogError, match="there is no run to fit"):
        identify(dataset, robot)


def test_tx40_has_nothing_to_fit(scratch):
    """All joints move fast together: no run, and identify ends with exit code 3 and says why."""
    path, recipe = others.tx40(scratch), write_recipe("staubli_tx40", scratch)
    assert told("segment", path, "--recipe", recipe)["runs"] == []
    found = CliRunner().invoke(group, ["identify", str(path), "--recipe", str(recipe)])
    assert found.exit_code == 3
    assert "no-runs" in found.stderr


def test_one_speed_of_a_bare_motor_gives_one_sum(scratch):
    """A motor rolling at one speed: Coulomb and viscous friction stay apart from each other, their sum is told."""
    robot, dataset = read("motor", [folder() / "laas-odri-cogging" / "rolling_data1.parquet"], scratch)
    estimate = identify(dataset, robot)
    assert [value.name for value in estimate.values if value.value is not None] == []
    assert sums(estimate, "friction of joint 1 forward").value == pytest.approx(0.092, abs=0.003)


def test_document_tells_what_comes_out(shoulder, wrist_to_waist):
    """Each sum in the tables of docs/real_data.md is within half a standard error, and rounding, of today's."""
    page = (Path(__file__).parents[2] / "docs" / "real_data.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| ((?:friction of|weight felt by) joint [^|]+) \| ([^|]+) \| ([^|]+) \| A \|$", page, re.MULTILINE
    )
    assert len(rows) == 13
    for number, (what, value, error) in enumerate(rows):
        estimate = shoulder[2] if number < 2 else wrist_to_waist[2]
        found = sums(estimate, re.sub(r" (forward )?\(?(at \d.*|arm .*)$", "", what.strip()))
        rounding = 0.5 * 10.0 ** -len(value.strip().partition(".")[2])
        assert float(value) == pytest.approx(found.value, abs=0.5 * found.std_error + rounding)
        assert float(error) == pytest.approx(found.std_error, rel=0.3, abs=0.001)
