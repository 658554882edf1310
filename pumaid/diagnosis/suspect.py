"""A user's own suspicion: any column of the logs, tried as current by itself, with the direction and with the load."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Family, Floats, Parameter, Shape
from pumaid.records import Extent, Samples
from pumaid.robot import Robot

#: What the column is multiplied by, in the order of the shape ``times``.
TIMES = ("nothing", "direction", "load")


class Suspect(Effect):
    """a x, s a x or a tau x, with x a column of the logs less its mean, s the direction and tau gravity's load.

    Parameters
    ----------
    column
        Its name.
    place
        Its number in `Samples.extra`.
    middle, spread
        Mean and standard deviation over the runs, in the column's own unit.
    """

    title = "A suspected column of the logs"
    source = "the user's suspicion"
    family = Family.SUSPECT
    needs_loads: ClassVar[bool] = True

    def __init__(self, column: str, place: int, *, middle: float, spread: float) -> None:
        self.column, self.place, self.middle, self.spread = column, place, middle, spread

    @property
    def name(self) -> str:
        """``suspect:COLUMN``."""
        return f"suspect:{self.column}"

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("a", "A", f"current per standard deviation ({self.spread:.4g}) of {self.column}", "a{n}"),)

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        return (Shape("times", "1", "0: as it is, 1: times direction, 2: times load", 0.0, 2.0, 1.0, False),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        return tuple({"times": float(number)} for number in range(len(TIMES)))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        if samples.extra is None or self.spread <= 0.0:
            return np.zeros((len(samples), 1))
        x = np.nan_to_num((samples.extra[:, self.place] - self.middle) / self.spread)
        load = np.zeros(len(samples)) if samples.loads is None else samples.loads.own
        factor = (np.ones(len(samples)), samples.direction, load)[int(shape.get("times", 0.0))]
        return np.asarray((x * factor)[:, None])
