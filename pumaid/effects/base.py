"""The contract of a physical effect: what one file under ``effects/`` states."""

import itertools
import math
import sys
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from pumaid.effects.formula import OF_LOADS, Samples, columns, names_in, printed
from pumaid.maths import Floats
from pumaid.robot import Robot

NO_SHAPE: Mapping[str, float] = {}

#: Below this share of gravity a component is the rounding of twists by right angles.
ROUNDING = 1e-9
#: Instants tried at most for a change in time: neighbours share all but a fortieth of the runs.
MOST_INSTANTS = 40
#: Share of the time between two starts by which an instant lies ahead of the second: within any real pause.
AHEAD = 0.02
#: Time constants at which a search begins, as shares of the campaign.
TIME_CONSTANTS = (0.08, 0.15, 0.3, 0.6, 1.2)
#: Random postures that show how an axis can stand to gravity; the answer does not depend on them.
POSTURES = 8


#: Prior odds of an effect at a joint: 1 where every surveyed joint with gears has it (load: P. Hamon et al., IROS 2010;
#: speed: A. C. Bittencourt and S. Gunnarsson, ASME J. Dyn. Syst. Meas. Control 134 (2012) 051013; waves: T. D. Tuttle
#: and W. P. Seering, IEEE Trans. Robotics and Automation 12 (1996) 368-374). No survey counts joints with the others: a
#: quarter for what some reports have (B. Armstrong-Helouvry et al., Automatica 30 (1994) 1083-1138), a sixteenth for
#: springs, which few arms have, and for faults.
USUAL, OCCASIONAL, RARE = 1.0, 1.0 / 4.0, 1.0 / 16.0


class Scope(Enum):
    """Whose the parameters are."""

    JOINT = "joint"  # the moving joint's own
    LINK = "link"  # a link's; they act on every joint that feels the link, scaled by the ratio of gains
    CAUSE = "cause"  # one joint's, which may act on any joint's current (a shifted zero, a geared wrist)
    ARM = "arm"  # the whole arm's


class Family(Enum):
    """What the current of an effect depends on."""

    GRAVITY = "gravity"
    DIRECTION = "direction"
    SPEED = "speed"
    LOAD = "load"
    POSITION = "position"
    TORQUE = "torque(q)"
    RIPPLE = "position, fast"
    START = "start"
    TIME = "time"
    PAYLOAD = "time, gravity"
    TEMPERATURE = "temperature"
    CURRENT = "current"
    MOTION = "motion"
    SUSPECT = "suspected"  # a column of the logs or a free function, in no catalogue


class Trace(Enum):
    """Which residual can show the effect."""

    POSITION = "position"
    SPEED = "speed"
    DIRECTION = "direction"
    LOAD = "load"
    TIME = "time"


