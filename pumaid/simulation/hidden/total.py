"""What hidden effects make of a joint's current."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError, Where
from pumaid.simulation.hidden.catalogue import LAWS
from pumaid.simulation.hidden.law import Hidden, Reach
from pumaid.simulation.hidden.state import State

Floats = NDArray[np.float64]

#: s; a run lasts about as long.
_LATEST = 1.0


def total(hidden: Sequence[Hidden], at: State, current: Floats) -> Floats:
    """The joint's current with everything hidden: what adds is added, then laws of the whole current act on the sum.

    Parameters
    ----------
    hidden
        With all their values, see `sized`.
    at
        The joint.
    current
        (N,) A without anything hidden.
    """
    found = current.copy()
    for one in felt(hidden, at.joint):
        adds = LAWS[one.effect].adds
        if adds is not None:
            found += adds(at, one)
    return bent(hidden, at, found)


def bent(hidden: Sequence[Hidden], at: State, current: Floats) -> Floats:
    """What laws of the whole current make of a joint's current (N,) A; what adds is in it already.

    Parameters
    ----------
    hidden, at, current
        As for `total`.
    """
    found = current
    for name, law in LAWS.items():
        for one in felt(hidden, at.joint):
            if one.effect == name and law.bends is not None:
                found = law.bends(at, one, found)
    return found


def felt(hidden: Sequence[Hidden], joint: int) -> list[Hidden]:
    """Those that joint `joint` (from 1) can feel."""
    return [one for one in hidden if LAWS[one.effect].reach is not Reach.JOINT or one.joint in (None, joint)]


def delays(hidden: Sequence[Hidden], n_joints: int) -> Floats:
    """(J,) s by which each joint's current is stamped late.

    Raises
    ------
    ModelError [hide-wrong]
        It is early, or later than any clock that is read.
    """
    late = np.zeros(n_joints)
    for one in hidden:
        if one.effect == "delay":
            if not 0.0 <= one["dt"] <= _LATEST:
                what = f"a current cannot be logged {one['dt']:g} s late"
                raise ModelError("hide-wrong", what, Where(field="--hide delay"), f"give dt from 0 to {_LATEST:g} s")
            late[slice(None) if one.joint is None else one.joint - 1] += one["dt"]
    return late
