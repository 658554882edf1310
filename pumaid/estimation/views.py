"""The runs as the effects of a model see them, and what a fit of it says of gravity there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.loads import loads
from pumaid.model import Model
from pumaid.records import Campaign, Loads, Samples
from pumaid.sight import Sight

Floats = NDArray[np.float64]
Sights = Mapping[int, Sight]


def sights(
    model: Model,
    runs: Sequence[Run],
    campaign: Campaign,
    *,
    known: Sights | None = None,
    noise: Mapping[int, float] | None = None,
) -> dict[int, Sight]:
    """A sight of each joint (from 1) that an effect of `model` may act on; those that are `known` already are kept."""
    moving = sorted({run.joint for run in runs})
    out = dict(known or {})
    for joint in (joint for joint in moving if model.touched(joint)):
        has = (out[joint].has_slope, out[joint].grain > 1) if joint in out else None
        if has != (model.has_slope(joint), model.is_fine(joint)):
            out[joint] = model.sight(joint, runs, campaign, noise=(noise or {}).get(joint))
    return out


def loaded(seen: Sights, model: Model, *, solution: Floats, scales: Floats) -> dict[int, Sight]:
    """The same with loads by (p,) parameters of `model` and (J, J) ratios."""

    def gravity(samples: Samples) -> Loads:
        return loads(model, samples, solution=solution, scales=scales)

    return {joint: sight.with_loads(gravity) for joint, sight in seen.items()}
