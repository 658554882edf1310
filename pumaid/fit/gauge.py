"""What of added effects the data cannot tell from the paper's model, and the convention that settles it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.fit.rows import TIGHT
from pumaid.fit.system import Fitted

Floats = NDArray[np.float64]

#: Share of a direction below which a term does not belong to it; well above the jitter of held positions.
PART_OF = 1e-3


@dataclass(frozen=True, eq=False, slots=True)
class Gauge:
    """Directions in which effects and the paper's model stand for one another; the effects' part is 0 by convention.

    Attributes
    ----------
    rows
        (h, p) sums of the effects' parameters that are held at 0.
    directions
        (p + edges, b) as of `rank.Solution.blind`, of parameters each measured by its limit.
    partners
        Number (from 0) of an effect's parameter that takes part -> names of the others that do.
    """

    rows: Floats
    directions: Floats
    partners: dict[int, list[str]]


def gauge_of(fitted: Fitted) -> Gauge | None:
    """What `fitted` leaves open between its effects and the paper's model; None where there is nothing.

    The paper's model has the first word: it says what it would say without the effect, and what the effect shows
    beyond it is the effect's.
    """
    model, blind = fitted.model, fitted.solution.linear.blind
    added = np.array([column.place is not None and column.shape is None for column in model.columns], dtype=bool)
    ours = np.zeros(len(blind), dtype=bool)
    ours[: len(added)] = added
    theirs = np.ones(len(blind), dtype=bool)
    theirs[: len(added)] = [column.place is None for column in model.columns]
    if blind.shape[1] == 0 or not added.any():
        return None
    _, sizes, right = np.linalg.svd(blind[theirs], full_matrices=False)
    mixed = blind @ right[sizes > PART_OF].T
    left, sizes, _ = np.linalg.svd(mixed[ours], full_matrices=False)
    kept = left[:, sizes > PART_OF]
    if kept.shape[1] == 0:
        return None
    rows = np.zeros((kept.shape[1], len(added)))
    rows[:, added] = TIGHT * kept.T / fitted.limit[added]
    names = [*model.names, *(f"a gain of joint {edge + 1}" for edge in fitted.gains.edges)]
    shares = np.abs(mixed @ mixed.T)
    least = PART_OF * shares.max()
    partners = {
        int(index): [name for n, name in enumerate(names) if shares[index, n] > least and n != index]
        for index in np.flatnonzero(added)
        if np.abs(kept[np.flatnonzero(np.flatnonzero(added) == index)[0]]).max() > PART_OF
    }
    return Gauge(rows, mixed, partners)