#: Family -> the residuals that can show its effects where they do not say otherwise.
TRACES = {
    Family.GRAVITY: (Trace.POSITION,),
    Family.DIRECTION: (Trace.DIRECTION,),
    Family.SPEED: (Trace.SPEED, Trace.DIRECTION),
    Family.LOAD: (Trace.LOAD, Trace.DIRECTION),
    Family.POSITION: (Trace.POSITION, Trace.DIRECTION),
    Family.TORQUE: (Trace.POSITION,),
    Family.RIPPLE: (Trace.POSITION,),
    Family.START: (Trace.POSITION, Trace.DIRECTION),
    Family.TIME: (Trace.TIME, Trace.DIRECTION),
    Family.PAYLOAD: (Trace.TIME, Trace.POSITION),
    Family.TEMPERATURE: (Trace.TIME, Trace.DIRECTION),
    Family.CURRENT: (Trace.LOAD,),
    Family.MOTION: (Trace.POSITION,),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One linear parameter: name as in ``effect.jN.name``, unit, meaning, an example.

    ``{unit}`` stands for rad or m, of the owner's position or that of the joint that a shape `on` names. `symbol` is
    the paper's short name with ``{n}`` for the joint's number; `low` and `high` bound what is physical, and `sign` is
    the one that it has if it is this physics: +1, -1, or 0 where either is possible.
    """

    name: str
    unit: str
    meaning: str
    symbol: str
    example: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    sign: int = 0


@dataclass(frozen=True, slots=True)
class Extent:
    """What the runs of one joint (for an effect of the whole arm: of all) cover: where a shape can be looked for."""

    joint: int | None  # from 1; None for the whole arm
    speeds: tuple[float, ...]  # distinct speeds, rising, rad/s or m/s
    position: tuple[float, float]  # lowest and highest of the moving joint, rad or m
    finest: float  # shortest wavelength that the bins can show, rad or m
    travel: float  # longest run, rad or m
    starts: tuple[float, ...]  # s since the joint's first motion, of every run, and of blocks' cells; rising
    duration: float  # s from the first motion to the end of the last
    current: float  # largest absolute current that the model predicts, A

    @property
    def fastest(self) -> float:
        """Largest speed, rad/s or m/s."""
        return self.speeds[-1]

    @property
    def half_wave(self) -> float:
        """Radians of phase per rad or m of a wave that goes through half a period over all positions."""
        return math.pi / max(self.position[1] - self.position[0], 0.01)

    def nearer(self, instant: float) -> "Extent":
        """With the starts about one of the instants that a search of these began at, as far as its neighbours."""
        tried = _instants(self)
        place, starts = bisect_left(tried, instant), np.array(self.starts)
        low, high = tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)]
        first, last = np.searchsorted(starts, [low, high], side="right")
        return replace(self, starts=self.starts[max(first - 1, 0) : last + 1])


@dataclass(frozen=True, slots=True)
class Shape:
    """One nonlinear parameter: name as in ``EFFECT@JOINT:name=value``, unit, meaning, bounds, an example.

    `is_searched` says whether it is refined off the grid (not whole numbers, nor instants between two runs). A search
    begins at `starts`, which are shares of the quantity `of` an `Extent` where that is named. Where they are not
    stated, the shape is a time constant, or an instant between two runs where it is not searched.
    """

    name: str
    unit: str
    meaning: str
    low: float
    high: float
    example: float
    is_searched: bool = True
    starts: tuple[float, ...] = ()
    of: str = ""

    def starts_in(self, extent: Extent) -> tuple[float, ...]:
        """Values at which a search begins in runs that cover `extent`, within the bounds."""
        if not self.starts and not self.is_searched:
            return _instants(extent)
        shares, of = (self.starts, self.of) if self.starts else (TIME_CONSTANTS, "duration")
        unit = getattr(extent, of) if of else 1.0
        return tuple(min(max(share * unit, self.low), self.high) for share in shares)


class Effect:
    """A contribution to a joint's current that is linear in its parameters.

    An effect is final, keeps no state, reads no file and never sees the measured current. Its file's name is its name
    in recipes, parameters, the command line and results.

    Examples
    --------
    >>> class Square(Effect):
    ...     title = "Friction with the square of speed"
    ...     formula = "square * qd * v"
    ...     source = "an example"
    ...     family = Family.SPEED
    ...     trace = (Trace.SPEED,)
    ...     linear = (Parameter("square", "A s2/{unit}2", "current at unit speed", "c{n}"),)
    >>> Square.equation
    'square qd v'
    """

    #: A line for people, that at the head of the file where it is not stated, and who states the law.
    title: ClassVar[str] = ""
    source: ClassVar[str]
    #: The current, in the terms of `pumaid.effects.formula`: columns, exports and documents are made from it. Empty
    #: where `columns` says it in code; `equation` is what documents print, made from it where it is not stated.
    formula: ClassVar[str] = ""
    equation: ClassVar[str] = ""
    #: Why an exported model leaves the effect out though the formula is known; empty where it does not.
    left_out: ClassVar[str] = ""
    scope: ClassVar[Scope] = Scope.JOINT
    family: ClassVar[Family]
    #: That of the family where it is not stated.
    trace: ClassVar[tuple[Trace, ...]] = ()
    #: The runs that show it best, to go after "it is seen best in".
    seen_in: ClassVar[str] = ""
    #: Names of effects that data may not tell from it.
    look_alikes: ClassVar[tuple[str, ...]] = ()
    #: Odds before any data: `USUAL`, `OCCASIONAL` or `RARE`.
    prior_odds: ClassVar[float] = OCCASIONAL
    #: Linear and nonlinear parameters of every owner that can have the effect; those that differ by owner override
    #: `parameters` and `shapes`.
    linear: ClassVar[tuple[Parameter, ...]] = ()
    nonlinear: ClassVar[tuple[Shape, ...]] = ()
    #: Why it cannot act at a joint that slides, and whether only where gravity loads the joint, or some joint.
    not_sliding: ClassVar[str] = ""
    only_loaded: ClassVar[bool] = False
    #: Whether it belongs to the paper's model, and so is in every model.
    base: ClassVar[bool] = False
    #: Whether it is friction, so that `signs` count along the current that overcomes friction (which is against the
    #: direction of motion where the motor counts its current backwards); so it is where the formula has ``s``.
    opposes_motion: ClassVar[bool] = False
    #: Whether a joint may have it several times with other shapes (two harmonics).
    is_repeatable: ClassVar[bool] = False
    #: Whether it is a free function of a variable: tried only where nothing of the catalogue explains what is left.
    is_free: ClassVar[bool] = False
    #: Name of the shape that is a frequency of the own position, looked for by a periodogram on the finest cells.
    periodic: ClassVar[str | None] = None
    #: Whether its columns are made from `Samples.loads`, so that they wait for a fit and move with it;
    #: so it is where the formula has loads.
    needs_loads: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        names = names_in(cls.formula) if cls.formula else frozenset[str]()
        head = (sys.modules[cls.__module__].__doc__ or "").strip().partition("\n")[0]
        cls.title = cls.title or head.removesuffix(".")
        cls.equation, cls.trace = cls.equation or printed(cls.formula), cls.trace or TRACES.get(cls.family, ())
        cls.needs_loads = cls.needs_loads or bool(names & OF_LOADS)
        cls.opposes_motion = cls.opposes_motion or "s" in names

    @property
    def name(self) -> str:
        """The file's name."""
        return type(self).__module__.rsplit(".", 1)[-1]

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        """Linear parameters that joint or link `number` (from 1; 0: the whole arm) owns; empty where it owns none."""
        return _in_units(self.linear, robot.joint(number).position_unit if number else "rad")

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        """Nonlinear parameters of owner `number`; none for most effects."""
        return _in_units(self.nonlinear, robot.joint(number).position_unit if number else "rad")

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        """Values of the shapes at which a search begins, given what the owner's runs cover; at least one mapping.

        Every combination of what the shapes say.
        """
        shapes = self.shapes(robot, extent.joint or 0)
        starts = itertools.product(*(shape.starts_in(extent) for shape in shapes))
        return tuple({shape.name: start for shape, start in zip(shapes, point, strict=True)} for point in starts)

    def formula_in(self, robot: Robot, number: int, joint: int) -> str:
        """The current in `joint` (from 1) that owner `number` causes; `formula` for most effects."""
        return self.formula

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        """(M, p) A of current in joint `samples.joint` per unit of each parameter, at M instants of its motion.

        `number` (from 1) owns the parameters: the moving joint where not given, 0 or None for the whole arm. Of scope
        LINK it may be any link outward of the moving joint, and the current is then in units of that link's own gain;
        of scope CAUSE it is the joint that causes the current, wherever it flows.
        """
        owner = number or (0 if self.scope is Scope.ARM else samples.joint)
        return columns(
            self.formula_in(robot, owner, samples.joint),
            tuple(parameter.name for parameter in self.parameters(robot, owner)),
            shape,
            motion=(robot, samples, owner),
        )

    def signs(self, shape: Mapping[str, float]) -> tuple[int, ...]:
        """Signs that the parameters have if it is this physics, with this shape; () where `parameters` says them."""
        return tuple(parameter.sign for parameter in self.linear)

    def chosen(self, shape: Mapping[str, float]) -> Mapping[str, float]:
        """The shapes that tell it from the same effect at the same joint: all where that may be, else none."""
        return dict(shape) if self.is_repeatable else {}

    def applies(self, robot: Robot, joint: int, *, in_motion: bool = False) -> str | None:
        """Why the effect cannot act at (or be caused by) `joint` (from 1; 0: the whole arm), or None where it can.

        `in_motion` joints carry loads of inertia, too.
        """
        if self.not_sliding and not robot.joint(joint).is_revolute:
            return f"joint {joint} slides: {self.not_sliding}"
        numbers = [joint] if joint else range(1, robot.n_joints + 1)
        is_loaded = not self.only_loaded or (in_motion and not names_in(self.formula).isdisjoint({"load", "load_rate"}))
        refusals = [None] if is_loaded else [load_refusal(robot, number) for number in numbers]
        return None if None in refusals else "; ".join(map(str, refusals))


@lru_cache(maxsize=256)
def _in_units(entries: tuple[Any, ...], unit: str) -> tuple[Any, ...]:
    return tuple(replace(entry, unit=entry.unit.format(unit=unit)) for entry in entries)


def _instants(extent: Extent) -> tuple[float, ...]:
    """Times (s) between runs at which something may have changed, at most `MOST_INSTANTS`, spread over the runs.

    Each lies in the pause before a run, just ahead of it: half way between two starts a slow run may still be going.
    """
    starts = np.unique(np.asarray(extent.starts, dtype=float))
    if len(starts) < 2:
        return (max(extent.duration, 1.0) / 2.0,)
    between = starts[1:] - AHEAD * np.diff(starts)
    chosen = np.unique(np.linspace(0, len(between) - 1, min(len(between), MOST_INSTANTS)).round().astype(int))
    return tuple(float(t) for t in between[chosen])


@lru_cache(maxsize=64)  # asked again for every shape of every effect
def load_refusal(robot: Robot, joint: int, *, must_change: bool = False) -> str | None:
    """Why an effect of gravity's load says nothing at joint `joint` (from 1), whatever its limits; None where it can.

    With `must_change`, a load that is the same in every posture does not count either.
    """
    rng = np.random.default_rng(0)
    z = robot.rotations(rng.uniform(-np.pi, np.pi, (POSTURES, robot.n_joints)))[:, joint - 1, :, 2]
    g = np.asarray(robot.gravity, dtype=float)
    small = ROUNDING * float(np.linalg.norm(g))
    if robot.joint(joint).is_revolute:
        upright = float(np.abs(np.cross(z, g)).max()) <= small
        return f"joint {joint} turns about the direction of gravity in every posture" if upright else None
    along = z @ g
    if float(np.abs(along).max()) <= small:
        return f"joint {joint} slides across the direction of gravity in every posture"
    if must_change and float(np.ptp(along)) <= small:
        return f"the load of joint {joint} is the same in every posture, so this is part of its Coulomb friction"
    return None
