"""Learned curve of one variable, for what no law of the catalogue describes."""

from collections.abc import Mapping

import numpy as np

from pumaid.effects import NO_SHAPE, Effect, Family, Parameter, Samples, Shape, Trace
from pumaid.effects.formula import QUANTITIES
from pumaid.maths import Flags, Floats
from pumaid.robot import SHAPE_WORDS, Robot

#: Equal segments of the range: two knots within the narrowest worn spot that is told from a ripple.
SEGMENTS = 32
#: Variables of a curve as formulas and as free forms call them, in the order of their words.
OF, NAMES = ("q", "v", "load", "path", "t", "temperature"), ("q", "v", "load", "travel", "t", "temperature")
#: The place of speed, and the share of its range by which a curve may be left before that is told.
SPEED, MARGIN = OF.index("v"), 0.02
MEANING = f"second difference of the spline's coefficients; up to bend{SEGMENTS + 1}"
#: What is chosen of a curve; the rest follows from the runs.
CHOSEN = ("of", "odd", "times")

_second = np.diff(np.eye(SEGMENTS + 3), n=2, axis=0)
#: (S + 3, S + 2) coefficients of the cubic B-splines by a slope over the range and by their own second differences: a
#: constant is left out, since Coulomb or viscous friction has it.
COEFFICIENTS: Floats = np.column_stack(
    [(np.arange(SEGMENTS + 3) - 1.0) / (SEGMENTS / 2.0) - 1.0, np.linalg.pinv(_second)]
)


class LearnedCurve(Effect):
    """A cubic spline of position, speed, load, travel, time or temperature, as smooth as the data ask for.

    odd curves change their sign with the motion, as friction does; those times speed are a viscous friction that
    varies. Second differences of the coefficients have the standard deviation `spread` before any data, which
    restricted maximum likelihood chooses; beyond the range of its runs the curve stays as it is at the end.
    """

    equation = "f(of), s f(of) or v f(of)"
    source = (
        "S. N. Wood, Generalized Additive Models, 2nd ed., 2017, ch. 5, 6; D. Ruppert, M. P. Wand and R. J. Carroll,"
        " Semiparametric Regression, 2003, ch. 4"
    )
    family = Family.SUSPECT
    trace = (Trace.POSITION, Trace.DIRECTION)
    seen_in = "runs both ways over the whole span"
    is_repeatable = True
    is_free = True
    needs_loads = True
    linear = (
        Parameter("slope", "A", "half the rise of a straight line", "c{n}", 0.01),
        *(
            Parameter(f"bend{k}", "A", MEANING, f"c{{n}}_{k}", {12: 0.01, 16: -0.02, 20: 0.01}.get(k, 0.0))
            for k in range(1, SEGMENTS + 2)
        ),
    )
    nonlinear = (
        Shape("of", "1", ", ".join(SHAPE_WORDS["of"]), 0.0, len(OF) - 1.0, 0.0, is_searched=False, starts=(0.0,)),
        Shape("odd", "1", "with the sign of motion: false, true", 0.0, 1.0, 1.0, is_searched=False, starts=(1.0,)),
        Shape("times", "1", "by nothing, speed", 0.0, 1.0, 0.0, is_searched=False, starts=(0.0,)),
        Shape("low", "SI", "lowest value in the runs", -1e9, 1e9, -1.5, is_searched=False, starts=(-1.5,)),
        Shape("high", "SI", "highest", -1e9, 1e9, 1.5, is_searched=False, starts=(1.5,)),
        Shape("spread", "A", "deviation of bends", 1e-9, 1e6, 0.05, is_searched=False, starts=(0.05,)),
    )

    def chosen(self, shape: Mapping[str, float]) -> Mapping[str, float]:
        return {name: shape[name] for name in CHOSEN if name in shape}

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        factor = np.ones(len(samples))
        for name, is_there in (("s", shape["odd"]), ("v", shape["times"])):
            factor = factor * (QUANTITIES[name](robot, samples, samples.joint) if is_there else 1.0)
        return course(shape, variable(robot, samples, shape)) * factor[:, None]


def variable(robot: Robot, samples: Samples, shape: Mapping[str, float]) -> Floats:
    """(M,) values of a curve's variable."""
    return np.asarray(QUANTITIES[OF[int(shape["of"])]](robot, samples, samples.joint))


def course(shape: Mapping[str, float], x: Floats) -> Floats:
    """(M, S + 2) A, or A s/rad or A s/m where speed multiplies it, of a curve at M values of its variable."""
    share = (x - shape["low"]) / max(shape["high"] - shape["low"], 1e-300)
    return np.asarray(splines(share) @ COEFFICIENTS * _is_drawn(shape))


def law(shape: Mapping[str, float], row: int) -> str:
    """A curve as a formula, ``s * curve(row, q)``, of a function that looks it up in `table`."""
    return f"{'s * ' * bool(shape['odd'])}{'v * ' * bool(shape['times'])}curve({row}, {OF[int(shape['of'])]})"


def table(shape: Mapping[str, float], sizes: Floats) -> Floats:
    """(S + 5,) lowest and highest value of a curve's variable, and the coefficients (A) of its B-splines."""
    return np.array([shape["low"], shape["high"], *(COEFFICIENTS @ np.where(_is_drawn(shape), sizes, 0.0))])


def _is_drawn(shape: Mapping[str, float]) -> Flags:
    """(S + 2,) parameters that draw current: a friction in proportion to speed is viscous friction."""
    return np.arange(SEGMENTS + 2) >= bool(int(shape["of"]) == SPEED and shape["odd"] and not shape["times"])


def knots_of(shape: Mapping[str, float]) -> tuple[float, ...]:
    """Knots of a curve, in its variable."""
    return tuple(np.linspace(shape["low"], shape["high"], SEGMENTS + 1).tolist())


def spoken_form(shape: Mapping[str, float]) -> str:
    """A curve as free forms are called, ``s f(q)``."""
    factor = ("|v| ", "v ")[int(shape["odd"])] if shape["times"] else ("", "s ")[int(shape["odd"])]
    return f"{factor}f({NAMES[int(shape['of'])]})"


def outside(robot: Robot, samples: Samples, shape: Mapping[str, float]) -> Flags:
    """(M,) instants at which a curve is held at an end of its range."""
    x, margin = variable(robot, samples, shape), MARGIN * (shape["high"] - shape["low"])
    return np.asarray((x < shape["low"] - margin) | (x > shape["high"] + margin))


def splines(share: Floats) -> Floats:
    """(M, S + 3) cubic B-splines on equal segments of the range, of which (M,) shares are given, held at its ends.

    Source: C. de Boor, A Practical Guide to Splines, ch. 9; P. H. C. Eilers, B. D. Marx, Stat. Sci. 11 (1996) 89-121.
    """
    place = np.clip(share, 0.0, 1.0) * SEGMENTS
    segment = np.minimum(place.astype(np.int64), SEGMENTS - 1)
    t, out = place - segment, np.zeros((len(place), SEGMENTS + 3))
    parts = ((1.0 - t) ** 3, 3.0 * t**3 - 6.0 * t**2 + 4.0, -3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0, t**3)
    for k, part in enumerate(parts):
        out[np.arange(len(t)), segment + k] = part / 6.0
    return out
