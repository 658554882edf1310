"""What the weight of a virtual arm draws in every joint, also with its base turned or something in its hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pumaid.errors import ModelError
from pumaid.robot import Robot
from pumaid.simulation.links import Links, gravity_load, side_load
from pumaid.simulation.recursion import Constants, gravity_current
from pumaid.simulation.shafts import borne

Floats = NDArray[np.float64]

#: Answers that a weight remembers: those of one instant, a sagging drive's rounds included.
MOST_RECALLED = 256


@dataclass(frozen=True, eq=False)
class Weight:
    """Gravity's currents: from masses and gains where they are known, else from the paper's constants.

    Attributes
    ----------
    robot
        Geometry and the direction of gravity.
    links, gain
        Masses and centres; (J,) A/(N m) or A/N; or neither.
    known
        Constants in amperes, or none where `links` say it.
    """

    robot: Robot
    links: Links | None = None
    gain: Floats | None = None
    known: Constants | None = None

    def current(self, position: Floats) -> Floats:
        """(N, J) A that carry the weight at `position` (N, J), rad or m.

        Where gears couple joints, a motor carries what reaches it of the loads of joints beyond; constants in amperes
        know nothing of that.
        """
        if self.links is not None and self.gain is not None:
            return borne(self.robot, gravity_load(self.robot, self.links, position)) * self.gain
        assert self.known is not None
        return gravity_current(self.robot, self.known, position)

    def turned(self, x: float, y: float) -> Weight:
        """The same arm with its base turned by `x` and `y` (rad) about its own axes."""
        seen = Rotation.from_rotvec([x, y, 0.0]).inv().apply(np.asarray(self.robot.gravity, dtype=float)).tolist()
        robot = replace(self.robot, gravity=(seen[0], seen[1], seen[2]))
        return Weight(robot, self.links, self.gain, self.known)

    def loaded(self, mass: float, place: tuple[float, float, float]) -> Weight:
        """The same arm with `mass` (kg) more on its last link, at `place` (m, in that link's frame)."""
        links, _ = self._masses()
        total = links.mass.copy()
        total[-1] += mass
        centre = links.centre.copy()
        centre[-1] = (links.mass[-1] * centre[-1] + mass * np.array(place)) / total[-1]
        return Weight(self.robot, Links(total, centre), self.gain, self.known)

    def across(self, position: Floats) -> Floats:
        """(N, J) A: what the moment across each turning joint's axis would draw if it lay along it; 0 for sliding."""
        links, gain = self._masses()
        return side_load(self.robot, links, position) * np.abs(gain)

    def _masses(self) -> tuple[Links, Floats]:
        if self.links is None or self.gain is None:
            what = f"{self.robot.name} is known by its constants in amperes alone, and this effect needs its masses"
            raise ModelError("hide-wrong", what, mend="leave out --truth table1, or give a truth with masses")
        return self.links, self.gain


class Recalled(Weight):
    """A weight that remembers what it was last asked: many joints' laws look at the same postures."""

    @classmethod
    def of(cls, weight: Weight) -> Recalled:
        """The same arm."""
        return cls(weight.robot, weight.links, weight.gain, weight.known)

    @cached_property
    def _known(self) -> dict[tuple[str, bytes], Floats]:
        return {}

    @cached_property
    def _others(self) -> dict[tuple[object, ...], Weight]:
        return {}

    def current(self, position: Floats) -> Floats:
        """As of `Weight`; not to be written to."""
        return self._recalled("current", super().current, position)

    def across(self, position: Floats) -> Floats:
        """As of `Weight`; not to be written to."""
        return self._recalled("across", super().across, position)

    def turned(self, x: float, y: float) -> Weight:
        """As of `Weight`, remembering too."""
        key = ("turned", x, y)
        if key not in self._others:
            self._others[key] = Recalled.of(super().turned(x, y))
        return self._others[key]

    def loaded(self, mass: float, place: tuple[float, float, float]) -> Weight:
        """As of `Weight`, remembering too."""
        key = ("loaded", mass, place)
        if key not in self._others:
            self._others[key] = Recalled.of(super().loaded(mass, place))
        return self._others[key]

    def _recalled(self, what: str, asked: Callable[[Floats], Floats], position: Floats) -> Floats:
        key = (what, position.tobytes())
        if key not in self._known:
            if len(self._known) >= MOST_RECALLED:
                self._known.clear()
            self._known[key] = asked(position)
        return self._known[key]
