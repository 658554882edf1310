"""MJCF files: where their joints are, against MuJoCo's own dynamics of the whole file, and what is told of them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pumaid.errors import PumaidError
from pumaid.io.urdf import UrdfRecipe
from pumaid.rigid_body import whole

#: Relative to the largest torque.
EXACT = 1e-8


@pytest.fixture
def made(tmp_path: Path):
    """A function that writes an MJCF file and makes a recipe of it."""

    def make(text: str, **ends: str) -> UrdfRecipe:
        (tmp_path / "arm.xml").write_text(text)
        return UrdfRecipe(tmp_path / "arm.xml", **ends)

    return make


def torques(text: str, names: list[str], motion: list[np.ndarray]) -> np.ndarray:
    """(J, N) of these joints by MuJoCo's inverse dynamics of the file's bodies, all other joints at rest at zero."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.dof_armature[:] = model.dof_damping[:] = 0.0
    data, out = mujoco.MjData(model), []
    joints = [model.joint(name) for name in names]
    places, rates = [joint.qposadr[0] for joint in joints], [joint.dofadr[0] for joint in joints]
    for state in zip(*(part.T for part in motion), strict=True):
        data.qpos[:] = 0.0
        data.qpos[places], data.qvel[rates], data.qacc[rates] = state
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse[rates].copy())
    return np.array(out).T


def miss(text: str, recipe: UrdfRecipe) -> float:
    """Largest relative error of the recipe's rigid body, fitted to MuJoCo's torques, in motions that were not fitted.

    Positions, velocities and accelerations are random: gravity, the whole inertia matrix and the speeds' forces count.
    """
    robot, rng = recipe.robot, np.random.default_rng(7)
    motion = [rng.normal(0.0, size, (robot.n_joints, 300)) for size in (1.5, 2.0, 6.0)]
    wanted = torques(text, [joint.name for joint in robot.joints], motion)
    rows = whole(robot).rows(*motion)
    design = np.array([np.pad(part.T, ((0, 0), (len(rows[0]) - len(part), 0))) for part in rows])
    fitted = np.linalg.lstsq(design[:, :150].reshape(-1, design.shape[-1]), wanted[:, :150].ravel(), rcond=1e-10)[0]
    return float(np.abs(design[:, 150:] @ fitted - wanted[:, 150:]).max() / np.abs(wanted).max())


