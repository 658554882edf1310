"""Hidden effects: laws written out by hand or found the slow way, where they act, and how they are named."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import table1
from monte_carlo import Bench, warming
from scipy.optimize import brentq
from test_session import SHORT, session

from pumaid.errors import ModelError
from pumaid.robot import Joint, Robot
from pumaid.simulation import Hidden, draw
from pumaid.simulation.hidden_effects import LAWS, ArmState, parse
from pumaid.simulation.mujoco_engine import RigidArm
from pumaid.trajectory import REST, Motion, Plan, run_trapezoid

PUMA = table1.puma560().with_noise(0.0)
RATE = 100.0
#: An arm with masses: shoulder, elbow and a wrist out of their plane.
ARM = Robot(
    "three joints",
    (
        Joint(1, "shoulder", "revolute", alpha=-1.2),
        Joint(2, "elbow", "revolute", a=0.5, d=0.1),
        Joint(3, "wrist", "revolute", alpha=1.1, a=0.1, d=0.4),
    ),
)
HEAVY = draw(ARM, 3).with_noise(0.0)
#: A s2/rad that each joint moves near the plan's postures.
INERTIA = HEAVY.gain * np.diag(RigidArm(HEAVY, step=0.005).inertia(np.array([0.4, 0.0, 0.7])))
HEAVY_PLAN = Plan(
    "three joints", (Motion(2, (0.4, 0.0, 0.7), -1.5, 1.5, 0.9), Motion(1, (0.0, 0.6, -0.5), 1.2, -1.2, 0.7))
)


def ideal(robot: Robot, plan: Plan, step: float = 0.01) -> ArmState:
    """The plan's motions one after the other every `step` s, each after a rest, made to the letter."""
    parts, first, clock = [], np.full(robot.n_joints, np.nan), 0.0
    for motion in plan.motions:
        run, j = run_trapezoid(robot, motion), motion.joint - 1
        local = np.arange(0.0, run.duration + REST, step) - REST
        position, velocity = run.at(np.maximum(local, 0.0))
        velocity[local <= 0.0] = 0.0
        first[j] = clock + REST if np.isnan(first[j]) else first[j]
        parts.append((clock + REST + local, position, velocity, np.gradient(velocity, step, axis=0)))
        parts[-1] += (np.abs(position - position[0]),)
        clock += len(local) * step
    time, *motion_of = (np.concatenate(part) for part in zip(*parts, strict=True))
    first = np.where(np.isnan(first), np.nanmin(first), first)
    return ArmState(time, first, *motion_of, np.tile(warming(time)[:, None], robot.n_joints))


def static(truth, plan=SHORT, step: float = 0.01) -> dict[str, np.ndarray]:
    """Motion and current of a robot that follows its plan to the letter."""
    at = ideal(truth.robot, plan, step)
    names = ("time", "position", "velocity", "acceleration", "travel", "temperature")
    current = np.column_stack([truth.current(joint.number, at) for joint in truth.robot.joints])
    return {name: getattr(at, name) for name in names} | {"current": current}


def difference(effect: str, joint: int | None = None, truth=PUMA, plan=SHORT, **values: float):
    """The ideal course with an effect, and (N, J) what the effect added to the currents."""
    motion = static(replace(truth, hidden=(Hidden(effect, joint, values),)), plan)
    return motion, motion["current"] - static(truth, plan)["current"]


#: Effect -> its values, and the current that it adds: s direction, v velocity, q position, tau load, t since first run,
#: a acceleration. Of the other effects test_estimate.py finds the values again by a law that was written apart.
CASES = {
    "inertia": ({"J": 0.3}, lambda s, v, q, tau, t, a: 0.3 * a),
    "counterbalance": (
        {"a": 0.3, "length": 0.5, "angle": 0.4},
        lambda s, v, q, tau, t, a: 0.3 * np.sin(q - 0.4) / np.sqrt(1.25 - np.cos(q - 0.4)),
    ),
    "friction_step": ({"a": 0.2, "time": 1.005}, lambda s, v, q, tau, t, a: s * np.where(t > 1.005, 0.2, 0.0)),
    "load_friction": (
        {"drive": 0.3, "back": 0.1},
        lambda s, v, q, tau, t, a: s * np.abs(tau) * np.where(tau * s > 0, 0.3, 0.1),
    ),
}


