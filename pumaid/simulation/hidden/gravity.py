"""Weight that is not where the recipe has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden.law import Hidden, Law, Reach, Typical
from pumaid.simulation.hidden.state import State
from pumaid.simulation.weight import Weight

Floats = NDArray[np.float64]

#: Rounds in which a sagging drive comes to rest: each adds a digit or two where it sags by a tenth of a radian.
_ROUNDS = 30
#: A: a change that is none.
_SETTLED = 1e-10


def _extra(at: State, weight: Weight, position: Floats) -> Floats:
    """(N,) A more in the joint than the arm of the recipe would need."""
    return np.asarray(weight.current(position)[:, at.joint - 1] - at.own)


def _tilt(at: State, one: Hidden) -> Floats:
    return _extra(at, at.weight.turned(one["x"], one["y"]), at.arm.position)


def _payload(at: State, one: Hidden) -> Floats:
    more = _extra(at, at.weight.loaded(one["mass"], (one["x"], one["y"], one["z"])), at.arm.position)
    return more * (at.elapsed > one["time"])


def _zero_offset(at: State, one: Hidden) -> Floats:
    true = at.arm.position.copy()
    true[:, (one.joint or at.joint) - 1] += one["delta"]
    return _extra(at, at.weight, true)


def _flexibility(at: State, one: Hidden) -> Floats:
    """The link stands where drive and weight agree: c times its load there below the motor, whichever joint moves."""
    soft = (one.joint or at.joint) - 1
    load, link = at.load, at.arm.position.copy()
    for _ in range(_ROUNDS):
        link[:, soft] = at.arm.position[:, soft] - at.sides[soft] * one["c"] * load[:, soft]
        before, load = load, at.weight.current(link)
        if np.max(np.abs(load - before), initial=0.0) < _SETTLED:
            break
    return np.asarray(load[:, at.joint - 1] - at.own)


def _coupling(at: State, one: Hidden) -> Floats:
    if one.joint is None or at.joint != int(one["on"]):
        return np.zeros(len(at.position))
    cause = one.joint - 1
    return np.asarray(one["c"] * (at.load[:, cause] + at.friction(one.joint, at.arm.velocity[:, cause])))


def _usual_coupling(joint: Typical) -> tuple[float, ...]:
    """On the motor before: a drive passes through the joints before its own."""
    return 0.4 * joint.before / joint.load, float(joint.joint - 1 if joint.joint > 1 else 2)


LAWS = {
    "tilt": Law(("x", "y"), lambda joint: (0.04, -0.03), _tilt, reach=Reach.ARM, is_slow=True),
    "zero_offset": Law(("delta",), lambda joint: (0.06,), _zero_offset, reach=Reach.CAUSE, is_slow=True),
    "payload": Law(
        ("mass", "x", "y", "z", "time"),
        lambda joint: (joint.last_mass, 0.0, 0.03 * joint.reach, 0.05 * joint.reach, 600.0),
        _payload,
        reach=Reach.ARM,
        letters={"t_0": "time"},
        needs_masses=True,
        is_slow=True,
    ),
    "flexibility": Law(("c",), lambda joint: (0.08 / joint.most,), _flexibility, reach=Reach.CAUSE, is_slow=True),
    "coupling": Law(("c", "on"), _usual_coupling, _coupling, reach=Reach.CAUSE, letters={"m": "on"}),
}
