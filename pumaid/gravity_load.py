"""What a fitted model says of gravity at given instants: what effects that depend on the load are made from."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pumaid.effects import catalogue
from pumaid.joint_bins import JointBins, swept
from pumaid.maths import Counts, Flags, Floats
from pumaid.samples import Loads, Samples

if TYPE_CHECKING:
    from pumaid.model import Model


def along(model: Model, samples: Samples, sizes: Counts, *, solution: Floats, scales: Floats) -> Loads:
    """`loads` along runs of `sizes` instants each, in which all joints but the moving one stand."""
    n, turns, gains = model.robot.n_joints, model.robot.joint(samples.joint).is_revolute, np.zeros(0)

    def table(knots: Samples) -> Floats:
        nonlocal gains
        knot = loads(model, knots, solution=solution, scales=scales)
        gains = knot.gains
        return np.column_stack([knot.moving, knot.across**2, knot.tilts, knot.by_joint, knot.slopes])

    values = swept(samples, sizes, table, turns=turns)
    load, across, tilts, elsewhere, slopes = np.split(values, [1, 2, 4, 4 + n], axis=1)
    drawn = load[:, 0] + _friction(model, samples, solution)
    return Loads(load[:, 0], elsewhere, slopes, tilts, np.sqrt(np.maximum(across[:, 0], 0.0)), drawn, gains)


def with_inertia(model: Model, bins: JointBins, gravity: Loads, *, weights: Floats) -> Loads:
    """Loads at the bins, or at their nodes, those in blocks of any motion with the joint's inertial load.

    `weights` (p,) are the model's parameters in the joint's own gain.
    """
    if bins.rigid_body is None or not model.is_dynamic:
        return gravity
    torque = np.repeat(bins.rigid_body @ weights[model.inertial], len(gravity.moving) // len(bins))
    moving = np.where(np.isfinite(torque), torque, gravity.moving)
    return replace(gravity, moving=moving, drawn=gravity.drawn + moving - gravity.moving)


def loads(model: Model, samples: Samples, *, solution: Floats, scales: Floats) -> Loads:
    """Gravity's currents, their slopes and the base model's prediction at M instants of one moving joint.

    With h the regrouped first moment of all links from joint i outward (base axes, in joint i's gain), gravity's moment
    about joint i is g x h and its current z_i . (g x h); a slope follows from which of z_i, h and g turn. `solution`
    (p,) are parameters and `scales` (J, J) ratios of gains as in `Estimate`; an unknown ratio counts as zero in the
    moving joint's own load and makes other joints' loads NaN.

    Source: S.-K. Lin, eq. (11), (25), in the directions of the axes.
    """
    robot, number = model.robot, samples.joint
    i, g = number - 1, np.asarray(robot.gravity, dtype=float)
    frames = robot.rotations(samples.position)
    z = frames[:, :, :, 2]
    levers = np.cross(z, g)
    moments, weights = _moments(model, frames, samples=samples, solution=solution)
    turns = robot.is_revolute
    heavy = np.abs(moments).max(axis=(0, 2)) > 0
    counted = np.where(heavy[None, :], np.triu(scales), 0.0)
    elsewhere = np.einsum("mkp,mjp,kj->mk", levers, moments, counted, optimize=True)
    elsewhere[:, ~turns] = (-(z @ g) * weights)[:, ~turns]
    ratios = np.nan_to_num(scales[i])
    parts = moments * ratios[None, :, None]
    parts[:, :i] = 0.0
    h = parts.sum(axis=1)
    load = np.einsum("mk,mk->m", levers[:, i], h) if turns[i] else elsewhere[:, i]
    slopes = np.column_stack(
        [_slope(i, m, z=z, parts=parts, weights=weights * ratios, g=g, turns=turns) for m in range(len(turns))]
    )
    turned = [np.cross(g, axis) for axis in np.eye(3)[:2]]
    felt = np.einsum("mjk,j->mk", moments, felt_ratios(heavy, scales, i))
    if turns[i]:
        tilts = np.column_stack([np.einsum("mk,mk->m", np.cross(z[:, i], way), felt) for way in turned])
        moment = np.cross(g, felt)
        across = np.linalg.norm(moment - z[:, i] * np.einsum("mk,mk->m", z[:, i], moment)[:, None], axis=1)
    else:
        tilts = np.column_stack([-(z[:, i] @ way) * weights[i] for way in turned])
        across = np.zeros(len(samples))
    drawn = load + _friction(model, samples, solution)
    return Loads(load, elsewhere, slopes, tilts, across, drawn, _gains(scales, i))


def _moments(model: Model, frames: Floats, *, samples: Samples, solution: Floats) -> tuple[Floats, Floats]:
    """(M, J, 3) first moment that each link adds, in its own gain; (J,) masses of prismatic links, else 0."""
    robot = model.robot
    out, weights = np.zeros((len(samples), robot.n_joints, 3)), np.zeros(robot.n_joints)
    reach = robot.displacements(samples.position)
    for column, value in zip(model.columns, solution, strict=True):
        if column.effect != "gravity":
            continue
        j, part = column.owner - 1, column.name.rsplit(".", 1)[1]
        if part == "mass":
            weights[j] = value
            out[:, j] = reach[:, j, None] * frames[:, j, :, 2] * value
        else:
            out[:, j] += frames[:, j, :, "xy".index(part)] * value
    return out, weights


def felt_ratios(heavy: Flags, scales: Floats, i: int) -> Floats:
    """(J,) ratios by which joint i (from 0) counts the links' moments: its own where they are known, else those of the
    next joint outward whose are (a moment across an upright axis is never told in its own gain)."""
    links = np.arange(len(scales))
    for k in range(i, len(scales)):
        beyond = heavy & (links >= k)
        if np.all(np.isfinite(scales[k][beyond])):
            return np.where(beyond, scales[k], 0.0)
    return np.zeros(len(scales))


def _slope(i: int, m: int, *, z: Floats, parts: Floats, weights: Floats, g: Floats, turns: Flags) -> Floats:
    """(M,) derivative of joint i's load by joint m's position (both from 0)."""
    if not turns[m]:
        far = weights[m] if turns[i] and m > i else 0.0
        return np.einsum("mk,mk->m", np.cross(z[:, i], g), z[:, m]) * far
    if not turns[i]:
        return -(np.cross(z[:, m], z[:, i]) @ g) * weights[i] if m < i else np.zeros(len(z))
    if m <= i:  # all of it turns: as if gravity turned the other way
        return -np.einsum("mk,mk->m", np.cross(z[:, i], np.cross(z[:, m], g)), parts.sum(axis=1))
    return np.einsum("mk,mk->m", np.cross(z[:, i], g), np.cross(z[:, m], parts[:, m:].sum(axis=1)))


def _friction(model: Model, samples: Samples, solution: Floats) -> Floats:
    """(M,) Coulomb and viscous friction of the moving joint."""
    total, values = np.zeros(len(samples)), dict(zip(model.names, solution, strict=True))
    for name in ("coulomb", "viscous"):
        columns = catalogue()[name].columns(model.robot, samples, number=samples.joint)
        parameters = catalogue()[name].parameters(model.robot, samples.joint)
        sizes = [values[f"{name}.j{samples.joint}.{parameter.name}"] for parameter in parameters]
        total += columns @ np.array(sizes)
    return total


def _gains(scales: Floats, i: int) -> Floats:
    """(J,) eta_i / eta_k."""
    inward = scales[:, i]
    with np.errstate(divide="ignore", invalid="ignore"):
        back = np.where(inward != 0.0, 1.0 / inward, np.nan)
    return np.where(np.arange(len(scales)) < i, back, scales[i])
