"""What of added effects the data cannot tell from the paper's model, and the convention that settles it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.estimation.rows import TIGHT
from pumaid.estimation.system import Fitted

Floats = NDArray[np.float64]

#: Share of an effect's column beyond the paper's model, below which it is none: what is made from fitted loads is known
#: to a few parts in a thousand.
NOTHING = 1e-3

#: Share of a direction below which a term does not belong to it.
PART_OF = 1e-3


@dataclass(frozen=True, eq=False, slots=True)
class Gauge:
    """Sums of effects' parameters that the paper's model could take over whole; they are 0 by convention.

    Attributes
    ----------
    rows
        (h, p) the sums, each as a multiple of the noise, times `TIGHT`.
    partners
        Number (from 0) of an effect's parameter in such a sum -> names of what could take it over.
    """

    rows: Floats
    partners: dict[int, list[str]]


def gauge_of(fitted: Fitted) -> Gauge | None:
    """What of the effects in `fitted` no run tells from the paper's model; None where there is nothing.

    The paper's model has the first word: it says what it would say without the effect, and what the effect shows
    beyond it is the effect's.
    """
    model, jacobian = fitted.model, fitted.solution.jacobian
    ours = np.array([n for n, c in enumerate(model.columns) if c.place is not None and c.shape is None], dtype=int)
    theirs = np.array([n for n, c in enumerate(model.columns) if c.place is None], dtype=int)
    theirs = np.concatenate([theirs, np.arange(len(model.columns), jacobian.shape[1])])
    size, scale = np.linalg.norm(jacobian[:, ours], axis=0), np.linalg.norm(jacobian[:, theirs], axis=0)
    acting = size > 0
    if not acting.any():
        return None
    ours, size = ours[acting], size[acting]
    unit, base = jacobian[:, ours] / size, jacobian[:, theirs] / np.where(scale > 0, scale, 1.0)
    share, *_ = np.linalg.lstsq(base, unit, rcond=1e-12)
    _, sizes, right = np.linalg.svd(unit - base @ share, full_matrices=False)
    lost = right[sizes < NOTHING * max(1.0, sizes[0])]
    if len(lost) == 0:
        return None
    rows = np.zeros((len(lost), len(model.columns)))
    rows[:, ours] = TIGHT * lost * size
    names = [*model.names, *(f"a gain of joint {edge + 1}" for edge in fitted.gains.edges)]
    taken = np.abs(share @ lost.T).max(axis=1)
    others = [names[n] for n, part in zip(theirs, taken, strict=True) if part > PART_OF * taken.max()]
    partners = {int(n): others for n, part in zip(ours, np.abs(lost).max(axis=0), strict=True) if part > PART_OF}
    return Gauge(rows, partners)
