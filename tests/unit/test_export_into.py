"""Friction and armature written into a user's own URDF or MJCF: engines feel them, and no other letter changes."""

import difflib
import re
from dataclasses import replace

import numpy as np
import pytest

from pumaid.errors import ModelError, RecipeError
from pumaid.estimate import NOT_IDENTIFIABLE, Value
from pumaid.exports import export
from pumaid.robot import EffectChoice
from tests.exported import fitted, motions, robot_called
from tests.unit.test_export_dynamics import case
from tests.unit.test_export_masses import gains, given

mujoco = pytest.importorskip("mujoco", reason="an engine is mujoco (pip install pumaid[test])")

#: Six digits are written, and MuJoCo's friction is a constraint that is softly held.
WRITTEN = 1e-4


def users_file(robot, estimate, form: str) -> str:
    """An arm of other friction: comments, CRLF, a default class, joints with and without dynamics, an equality."""
    text = next(iter(export(estimate, robot, form=form, torque_constants=given(robot)).files.values()))
    first, last = (re.escape(robot.joints[place].name) for place in (0, -1))
    if form == "urdf":
        text = re.sub(r"( *<dynamics)[^>]*>", r"""\1 friction='7'\n      damping = "3" />""", text)
        text = re.sub(rf'(<joint name="{first}".*?)\n *<dynamics[^>]*>', r"\1", text, flags=re.DOTALL)
        text = re.sub(rf'(<joint name="{first}"[^>]*>)', r"\1\n    <!-- </joint> -->", text)
        motor = f'<transmission name="t"><joint name="{first}"><hardwareInterface/></joint></transmission>'
        text = text.replace("</robot>", f"{motor}\n</robot>")
    else:
        text = re.sub(r' (damping|frictionloss|armature)="[^"]*"', "", text)
        text = re.sub(rf'(<joint name="{last}"[^>]*?) />', r"""\1 damping='3' frictionloss = "7"/>""", text)
        text = text.replace(
            "<worldbody>", '<default><joint damping="5 3 2" frictionloss="6"/></default>\n  <worldbody>'
        )
        text = text.replace(
            "</mujoco>", f'  <equality><joint name="e" joint1="{first}" active="false"/></equality>\n</mujoco>'
        )
    return text.replace("\n", "\r\n") + f'<!-- <joint name="{first}" type="hinge"/> é -->\r\n'


