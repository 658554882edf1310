"""Joints that their model misses by far more than noise, and logs that do not fit the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, Where
from pumaid.fit.rows import Row
from pumaid.fit.system import Fitted
from pumaid.units import number

Floats = NDArray[np.float64]

#: Multiple of the noise, and share of the current's variance, beyond which a model misses a joint. Logs of
#: the arm that the model is of are within 1.3 times.
FAR, SHARE = 4.0, 0.01
#: Runs of a joint that a file must have to be fitted by itself, and how much better it must be met then.
FEWEST, BETTER = 8, 2.0
#: Singular values below this share of the largest are left out where one file is fitted by itself.
_RCOND = 1e-3


def of_misfit(fitted: Fitted, floors: Mapping[int, float | None]) -> list[Note]:
    """A note for each joint whose current the model does not explain, with the file that is to blame if one is.

    Noise is what is left of each run by its own harmonic, or what repeated runs differ by if that is less.

    Parameters
    ----------
    fitted
        The fit of all joints.
    floors
        Joint -> what its repeated runs differ by (A), None where no run is repeated.
    """
    found = []
    for row in fitted.rows:
        values = fitted.system.factors(fitted.gains)[row.joint - 1] * fitted.solution.values
        misses = float(np.sqrt(row.squares(values) / row.samples))
        floor, inside = floors.get(row.joint), _inside(row)
        noise = inside if floor is None else min(inside, floor)
        if misses > FAR * noise and misses**2 > SHARE * _variance(row):
            found.append(_note(row, values, misses, noise))
    return found


def _note(row: Row, values: Floats, misses: float, noise: float) -> Note:
    text = f"the model misses the current of joint {row.joint} by {number(misses)} A (RMS)"
    odd = max(_odd_files(row, values), default=None)
    if odd is None:
        advice = "its intervals may not hold the truth; 'pumaid diagnose' tells what is missing, if no column is wrong"
        told = f"where noise is {number(noise)} A"
        return Note("model-misses", f"{text}, {told}: {advice}", Where(joint=row.joint))
    _, name, before, after = odd
    own = f"the runs of {name} alone would be met to {number(after)} A instead of {number(before)} A"
    advice = "is it another arm's, or was payload, zero, unit or a column's name another one?"
    return Note("logs-disagree", f"{text}, since the logs disagree: {own}; {advice}", Where(file=name, joint=row.joint))


def _inside(row: Row) -> float:
    """RMS current (A) that the runs' own harmonics leave."""
    left = sum(float(run.triangle.factor[-1, -1]) ** 2 for run in row.runs)
    freedom = sum(run.samples - len(run.triangle.columns) for run in row.runs)
    return float(np.sqrt(left / max(freedom, 1)))


def _variance(row: Row) -> float:
    """Variance (A2) of the joint's current over all its runs."""
    count = np.concatenate([run.cells.count for run in row.runs])
    current = np.concatenate([run.cells.current[:, run.joint - 1] for run in row.runs])
    inside = np.concatenate([run.cells.variance for run in row.runs])
    mean = np.average(current, weights=count)
    return float(np.average((current - mean) ** 2 + inside, weights=count))


def _odd_files(row: Row, values: Floats) -> Iterator[tuple[float, str, float, float]]:
    """Files that corrections of their own would meet far better: by how much, name, RMS (A) before and after.

    Corrections are found from one half of the file's runs and judged on the other, so that noise gains nothing.
    """
    misfit = row.target - row.regressors @ values
    origins = np.array([run.origin for run in row.runs])
    rest = row.rest / row.samples
    for name in dict.fromkeys(origins.tolist()):
        own = np.flatnonzero(origins == name)
        if FEWEST <= len(own) < len(origins):
            samples = sum(row.runs[n].samples for n in own)
            # Neighbouring runs go to and fro: pairs of them keep both directions in each half.
            first = np.isin(np.arange(len(own)) % 4, (0, 3))
            left = sum(_left(row, misfit, own[part], own[~part]) for part in (first, ~first))
            before = float(np.sqrt(np.sum(misfit[own] ** 2) / samples + rest))
            after = float(np.sqrt(left / samples + rest))
            if before > BETTER * after:
                yield before / after, name, before, after


def _left(row: Row, misfit: Floats, seen: NDArray[np.int64], judged: NDArray[np.int64]) -> float:
    """Sum of squares (A2) of some runs once what others show is taken out."""
    width = row.regressors.shape[2]
    rows, target = row.regressors[seen].reshape(-1, width), misfit[seen].ravel()
    correction = np.linalg.lstsq(rows, target, rcond=_RCOND)[0]
    return float(np.sum((misfit[judged] - row.regressors[judged] @ correction) ** 2))
