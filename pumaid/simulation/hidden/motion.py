"""What shows where a motion starts, speeds up or is stamped late."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.law import Hidden, Law
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


def _presliding(at: State, one: Hidden) -> Floats:
    return np.asarray(-at.opposing * one["a"] * np.exp(-at.arm.travel[:, at.joint - 1] / one["travel"]))


def _inertia(at: State, one: Hidden) -> Floats:
    return np.asarray(at.side * one["J"] * at.arm.acceleration[:, at.joint - 1])


def _delay(at: State, one: Hidden) -> Floats:
    """Nothing: whoever logs stamps the current later, see `delays`."""
    return np.zeros(len(at.position))


LAWS = {
    "presliding": Law(
        ("a", "travel"),
        lambda joint: (0.6 * joint.coulomb, 0.08 * joint.half_span),
        _presliding,
        letters={"x_s": "travel"},
        opposes=True,
    ),
    "inertia": Law(("J",), lambda joint: (0.5 * joint.coulomb / joint.acceleration,), _inertia),
    "delay": Law(("dt",), lambda joint: (0.04,), _delay),
}
