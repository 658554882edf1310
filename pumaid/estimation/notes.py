"""What a user should know of a fit: odd friction, few runs, loads that hide, effects that did not settle."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from pumaid.dataset import Run
from pumaid.effects import Trace
from pumaid.effects.base import load_refusal
from pumaid.errors import Note, Where
from pumaid.estimation.enlarged import Enlarged
from pumaid.estimation.system import Fitted
from pumaid.records import Value
from pumaid.robot import Robot
from pumaid.units import number

#: Share of a joint's load on another's motor below which it is not spoken of.
SMALLEST_PART = 1e-3
#: Sine of the angle between axes up to which they are parallel.
PARALLEL = 1e-6
#: Standard errors beyond which a ratio has a sign.
SURELY = 5.0
#: The same for an inertia below zero.
NEGATIVE = 3.0


def odd_friction(values: Sequence[Value], n_joints: int) -> list[Note]:
    """Viscous terms that are surely of the sign opposite to their joint's Coulomb friction."""
    known = {
        value.name: (value.value, value.std_error, value.ci95, value.unit)
        for value in values
        if value.value is not None and value.std_error is not None and value.ci95 is not None
    }
    notes = []
    for joint, (side, way) in itertools.product(range(1, n_joints + 1), (("plus", "forward"), ("minus", "backward"))):
        if f"viscous.j{joint}.{side}" not in known:
            continue
        slope, error, (low, high), unit = known[f"viscous.j{joint}.{side}"]
        # Friction opposes motion, so the Coulomb terms tell the sign in which the motor counts its current.
        signs = {1.0: f"coulomb.j{joint}.plus", -1.0: f"coulomb.j{joint}.minus"}
        motor = sum(sign * known[name][0] for sign, name in signs.items() if name in known)
        if motor * slope < 0 and not low <= 0.0 <= high:
            text = (
                f"friction of joint {joint} falls with speed going {way} ({number(slope)} ± {number(error, 2)} {unit}),"
                " which viscous friction does not: something else changed with the speed, or Stribeck friction reigns"
            )
            notes.append(Note("friction-falls-with-speed", text, Where(joint=joint)))
    return notes


def odd_inertia(values: Sequence[Value], n_joints: int) -> list[Note]:
    """Inertias that are surely below zero, by the way in which their joint's motor counts its friction."""
    ways, notes = _ways(values, n_joints), []
    for value in values:
        if not value.name.startswith("inertia.j") or value.value is None or not value.std_error:
            continue
        joint = value.joint or 0
        if value.value * ways.get(joint, 0.0) < -NEGATIVE * value.std_error:
            text = (
                f"inertia of joint {joint} comes out below zero ({number(value.value)} ± {number(value.std_error, 2)}"
                f" {value.unit}, and friction says which way is up): its current or position is late or smoothed"
            )
            notes.append(Note("inertia-negative", text, Where(joint=joint)))
    return notes


def _ways(values: Sequence[Value], n_joints: int) -> dict[int, float]:
    """Joint -> 1.0 or -1.0, the sign in which its motor surely counts what opposes motion."""
    known = {value.name: value for value in values if value.ci95 is not None and value.value is not None}
    ways: dict[int, float] = {}
    for joint in range(1, n_joints + 1):
        forth, back = known.get(f"coulomb.j{joint}.plus"), known.get(f"coulomb.j{joint}.minus")
        if forth and back and (forth.ci95[0] > back.ci95[1] or back.ci95[0] > forth.ci95[1]):  # type: ignore[index]
            ways[joint] = math.copysign(1.0, forth.value - back.value)  # type: ignore[operator]
    return ways


