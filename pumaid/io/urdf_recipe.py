"""A recipe from a URDF: modified DH parameters are derived, written as text, read back and checked against the URDF."""

from __future__ import annotations

import math
import re
import shlex
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from pumaid.errors import Note, RecipeError, Where
from pumaid.io.forms import yaml_text
from pumaid.io.recipe import RECIPE_NAME, read_recipe, remarked
from pumaid.io.recipe_schema import (
    FASTEST,
    FASTEST_RAIL,
    LONGEST_LINK,
    LONGEST_RAIL,
    SLOWEST,
    WIDEST,
    ArmForm,
    JointForm,
)
from pumaid.io.urdf import ArmChain, UrdfFile, UrdfJoint, arm_chain, read_urdf
from pumaid.kinematics import DhChain, SerialChain, axes, modified_dh, origins, placement, straightened
from pumaid.robot import Joint, Robot
from pumaid.units import factor, number

Floats = NDArray[np.float64]

#: How well the written recipe must agree with the URDF (rad and m).
TOLERANCE = 1e-8
#: Random postures that are compared; joints that slide go this far each way (m), joints that turn half a turn.
POSTURES, SLIDE = 200, 1.0
FREE_FALL = 9.80665
#: Most names that a note lists.
LISTED = 6
#: Decimals of lengths and angles, and how near to a multiple of 15 deg (rad) an angle is written as one: the first pair
#: takes away the rounding of a URDF that is written with nine decimals, the second only round-off.
ROUNDINGS = ((9, 2.5e-9), (14, 1e-12))
_STEP = math.pi / 12.0
_GRIPPER = re.compile(r"grip|finger|jaw|claw|thumb", re.IGNORECASE)

_BODY = """\
# Frames: modified Denavit-Hartenberg parameters derived from the axes of the URDF. Every z points as the URDF's axis
# does, so positions, zeros and limits are the URDF's own.
# The base (frame 0) is {base}.
# Gravity pulls along -z of the URDF's root link; where that does not stand upright, put another vector here.
# {agrees} axes agree with the URDF's within {tolerance:g} rad and m in {postures} random postures.
name: {name}
source: {source}
units: {{angle: rad}}
gravity: [{gravity}]        # m/s2, in axes of this base
joints:
{joints}"""


class Agreement(NamedTuple):
    """Farthest that any axis is off in any posture: in direction (rad), and in place (m, across the axis)."""

    direction: float
    place: float


@dataclass(frozen=True, slots=True)
class UrdfRecipe:
    """A recipe made from a URDF, as text and as the robot that is read back from it.

    `base` is the (4, 4) recipe's frame 0 in the URDF's link `chain.base` (m), `agreement` that with the URDF as it is
    written; `notes` tell what the URDF lacks, and what was left out.
    """

    text: str
    robot: Robot
    urdf: UrdfFile
    chain: ArmChain
    base: Floats
    agreement: Agreement
    notes: tuple[Note, ...]


def recipe_from_urdf(path: Path, *, base: str | None = None, tip: str | None = None) -> UrdfRecipe:
    """Make a recipe from a URDF (``-`` is standard input) of the arm between two links (found where not given).

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused, urdf-which-chain]
        The file cannot be used, or it is not clear which joints are the arm.
    RecipeError [urdf-not-derived]
        No recipe agrees with the URDF's axes.
    """
    urdf = read_urdf(path)
    chain = arm_chain(urdf, base=base, tip=tip)
    joints, notes = _joints(chain)
    stated, down = geometry(chain)
    usable, bent = straightened(stated)
    dh = modified_dh(usable)
    for joint, a, d in zip(joints, dh.a, dh.d, strict=True):
        if max(abs(a), abs(d)) > LONGEST_LINK:
            what = f"joint {joint.name} needs a of {a:.4g} m and d of {d:.4g} m, beyond {LONGEST_LINK:g} m"
            mend = "a URDF is in metres; where axes are nearly parallel, write them as parallel"
            raise RecipeError("urdf-not-derived", what, Where(file=urdf.file, joint=joint.number), mend)
    gravity = dh.base[:3, :3].T @ down * FREE_FALL
    head = _head(urdf, chain, dh, is_bent=bool(bent))
    for decimals, snap in ROUNDINGS:
        text = _text(head, dh, joints, gravity=gravity, rounding=(decimals, snap))
        robot = _read_back(text)
        off = agreement(robot, usable, dh.base)
        if max(off) <= TOLERANCE and np.linalg.norm(np.array(robot.gravity) - gravity) <= TOLERANCE * FREE_FALL:
            break
    else:
        what = f"the recipe's axes differ from the URDF's by {off.direction:.1e} rad and {off.place:.1e} m"
        raise RecipeError("urdf-not-derived", what, Where(file=urdf.file), "please report it, with the URDF")
    off = agreement(robot, stated, dh.base)
    if max(off) > TOLERANCE:
        notes.append(_note_on_bent(chain, bent, off))
    return UrdfRecipe(text, robot, urdf, chain, dh.base, off, (*_notes_on_chain(chain), *notes))


