"""URDF and MJCF hold masses with the model's weight: pinocchio and MuJoCo load them and feel what the model says."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from pumaid.errors import ModelError
from pumaid.estimate import Value
from pumaid.exports import export
from pumaid.exports.equivalent_bodies import read_constants
from pumaid.simulation import draw
from tests.exported import fitted, motions, predicted, robot_called
from tests.worlds import random_arm

pin = pytest.importorskip("pinocchio", reason="an engine is pinocchio (pip install pumaid[test])")
mujoco = pytest.importorskip("mujoco", reason="an engine is mujoco (pip install pumaid[test])")
engines = pytest.importorskip("tests.engines")

#: Relative to the largest load: engines turn angles into rotations and back.
ROUNDED = 1e-9
ARMS = ("puma560", "panda", "stanford", "crane", "one", "twelve")


def gains(robot) -> np.ndarray:
    """(J,) N m/A or N/A of the drawn robot: what its currents are worth."""
    return 1.0 / draw(robot, 0).gain


def given(robot) -> dict[int, float]:
    """The same by joint, from 1."""
    return {joint: float(value) for joint, value in enumerate(gains(robot), start=1)}


def weight(robot, estimate, position: np.ndarray) -> np.ndarray:
    """(N, J) A of gravity: the mean of both directions, what friction leaves at no speed taken out."""
    is_gravity = [name.startswith("gravity.") for name in estimate.names]
    still = replace(estimate, solution=np.where(is_gravity, estimate.solution, 0.0))
    return predicted(robot, still, position, velocity=np.ones_like(position))


def by_pinocchio(text: str, robot, position: np.ndarray) -> np.ndarray:
    """(N, J) N m that hold the URDF's arm; the world's gravity is along -z and as large as the recipe's."""
    model = pin.buildModelFromXML(text)
    model.gravity.linear = np.array([0.0, 0.0, -np.linalg.norm(robot.gravity)])
    position = [pin.integrate(model, pin.neutral(model), q) for q in position]
    return engines.held_by_pinocchio(model, position)


def by_mujoco(text: str, position: np.ndarray) -> np.ndarray:
    """(N, J) N m that hold the MJCF's arm."""
    return engines.held_by_mujoco(mujoco.MjModel.from_xml_string(text), position)


def tilted(robot):
    """The same arm on a wall, gravity of another size too."""
    return replace(robot, gravity=(3.0, -8.0, 1.5), digest="")


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("name", ARMS)
def test_engines_feel_what_the_model_says(name, turned):
    """With true torque constants, and on a tilted base: gravity of either file is the model's current times them."""
    robot = tilted(robot_called(name)) if turned else robot_called(name)
    estimate, (position, _) = fitted(robot), motions(robot)
    wanted = weight(robot, estimate, position) * gains(robot)
    urdf = export(estimate, robot, form="urdf", torque_constants=given(robot))
    mjcf = export(estimate, robot, form="mjcf", torque_constants=given(robot))
    scale = max(np.abs(wanted).max(), 1.0)
    assert np.abs(by_pinocchio(urdf.files[".urdf"], robot, position) - wanted).max() < ROUNDED * scale
    assert np.abs(by_mujoco(mjcf.files[".xml"], position) - wanted).max() < ROUNDED * scale
    assert not [remark for remark in mjcf.remarks if "RMS" in remark or "eta" in remark]


@pytest.mark.parametrize("name", ["puma560", "panda"])
def test_without_constants_ratios_give_them_but_for_one_factor(name):
    """Gravity over current is then one number a joint, its ratios those of the gains, the largest of a group 1."""
    robot = robot_called(name)
    estimate, (position, _) = fitted(robot), motions(robot)
    text = export(estimate, robot, form="mjcf").files[".xml"]
    found, current = by_mujoco(text, position), weight(robot, estimate, position)
    gears = np.array([float(one.get("gear")) for one in ElementTree.fromstring(text).iter("motor")])
    assert np.allclose(found, current * gears, atol=ROUNDED) and np.abs(gears).max() == 1.0
    assert np.allclose(gears / gears[-1], gains(robot) / gains(robot)[-1])


