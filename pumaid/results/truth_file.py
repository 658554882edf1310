"""A virtual robot as a document, ``truth.json``."""

from dataclasses import asdict
from typing import Any

import numpy as np

from pumaid.results.documents import heading, plain
from pumaid.simulation import Truth

#: Significant digits of what a document works out from masses and gains; the last ones differ between machines.
_DIGITS = 9


def as_json(truth: Truth, *, seed: int | None = None) -> dict[str, Any]:
    """Everything about a virtual robot, SI, JSON's own types.

    `parameters` are in amperes, as currents show them.
    """
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
                "parameters": {name: float(f"{value:.{_DIGITS}g}") for name, value in values.items()},
                "gain": truth.gain,
                "mass": truth.links.mass,
                "centre": truth.links.centre,
                "constants": {
                    part: [float(f"{value:.{_DIGITS}g}") for value in values]
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
