"""URDF: the chain with masses that have the model's weight, and symmetric friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from pumaid.exports.base import Form, Subject
from pumaid.exports.formulas import Lack
from pumaid.exports.robot_xml import bodies_of, spaced, weights_only, written, xml_name
from pumaid.kinematics import roll_pitch_yaw
from pumaid.robot import Joint

Floats = NDArray[np.float64]

#: What stands for a limit that the recipe does not give: URDF asks for a number.
NO_LIMIT = 1e6


class Urdf(Form):
    """Gravity has no place in URDF: a fixed joint turns the base so that it is along -z of the world."""

    title = "URDF: masses with the model's weight, mean friction, the recipe's geometry and limits"
    has_bodies = True

    def left_out(self, subject: Subject) -> tuple[Lack, ...]:
        lacks = [*weights_only(subject)]
        lacks.append(Lack("size of gravity", f"set {_size(subject):.6g} m/s2 along -z in the program that reads it"))
        if any(joint.limits is None or joint.max_velocity is None for joint in subject.formulas.robot.joints):
            reason = (
                f"limits that the recipe does not give are written as {NO_LIMIT:g}; a joint that turns is continuous"
            )
            lacks.append(Lack("limits", reason))
        return (*lacks, Lack("effort", f"no current limit is known, so effort is written as {NO_LIMIT:g}"))

    def texts(self, subject: Subject) -> dict[str, str]:
        robot, held = subject.formulas.robot, bodies_of(subject)
        root = ET.Element("robot", name=xml_name(robot.name))
        ET.SubElement(root, "link", name="world")
        mount = ET.SubElement(root, "joint", name="mount", type="fixed")
        ET.SubElement(mount, "origin", xyz="0 0 0", rpy=spaced(roll_pitch_yaw(held.mount)))
        ET.SubElement(mount, "parent", link="world")
        ET.SubElement(mount, "child", link="base")
        ET.SubElement(root, "link", name="base")
        for joint in robot.joints:
            self._joint(root, joint, subject)
            i = joint.number - 1
            link = ET.SubElement(root, "link", name=f"link{joint.number}")
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "origin", xyz=spaced(held.centres[i]), rpy="0 0 0")
            ET.SubElement(inertial, "mass", value=spaced([held.masses[i]]))
            size = spaced([held.inertias[i]])
            ET.SubElement(inertial, "inertia", ixx=size, ixy="0", ixz="0", iyy=size, iyz="0", izz=size)
        remark = f"Gravity: 0 0 -{_size(subject)!r} m/s2 in the world."
        return {".urdf": written(root, subject, left_out=self.left_out(subject), remark=remark)}

    def _joint(self, root: ET.Element, joint: Joint, subject: Subject) -> None:
        held, i = bodies_of(subject), joint.number - 1
        kind = joint.kind if joint.limits is not None or not joint.is_revolute else "continuous"
        out = ET.SubElement(root, "joint", name=xml_name(joint.name), type=kind)
        turn, place = joint.frame[:3, :3], joint.frame[:3, 3]
        ET.SubElement(out, "origin", xyz=spaced(place), rpy=spaced(roll_pitch_yaw(turn)))
        ET.SubElement(out, "parent", link=f"link{i}" if i else "base")
        ET.SubElement(out, "child", link=f"link{joint.number}")
        ET.SubElement(out, "axis", xyz="0 0 1")
        limit = {"effort": spaced([NO_LIMIT]), "velocity": spaced([joint.max_velocity or NO_LIMIT])}
        if kind != "continuous":
            low, high = joint.limits or (-NO_LIMIT, NO_LIMIT)
            limit |= {"lower": spaced([low]), "upper": spaced([high])}
        ET.SubElement(out, "limit", limit)
        ET.SubElement(out, "dynamics", damping=spaced([held.damping[i]]), friction=spaced([held.friction[i]]))


def _size(subject: Subject) -> float:
    return float(np.linalg.norm(subject.formulas.robot.gravity))