def pushed(text: str, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(J,) N m that MuJoCo asks in a posture at constant speeds."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.dof_invweight0[:] = 1e-6  # friction is a soft constraint, which light links would not saturate
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = position, velocity, 0.0
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("name", ["ur5e", "stanford", "panda"])
def test_the_engine_feels_the_models_friction(name, form):
    """What constant speed asks beyond the opposite speed is the model's friction times the constants, signs or not."""
    robot = robot_called(name)
    estimate = fitted(robot)
    known, numbers = dict(zip(estimate.names, estimate.solution, strict=True)), range(1, robot.n_joints + 1)
    constants = {joint: abs(value) for joint, value in given(robot).items()}
    found = export(estimate, robot, into=users_file(robot, estimate, form), torque_constants=constants)
    position, velocity = (part[0] for part in motions(robot))
    (text,) = found.files.values()
    both = pushed(text, position, velocity) - pushed(text, position, -velocity)
    dry = [known[f"coulomb.j{n}.plus"] - known[f"coulomb.j{n}.minus"] for n in numbers]
    rise = [known[f"viscous.j{n}.plus"] + known[f"viscous.j{n}.minus"] for n in numbers]
    assert np.allclose(both, gains(robot) * (np.sign(velocity) * dry + velocity * rise), rtol=WRITTEN)


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_only_dynamics_of_joints_change(form):
    """All else stays to the letter; where a joint had no <dynamics>, a line is added."""
    robot = robot_called("stanford")
    estimate = fitted(robot)
    before = users_file(robot, estimate, form)
    (after,) = export(estimate, robot, into=before, torque_constants=given(robot)).files.values()
    lines = [line for line in difflib.ndiff(before.split("\r\n"), after.split("\r\n")) if line[0] in "+-"]
    bare = {
        re.sub(r""" ?(damping|friction|frictionloss) ?= ?("[^"]*"|'[^']*')""", "", line[1:]).strip() for line in lines
    }
    words = "<dynamics" if form == "urdf" else "<joint"
    assert lines and all(words in line or "damping" in line for line in lines)
    assert len(bare) <= (3 if form == "urdf" else 6) and "\r\n".join(after.split("\r\n")) == after


def test_armature_is_the_rotors_inertia():
    """Of joints whose rotors any motion tells apart from their links; a slide's first joint keeps the file's own."""
    robot, estimate, _, _, constants = case("puma560")
    values = estimate.solution.copy()
    for joint, constant in constants.items():  # friction opposes motion
        for way, sign in (("plus", 1.0), ("minus", -1.0)):
            values[estimate.names.index(f"coulomb.j{joint}.{way}")] = sign / constant
    estimate = replace(estimate, solution=values)
    before = export(estimate, robot, form="mjcf", torque_constants=constants).files[".xml"]
    before = re.sub(r'armature="[^"]*"', 'armature="0.5"', before)
    model = mujoco.MjModel.from_xml_string(
        export(estimate, robot, into=before, torque_constants=constants).files[".xml"]
    )
    known = dict(zip(estimate.names, estimate.solution, strict=True))
    wanted = [known[f"rotor.j{n}"] * constants[n] for n in range(3, 7)]
    assert np.allclose(model.dof_armature[2:], wanted, rtol=WRITTEN) and model.dof_armature[0] == 0.5
    before = export(estimate, robot, form="urdf", torque_constants=constants).files[".urdf"]
    *_, rotors = export(estimate, robot, into=before, torque_constants=constants).left_out
    assert re.findall(r"\(joint (\d)\)", rotors.reason) == ["3", "4", "5", "6"]


def test_what_has_no_place_is_told_with_its_size():
    """Asymmetric friction and Stribeck's, at the joint that has them, in N m."""
    robot = robot_called("ur5e")
    effects = (EffectChoice("stribeck", 3, {"velocity": 0.2, "exponent": 1.0}),)
    estimate = fitted(robot, effects=effects)
    peak = dict(zip(estimate.names, estimate.solution, strict=True))["stribeck.j3.a"]
    found = export(estimate, robot, into=users_file(robot, estimate, "mjcf"), torque_constants=given(robot))
    reasons = {lack.name: lack.reason for lack in found.left_out}
    size = float(re.search(r"([\d.e+-]+) at joint 3$", reasons["stribeck@3"])[1])
    assert size >= 0.95 * abs(peak * gains(robot)[2]) and "at joint 2" in reasons["direction of friction"]


def test_what_the_data_do_not_tell_stays():
    """A joint whose viscous friction is not identified keeps both of the file's numbers."""
    robot = robot_called("ur5e")
    estimate = fitted(robot)
    lost = Value("viscous.j6.plus", "", 6, "", None, state=NOT_IDENTIFIABLE, reason="one speed only")
    cut = replace(estimate, values=(*(v for v in estimate.values if v.name != lost.name), lost))
    text = export(cut, robot, into=users_file(robot, estimate, "mjcf"), torque_constants=given(robot)).files[".xml"]
    model = mujoco.MjModel.from_xml_string(text)
    assert (model.dof_damping[5], model.dof_frictionloss[5]) == (3.0, 7.0) and model.dof_damping[4] != 5.0


def test_names_with_words_around_are_the_joints_where_only_one_has_them():
    """shoulder_pan_joint is shoulder_pan; of left_elbow and right_elbow none is the elbow."""
    robot = robot_called("ur5e")
    estimate = fitted(robot)
    text = re.sub(r'joint name="(\w+)"', r'joint name="left/\1_joint"', users_file(robot, estimate, "urdf"))
    assert export(estimate, robot, into=text, torque_constants=given(robot)).files[".urdf"].count("friction='7'") == 0
    doubled = text.replace("<link", '<joint name="right/elbow_joint" type="revolute"></joint><link', 1)
    with pytest.raises(RecipeError, match="no joint is clearly elbow") as caught:
        export(estimate, robot, into=doubled, torque_constants=given(robot))
    assert caught.value.slug == "into-refused"


@pytest.mark.parametrize("text", ["no xml", "<robot/>", "<mujoco><include file='arm.xml'/></mujoco>"])
def test_a_file_without_the_joints_is_refused(text):
    robot = robot_called("ur5e")
    with pytest.raises(RecipeError, match="shoulder_pan, shoulder_lift") as caught:
        export(fitted(robot), robot, into=text, torque_constants=given(robot))
    assert "MJCF includes" in caught.value.mend


def test_currents_are_not_taken_for_torques():
    """Without a torque constant nothing is written, and the joints that need one are named."""
    robot = robot_called("ur5e")
    estimate = fitted(robot)
    with pytest.raises(ModelError, match="joints 1, 2, 3, 4, 5, 6") as caught:
        export(estimate, robot, into=users_file(robot, estimate, "urdf"))
    assert caught.value.slug == "torque-constants"
