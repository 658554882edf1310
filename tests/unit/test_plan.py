"""Plans: what they show, how they keep to limits and time, what they refuse."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from paper_recursion import gravity_current

from pumaid.design.candidate_runs import top_speed
from pumaid.design.plan import plan
from pumaid.errors import Faults, ModelError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Joint, Robot
from pumaid.simulation.random_robot import draw
from pumaid.structure import minimal
from pumaid.trajectory import Motion, Plan, span

ARMS = ("puma560", "stanford", "pendulum2")


@cache
def arm(name: str) -> Robot:
    """A shipped recipe."""
    return read_recipe(shipped_recipes()[name])


@cache
def planned(name: str) -> Plan:
    """The default plan of a shipped recipe."""
    return plan(arm(name), seed=5)


def kinds(found: Plan, purpose: str) -> list[tuple[object, ...]]:
    """Motions of a purpose as comparable tuples."""
    return [(m.joint, m.hold, m.start, m.end, m.velocity) for m in found.motions if m.purpose == purpose]


@pytest.mark.parametrize("name", ARMS)
def test_everything_the_arm_has_is_promised(name):
    """Each parameter has either an expected error or a reason why no run shows it."""
    found, structure = planned(name), minimal(arm(name))
    redundant = {f"gain_ratio.{i}.{j}" for i, j in structure.redundant}
    assert set(found.unseen) == set(structure.absent) | redundant
    n = arm(name).n_joints
    friction = {
        f"{kind}.j{k}.{side}" for k in range(1, n + 1) for kind in ("coulomb", "viscous") for side in ("plus", "minus")
    }
    ratios = {f"gain_ratio.{k}.{k + 1}" for k in range(1, n)}
    assert friction | ratios <= set(found.expected) | set(found.unseen)
    assert not set(found.expected) & set(found.unseen)
    assert all(0.0 < error < 1.0 for error in found.expected.values())


@pytest.mark.parametrize("name", ARMS)
def test_limits_and_speeds_are_kept(name):
    """No motion passes a limit or a highest speed, moving or held."""
    robot = arm(name)
    for motion in planned(name).motions:
        own = robot.joint(motion.joint)
        assert 0.0 < motion.velocity <= (own.max_velocity or np.inf)
        for joint, value in zip(robot.joints, motion.hold, strict=True):
            places = (motion.start, motion.end) if joint.number == motion.joint else (value,)
            low, high = joint.limits or (-np.inf, np.inf)
            assert all(low <= place <= high for place in places)


@pytest.mark.parametrize("name", ARMS)
def test_every_joint_has_postures_and_speeds(name):
    """A joint runs in four postures and at four speeds, from a fourteenth of its highest or less up to all of it."""
    robot, fitted = arm(name), [m for m in planned(name).motions if m.purpose == "fit"]
    for joint in robot.joints:
        own = [m for m in fitted if m.joint == joint.number]
        speeds = sorted({m.velocity for m in own})
        assert len({m.hold for m in own}) >= 4
        assert len(speeds) >= 4
        assert speeds[0] <= speeds[-1] / 14.0
        assert speeds[-1] == pytest.approx(top_speed(robot, joint.number), rel=0.02)


@pytest.mark.parametrize("name", ARMS)
def test_every_posture_has_runs_both_ways(name):
    """In each fitted posture the joint goes as often up as down, counted by way, and ends where it began."""
    fitted = [m for m in planned(name).motions if m.purpose == "fit"]
    for joint, hold in {(m.joint, m.hold) for m in fitted}:
        runs = [m for m in fitted if (m.joint, m.hold) == (joint, hold)]
        assert sum(m.end - m.start for m in runs) == pytest.approx(0.0, abs=1e-9)
        assert {m.end > m.start for m in runs} == {True, False}


@pytest.mark.parametrize("name", ARMS)
def test_every_joint_goes_over_its_whole_span(name):
    """In two postures or more a joint passes its whole span in one run: what tells a spring from gravity."""
    robot = arm(name)
    for joint in robot.joints:
        whole = span(joint)
        own = [m for m in planned(name).motions if m.joint == joint.number and m.purpose == "fit"]
        assert len({m.hold for m in own if (min(m.start, m.end), max(m.start, m.end)) == whole}) >= 2


@pytest.mark.parametrize("name", ARMS)
def test_held_out_runs_are_new(name):
    """Runs for judging use speeds, and where postures matter postures, that no fitted run has."""
    found = planned(name)
    fitted, judged = kinds(found, "fit"), kinds(found, "heldout")
    speeds = {(joint, velocity) for joint, *_, velocity in fitted}
    assert {joint for joint, *_ in judged} == set(range(1, arm(name).n_joints + 1))
    assert not {(joint, velocity) for joint, *_, velocity in judged} & speeds
    if arm(name).n_joints > 2:
        assert not {(joint, hold) for joint, hold, *_ in judged} & {(joint, hold) for joint, hold, *_ in fitted}


def test_replicates_are_a_pass_apart():
    """Each joint has many runs that are made again, and between the two most other joints have run."""
    found = planned("puma560")
    places: dict[tuple[object, ...], list[int]] = {}
    for place, motion in enumerate(found.motions):
        if motion.purpose == "fit":
            key = (motion.joint, motion.hold, motion.start, motion.end, motion.velocity)
            places.setdefault(key, []).append(place)
    twice = {key: where for key, where in places.items() if where[-1] - where[0] > 20}
    counts = {joint: sum(key[0] == joint for key in twice) for joint in range(1, 7)}
    assert min(counts.values()) >= 6, counts
    gaps = [{m.joint for m in found.motions[where[0] : where[-1]]} for where in twice.values()]
    # A block at the end of the first pass may come early in the second; across the plan nearly all joints lie between.
    assert np.mean([len(gap) for gap in gaps]) > 4.0


def test_postures_make_each_ratio_visible():
    """Between the postures of one joint the outer links' load differs by more than ten times the noise."""
    robot, found = arm("puma560"), planned("puma560")
    known = draw(robot, 77).constants
    for inner in range(2, robot.n_joints):
        own = replace(known, ratio=np.where(np.arange(5) == inner - 1, 0.0, known.ratio))
        loads = []
        for hold in {m.hold for m in found.motions if m.joint == inner and m.purpose == "fit"}:
            q = np.tile(hold, (40, 1))
            q[:, inner - 1] = np.linspace(-2, 2, 40)
            loads.append((gravity_current(robot, known, q) - gravity_current(robot, own, q))[:, inner - 1])
        assert np.max(np.std(loads, axis=0)) > 0.02