def words(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def random_text(seed: int) -> str:
    """An arm with offset anchors, zeros that are not as drawn, several joints a body, fixed bodies, any axes."""
    rng = np.random.default_rng(seed)
    is_degrees = bool(seed % 2)
    turn = 180.0 / np.pi if is_degrees else 1.0
    text, ends, number = "", "", 0
    for body in range(int(rng.integers(3, 6))):
        quat, euler = Rotation.random(random_state=seed + body).as_quat(), rng.uniform(-3, 3, 3) * turn
        facing = f'quat="{words(quat)}"' if body % 2 else f'euler="{words(euler)}"'
        frame = f'<frame pos="{words(rng.uniform(-0.3, 0.3, 3))}" euler="{words(rng.uniform(-2, 2, 3) * turn)}">'
        text += f'{frame}<body pos="{words(rng.uniform(-0.5, 0.5, 3))}" {facing}>'
        for _ in range(int(rng.choice([0, 1, 1, 2])) if body else 1):
            number += 1
            kind = str(rng.choice(["hinge", "hinge", "slide"]))
            unit = turn if kind == "hinge" else 1.0
            low, high = sorted(rng.uniform(-2, 2, 2) * unit)
            text += (
                f'<joint name="j{number}" type="{kind}" axis="{words(rng.normal(size=3))}" ref="{rng.normal() * unit}"'
                f' pos="{words(rng.uniform(-0.2, 0.2, 3))}" range="{low} {high}"/>'
            )
        text += f'<geom type="box" size=".1 .2 .3" pos="{words(rng.uniform(-0.2, 0.2, 3))}" euler="10 20 30"/>'
        ends = f"</body></frame>{ends}"
    gravity, density = rng.normal(0.0, 4.0, 3), rng.uniform(500, 2000)
    angle = "degree" if is_degrees else "radian"
    return (
        f'<mujoco model="any"><compiler angle="{angle}" eulerseq="{"zyx" if seed % 3 else "xyz"}"/>'
        f'<option gravity="{words(gravity)}"/>'
        f'<default><joint armature="0.3" damping="2" frictionloss="1"/><geom density="{density}"/></default>'
        f"<worldbody>{text}{ends}</worldbody></mujoco>"
    )


@pytest.mark.parametrize("seed", range(12))
def test_any_chain_has_the_dynamics_that_mujoco_gives_it(made, seed: int) -> None:
    """Gravity, inertia matrix and the speeds' forces of random motions are the recipe's; limits are MuJoCo's."""
    text = random_text(seed)
    recipe = made(text)
    assert miss(text, recipe) < EXACT
    model = mujoco.MjModel.from_xml_string(text)
    ranges = [model.joint(joint.name).range for joint in recipe.robot.joints]
    assert recipe.robot.n_joints == model.njnt
    assert np.allclose([joint.limits for joint in recipe.robot.joints], ranges, atol=1e-11)
    assert np.linalg.norm(recipe.robot.gravity) == pytest.approx(np.linalg.norm(model.opt.gravity))


#: Two links as people write them (default classes, degrees), with a gripper, actuators, a mesh that is not there.
ARM = """<mujoco model="two links">
<compiler meshdir="assets"/>
<default>
  <default class="link"><joint axis="0 1 0" range="-170 170"/>
  <geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.4"/></default>
</default>
<asset><mesh name="hull" file="hull.stl"/></asset>
<worldbody><light pos="0 0 3"/>
<body name="pedestal" pos="0 0 0.2"><geom type="mesh" mesh="hull"/>
<body name="upper" childclass="link"><inertial pos="0 0 0.2" mass="3" diaginertia="0.1 0.1 0.01"/>
<joint name="shoulder"/>
<body name="lower" pos="0 0 0.4"><geom/><joint name="elbow" limited="false"/><site name="flange" pos="0 0 0.4"/>
<body name="left" pos="0 0.02 0.4"><geom size="0.01"/><joint name="finger1" type="slide" range="0 0.04"/></body>
<body name="right" pos="0 -0.02 0.4"><geom size="0.01"/><joint name="finger2" type="slide" range="0 0.04"/></body>
</body></body></body></worldbody>
<equality><joint joint1="finger2" joint2="finger1"/></equality>
<actuator><motor joint="shoulder" gear="101"/><position joint="elbow" kp="100"/></actuator>
<sensor><framepos objtype="site" objname="flange"/></sensor>
<keyframe><key qpos="0 0 0 0"/></keyframe>
</mujoco>"""


def test_an_arm_with_a_gripper_is_taken_as_it_is(made) -> None:
    """Meshes need not be there; fingers are left out and told, and so are gears, missing limits and speeds."""
    recipe = made(ARM)
    joints = recipe.robot.joints
    assert [joint.name for joint in joints] == ["shoulder", "elbow"]
    assert joints[0].limits == pytest.approx(np.radians([-170, 170])) and joints[1].limits is None
    assert recipe.robot.gravity == (0.0, 0.0, -9.81) and recipe.robot.name == "two links"
    told = {note.slug: note.text for note in recipe.notes}
    assert (
        "speed of shoulder, elbow; gear_ratio of shoulder (its actuator's gear is 101); limits of elbow."
        in (told["urdf-incomplete"])
    )
    assert "finger1, finger2" in told["urdf-left-out"]
    bare = ARM.replace('<mesh name="hull" file="hull.stl"/>', "").replace('<geom type="mesh" mesh="hull"/>', "")
    assert miss(bare, recipe) < EXACT


@pytest.mark.parametrize(
    ("text", "ends", "names"),
    [
        (ARM, {"tip": "left"}, ["shoulder", "elbow", "finger1"]),
        (ARM, {"base": "upper", "tip": "lower"}, ["elbow"]),
        (
            ARM.replace("</worldbody>", '<body name="cube"><freejoint/><geom size="1"/></body></worldbody>'),
            {"tip": "lower"},
            ["shoulder", "elbow"],
        ),
    ],
)
def test_which_chain_is_taken_is_said_by_its_bodies(made, text, ends, names) -> None:
    assert [joint.name for joint in made(text, **ends).robot.joints] == names


@pytest.mark.parametrize(
    ("change", "slug", "said"),
    [
        (('<body name="upper"', '<body name="upper" pos="far"'), "urdf-refused", "MuJoCo cannot read"),
        (("</worldbody>", "<joint/></worldbody>"), "urdf-refused", "MuJoCo cannot read"),
        (("<worldbody>", '<include file="other.xml"/><worldbody>'), "urdf-refused", "other.xml"),
        (("</worldbody>", '<body name="cube"><freejoint/></body></worldbody>'), "urdf-which-chain", "--tip LINK, of"),
        (
            ('<joint name="elbow" limited="false"/>', '<joint name="elbow" type="ball" range="0 0" limited="false"/>'),
            "urdf-which-chain",
            "is spherical",
        ),
        (("<worldbody>", '<option gravity="0 0 0"/><worldbody>'), "", ""),
        (("<compiler", '<option gravity="0 0 -981"/><compiler'), "recipe-wrong", "no planet's gravity"),
    ],
)
def test_what_cannot_be_a_recipe_is_told(made, change, slug: str, said: str) -> None:
    """In one message that says what; a file without gravity is taken for an upright arm, as a URDF is."""
    text = ARM.replace(*change)
    if not slug:
        assert made(text).robot.gravity == (0.0, 0.0, -9.80665) and "states no gravity" in str(made(text).notes)
        return
    with pytest.raises(PumaidError) as refused:
        made(text)
    assert refused.value.slug == slug and said in f"{refused.value.what} {refused.value.mend}"


def test_includes_beside_the_file_are_read(made, tmp_path) -> None:
    (tmp_path / "inner.xml").write_text(ARM)
    scene = '<mujoco><include file="inner.xml"/><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>'
    assert [joint.name for joint in made(scene).robot.joints] == ["shoulder", "elbow"]


def test_included_files_are_read_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arm" / "parts").mkdir(parents=True)
    for name, text in {
        "arm.xml": '<mujoco><worldbody><include file="parts/upper.xml"/></worldbody></mujoco>',
        "parts/upper.xml": '<mujocoinclude><body><joint name="a"/><include file="fore.xml"/></body></mujocoinclude>',
        "parts/fore.xml": '<mujocoinclude><body><joint name="b"/></body></mujocoinclude>',
    }.items():
        (tmp_path / "arm" / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    assert [joint.name for joint in UrdfRecipe(Path("arm/arm.xml")).robot.joints] == ["a", "b"]
