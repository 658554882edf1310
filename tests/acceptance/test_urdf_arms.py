"""Recipes made from every URDF of example-robot-data, against pinocchio's own reading of the same files."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from clearance import driven
from urdfs import Engine, Stated, serial_text, span_miss

from pumaid.design.collision import Collision
from pumaid.design.plan import plan
from pumaid.errors import PumaidError
from pumaid.io.link_shapes import capsule_about
from pumaid.io.urdf import UrdfRecipe

pytest.importorskip("pinocchio", reason="the independent reader is pinocchio (pip install pumaid[test])")
pytest.importorskip("example_robot_data", reason="example-robot-data brings the URDFs (pip install pumaid[test])")

#: Files that hold one arm, gripper apart -> its joints. All others of the package are refused.
ARMS = {
    "asr_twodof_description/urdf/TwoDofs.urdf": 2,
    "bluevolta_description/urdf/bluevolta_bravo7_gripper.urdf": 6,
    "bluevolta_description/urdf/bluevolta_bravo7_no_ee.urdf": 6,
    "borinot_description/urdf/borinot_flying_arm_2.urdf": 2,
    "bravo7_description/urdf/bravo7_gripper.urdf": 6,
    "bravo7_description/urdf/bravo7_no_ee.urdf": 6,
    "double_pendulum_description/urdf/double_pendulum.urdf": 2,
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf": 2,
    "double_pendulum_description/urdf/double_pendulum_simple.urdf": 2,
    "falcon_description/urdf/falcon_bravo7_gripper.urdf": 6,
    "falcon_description/urdf/falcon_bravo7_no_ee.urdf": 6,
    "finger_edu_description/robots/finger_edu.urdf": 3,
    "hextilt_description/urdf/hextilt_flying_arm_5.urdf": 5,
    "kinova_description/robots/kinova.urdf": 6,
    "panda_description/urdf/panda.urdf": 7,
    "panda_description/urdf/panda_collision.urdf": 7,
    "so_arm_description/urdf/so100.urdf": 6,
    "so_arm_description/urdf/so101.urdf": 6,
    "talos_data/robots/talos_left_arm.urdf": 7,
    "ur_description/urdf/ur10_joint_limited_robot.urdf": 6,
    "ur_description/urdf/ur10_robot.urdf": 6,
    "ur_description/urdf/ur3_gripper.urdf": 6,
    "ur_description/urdf/ur3_joint_limited_robot.urdf": 6,
    "ur_description/urdf/ur3_robot.urdf": 6,
    "ur_description/urdf/ur5_gripper.urdf": 6,
    "ur_description/urdf/ur5_joint_limited_robot.urdf": 6,
    "ur_description/urdf/ur5_robot.urdf": 6,
    "xarm_description/urdf/xarm7.urdf": 7,
    "z1_description/urdf/z1.urdf": 7,
}
#: Refused files that hold no chain at all, or are broken: no joint that moves, a link that is not there, an empty file.
NO_ARM = {
    "bluevolta_description/urdf/bluevolta.urdf": "urdf-which-chain",
    "falcon_description/urdf/falcon.urdf": "urdf-refused",
    "hector_description/robots/quadrotor_base.urdf": "urdf-which-chain",
    "iris_description/robots/iris_simple.urdf": "urdf-which-chain",
    "ur_description/urdf/ur3.urdf": "urdf-refused",
}
#: Farthest that an axis may be off: the rounding of angles that are written as parts of pi (rad, m).
TOLERANCE = 1e-8
#: Torques against the largest one, or against a kilogram on a metre.
EXACT = 1e-7

TIPS = re.compile(r"--tip LINK, of (.*?)(?: \.\.\. .*)?$")


def folder() -> Path:
    from example_robot_data.robots_loader import getModelPath

    return Path(getModelPath("panda_description/urdf/panda.urdf"))


def worst(name: str, made: UrdfRecipe) -> float:
    """Farthest that any axis of the recipe is from pinocchio's in ten random postures (rad or m)."""
    engine = Engine(folder() / name, made)
    positions = np.random.default_rng(3).uniform(-3.0, 3.0, (10, made.robot.n_joints))
    return max(max(engine.off(position)) for position in positions)


@pytest.mark.parametrize("name", ARMS)
def test_axes_are_those_of_the_urdf(name: str) -> None:
    """The arm is found, and each axis lies where pinocchio has it: direction, place, zero and sense."""
    made = UrdfRecipe(folder() / name)
    assert made.robot.n_joints == ARMS[name]
    assert worst(name, made) < TOLERANCE


@pytest.mark.parametrize(
    "name", sorted({str(path.relative_to(folder())) for path in folder().glob("*/*/*.urdf")} - set(ARMS))
)
def test_what_is_no_arm_is_refused_with_its_chains(name: str) -> None:
    """One message; where it names ends (legs, arms, fingers), each of them makes a recipe that pinocchio confirms."""
    with pytest.raises(PumaidError) as refused:
        UrdfRecipe(folder() / name)
    assert refused.value.slug == NO_ARM.get(name, "urdf-which-chain")
    tips = TIPS.search(refused.value.mend)
    assert (tips is not None) == (name not in NO_ARM)
    for tip in tips[1].split(", ") if tips else ():
        try:
            made = UrdfRecipe(folder() / name, tip=tip)
        except PumaidError as error:  # a joint that no recipe can state, and where to start or end instead
            assert error.slug == "urdf-which-chain" and re.search("--(base|tip) ", error.mend)
        else:
            assert worst(name, made) < TOLERANCE


