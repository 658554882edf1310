"""Friction that is not linear in speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.law import Hidden, Law, Typical
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


def _stribeck(at: State, one: Hidden) -> Floats:
    return np.asarray(at.opposing * one["a"] * np.exp(-((np.abs(at.velocity) / one["velocity"]) ** one["exponent"])))


def _viscous_power(at: State, one: Hidden) -> Floats:
    return np.asarray(at.opposing * one["b"] * np.abs(at.velocity) ** one["exponent"])


def _usual_power(joint: Typical) -> tuple[float, ...]:
    """As much as Coulomb friction at the highest speed: all but a tenth of it passes for viscous friction."""
    return joint.coulomb / joint.speed**0.4, 0.4


LAWS = {
    "stribeck": Law(
        ("a", "velocity", "exponent"),
        lambda joint: (0.4 * joint.coulomb, 0.2 * joint.speed, 1.0),
        _stribeck,
        letters={"v_s": "velocity", "d": "exponent"},
        opposes=True,
    ),
    "viscous_power": Law(("b", "exponent"), _usual_power, _viscous_power, letters={"p": "exponent"}, opposes=True),
}
