"""The truth as a document: what a test or a demo reveals at the end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.simulation.gravity import Constants, Links
from pumaid.simulation.hidden_effects import LAWS, Hidden
from pumaid.simulation.virtual_robot import Friction, Noise, Truth

Floats = NDArray[np.float64]

FORMAT = 1
#: Significant digits of what is worked out from masses and gains: the last ones of a sum differ between machines.
_DIGITS = 9
#: Postures at which a load is compared with itself.
_POSTURES = 16
#: SI; no entry of a truth is larger on any arm, and much farther on currents overflow.
_GREATEST = 1e12


def as_json(truth: Truth, *, seed: int | None = None) -> dict[str, Any]:
    """Everything about a virtual robot, SI, JSON's own types.

    `parameters` are those of the paper's model by their public names (in amperes, as `pumaid identify` gives them: the
    constant load of a slide is part of its Coulomb terms, while `friction` is friction alone);
    `gain` (A per N m or N), `mass` (kg) and `centre` (m, in each link's frame) are null for a robot that is known by
    its constants alone; those are `constants`, of revolute and prismatic links alike.

    Parameters
    ----------
    truth
        The robot.
    seed
        Of the session, where it is known.
    """
    friction, noise = truth.friction, truth.noise
    links, gain = truth.masses if truth.known is None else (None, None)
    worth, digits = truth.constants, 17 if links is None else _DIGITS
    return {
        "kind": "truth",
        "format": FORMAT,
        "pumaid": __version__,
        "robot": truth.robot.name,
        "recipe": {"file": truth.robot.origin, "sha256": truth.robot.digest},
        "seed": truth.seed if seed is None else seed,
        "parameters": {name: _short(value, digits) for name, value in _seen(truth).items()},
        "gain": None if gain is None else gain.tolist(),
        "mass": None if links is None else links.mass.tolist(),
        "centre": None if links is None else links.centre.tolist(),
        "constants": {
            part: [_short(value, digits) for value in getattr(worth, part).tolist()]
            for part in ("x", "y", "mass", "ratio")
        },
        "friction": {
            "coulomb_plus": friction.coulomb_plus.tolist(),
            "coulomb_minus": friction.coulomb_minus.tolist(),
            "viscous_plus": friction.viscous_plus.tolist(),
            "viscous_minus": friction.viscous_minus.tolist(),
        },
        "inertia": truth.inertia.tolist(),
        "breakaway": truth.breakaway.tolist(),
        "hidden": [{"effect": one.effect, "joint": one.joint, "values": dict(one.values)} for one in truth.hidden],
        "noise": {
            "std": noise.std.tolist(),
            "level_share": noise.level_share,
            "correlation_time": noise.correlation_time,
            "current_step": noise.current_step,
            "counts": None if noise.counts is None else noise.counts.tolist(),
        },
    }


def _seen(truth: Truth) -> dict[str, float]:
    """The parameters as currents show them: what a slide carries in every posture is part of its Coulomb terms."""
    values, n = truth.parameters(), truth.robot.n_joints
    # Uneven multiples: no two joints stand alike in all of them.
    load = truth.gravity_current(np.sin(np.outer(np.arange(_POSTURES), np.sqrt(2.0 + np.arange(n)))))
    is_same = np.ptp(load, axis=0) <= 1e-9 * np.max(np.abs(load), axis=0)
    for joint in truth.robot.joints:
        if is_same[joint.number - 1] and not joint.is_revolute:
            for side in ("plus", "minus"):
                values[f"coulomb.j{joint.number}.{side}"] += float(load[0, joint.number - 1])
    return values


def _short(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def from_json(document: Mapping[str, Any], robot: Robot) -> Truth:
    """The virtual robot of a document, edited or not.

    Parameters
    ----------
    document
        What `as_json` gave: masses, centres and gains where they are not null, else the constants; friction; noise.
        `parameters` is passed over: it follows from the rest.
    robot
        The arm in whose geometry it moves.

    Raises
    ------
    ModelError [truth-wrong]
        It is no such document, or an entry is missing or has another number of joints.
    """
    if document.get("kind") != "truth" or document.get("format") != FORMAT:
        what = f"the document's kind is {document.get('kind')!r} and its format {document.get('format')!r}"
        raise ModelError("truth-wrong", what, mend="give a truth.json that pumaid simulate wrote")
    n = robot.n_joints
    friction, noise = _part(document, "friction"), _part(document, "noise")
    has_links = document.get("mass") is not None
    links = Links(_array(document, "mass", (n,)), _array(document, "centre", (n, 3))) if has_links else None
    known = None
    if links is None:
        inner = _part(document, "constants")
        x, y, mass = (_array(inner, name, (n,)) for name in ("x", "y", "mass"))
        known = Constants(x, y, mass, _array(inner, "ratio", (n - 1,)))
    sides = ("coulomb_plus", "coulomb_minus", "viscous_plus", "viscous_minus")
    return Truth(
        robot=robot,
        friction=Friction(*(_array(friction, side, (n,)) for side in sides)),
        noise=Noise(
            _array(noise, "std", (n,)),
            level_share=float(_array(noise, "level_share", ())),
            correlation_time=float(_array(noise, "correlation_time", ())),
            current_step=float(_array(noise, "current_step", ())),
            counts=None if noise.get("counts") is None else _array(noise, "counts", (n,)),
        ),
        links=links,
        gain=_array(document, "gain", (n,)) if has_links else None,
        known=known,
        inertia=_array(document, "inertia", (n,)),
        hidden=tuple(_hidden(entry, n) for entry in document.get("hidden") or ()),
        # Truths of earlier versions have none: the usual one.
        breakaway=_array(document, "breakaway", (n,)) if "breakaway" in document else np.zeros(0),
    )


def _hidden(entry: object, n_joints: int) -> Hidden:
    inner = entry if isinstance(entry, Mapping) else {}
    name, joint, values = inner.get("effect"), inner.get("joint"), inner.get("values")
    is_known = name in LAWS and (joint is None or (isinstance(joint, int) and 1 <= joint <= n_joints))
    if not is_known or not isinstance(values, Mapping) or set(values) != set(LAWS[str(name)].keys):
        what = f"{str(entry)[:80]} is no hidden effect of this robot"
        raise ModelError("truth-wrong", what, Where(field="hidden"), f"known: {', '.join(LAWS)}")
    return Hidden(str(name), joint, {key: float(_array(values, key, ())) for key in values})


def _part(document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = document.get(name)
    if not isinstance(found, Mapping):
        raise ModelError("truth-wrong", f"the entry {name} is missing", Where(field=name), "simulate anew")
    return found


def _array(document: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Floats:
    try:
        found = np.array(document.get(name), dtype=float)
    except (TypeError, ValueError):
        found = np.array(np.nan)
    if found.shape != shape or not np.all(np.abs(found) <= _GREATEST):
        what = f"{name} is not {' x '.join(str(size) for size in shape) or 'one'} finite numbers up to {_GREATEST:g}"
        raise ModelError("truth-wrong", what, Where(field=name), "is it the truth of another robot?")
    return found
