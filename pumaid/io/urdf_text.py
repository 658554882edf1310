"""The text of a recipe that was made from a URDF."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from pumaid.io.recipe_template import remarked
from pumaid.maths.dh import DhChain
from pumaid.robot import Joint
from pumaid.units import factor, number

_STEP = math.pi / 12.0
#: Turns (rad) and shifts (m) of the base below this are rounding and are not told.
SEEN = 1e-7
#: Words of which YAML makes something else than text.
_YAML_WORDS = ("true", "false", "null", "yes", "no", "on", "off", "y", "n")

_BODY = """\
# Frames: modified Denavit-Hartenberg parameters derived from the axes of the URDF. Every z points as the URDF's axis
# does, so positions, zeros and limits are the URDF's own.
# The base is {base}.
# Gravity pulls along -z of the URDF's root link; where that does not stand upright, put another vector here.
# {agrees}
name: {name}
source: {source}
units: {{angle: rad}}
gravity: [{gravity}]        # m/s2, in axes of this base
joints:
{joints}"""


@dataclass(frozen=True, slots=True)
class Rounding:
    """How numbers are written: `decimals` of lengths and angles, and how near (rad) to a multiple of 15 deg an angle
    lies to be written as one."""

    decimals: int
    snap: float

    def length(self, value: float) -> str:
        """A bare number without exponent and trailing zeros."""
        text = f"{value:.{self.decimals}f}".rstrip("0")
        text += "0" if text.endswith(".") else ""
        return "0.0" if float(text) == 0.0 else text

    def gravity(self, value: float) -> str:
        """m/s2 of which a direction follows as well as from angles."""
        return Rounding(self.decimals - 2, self.snap).length(value)

    def angle(self, value: float) -> str:
        """Radians: ``-pi/2`` and the like, or a bare number."""
        steps = round(value / _STEP)
        if abs(value - steps * _STEP) > self.snap:
            return self.length(value)
        part = Fraction(12 if steps == -12 else steps, 12)
        top, under = part.numerator, part.denominator
        times = {1: "", -1: "-"}.get(top, f"{top}*")
        return "0" if top == 0 else f"{times}pi" + (f"/{under}" if under > 1 else "")


#: Limits and speeds are written as the URDF has them, to the picometre.
LIMITS = Rounding(decimals=12, snap=0.0)


@dataclass(frozen=True, slots=True)
class Origin:
    """What a recipe was made from: the URDF's file and digest, the robot's name, the links at both ends.

    `agrees` is a sentence about how well the recipe agrees with it.
    """

    file: str
    digest: str
    robot: str
    base: str
    tip: str
    agrees: str


def dh_text(
    dh: DhChain, joints: Sequence[Joint], gravity: Iterable[float], *, origin: Origin, rounding: Rounding
) -> str:
    """A whole recipe with remarks.

    Parameters
    ----------
    dh
        The parameters.
    joints
        Names, kinds, limits and speeds (their own DH parameters are not looked at).
    gravity
        m/s2, in axes of frame 0.
    origin
        Told in the remarks.
    rounding
        Of the numbers.
    """
    rows = zip(dh.theta, dh.alpha, dh.a, dh.d, strict=True)
    lines = [_line(joint, row, rounding) for joint, row in zip(joints, rows, strict=True)]
    file, base, tip = (_plain(text) for text in (origin.file, origin.base, origin.tip))
    body = _BODY.format(
        base=_frame(dh.base, base),
        agrees=origin.agrees,
        name=quoted(origin.robot),
        source=quoted(f"URDF {file}, links {base} to {tip}; SHA-256 {origin.digest}"),
        gravity=", ".join(rounding.gravity(value) for value in gravity),
        joints="\n".join(lines) + "\n",
    )
    given = "-" if origin.file == "standard input" else file
    command = shlex.join(["pumaid", "init", "--urdf", given, "--base", base, "--tip", tip])
    return remarked(body, len(joints), origin=command)


def quoted(text: str) -> str:
    """Printable text as YAML reads it back: bare where that is safe."""
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", text) and text.lower() not in _YAML_WORDS:
        return text
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _plain(text: str) -> str:
    """Text that keeps to its line."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _frame(base: NDArray[np.float64], link: str) -> str:
    """Where frame 0 stands in its link, in words."""
    moves = []
    tilt = math.acos(min(1.0, float(base[2, 2])))
    turned = math.atan2(float(base[1, 0]), float(base[0, 0]))
    if tilt > SEEN:
        moves.append(f"tilted by {number(tilt / factor('deg'))} deg so that z is parallel to the first joint's")
    if abs(turned) > SEEN:
        moves.append(f"turned by {number(turned / factor('deg'))} deg about z")
    if abs(base[:3, 3] @ base[:3, 2]) > SEEN:
        moves.append(f"shifted by {number(float(base[:3, 3] @ base[:3, 2]))} m along z")
    return f"link {link}, " + (", ".join(moves) if moves else "its own axes")


def _line(joint: Joint, row: Iterable[float], rounding: Rounding) -> str:
    theta, alpha, a, d = row
    words = [
        f"name: {quoted(joint.name)}",
        f"type: {joint.kind}",
        f"theta: {rounding.angle(theta)}",
        f"alpha: {rounding.angle(alpha)}",
        f"a: {rounding.length(a)}",
        f"d: {rounding.length(d)}",
    ]
    if joint.limits is not None:
        low, high = (LIMITS.length(value) for value in joint.limits)
        words.append(f"limits: [{low}, {high}]")
    if joint.max_velocity is not None:
        words.append(f"max_velocity: {LIMITS.length(joint.max_velocity)}")
    return f"  - {{{', '.join(words)}}}"
