"""Whether the arm keeps its distance from forbidden boxes and from itself along a path; distances are MuJoCo's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Faults, RecipeError, Where
from pumaid.robot import Robot, Safety, Sphere
from pumaid.trajectory import in_words

Floats = NDArray[np.float64]

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


@dataclass(frozen=True, slots=True)
class Hit:
    """Where a path comes too near: joint positions (J,) rad or m, the distance (m), and the pair in words."""

    position: Floats
    distance: float
    first: str
    second: str


@dataclass(frozen=True, slots=True)
class _Body:
    """A geometry of the MuJoCo model: its number, its link (0 for the base), how it is named, its extent (m)."""

    number: int
    link: int
    label: str
    extent: float
    is_box: bool = False


class Collision:
    """The arm's spheres, its tip and the forbidden boxes of a recipe's block `safety`, asked about whole paths.

    Raises
    ------
    RecipeError [safety-always-touching]
        A pair touches in every posture within the limits; a `Faults` where several do.

    Notes
    -----
    Paths are checked by conservative advancement: from a posture in which all distances are at least d beyond the
    margin, no point can use that up before it has gone d, so the next posture looked at is that far away. Nothing
    between two postures is missed.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot, self.safety = robot, robot.safety or Safety()
        self._pairs: list[tuple[_Body, _Body]] = []
        if robot.safety is not None:
            self._build()
            self._refuse_what_always_touches()

    @property
    def is_free(self) -> bool:
        """Whether the recipe forbids nothing."""
        return not self._pairs

    def first_hit(self, start: Floats, end: Floats) -> Hit | None:
        """Where the straight path from `start` to `end` (J,), rad or m, first comes too near; None where it is free."""
        if self.is_free:
            return None
        rates, share, margin = self._reach @ np.abs(end - start), 0.0, self.safety.margin
        while True:
            position = start + share * (end - start)
            distance = self.distances(position)
            nearest = int(distance.argmin())
            if distance[nearest] < margin + TOLERANCE:
                first, second = self._pairs[nearest]
                return Hit(position, float(distance[nearest]), first.label, second.label)
            if share >= 1.0:
                return None
            with np.errstate(divide="ignore"):
                share = min(1.0, share + float(np.min((distance - margin) / rates)))

    def describe(self, hit: Hit) -> str:
        """One sentence: what comes near to what, and at which joint positions."""
        margin = 1e3 * self.safety.margin
        return (
            f"{hit.first} comes nearer to {hit.second} than the margin of {margin:.0f} mm where the joints are at"
            f" {in_words(self.robot, hit.position)}"
        )

    def distances(self, position: Floats) -> Floats:
        """(P,) m between the P pairs at joint positions (J,), negative where they overlap."""
        import mujoco

        self._data.qpos[:] = position
        mujoco.mj_kinematics(self._model, self._data)
        measure, model, data = mujoco.mj_geomDistance, self._model, self._data
        return np.array([measure(model, data, a.number, b.number, _FAR, None) for a, b in self._pairs])

    def _build(self) -> None:
        """The MuJoCo model: a chain of bodies with the recipe's shapes on them."""
        import mujoco

        spec, safety = mujoco.MjSpec(), self.safety
        bodies = [spec.worldbody]
        for joint in self.robot.joints:
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, joint.frame[:3, :3].ravel())
            body = bodies[-1].add_body(pos=joint.frame[:3, 3], quat=quaternion)
            kind = mujoco.mjtJoint.mjJNT_HINGE if joint.is_revolute else mujoco.mjtJoint.mjJNT_SLIDE
            body.add_joint(type=kind, axis=[0, 0, 1])
            body.mass, body.inertia = 1.0, [1.0, 1.0, 1.0]  # a moving body must have some
            bodies.append(body)
        tip = Sphere(self.robot.n_joints, safety.tool or (0.0, 0.0, 0.0), _POINT)
        ball, block = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
        spheres = [tip, *safety.spheres]
        shapes = []
        for number, sphere in enumerate(spheres):
            bodies[sphere.link].add_geom(name=f"s{number}", type=ball, pos=sphere.centre, size=[sphere.radius, 0, 0])
        for number, box in enumerate(safety.boxes):
            low, high = np.array(box.low), np.array(box.high)
            spec.worldbody.add_geom(name=f"b{number}", type=block, pos=(low + high) / 2, size=(high - low) / 2)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        for number, sphere in enumerate(spheres):
            link = f"link {sphere.link}" if sphere.link else "the base"
            label = f"sphere {number} of {link}" if number else "the tip"
            extent = float(np.linalg.norm(sphere.centre)) + sphere.radius
            shapes.append(_Body(self._model.geom(f"s{number}").id, sphere.link, label, extent))
        for number, box in enumerate(safety.boxes):
            shapes.append(_Body(self._model.geom(f"b{number}").id, 0, f"the box '{box.name}'", 0.0, is_box=True))
        self._pairs = [
            (outer, inner) for outer in shapes for inner in shapes if self._may_meet(outer, inner, tip=shapes[0])
        ]
        self._reach = np.array([self._lever(outer, inner) for outer, inner in self._pairs])

    def _may_meet(self, outer: _Body, inner: _Body, *, tip: _Body) -> bool:
        """Whether a pair is checked: spheres of moving links with boxes, and with spheres of links not adjacent."""
        if outer.is_box or outer.link == 0:
            return False
        if inner.is_box:
            return True
        # Without a stated tool the tip is the wrist's centre, which lies inside the wrist's own sphere.
        is_stated = self.safety.tool is not None or tip not in (outer, inner)
        return is_stated and outer.link > inner.link + 1 and (inner.link, outer.link) not in self.safety.ignore

    def _lever(self, outer: _Body, inner: _Body) -> Floats:
        """(J,) m a rad, or m a m: how far each joint takes the outer shape at most, seen from the inner one."""
        out, length = np.zeros(self.robot.n_joints), outer.extent
        for joint in reversed(self.robot.joints[inner.link : outer.link]):
            out[joint.number - 1] = length if joint.is_revolute else 1.0
            slide = 0.0 if joint.is_revolute else float(np.max(np.abs(joint.limits or _SLIDE)))
            length += float(np.linalg.norm(joint.frame[:3, 3])) + slide
        return out

    def _refuse_what_always_touches(self) -> None:
        joints = self.robot.joints
        low, high = np.transpose([joint.limits or (_TURN if joint.is_revolute else _SLIDE) for joint in joints])
        rng = np.random.default_rng(0)
        distance = np.array([self.distances(position) for position in rng.uniform(low, high, (_DRAWN, len(low)))])
        always = np.flatnonzero((distance < self.safety.margin).all(axis=0))
        if faults := [self._fault(*self._pairs[pair]) for pair in always]:
            raise faults[0] if len(faults) == 1 else Faults(faults)

    def _fault(self, outer: _Body, inner: _Body) -> RecipeError:
        margin = 1e3 * self.safety.margin
        what = (
            f"{outer.label} is nearer to {inner.label} than the margin of {margin:.0f} mm in all of {_DRAWN} random"
            " postures within the limits, so no posture is allowed"
        )
        mend = f"make the spheres smaller, or add {[inner.link, outer.link]} to safety.ignore"
        if inner.is_box:
            mend = "make the box smaller; a sphere that does not move belongs to link 0, which may stand in a box"
        return RecipeError("safety-always-touching", what, Where(file=self.robot.origin or None), mend)
