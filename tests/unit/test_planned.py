"""Runs matched to the plan by which they were made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pumaid.dataset import Dataset, Run
from pumaid.preprocessing.planned import mark_heldout
from pumaid.simulation import runs, table1
from pumaid.trajectory import Motion, Plan

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


def dataset() -> Dataset:
    """The plan's runs as found in logs: nothing is marked yet."""
    found = runs(table1.puma560(), PLAN, np.random.default_rng(1))
    return Dataset(tuple(replace(run, heldout=False) for run in found))


def with_first(**changes: object) -> tuple[Run, ...]:
    """Runs of which the third (held out) is changed."""
    found = dataset().runs
    return (*found[:2], replace(found[2], **changes), *found[3:])


def test_heldout_runs_are_marked_and_no_others():
    """Posture, speed and direction decide, not the order."""
    shuffled = Dataset(tuple(reversed(dataset().runs)))
    found = mark_heldout(shuffled, PLAN)
    assert [run.heldout for run in found.runs] == [True, True, False, False]
    assert found.notes == ()


@pytest.mark.parametrize(("share", "is_marked"), [(1.08, True), (0.93, True), (1.15, False)])
def test_speed_may_differ_by_a_tenth(share, is_marked):
    """A robot that runs 8 % fast makes the planned run; at 15 % it is another."""
    found = mark_heldout(Dataset(with_first(speed=0.7 * share)), PLAN)
    assert found.runs[2].heldout is is_marked


@pytest.mark.parametrize(("away", "is_marked"), [(0.03, True), (0.2, False)])
def test_posture_may_differ_a_little(away, is_marked):
    """A steady error of 0.03 rad is the planned posture, 0.2 rad is not."""
    posture = dataset().runs[2].posture + np.array([0.0, 0.0, 0.0, away, 0.0, 0.0])
    assert mark_heldout(Dataset(with_first(posture=posture)), PLAN).runs[2].heldout is is_marked


def test_the_other_direction_is_another_run():
    """A run down is not the planned run up."""
    assert not mark_heldout(Dataset(with_first(speed=-0.7, span=(1.0, -1.0))), PLAN).runs[2].heldout


def test_the_nearest_speed_decides():
    """Between a fitted run at 0.50 and one for judging at 0.54 a run at 0.535 is for judging."""
    plan = replace(PLAN, motions=(PLAN.motions[0], replace(PLAN.motions[0], velocity=0.54, purpose="heldout")))
    run = replace(dataset().runs[0], speed=0.535)
    assert mark_heldout(Dataset((run,)), plan).runs[0].heldout


def test_missing_runs_are_told():
    """Planned motions of which the logs have no run are counted and named."""
    found = mark_heldout(Dataset(dataset().runs[:2]), PLAN)
    (note,) = found.notes
    assert note.slug == "plan-run-missing"
    assert "2 of 4 planned runs" in note.text
    assert "run 3 (joint 2 up)" in note.text


def test_a_replicate_that_is_missing_is_told():
    """Of a motion planned twice and found once, one is missing."""
    plan = replace(PLAN, motions=(*PLAN.motions, PLAN.motions[0]))
    (note,) = mark_heldout(dataset(), plan).notes
    assert "1 of 5 planned runs" in note.text


@pytest.mark.parametrize(("count", "notes"), [(1, []), (3, ["plan-run-unplanned"])])
def test_many_unplanned_runs_are_told_and_kept(count, notes):
    """Runs that nobody planned stay in the fit; a quarter of all may pass unsaid, more is told."""
    stray = replace(dataset().runs[0], joint=4, posture=np.array([0.0, -1.5, 0.5, np.nan, 0.0, 0.0]))
    found = mark_heldout(Dataset((*dataset().runs, *[stray] * count)), PLAN)
    assert [run.heldout for run in found.runs] == [False, False, True, True] + [False] * count
    assert [note.slug for note in found.notes] == notes


def test_parts_of_a_motion_are_all_marked():
    """A run that was cut in two is held out in both parts."""
    first = replace(dataset().runs[2], span=(-0.9, -0.1))
    second = replace(dataset().runs[2], span=(0.1, 0.9))
    found = mark_heldout(Dataset((first, second)), PLAN)
    assert [run.heldout for run in found.runs] == [True, True]


def test_another_arms_plan_changes_nothing():
    """A plan for another number of joints marks nothing."""
    plan = Plan("pendulum", (Motion(2, (0.0, 0.0), -1.0, 1.0, 0.7, "heldout"),))
    assert mark_heldout(dataset(), plan).runs == dataset().runs or not any(
        run.heldout for run in mark_heldout(dataset(), plan).runs
    )


def test_a_tour_and_its_part_are_told_apart():
    """Of two motions as fast, one over the span and one over a fifth of it, each run is the one whose way it goes."""
    tour, part = Motion(2, HOLD, -1.0, 1.0, 0.5), Motion(2, HOLD, 0.0, 0.4, 0.5)
    plan = Plan("PUMA 560", (part, tour, part, tour))
    found = runs(table1.puma560(), plan, np.random.default_rng(2))
    assert mark_heldout(Dataset(tuple(found)), plan).notes == ()


def test_a_run_of_which_little_is_left_is_not_missing():
    """A run over the whole span, found only over its second half, counts for it where the half has its own run."""
    whole, half = Motion(2, HOLD, -1.0, 1.0, 0.5), Motion(2, HOLD, 0.0, 1.0, 0.5)
    first = replace(dataset().runs[0], span=(0.1, 0.9))
    plan = replace(PLAN, motions=(whole, half))
    assert mark_heldout(Dataset((first, first)), plan).notes == ()
    (note,) = mark_heldout(Dataset((first,)), plan).notes
    assert "1 of 2 planned runs" in note.text
