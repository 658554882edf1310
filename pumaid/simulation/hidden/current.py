"""What happens to the whole current of a motor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.law import Hidden, Law
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


def _torque_constant_drift(at: State, one: Hidden, current: Floats) -> Floats:
    return np.asarray(current * (1.0 + one["a"] * (1.0 - np.exp(-np.maximum(at.time, 0.0) / one["time_constant"]))))


def _torque_droop(at: State, one: Hidden, current: Floats) -> Floats:
    return np.asarray(current + one["a"] * current**3)


def _saturation(at: State, one: Hidden, current: Floats) -> Floats:
    return np.clip(current, -one["limit"], one["limit"])


#: In the order in which they act.
LAWS = {
    "torque_constant_drift": Law(
        ("a", "time_constant"),
        lambda joint: (0.15, 600.0),
        bends=_torque_constant_drift,
        letters={"T": "time_constant"},
    ),
    "torque_droop": Law(("a",), lambda joint: (0.3 / (joint.most + joint.coulomb) ** 2,), bends=_torque_droop),
    "saturation": Law(
        ("limit",), lambda joint: (0.75 * joint.most + joint.coulomb,), bends=_saturation, letters={"i_lim": "limit"}
    ),
}
