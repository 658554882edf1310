"""The truth as a document: what a test or a demo reveals at the end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.simulation.hidden_effects import LAWS, Hidden
from pumaid.simulation.virtual_robot import BREAKAWAY, Constants, Friction, Links, Noise, Truth, links_of

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

    `parameters` are in amperes, as `pumaid identify` gives them; `gain`, `mass` and `centre` are null for a robot that
    is known by its constants alone.
    """
    has_masses = truth.given_constants is None
    digits = _DIGITS if has_masses else 17
    worth = _entries(truth.constants)
    return {
        "kind": "truth",
        "format": FORMAT,
        "pumaid": __version__,
        "robot": truth.robot.name,
        "recipe": {"file": truth.robot.origin, "sha256": truth.robot.digest},
        "seed": truth.seed if seed is None else seed,
        "parameters": {name: _short(value, digits) for name, value in _identifiable(truth).items()},
        "gain": truth.gain.tolist() if has_masses else None,
        "mass": truth.links.mass.tolist() if has_masses else None,
        "centre": truth.links.centre.tolist() if has_masses else None,
        "constants": {part: [_short(value, digits) for value in values] for part, values in worth.items()},
        "friction": _entries(truth.friction),
        "inertia": truth.inertia.tolist(),
        "breakaway": truth.breakaway.tolist(),
        "hidden": [asdict(hidden) for hidden in truth.hidden],
        "noise": _entries(truth.noise),
    }


def _entries(record: Friction | Noise | Constants) -> dict[str, Any]:
    """A record's attributes by name, arrays as lists."""
    values = {entry.name: getattr(record, entry.name) for entry in fields(record)}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def _identifiable(truth: Truth) -> dict[str, float]:
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
    """The virtual robot of a document by `as_json`, edited or not, in the geometry of an arm.

    `parameters` is passed over: it follows from the rest. What is missing or of another number of joints is refused
    (truth-wrong).
    """
    if document.get("kind") != "truth" or document.get("format") != FORMAT:
        what = f"the document's kind is {document.get('kind')!r} and its format {document.get('format')!r}"
        raise ModelError("truth-wrong", what, mend="give a truth.json that pumaid simulate wrote")
    n, given = robot.n_joints, None
    per_joint = {"gain", "mass", "inertia", "breakaway", "std", "counts", "x", "y", *_names(Friction)}
    shapes = {**dict.fromkeys(per_joint, (n,)), "centre": (n, 3), "ratio": (n - 1,)}

    def arrays(part: Mapping[str, Any], *names: str) -> list[Floats]:
        return [_array(part, name, shapes.get(name, ())) for name in names]

    (inertia,) = arrays(document, "inertia")
    if document.get("mass") is not None:
        mass, centre, gain = arrays(document, "mass", "centre", "gain")
        links = Links(mass, centre)
    else:
        given = Constants(*arrays(_part(document, "constants"), *_names(Constants)))
        links, gain = links_of(robot, given, inertia)
    friction, noise = _part(document, "friction"), _part(document, "noise")
    (std,) = arrays(noise, "std")
    share, time, step = map(float, arrays(noise, "level_share", "correlation_time", "current_step"))
    counts = None if noise.get("counts") is None else arrays(noise, "counts")[0]
    # Truths of earlier versions state no break-away friction.
    (breakaway,) = arrays({"breakaway": [BREAKAWAY] * n, **document}, "breakaway")
    return Truth(
        robot,
        Friction(*arrays(friction, *_names(Friction))),
        Noise(std, share, time, step, counts),
        links,
        gain,
        inertia,
        breakaway,
        given_constants=given,
        hidden=tuple(_hidden(entry, n) for entry in document.get("hidden") or ()),
    )


def _names(record: type[Friction | Constants]) -> list[str]:
    return [entry.name for entry in fields(record)]


def _hidden(entry: object, n_joints: int) -> Hidden:
    content = entry if isinstance(entry, Mapping) else {}
    name, joint, values = content.get("effect"), content.get("joint"), content.get("values")
    is_effect = name in LAWS and (joint is None or (isinstance(joint, int) and 1 <= joint <= n_joints))
    if not is_effect or not isinstance(values, Mapping) or set(values) != set(LAWS[str(name)].keys):
        what = f"{str(entry)[:80]} is no hidden effect of this robot"
        raise ModelError("truth-wrong", what, Where(field="hidden"), f"known: {', '.join(LAWS)}")
    return Hidden(str(name), joint, {key: float(_array(values, key, ())) for key in values})


def _part(document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part = document.get(name)
    if not isinstance(part, Mapping):
        raise ModelError("truth-wrong", f"the entry {name} is missing", Where(field=name), "simulate anew")
    return part


def _array(document: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Floats:
    try:
        values = np.array(document.get(name), dtype=float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if values.shape != shape or not np.all(np.abs(values) <= _GREATEST):
        what = f"{name} is not {' x '.join(str(size) for size in shape) or 'one'} finite numbers up to {_GREATEST:g}"
        raise ModelError("truth-wrong", what, Where(field=name), "is it the truth of another robot?")
    return values
