"""Whether estimates of one quantity on several things differ by more than their errors, and which stand apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.maths.statistics import two_sided

Floats = NDArray[np.float64]


def pooled(values: Floats, errors: Floats) -> tuple[float, float]:
    """Mean of (R,) values weighted by their (R,) standard errors, and its standard error."""
    weight = 1.0 / errors**2
    return float(weight @ values / weight.sum()), float(weight.sum() ** -0.5)


def between(values: Floats, errors: Floats) -> float:
    """Standard deviation between the (R,) things beyond what their standard errors explain, not below 0.

    Source
    ------
    R. DerSimonian and N. Laird, Controlled Clinical Trials 7 (1986) 177-188.
    """
    weight = 1.0 / errors**2
    mean, _ = pooled(values, errors)
    surplus = float(weight @ (values - mean) ** 2) - (len(values) - 1)
    spread = weight.sum() - float(weight @ weight) / weight.sum()
    return float(np.sqrt(max(surplus / spread, 0.0))) if spread > 0.0 else 0.0


def alike(values: Floats, errors: Floats, freedoms: Floats) -> float:
    """Chance that equal quantities give (R,) estimates as far apart as these.

    Parameters
    ----------
    values, errors, freedoms
        (R,) estimates, standard errors, and the degrees of freedom behind them; R at least 2.

    Source
    ------
    B. L. Welch, Biometrika 38 (1951) 330-336: the F test for unequal variances that are themselves estimated.
    """
    count, weight = len(values), 1.0 / errors**2
    mean, _ = pooled(values, errors)
    among = float(weight @ (values - mean) ** 2) / (count - 1)
    doubt = float(np.sum((1.0 - weight / weight.sum()) ** 2 / np.maximum(freedoms, 1.0)))
    statistic = among / (1.0 + 2.0 * (count - 2) / (count**2 - 1) * doubt)
    below = (count**2 - 1) / (3.0 * doubt) if doubt > 0.0 else np.inf
    return float(special.fdtrc(count - 1, min(below, 1e9), statistic))


def apart(values: Floats, errors: Floats, freedoms: Floats) -> tuple[Floats, Floats]:
    """How far each of R things is from the others, and the chance that one of their kind is as far.

    The others' mean carries their spread, and so does a new one of their kind: where all differ, none stands out.

    Parameters
    ----------
    values, errors, freedoms
        As in `alike`.

    Returns
    -------
    off, chance
        (R,) distance from the mean of the others, and two-sided chance.

    Source
    ------
    J. P. T. Higgins, S. G. Thompson and D. J. Spiegelhalter, J. R. Stat. Soc. A 172 (2009) 137-159: the prediction
    interval of a new member, with one degree of freedom less than there are members to tell the spread.
    """
    off, chance = np.zeros((2, len(values)))
    for one in range(len(values)):
        rest = np.arange(len(values)) != one
        spread = between(values[rest], errors[rest]) if len(values) > 2 else 0.0
        mean, error = pooled(values[rest], np.hypot(errors[rest], spread))
        off[one] = values[one] - mean
        width = float(np.sqrt(errors[one] ** 2 + error**2 + spread**2))
        known = freedoms[one] if spread == 0.0 else min(freedoms[one], len(values) - 2)
        chance[one] = two_sided(off[one] / width, max(known, 1.0))
    return off, chance


def holm(chances: Floats) -> Floats:
    """(N,) chances, each such that below a level it is a finding of all N together at that level.

    Source
    ------
    S. Holm, Scandinavian Journal of Statistics 6 (1979) 65-70.
    """
    order = np.argsort(chances, kind="stable")
    stepped = np.maximum.accumulate(chances[order] * np.arange(len(chances), 0, -1))
    out = np.empty(len(chances))
    out[order] = np.minimum(stepped, 1.0)
    return out
