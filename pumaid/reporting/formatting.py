"""Numbers, units and names as people read them."""

import math
import re
from collections.abc import Iterable, Sequence
from itertools import takewhile
from pathlib import PurePath

import numpy as np

from pumaid.robot import Robot
from pumaid.units import factor, number

#: Decimals beyond which a power of ten is easier to read.
MOST_DECIMALS = 7

_ANGLE = re.compile(r"\brad(\d?)\b")


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """A value and its standard error as text, both to the error's second significant digit."""
    if error is None or not math.isfinite(error) or error <= 0.0:
        return number(value, 5), "" if error is None else number(error, 2)
    decimals = 1 - math.floor(math.log10(error))
    if decimals <= MOST_DECIMALS:
        return f"{value:.{max(decimals, 0)}f}", f"{error:.{max(decimals, 0)}f}"
    largest = max(abs(value), error)
    if largest >= 1e-4:
        return number(value, 7), f"{error:.1e}"
    power = math.floor(math.log10(largest))
    texts = [f"{item / 10.0**power:.{max(decimals + power, 0)}f}e{power}" for item in (value, error)]
    return texts[0], texts[1]


def in_unit(unit: str, angle: str) -> tuple[float, str]:
    """Factor and unit word that show a number of `unit` with angles in `angle` (``rad`` or ``deg``)."""
    if angle == "rad" or not _ANGLE.search(unit):
        return 1.0, unit
    scale = 1.0
    above, _, below = unit.partition("/")
    for part, sign in ((above, -1), (below, 1)):
        for match in _ANGLE.finditer(part):
            scale *= factor("deg") ** (sign * int(match[1] or 1))
    return scale, _ANGLE.sub(r"deg\1", unit)


def percent(share: float | None) -> str:
    """A share as a percentage with as many digits as distinguish it from 100 %."""
    if share is None or not math.isfinite(share):
        return "unknown"
    gap = abs(1.0 - share)
    decimals = 0 if gap >= 0.05 else min(4, max(1, -math.floor(math.log10(max(gap, 1e-6))) - 2))
    return f"{round(100.0 * share, decimals) + 0.0:.{decimals}f} %"


def amperes(value: float | None) -> str:
    """A current with three significant digits; a dash where there is none."""
    return "-" if value is None else f"{number(value, 3)} A"


def shortened(name: str, limit: int = 52) -> str:
    """A name cut to at most `limit` letters."""
    return name if len(name) <= limit else name[: limit - 1] + "…"


def plural(count: int, word: str) -> str:
    """A count with its noun: ``1 run``, ``2 runs``."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def letters(index: int) -> str:
    """A short name by its number from 0: a, b, ... z, aa, bb, ..."""
    return chr(ord("a") + index % 26) * (index // 26 + 1)


def listed(words: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def joint_title(robot: Robot, joint: int) -> str:
    """Number and name of joint `joint` (from 1): ``Joint 3 (elbow)``."""
    name = robot.joint(joint).name
    return f"Joint {joint}" if name == f"joint{joint}" else f"Joint {joint} ({name})"


def joint_label(robot: Robot, joint: int | None) -> str:
    """Number and name of joint `joint` (from 1) in a table: ``3 elbow``; ``arm`` for none."""
    return f"{joint} {robot.joint(joint).name}" if joint else "arm"


def joint_titles(robot: Robot, joints: Sequence[int]) -> str:
    """Several joints (from 1): ``Joints 1 (waist) and 3 (elbow)``."""
    names = [joint_title(robot, joint).removeprefix("Joint ") for joint in joints]
    return f"Joint{'s' * (len(joints) > 1)} {listed(names)}"


def posture_text(robot: Robot, positions: Sequence[float], angle: str = "rad", *, moving: int = 0) -> str:
    """Positions (J,) of all joints: ``[0 – 90]``, a dash for joint `moving` (from 1) and for NaN."""
    words = []
    for joint, position in zip(robot.joints, positions, strict=True):
        if joint.number == moving or not np.isfinite(position):
            words.append("–")
            continue
        decimals = 0 if angle == "deg" and joint.is_revolute else 2
        words.append(f"{round(position * in_unit(joint.position_unit, angle)[0], decimals) + 0.0:.{decimals}f}")
    return "[" + " ".join(words) + "]"


def relative_names(names: Iterable[str]) -> dict[str, str]:
    """File names without the folders that all of them share."""
    paths = {name: PurePath(name) for name in names}
    levels = zip(*(path.parent.parts for path in paths.values()), strict=False)
    shared = len(list(takewhile(lambda folders: len(set(folders)) == 1, levels)))
    return {name: str(PurePath(*path.parts[shared:])) for name, path in paths.items()}