@pytest.mark.parametrize("effect", CASES)
@pytest.mark.parametrize(("joint", "side"), [(2, 1.0), (3, -1.0)])
def test_law_is_what_it_says(effect, joint, side):
    """The current added to the joint is the law written out by hand, with the motor's own sign and clock."""
    values, law = CASES[effect]
    motion, added = difference(effect, joint, **values)
    q, v, acceleration = (motion[name][:, joint - 1] for name in ("position", "velocity", "acceleration"))
    load = PUMA.gravity_current(motion["position"])[:, joint - 1]
    # A run begins when its 0.4 s of rest are over; joint 2's is the first of the session.
    ran = np.flatnonzero((v != 0) & (np.abs(motion["velocity"]).sum(axis=1) == np.abs(v)))[0]
    t = motion["time"] - (0.4 if joint == 2 else motion["time"][ran] - 0.01)
    assert added[:, joint - 1] == pytest.approx(law(side * np.sign(v), v, q, load, t, side * acceleration), abs=1e-9)
    assert np.max(np.abs(added[:, joint - 1])) > 0.01
    assert np.all(np.delete(added, joint - 1, axis=1) == 0.0)
    if effect == "counterbalance":  # without a joint it acts at all that move
        assert np.all(np.max(np.abs(difference(effect, **values)[1][:, 1:3]), axis=0) > 0.01)


DOWN = np.array([0.0, 0.0, -9.80665])


def link_frames(truth, position: np.ndarray) -> list[np.ndarray]:
    """Frames of the links by 4 x 4 transforms, one after the other."""
    frame, out = np.eye(4), []
    for k, joint in enumerate(truth.robot.joints):
        (ca, sa), (c, s) = ((math.cos(x), math.sin(x)) for x in (joint.alpha, position[k] + joint.theta))
        about_x = np.array([[1, 0, 0, joint.a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        frame = frame @ about_x @ np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, joint.d], [0, 0, 0, 1]])
        out.append(frame)
    return out


def slow_load(truth, position, joint: int, gravity=DOWN, extra=(0.0, [0, 0, 0])) -> float:
    """A: slope of the potential energy by central differences, times the gain; `extra` is a mass on the last link."""

    def energy(position: np.ndarray) -> float:
        frames = link_frames(truth, position)
        bodies = [*zip(truth.links.mass, truth.links.centre, strict=True), extra]
        return -sum(m * gravity @ (f @ [*c, 1.0])[:3] for f, (m, c) in zip([*frames, frames[-1]], bodies, strict=True))

    step = 1e-5 * np.eye(len(position))[joint - 1]
    return truth.gain[joint - 1] * (energy(position + step) - energy(position - step)) / 2e-5


def tilted(q, joint, time):
    """A base that is turned about x stands in a turned field of gravity."""
    c, s = math.cos(0.2), math.sin(0.2)
    return slow_load(HEAVY, q, joint, np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T @ DOWN)


def displaced(q, joint, time):
    """Joint 2 stands 0.3 rad beyond what its sensor says."""
    return slow_load(HEAVY, q + np.array([0.0, 0.3, 0.0]), joint)


def with_payload(q, joint, time):
    """A mass comes 3 s after the arm's first run began."""
    return slow_load(HEAVY, q, joint, extra=(2.0 * (time - REST > 3.0), [0.1, -0.05, 0.2]))


def sagging(q, joint, time):
    """The link stands where the spring of its drive balances its weight there."""
    side = np.sign(HEAVY.friction.coulomb_plus[1])
    lack = lambda x: x - q[1] + side * 0.05 * slow_load(HEAVY, np.array([q[0], x, q[2]]), 2)  # noqa: E731
    return slow_load(HEAVY, np.array([q[0], brentq(lack, q[1] - 1.0, q[1] + 1.0, xtol=1e-10), q[2]]), joint)


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize(
    ("effect", "where", "values", "load"),
    [
        ("tilt", None, {"x": 0.2, "y": 0.0}, tilted),
        ("zero_offset", 2, {"delta": 0.3}, displaced),
        ("payload", None, {"mass": 2.0, "x": 0.1, "y": -0.05, "z": 0.2, "time": 3.0}, with_payload),
        ("flexibility", 2, {"c": 0.05}, sagging),
    ],
)
def test_what_weighs_draws_the_slope_of_its_energy(effect, where, values, load, joint):
    """Every joint that carries a displaced, sagging or added body feels it as the potential energy says."""
    motion, added = difference(effect, where, HEAVY, HEAVY_PLAN, **values)
    for k in np.flatnonzero(motion["velocity"][:, joint - 1])[::29]:
        q = motion["position"][k]
        wanted = load(q, joint, motion["time"][k]) - slow_load(HEAVY, q, joint)
        assert added[k, joint - 1] == pytest.approx(wanted, abs=1e-5)
    assert np.max(np.abs(added[:, joint - 1])) > 0.01


