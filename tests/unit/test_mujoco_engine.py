"""A virtual arm in MuJoCo against the masses' own gravity, the mass matrix and friction worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
import table1
from worlds import wrist

from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Joint, Robot
from pumaid.simulation import Friction, draw, simulate
from pumaid.simulation.hidden_effects import ArmState, Hidden
from pumaid.simulation.mujoco_engine import RigidArm
from pumaid.trajectory import Motion, Plan, trapezoids

RATE = 250.0
#: Arm -> where its joints are held; the Stanford arm's third slides.
HOLDS = {"puma560": (0.2, -0.7, 0.5, 0.3, 0.6, 0.1), "stanford": (0.2, -0.7, 0.6, 0.3, 0.6, 0.1)}


@pytest.mark.parametrize("name", HOLDS)
def test_a_run_draws_gravity_friction_and_the_mass_matrix(name):
    """In a run's middle the current is gravity and friction to a tenth of a milliampere, in ramps inertia besides."""
    robot, motions = read_recipe(shipped_recipes()[name]), []
    for joint in (2, 3, 5):
        low, high, speed = (-1.0, 1.0, 0.8) if robot.joint(joint).is_revolute else (0.4, 0.9, 0.15)
        motions += [Motion(joint, HOLDS[name], low, high, speed), Motion(joint, HOLDS[name], high, low, speed)]
    truth = draw(robot, 3).with_noise(0.0)
    plan = Plan(robot.name, tuple(motions))
    logs = simulate(robot, plan, truth=truth, seed=1, rate=RATE)
    arm = RigidArm(truth, step=0.004)
    for movement, log in zip(trapezoids(robot, plan), logs, strict=True):
        if movement.motion is None:
            continue
        j, v = movement.motion.joint - 1, log.velocity[:, movement.motion.joint - 1]
        rising = RATE * np.diff(v, append=0.0)
        explained = truth.gravity_current(log.position)[:, j] + truth.friction.currents(log.velocity)[:, j]
        matrix = np.array([truth.gain[j] * arm.inertia(q)[j, j] for q in log.position[::25]])
        inertia = np.interp(np.arange(len(log)), np.arange(len(log))[::25], matrix)
        rest = log.current[:, j] - explained - inertia * rising
        fast = np.abs(v) > 0.9 * np.abs(v).max()
        steady = fast & (np.abs(rising) < 0.02 * np.abs(rising).max())
        assert np.mean(steady) > 0.3
        # Where the load is steep the speed wavers, and held joints give a little.
        assert abs(np.mean(rest[steady])) < 2e-3
        ramp = fast & (np.abs(rising) > 0.3 * np.abs(rising).max())
        assert np.max(np.abs(rest[ramp])) < 0.05 * np.max(np.abs(log.current[:, j] - explained)) + 0.02


@pytest.mark.parametrize("truth", [draw(table1.robot(), 3), table1.puma560()], ids=["drawn", "table1"])
def test_break_away(truth):
    """Just below the break-away level no joint that rests moves; just above it each does."""
    place = np.array(HOLDS["puma560"])
    for share, moves in ((0.97, False), (1.05, True)):
        for j in range(6):
            arm = RigidArm(truth, step=0.001)
            arm.place(place)
            side = truth.sides[j]
            friction = truth.friction.coulomb_plus[j], truth.friction.coulomb_minus[j]
            uneven, half = 0.5 * sum(friction), truth.coulomb[j]
            current = truth.gravity_current(place[None])[0]
            current[j] += uneven + side * share * truth.breakaway[j] * half
            for _ in range(100):
                arm.advance(current)
            assert (arm.position[j] - place[j] > 1e-5) == moves


