"""URDF: the chain with masses that have the model's weight, and symmetric friction."""

import xml.etree.ElementTree as ET

import numpy as np

from pumaid.exports.base import Form, Subject, add, bodies_of, weights_only, written, xml_name
from pumaid.exports.formulas import Lack
from pumaid.maths import Floats
from pumaid.robot import roll_pitch_yaw

#: What stands for a limit that the recipe does not give: URDF asks for a number.
NO_LIMIT = 1e6


class Urdf(Form):
    """Gravity has no place in URDF: a fixed joint turns the base so that it is along -z of the world."""

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
        add(root, "link", name="world")
        _joint(root, "mount", "fixed", links=("world", "base"), frame=(np.zeros(3), held.mount))
        add(root, "link", name="base")
        for i, joint in enumerate(robot.joints):
            kind = joint.kind if joint.limits is not None or not joint.is_revolute else "continuous"
            links, frame = (f"link{i}" if i else "base", f"link{i + 1}"), (joint.frame[:3, 3], joint.frame[:3, :3])
            out = _joint(root, xml_name(joint.name), kind, links=links, frame=frame)
            add(out, "axis", xyz="0 0 1")
            low, high = joint.limits or (-NO_LIMIT, NO_LIMIT)
            limits = {} if kind == "continuous" else {"lower": low, "upper": high}
            add(out, "limit", effort=NO_LIMIT, velocity=joint.max_velocity or NO_LIMIT, **limits)
            add(out, "dynamics", damping=held.damping[i], friction=held.friction[i])
            inertial = add(add(root, "link", name=f"link{i + 1}"), "inertial")
            add(inertial, "origin", xyz=held.centres[i], rpy="0 0 0")
            add(inertial, "mass", value=held.masses[i])
            size = held.inertias[i]
            add(inertial, "inertia", ixx=size, ixy="0", ixz="0", iyy=size, iyz="0", izz=size)
        remark = f"Gravity: 0 0 -{_size(subject)!r} m/s2 in the world."
        return {".urdf": written(root, subject, left_out=self.left_out(subject), remark=remark)}


def _joint(
    root: ET.Element, name: str, kind: str, *, links: tuple[str, str], frame: tuple[Floats, Floats]
) -> ET.Element:
    """A joint from one link to another, which stands at `frame`: (3,) m and a (3, 3) rotation."""
    place, turn = frame
    out = add(root, "joint", name=name, type=kind)
    add(out, "origin", xyz=place, rpy=roll_pitch_yaw(turn))
    add(out, "parent", link=links[0])
    add(out, "child", link=links[1])
    return out


def _size(subject: Subject) -> float:
    return float(np.linalg.norm(subject.formulas.robot.gravity))
