"""The answer to "may the arm go there": struck or free, how near, and in words what touches what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance.contacts import Contacts
from pumaid.clearance.paths import Route, straight, trapezoids
from pumaid.clearance.search import Nearest, nearest
from pumaid.errors import Faults, RecipeError, Where
from pumaid.robot import Robot, Safety
from pumaid.units import factor

Floats = NDArray[np.float64]

#: m: a path that comes this near to its margin may be called struck; no path within its margin is called free.
TOLERANCE = 1e-3
#: Postures, drawn within the limits, after which a contact that touches in all of them is the recipe's fault.
_DRAWN = 400
#: rad and m: how far joints without limits are taken to go when postures are drawn.
_TURN, _SLIDE = np.pi, 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Clearance:
    """What of an arm must not touch what, ready to be asked about paths.

    Paths are those of all joints moving together, from `starts` to `ends` (K, J), rad or m, each joint at its own
    constant speed, unless a `Route` is given. Whole paths are judged: between the postures looked at, bounds on how far
    each point can go show that nothing is missed.
    """

    contacts: Contacts
    safety: Safety

    @classmethod
    def of(cls, robot: Robot) -> Clearance:
        """What the recipe's block `safety` asks for.

        Raises
        ------
        RecipeError [safety-always-touching]
            Something touches in every posture within the joints' limits, so that the arm could not move at all.
        Faults
            Several do.
        """
        found = cls(Contacts.of(robot), robot.safety or Safety())
        if not found.is_free:
            found._refuse_what_always_touches()
        return found

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.contacts.robot

    @property
    def is_free(self) -> bool:
        """Whether the recipe forbids nothing."""
        return len(self.contacts) == 0

    def struck(self, starts: Floats, ends: Floats) -> NDArray[np.bool_]:
        """(K,) whether each path comes nearer to something than the recipe's margin.

        A path that keeps between the margin and 1 mm more may be called struck too.
        """
        return self.struck_along(straight(starts, ends), len(np.atleast_2d(starts)))

    def gap(self, starts: Floats, ends: Floats) -> Floats:
        """(K,) least distance along each path, m, negative inside; at most 1 mm above the true one, inf if free."""
        return self.gap_along(straight(starts, ends), len(np.atleast_2d(starts)))

    def struck_moves(self, starts: Floats, ends: Floats, *, speeds: Floats, accelerations: Floats) -> NDArray[np.bool_]:
        """(K,) as `struck`, for moves that may be driven straight or with each joint by its own trapezoid of speed.

        Controllers differ in this, and the virtual robot drives the second; a move is free only where both are.

        Parameters
        ----------
        starts, ends
            (K, J) rad or m.
        speeds, accelerations
            (J,) of the trapezoids, rad/s and rad/s2, or m/s and m/s2.
        """
        bent = trapezoids(starts, ends, speeds=speeds, accelerations=accelerations)
        return self.struck(starts, ends) | self.struck_along(bent, len(np.atleast_2d(starts)))

    def explain(self, start: Floats, end: Floats) -> str:
        """What comes nearest on the path from `start` (J,) to `end` (J,), how near, and where; one sentence."""
        return self.explain_along(straight(np.asarray(start)[None], np.asarray(end)[None]))

    def struck_along(self, path: Route, count: int) -> NDArray[np.bool_]:
        """As `struck`, for `count` paths of any course on which each joint goes one way only."""
        if self.is_free:
            return np.zeros(count, dtype=bool)
        margin = self.safety.margin
        found = nearest(self.contacts, path, count=count, tolerance=TOLERANCE, threshold=margin)
        return np.asarray(found.distance < margin + TOLERANCE)

    def gap_along(self, path: Route, count: int) -> Floats:
        """As `gap`, for `count` paths of any course on which each joint goes one way only."""
        return np.full(count, np.inf) if self.is_free else self._nearest(path, count).distance

    def explain_along(self, path: Route, which: int = 0) -> str:
        """As `explain`, for path number `which` (from 0) of some."""
        if self.is_free:
            return "the recipe forbids nothing"
        only = np.array([which], dtype=np.intp)
        found = self._nearest(lambda chosen, share: path(only[chosen], share), 1)
        posture = path(only, found.share)[0]
        moved = np.abs(path(only, np.ones(1)) - path(only, np.zeros(1)))[0] > 0.0
        contact = int(found.contact[0])
        return f"{self._told(contact, float(found.distance[0]))} {self._when(posture, moved, contact)}"

    def _nearest(self, path: Route, count: int) -> Nearest:
        return nearest(self.contacts, path, count=count, tolerance=TOLERANCE)

    def _told(self, contact: int, distance: float) -> str:
        one, other = self._parties(contact)
        near, margin = f"{1e3 * abs(distance):.0f} mm", self.safety.margin
        if distance < 0.0:
            return f"{one} enters {other} by {near}"
        left = f", nearer than the margin of {1e3 * margin:.0f} mm," if distance < margin else ""
        return f"{one} comes within {near} of {other}{left}"

    def _parties(self, contact: int) -> tuple[str, str]:
        table = self.contacts
        box = int(table.box[contact])
        one = self._named(int(table.carried[contact]))
        return one, f"the box '{self.safety.boxes[box].name}'" if box >= 0 else self._named(int(table.other[contact]))

    def _named(self, point: int) -> str:
        if point == 0:
            return "the tip"
        link = self.safety.spheres[point - 1].link
        return f"sphere {point} of {f'link {link}' if link else 'the base'}"

    def _when(self, posture: Floats, moved: NDArray[np.bool_], contact: int) -> str:
        """Where the joints are: the one that moves, or all of them; or that the ones that move are not to blame."""
        reach = slice(self.contacts.inner[contact], self.contacts.links[self.contacts.carried[contact]])
        shown = [
            f"{value / factor('deg') + 0.0:.4g} deg" if joint.is_revolute else f"{value:.4g} m"
            for joint, value in zip(self.robot.joints, posture, strict=True)
        ]
        if not moved[reach].any():
            return f"on the whole way, the joints being at {', '.join(shown)}"
        if moved.sum() == 1:
            joint = self.robot.joints[int(moved.argmax())]
            return f"when joint {joint.number} ({joint.name}) is at {shown[joint.number - 1]}"
        return f"when the joints are at {', '.join(shown)}"

    def _refuse_what_always_touches(self) -> None:
        low, high = np.array(
            [
                joint.limits or ((-_TURN, _TURN) if joint.is_revolute else (-_SLIDE, _SLIDE))
                for joint in self.robot.joints
            ]
        ).T
        drawn = np.random.default_rng(0)
        distance = self.contacts.distances(drawn.uniform(low, high, (_DRAWN, len(low))))
        always = np.flatnonzero((distance < self.safety.margin).all(axis=0))
        faults = [self._fault(int(contact), float(distance[:, contact].max())) for contact in always]
        if faults:
            raise faults[0] if len(faults) == 1 else Faults(faults)

    def _fault(self, contact: int, farthest: float) -> RecipeError:
        one, other = self._parties(contact)
        table = self.contacts
        if farthest < 0.0:
            always = f"{one} is at least {-1e3 * farthest:.0f} mm inside {other}"
        else:
            margin = 1e3 * self.safety.margin
            always = f"{one} is never farther than {1e3 * farthest:.0f} mm from {other} (margin {margin:.0f} mm)"
        what = f"{always} in {_DRAWN} postures drawn within the limits, so that none is allowed"
        if table.box[contact] >= 0:
            mend = "make the box smaller; a sphere that does not move belongs to link 0, which boxes do not mind"
            return RecipeError("safety-always-touching", what, Where(file=self.robot.origin or None), mend)
        links = sorted(int(table.links[point]) for point in (table.carried[contact], table.other[contact]))
        mend = f"make the spheres smaller, or add {links} to safety.ignore if these links cannot hurt each other"
        return RecipeError("safety-always-touching", what, Where(file=self.robot.origin or None), mend)
