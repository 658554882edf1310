"""The contract of a physical effect: what one file under ``effects/`` states."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Extent, Robot, Samples

Floats = NDArray[np.float64]
NO_SHAPE: Mapping[str, float] = {}


class Scope(Enum):
    """Whose the parameters are."""

    JOINT = "joint"  # the moving joint's own
    LINK = "link"  # a link's; they act on every joint that feels the link, scaled by the ratio of gains
    CAUSE = "cause"  # one joint's, which may act on any joint's current (a shifted zero, a geared wrist)
    ARM = "arm"  # the whole arm's


class Trace(Enum):
    """Which residual can show the effect."""

    POSITION = "position"
    SPEED = "speed"
    DIRECTION = "direction"
    LOAD = "load"
    TIME = "time"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One linear parameter: name as in ``effect.jN.name``, unit (``{unit}`` stands for rad or m), meaning, an example.

    `symbol` is the paper's short name with ``{n}`` for the joint's number; `low` and `high` bound what is physical.
    """

    name: str
    unit: str
    meaning: str
    symbol: str
    example: float = 0.0
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, slots=True)
class Shape:
    """One nonlinear parameter: name as in ``EFFECT@JOINT:name=value``, unit, meaning, bounds, an example.

    `is_searched` says whether it is refined off the grid (not whole numbers, nor instants between two runs).
    """

    name: str
    unit: str
    meaning: str
    low: float
    high: float
    example: float
    is_searched: bool = True


class Effect(ABC):
    """A contribution to a joint's current that is linear in its parameters.

    An effect is final, keeps no state, reads no file and never sees the measured current. Its file's name is its name
    in recipes, parameters, the command line and results.

    Attributes
    ----------
    title
        A line for people.
    equation
        The current, in plain characters: ``s a exp(-(v/v_s)^d)``.
    source
        Paper or book that states the law.
    scope
        Whose the parameters are.
    family
        What the current depends on, in a word or two: ``speed``, ``load``, ``position``, ``start``, ``time`` ...
    trace
        The residuals that show it.
    look_alikes
        Names of effects that data may not tell from it.
    base
        Whether it belongs to the paper's model and so is in every model.
    in_triangle
        Whether, within one run, its columns lie in the span of the run's triangle (cos q, sin q, 1, and for strokes
        velocity and acceleration), so that it is fitted without looking at cells.
    per_posture
        Whether its parameters are separate for each set of positions at which the outer joints are held.
    needs_loads
        Whether its columns are made from `Samples.loads`, so that they wait for a fit and move with it.

    Examples
    --------
    >>> class Square(Effect):
    ...     title = "Friction with the square of speed"
    ...     equation = "c v |v|"
    ...     source = "an example"
    ...     family = "speed"
    ...     trace = (Trace.SPEED,)
    ...     def parameters(self, robot, number):
    ...         return (Parameter("square", "A s2/{unit}2", "current at unit speed", "c{n}"),)
    ...     def columns(self, robot, samples, *, number=None, shape=NO_SHAPE):
    ...         v = samples.velocity[:, samples.joint - 1]
    ...         return (v * np.abs(v))[:, None]
    """

    title: ClassVar[str]
    equation: ClassVar[str] = ""
    source: ClassVar[str]
    scope: ClassVar[Scope] = Scope.JOINT
    family: ClassVar[str] = ""
    trace: ClassVar[tuple[Trace, ...]] = ()
    look_alikes: ClassVar[tuple[str, ...]] = ()
    base: ClassVar[bool] = False
    in_triangle: ClassVar[bool] = False
    per_posture: ClassVar[bool] = False
    needs_loads: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """The file's name."""
        return type(self).__module__.rsplit(".", 1)[-1]

    @abstractmethod
    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        """Linear parameters that joint or link `number` (from 1; 0: the whole arm) owns; empty where it owns none."""

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        """Nonlinear parameters of owner `number`; none for most effects."""
        return ()

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        """Values of the shape at which a search begins, given what the owner's runs cover.

        Parameters
        ----------
        robot
            The arm.
        extent
            Of the runs of the joint that owns it, or of all for an effect of the whole arm.

        Returns
        -------
        grid
            At least one mapping where the effect can act; ``({},)`` for an effect without shape.
        """
        return (NO_SHAPE,)

    @abstractmethod
    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        """Current in joint `samples.joint` per unit of each parameter.

        Parameters
        ----------
        robot
            The arm.
        samples
            M instants of one moving joint.
        number
            Owner of the parameters, from 1; the moving joint itself where not given. For an effect of scope LINK it may
            be any link outward of the moving joint, and the current is then in units of that link's own gain. For one
            of scope CAUSE it is the joint that causes the current, wherever it flows; 0 or None for the whole arm.
        shape
            Nonlinear parameters by name.

        Returns
        -------
        columns
            (M, p), A per unit of parameter.
        """

    def applies(self, robot: Robot, joint: int) -> str | None:
        """Why the effect cannot act at (or be caused by) `joint` (from 1), or None where it can."""
        return None
