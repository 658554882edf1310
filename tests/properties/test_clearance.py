"""No plan of a random arm comes near its floor, its boxes or itself, by distances that MuJoCo has no part in."""

import os
from dataclasses import replace

import numpy as np
import pytest
from clearance import driven, gaps, random_arm, straight, watched

from pumaid.design import motion
from pumaid.design.collision import TOLERANCE, Collision
from pumaid.design.motion import plan_motion
from pumaid.design.plan import collision_notes, plan
from pumaid.errors import ModelError
from pumaid.robot import Robot
from pumaid.trajectory import Plan

#: First arms of tens of them; PUMAID_ARMS=200 looks at as many.
TENS = range(7000, 7000 + int(os.environ.get("PUMAID_ARMS", "10")), 10)
#: m that positions between two samples, and rounding, may change.
SLACK = 5e-4


def planned(robot: Robot, seed: int) -> Plan:
    """Runs of every second arm, a trajectory of all joints of the others."""
    if seed % 2:
        return plan_motion(robot, ("fourier", "picks")[seed // 2 % 2], minutes=0.6, seed=seed)
    return plan(robot, minutes=1.5 * robot.n_joints, seed=seed)


def nearest(robot: Robot, made: Plan) -> float:
    """Least distance on a plan's ways, m, over the margin."""
    way = made.trajectory
    positions = driven(made) if way is None else way.at(np.arange(0.0, way.cycle, 0.01))[0]
    return float(gaps(robot, positions)[:, watched(robot, 0)].min(initial=1.0)) - robot.safety.margin


@pytest.mark.parametrize("first", TENS)
def test_no_plan_comes_near_what_is_forbidden(first, monkeypatch):
    """Of ten arms each has a plan that stays at the margin, or is refused; without the block some would hit."""
    monkeypatch.setattr(motion, "DRAWN", 20)
    monkeypatch.setattr(motion, "TRIED", 3)
    clear, blind = [], []
    for seed in range(first, first + 10):
        robot = random_arm(seed)
        if seed % 2 == 0:
            careless = plan(replace(robot, safety=None), minutes=1.5 * robot.n_joints, seed=seed)
            blind.append(nearest(robot, careless))
            strikes = bool(list(collision_notes(robot, careless)))
            assert blind[-1] < TOLERANCE + SLACK if strikes else blind[-1] > -1e-6
        try:
            made = planned(robot, seed)
        except ModelError as error:
            assert error.slug == "plan-unsafe" and "safety" in error.mend
            continue
        clear.append(nearest(robot, made))
        assert made.trajectory is not None or not list(collision_notes(robot, made))
    assert min(clear) > -1e-6 and len(clear) >= 4 and min(blind) < 0.0


def test_paths_are_judged_by_the_same_distances():
    """A straight path strikes where it comes within the margin, and is free where it stays a millimetre outside it."""
    verdicts = []
    for seed in range(6990, 7000):
        robot, rng = random_arm(seed), np.random.default_rng(seed)
        low, high = np.transpose([joint.limits for joint in robot.joints])
        pairs, collision = watched(robot, seed), Collision(robot)
        for _ in range(10):
            start, end = rng.uniform(low, high, (2, robot.n_joints))
            end = np.where(rng.random(robot.n_joints) < 0.5, start, end)
            least = float(gaps(robot, straight(start, end, 0.004))[:, pairs].min(initial=1.0))
            verdicts.append(collision.first_hit(start, end) is not None)
            assert verdicts[-1] or least > robot.safety.margin - 1e-6
            assert not verdicts[-1] or least < robot.safety.margin + TOLERANCE + SLACK
    assert 20 < sum(verdicts) < 80
