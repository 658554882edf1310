"""Torque constants: what a user gives, and what the identified ratios of gains make of the rest."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError, Where
from pumaid.exports.formulas import Formulas

Floats = NDArray[np.float64]

#: What a list of numbers is made of; anything else is the name of a file.
NUMBERS = re.compile(r"[\d\s.,;=:eE+-]*")

_MEND = "write as many numbers as the arm has joints (k1,k2,...), or JOINT=NUMBER, or name a file that holds them"


def read_constants(text: str, joints: int) -> dict[int, float]:
    """Torque constants as a user gives them.

    Parameters
    ----------
    text
        ``k1,k2,...`` of all joints, ``2=31.5`` of some of them, or the name of a file that holds either, separated by
        commas, blanks or line ends, with comments after ``#``.
    joints
        How many the arm has.

    Returns
    -------
    constants
        Joint (from 1) -> N m/A, or N/A of a slide; none is zero.

    Raises
    ------
    ModelError [torque-constants]
        It is neither, or not of this arm.
    """
    path, where = Path(text), Where(field=f"--torque-constants {text}")
    if not NUMBERS.fullmatch(text):
        if not path.is_file():
            raise ModelError("torque-constants", f"there is no file {text}", where, _MEND)
        text = re.sub(r"#.*", "", path.read_text(encoding="utf-8", errors="replace"))
        where = Where(file=str(path))
    words = [word for word in re.split(r"[\s,;]+", re.sub(r"\s*[=:]\s*", "=", text)) if word]
    found: dict[int, float] = {}
    for place, word in enumerate(words, start=1):
        joint, named, value = word.rpartition("=")
        number = _number(joint) if named else float(place)
        constant = _number(value)
        if not (1 <= number <= joints and number == int(number)) or int(number) in found:
            what = f"{word!r} is of no joint from 1 to {joints}, or of one that was given before"
            raise ModelError("torque-constants", what, where, _MEND)
        if not math.isfinite(constant) or constant == 0.0:
            raise ModelError("torque-constants", f"{word!r} is no torque constant", where, _MEND)
        found[int(number)] = constant
    if not found or (all("=" not in word for word in words) and len(found) != joints):
        what = f"there are {len(found)} torque constants for {joints} joints"
        raise ModelError("torque-constants", what, where, _MEND)
    return found


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def constants_of(told: Formulas, given: Mapping[int, float]) -> tuple[Floats, tuple[str, ...]]:
    """(J,) torque constants of all joints, and what is to be said of them.

    A joint that is not in `given` gets its constant from the nearest that has one, by the identified ratio of gains.
    Where nothing is given, the largest of the joints that are tied by ratios is 1, with the sign by which friction
    opposes motion.

    Parameters
    ----------
    told
        The model, whose ratios are K_j / K_i = eta_i / eta_j.
    given
        Joint (from 1) -> constant.
    """
    n = told.robot.n_joints
    out = np.full(n, np.nan)
    for joint, value in given.items():
        out[joint - 1] = value
    _spread(out, told.ratios)
    free = []
    for joint in range(n):
        if np.isnan(out[joint]):
            group = np.full(n, np.nan)
            group[joint] = 1.0
            _spread(group, told.ratios)
            own = np.isfinite(group) & np.isnan(out)
            opposing = np.nansum(np.where(own, group, 0.0) * (told.coulomb[:, 0] - told.coulomb[:, 1]))
            out[own] = group[own] / np.abs(group[own]).max() * (-1.0 if opposing < 0.0 else 1.0)
            free.append([int(k) + 1 for k in np.flatnonzero(own)])
    return out, tuple(_said(free, given, joints=n))


def _spread(constants: Floats, ratios: Floats) -> None:
    """Fill in, outward from joints that are known, those that a ratio ties to one of them; nearest first."""
    n = len(constants)
    pairs = [(known, joint) for known in range(n) for joint in range(n) if known != joint]
    for _ in range(n):
        for known, joint in sorted(pairs, key=lambda pair: abs(pair[0] - pair[1])):
            ratio = ratios[min(known, joint), max(known, joint)]
            if np.isfinite(constants[known]) and np.isnan(constants[joint]) and ratio != 0.0:
                constants[joint] = constants[known] * (ratio if joint > known else 1.0 / ratio)


def _said(free: list[list[int]], given: Mapping[int, float], *, joints: int) -> list[str]:
    out = []
    if given and len(given) + sum(map(len, free)) < joints:
        out.append("torque constants that were not given follow from the identified ratios of gains")
    for group in free:
        which = f"joint {group[0]}" if len(group) == 1 else f"joints {', '.join(map(str, group))}"
        rest = ", the others follow from the identified ratios of gains" if len(group) > 1 else ""
        out.append(
            f"no torque constant of {which} was given: the largest there is taken as 1 N m/A (N/A){rest}; torques and"
            " masses there are right but for one factor (--torque-constants JOINT=K)"
        )
    return out