def test_coupling_carries_another_joints_load():
    """Joint 2's motor gets its share of joint 3's weight and of its friction where it moves; no other joint does."""
    motion, added = difference("coupling", 3, HEAVY, HEAVY_PLAN, c=0.4, on=2.0)
    for k in range(0, len(added), 37):
        wanted = slow_load(HEAVY, motion["position"][k], 3) + HEAVY.friction.currents(motion["velocity"][k])[2]
        assert added[k, 1] == pytest.approx(0.4 * wanted, abs=1e-6)
    assert np.all(added[:, [0, 2]] == 0.0)


def test_side_load_is_the_moment_across():
    """Friction of bearings follows the moment of all outer weights less its part along the axis."""
    motion, added = difference("side_load_friction", 2, HEAVY, HEAVY_PLAN, mu=0.3)
    side = np.sign(HEAVY.friction.coulomb_plus[1])
    for k in np.flatnonzero(motion["velocity"][:, 1])[::29]:
        frames = link_frames(HEAVY, motion["position"][k])
        origin, axis = frames[1][:3, 3], frames[1][:3, 2]
        places = [(frame @ [*centre, 1.0])[:3] for frame, centre in zip(frames, HEAVY.links.centre, strict=True)]
        moment = sum(np.cross(places[i] - origin, HEAVY.links.mass[i] * DOWN) for i in (1, 2))
        across = np.linalg.norm(moment - axis * (axis @ moment))
        wanted = side * np.sign(motion["velocity"][k, 1]) * 0.3 * across * abs(HEAVY.gain[1])
        assert added[k, 1] == pytest.approx(wanted, abs=1e-9)


def test_delay_stamps_the_current_late():
    """The delayed joint's current is that of some samples before, row by row; other joints' is not."""
    plain, late = (
        session(PUMA, rate=RATE),
        session(replace(PUMA, hidden=(Hidden("delay", 2, {"dt": 0.05}),)), rate=RATE),
    )
    assert late["current"][5:, 1] == pytest.approx(plain["current"][:-5, 1], abs=1e-9)
    assert np.array_equal(late["current"][:, 0], plain["current"][:, 0])
    assert np.array_equal(late["position"], plain["position"])


@cache
def warmed() -> dict[str, np.ndarray]:
    """The log of a robot whose friction falls as its motors warm."""
    plan = replace(SHORT, motions=SHORT.motions * 5)
    return session(replace(PUMA, hidden=(Hidden("thermal_friction", 2, {"a": -0.1}),)), plan, rate=RATE)


def test_thermal_friction_follows_the_logged_temperature():
    """Friction falls with the temperature above 25 degC that the log has, which is there without being asked for."""
    log = warmed()
    above, v = log["temperature"][:, 1] - 25.0, log["velocity"][:, 1]
    rubs = PUMA.friction.currents(log["velocity"])[:, 1]
    cruising = (np.abs(np.gradient(v)) < 1e-5) & (np.abs(v) > 0.49) & (np.abs(v) < 0.51)
    added = log["current"][:, 1] - PUMA.gravity_current(log["position"])[:, 1] - rubs
    # Temperatures are logged in steps of 0.1 degC; a changing speed draws a milliampere or two.
    assert np.quantile(np.abs(added + 0.1 * np.sign(v) * above)[cruising], 0.999) < 0.1 * 0.06 + 0.002
    assert 1.0 < np.max(above) < 60.0


def test_temperature_is_a_first_order_answer_to_the_square_of_the_current():
    """Stepped sample by sample by hand, the temperature is the logged one."""
    holds = np.array([motion.hold for motion in SHORT.motions])
    usual = np.sqrt(np.mean(PUMA.gravity_current(holds)[:, 1] ** 2)) + PUMA.coulomb[1]
    now = 25.0
    for current, logged in zip(warmed()["current"][:, 1], warmed()["temperature"][:, 1], strict=True):
        now += (25.0 + 30.0 * (current / usual) ** 2 - now) * 0.01 / 600.0
        assert logged == pytest.approx(now, abs=0.06)