def test_friction_stops_a_joint_for_good():
    """A hub without weight or motor current stops after its kinetic energy is spent, and stays."""
    robot = Robot("level", (Joint(1, "hub", "revolute"),))  # turns about the vertical
    truth = draw(robot, 5)
    level, nothing = truth.friction.coulomb_plus, np.zeros(1)
    truth = replace(truth, friction=Friction(level, -level, nothing, nothing))
    arm = RigidArm(truth, step=0.0005)
    arm.place(np.zeros(1))
    arm.data.qvel[:] = 1.0
    for _ in range(6000):
        arm.advance(np.zeros(1))
    way = 0.5 * truth.gain[0] * arm.inertia(np.zeros(1))[0, 0] / level[0]
    assert arm.position[0] == pytest.approx(way, rel=0.01)
    assert abs(arm.velocity[0]) < 1e-6


def frictionless(truth):
    """The same arm without friction."""
    return replace(truth, friction=Friction(*np.zeros((4, truth.robot.n_joints))))


def test_links_push_each_other():
    """A joint without friction next to one that is driven follows the mass matrix's cross term."""
    truth, place = frictionless(draw(table1.robot(), 3)), np.array(HOLDS["puma560"])
    arm = RigidArm(truth, step=0.0005)
    arm.place(place)
    pushed = truth.gravity_current(place[None])[0]
    pushed[1] += 6.0 * np.sign(truth.gain[1])
    for _ in range(10):
        arm.advance(pushed)
    torque = np.array([0.0, 6.0 / abs(truth.gain[1]), 0.0, 0.0, 0.0, 0.0])
    assert arm.velocity == pytest.approx(0.005 * np.linalg.solve(arm.inertia(place), torque), rel=0.02, abs=1e-4)


def test_joint_4_turns_the_motors_behind_it():
    """While joint 4 moves alone, motors 5 and 6 draw their friction, as those of joint 4 alone would not."""
    truth = draw(wrist(), 3)
    velocity, still = np.zeros((2, 6)), np.zeros((2, 6))
    velocity[:, 3] = 0.8
    at = ArmState(np.zeros(2), np.zeros(6), still, velocity, still, still, still)
    drawn = np.column_stack([truth.current(joint, at) for joint in range(1, 7)]) - truth.gravity_current(still)
    for joint, ratio in ((5, 0.0139 * 76.0 / 71.9), (6, (0.013 + 0.18 * 0.0139) * 76.0 / 76.7)):
        np.testing.assert_allclose(drawn[:, joint - 1], truth.friction.currents(np.full(6, 0.8 * ratio))[joint - 1])
    np.testing.assert_allclose(drawn[:, :3], 0.0, atol=1e-12)


def test_coupled_motors_hold_the_arm_with_what_they_carry():
    """With gravity's currents of the coupled motors, and no friction to help, the arm stays where it is."""
    truth = frictionless(draw(wrist(), 3))
    arm = RigidArm(truth, step=0.001)
    posture = np.array([0.0, -1.0, 0.5, 0.3, 0.7, 0.2])
    arm.place(posture)
    for _ in range(50):
        arm.advance(truth.gravity_current(arm.position[None])[0])
    np.testing.assert_allclose(arm.position, posture, atol=1e-7)


def test_a_payload_comes_and_moves_with_the_arm():
    """The load rises by the payload's weight at its time, and the mass matrix with it."""
    truth = draw(table1.robot(), 3).hiding([Hidden("payload", None, {"mass": 3.0, "z": 0.1, "time": 0.01})])
    arm, place = RigidArm(truth, step=0.004), np.array(HOLDS["puma560"])
    arm.place(place)
    for elapsed in (0.0, 0.008, 0.016):
        wanted = truth.carried(arm.position[None], np.array([elapsed]))[0][0]
        assert arm.load == pytest.approx(wanted, abs=2e-3)
        for _ in range(2):
            arm.advance(arm.load)
    bare = RigidArm(replace(truth, hidden=()), step=0.004)
    assert arm.inertia(place)[1, 1] > bare.inertia(place)[1, 1] + 1.0
