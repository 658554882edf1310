"""Runs that would decide, in plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.diagnosis.candidates import Suspect
from pumaid.diagnosis.design import ages
from pumaid.diagnosis.feasible import Lap
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Trace
from pumaid.robot import Robot
from pumaid.units import deviations, factor, number

#: What could still tell effects apart that no run within the limits does, by the residual that shows them both.
WAYS_OUT = {
    Trace.LOAD: "another payload would change the load without the position",
    Trace.POSITION: "a wider span would, or a tool that changes the load",
    Trace.SPEED: "speeds beyond the recipe's limits might, or a measurement without the gear",
    Trace.TIME: "a thermometer at the motor might, in a column of the logs, or a rest until the arm is cold",
    Trace.DIRECTION: "another payload or a wider span might",
}

#: Two gaps within this factor are told as the smaller.
ALIKE = 1.3


def decided(
    robot: Robot,
    made: Mapping[Lap, int],
    effects: Sequence[EffectTerm],
    *,
    apart: tuple[float, float],
    age: tuple[float, float],
) -> str:
    """The runs that decide between two effects, and by how many standard deviations if the one or the other is true."""
    text = f"{_runs(robot, made, age, effects)}: {_pair(effects)} would then differ by"
    if max(apart) < ALIKE * min(apart):
        return f"{text} {deviations(min(apart))} standard deviations"
    first, second = (
        f"{deviations(gap)} {{}}if it is {_name(one, effects)}" for gap, one in zip(apart, effects, strict=True)
    )
    return f"{text} {first.format('standard deviations ')}, by {second.format('')}"


def shown(robot: Robot, made: Mapping[Lap, int], added: EffectTerm, *, apart: float, age: tuple[float, float]) -> str:
    """The runs that show one effect, and by how many standard deviations."""
    return (
        f"{_runs(robot, made, age, [added])}: {_name(added, ())} would show by {deviations(apart)} standard deviations"
    )


def because(effects: Sequence[EffectTerm]) -> str:
    """Why no run decides, and what would."""
    suspect = next((one.effect for one in effects if isinstance(one.effect, Suspect)), None)
    if suspect is not None:
        return f"change {suspect.column} on purpose while all else is repeated: no plan of motions can"
    shared = [trace for trace in WAYS_OUT if all(trace in one.effect.trace for one in effects)]
    out = WAYS_OUT[shared[0]] if shared else "another payload or a wider span might"
    return f"no run within the limits tells {_pair(effects)} apart; {out}"


def _pair(effects: Sequence[EffectTerm]) -> str:
    return " and ".join(_name(one, effects) for one in effects)


def _name(added: EffectTerm, effects: Sequence[EffectTerm]) -> str:
    """With its joint where the other's is another."""
    where = "" if len({one.joint for one in effects}) < 2 else f" at joint {added.joint}"
    return added.effect.name + ("" if where and added.joint is None else where)


def _runs(robot: Robot, made: Mapping[Lap, int], age: tuple[float, float], effects: Sequence[EffectTerm]) -> str:
    parts = []
    for joint, hold in dict.fromkeys((lap.joint, lap.hold) for lap in made):
        own = [lap for lap in made if (lap.joint, lap.hold) == (joint, hold)]
        own.sort(key=lambda lap: lap.speed)
        speeds = " and ".join(_speed(robot, lap, made[lap]) for lap in own)
        place = _place(robot, own[0])
        parts.append(f"joint {joint} both ways at {speeds}{place}")
    return _when(age, effects) + "run " + ", then ".join(parts)


def _when(age: tuple[float, float], effects: Sequence[EffectTerm]) -> str:
    if not any(ages(one) for one in effects):
        return ""
    if age[0] == 0.0:
        return "let the arm cool, then as the first runs of a new recording "
    return f"after {number(age[1] / 60.0, 2)} minutes of motion in one recording "


def _speed(robot: Robot, lap: Lap, count: int) -> str:
    unit, scale = _unit(robot, lap.joint)
    ends = " to ".join(f"{round(end / scale, 3) + 0.0:.4g}" for end in (lap.low, lap.high))
    times = {1: "", 2: ", twice"}.get(count, f", {count} times")
    return f"{number(lap.speed / scale, 2)} {unit}/s ({ends} {unit}{times})"


def _place(robot: Robot, lap: Lap) -> str:
    """Where the other joints are held."""
    if robot.n_joints == 1:
        return ""
    places = []
    for joint, position in zip(robot.joints, lap.hold, strict=True):
        unit, scale = _unit(robot, joint.number)
        places.append("-" if joint.number == lap.joint else f"{round(position / scale, 1) + 0.0:g} {unit}")
    new = "a new posture, see that its way is free" if lap.is_new else "a posture of the runs so far"
    return f" with the joints at [{', '.join(places)}], {new}"


def _unit(robot: Robot, joint: int) -> tuple[str, float]:
    return ("deg", factor("deg")) if robot.joint(joint).is_revolute else ("m", 1.0)
