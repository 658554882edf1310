"""What could touch what: the arm's points and spheres, their distances, and how much these can change nearby."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.kinematics import frames
from pumaid.robot import Robot, Safety, Sphere

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """The arm in N postures, each with room around it in which every joint may be.

    Attributes
    ----------
    distance
        (N, P) m between the two of each contact, negative where they overlap.
    spread
        (N, P) m by which that distance can be less within the room; a bound of first order.
    """

    distance: Floats
    spread: Floats
    _normal: Floats  # (N, P, 3) where the distance grows fastest
    _lever: Floats  # (N, J, M, 3) m/rad, what a turn of joint j does to point m; 0 for joints that do not carry it
    _bend: Floats  # (N, J + 1, M) m, what the lever's own change adds at most, seen from each link
    _room: Floats  # (N, J)

    def finer(self, rows: Ints, contacts: Ints, table: Contacts) -> Floats:
        """(F,) m, as `spread`, of second order: motion along the surface brings nothing nearer.

        Both distances, to a box and between centres, are convex functions of the point, so the tangent at the posture
        is below them: distance >= distance here + normal . (point - point here).
        """
        carried, inner = table.carried[contacts], table.inner[contacts]
        nearing = np.abs(np.einsum("fja,fa->fj", self._lever[rows, :, carried], self._normal[rows, contacts]))
        between = np.arange(nearing.shape[1]) >= inner[:, None]
        return (nearing * between * self._room[rows]).sum(axis=1) + self._bend[rows, inner, carried]


@dataclass(frozen=True, eq=False, slots=True)
class Contacts:
    """Pairs that are held against each other: point and box, or sphere and sphere of links that are not neighbours.

    Points are the tip (number 0, no extent) and the spheres in the recipe's order. `carried` (P,) is each contact's
    outer point, `other` (P,) the inner one or -1, `box` (P,) or -1, `inner` (P,) the link from which it is seen.
    """

    robot: Robot
    links: Ints
    centres: Floats
    radii: Floats
    low: Floats
    high: Floats
    carried: Ints
    other: Ints
    box: Ints
    inner: Ints

    @classmethod
    def of(cls, robot: Robot) -> Contacts:
        """Every contact that can change as the arm moves."""
        safety = robot.safety or Safety()
        tip = Sphere(robot.n_joints, safety.tool or (0.0, 0.0, 0.0), 0.0)
        points = (tip, *safety.spheres)
        found = [(m, -1, b, 0) for m, one in enumerate(points) if one.link > 0 for b in range(len(safety.boxes))]
        for m, one in enumerate(points):
            for k, two in enumerate(points[:m]):
                # A tip that the recipe does not state is often the wrist's centre, inside the wrist's own sphere.
                if (k or safety.tool is not None) and _may_meet(one.link, two.link, safety):
                    outer, inner = (m, k) if one.link > two.link else (k, m)
                    found.append((outer, inner, -1, points[inner].link))
        columns = np.array(found, dtype=np.intp).reshape(-1, 4).T
        return cls(
            robot,
            np.array([one.link for one in points], dtype=np.intp),
            np.array([one.centre for one in points], dtype=float),
            np.array([one.radius for one in points], dtype=float),
            np.array([box.low for box in safety.boxes], dtype=float).reshape(-1, 3),
            np.array([box.high for box in safety.boxes], dtype=float).reshape(-1, 3),
            *columns,
        )

    def __len__(self) -> int:
        return len(self.carried)

    def view(self, position: Floats, room: Floats) -> View:
        """The arm at (N, J) positions, each joint at most (N, J) `room` from there."""
        rotations, joints = self._frames(position)
        points = joints[:, self.links] + np.einsum("nmab,mb->nma", rotations[:, self.links], self.centres)
        lever = self._lever(rotations[:, 1:, :, 2], points[:, None] - joints[:, 1:, None])
        reach, bend = self._reach(lever, room)
        distance, normal = self._distances(points)
        return View(distance, reach[:, self.inner, self.carried], normal, lever, bend, room)

    def distances(self, position: Floats) -> Floats:
        """(N, P) m at (N, J) positions."""
        return self._distances(self.points(position))[0]

    def points(self, position: Floats) -> Floats:
        """(N, M, 3) m: the tip and the centres of the spheres in base axes."""
        rotations, joints = self._frames(position)
        return joints[:, self.links] + np.einsum("nmab,mb->nma", rotations[:, self.links], self.centres)

    def _frames(self, position: Floats) -> tuple[Floats, Floats]:
        """(N, J+1, 3, 3) rotations and (N, J+1, 3) origins, the base first."""
        robot = self.robot
        angles, shifts = robot.dh_angles(position), robot.dh_displacements(position)
        turned, placed = frames(robot.alphas, robot.lengths, offsets=shifts, thetas=angles)
        base = np.broadcast_to(np.eye(3), (len(position), 1, 3, 3))
        rotations = np.concatenate([base, turned], axis=1)
        joints = np.concatenate([np.zeros((len(position), 1, 3)), placed], axis=1)
        return rotations, joints

    def _lever(self, axis: Floats, arm: Floats) -> Floats:
        """(N, J, M, 3): z_j x (p_m - o_j) of a turning joint, z_j of a sliding one."""
        z = np.broadcast_to(axis[:, :, None], arm.shape)
        moved = np.where(self.robot.is_revolute[:, None, None], np.cross(z, arm), z)
        carries = np.arange(1, self.robot.n_joints + 1)[:, None] <= self.links
        return np.asarray(moved * carries[..., None])

    def _reach(self, lever: Floats, room: Floats) -> tuple[Floats, Floats]:
        """(N, J+1, M) each, m: how far a point can go as seen from link k, and how far off its tangent.

        From the tip inward: what the joints beyond j do keeps its length when joint j turns it; and turning the point
        where it is now takes it at most room_j times its distance from the axis. Its second derivatives are
        z_i x (z_j x r) for i <= j, no longer than r is far from axis j, which the joints beyond may have made more.
        """
        size = np.linalg.norm(lever, axis=3)
        reach, bend = np.zeros((2, len(room), self.robot.n_joints + 1, len(self.links)))
        swept = np.zeros(bend[:, 0].shape)  # sum over the joints beyond of room times the farthest distance
        for j in reversed(range(self.robot.n_joints)):
            turns, mine = self.robot.is_revolute[j], room[:, j, None]
            beyond = reach[:, j + 1]
            reach[:, j] = beyond + mine * size[:, j]
            own = mine * (size[:, j] + beyond) if turns else mine * size[:, j]
            bend[:, j] = bend[:, j + 1] + (mine * (0.5 * own + swept) if turns else 0.0)
            swept = swept + own
        return reach, bend

    def _distances(self, points: Floats) -> tuple[Floats, Floats]:
        """(N, P) m and (N, P, 3) directions."""
        distance = np.empty((len(points), len(self)))
        normal = np.empty((len(points), len(self), 3))
        of_box = self.box >= 0
        for chosen, measured in ((of_box, self._from_boxes), (~of_box, self._from_spheres)):
            distance[:, chosen], normal[:, chosen] = measured(points, chosen)
        return distance, normal

    def _from_boxes(self, points: Floats, chosen: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        low, high = self.low[self.box[chosen]], self.high[self.box[chosen]]
        away = points[:, self.carried[chosen]] - 0.5 * (low + high)
        past = np.abs(away) - 0.5 * (high - low)  # m outside each pair of faces
        outside, deepest = np.maximum(past, 0.0), past.max(axis=2)
        size = np.linalg.norm(outside, axis=2)
        inside = np.arange(3) == past.argmax(axis=2)[..., None]
        way = np.where(size[..., None] > 0, outside / np.where(size > 0, size, 1.0)[..., None], inside)
        signed = np.where(size > 0, size, deepest) - self.radii[self.carried[chosen]]
        return signed, way * np.where(away < 0, -1.0, 1.0)

    def _from_spheres(self, points: Floats, chosen: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        outer, inner = self.carried[chosen], self.other[chosen]
        apart = points[:, outer] - points[:, inner]
        size = np.linalg.norm(apart, axis=2)
        return size - self.radii[outer] - self.radii[inner], apart / np.where(size > 0, size, 1.0)[..., None]


def _may_meet(one: int, two: int, safety: Safety) -> bool:
    """Whether spheres of two links are held against each other: neighbours touch in every posture."""
    return abs(one - two) > 1 and (min(one, two), max(one, two)) not in safety.ignore
