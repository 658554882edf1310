"""Clearance against MuJoCo's distances, against paths sampled densely, and what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pumaid.clearance import Clearance, straight, trapezoids
from pumaid.clearance.contacts import Contacts
from pumaid.errors import Faults, RecipeError
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Box, Joint, Robot, Safety, Sphere

#: m, as docs/safety.md promises.
TOLERANCE = 1e-3


def arm(seed: int) -> Robot:
    """A random chain of five joints, about a third of them sliding, with six spheres, two boxes and a tool."""
    rng = np.random.default_rng(seed)
    kinds = np.where(rng.random(5) < 0.3, "prismatic", "revolute")
    joints = []
    for number, kind in enumerate(kinds, start=1):
        theta, alpha, a, d = rng.uniform(-3, 3), rng.uniform(-3, 3), *rng.uniform(-0.4, 0.4, 2)
        joints.append(Joint(number, f"j{number}", str(kind), theta=theta, alpha=alpha, a=a, d=d))
    spheres = tuple(
        Sphere(int(rng.integers(0, 6)), tuple(rng.uniform(-0.3, 0.3, 3)), rng.uniform(0.02, 0.1)) for _ in range(6)
    )
    corners = rng.uniform(-0.8, 0.8, (2, 3))
    boxes = tuple(Box(f"b{k}", tuple(low), tuple(low + rng.uniform(0.01, 0.5, 3))) for k, low in enumerate(corners))
    return Robot("random", tuple(joints), safety=Safety(boxes, spheres, tuple(rng.uniform(-0.2, 0.2, 3)), 0.01))


def puma(safety: Safety) -> Robot:
    return replace(read_recipe(shipped_recipes()["puma560"]), safety=safety)


def densely(robot: Robot, path, count: int, steps: int = 3000) -> np.ndarray:
    """(K,) least distance of any contact over many equal steps of each path: slow and obvious."""
    contacts, which = Contacts.of(robot), np.arange(count)
    looks = [contacts.distances(path(which, np.full(count, share))).min(axis=1) for share in np.linspace(0, 1, steps)]
    return np.min(looks, axis=0)


def in_mujoco(robot: Robot, position: np.ndarray) -> list[float]:
    """Distances of all contacts in one posture by MuJoCo, which builds the arm from nested bodies of its own."""
    mujoco = pytest.importorskip("mujoco", reason="the engine is mujoco (pip install pumaid[test])")
    spec = mujoco.MjSpec()
    bodies = [spec.worldbody]
    for joint, value in zip(robot.joints, position, strict=True):
        turn, shift = (value, 0.0) if joint.is_revolute else (0.0, value)
        twisted = bodies[-1].add_body(
            pos=[joint.a, 0, 0], quat=[np.cos(joint.alpha / 2), np.sin(joint.alpha / 2), 0, 0]
        )
        half = (joint.theta + turn) / 2
        bodies.append(twisted.add_body(pos=[0, 0, joint.d + shift], quat=[np.cos(half), 0, 0, np.sin(half)]))
    tip = Sphere(robot.n_joints, robot.safety.tool, 1e-9)
    names = []
    for number, one in enumerate((tip, *robot.safety.spheres)):
        geom = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "pos": one.centre, "size": [one.radius, 0, 0]}
        names.append(bodies[one.link].add_geom(name=f"p{number}", **geom).name)
    for number, box in enumerate(robot.safety.boxes):
        low, high = np.array(box.low), np.array(box.high)
        kind = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(name=f"b{number}", type=kind, pos=(low + high) / 2, size=(high - low) / 2)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    table = Contacts.of(robot)
    pairs = zip(table.carried, table.other, table.box, strict=True)
    named = [(f"p{m}", f"b{b}" if b >= 0 else f"p{o}") for m, o, b in pairs]
    found = [[model.geom(name).id for name in pair] for pair in named]
    return [mujoco.mj_geomDistance(model, data, one, two, 10.0, np.zeros(6)) for one, two in found]


@pytest.mark.parametrize("seed", range(6))
def test_distances_are_mujocos(seed):
    """Where two things are apart, their distance is that of MuJoCo's geometry; where they overlap, both say so."""
    robot = arm(seed)
    for position in np.random.default_rng(seed).uniform(-2, 2, (5, 5)):
        found, wanted = Contacts.of(robot).distances(position[None])[0], np.array(in_mujoco(robot, position))
        apart = wanted > 1e-6
        assert found[apart] == pytest.approx(wanted[apart], abs=1e-6)  # its solver stops at about 1e-6 m
        assert (found[~apart] < 1e-5).all()