def odd_gains(values: Sequence[Value], n_joints: int) -> list[Note]:
    """Gain ratios whose sign is surely not that by which the two motors count their friction."""
    known = {value.name: value for value in values if value.ci95 is not None and value.value is not None}
    ways = _ways(values, n_joints)
    notes = []
    for joint in range(1, n_joints):
        ratio, pair = known.get(f"gain_ratio.{joint}.{joint + 1}"), (ways.get(joint, 0.0), ways.get(joint + 1, 0.0))
        if ratio is None or ratio.std_error is None or not pair[0] * pair[1]:
            continue
        if ratio.value * pair[0] * pair[1] < -SURELY * ratio.std_error:  # type: ignore[operator]
            same = "the same way" if pair[0] == pair[1] else "opposite ways"
            load = f"by the load that joints {joint} and {joint + 1} share, their gains have the ratio"
            text = f"{load} {number(ratio.value or 0.0)}, but by friction the two motors count their currents {same}"
            mend = "a sign in the DH table (alpha, or theta's or d's), of a position or of gravity is not the arm's"
            notes.append(Note("gain-sign", f"{text}: {mend}", Where(joint=joint)))
    return notes


def of_fit(fitted: Fitted, robot: Robot) -> list[Note]:
    """Joints with few runs, and loads that are part of friction."""
    notes = []
    for joint in sorted(fitted.weak):
        runs = len(next(row.runs for row in fitted.rows if row.joint == joint))
        notes.append(
            Note(
                "few-runs",
                f"joint {joint} has {runs} run{'s' if runs > 1 else ''} only: its intervals rest on the noise inside"
                " runs and leave out what a repeated run would differ by",
                Where(joint=joint),
            )
        )
    for joint in fitted.model.structure.embodied:
        notes.append(
            Note(
                "load-in-coulomb",
                f"the constant load of prismatic joint {joint} ({robot.joint(joint).name}) is part of its Coulomb"
                " terms",
                Where(joint=joint),
            )
        )
    return notes


def of_gears(fitted: Fitted, robot: Robot) -> list[Note]:
    """Loads that the recipe's gears (`coupling`) pass to motors of other joints, where the model leaves them out."""
    if not robot.coupling:
        return []
    # Power is the same on either side: what motors carry of the joints' loads, by joint and motor.
    share = np.linalg.inv(robot.shaft_speeds)
    fitted_ones = {(one.choice.joint, one.choice.shape.get("on")) for one in fitted.model.effects}
    told, parallel = [], []
    for joint, motor in itertools.product(range(1, robot.n_joints + 1), sorted(row.joint for row in fitted.rows)):
        part = float(share[joint - 1, motor - 1])
        if joint <= motor or abs(part) < SMALLEST_PART or load_refusal(robot, joint) is not None:
            continue
        if (joint, float(motor)) in fitted_ones:
            continue
        told.append(
            f"motor {motor} carries {number(part, 2)} of joint {joint}'s load (--add coupling@{joint}:on={motor})"
        )
        if joint == motor + 1 and abs(math.sin(robot.joint(joint).alpha)) < PARALLEL:
            parallel.append(
                f"axes {motor} and {joint} are parallel, so no log tells this from gain_ratio.{motor}.{joint}, of which"
                f" what is found is {number(1.0 + part, 3)} times the ratio of the motors' gains"
            )
    if not told:
        return []
    text = (
        f"by the recipe's gears (coupling) {'; '.join(told)}; this model leaves that out, gravity and ratios take it up"
    )
    return [Note("load-through-gears", "; ".join([text, *parallel]), Where())]


def of_effects(found: Enlarged, runs: Sequence[Run]) -> list[Note]:
    """Effects that did not settle, shapes at a bound, and effects of time over several recordings."""
    notes, effects = [], found.fitted.model.effects
    if not found.is_settled:
        names = ", ".join(dict.fromkeys(one.effect.name for one in effects))
        text = f"the fit with {names} still moved when it was stopped: two of its effects may stand for one another"
        notes.append(Note("effects-not-settled", text, Where()))
    for one, shape in ((effect, name) for effect in effects for name in effect.held):
        text = f"{shape} of {one.effect.name} is best at its bound, {number(one.choice.shape[shape])}"
        notes.append(
            Note("shape-at-bound", f"{text}: these data do not show where it is", Where(joint=one.choice.joint))
        )
    timed = [one.effect.name for one in effects if Trace.TIME in one.effect.trace]
    clocks = len({run.clock for run in runs})
    if timed and clocks > 1:
        text = f"the logs have {clocks} clocks: {timed[0]} counts its time anew in each"
        notes.append(Note("several-clocks", text, Where()))
    return notes