def geometry(chain: ArmChain) -> tuple[SerialChain, Floats]:
    """The moving joints' frames and axes, fixed joints folded in, and which way is down in the base (unit vector)."""
    frames, frame = [], np.eye(4)
    for joint in chain.path:
        frame = frame @ placement(*joint.origin)
        if joint.moves:
            frames.append(frame)
            frame = np.eye(4)
    base = np.eye(4)
    for joint in chain.before:
        base = base @ placement(*joint.origin)
    directions = np.array([joint.axis for joint in chain.moving])
    slides = np.array([joint.kind == "prismatic" for joint in chain.moving])
    return SerialChain(np.array(frames), directions, slides), -base[2, :3]


def agreement(robot: Robot, chain: SerialChain, base: Floats) -> Agreement:
    """Compare a recipe's axes, as lines in space, with homogeneous transforms straight from a URDF's elements.

    `base` is the (4, 4) recipe's frame 0 in the chain's base (m).
    """
    spans = np.where(robot.is_revolute, np.pi, SLIDE)
    generator = np.random.default_rng(0)
    positions = generator.uniform(-spans, spans, (POSTURES, robot.n_joints))
    positions[0] = 0.0
    angles, shifts = robot.dh_angles(positions), robot.dh_displacements(positions)
    directions = axes(robot.alphas, angles)[..., 2] @ base[:3, :3].T
    points = origins(robot.alphas, robot.lengths, offsets=shifts, thetas=angles) @ base[:3, :3].T + base[:3, 3]
    wanted, wanted_points = chain.lines(positions)
    differences = directions - wanted, np.cross(points - wanted_points, wanted)
    return Agreement(*(float(np.linalg.norm(vectors, axis=-1).max()) for vectors in differences))


def _read_back(text: str) -> Robot:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / RECIPE_NAME
        path.write_text(text, encoding="utf-8")
        return read_recipe(path)


def _joints(chain: ArmChain) -> tuple[list[Joint], list[Note]]:
    """Names, kinds, limits and speeds of the arm's joints, and notes on those that are missing or unusable."""
    joints: list[Joint] = []
    notes = []
    for count, stated in enumerate(chain.moving, start=1):
        name = _name(stated.name, count, [joint.name.lower() for joint in joints])
        if name != stated.name:
            text = f"no recipe can name a joint {stated.name!r}; it is called {name}"
            notes.append(Note("urdf-incomplete", text, Where(joint=count)))
        kind = "prismatic" if stated.kind == "prismatic" else "revolute"
        farthest, slowest, fastest = (
            (LONGEST_RAIL, 1e-9, FASTEST_RAIL) if kind == "prismatic" else (WIDEST, SLOWEST, FASTEST)
        )
        low, high, speed = (stated.limit(word) for word in ("lower", "upper", "velocity"))
        limits = None
        if stated.kind != "continuous" and low is not None and high is not None and -farthest <= low < high <= farthest:
            limits = low, high
        speed = speed if speed is not None and slowest <= speed <= fastest else None
        joints.append(Joint(count, name, kind, limits=limits, max_velocity=speed))
    lacking = {
        "limits": [
            joint.name
            for joint, stated in zip(joints, chain.moving, strict=True)
            if joint.limits is None and stated.kind != "continuous"
        ],
        "highest speed": [joint.name for joint in joints if joint.max_velocity is None],
    }
    for what, names in lacking.items():
        if names:
            text = f"the URDF states no usable {what} of {_listed(names)}: put the arm's own into the recipe"
            notes.append(Note("urdf-incomplete", text))
    return joints, notes


def _name(name: str, count: int, taken: Sequence[str]) -> str:
    """The URDF's name where a recipe can hold it."""
    data = {"type": "revolute", "alpha": 0.0, "a": 0.0, "d": 0.0, "name": name}
    try:
        JointForm.model_validate(data, context=ArmForm((), frozenset(), "rad", True))
    except ValidationError:
        name = f"joint{count}"
    while name.lower() in taken:
        name += "_"
    return name


