"""MJCF: the chain for MuJoCo, with masses that have the model's weight, symmetric friction and motors in ampere."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from pumaid.exports.base import Form, Subject
from pumaid.exports.formulas import Lack
from pumaid.exports.robot_xml import bodies_of, spaced, weights_only, written, xml_name
from pumaid.robot import Joint

Floats = NDArray[np.float64]


class Mjcf(Form):
    """A motor's control is its current: its gear is the torque constant."""

    title = "MJCF for MuJoCo: masses with the model's weight, mean friction, limits, motors driven in ampere"
    has_bodies = True

    def left_out(self, subject: Subject) -> tuple[Lack, ...]:
        return (*weights_only(subject), Lack("speed limits", "MJCF has no place for them"))

    def texts(self, subject: Subject) -> dict[str, str]:
        robot, held = subject.formulas.robot, bodies_of(subject)
        root = ET.Element("mujoco", model=xml_name(robot.name))
        ET.SubElement(
            root, "compiler", angle="radian", autolimits="true", balanceinertia="false", inertiafromgeom="false"
        )
        ET.SubElement(root, "option", gravity=spaced([0.0, 0.0, -float(np.linalg.norm(robot.gravity))]))
        world = ET.SubElement(root, "worldbody")
        parent = ET.SubElement(world, "body", name="base", xyaxes=_axes(held.mount))
        for joint in robot.joints:
            parent = _body(parent, joint, subject)
        actuators = ET.SubElement(root, "actuator")
        for joint, torque in zip(robot.joints, held.torques, strict=True):
            name = xml_name(joint.name)
            ET.SubElement(actuators, "motor", name=name, joint=name, gear=spaced([torque]))
        remark = "Motors take their current in A; their gear is the torque constant in N m/A (N/A)."
        return {".xml": written(root, subject, left_out=self.left_out(subject), remark=remark)}


def _body(parent: ET.Element, joint: Joint, subject: Subject) -> ET.Element:
    held, i = bodies_of(subject), joint.number - 1
    turn, place = _axes(joint.frame[:3, :3]), spaced(joint.frame[:3, 3])
    body = ET.SubElement(parent, "body", name=f"link{joint.number}", pos=place, xyaxes=turn)
    size = spaced([held.inertias[i]] * 3)
    ET.SubElement(body, "inertial", pos=spaced(held.centres[i]), mass=spaced([held.masses[i]]), diaginertia=size)
    facts = {"name": xml_name(joint.name), "type": "hinge" if joint.is_revolute else "slide", "axis": "0 0 1"}
    if joint.limits is not None:
        facts["range"] = spaced(joint.limits)
    facts |= {"frictionloss": spaced([held.friction[i]]), "damping": spaced([held.damping[i]])}
    ET.SubElement(body, "joint", facts)
    return body


def _axes(rotation: Floats) -> str:
    """The x and y axes of a rotation (3, 3)."""
    return spaced([*rotation[:, 0], *rotation[:, 1]])
