"""Whether the arm keeps its distance from forbidden boxes and from itself along a path; distances are MuJoCo's."""

from typing import Any, NamedTuple

import numpy as np

from pumaid.errors import RecipeError, Where, refuse
from pumaid.maths import Floats
from pumaid.robot import Robot, Safety, Sphere
from pumaid.simulation.mujoco_engine import chain
from pumaid.trajectory import in_words

#: m: no path within the margin is called free, and none that stays this far outside it is called a collision.
TOLERANCE = 1e-3
#: m beyond which a distance need not be known.
_FAR = 10.0
#: m, radius that stands for the tip.
_POINT = 1e-6
#: Random postures: a pair that touches in all of them is a fault of the recipe.
_DRAWN = 400
#: rad and m: range of joints without limits in these postures.
_TURN, _SLIDE = (-np.pi, np.pi), (-0.5, 0.5)


class Geometry(NamedTuple):
    """A shape of the MuJoCo model."""

    label: str
    link: int  # 0 for the base
    extent: float = 0.0  # m from the link's origin to its farthest point
    is_box: bool = False


class Collision:
    """The arm's spheres, its tip and the forbidden boxes of a recipe's block `safety`, asked about whole paths.

    Raises
    ------
    RecipeError [safety-always-touching]
        A pair touches in every posture within the limits; a `Faults` where several do.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.safety = robot, robot.safety or Safety()
        self._pairs: list[tuple[Geometry, Geometry]] = []
        if robot.safety is not None:
            self._build()
            self._refuse_what_always_touches()

    @property
    def is_free(self) -> bool:
        """Whether the recipe forbids nothing."""
        return not self._pairs

    def first_hit(self, start: Floats, end: Floats) -> str | None:
        """Where the straight path from `start` to `end` (J,), rad or m, first comes too near; None where it is free.

        One sentence: what comes near to what, and at which joint positions.

        Notes
        -----
        Conservative advancement: from a posture in which all distances are at least d beyond the margin, no point can
        use that up before it has gone d, so the next posture looked at is that far away and nothing is missed.
        """
        if self.is_free:
            return None
        rates, share, margin = self._reach @ np.abs(end - start), 0.0, self.safety.margin
        while True:
            position = start + share * (end - start)
            distance = self.distances(position)
            nearest = int(distance.argmin())
            if distance[nearest] < margin + TOLERANCE:
                outer, inner = self._pairs[nearest]
                return (
                    f"{outer.label} comes nearer to {inner.label} than the margin of {1e3 * margin:.0f} mm where the"
                    f" joints are at {in_words(self.robot, position)}"
                )
            if share >= 1.0:
                return None
            with np.errstate(divide="ignore"):
                share = min(1.0, share + float(np.min((distance - margin) / rates)))

    def first_hit_along(self, path: Floats) -> str | None:
        """The same of a path through many near positions (N, J), straight between two of them."""
        if self.is_free:
            return None
        gone, place = np.cumsum(np.abs(np.diff(path, axis=0, prepend=path[:1])) @ self._reach.T, axis=0), 0
        while place < len(path) - 1:
            room = self.distances(path[place]) - self.safety.margin - TOLERANCE
            ahead = int(np.count_nonzero((gone[place:] - gone[place] <= room).all(axis=1))) - 1
            if ahead < 1:
                ahead, hit = 1, self.first_hit(path[place], path[place + 1])
                if hit is not None:
                    return hit
            place += ahead
        return None

    def distances(self, position: Floats) -> Floats:
        """(P,) m between the P pairs at joint positions (J,), negative where they overlap."""
        import mujoco

        self._data.qpos[:] = position
        mujoco.mj_kinematics(self._model, self._data)
        return np.array(
            [mujoco.mj_geomDistance(self._model, self._data, *pair, _FAR, None) for pair in self._geometries]
        )

    def _build(self) -> None:
        """The MuJoCo model: a chain of bodies with the recipe's shapes on them, and the pairs that are checked."""
        import mujoco

        safety, last = self.safety, self.robot.n_joints
        spec, bodies = chain(self.robot, [{"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}] * last)
        shapes = list[Geometry]()
        for number, sphere in enumerate([Sphere(last, safety.tool or (0.0, 0.0, 0.0), _POINT), *safety.spheres]):
            bodies[sphere.link].add_geom(name=str(len(shapes)), pos=sphere.centre, size=[sphere.radius, 0, 0])
            label = f"sphere {number} of {f'link {sphere.link}' if sphere.link else 'the base'}"
            shapes.append(
                Geometry(
                    label if number else "the tip", sphere.link, float(np.linalg.norm(sphere.centre)) + sphere.radius
                )
            )
        for box in safety.boxes:
            low, high = np.array(box.low), np.array(box.high)
            spec.worldbody.add_geom(
                name=str(len(shapes)), type=mujoco.mjtGeom.mjGEOM_BOX, pos=(low + high) / 2, size=(high - low) / 2
            )
            shapes.append(Geometry(f"the box '{box.name}'", 0, is_box=True))
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        geometry = [self._model.geom(str(number)).id for number in range(len(shapes))]
        # Moving shapes with boxes, and spheres with those of links that are not adjacent; without a stated tool the tip
        # is the wrist's centre, which lies inside the wrist's own sphere.
        pairs = [
            (first, second)
            for first, outer in enumerate(shapes)
            for second, inner in enumerate(shapes)
            if (inner.is_box and outer.link)
            or (
                outer.link > inner.link + 1 and (inner.link, outer.link) not in safety.ignore and (safety.tool or first)
            )
        ]
        self._pairs = [(shapes[first], shapes[second]) for first, second in pairs]
        self._geometries = [(geometry[first], geometry[second]) for first, second in pairs]
        self._reach = np.array([self._lever(*pair) for pair in self._pairs])

    def _lever(self, outer: Geometry, inner: Geometry) -> Floats:
        """(J,) m a rad, or m a m: how far each joint takes the outer shape at most, seen from the inner one."""
        out, length = np.zeros(self.robot.n_joints), outer.extent
        for joint in reversed(self.robot.joints[inner.link : outer.link]):
            out[joint.number - 1] = length if joint.is_revolute else 1.0
            slide = 0.0 if joint.is_revolute else float(np.max(np.abs(joint.limits or _SLIDE)))
            length += float(np.linalg.norm(joint.frame[:3, 3])) + slide
        return out

    def _refuse_what_always_touches(self) -> None:
        joints, margin, faults = self.robot.joints, self.safety.margin, []
        low, high = np.transpose([joint.limits or (_TURN if joint.is_revolute else _SLIDE) for joint in joints])
        rng = np.random.default_rng(0)
        distance = np.array([self.distances(position) for position in rng.uniform(low, high, (_DRAWN, len(low)))])
        for pair in np.flatnonzero((distance < margin).all(axis=0)):
            outer, inner = self._pairs[pair]
            what = (
                f"{outer.label} is nearer to {inner.label} than the margin of {1e3 * margin:.0f} mm in all of {_DRAWN}"
                " random postures within the limits, so no posture is allowed"
            )
            mend = f"make the spheres smaller, or add {[inner.link, outer.link]} to safety.ignore"
            if inner.is_box:
                mend = "make the box smaller; a sphere that does not move belongs to link 0, which may stand in a box"
            faults.append(RecipeError("safety-always-touching", what, Where(file=self.robot.origin or None), mend))
        refuse(faults)
