"""Tables and document of a comparison, and the sentences about it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import stories
import worlds

from pumaid.records import Combination
from pumaid.reporting import scores, wording
from pumaid.reporting.comparison import comparison_document
from pumaid.results.documents import as_text


@pytest.fixture(scope="module")
def told():
    """The small arm's story."""
    return stories.story()


def test_document_has_the_fixed_entries(told):
    """The JSON document of a comparison holds what interfaces promise, and is plain JSON."""
    document = json.loads(as_text(comparison_document(told.comparison)))
    joint = document["joints"][0]
    assert {"joint", "rmse", "noise_floor", "bias", "explained", "runs"} <= set(joint)
    assert {"file", "start", "velocity", "posture", "rmse", "bias"} <= set(joint["runs"][0])
    assert joint["runs"][0]["posture"][0] is None  # the moving joint's own
    assert document["rmse"] == told.comparison.rmse


def test_document_tells_heldout_apart(told):
    """Held-out runs have their own error and are marked among the runs."""
    document = comparison_document(told.comparison)
    assert document["heldout"] == {"rmse": told.comparison.heldout}
    assert sum(run["heldout"] for joint in document["joints"] for run in joint["runs"]) == 1


def test_worst_runs_name_file_and_seconds(told):
    """A user finds the worst run in the log by its file and seconds."""
    first = scores.worst_grid(told.comparison, told.robot, count=3).rows[0]
    run = told.comparison.worst(1)[0].run
    assert first[2].text == run.origin and first[3].text.startswith(f"{run.start:.2f} –")


def test_a_mean_error_that_is_rounding_is_none(told):
    """A bias far below the RMSE is 0 in the table; the document keeps it."""
    first, second = told.comparison.joints
    fitted = replace(told.comparison, joints=(replace(first, bias=1e-17), replace(second, bias=0.5)))
    assert [row[4].text for row in scores.comparison_grid(fitted, told.robot).rows][:2] == ["0", "0.500"]
    assert comparison_document(fitted)["joints"][0]["bias"] == 1e-17


def test_joints_without_runs_are_named_below_the_table(told):
    """One joint never moves, several never move."""
    still = [replace(score, runs=0, rmse=None, noise_floor=None) for score in told.comparison.joints]
    for joints, words in (
        ((told.comparison.joints[0], still[1]), "joint 2 never moves"),
        (still, "joints 1, 2 never move "),
    ):
        table = scores.comparison_grid(replace(told.comparison, joints=tuple(joints)), told.robot)
        assert any(words in text for _, text in table.notes)


def test_an_error_above_the_floor_is_an_alarm(told):
    """A joint whose error is well above the noise floor is marked; one at the floor is not."""
    first, second = told.comparison.joints
    spoilt = replace(told.comparison, joints=(replace(first, rmse=3.0 * first.noise_floor), second))
    tones = [row[2].tone for row in scores.comparison_grid(spoilt, told.robot).rows]
    assert tones == ["alarm", "", ""]


def test_outside_is_told_by_reason(told):
    """What lies outside runs stands in a table of its own, a column a reason; without any there is no table."""
    table = scores.outside_grid(told.comparison, told.robot)
    assert [head.text for head in table.header] == ["joint", "samples", "ramp"]
    assert "Inertia is missing there by design" in table.caption
    assert scores.outside_grid(replace(told.comparison, outside=()), told.robot) is None


def test_postures_are_told_in_the_unit_asked_for(told):
    """Held positions in rad or deg, a dash for the moving joint, and no minus before a zero."""
    run = replace(told.comparison.runs[0].run, posture=np.array([np.nan, -1e-9]))
    assert scores.posture_text(run, worlds.PENDULUM, "deg") == "[– 0]"
    turned = replace(run, posture=np.array([np.nan, np.pi / 2]))
    assert scores.posture_text(turned, worlds.PENDULUM, "deg") == "[– 90]"
    assert scores.posture_text(turned, worlds.PENDULUM) == "[– 1.57]"


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (0.6, "something changes from run to run"),
        (1.0, "nothing missing that repeated runs can show"),
        (1.2, "little more to explain"),
        (2.0, "the model lacks something here"),
    ],
)
def test_sentence_judges_by_the_noise_floor(told, ratio, words):
    """A sentence says whether there is anything left to explain."""
    score = told.comparison.joints[0]
    assert words in wording.joint_sentence(told, replace(score, rmse=ratio * score.noise_floor))


def test_sentence_without_a_floor_does_not_judge(told):
    """Without repeated runs nothing is said about what is left, and the summary says why."""
    joints = tuple(replace(score, noise_floor=None) for score in told.comparison.joints)
    blind = replace(told, comparison=replace(told.comparison, joints=joints))
    assert "explain " not in wording.joint_sentence(blind, joints[0]).split("is left")[1]
    assert "No run of any joint is repeated" in wording.noise_sentence(blind)
    assert wording.noise_sentence(told) is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rms": 0.0, "explained": None}, "no current was measured"),
        ({"explained": None}, "the measured current never changes"),
        ({"explained": -0.3}, "worse than a constant current"),
        ({"explained": 0.998}, "explains 99.8 % of how the current changes"),
    ],
)
def test_sentence_tells_what_there_was_to_explain(told, changes, words):
    """Where the current does not vary, or the model does worse than a constant, it is said in words."""
    assert words in wording.joint_sentence(told, replace(told.comparison.joints[0], **changes))


def test_sentence_of_one_constant_current(told):
    """Runs that ask for one and the same current leave no change to explain, whatever share comes out."""
    runs = tuple(replace(score, predicted=np.full(len(score.predicted), 0.4)) for score in told.comparison.runs)
    calm = replace(told, comparison=replace(told.comparison, runs=runs))
    words = wording.joint_sentence(calm, replace(told.comparison.joints[0], explained=-1e-9))
    assert "ask for one and the same current" in words and "%" not in words.split("is left")[0]


def test_sums_that_are_known_are_counted(told):
    """Where parameters are not identified but sums of them are, the sentence says how many sums."""
    unknown = replace(told.estimate.values[0], state="not_identifiable", value=None, reason="one speed")
    few = Combination({"coulomb.j1.plus": 1.0, "viscous.j1.plus": 0.4}, 0.5, 0.01, "A", "friction of joint 1")
    estimate = replace(told.estimate, values=(unknown, *told.estimate.values[1:]), combinations=(few,))
    assert "of these, 1 sum is known" in wording.parameters_sentence(replace(told, estimate=estimate))


def test_joints_that_never_move_are_named(told):
    """Which joints were never moved alone is said in one sentence."""
    first, second = told.comparison.joints
    still = replace(told.comparison, joints=(first, replace(second, rmse=None, runs=0)))
    assert wording.still_sentence(replace(told, comparison=still)) == "Joint 2 never moves alone in these logs."
