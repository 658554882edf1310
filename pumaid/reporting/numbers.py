"""Numbers and units as people read them."""

from __future__ import annotations

import math
import re

from pumaid.units import factor, number

#: Digits behind the point beyond which a power of ten is easier to read.
MOST_PLACES = 7

_ANGLE = re.compile(r"\brad(\d?)\b")


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """A value and its standard error as text, both to the error's second significant digit.

    Examples
    --------
    >>> with_error(0.2236776, 0.0000934)
    ('0.223678', '0.000093')
    >>> with_error(12345.6, 310.0)
    ('12346', '310')
    """
    if error is None or not math.isfinite(error) or error <= 0.0:
        return number(value, 5), "" if error is None else number(error, 2)
    places = 1 - math.floor(math.log10(error))
    if places <= MOST_PLACES:
        return f"{value:.{max(places, 0)}f}", f"{error:.{max(places, 0)}f}"
    largest = max(abs(value), error)
    if largest >= 1e-4:
        return number(value, 7), f"{error:.1e}"
    power = math.floor(math.log10(largest))
    shown = [f"{item / 10.0**power:.{max(places + power, 0)}f}e{power}" for item in (value, error)]
    return shown[0], shown[1]


def in_unit(unit: str, units: str) -> tuple[float, str]:
    """What a number of `unit` is multiplied by where angles are shown in `units` (rad or deg), and the unit then.

    Examples
    --------
    >>> in_unit("A s/rad", "deg")
    (0.017453292519943295, 'A s/deg')
    """
    if units == "rad" or not _ANGLE.search(unit):
        return 1.0, unit
    times = 1.0
    above, _, below = unit.partition("/")
    for part, sign in ((above, -1), (below, 1)):
        for found in _ANGLE.finditer(part):
            times *= factor("deg") ** (sign * int(found[1] or 1))
    return times, _ANGLE.sub(r"deg\1", unit)


def percent(share: float | None) -> str:
    """A share as a percentage with as many digits as distinguish it from 100 %.

    Examples
    --------
    >>> percent(0.5), percent(0.998), percent(0.99998)
    ('50 %', '99.8 %', '99.998 %')
    """
    if share is None or not math.isfinite(share):
        return "unknown"
    gap = abs(1.0 - share)
    places = 0 if gap >= 0.05 else min(4, max(1, -math.floor(math.log10(max(gap, 1e-6))) - 2))
    return f"{round(100.0 * share, places) + 0.0:.{places}f} %"


def shortened(name: str, most: int = 52) -> str:
    """A name that fits above a figure: at most `most` letters."""
    return name if len(name) <= most else name[: most - 1] + "…"


def amperes(value: float | None) -> str:
    """A current for people: A, three significant digits; a dash where there is none."""
    return "-" if value is None else f"{number(value, 3)} A"
