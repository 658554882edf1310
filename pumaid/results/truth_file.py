"""A virtual robot as a document, ``truth.json``, and back."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from pumaid.errors import ModelError, Where
from pumaid.results.documents import FORMAT, heading, plain, record_from
from pumaid.robot import Robot
from pumaid.simulation import BREAKAWAY, Constants, Friction, Hidden, Links, Noise, Truth, links_of
from pumaid.simulation.hidden_effects import KEYS

#: Significant digits of what a document works out from masses and gains; the last ones differ between machines.
_DIGITS = 9
#: SI; no entry of a truth is larger on any arm, and much farther on currents overflow.
_GREATEST = 1e12


def as_json(truth: Truth, *, seed: int | None = None) -> dict[str, Any]:
    """Everything about a virtual robot, SI, JSON's own types.

    `parameters` are in amperes, as currents show them; `gain`, `mass` and `centre` are null for a robot that
    is known by its constants alone.
    """
    has_masses = truth.given_constants is None
    digits = _DIGITS if has_masses else 17
    values, n = truth.parameters(), truth.robot.n_joints
    # What a slide carries in every posture is part of its Coulomb terms. Uneven multiples: no two joints stand alike in
    # all of them.
    load = truth.gravity_current(np.sin(np.outer(np.arange(16), np.sqrt(2.0 + np.arange(n)))))
    is_same = np.ptp(load, axis=0) <= 1e-9 * np.max(np.abs(load), axis=0)
    for j in np.flatnonzero(is_same & ~truth.robot.is_revolute):
        for side in ("plus", "minus"):
            values[f"coulomb.j{j + 1}.{side}"] += float(load[0, j])
    return dict(
        plain(
            heading("truth", robot=truth.robot)
            | {
                "seed": truth.seed if seed is None else seed,
                "parameters": {name: float(f"{value:.{digits}g}") for name, value in values.items()},
                "gain": truth.gain if has_masses else None,
                "mass": truth.links.mass if has_masses else None,
                "centre": truth.links.centre if has_masses else None,
                "constants": {
                    part: [float(f"{value:.{digits}g}") for value in values]
                    for part, values in asdict(truth.constants).items()
                },
                "friction": truth.friction,
                "inertia": truth.inertia,
                "breakaway": truth.breakaway,
                "hidden": truth.hidden,
                "noise": truth.noise,
            }
        )
    )


def from_json(document: Mapping[str, Any], robot: Robot) -> Truth:
    """The virtual robot of a document by `as_json`, edited or not, in the geometry of an arm.

    `parameters` is passed over: it follows from the rest. What is missing or of another number of joints is refused
    (truth-wrong).
    """

    def wrong(what: str, field: str | None = None, mend: str = "is it the truth of another robot?") -> ModelError:
        return ModelError("truth-wrong", what, Where(field=field), mend)

    if document.get("kind") != "truth" or document.get("format") != FORMAT:
        raise wrong(
            f"the document's kind is {document.get('kind')!r} and its format {document.get('format')!r}",
            mend="give a truth.json that pumaid simulate wrote",
        )
    n, has_masses = robot.n_joints, document.get("mass") is not None
    # Truths of earlier versions state no break-away friction.
    document = {"breakaway": [BREAKAWAY] * n, "hidden": [], **document}
    names = ("inertia", "breakaway", *(("gain", "mass", "centre") if has_masses else ()))
    try:
        friction, noise = record_from(Friction, document["friction"]), record_from(Noise, document["noise"])
        arrays = {name: np.array(document[name], dtype=float) for name in names}
        given = None if has_masses else record_from(Constants, document["constants"])
        hidden = record_from(tuple[Hidden, ...], document["hidden"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise wrong(f"an entry is missing or no number: {error!r:.80}", mend="simulate anew") from None
    shapes = {"centre": (n, 3), "ratio": (n - 1,), "level_share": (), "correlation_time": (), "current_step": ()}
    for name, values in (arrays | asdict(friction) | asdict(noise) | ({} if given is None else asdict(given))).items():
        shape = shapes.get(name, (n,))
        if values is not None and (np.shape(values) != shape or not np.all(np.abs(values) <= _GREATEST)):
            size = " x ".join(map(str, shape)) or "one"
            raise wrong(f"{name} is not {size} finite numbers up to {_GREATEST:g}", name)
    for entry in hidden:
        keys, at = KEYS.get(entry.effect, ()), entry.joint
        numbers = [abs(value) <= _GREATEST for value in entry.values.values()]
        is_joint = at is None or (isinstance(at, int) and 1 <= at <= n)
        if not keys or set(entry.values) != set(keys) or not all(numbers) or not is_joint:
            raise wrong(f"{entry!r:.80} is no hidden effect of this robot", "hidden", f"known: {', '.join(KEYS)}")
    inertia, breakaway = arrays["inertia"], arrays["breakaway"]
    links, gain = (
        (Links(arrays["mass"], arrays["centre"]), arrays["gain"]) if given is None else links_of(robot, given, inertia)
    )
    return Truth(robot, friction, noise, links, gain, inertia, breakaway, given_constants=given, hidden=hidden)
