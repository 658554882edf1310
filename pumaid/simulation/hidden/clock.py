"""Friction that changes with time and temperature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.heat import AMBIENT
from pumaid.simulation.hidden.law import Hidden, Law
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


def _warmup(at: State, one: Hidden) -> Floats:
    return np.asarray(at.opposing * one["a"] * np.exp(-at.time / one["time_constant"]))


def _friction_step(at: State, one: Hidden) -> Floats:
    return np.asarray(at.opposing * one["a"] * (at.time > one["time"]))


def _thermal_friction(at: State, one: Hidden) -> Floats:
    return np.asarray(at.opposing * one["a"] * (at.arm.temperature[:, at.joint - 1] - AMBIENT))


LAWS = {
    "warmup": Law(
        ("a", "time_constant"),
        lambda joint: (0.4 * joint.coulomb, 600.0),
        _warmup,
        letters={"T": "time_constant"},
        opposes=True,
    ),
    "friction_step": Law(
        ("a", "time"),
        lambda joint: (0.3 * joint.coulomb, 600.0),
        _friction_step,
        letters={"t_0": "time"},
        opposes=True,
    ),
    # Grease thins: a twentieth of the friction is gone with every degree of some ten.
    "thermal_friction": Law(("a",), lambda joint: (-0.05 * joint.coulomb,), _thermal_friction, opposes=True),
}