@pytest.mark.parametrize("seed", range(8))
def test_no_posture_in_the_room_is_nearer_than_promised(seed):
    """Both bounds hold for 200 postures drawn from the room around each of 20 postures, corners among them."""
    rng, contacts = np.random.default_rng(seed), Contacts.of(arm(seed))
    centre, room = rng.uniform(-2, 2, (20, 5)), rng.uniform(0, 1, (20, 5)) ** 3
    view = contacts.view(centre, room)
    rows, pairs = np.indices(view.distance.shape).reshape(2, -1)
    second = view.finer(rows, pairs, contacts).reshape(view.distance.shape)
    for _ in range(200):
        offset = rng.uniform(-1, 1, (20, 5)) if rng.random() < 0.5 else rng.choice([-1.0, 0.0, 1.0], (20, 5))
        reached = contacts.distances(centre + offset * room)
        assert (reached >= view.distance - np.minimum(view.spread, second) - 1e-12).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("course", ["straight", "trapezoids"])
def test_gap_is_that_of_a_dense_sweep(seed, course):
    """The least distance along a path is at most 1 mm above, and not below, that of 3000 samples of it."""
    rng, robot = np.random.default_rng(seed), arm(seed)
    starts, ends = rng.uniform(-1.5, 1.5, (2, 12, 5))
    bent = trapezoids(starts, ends, speeds=rng.uniform(0.3, 2, 5), accelerations=rng.uniform(0.5, 4, 5))
    path = straight(starts, ends) if course == "straight" else bent
    clearance = Clearance(Contacts.of(robot), robot.safety)
    found, sampled = clearance.gap_along(path, 12), densely(robot, path, 12)
    # A sample is at most 1/6000 of the way, about 1e-3 m, off the nearest point; near a minimum far less.
    assert (found - sampled).max() < TOLERANCE
    assert (sampled - found).max() < 0.3e-3


@pytest.mark.parametrize("seed", range(4))
def test_struck_agrees_with_a_dense_sweep(seed):
    """A path is struck where samples come nearer than the margin, and free where they stay 1 mm outside it."""
    rng, robot = np.random.default_rng(seed), arm(seed)
    starts, ends = rng.uniform(-1.5, 1.5, (2, 40, 5))
    few = np.argsort(rng.random((40, 5)), axis=1) < 3  # a contact is too often hit where all joints move
    ends = np.where(few, starts, ends)
    sampled = densely(robot, straight(starts, ends), 40, steps=1000)
    struck = Clearance(Contacts.of(robot), robot.safety).struck(starts, ends)
    assert 0 < struck.sum() < 40
    assert struck[sampled < 0.01].all()
    assert not struck[sampled > 0.01 + TOLERANCE + 0.3e-3].any()


def test_a_thin_plate_is_not_jumped_over():
    """A plate of 1 mm across a sweep of 2.4 m is found, where 60 samples of the path all pass it by."""
    plate = Box("plate", (0.3, 0.001, -2.0), (2.0, 0.002, 2.0))
    robot = puma(Safety((plate,), margin=0.0))
    start, end = np.zeros((1, 6)), np.zeros((1, 6))
    start[0, 0], end[0, 0] = np.radians([-100, 100])
    clearance = Clearance(Contacts.of(robot), robot.safety)
    assert densely(robot, straight(start, end), 1, steps=60) > 1e-3
    assert clearance.struck(start, end).tolist() == [True]
    assert "the tip enters the box 'plate'" in clearance.explain(start[0], end[0])


def test_a_bent_path_is_judged_as_it_runs():
    """A move whose joints do not end together hits a post that the straight way between its ends passes by."""
    robot = Robot("two rails", tuple(Joint(n, f"rail{n}", "prismatic", alpha=np.pi / 2 * (n - 1)) for n in (1, 2)))
    robot = replace(robot, safety=Safety((Box("post", (-0.1, -0.65, 0.9), (0.1, -0.35, 1.1)),), margin=0.01))
    start, end = np.zeros((1, 2)), np.array([[1.0, 1.0]])
    ways = [straight(start, end), trapezoids(start, end, speeds=np.array([2.0, 0.2]), accelerations=np.full(2, 20.0))]
    clearance = Clearance.of(robot)
    assert [bool(clearance.struck_along(way, 1)[0]) for way in ways] == [False, True]
    both = clearance.struck_moves(start, end, speeds=np.array([2.0, 0.2]), accelerations=np.full(2, 20.0))
    assert both.tolist() == [True]