@pytest.mark.parametrize("name", ["ur5e", "stanford", "twelve"])
def test_masses_are_possible(name):
    """Every mass and moment of inertia is positive, and the mass matrix of the whole arm positive definite."""
    robot = robot_called(name)
    text = export(fitted(robot), robot, form="mjcf", torque_constants=given(robot)).files[".xml"]
    model = mujoco.MjModel.from_xml_string(text)
    data, full = mujoco.MjData(model), np.zeros((robot.n_joints, robot.n_joints))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    assert model.body_mass[2:].min() > 0.0 and model.body_inertia[2:].min() > 0.0
    assert np.linalg.eigvalsh(full).min() > 0.0


def test_limits_speeds_and_friction_are_written():
    """Limits as in the recipe; friction the mean of both directions in N m; motors in ampere."""
    robot = robot_called("panda")
    estimate = fitted(robot)
    known = dict(zip(estimate.names, estimate.solution, strict=True))
    model = pin.buildModelFromXML(export(estimate, robot, form="urdf", torque_constants=given(robot)).files[".urdf"])
    both = mujoco.MjModel.from_xml_string(
        export(estimate, robot, form="mjcf", torque_constants=given(robot)).files[".xml"]
    )
    ways = [0.5 * (known[f"coulomb.j{n}.plus"] - known[f"coulomb.j{n}.minus"]) for n in range(1, 8)]
    rises = [0.5 * (known[f"viscous.j{n}.plus"] + known[f"viscous.j{n}.minus"]) for n in range(1, 8)]
    assert np.allclose(model.lowerPositionLimit, [joint.limits[0] for joint in robot.joints])
    assert np.allclose(model.velocityLimit, [joint.max_velocity for joint in robot.joints])
    assert np.allclose(model.friction, ways * gains(robot)) and np.allclose(both.dof_frictionloss, model.friction)
    assert np.allclose(model.damping, rises * gains(robot)) and np.allclose(both.dof_damping, model.damping)
    assert np.allclose(both.jnt_range, [joint.limits for joint in robot.joints])
    assert np.allclose(both.actuator_gear[:, 0], gains(robot))


def test_constants_that_contradict_the_ratios_are_told_with_their_size():
    """Joint 3's constant 10 % too large: its own load grows so, inner joints are off, by as much as is said."""
    robot = robot_called("ur5e")
    estimate, (position, _) = fitted(robot), motions(robot, count=4000)
    wrong = given(robot) | {3: 1.1 * given(robot)[3]}
    found = export(estimate, robot, form="mjcf", torque_constants=wrong)
    feels = by_mujoco(found.files[".xml"], position)
    wanted = weight(robot, estimate, position) * np.array(list(wrong.values()))
    size = np.sqrt(np.mean((feels - wanted) ** 2, axis=0))
    told = {int(text.split(":")[0][6:]): float(text.split()[5]) for text in found.remarks if "RMS" in text}
    assert sorted(told) == [2, 3] and size[3:].max() < ROUNDED
    assert np.allclose([told[2], told[3]], size[1:3], rtol=0.15)  # two hundred postures against four thousand
    assert [text for text in found.remarks if "joints 3 and 4" in text and "the logs say" in text]


def test_a_sign_against_the_logs_is_told():
    """All constants given as positive where the logs say that one motor counts backwards."""
    robot = robot_called("puma560")
    estimate = fitted(robot)
    backwards = np.flatnonzero(gains(robot) < 0.0) + 1
    found = export(estimate, robot, form="urdf", torque_constants={n: abs(k) for n, k in given(robot).items()})
    assert backwards.size and [text for text in found.remarks if "of the other sign" in text]
    assert [text for text in found.remarks if f"friction of joint {backwards[0]} comes out as -" in text]


@pytest.mark.parametrize("value", [-0.04, None])
def test_a_ratio_that_is_not_told_gives_no_torque_constant(value):
    """Where zero is within its interval, or it is not identifiable, either side has constants of its own."""
    robot = robot_called("ur5e")
    estimate = fitted(robot)
    open_ratio = Value("gain_ratio.4.5", "", 4, "", value, *(() if value is None else (0.09, (-0.22, 0.14))))
    found = export(replace(estimate, values=(*estimate.values, open_ratio)), robot, form="mjcf")
    gears = np.abs([float(motor.get("gear")) for motor in ElementTree.fromstring(found.files[".xml"]).iter("motor")])
    assert gears[:4].max() == gears[4:].max() == 1.0
    assert value is None or [text for text in found.remarks if "not even the sign" in text]


