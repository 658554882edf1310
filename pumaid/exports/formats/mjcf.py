"""MJCF: the chain for MuJoCo, with masses that have the model's weight, symmetric friction and motors in ampere."""

import xml.etree.ElementTree as ET

import numpy as np

from pumaid.exports.base import Form, Subject, add, bodies_of, weights_only, written, xml_name
from pumaid.exports.formulas import Lack
from pumaid.maths import Floats


class Mjcf(Form):
    """A motor's control is its current: its gear is the torque constant."""

    has_bodies = True

    def left_out(self, subject: Subject) -> tuple[Lack, ...]:
        return (*weights_only(subject), Lack("speed limits", "MJCF has no place for them"))

    def texts(self, subject: Subject) -> dict[str, str]:
        robot, held = subject.formulas.robot, bodies_of(subject)
        root = ET.Element("mujoco", model=xml_name(robot.name))
        add(root, "compiler", angle="radian", autolimits="true", balanceinertia="false", inertiafromgeom="false")
        add(root, "option", gravity=[0.0, 0.0, -float(np.linalg.norm(robot.gravity))])
        parent = add(add(root, "worldbody"), "body", name="base", xyaxes=_axes(held.mount))
        actuators = ET.Element("actuator")
        for i, joint in enumerate(robot.joints):
            name, place, turn = xml_name(joint.name), joint.frame[:3, 3], joint.frame[:3, :3]
            parent = add(parent, "body", name=f"link{joint.number}", pos=place, xyaxes=_axes(turn))
            size = [held.inertias[i]] * 3
            add(parent, "inertial", pos=held.centres[i], mass=held.masses[i], diaginertia=size)
            kind = "hinge" if joint.is_revolute else "slide"
            limits = {} if joint.limits is None else {"range": joint.limits}
            friction = {"frictionloss": held.friction[i], "damping": held.damping[i]}
            add(parent, "joint", name=name, type=kind, axis="0 0 1", **limits, **friction)
            add(actuators, "motor", name=name, joint=name, gear=held.torques[i])
        root.append(actuators)
        remark = "Motors take their current in A; their gear is the torque constant in N m/A (N/A)."
        return {".xml": written(root, subject, left_out=self.left_out(subject), remark=remark)}


def _axes(rotation: Floats) -> list[float]:
    """The x and y axes of a rotation (3, 3)."""
    return [*rotation[:, 0], *rotation[:, 1]]
