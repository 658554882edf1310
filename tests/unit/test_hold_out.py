"""Runs kept for judging: by the plan, by whole files or whole postures, never a part of a fitted run."""

from dataclasses import replace

import numpy as np
import pytest
import table1
import worlds
from monte_carlo import Bench

from pumaid.dataset import Dataset
from pumaid.errors import LogError
from pumaid.io.paths import chosen_logs
from pumaid.preprocessing.hold_out import hold_out, match_with_plan
from pumaid.trajectory import Motion, Plan

ROBOT = table1.puma560().robot
HOLD = (0.0, -1.5, 0.5, 0.0, 0.0, 0.0)
OTHER = (0.0, -1.5, 0.9, 0.0, 0.0, 0.0)
PLAN = Plan(
    "PUMA 560",
    (
        Motion(2, HOLD, -1.0, 1.0, 0.5),
        Motion(2, HOLD, 1.0, -1.0, 0.5),
        Motion(2, HOLD, -1.0, 1.0, 0.7, "heldout"),
        Motion(2, OTHER, -1.0, 1.0, 0.5, "heldout"),
    ),
)


def planned() -> Dataset:
    """The plan's runs as found in logs: nothing is marked yet."""
    found = Bench(table1.puma560(), PLAN).runs(np.random.default_rng(1))
    return Dataset(tuple(replace(run, heldout=False) for run in found))


def test_heldout_runs_are_marked_and_no_others():
    shuffled = Dataset(tuple(reversed(planned().runs)))
    found = match_with_plan(shuffled, PLAN, ROBOT)
    assert [run.heldout for run in found.runs] == [True, True, False, False]
    assert found.notes == ()


@pytest.mark.parametrize(
    ("changes", "is_marked"),
    [
        ({"speed": 0.7 * 1.08}, True),
        ({"speed": 0.7 * 0.93}, True),
        ({"speed": 0.7 * 1.15}, False),
        ({"posture": 0.03}, True),
        ({"posture": 0.2}, False),
        ({"speed": -0.7, "span": (1.0, -1.0)}, False),
    ],
)
def test_a_run_may_differ_a_little(changes, is_marked):
    """Speed by a tenth, posture by a steady error of 0.03 rad; a run down is not the planned run up."""
    run = planned().runs[2]
    if "posture" in changes:
        changes = {"posture": run.posture + np.array([0.0, 0.0, 0.0, changes["posture"], 0.0, 0.0])}
    assert match_with_plan(Dataset((replace(run, **changes),)), PLAN, ROBOT).runs[0].heldout is is_marked


def test_missing_runs_are_told():
    """Planned motions of which the logs have no run are counted and named; a repeat that lacks its run is one."""
    (note,) = match_with_plan(Dataset(planned().runs[:2]), PLAN, ROBOT).notes
    assert note.slug == "plan-run-missing"
    assert "2 of 4 planned runs" in note.text and "run 3 (joint 2 up)" in note.text
    twice = replace(PLAN, motions=(*PLAN.motions, PLAN.motions[0]))
    assert "1 of 5 planned runs" in match_with_plan(planned(), twice, ROBOT).notes[0].text


def test_unplanned_runs_are_fitted():
    stray = replace(planned().runs[0], joint=4, posture=np.array([0.0, -1.5, 0.5, np.nan, 0.0, 0.0]))
    found = match_with_plan(Dataset((*planned().runs, stray)), PLAN, ROBOT)
    assert [run.heldout for run in found.runs] == [False, False, True, True, False]
    assert found.notes == ()


def test_parts_of_a_motion_are_all_marked():
    """A run that was cut in two is held out in both parts; over half of the span it counts for the whole motion."""
    parts = tuple(replace(planned().runs[2], span=span) for span in ((-0.9, -0.1), (0.1, 0.9)))
    assert [run.heldout for run in match_with_plan(Dataset(parts), PLAN, ROBOT).runs] == [True, True]
    plan = replace(PLAN, motions=(Motion(2, HOLD, -1.0, 1.0, 0.5), Motion(2, HOLD, 0.0, 1.0, 0.5)))
    half = replace(planned().runs[0], span=(0.1, 0.9))
    assert match_with_plan(Dataset((half, half)), plan, ROBOT).notes == ()
    assert "1 of 2 planned runs" in match_with_plan(Dataset((half,)), plan, ROBOT).notes[0].text


NAMES = ["logs/day1/a.csv", "logs/day1/b.csv", "logs/day2/a.csv"]


def dataset(postures: int = 4) -> Dataset:
    """A pendulum's runs in random postures, a third in each of the files a, b and c."""
    truth = worlds.drawn(worlds.PENDULUM, 5)
    runs = worlds.dataset(truth, worlds.experiment(worlds.PENDULUM, postures=postures)).runs
    third = -(-len(runs) // 3)
    named = [replace(run, origin=f"{'abc'[number // third]}.csv") for number, run in enumerate(runs)]
    return Dataset(tuple(named))


def held(found: Dataset) -> list[int]:
    """Indices of the held-out runs."""
    return [number for number, run in enumerate(found.runs) if run.heldout]


def test_every_run_of_a_file_is_held_out():
    """Runs of other files stay as they are, also those that the plan holds out; a note counts."""
    before = dataset()
    before = replace(before, runs=(replace(before.runs[0], heldout=True), *before.runs[1:]))
    found = hold_out(before, files=["b.csv"])
    expected = [k for k, run in enumerate(before.runs) if run.origin == "b.csv"]
    assert held(found) == [0, *expected] and len(expected) == len(before.runs) // 3
    counts = f"{len(expected) + 1} runs are held out, {len(expected)} of them as was asked"
    assert found.notes[-1].slug == "held-out"
    assert found.notes[-1].text == f"{counts}; {len(before.runs) - len(expected) - 1} are left to fit"


def test_a_joint_keeps_runs_to_fit():
    """Where files hold all runs of a joint, the joint and its files are named; a file without runs judges nothing."""
    runs = tuple(replace(run, origin=f"j{run.joint}.csv") for run in dataset().runs)
    with pytest.raises(LogError, match="runs of joint 2 would be held out") as refused:
        hold_out(Dataset(runs), files=["j2.csv"])
    assert refused.value.slug == "heldout-nothing" and "j2.csv" in refused.value.mend
    with pytest.raises(LogError, match="heldout-nothing"):
        hold_out(dataset(), files=["d.csv"])


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("logs/day1/a.csv", NAMES[:1]),
        ("./logs/day1/../day1/a.csv", NAMES[:1]),
        ("a.csv", [NAMES[0], NAMES[2]]),
        ("logs/day1", NAMES[:2]),
        ("logs/*/b*", NAMES[1:2]),
        ("b.*", NAMES[1:2]),
    ],
)
def test_files_are_named_as_users_do(pattern, expected):
    """By path, bare name, folder, or a glob of either; of a name that leads nowhere the nearest one is told."""
    assert chosen_logs(pattern, NAMES) == expected
    with pytest.raises(LogError) as refused:
        chosen_logs("logs/day1/bb.csv", NAMES)
    assert refused.value.slug == "heldout-nothing" and "b.csv" in refused.value.mend
    with pytest.raises(LogError, match="name it among the logs, too"):
        chosen_logs(__file__, NAMES)
