"""How much of what an effect says of runs that were held out these really show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, elsewhere
from pumaid.joint_bins import JointBins
from pumaid.maths.rank import pseudo_inverse
from pumaid.records import Transfer

#: Standard deviations of what the effect adds to runs held out below which these say nothing of it.
LEAST = 2.0


def transfer(last: Fit, added: EffectTerm, heldout: Sequence[JointBins]) -> Transfer | None:
    """The share of an effect's current that runs held out show; None where they could not show it.

    What the whole model leaves of these runs is projected on what the effect adds there, by generalised least squares
    with the covariance of their noise and of all fitted parameters but the effect's own; the error of these is told as
    an error of the share.

    Parameters
    ----------
    last
        The system with all that was added, `added` among it.
    added
        One of `last.model.effects`.
    heldout
        Bins of runs that were not fitted.

    Source
    ------
    A. C. Atkinson, Biometrika 56 (1969) 33-41: a variable of the model's own prediction as a test of it.
    """
    place = last.place_of(added)
    own = np.isin(np.arange(len(last.inverse)), last.columns_of(place))
    held, sums = np.zeros_like(last.inverse), np.zeros((2, len(own)))
    drawn2, shared = 0.0, 0.0
    for bins in heldout:
        if bins.joint not in last.noises:
            continue
        row = elsewhere(last, bins)
        drawn = row.noise.whiten(row.bins, added.linear(last.model.robot, row.bins.samples) @ last.sizes(place))
        held[np.ix_(row.acting, row.acting)] += row.slim.T @ row.slim
        sums[:, row.acting] += np.vstack([drawn, row.residual]) @ row.slim
        drawn2, shared = drawn2 + float(drawn @ drawn), shared + float(drawn @ row.residual)
    known = (last.information() + held)[np.ix_(~own, ~own)]
    turned = np.zeros_like(sums)
    turned[:, ~own] = sums[:, ~own] @ pseudo_inverse(known)[0]
    square = drawn2 - float(sums[0] @ turned[0])
    if square <= LEAST**2 * last.scale:
        return None
    weighed = (drawn2 - 2.0 * float(turned[0] @ sums[0]) + float(turned[0] @ held @ turned[0])) / square**2
    along = (sums[0] - held @ turned[0]) / square
    error = float(np.sqrt(last.scale * (weighed + along @ last.inverse @ along)))
    return Transfer(1.0 + (shared - float(sums[0] @ turned[1])) / square, error, -(drawn2 + 2.0 * shared) / last.scale)