def _notes_on_chain(chain: ArmChain) -> list[Note]:
    """Which joints were not taken, and whether the last one should have been."""
    notes = []
    if chain.carried:
        text = (
            f"left out, and carried by the arm: {_counted(chain.carried)}; hold them still, their weight is the arm's"
        )
        notes.append(Note("urdf-left-out", text))
    if chain.elsewhere:
        text = f"left out, and not carried by the arm: {_counted(chain.elsewhere)}"
        notes.append(Note("urdf-left-out", text))
    last = chain.moving[-1]
    if len(chain.moving) > 1 and _GRIPPER.search(f"{last.name} {last.child}"):
        text = f"the last joint, {last.name}, may be a gripper's: leave it out with --tip {shlex.quote(last.parent)}"
        notes.append(Note("urdf-left-out", text))
    moving = [joint for joint in chain.before if joint.moves]
    if moving:
        notes.append(Note("urdf-base-moves", f"gravity is given for {_counted(moving)} before the base at zero"))
    return notes


def _note_on_bent(chain: ArmChain, bent: dict[int, float], off: Agreement) -> Note:
    degree = factor("deg")
    turned = [f"{chain.moving[joint - 1].name} by {number(angle / degree, 2)} deg" for joint, angle in bent.items()]
    text = (
        f"nearly parallel axes were made parallel, for their common normal lies anywhere: {', '.join(turned)}; no axis"
        f" is off by more than {number(off.direction / degree, 2)} deg and {number(off.place * 1e3, 2)} mm"
    )
    return Note("urdf-made-parallel", text)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def _counted(joints: Sequence[UrdfJoint]) -> str:
    return f"{len(joints)} moving joint{'s' * (len(joints) > 1)} ({_listed([joint.name for joint in joints])})"


def _head(urdf: UrdfFile, chain: ArmChain, dh: DhChain, *, is_bent: bool) -> dict[str, str]:
    """The recipe's texts about where it is from."""
    file, base, tip = (
        "".join(letter if letter.isprintable() else "?" for letter in text)
        for text in (Path(urdf.file).name, chain.base, chain.tip)
    )
    given = "-" if file == "standard input" else file
    x, z, place = (", ".join(_decimal(value, 7) for value in dh.base[:3, column]) for column in (0, 2, 3))
    return {
        "origin": shlex.join(["pumaid", "init", "--urdf", given, "--base", base, "--tip", tip]),
        "base": f"in link {base} at ({place}) m, its x along ({x}) and z along ({z})",
        "agrees": "Nearly parallel axes were made parallel; then all" if is_bent else "All",
        "name": yaml_text(urdf.name[:200] if urdf.name.strip() and urdf.name.isprintable() else "arm"),
        "source": yaml_text(f"URDF {file}, links {base} to {tip}; SHA-256 {urdf.digest}"),
    }


def _text(
    head: dict[str, str], dh: DhChain, joints: Sequence[Joint], *, gravity: Floats, rounding: tuple[int, float]
) -> str:
    """The whole recipe with remarks; of `joints` names, kinds, limits and speeds are used."""
    decimals, snap = rounding
    lines = []
    for joint, theta, alpha, a, d in zip(joints, dh.theta, dh.alpha, dh.a, dh.d, strict=True):
        words = {
            "name": yaml_text(joint.name),
            "type": joint.kind,
            "theta": _angle(theta, decimals, snap),
            "alpha": _angle(alpha, decimals, snap),
            "a": _decimal(a, decimals),
            "d": _decimal(d, decimals),
        }
        if joint.limits is not None:
            words["limits"] = f"[{', '.join(_decimal(value, 12) for value in joint.limits)}]"
        if joint.max_velocity is not None:
            words["max_velocity"] = _decimal(joint.max_velocity, 12)
        lines.append(f"  - {{{', '.join(f'{key}: {word}' for key, word in words.items())}}}\n")
    down = ", ".join(_decimal(value, decimals - 2) for value in gravity)
    body = _BODY.format(gravity=down, joints="".join(lines), tolerance=TOLERANCE, postures=POSTURES, **head)
    return remarked(body, len(joints), origin=head["origin"])


def _decimal(value: float, decimals: int) -> str:
    """A bare number without exponent and trailing zeros."""
    return np.format_float_positional(round(value, decimals) + 0.0, trim="0")


def _angle(value: float, decimals: int, snap: float) -> str:
    """Radians: ``-pi/2`` and the like where they are as near as `snap`, else a bare number."""
    steps = round(value / _STEP)
    if abs(value - steps * _STEP) > snap:
        return _decimal(value, decimals)
    part = Fraction(12 if steps == -12 else steps, 12)
    times = {1: "", -1: "-"}.get(part.numerator, f"{part.numerator}*")
    return "0" if steps == 0 else f"{times}pi" + (f"/{part.denominator}" if part.denominator > 1 else "")
