"""Looking at a plan that is there: its errors by the forecast, and each fault by its note."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from menus import arm, names, prior

from pumaid.cli.planning import ATTENTION
from pumaid.design.information import predicted_errors
from pumaid.design.plan import check_plan, plan
from pumaid.design.prior import Setup
from pumaid.robot import Box, Safety
from pumaid.simulation import table1
from pumaid.trajectory import Motion, Plan

PENDULUM = arm("pendulum2")
#: Where the tip comes by when the hip stands half a radian from straight down.
POST = Box("post", (0.3, -0.1, -0.7), (0.4, 0.1, -0.55))


@cache
def own() -> Plan:
    """The planner's."""
    return plan(PENDULUM, minutes=6, seed=1)


@cache
def papers() -> Plan:
    """The paper's motions, looked at."""
    return check_plan(arm("puma560"), table1.experiment(), seed=1)


def needs_attention(plan: Plan) -> bool:
    """Whether ``--check`` of it ends with exit code 1."""
    return any(note.slug in ATTENTION for note in plan.notes)


def slugs(found: Plan) -> list[str]:
    """Of its notes."""
    return [note.slug for note in found.notes]


def test_the_papers_errors_are_those_of_the_forecast():
    """Each expected error is the median of the forecasts for the prior robots."""
    motions = table1.experiment().motions
    each = [predicted_errors([t], motions, names(arm("puma560"))) for t in prior("puma560").robots]
    assert papers().expected == pytest.approx({name: np.median([e[name] for e in each]) for name in each[0]})
    assert papers().motions == table1.experiment().motions


def test_the_papers_plan_lacks_what_diagnosis_needs():
    """Every joint lacks postures, replicates and runs for judging; none lacks speeds; the best plan is far better."""
    lacks = [note for note in papers().notes if note.slug == "plan-lacks"]
    assert [note.where.joint for note in lacks] == [1, 2, 3, 4, 5, 6]
    for note in lacks:
        assert "of 4 postures" in note.text and "made twice" in note.text and "kept for judging" in note.text
        assert "speeds" not in note.text
    assert "plan-needs-tilt" in slugs(papers())
    assert needs_attention(papers())
    assert 0.1 < papers().efficiency < 0.7


def test_the_planners_own_plan_is_as_promised():
    """The same seed gives the same errors, duration and reasons for what is dark, and nothing asks for attention."""
    found = check_plan(PENDULUM, replace(own(), expected={}, unseen={}, notes=()), seed=1)
    assert (found.expected, found.unseen, found.duration) == (own().expected, own().unseen, own().duration)
    assert found.efficiency == pytest.approx(own().efficiency, abs=0.02)
    assert not needs_attention(found)


def test_a_joint_that_never_runs_is_told_with_all_it_hides():
    """Without joint 2's runs its gravity, its friction and the ratio are dark, and it is said to never run."""
    found = check_plan(PENDULUM, replace(own(), motions=tuple(m for m in own().motions if m.joint == 1)), seed=1)
    friction = {f"{kind}.j2.{side}" for kind in ("coulomb", "viscous") for side in ("plus", "minus")}
    assert friction | {"gravity.l2.x", "gravity.l2.y", "gain_ratio.1.2"} == set(found.unseen)
    (dark,) = [note for note in found.notes if note.slug == "plan-dark"]
    assert all(name in dark.text for name in found.unseen)
    assert [note.text for note in found.notes if note.slug == "plan-lacks"] == ["joint 2 (knee): it never runs"]
    assert found.efficiency is None and needs_attention(found)


def test_nothing_is_a_plan_that_shows_nothing():
    """A plan without runs promises nothing and is told so."""
    found = check_plan(PENDULUM, Plan(PENDULUM.name, ()), seed=1)
    assert (found.expected, found.efficiency, found.duration) == ({}, None, 0.0)
    assert slugs(found).count("plan-lacks") == 2


def test_runs_and_moves_that_strike_are_named():
    """A box in the way of one run and of the move to the next: both are named, the free run is not."""
    robot = replace(PENDULUM, safety=Safety((POST,), (), (0.4, 0.0, 0.0), 0.01))
    free = Motion(2, (0.0, 0.0), 0.0, -0.5, 0.5)
    hit = Motion(1, (0.0, 0.0), -1.5, 1.5, 0.5)
    found = check_plan(robot, Plan(robot.name, (free, hit, free)), seed=1)
    strikes = [note for note in found.notes if note.slug == "plan-strikes"]
    assert strikes[0].text.startswith("run 2: ") and "post" in strikes[0].text
    assert strikes[0].where.field == "runs[2]"
    assert not [note for note in strikes if note.text.startswith(("run 1:", "run 3:"))]


def test_planner_avoids_what_the_look_would_find():
    """With a box in reach the planner's own plan strikes nothing and asks for no attention."""
    robot = replace(PENDULUM, safety=Safety((POST,), (), (0.4, 0.0, 0.0), 0.01))
    found = check_plan(robot, plan(robot, minutes=6, seed=1), seed=1)
    assert "plan-strikes" not in slugs(found)


def test_one_speed_and_one_way_are_lacking():
    """Speeds are counted, and a single speed leaves friction's two parts dark."""
    motions = [Motion(k, (0.0, 0.5), -1.0 * w, 1.0 * w, 0.5) for k in (1, 2) for w in (1, -1)]
    found = check_plan(PENDULUM, Plan(PENDULUM.name, tuple(motions)), seed=1)
    assert "1 of 4 speeds" in next(note.text for note in found.notes if note.slug == "plan-lacks")
    assert "viscous.j1.plus" in found.unseen


def test_a_payload_is_looked_at_too():
    """The same runs promise a smaller error of the ratio where the last link carries more."""
    loaded = check_plan(PENDULUM, own(), setup=Setup(payload=(2.0, 0.2, 0.0, 0.0)), seed=1)
    assert loaded.expected["gain_ratio.1.2"] < 0.9 * own().expected["gain_ratio.1.2"]
    assert "carries 2.00 kg" in loaded.assumptions[0]


def test_runs_that_no_log_shows_are_told():
    """A run over a hundredth of a radian and one slower than what counts as rest are named, and ask for attention."""
    first = own().motions[0]
    short = replace(first, end=first.start + 0.01)
    slow = replace(first, velocity=0.002)
    found = check_plan(PENDULUM, replace(own(), motions=(short, *own().motions, slow)), seed=1)
    (note,) = [note for note in found.notes if note.slug == "plan-unusable"]
    assert note.text.startswith(f"2 run(s) of joint {first.joint} ") and note.where.field == "runs[1]"
    assert needs_attention(found) and "plan-unusable" not in slugs(check_plan(PENDULUM, own(), seed=1))
