"""A fleet as a document: models by robot, and the parameters over all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pumaid.errors import PumaidError
from pumaid.io.result import heading, model_document, plain
from pumaid.records import Estimate, Fleet


def fleet_document(
    found: Sequence[Fleet], models: Mapping[str, Estimate], refused: Mapping[str, PumaidError]
) -> dict[str, Any]:
    """What ``pumaid identify fleet/ --json`` prints.

    Parameters
    ----------
    found
        A comparison for each kind of arm with two robots at least.
    models
        By robot.
    refused
        What refused the others.
    """
    groups = [
        {"robots": list(one.robots), "level": one.level, "parameters": [plain(shared) for shared in one.shared]}
        for one in found
    ]
    told = {name: {"slug": error.slug, "text": error.what} for name, error in refused.items()}
    return heading("fleet") | {
        "robots": {name: model_document(model) for name, model in models.items()},
        "refused": told,
        "groups": groups,
    }