#: File, base and tip of chains whose gravity is compared: upright, on a torso, tilted, with a joint that slides.
WEIGHED = [
    ("ur_description/urdf/ur5_robot.urdf", None, None),
    ("panda_description/urdf/panda.urdf", None, None),
    ("kinova_description/robots/kinova.urdf", None, None),
    ("tiago_description/robots/tiago_no_hand.urdf", None, "arm_7_link"),
    ("talos_data/robots/talos_full_v2.urdf", None, "arm_left_7_link"),
    ("talos_data/robots/talos_full_v2.urdf", "arm_left_1_link", "arm_left_7_link"),
    ("icub_description/robots/icub.urdf", "chest", "l_hand"),
    ("baxter_description/urdf/baxter.urdf", None, "right_wrist"),
    ("bluevolta_description/urdf/bluevolta_bravo7_no_ee.urdf", None, None),
]


@pytest.mark.parametrize(("name", "base", "tip"), WEIGHED)
def test_gravity_of_the_urdf_is_spanned(name: str, base: str | None, tip: str | None) -> None:
    """The recipe's gravity columns give the torques of the URDF's own masses, in postures that were not fitted."""
    made = UrdfRecipe(folder() / name, base=base, tip=tip)
    position = np.random.default_rng(5).uniform(-1.5, 1.5, (120, made.robot.n_joints))
    assert span_miss(made.robot, position, Engine(folder() / name, made).holding(position).T) < EXACT


def mesh_gaps(file: Path, made: UrdfRecipe, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) least height of the file's meshes of links 1 and up, (N,) least distance of any that are held apart, m."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(file))
    solids = pin.buildGeomFromUrdf(model, str(file), pin.COLLISION, package_dirs=[str(folder().resolve().parents[1])])
    joints = [model.getJointId(joint.name) for joint in made.path if joint.moves]
    links = {0: 0} | {joint: number for number, joint in enumerate(joints, start=1)}
    numbers = [links.get(solid.parentJoint) for solid in solids.geometryObjects]
    touching = Collision(made.robot).touching
    for (first, inner), (second, outer) in product(enumerate(numbers), enumerate(numbers)):
        words = f"link {outer} and {f'link {inner}' if inner else 'the base'}"
        if None not in (inner, outer) and outer > inner + 1 and words not in touching:
            solids.addCollisionPair(pin.CollisionPair(first, second))
    data, placed, lows, apart = model.createData(), solids.createData(), [], []
    corners = {
        number: np.array(solid.geometry.vertices())
        for number, (link, solid) in enumerate(zip(numbers, solids.geometryObjects, strict=True))
        if link and hasattr(solid.geometry, "vertices")
    }
    for position in positions:
        q = pin.neutral(model)
        q[[model.joints[joint].idx_q for joint in joints]] = position
        pin.computeDistances(model, data, solids, placed, q)
        apart.append([result.min_distance for result in placed.distanceResults])
        poses = [(points, placed.oMg[number]) for number, points in corners.items()]
        lows.append(min(float((points @ pose.rotation[2]).min() + pose.translation[2]) for points, pose in poses))
    return np.array(lows), np.min(apart, axis=1)


@pytest.mark.slow
def test_no_plan_strikes_with_the_meshes_of_the_file():
    """A recipe has capsules about these, so runs and moves keep the margin; without them the arm strikes the floor."""
    name = "ur_description/urdf/ur5_robot.urdf"
    made = UrdfRecipe(folder() / name)
    low, apart = mesh_gaps(folder() / name, made, driven(plan(made.robot, minutes=6, seed=3))[::40])
    assert low.min() > 0.02 and apart.min() > 0.02
    careless = driven(plan(replace(made.robot, safety=None), minutes=6, seed=3))[::40]
    assert mesh_gaps(folder() / name, made, careless)[0].min() < 0.0


def test_capsules_hold_the_points_and_little_more():
    """Of points in a ball and in a slanted rod none is outside, and both ends are where they should be."""
    rng = np.random.default_rng(0)
    along = np.array([0.6, 0.0, 0.8])
    ball = rng.normal(size=(4000, 3))
    ball *= 0.04 / np.linalg.norm(ball, axis=1)[:, None]
    for points, length in ((ball, 0.0), (ball + 0.5 * rng.random((4000, 1)) * along + 1.0, 0.5)):
        start, end, radius = capsule_about(points)
        share = np.clip((points - start) @ (end - start) / max(float((end - start) @ (end - start)), 1e-12), 0.0, 1.0)
        assert np.linalg.norm(points - start - share[:, None] * (end - start), axis=1).max() < radius + 1e-9
        assert radius < 0.045 and np.linalg.norm(end - start) == pytest.approx(length, abs=0.01)


def test_shapes_that_cannot_be_read_are_guessed(tmp_path):
    """A mesh that is no file, and sizes that are none: the link gets a radius by the arm's length, and is named."""
    shapes = {"l0": '<collision><geometry><box size="inf 1 1"/></geometry></collision>'}
    shapes["l1"] = '<collision><geometry><mesh filename="/dev/zero"/></geometry></collision>'
    shapes["l2"] = '<collision><geometry><cylinder radius="wide" length="1"/></geometry></collision>'
    shapes["l3"] = '<visual><geometry><sphere radius="0.05"/></geometry></visual>'
    text = serial_text([Stated(xyz=(0.0, 0.0, 0.3))] * 3)
    for link, shape in shapes.items():
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{shape}')
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    safety = UrdfRecipe(tmp_path / "arm.urdf").robot.safety
    assert [(rod.link, rod.radius) for rod in safety.capsules] == [(3, 0.051)]
    assert dict(safety.links) == {0: 0.05, 1: 0.05, 2: 0.05}
