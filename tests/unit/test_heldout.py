"""Runs kept for judging: whole files or whole postures, never a part of a fitted run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import worlds

from pumaid.dataset import Dataset
from pumaid.errors import LogError
from pumaid.io.paths import meant
from pumaid.preprocessing.heldout import hold_out

NAMES = ["logs/day1/a.csv", "logs/day1/b.csv", "logs/day2/a.csv"]


def dataset(postures: int = 4) -> Dataset:
    """A pendulum's runs in random postures, in turn in files a, b and c; the one between a and b is in both."""
    truth = worlds.drawn(worlds.PENDULUM, 5)
    runs = worlds.dataset(truth, worlds.experiment(worlds.PENDULUM, postures=postures)).runs
    third = -(-len(runs) // 3)
    named = [replace(run, origin=f"{'abc'[number // third]}.csv") for number, run in enumerate(runs)]
    named[third - 1] = replace(named[third - 1], last_origin="b.csv")
    return Dataset(tuple(named))


def held(found: Dataset) -> list[int]:
    """Indices of the held-out runs."""
    return [number for number, run in enumerate(found.runs) if run.heldout]


def test_every_run_of_a_file_is_held_out():
    """Also one that only ends in it; runs of other files stay."""
    before = dataset()
    found = hold_out(before, files=["b.csv"])
    expected = [k for k, run in enumerate(before.runs) if "b.csv" in (run.origin, run.last_origin)]
    assert held(found) == expected and len(expected) == len(before.runs) // 3 + 1


def test_what_the_plan_holds_out_stays():
    """A run that was marked before is marked after."""
    before = dataset()
    marked = replace(before, runs=(replace(before.runs[0], heldout=True), *before.runs[1:]))
    assert held(hold_out(marked, files=["c.csv"]))[0] == 0


def test_the_last_posture_of_each_joint_is_held_out():
    """All its runs and no other's: three postures a joint are left, and the one that is gone was begun last."""
    found = hold_out(dataset(), postures=True)
    for joint in (1, 2):
        own = found.of_joint(joint)
        kept = {tuple(np.round(np.delete(run.posture, joint - 1), 6)) for run in own if not run.heldout}
        gone = {tuple(np.round(np.delete(run.posture, joint - 1), 6)) for run in own if run.heldout}
        assert len(kept) == 3 and len(gone) == 1 and not kept & gone
        assert gone == {tuple(np.round(np.delete(own[-1].posture, joint - 1), 6))}


def test_a_chance_posture_does_not_count():
    """One run on the way between two postures makes no fourth of them, and is not held out for a fourth."""
    few = dataset(3)
    stray = replace(few.runs[-1], posture=few.runs[-1].posture + 0.5)
    with pytest.raises(LogError, match="4 postures"):
        hold_out(Dataset((*few.runs, stray)), postures=True)
    many = dataset(4)
    assert held(hold_out(Dataset((*many.runs, stray)), postures=True)) == held(hold_out(many, postures=True))


def test_whole_turns_are_no_other_posture():
    """A joint that is held a turn further on is in the same posture; so three are not four."""
    runs = tuple(
        replace(run, posture=run.posture + 2 * np.pi * (number % 2)) for number, run in enumerate(dataset(3).runs)
    )
    with pytest.raises(LogError, match="4 postures"):
        hold_out(Dataset(runs), postures=True)


def test_too_few_postures_are_refused():
    """The message names the joint with most."""
    with pytest.raises(LogError, match="joint 1 has most, 3") as refused:
        hold_out(dataset(3), postures=True)
    assert refused.value.slug == "heldout-nothing"


def test_a_joint_keeps_runs_to_fit():
    """Where files hold all runs of a joint, the joint and its files are named."""
    runs = tuple(replace(run, origin=f"j{run.joint}.csv", last_origin="") for run in dataset().runs)
    with pytest.raises(LogError, match="runs of joint 2 would be held out") as refused:
        hold_out(Dataset(runs), files=["j2.csv"])
    assert refused.value.slug == "heldout-all" and "j2.csv" in refused.value.mend


def test_files_without_runs_are_refused():
    """A file in which nothing was found judges nothing."""
    with pytest.raises(LogError) as refused:
        hold_out(dataset(), files=["d.csv"])
    assert refused.value.slug == "heldout-nothing"


def test_the_note_counts():
    """What is held out, and how much is left."""
    found = hold_out(dataset(), files=["c.csv"])
    n_runs, n_held = len(found.runs), len(held(found))
    assert found.notes[-1].slug == "held-out"
    assert found.notes[-1].text == f"runs held out: {n_held} of c.csv; {n_runs - n_held} of {n_runs} are left to fit"


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("logs/day1/a.csv", NAMES[:1]),
        ("./logs/day1/../day1/a.csv", NAMES[:1]),
        ("a.csv", [NAMES[0], NAMES[2]]),
        ("logs/day1", NAMES[:2]),
        ("logs/day1/", NAMES[:2]),
        ("logs/*/b*", NAMES[1:2]),
        ("b.*", NAMES[1:2]),
    ],
)
def test_files_are_named_as_users_do(pattern, expected):
    """By path, bare name, folder, or a glob of either."""
    assert meant(pattern, NAMES) == expected


def test_a_name_that_leads_nowhere():
    """The nearest one is told."""
    with pytest.raises(LogError) as refused:
        meant("logs/day1/bb.csv", NAMES)
    assert refused.value.slug == "heldout-nothing" and "b.csv" in refused.value.mend
