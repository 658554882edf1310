"""A base that does not stand as the recipe says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Floats, Parameter, Scope, Trace, loads_of
from pumaid.records import Robot, Samples


class Tilt(Effect):
    """The base is turned by small angles about its own x and y: gravity's load changes in every joint.

    x and y (rad) turn the whole arm by the right hand about the base frame's axes, gravity staying where it is. A turn
    about the direction of gravity changes nothing, so for an arm that stands upright x and y are all there is. It gives
    a load to a joint whose axis was thought upright; the first moment of that joint's own link, which no current shows
    until then, is left out of it.
    """

    title = "Base tilted against gravity"
    equation = "x dtau/d(turn about base x) + y dtau/d(turn about base y)"
    source = (
        "B. Siciliano, L. Sciavicco, L. Villani and G. Oriolo, Robotics: Modelling, Planning and Control, Springer"
        " 2009, section 7.1.2 (gravity's potential), linearised about the recipe's direction"
    )
    scope = Scope.ARM
    family = "gravity"
    trace = (Trace.POSITION,)
    look_alikes = ("zero_offset", "counterbalance", "coupling", "spring")
    needs_loads = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        if number:
            return ()
        return (
            Parameter("x", "rad", "turn of the base about its x axis", "tilt x", 0.02, -0.5, 0.5),
            Parameter("y", "rad", "turn of the base about its y axis", "tilt y", -0.015, -0.5, 0.5),
        )

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        return np.array(loads_of(samples).tilts)
