"""The formula of each effect that a posture and velocities determine, and why each of the others is left out.

In a formula stand the effect's parameters and shapes by their own names, and of the joint that is looked at

- ``q`` its measured position, ``v`` the speed that drives its friction, ``s`` +1 while it moves forward, else -1;
- ``load`` gravity's current in it by the paper's model, ``load_m`` that of joint m in its own motor;
- ``drawn`` the paper's model as a whole: gravity, Coulomb and viscous friction;
- ``slope_m`` the derivative of ``load`` by joint m's position, ``tilt_x`` and ``tilt_y`` by a turn of the base;
- ``across`` gravity's moment across its axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pumaid.chosen import Chosen
from pumaid.robot import Robot


@dataclass(frozen=True, slots=True)
class Law:
    """What an effect adds to one joint's current: at any speed (`hold`) and against the motion (`friction`)."""

    hold: str = ""
    friction: str = ""


def _same(hold: str = "", friction: str = "") -> Callable[[Robot, Chosen, int], Law]:
    """A law of the owner's own joint."""
    return lambda robot, one, joint: Law(hold, friction)


def _tilt(robot: Robot, one: Chosen, joint: int) -> Law:
    """Upright joints feel the tilt by the gain that is the effect's shape, and their own link besides."""
    names = [parameter.name for parameter in one.effect.parameters(robot, 0)]
    felt = "x * tilt_x + y * tilt_y"
    if f"cos{joint}" not in names:
        return Law(felt)
    return Law(f"waist * ({felt}) + cos{joint} * cos(q) + sin{joint} * sin(q)")


def _zero_offset(robot: Robot, one: Chosen, joint: int) -> Law:
    return Law(f"delta * slope_{one.number}")


def _flexibility(robot: Robot, one: Chosen, joint: int) -> Law:
    return Law(f"-c * slope_{one.number} * load_{one.number}")


def _coupling(robot: Robot, one: Chosen, joint: int) -> Law:
    is_there = joint == int(one.choice.shape["on"]) and joint != one.number
    return Law(f"c * load_{one.number}" if is_there else "")


LAWS: dict[str, Callable[[Robot, Chosen, int], Law]] = {
    "spring": _same("a * q"),
    "counterbalance": _same("a * sin(q - angle) / sqrt(1.0 + length * length - 2.0 * length * cos(q - angle))"),
    "ripple": _same("cos * cos(frequency * q) + sin * sin(frequency * q)"),
    "tilt": _tilt,
    "zero_offset": _zero_offset,
    "flexibility": _flexibility,
    "coupling": _coupling,
    "stribeck": _same(friction="s * a * exp(-(abs(v) / velocity) ** exponent)"),
    "viscous_power": _same(friction="s * b * abs(v) ** exponent"),
    "position_friction": _same(friction="s * (cos * cos(harmonic * q) + sin * sin(harmonic * q))"),
    "load_friction": _same(friction="s * (drive * max(s * load, 0.0) + back * max(-s * load, 0.0))"),
    "side_load_friction": _same(friction="s * mu * across"),
    # What the load alone costs is asked at rest as well; friction is what the motion adds to it.
    "torque_droop": _same("a * load ** 3", "a * (drawn ** 3 - load ** 3)"),
}

#: Effect -> why no formula of posture and velocity has it, and for which state of the arm the rest then holds.
LEFT_OUT = {
    "warmup": "it fades with time: what is written is the warm joint",
    "friction_step": "it came at one instant: what is written is the friction before it",
    "payload": "it came at one instant: what is written is the arm without it",
    "torque_constant_drift": "it grows with time: what is written is the cold motor",
    "thermal_friction": "it follows a measured temperature: what is written is the joint at 25 degC",
    "presliding": "it depends on the travel since the motion began: what is written is friction after it",
    "inertia": "it needs the acceleration, and is known only where the other joints were held",
    "saturation": "the drive, or the sensor, clips by itself: what is written is the current that the motion needs",
    "delay": "it is of the log's clocks, not of the arm",
}


def laws_of(robot: Robot, one: Chosen) -> Iterator[tuple[int, Law]]:
    """(joint, law) of each joint on which an effect acts; none where it has no formula.

    Parameters
    ----------
    robot
        The arm.
    one
        The effect, with all its shapes.
    """
    if one.effect.name not in LAWS:
        return
    for joint in range(1, robot.n_joints + 1):
        law = LAWS[one.effect.name](robot, one, joint) if one.touches(joint) else Law()
        if law != Law():
            yield joint, law


def why_left_out(one: Chosen) -> str | None:
    """Why an effect is left out, or None where it has a formula."""
    if one.effect.name in LAWS:
        return None
    return LEFT_OUT.get(one.effect.name, "it is an effect of your own, of which no formula is known here")
