"""Unit words and the factors that turn what a file holds into SI."""

import math

#: Unit word -> (dimension, factor to SI). Inside the program everything is SI, angles rad, currents A.
UNITS: dict[str, tuple[str, float]] = {
    "rad": ("angle", 1.0),
    "deg": ("angle", math.pi / 180.0),
    "rev": ("angle", 2.0 * math.pi),
    "mrad": ("angle", 1e-3),
    "tick": ("angle", 2.0 * math.pi / 4096.0),  # of the servos of most hobby arms
    "m": ("length", 1.0),
    "mm": ("length", 1e-3),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "rad/s": ("angular velocity", 1.0),
    "deg/s": ("angular velocity", math.pi / 180.0),
    "rev/s": ("angular velocity", 2.0 * math.pi),
    "rpm": ("angular velocity", 2.0 * math.pi / 60.0),
    "mrad/s": ("angular velocity", 1e-3),
    "tick/s": ("angular velocity", 2.0 * math.pi / 4096.0),
    "m/s": ("linear velocity", 1.0),
    "mm/s": ("linear velocity", 1e-3),
    "A": ("current", 1.0),
    "mA": ("current", 1e-3),
    "Nm": ("current", 1.0),  # torques take the place of currents
    "mNm": ("current", 1e-3),
    "raw": ("current", 1.0),  # counts of a driver, whose size nobody knows
    "percent": ("current", 1e-2),  # of what the drive is rated for
    "permille": ("current", 1e-3),
    "degC": ("temperature", 1.0),
}
#: How the note begins that says what currents are, where they are not in A.
CURRENTS_IN = "currents are in "
#: Standard deviations from which they are not counted.
CERTAIN = 100


def factor(unit: str) -> float:
    """What a number in `unit` is multiplied by to be SI.

    Raises
    ------
    KeyError
        The unit word is not one of `UNITS`.
    """
    return UNITS[unit][1]


def number(value: float, digits: int = 4) -> str:
    """A number for people: `digits` significant digits, no exponent where it can be avoided."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value + 0.0:g}"
    if 1e-4 <= abs(value) < 1e6:
        return f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}"
    return f"{value:.{digits - 1}e}"


def deviations(apart: float) -> str:
    """Standard deviations for people: how many is no matter where chance is out of the question."""
    return number(apart, 2) if apart < CERTAIN else f"more than {CERTAIN}"
