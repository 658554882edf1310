"""Chains of bodies that have the model's loads, with symmetric friction: URDF, and MJCF with motors in ampere."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from pumaid.exports import Form, Subject, head
from pumaid.exports.formulas import Lack
from pumaid.maths import Floats
from pumaid.robot import Robot, roll_pitch_yaw

#: What stands for a limit that the recipe does not give: URDF asks for a number.
NO_LIMIT = 1e6

_PHYSICS = (
    "masses, Coulomb and viscous friction have no place for it; c, python, json and matlab have where it can be written"
)


def xml_name(text: str) -> str:
    """A name without what XML cannot hold, such as control characters."""
    return "".join(letter if letter.isprintable() else "_" for letter in text)


def add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    """A new element in `parent`; no number is rounded, and zero has no sign."""
    out = ET.SubElement(parent, tag)
    for name, value in attributes.items():
        out.set(name, value if isinstance(value, str) else " ".join(repr(x + 0.0) for x in np.ravel(value).tolist()))
    return out


def written(root: ET.Element, subject: Subject, *, left_out: tuple[Lack, ...], remarks: Sequence[str]) -> str:
    """A whole XML file, with a comment at its head that says what it is and what is not in it."""
    ET.indent(root)
    comment = "\n".join(f"  {line}".rstrip() for line in head(subject, left_out, remarks))
    return f'<?xml version="1.0" encoding="utf-8"?>\n<!--\n{comment}\n-->\n{ET.tostring(root, encoding="unicode")}\n'


def not_of_bodies(subject: Subject) -> tuple[Lack, ...]:
    """What a chain of bodies with friction leaves out of a model."""
    formulas = subject.formulas
    lacks = {lack.name: lack for lack in formulas.left_out}
    for term in formulas.terms:
        lacks.setdefault(term.effect, Lack(term.effect, _PHYSICS))
    lacks["direction"] = Lack("direction of friction", "the mean of forward and backward is written")
    if (formulas.shaft != 0).sum() > len(formulas.shaft):
        lacks["shaft"] = Lack("coupled gears", "friction follows each joint's own velocity, not its motor shaft's")
    if not formulas.is_dynamic:
        lacks["inertia"] = Lack(
            "inertia", "moments of inertia are made up (balls of aluminium), no current showed them; rotors have none"
        )
    return tuple(lacks.values())


def urdf(subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
    """A URDF; gravity has no place there, so that a fixed joint turns the base until it is along -z of the world."""
    robot, held = subject.formulas.robot, subject.bodies
    assert held is not None
    gravity = float(np.linalg.norm(robot.gravity))
    lacks = [
        *not_of_bodies(subject),
        Lack("size of gravity", f"set {gravity:.6g} m/s2 along -z in the program that reads it"),
    ]
    if any(joint.limits is None or joint.max_velocity is None for joint in robot.joints):
        lacks.append(
            Lack(
                "limits",
                f"limits that the recipe does not give are written as {NO_LIMIT:g}; a joint that turns is continuous",
            )
        )
    centres, tensors = held.centres, held.tensors
    if held.rotors.any():
        lacks.append(_rotors(robot, held.rotors, tensors))
    left_out = (*lacks, Lack("effort", f"no current limit is known, so effort is written as {NO_LIMIT:g}"))
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
        add(inertial, "origin", xyz=centres[i], rpy="0 0 0")
        add(inertial, "mass", value=held.masses[i])
        add(inertial, "inertia", **dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), tensors[i], strict=True)))
    remark = f"Gravity: 0 0 -{gravity!r} m/s2 in the world."
    return {".urdf": written(root, subject, left_out=left_out, remarks=(*held.remarks, remark))}, left_out


def _rotors(robot: Robot, rotors: Floats, tensors: Floats) -> Lack:
    """What is said of rotors, after that of the first joint, where it turns, became a disc of its link's tensor."""
    beside = rotors.copy()
    if robot.joint(1).is_revolute:
        tensors[0, [0, 3, 5]] += np.array([0.5, 0.5, 1.0]) * rotors[0]
        beside[0] = 0.0
    sizes = ", ".join(map(repr, beside.tolist()))
    return Lack(
        "inertia of rotors",
        f"URDF has no place for it; set {sizes} kg m2 (kg of a slide) where it is read (pinocchio's armature)",
    )


def _joint(
    root: ET.Element, name: str, kind: str, *, links: tuple[str, str], frame: tuple[Floats, Floats]
) -> ET.Element:
    """A joint from one link to another, which stands at `frame`: (3,) m and a (3, 3) rotation."""
    out = add(root, "joint", name=name, type=kind)
    add(out, "origin", xyz=frame[0], rpy=roll_pitch_yaw(frame[1]))
    add(out, "parent", link=links[0])
    add(out, "child", link=links[1])
    return out


def mjcf(subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
    """A chain for MuJoCo; a motor's control is its current: its gear is the torque constant."""
    robot, held = subject.formulas.robot, subject.bodies
    assert held is not None
    left_out = (*not_of_bodies(subject), Lack("speed limits", "MJCF has no place for them"))
    root = ET.Element("mujoco", model=xml_name(robot.name))
    add(root, "compiler", angle="radian", autolimits="true", balanceinertia="false", inertiafromgeom="false")
    add(root, "option", gravity=[0.0, 0.0, -float(np.linalg.norm(robot.gravity))])
    parent = add(add(root, "worldbody"), "body", name="base", xyaxes=held.mount[:, :2].T)
    actuators, centres, tensors = ET.Element("actuator"), held.centres, held.tensors
    for i, joint in enumerate(robot.joints):
        name, place, turn = xml_name(joint.name), joint.frame[:3, 3], joint.frame[:3, :3]
        parent = add(parent, "body", name=f"link{joint.number}", pos=place, xyaxes=turn[:, :2].T)
        add(parent, "inertial", pos=centres[i], mass=held.masses[i], fullinertia=tensors[i, [0, 3, 5, 1, 2, 4]])
        limits = {} if joint.limits is None else {"range": joint.limits}
        add(
            parent,
            "joint",
            name=name,
            type="hinge" if joint.is_revolute else "slide",
            axis="0 0 1",
            **limits,
            frictionloss=held.friction[i],
            damping=held.damping[i],
            armature=held.rotors[i],
        )
        add(actuators, "motor", name=name, joint=name, gear=held.torques[i])
    root.append(actuators)
    remark = "Motors take their current in A; their gear is the torque constant in N m/A (N/A)."
    return {".xml": written(root, subject, left_out=left_out, remarks=(*held.remarks, remark))}, left_out


FORMS = {"urdf": Form(urdf, has_bodies=True), "mjcf": Form(mjcf, has_bodies=True)}
