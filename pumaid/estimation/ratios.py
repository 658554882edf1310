"""Ratios of gains in the joint fit: which the data hardly show, and where else to start from when they lead astray."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pumaid.maths import rank
from pumaid.maths.joint_fit import Bilinear, fit
from pumaid.maths.levels import Levels
from pumaid.maths.recursion import USUAL_RATIO, Gains

Floats = NDArray[np.float64]

#: A ratio whose own row shows it neither to this standard error nor to `RATIO_SIGNIFICANT` standard errors is held
#: about one by `RATIO_SPREAD` in the joint fit. Neighbouring gains differ by up to about ten on published arms.
RATIO_KNOWN = 0.25
RATIO_SIGNIFICANT = 3.3
RATIO_SPREAD = 10.0

#: Noise of a joint between runs, over that inside them, beyond which the recursion is taken to have gone astray; ratios
#: from which the joint fit starts as well then; and the share of the sum of squares that they must get below.
ASTRAY, OTHER_RATIOS, BETTER = 10.0, (USUAL_RATIO, -USUAL_RATIO), 0.98


def spread_of(white: Bilinear, values: Floats, gains: Gains) -> Floats:
    """(edges,) prior spread of each ratio: none where its own row shows it."""
    jacobian, out = white.jacobian(gains, values), []
    for number, edge in enumerate(gains.edges):
        row = gains.parent[edge]
        here = white.row == row
        own = np.flatnonzero(white.owners == row)
        columns = np.column_stack([jacobian[here][:, own], jacobian[here][:, len(values) + number]])
        alone = rank.solve(columns, white.target[here])
        error = float(np.sqrt(alone.inverse[-1, -1])) if alone.determined[-1] else np.inf
        shown = error < RATIO_KNOWN or abs(gains.edge[edge]) > RATIO_SIGNIFICANT * error
        out.append(np.inf if shown else RATIO_SPREAD)
    return np.array(out)


def is_astray(levels: Mapping[int, Levels], inside: Mapping[int, Levels]) -> bool:
    """Whether the recursion left some joint (from 1) with far more between runs than there is `inside` them."""
    return any(levels[joint].sample > ASTRAY * own.sample for joint, own in inside.items())


def restarted(white: Bilinear, values: Floats, gains: Gains, *, limit: Floats, held: Floats) -> tuple[Floats, Gains]:
    """The best of joint fits from the recursion's solution and from one with a ratio of another sign or size.

    Of few postures the recursion may take a ratio with the wrong sign, from which no downhill way leads to the truth.

    Parameters
    ----------
    white
        Rows whitened by the noise inside runs.
    values, gains
        (p,) parameters and ratios by the recursion.
    limit, held
        As for `joint_fit.fit`.
    """
    white = white.condensed()
    spread = spread_of(white, values, gains)
    best = fit(white, values, gains, limit=limit, spread=spread, held=held)
    for number, ratio in itertools.product(range(len(gains.edges)), (None, *OTHER_RATIOS)):
        edge = gains.edges[number]
        tried = best.gains.with_edge(edge, -best.gains.edge[edge] if ratio is None else ratio)
        known = rank.solve(white.scaled(tried), white.target, limit=limit[: len(values)]).values
        found = fit(white, known, tried, limit=limit, spread=spread, held=held)
        if found.residual @ found.residual < BETTER * (best.residual @ best.residual):
            best = found
    return best.values, best.gains
