"""What a recipe takes over from each of a URDF's joints, and notes on what the URDF lacks or the recipe leaves out."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from shlex import quote

from pydantic import ValidationError

from pumaid.errors import Note, Where
from pumaid.io.recipe_schema import FASTEST, FASTEST_RAIL, LONGEST_RAIL, SLOWEST, WIDEST, Arm, JointForm
from pumaid.io.urdf import UrdfJoint
from pumaid.io.urdf_chain import ArmChain
from pumaid.robot import Joint

#: Names that a note tells, at most.
SHOWN = 6
_GRIPPER = re.compile(r"grip|finger|jaw|claw|thumb", re.IGNORECASE)


def joints_of(chain: ArmChain) -> tuple[list[Joint], list[Note]]:
    """Names, kinds, limits and speeds of the arm's joints, and notes on those that are missing or unusable."""
    found: list[Joint] = []
    notes: list[Note] = []
    unlimited, unhurried = [], []
    for number, stated in enumerate(chain.moving, start=1):
        name = _name(stated, number, [joint.name for joint in found])
        if name != stated.name:
            text = f"no recipe can name a joint {stated.name!r}; it is called {name}"
            notes.append(Note("urdf-renamed", text, Where(joint=number)))
        kind = "prismatic" if stated.kind == "prismatic" else "revolute"
        joint = Joint(number, name, kind, limits=_limits(stated), max_velocity=_speed(stated))
        if joint.limits is None and stated.kind != "continuous":
            unlimited.append(name)
        if joint.max_velocity is None:
            unhurried.append(name)
        found.append(joint)
    if unlimited:
        text = f"the URDF states no usable limits of {named(unlimited)}: put the arm's own into the recipe"
        notes.append(Note("urdf-no-limits", text))
    if unhurried:
        text = f"the URDF states no usable highest speed of {named(unhurried)}: put the arm's own into the recipe"
        notes.append(Note("urdf-no-speed", text))
    return found, notes


def notes_on_chain(chain: ArmChain) -> list[Note]:
    """Notes on which joints were taken."""
    found = []
    carried = [*chain.end, *chain.beside]
    if carried:
        text = f"left out, and carried by the arm: {_counted(carried)}; hold them still, their weight is the arm's"
        found.append(("urdf-carried", text))
    if chain.elsewhere:
        found.append(("urdf-elsewhere", f"left out, and not carried by the arm: {_counted(chain.elsewhere)}"))
    last = chain.moving[-1]
    if len(chain.moving) > 1 and _GRIPPER.search(f"{last.name} {last.child}"):
        text = f"the last joint, {last.name}, may be a gripper's: leave it out with --tip {quote(last.parent)}"
        found.append(("urdf-gripper", text))
    moving = [joint for joint in chain.before if joint.moves]
    if moving:
        text = f"gravity is given for {_counted(moving)} before the base at zero"
        found.append(("urdf-base-moves", text))
    return [Note(slug, text) for slug, text in found]


def named(names: Sequence[str]) -> str:
    """Some names, and how many more there are."""
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(names[:SHOWN]) + more


def _counted(joints: Sequence[UrdfJoint]) -> str:
    return f"{len(joints)} moving joint{'s' * (len(joints) > 1)} ({named([joint.name for joint in joints])})"


def _name(joint: UrdfJoint, number: int, taken: Sequence[str]) -> str:
    """The URDF's name where a recipe can hold it."""
    try:
        data = {"type": "revolute", "alpha": 0.0, "a": 0.0, "name": joint.name}
        JointForm.model_validate(data, context=Arm((), frozenset(), "rad", True))
        name = joint.name
    except ValidationError:
        name = f"joint{number}"
    known = {other.lower() for other in taken}
    while name.lower() in known:
        name += "_"
    return name


def _limits(joint: UrdfJoint) -> tuple[float, float] | None:
    low, high, _ = joint.limits
    farthest = LONGEST_RAIL if joint.kind == "prismatic" else WIDEST
    if joint.kind == "continuous" or low is None or high is None or not low < high:
        return None
    return (low, high) if max(abs(low), abs(high)) <= farthest else None


def _speed(joint: UrdfJoint) -> float | None:
    speed = joint.limits[2]
    slowest, fastest = (0.0, FASTEST_RAIL) if joint.kind == "prismatic" else (SLOWEST, FASTEST)
    return speed if speed is not None and slowest < speed <= fastest and math.isfinite(speed) else None
