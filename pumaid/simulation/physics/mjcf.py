"""A virtual robot as an MJCF model: the text that the rigid-body engine MuJoCo reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pumaid.errors import ModelError
from pumaid.simulation.shafts import shafts
from pumaid.simulation.truth import Truth

Floats = NDArray[np.float64]

#: A link is taken for a solid cylinder of its length, its radius this share of that; at least this share of the reach.
_RADIUS, _SHORTEST = 0.25, 0.08
#: Dry friction is held this stiffly: a loaded joint at rest creeps by some 1e-6 rad/s.
_HARD = "0.9999 0.9999 0.001 0.5 2"


def mjcf(truth: Truth, *, step: float = 0.001) -> str:
    """The arm of a virtual robot as MJCF text; every joint's position is the one that the recipe measures.

    Body ``link<k>`` carries joint ``joint<k>`` about (along) its z axis, frames being those of the recipe (modified
    Denavit-Hartenberg). Masses and centres are the truth's, inertia tensors those of solid cylinders of the links'
    lengths, ``armature`` the motors' inertia. Dry friction is ``frictionloss``, half the sum of both directions'
    Coulomb terms; where gears couple joints it is that of tendons ``shaft<k>``. What differs between directions,
    viscous friction, stiction and everything hidden are left to
    whoever steps the model: see `pumaid.simulation.physics.rigid.Rigid`.

    Parameters
    ----------
    truth
        A robot with masses and gains (`pumaid.simulation.draw`).
    step
        s of the engine's steps.

    Raises
    ------
    ModelError [physics-wrong]
        The robot is known by its constants in amperes alone, or a motor's inertia counts against its gain.

    Examples
    --------
    >>> from pumaid.simulation import draw, table1
    >>> text = mjcf(draw(table1.robot(), 3))
    >>> text.count("<body")
    6
    """
    if truth.links is None or truth.gain is None:
        what = f"{truth.robot.name} is known by its constants in amperes alone, and rigid bodies need masses"
        raise ModelError("physics-wrong", what, mend="leave out --truth table1, or give a truth with masses")
    armature, dry = truth.inertia / truth.gain, truth.coulomb / np.abs(truth.gain)
    if np.any(armature < 0):
        what = f"inertia and gain of joint {int(np.argmin(armature)) + 1} have opposite signs"
        raise ModelError("physics-wrong", what, mend="give both the sign with which the motor counts its current")
    tensors = _tensors(truth)
    coupled = bool(truth.robot.coupling)
    held = f'solimpfriction="{_HARD}" solreffriction="{_text([2 * step])} 1"'
    lines = []
    for k, joint in enumerate(truth.robot.joints):
        place = [joint.a, -joint.d * np.sin(joint.alpha), joint.d * np.cos(joint.alpha)]
        turn = (Rotation.from_rotvec([joint.alpha, 0, 0]) * Rotation.from_rotvec([0, 0, joint.theta])).as_quat()
        T = tensors[k]
        inertia = [T[0, 0], T[1, 1], T[2, 2], T[0, 1], T[0, 2], T[1, 2]]
        kind = "hinge" if joint.is_revolute else "slide"
        lines += [
            f'<body name="link{k + 1}" pos="{_text(place)}" quat="{_text(turn[[3, 0, 1, 2]])}">',
            f'<inertial pos="{_text(truth.links.centre[k])}" mass="{_text([truth.links.mass[k]])}"'
            f' fullinertia="{_text(inertia)}"/>',
            f'<joint name="joint{k + 1}" type="{kind}" axis="0 0 1" armature="{_text([armature[k]])}"'
            + ("/>" if coupled else f' frictionloss="{_text([dry[k]])}" {held}/>'),
        ]
    body = "\n".join([*lines, *["</body>"] * truth.robot.n_joints])
    gravity = _text(truth.robot.gravity)
    return (
        f'<mujoco model="arm">\n<compiler angle="radian" autolimits="false"/>\n'
        f'<option timestep="{_text([step])}" gravity="{gravity}" integrator="implicitfast" iterations="50"'
        f' tolerance="1e-12"/>\n<worldbody>\n{body}\n</worldbody>\n'
        f"{_tendons(truth, dry, held) if coupled else ''}</mujoco>\n"
    )


def _tendons(truth: Truth, dry: Floats, held: str) -> str:
    """Shafts of coupled motors, with the friction that acts on them; the inertia of rotors is left at their joints."""
    lines = []
    for k, row in enumerate(shafts(truth.robot)):
        turned = "".join(f'<joint joint="joint{j + 1}" coef="{_text([row[j]])}"/>' for j in np.flatnonzero(row))
        lines.append(f'<fixed name="shaft{k + 1}" frictionloss="{_text([dry[k]])}" {held}>{turned}</fixed>')
    return "<tendon>\n" + "\n".join(lines) + "\n</tendon>\n"


def _tensors(truth: Truth) -> Floats:
    """(J, 3, 3) kg m2 about the centres of mass: solid cylinders that lie along the links."""
    assert truth.links is not None
    joints = truth.robot.joints
    along = np.zeros((len(joints), 3))
    for i, after in enumerate(joints[1:]):
        along[i] = [after.a, -after.d * np.sin(after.alpha), after.d * np.cos(after.alpha)]
    length = np.linalg.norm(along, axis=1)
    shortest = _SHORTEST * (float(np.sum(length)) or 1.0)
    # A link without length (a wrist's) is as long as it is thick, along its own axis.
    unit = np.where(length[:, None] > 1e-9, along / np.maximum(length, 1e-9)[:, None], [0.0, 0.0, 1.0])
    size = np.maximum(length, shortest)
    radius = np.maximum(_RADIUS * size, 0.5 * shortest)
    lengthwise = 0.5 * radius**2
    across = (3 * radius**2 + size**2) / 12
    outer = unit[:, :, None] * unit[:, None, :]
    shape = across[:, None, None] * (np.eye(3) - outer) + lengthwise[:, None, None] * outer
    return np.asarray(truth.links.mass[:, None, None] * shape)


def _text(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, dtype=float))