def test_clipping_comes_last():
    """With a spring and a limit the sum is clipped, in whatever order they are named."""
    both = (Hidden("saturation", 2, {"limit": 0.5}), Hidden("spring", 2, {"a": 2.0}))
    for order in (both, both[::-1]):
        assert np.max(np.abs(session(replace(PUMA, hidden=order), rate=RATE)["current"][:, 1])) == pytest.approx(0.5)


@pytest.mark.parametrize("effect", sorted(set(LAWS) - {"inertia", "thermal_friction"}))
def test_bench_hides_the_same(effect):
    """Runs without dynamics carry the hidden current that MuJoCo's closed loop carries at the same positions."""
    truth = HEAVY.hiding([Hidden(effect, None if effect in ("tilt", "payload") else 2, {})])
    log = session(truth, HEAVY_PLAN, rate=RATE)
    for run in Bench(truth, HEAVY_PLAN, rate=100.0).runs(np.random.default_rng(0)):
        j, v = run.joint - 1, log["velocity"]
        alone = np.abs(np.delete(v, j, axis=1)).max(axis=1) < (5e-5 if effect == "coupling" else 1e-3)
        steady = (np.abs(v[:, j] / run.speed - 1.0) < 0.02) & alone
        rising = 100.0 * np.diff(v[:, j], append=0.0)
        q, i = log["position"][steady, j], (log["current"][:, j] - INERTIA[j] * rising)[steady]
        order = np.argsort(q)
        wanted = np.interp(run.bins.position[:, j], q[order], i[order])
        near = np.abs(run.bins.position[:, j, None] - q).min(axis=1) < 0.02
        assert np.mean(near) > 0.3
        # The links of a drive that sags gain and lose speed, which the bench does not know.
        close = 0.03 if effect == "flexibility" else 0.015
        assert run.bins.current[near][4:-4] == pytest.approx(wanted[near][4:-4], abs=close)


@pytest.mark.parametrize("effect", sorted(set(LAWS) - {"inertia", "delay"}))
def test_usual_size_shows(effect):
    """Without values an effect stands out of the noise of a sample and is at most a few A."""
    truth = draw(ARM, 3).hiding([Hidden(effect, None if LAWS[effect].is_of_arm else 2)])
    is_slow = "time" in " ".join(truth.hidden[0].values)
    plan = replace(HEAVY_PLAN, motions=HEAVY_PLAN.motions * (110 if is_slow else 12))
    plain, shown = (static(arm, plan, 0.1 if is_slow else 0.01) for arm in (HEAVY, truth.with_noise(0.0)))
    added = (shown["current"] - plain["current"])[:, :2] * (plain["velocity"][:, :2] != 0.0)
    assert 2.0 * truth.noise.std[1] < np.max(np.abs(added)) < 3.0


@pytest.mark.parametrize(
    ("text", "mend"),
    [
        ("stribek", "did you mean stribeck?"),
        ("stribeck@7", "one of waist"),
        ("stribeck@elbo", "did you mean elbow?"),
        ("stribeck:velocty=1", "did you mean velocity?"),
        ("stribeck:a=big", "write a=NUMBER"),
        ("tilt@2", "--hide tilt"),
        ("stribeck@2:velocity=0", "a larger number for velocity"),
        ("coupling@2:on=2", "from 1 to 6"),
        ("", "known here: stribeck"),
    ],
)
def test_wrong_names_are_told(text, mend):
    with pytest.raises(ModelError, match="hide-wrong") as caught:
        parse(text, PUMA.robot)
    assert mend in caught.value.mend


@pytest.mark.parametrize("effect", ["payload", "side_load_friction", "flexibility:c=0.1", "load_friction:drive=0.3"])
def test_what_cannot_be_had_is_told(effect):
    """Masses are not to be had from constants in amperes, nor an effect of a load that is none, whatever its values."""
    with pytest.raises(ModelError, match="hide-wrong"):
        PUMA.hiding([parse(effect if effect == "payload" else effect.replace(":", "@1:"), PUMA.robot)])
