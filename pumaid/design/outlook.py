"""What runs promise on a robot of which enough is assumed, and what they leave in the dark."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pumaid.design.assume import Assumed
from pumaid.errors import Note, Where
from pumaid.preprocessing.options import DEFAULTS
from pumaid.records import Motion
from pumaid.robot import Robot
from pumaid.simulation.forecast import forecast, gravity_names
from pumaid.simulation.ranges import span
from pumaid.structure import Structure
from pumaid.trajectory import highest_speeds
from pumaid.units import factor, number

#: Samples a second that forecasts assume.
RATE = 100.0
#: A standard error above this share of a ratio leaves it in the dark.
WEAK = 0.5
#: m off its axis at which a payload is suggested.
_LEVER = 0.1
#: kg m that a suggested payload has at least: what is easily screwed on.
_LEAST = 0.02


def existing(robot: Robot, structure: Structure) -> list[str]:
    """Gravity parameters and ratios that the arm has."""
    redundant = {f"gain_ratio.{i}.{j}" for i, j in structure.redundant}
    return [name for name in gravity_names(robot) if name not in structure.absent and name not in redundant]


def absent(structure: Structure) -> dict[str, str]:
    """Name -> why no run on this arm shows it."""
    return {
        **structure.absent,
        **{f"gain_ratio.{i}.{j}": why for (i, j), why in structure.redundant.items()},
    }


def expected(assumed: Assumed, motions: Sequence[Motion], names: Sequence[str]) -> dict[str, float]:
    """Predicted standard errors, the median over the assumed robots; a parameter that any of them hides is out.

    Parameters
    ----------
    assumed
        Robots.
    motions
        Runs; those for judging promise nothing.
    names
        Gravity parameters and ratios that the arm has.
    """
    each = [forecast(truth, motions, names=names, rate=RATE).std_errors() for truth in assumed.truths]
    return {name: float(np.median([found[name] for found in each])) for name in each[0] if all(name in e for e in each)}


def weight_note(assumed: Assumed, promised: dict[str, float]) -> tuple[Note, ...]:
    """How much weight the last link must have off its axis for the last ratio to be seen, and a payload that has it.

    Parameters
    ----------
    assumed
        Robots.
    promised
        Predicted standard errors by name.
    """
    robot = assumed.truths[0].robot
    n = robot.n_joints
    name = f"gain_ratio.{n - 1}.{n}"
    if name not in promised or not robot.joint(n).is_revolute:
        return ()
    needed = []
    for truth in assumed.truths:
        known = truth.constants
        off_axis = float(np.hypot(known.x[-1], known.y[-1]))
        if truth.links is not None:
            off_axis = float(truth.links.mass[-1] * np.linalg.norm(truth.links.centre[-1, :2]))
        needed.append(off_axis * promised[name] / (WEAK * abs(truth.parameters()[name])))
    least = float(np.median(needed))
    if assumed.truths[0].links is None:
        share = promised[name] / abs(assumed.truths[0].parameters()[name])
        if share < WEAK:
            return ()
        text = (
            f"{name} stays in the dark with the weight that this arm has: its predicted error is"
            f" {number(share, 2)} times its value. {_payload_hint(n)}"
        )
        return (Note("plan-needs-weight", text, Where(joint=n)),)
    mass = number(max(least, _LEAST) / _LEVER, 2)
    text = (
        f"{name} is seen only if link {n} carries enough off its axis: about {number(least, 2)} kg m (mass times"
        f" distance) for an error of half its value; a bare flange often has less, and a payload mends it: --payload"
        f" {mass},{_LEVER:g},0,0 plans for {mass} kg held {1000 * _LEVER:g} mm off the axis of joint {n}"
    )
    return (Note("plan-needs-weight", text, Where(joint=n)),)


def _payload_hint(n: int) -> str:
    return (
        f"A payload shows it: plan with --payload 0.5,{_LEVER:g},0,0 (half a kilogram {1000 * _LEVER:g} mm off the axis"
        f" of joint {n}); joint {n - 1} must then run with joint {n} at two positions a quarter turn apart"
    )


def tilt_note(robot: Robot, structure: Structure) -> tuple[Note, ...]:
    """That a tilted base would show what an upright one hides, where it would.

    Parameters
    ----------
    robot
        The arm as it stands.
    structure
        What it has.
    """
    first = next((joint for joint in robot.joints if joint.is_revolute), None)
    hidden = [name for name in absent(structure) if first is not None and f".l{first.number}." in name]
    if first is None or not hidden or not np.any(robot.gravity):
        return ()
    ratios = [name for name in absent(structure) if name.startswith("gain_ratio")]
    both = ", ".join([*hidden, *ratios])
    text = (
        f"{both} cannot be seen while joint {first.number} ({first.name}) turns about the vertical. With the base"
        " tilted they can: --tilt 10,0 plans for 10 deg about the base's x axis"
    )
    return (Note("plan-needs-tilt", text, Where(joint=first.number)),)


def short_note(robot: Robot, motions: Sequence[Motion]) -> tuple[Note, ...]:
    """Which runs are so short, or so slow, that no log of them is taken for a run; one note a joint.

    Parameters
    ----------
    robot, motions
        The arm and its runs.
    """
    out = []
    for joint in robot.joints:
        numbers = [k for k, m in enumerate(motions, start=1) if m.joint == joint.number and _is_lost(m)]
        if not numbers:
            continue
        unit = "rad" if joint.is_revolute else "m"
        count = f"{len(numbers)} run" + ("s" if len(numbers) > 1 else "")
        text = (
            f"{count} of joint {joint.number} ({joint.name}) will not be found in the logs: a run must go over"
            f" {DEFAULTS.min_travel:g} {unit} or more, faster than {DEFAULTS.rest_speed:g} {unit}/s; the first is run"
            f" {numbers[0]}. Give it more room (its limits in the recipe) or speed"
        )
        out.append(Note("plan-unusable", text, Where(joint=joint.number, field=f"runs[{numbers[0]}]")))
    return tuple(out)


def _is_lost(motion: Motion) -> bool:
    return abs(motion.end - motion.start) < DEFAULTS.min_travel or motion.velocity <= DEFAULTS.rest_speed


def conditions(robot: Robot) -> tuple[str, ...]:
    """What the forecast takes for granted of limits, speeds and surroundings."""
    told = [f"{RATE:g} samples a second; ramps reach the highest speed in 0.4 s."]
    if robot.safety is None:
        told.append(
            "The recipe states no boxes and no spheres (block safety): collisions are not checked. Look at each posture"
            " before it is run."
        )
    for joint in robot.joints:
        unit = "deg" if joint.is_revolute else "m"
        if joint.limits is None:
            low, high = (end / factor(unit) for end in span(joint))
            told.append(f"Joint {joint.number} ({joint.name}) states no limits: {low:.4g}..{high:.4g} {unit} taken.")
        if joint.max_velocity is None:
            most = highest_speeds(robot)[joint.number - 1] / factor(unit)
            told.append(f"Joint {joint.number} ({joint.name}) states no max_velocity: {most:.3g} {unit}/s taken.")
    return tuple(told)
