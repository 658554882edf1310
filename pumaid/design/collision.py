"""Whether the arm keeps clear of the floor, forbidden boxes and itself along a path; distances are MuJoCo's."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from pumaid.errors import RecipeError, Where, refuse
from pumaid.maths import Counts, Floats
from pumaid.robot import Capsule, Robot, Safety
from pumaid.simulation.mujoco_engine import chain, engine
from pumaid.trajectory import in_words

#: m: no path within the margin is called free, and none that stays this far outside it is called a collision.
TOLERANCE = 1e-3
#: m beyond which a distance need not be known.
_FAR = 10.0
#: The tip, and the radius (m) that stands for it.
_TIP, _POINT, _FLOOR = "the tip", 1e-6, "the floor"
#: Positions of a path that are looked ahead; share of a straight one after which a pair is looked at with others.
_AHEAD, _SOON = 48, 0.005
#: Random postures: a pair that touches in all of them is a fault of the recipe.
_DRAWN = 400
#: rad and m: range of joints without limits in these postures.
_TURN, _SLIDE = (-np.pi, np.pi), (-0.5, 0.5)


class Geometry(NamedTuple):
    """A shape of the MuJoCo model."""

    label: str
    link: int  # 0 for the base
    extent: float = 0.0  # m from the link's origin to its farthest point
    stands: bool = False  # a box or the floor


class Collision:
    """The arm's shapes, its tip, the floor and the boxes of a recipe's block `safety`, asked about whole paths.

    `spare` (m) is added to the margin: a plan is made with the tolerance to spare, so that its check finds nothing.
    `touching` are the labels of pairs that capsules make touch in every posture, and that are therefore left out.

    Raises
    ------
    RecipeError [safety-always-touching]
        A pair touches in every posture within the limits; a `Faults` where several do.
    """

    def __init__(self, robot: Robot, *, spare: float = 0.0) -> None:
        self.robot, self.safety = robot, robot.safety or Safety()
        self.margin = self.safety.margin + spare
        self._pairs: list[tuple[Geometry, Geometry]] = []
        self.touching: list[str] = []
        if robot.safety is not None:
            self._build()
            self._leave_out_what_always_touches()

    @property
    def is_free(self) -> bool:
        """Whether the recipe forbids nothing."""
        return not self._pairs

    @property
    def sentence(self) -> str:
        """What a plan keeps clear of, and how to change it."""
        safety, links = self.safety, range(self.robot.n_joints + 1)
        if self.robot.safety is None:
            lines = f"{{floor: 0, links: {{{', '.join(f'{link}: 0.06' for link in links)}}}}}"
            return (
                "Collisions are not checked: the recipe has no block safety. Look at each posture before it is run, or"
                f" add a line with your table's height and your links' radii in m: safety: {lines}."
            )
        if self.is_free:
            return "The recipe's block safety forbids nothing: collisions are not checked."
        what = [
            *([] if safety.floor is None else [f"the floor at {safety.floor:g} m"]),
            *(f"the box '{box.name}'" for box in safety.boxes),
            *(["the arm itself"] if any(not inner.stands for _, inner in self._pairs) else []),
        ]
        named = sorted({outer.link for outer, _ in self._pairs if outer.label != _TIP})
        shapes = f"The tip{' and links ' + ', '.join(map(str, named)) if named else ''}"
        touching = ", ".join(dict.fromkeys(self.touching))
        without = f" Parts that touch in every posture are not held against each other: {touching}." * bool(touching)
        return (
            f"{shapes} keep {1e3 * safety.margin:.0f} mm clear of {', '.join(what)}, with the sizes that the recipe's"
            f" block safety states; change them there.{without}"
        )

    def first_hit(self, start: Floats, end: Floats) -> str | None:
        """Where the straight path from `start` to `end` (J,), rad or m, first comes too near; None where it is free.

        One sentence: what comes near to what, and at which joint positions.
        """
        share, pair = self.free_share(start, end)
        if pair is None:
            return None
        outer, inner = self._pairs[pair]
        where = in_words(self.robot, start + share * (end - start))
        return (
            f"{outer.label} comes nearer to {inner.label} than the margin of {1e3 * self.safety.margin:.0f} mm where"
            f" the joints are at {where}"
        )

    def free_share(self, start: Floats, end: Floats) -> tuple[float, int | None]:
        """Share (0..1) of the straight path (J,) after which it first comes too near, and in which pair (None: free).

        Notes
        -----
        Conservative advancement: a pair that is d beyond the margin cannot use that up before one of them has gone d,
        so it is looked at again there, and nothing is missed.
        """
        if self.is_free:
            return 1.0, None
        share, margin, until = 0.0, self.margin, np.zeros(len(self._pairs))
        lasting = 1.0 / np.maximum(self._reach @ np.abs(end - start), 1e-12)
        while share < 1.0:
            due = np.flatnonzero(until <= share + _SOON)
            distance = self.distances(start + share * (end - start), due)
            nearest = int(distance.argmin())
            if distance[nearest] < margin + TOLERANCE:
                return share, int(due[nearest])
            until[due] = share + (distance - margin) * lasting[due]
            share = float(until.min())
        return 1.0, None

    def first_hit_along(self, path: Floats) -> str | None:
        """The same of a path through many near positions (N, J), straight between two of them."""
        if self.is_free:
            return None
        gone, place = np.cumsum(np.abs(np.diff(path, axis=0, prepend=path[:1])) @ self._reach.T, axis=0), 0
        while place < len(path) - 1:
            room = self.distances(path[place]) - self.margin - TOLERANCE
            near = gone[place : place + _AHEAD]
            ahead = int(np.count_nonzero((near <= near[0] + room).all(axis=1))) - 1
            if ahead < 1:
                ahead, hit = 1, self.first_hit(path[place], path[place + 1])
                if hit is not None:
                    return hit
            place += ahead
        return None

    def distances(self, position: Floats, pairs: Counts | None = None) -> Floats:
        """(P,) m between the P pairs, or those named, at joint positions (J,), negative where they overlap."""
        mujoco = engine()
        self._data.qpos[:] = position
        mujoco.mj_kinematics(self._model, self._data)
        model, data, distance = self._model, self._data, mujoco.mj_geomDistance
        chosen = self._geometries if pairs is None else [self._geometries[pair] for pair in pairs.tolist()]
        return np.array([distance(model, data, first, second, _FAR, None) for first, second in chosen])

    def _build(self) -> None:
        """The MuJoCo model: a chain of bodies with the recipe's shapes on them, and the pairs that are checked."""
        safety, last = self.safety, self.robot.n_joints
        spec, bodies = chain(self.robot, [{"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}] * last)
        shapes = list[Geometry]()
        for shape, attributes in _shapes(self.robot, safety):
            bodies[shape.link].add_geom(name=str(len(shapes)), **attributes)
            shapes.append(shape)
        self._model: Any = spec.compile()
        self._data: Any = engine().MjData(self._model)
        geometry = [self._model.geom(str(number)).id for number in range(len(shapes))]
        # Moving shapes with what stands, and with those of links that are not adjacent; without a stated tool the tip
        # is the wrist's centre, which lies inside the wrist's own shape.
        pairs = [
            (first, second)
            for first, outer in enumerate(shapes)
            for second, inner in enumerate(shapes)
            if (inner.stands and outer.link)
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

    def _leave_out_what_always_touches(self) -> None:
        joints, margin, faults = self.robot.joints, self.safety.margin, []
        low, high = np.transpose([joint.limits or (_TURN if joint.is_revolute else _SLIDE) for joint in joints])
        rng = np.random.default_rng(0)
        distance = np.array([self.distances(position) for position in rng.uniform(low, high, (_DRAWN, len(low)))])
        touches = (distance < margin).all(axis=0)
        for pair in np.flatnonzero(touches):
            outer, inner = self._pairs[pair]
            # Links of a wrist overlap, the first link turns on what the base stands on, and the second's lower end lies
            # at one height, however wide its capsule: no motion changes that.
            fixed = 2 if inner.label == _FLOOR else 1
            if not inner.stands or (outer.link <= fixed and outer.label != _TIP):
                self.touching.append(f"{outer.label} and {inner.label}")
                continue
            what = (
                f"{outer.label} is nearer to {inner.label} than the margin of {1e3 * margin:.0f} mm in all of {_DRAWN}"
                " random postures within the limits, so no posture is allowed"
            )
            mend = "make the box smaller, or lower safety.floor; what does not move belongs to link 0, which may touch"
            faults.append(RecipeError("safety-always-touching", what, Where(file=self.robot.origin or None), mend))
        refuse(faults)
        free = np.flatnonzero(~touches).tolist()
        self._pairs, self._geometries = ([whole[pair] for pair in free] for whole in (self._pairs, self._geometries))
        self._reach = self._reach[free]


def _shapes(robot: Robot, safety: Safety) -> Iterator[tuple[Geometry, dict[str, Any]]]:
    kinds, last = engine().mjtGeom, robot.n_joints
    tip = safety.tool or (0.0, 0.0, 0.0)
    yield Geometry(_TIP, last, float(np.linalg.norm(tip)) + _POINT), {"pos": tip, "size": [_POINT, 0, 0]}
    for rod in (*safety.capsules, *link_capsules(robot, safety)):
        extent = max(float(np.linalg.norm(end)) for end in (rod.start, rod.end)) + rod.radius
        where = {"type": kinds.mjGEOM_CAPSULE, "fromto": [*rod.start, *rod.end]}
        if np.allclose(rod.start, rod.end, rtol=0.0, atol=_POINT):
            where = {"pos": rod.start}
        yield (
            Geometry(f"link {rod.link}" if rod.link else "the base", rod.link, extent),
            {**where, "size": [rod.radius, 0, 0]},
        )
    for box in safety.boxes:
        low, high = np.array(box.low), np.array(box.high)
        size = {"type": kinds.mjGEOM_BOX, "pos": (low + high) / 2, "size": (high - low) / 2}
        yield Geometry(f"the box '{box.name}'", 0, stands=True), size
    if safety.floor is not None:
        x, y, z = up = -np.array(robot.gravity) / np.linalg.norm(robot.gravity)
        turn = [1.0 + z, -y, x, 0.0] if z > _POINT - 1.0 else [0.0, 1.0, 0.0, 0.0]  # takes z to up
        plane = {"type": kinds.mjGEOM_PLANE, "pos": safety.floor * up, "quat": turn, "size": [1, 1, 1]}
        yield Geometry(_FLOOR, 0, stands=True), plane


def link_capsules(robot: Robot, safety: Safety) -> Iterator[Capsule]:
    """The capsules of `safety.links`: from a joint's frame along the next joint's `a`, then `d`; last to the tool."""
    for link, radius in safety.links:
        origin = (0.0, 0.0, 0.0)
        if link == robot.n_joints:
            yield Capsule(link, origin, safety.tool or origin, radius)
            continue
        after = robot.joint(link + 1)
        x, y, z = after.frame[:3, 3].tolist()
        corner = (after.a, 0.0, 0.0) if after.placement is None else origin
        if corner in (origin, (x, y, z)):
            yield Capsule(link, origin, (x, y, z), radius)
        else:
            yield Capsule(link, origin, corner, radius)
            yield Capsule(link, corner, (x, y, z), radius)
