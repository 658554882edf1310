"""Friction that follows the load of gears and bearings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.law import Hidden, Law
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


def _load_friction(at: State, one: Hidden) -> Floats:
    is_lifting = at.own * at.opposing > 0
    return np.asarray(at.opposing * np.abs(at.own) * np.where(is_lifting, one["drive"], one["back"]))


def _side_load_friction(at: State, one: Hidden) -> Floats:
    return np.asarray(at.opposing * one["mu"] * at.weight.across(at.arm.position)[:, at.joint - 1])


LAWS = {
    "load_friction": Law(("drive", "back"), lambda joint: (0.15, 0.1), _load_friction, opposes=True),
    "side_load_friction": Law(
        ("mu",),
        lambda joint: (0.4 * joint.coulomb / joint.across,),
        _side_load_friction,
        needs_masses=True,
        opposes=True,
        is_slow=True,
    ),
}
