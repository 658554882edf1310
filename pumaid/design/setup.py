"""The arm as it will stand during an experiment: its base tilted, a payload in its hand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError
from pumaid.robot import Robot
from pumaid.simulation.draw import draw
from pumaid.simulation.links import Links
from pumaid.simulation.recursion import Constants, constants
from pumaid.simulation.truth import Truth
from pumaid.units import factor, number

Floats = NDArray[np.float64]

#: kg and m of a payload at most: beyond what any arm carries, and far from where numbers overflow.
_HEAVIEST, _FARTHEST = 1e5, 100.0


@dataclass(frozen=True, slots=True)
class Setup:
    """What is done to an arm before it runs.

    Attributes
    ----------
    tilt
        rad by which the base is turned about its own x axis, then about the y axis that it had upright, or none.
    payload
        kg, and x, y, z (m) in the last link's frame where its centre is, or none.

    Raises
    ------
    ModelError [plan-impossible]
        A number is not finite, or a payload weighs nothing, or more or farther out than any arm carries.
    """

    tilt: tuple[float, float] | None = None
    payload: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        for what, numbers in (("tilt", self.tilt), ("payload", self.payload)):
            if numbers is not None and not np.all(np.isfinite(numbers)):
                given = ", ".join(f"{one:g}" for one in numbers)
                raise ModelError("plan-impossible", f"a {what} of {given} is none", mend="give finite numbers")
        if self.payload is not None and not self.payload[0] > 0.0:
            what = f"a payload of {self.payload[0]:g} kg shows nothing"
            raise ModelError("plan-impossible", what, mend="give its mass in kg")
        if self.payload is not None and not (
            self.payload[0] <= _HEAVIEST and max(map(abs, self.payload[1:])) <= _FARTHEST
        ):
            mass, *at = (f"{one:g}" for one in self.payload)
            what = f"no arm carries {mass} kg at ({', '.join(at)}) m of its last link's frame"
            mend = f"give at most {_HEAVIEST:g} kg, and {_FARTHEST:g} m along each axis"
            raise ModelError("plan-impossible", what, mend=mend)

    def robot(self, robot: Robot) -> Robot:
        """The arm with gravity as its tilted base sees it.

        Parameters
        ----------
        robot
            As it usually stands.
        """
        if self.tilt is None:
            return robot
        x, y = self.tilt
        about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
        about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        turned = (about_y @ about_x).T @ np.asarray(robot.gravity)
        a, b, c = (round(float(part), 9) + 0.0 for part in turned)
        return replace(robot, gravity=(a, b, c))

    def loaded(self, truth: Truth) -> Truth:
        """An assumed robot with the payload.

        Parameters
        ----------
        truth
            Without it. Where only its constants in amperes are known, its last motor is taken to be of a usual size,
            the others by their ratios.
        """
        if self.payload is None:
            return truth
        mass, *at = self.payload
        if truth.links is not None:
            links = truth.links
            whole = links.mass.copy()
            whole[-1] += mass
            centre = links.centre.copy()
            centre[-1] = (links.mass[-1] * links.centre[-1] + mass * np.array(at)) / whole[-1]
            return replace(truth, links=Links(whole, centre))
        assert truth.known is not None
        n = truth.robot.n_joints
        at_end = Links(np.append(np.zeros(n - 1), mass), np.vstack([np.zeros((n - 1, 3)), at]))
        more = constants(truth.robot, at_end, self._gain(truth, truth.known))
        x, y, heavy = truth.known.x + more.x, truth.known.y + more.y, truth.known.mass + more.mass
        return replace(truth, known=replace(truth.known, x=x, y=y, mass=heavy))

    @staticmethod
    def _gain(truth: Truth, known: Constants) -> Floats:
        """(J,) A/(N m) or A/N: the last motor's of a usual size and with the sign of its friction, others by ratios."""
        usual = draw(truth.robot, 0)
        assert usual.gain is not None
        last = np.copysign(usual.gain[-1], truth.friction.coulomb_plus[-1])
        return np.asarray(last * np.append(np.cumprod(known.ratio[::-1])[::-1], 1.0))

    def told(self) -> tuple[str, ...]:
        """Sentences on what must be done before the plan is run."""
        out = []
        if self.tilt is not None:
            x, y = (number(part / factor("deg"), 3) for part in self.tilt)
            out.append(
                f"The base stands tilted by {x} deg about its x and {y} deg about its y axis; identify these runs with"
                " a recipe whose gravity says so."
            )
        if self.payload is not None:
            mass, *at = self.payload
            x, y, z = (number(part, 3) for part in at)
            out.append(
                f"The last link carries {number(mass, 3)} kg at ({x}, {y}, {z}) m of its frame; gravity parameters"
                " are those of the arm with it, ratios those of the bare arm."
            )
        return tuple(out)
