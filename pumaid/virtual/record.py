"""The truth as a document: what a test or a demo reveals at the end."""

from __future__ import annotations

from typing import Any

from pumaid import __version__
from pumaid.virtual.truth import Truth

FORMAT = 1


def as_json(truth: Truth, *, seed: int | None = None) -> dict[str, Any]:
    """Everything about a virtual robot, SI, JSON's own types.

    `parameters` are those of the paper's model by their public names (in amperes, as `pumaid identify` gives them);
    `gain` (A per N m or N), `mass` (kg) and `centre` (m, in each link's frame) are null for a robot that is known by
    its constants alone.

    Parameters
    ----------
    truth
        The robot.
    seed
        Of the session, where it is known.
    """
    links, friction, noise = truth.links, truth.friction, truth.noise
    return {
        "kind": "truth",
        "format": FORMAT,
        "pumaid": __version__,
        "robot": truth.robot.name,
        "recipe": {"file": truth.robot.origin, "sha256": truth.robot.digest},
        "seed": truth.seed if seed is None else seed,
        "parameters": truth.parameters(),
        "gain": None if truth.gain is None else truth.gain.tolist(),
        "mass": None if links is None else links.mass.tolist(),
        "centre": None if links is None else links.centre.tolist(),
        "friction": {
            "coulomb_plus": friction.coulomb_plus.tolist(),
            "coulomb_minus": friction.coulomb_minus.tolist(),
            "viscous_plus": friction.viscous_plus.tolist(),
            "viscous_minus": friction.viscous_minus.tolist(),
        },
        "inertia": truth.inertia.tolist(),
        "noise": {
            "std": noise.std.tolist(),
            "level_std": noise.level_std.tolist(),
            "correlation_time": noise.correlation_time,
            "current_step": noise.current_step,
            "counts": None if noise.counts is None else noise.counts.tolist(),
        },
    }