def test_an_identified_ratio_past_one_that_is_not_ties_what_is_beyond():
    """Joint 4 tells nothing of joint 5, but joint 3 does: constants of 5 and 6 follow from joint 3's."""
    robot = robot_called("ur5e")
    estimate, true = fitted(robot), gains(robot)
    ratio = true[4] / true[2]
    values = (Value("gain_ratio.4.5", "", 4, "", None), Value("gain_ratio.3.5", "", 3, "", ratio, 0.01 * ratio))
    found = export(replace(estimate, values=(*estimate.values, *values)), robot, form="mjcf", torque_constants={3: 7.0})
    gears = [float(motor.get("gear")) for motor in ElementTree.fromstring(found.files[".xml"]).iter("motor")]
    assert np.allclose(gears, 7.0 * true / true[2])


def test_torques_in_the_logs_need_no_constant():
    robot = robot_called("ur5e")
    robot = replace(robot, log=replace(robot.log, units={"current": "Nm"}))
    found = export(fitted(robot), robot, form="mjcf")
    gears = [float(motor.get("gear")) for motor in ElementTree.fromstring(found.files[".xml"]).iter("motor")]
    assert gears == [1.0] * 6 and not [text for text in found.remarks if "was given" in text]


def test_a_slide_with_a_negative_mass_is_refused():
    robot = robot_called("stanford")
    wrong = given(robot) | {3: -given(robot)[3]}
    with pytest.raises(ModelError, match="would carry -") as caught:
        export(fitted(robot), robot, form="urdf", torque_constants=wrong)
    assert caught.value.slug == "torque-constants"


def test_a_load_that_hides_in_friction_is_written_as_weight():
    """A slide along gravity: the mean of its two Coulomb terms is the load that the engine then feels."""
    robot = replace(random_arm("PR", np.random.default_rng(2)), gravity=(0.0, 0.0, -9.8))
    upright = replace(robot.joints[0], alpha=0.0)
    robot = replace(robot, joints=(upright, robot.joints[1]))
    estimate = fitted(robot)
    values = np.array(estimate.solution)
    for way, sign in (("plus", 1.0), ("minus", -1.0)):
        values[estimate.names.index(f"coulomb.j1.{way}")] = 2.0 + 0.3 * sign
    found = export(replace(estimate, solution=values), robot, form="mjcf", torque_constants={1: 10.0, 2: 5.0})
    assert np.allclose(by_mujoco(found.files[".xml"], np.zeros((1, 2)))[0, 0], 20.0)
    assert np.isclose(mujoco.MjModel.from_xml_string(found.files[".xml"]).dof_frictionloss[0], 3.0)


def test_names_are_escaped():
    """Quotes, brackets, ampersands, dashes and control characters in names: both engines still load the files."""
    robot = robot_called("crane")
    joints = tuple(replace(joint, name=f'<a "{joint.number}" & -- > \x07 é') for joint in robot.joints)
    robot = replace(robot, name="<!-- -->", joints=joints)
    estimate = fitted(robot)
    model = pin.buildModelFromXML(export(estimate, robot, form="urdf").files[".urdf"])
    other = mujoco.MjModel.from_xml_string(export(estimate, robot, form="mjcf").files[".xml"])
    assert model.names[1] == other.joint(0).name == '<a "1" & -- > _ é'


@pytest.mark.parametrize(("text", "wanted"), [("1, -2,3e1", {1: 1.0, 2: -2.0, 3: 30.0}), ("2=-4.5", {2: -4.5})])
def test_constants_as_typed(text, wanted):
    assert read_constants(text, 3) == wanted


@pytest.mark.parametrize("text", ["1,2", "", "0,1,2", "4=1", "1=2,1=3", "nan,1,2", "1=x"])
def test_constants_that_are_none(text):
    """Too few, none, zero, of no joint, twice, no number: refused with what is wrong."""
    with pytest.raises(ModelError) as caught:
        read_constants(text, 3)
    assert caught.value.slug == "torque-constants"
