"""How much of what an effect says of runs that were held out these really show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pumaid.diagnosis.chain import pseudo_inverse
from pumaid.diagnosis.field import Field
from pumaid.diagnosis.system import Added, Solved, elsewhere, information
from pumaid.records import Transfer

#: Standard error of the share beyond which held-out runs say nothing of the effect.
BLIND = 0.5


def transfer(last: Solved, added: Added, heldout: Sequence[Field]) -> Transfer | None:
    """The share of an effect's current that runs held out show; None where they could not show it.

    What the whole model leaves of these runs is projected on what the effect adds there, by generalised least squares
    with the covariance of their noise and of the fitted parameters.

    Parameters
    ----------
    last
        The system with all that was added, `added` among it.
    added
        One of `last.added`.
    heldout
        Fields of runs that were not fitted.

    Source
    ------
    A. C. Atkinson, Biometrika 56 (1969) 33-41: a variable of the model's own prediction as a test of it.
    """
    place = last.added.index(added)
    known, sums = information(last.rows), np.zeros((2, len(last.inverse)))
    square, shared = 0.0, 0.0
    for field in heldout:
        if field.joint not in last.noises:
            continue
        row = elsewhere(last, field)
        drawn = row.noise.whiten(row.field, added.columns(last.model, row.field.samples) @ last.sizes[place])
        known[np.ix_(row.acting, row.acting)] += row.slim.T @ row.slim
        sums[:, row.acting] += np.vstack([drawn, row.residual]) @ row.slim
        square, shared = square + float(drawn @ drawn), shared + float(drawn @ row.residual)
    turned = pseudo_inverse(known)[0] @ sums.T
    square -= float(sums[0] @ turned[:, 0])
    shared -= float(sums[0] @ turned[:, 1])
    if square <= 0.0 or last.scale / square > BLIND**2:
        return None
    return Transfer(1.0 + shared / square, float(np.sqrt(last.scale / square)))
