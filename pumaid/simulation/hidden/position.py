"""What depends on where the joint stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.law import Hidden, Law
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]


def _position_friction(at: State, one: Hidden) -> Floats:
    angle = one["harmonic"] * at.position
    return np.asarray(at.opposing * (one["cos"] * np.cos(angle) + one["sin"] * np.sin(angle)))


def _ripple(at: State, one: Hidden) -> Floats:
    angle = one["frequency"] * at.position
    return np.asarray(one["cos"] * np.cos(angle) + one["sin"] * np.sin(angle))


def _spring(at: State, one: Hidden) -> Floats:
    return np.asarray(one["a"] * at.position)


def _counterbalance(at: State, one: Hidden) -> Floats:
    """A constant force along a cylinder from a foot at distance 1 to a lever of length c: force times lever arm."""
    angle = at.position - one["angle"]
    foot, lever = np.array([1.0, 0.0]), one["length"] * np.column_stack([np.cos(angle), np.sin(angle)])
    along = lever - foot
    along /= np.linalg.norm(along, axis=1)[:, None]
    arm = (lever[:, 0] * along[:, 1] - lever[:, 1] * along[:, 0]) / one["length"]
    return np.asarray(one["a"] * arm)


LAWS = {
    "position_friction": Law(
        ("cos", "sin", "harmonic"),
        lambda joint: (0.25 * joint.coulomb, 0.2 * joint.coulomb, 2.0),
        _position_friction,
        letters={"a": "cos", "b": "sin", "k": "harmonic"},
        opposes=True,
    ),
    "ripple": Law(
        ("cos", "sin", "frequency"),
        # Twenty waves over the span: slow enough for any log, fast enough to be no gravity.
        lambda joint: (0.15 * joint.coulomb, 0.1 * joint.coulomb, float(round(20 * np.pi / joint.half_span))),
        _ripple,
        letters={"a": "cos", "b": "sin", "f": "frequency"},
    ),
    "spring": Law(("a",), lambda joint: (joint.coulomb / joint.half_span,), _spring),
    "counterbalance": Law(
        ("a", "length", "angle"),
        lambda joint: (joint.coulomb, 0.6, 0.5),
        _counterbalance,
        letters={"c": "length", "p": "angle"},
    ),
}