def test_few_postures_are_looked_at(monkeypatch):
    """Whether 300 runs of a PUMA are free costs fewer than 40 looks at the arm a run, most of them being free."""
    spheres = (Sphere(0, (0, 0, -0.3), 0.1), Sphere(2, (0.2, 0, 0), 0.08), Sphere(3, (0, 0.2, 0), 0.06))
    robot = puma(Safety((Box("table", (-2, -2, -2), (2, 2, -0.9)),), spheres, (0, 0, 0.1)))
    looks, real = [], Contacts.view
    monkeypatch.setattr(Contacts, "view", lambda self, q, room: looks.append(len(q)) or real(self, q, room))
    rng = np.random.default_rng(1)
    starts, ends = rng.uniform(-2, 2, (2, 300, 6))
    ends = np.where(np.arange(6) == rng.integers(0, 6, (300, 1)), ends, starts)
    assert Clearance.of(robot).struck(starts, ends).mean() < 0.3
    assert sum(looks) < 40 * 300


def test_nothing_forbidden_is_free():
    """Without the block, and with spheres of neighbours only, every path is free at no cost."""
    for safety in (None, Safety(spheres=(Sphere(2, (0, 0, 0), 1.0), Sphere(3, (0, 0, 0), 1.0)))):
        clearance = Clearance.of(replace(read_recipe(shipped_recipes()["puma560"]), safety=safety))
        assert clearance.is_free
        assert clearance.gap(np.zeros((2, 6)), np.ones((2, 6))).tolist() == [np.inf, np.inf]
        assert not clearance.struck(np.zeros((2, 6)), np.ones((2, 6))).any()


def test_what_always_touches_is_the_recipes_fault():
    """A box around the whole arm, and spheres larger than what lies between them, are refused together."""
    big = (Sphere(1, (0, 0, 0), 0.4), Sphere(3, (0, 0, 0), 0.4))
    robot = puma(Safety((Box("cell", (-9, -9, -9), (9, 9, 9)),), big))
    with pytest.raises(Faults) as caught:
        Clearance.of(robot)
    told = [str(fault) for fault in caught.value.faults]
    assert all("[safety-always-touching]" in one for one in told)
    assert sum("the box 'cell'" in one for one in told) == 3
    assert sum("add [1, 3] to safety.ignore" in one for one in told) == 1


def test_ignored_links_are_not_held_against_each_other():
    """Spheres of links named in `ignore` are left out."""
    big = (Sphere(1, (0, 0, 0), 0.4), Sphere(3, (0, 0, 0), 0.4))
    with pytest.raises(RecipeError, match="so that none is allowed"):
        Clearance.of(puma(Safety(spheres=big)))
    assert Clearance.of(puma(Safety(spheres=big, ignore=((1, 3),)))).is_free


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (-0.9, "the tip enters the box 'table' by 83 mm when joint 3 (elbow) is at 9"),
        (-1.0, "the tip comes within 17 mm of the box 'table', nearer than the margin of 20 mm, when joint 3"),
        (-1.2, "the tip comes within 217 mm of the box 'table' when joint 3 (elbow) is at"),
    ],
)
def test_explains_what_touches_and_where(table, words):
    """The sentence names both parties, the depth and the joint's position: arm stretched down, elbow swung through."""
    robot = puma(Safety((Box("table", (-2, -2, -2), (2, 2, table)),), tool=(0, 0, 0.118)))
    start, end = np.radians([[0, 90, 40, 0, 0, 0], [0, 90, 140, 0, 0, 0]])
    assert words in Clearance.of(robot).explain(start, end)


def test_a_joint_that_does_not_matter_is_not_blamed():
    """Where the joint that moves carries neither party, the posture is told instead."""
    robot = puma(Safety(spheres=(Sphere(1, (0, 0, 0), 0.1), Sphere(3, (0, 0, 0), 0.1))))
    start, end = np.zeros(6), np.array([0, 0, 0, 0, 0, 1.0])
    assert "on the whole way, the joints being at 0 deg" in Clearance.of(robot).explain(start, end)
