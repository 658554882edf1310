"""A shape off its grid: the value at which the effect explains most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pumaid.diagnosis.scan import Projector, Trial, trial_of
from pumaid.effect_spec import EffectTerm, columns_each
from pumaid.estimation.fit import Fit

#: Evaluations of one search.
MOST_STEPS = 60
#: Relative tolerance of a shape; its own error is a per cent at best.
TOLERANCE = 2e-3
#: First step of a search, as a share of the value (grids step by a factor of about 1.6).
FIRST_STEP = 0.25


def refined(projector: Projector, trial: Trial) -> Trial:
    """The trial with its searched shapes at the largest statistic, everything else profiled out.

    Parameters
    ----------
    projector
        Of the system that the trial was scored on.
    trial
        At the best point of its grid.
    """
    model = projector.solved.model
    bounds = {
        shape.name: shape
        for shape in trial.added.effect.shapes(model.robot, trial.added.joint or 0)
        if shape.is_searched and shape.name in trial.added.shape
    }
    if not bounds:
        return trial
    names = list(bounds)
    start = np.array([trial.added.shape[name] for name in names])
    step = np.array([step_of(trial.added, name, projector.solved) for name in names])
    best = trial

    def cost(point: np.ndarray) -> float:
        nonlocal best
        shape = {name: float(value) for name, value in zip(names, start + point * step, strict=True)}
        if any(not bounds[name].low <= value <= bounds[name].high for name, value in shape.items()):
            return 0.0
        found = at(projector, replace(trial.added, shape={**trial.added.shape, **shape}))
        if found is None:
            return 0.0
        if found.statistic > best.statistic:
            best = found
        return -found.statistic

    # It takes as long to load as some diagnoses, of which those that find nothing with a shape do without it.
    from scipy import optimize

    n = len(names)
    simplex = np.vstack([np.zeros(n), np.eye(n)])
    options = {"maxfev": MOST_STEPS, "xatol": TOLERANCE / FIRST_STEP, "fatol": 1e-2, "initial_simplex": simplex}
    optimize.minimize(cost, np.zeros(n), method="Nelder-Mead", options=options)
    return best


def step_of(added: EffectTerm, name: str, solved: Fit) -> float:
    """First step of a shape's search."""
    if name == added.effect.periodic and added.joint is not None:
        q = solved.row(added.joint).bins.samples.position[:, added.joint - 1]
        return float(np.pi / 2.0 / np.ptp(q))
    value = added.shape[name]
    return FIRST_STEP * (abs(value) or 1.0)


def at(projector: Projector, added: EffectTerm) -> Trial | None:
    """The trial of one effect with one shape; None where the model absorbs it."""
    return trials_at(projector, [added])[0]


def trials_at(projector: Projector, shapes: Sequence[EffectTerm]) -> list[Trial | None]:
    """The same for several shapes of one effect at once."""
    solved = projector.solved
    white = {}
    for row in solved.joints:
        columns = columns_each(shapes, solved.model.robot, row.bins.samples)
        if np.any(columns):
            white[row.bins.joint] = row.noise.whiten(row.bins, columns)
    if not white:
        return [None] * len(shapes)
    width = next(iter(white.values())).shape[1] // len(shapes)
    scores, left, raw = projector.apart(white, [width] * len(shapes))
    found = []
    for number, (one, information) in enumerate(zip(shapes, left, strict=True)):
        own = slice(number * width, (number + 1) * width)
        share = np.divide(np.diagonal(information), raw[own], out=np.zeros(width), where=raw[own] > 0)
        signs = solved.signs(one)
        found.append(trial_of(one, scores[:, own], information, share=share, signs=signs))
    return found