@pytest.mark.parametrize("name", ["puma560", "pendulum2"])
def test_no_plan_is_much_worse_than_the_best_conceivable(name):
    """Errors are within a third of a bound that no experiment of these laps in this time can beat."""
    assert 0.75 < planned(name).efficiency <= 1.0


def test_same_seed_same_plan():
    """The seed decides everything."""
    pendulum = arm("pendulum2")
    assert plan(pendulum, seed=1).motions == plan(pendulum, seed=1).motions
    assert plan(pendulum, seed=1).motions != plan(pendulum, seed=2).motions


@pytest.mark.parametrize("minutes", [6, 15])
def test_budget_is_kept(minutes):
    """A plan for so many minutes takes no longer, and more time tells more."""
    found = plan(arm("pendulum2"), minutes=minutes, seed=5)
    assert found.duration <= 60.0 * minutes
    assert found.duration > 30.0 * minutes
    errors = [
        np.mean(np.log(list(one.expected.values()))) for one in (found, plan(arm("pendulum2"), minutes=3, seed=5))
    ]
    assert errors[0] < errors[1]


def test_too_little_time_is_told():
    """Half a minute is too short for two joints; the message names the least that is not."""
    with pytest.raises(ModelError) as caught:
        plan(arm("pendulum2"), minutes=0.5)
    assert caught.value.slug == "plan-too-short"
    least = int(caught.value.mend.split()[2])
    assert plan(arm("pendulum2"), minutes=least).duration <= 60.0 * least


def test_asked_for_is_done():
    """As many postures as the user names, or more; the speeds and the passes are those of the plan."""
    found = plan(arm("pendulum2"), speeds=(0.1, 0.2, 0.4, 0.8), postures_per_joint=4, replicates=3, seed=1)
    fitted = [motion for motion in found.motions if motion.purpose == "fit" and motion.joint == 1]
    assert len({motion.hold for motion in fitted}) >= 4
    shares = [motion.velocity / top_speed(arm("pendulum2"), 1) for motion in fitted]
    assert sorted({round(share, 1) for share in shares}) == [0.1, 0.2, 0.4, 0.8]
    often = Counter((m.hold, m.start, m.end, m.velocity) for m in fitted)
    assert max(often.values()) >= 3


def test_all_faults_are_told_together():
    """Bad arguments are collected."""
    with pytest.raises(Faults) as caught:
        plan(arm("pendulum2"), minutes=-1.0, speeds=(0.1, 2.0), replicates=0)
    assert [fault.slug for fault in caught.value.faults] == ["plan-impossible"] * 4


@pytest.mark.parametrize(
    "robot",
    [
        Robot("turntable", (Joint(1, "turn", "revolute"),)),
        Robot("hinge", (Joint(1, "hinge", "revolute", alpha=np.pi / 2),)),
        Robot("lift", (Joint(1, "lift", "prismatic"),)),
        Robot("gantry", tuple(Joint(k, f"axis {k}", "prismatic", alpha=np.pi / 2) for k in (1, 2, 3))),
        Robot("weightless", tuple(Joint(k, f"j{k}", "revolute", alpha=1.0) for k in (1, 2)), gravity=(0.0, 0.0, 0.0)),
        Robot("narrow", (Joint(1, "nod", "revolute", alpha=1.5, limits=(-0.05, 0.08)), Joint(2, "tip", "revolute"))),
    ],
    ids=lambda robot: robot.name,
)
def test_odd_arms_get_a_plan(robot):
    """One joint, no weight, only sliding joints, a span of seven degrees: a plan all the same, with its reasons."""
    found = plan(robot, seed=2)
    assert {motion.joint for motion in found.motions} == set(range(1, robot.n_joints + 1))
    assert all(isinstance(motion, Motion) and motion.velocity > 0 for motion in found.motions)
    assert {f"coulomb.j{k}.plus" for k in range(1, robot.n_joints + 1)} <= set(found.expected)


def test_missing_limits_are_told():
    """What was assumed for want of limits stands among the assumptions."""
    told = plan(Robot("hinge", (Joint(1, "hinge", "revolute", alpha=1.5),))).assumptions
    assert "Joint 1 (hinge) states no limits: -125..125 deg taken." in told


def test_rounding_decides_nothing(monkeypatch):
    """A plan stays as it is where inverses are off in their twelfth digit, as on a machine that adds in other order."""
    exact, rng = np.linalg.inv, np.random.default_rng(0)
    wanted = planned("pendulum2").motions
    monkeypatch.setattr(
        np.linalg, "inv", lambda m: exact(m) * (1.0 + 1e-12 * rng.standard_normal((*m.shape[:-2], 1, 1)))
    )
    assert plan(arm("pendulum2"), seed=5).motions == wanted
