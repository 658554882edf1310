"""What a residual can depend on, as columns over a joint's bins: position, direction, speed, load, time, start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.laid import View

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: What counts as smooth: so many harmonics of a turn, and polynomials over the span up to a degree; of a sliding joint
#: polynomials up to a higher degree alone.
HARMONICS, DEGREE, SLIDING_DEGREE = 3, 5, 9
#: Half waves over the campaign: a warm-up, a drift or a step shows in these.
SLOW = 6
#: Lengths of a start, as shares of the span.
STARTS = (0.01, 0.03, 0.1)


@dataclass(frozen=True, slots=True)
class Term:
    """One way in which a residual can depend on something: the part of the budget, the variable, and its columns."""

    part: str
    against: str
    columns: Callable[[View], Floats]

    @property
    def key(self) -> tuple[str, str]:
        """Part and variable."""
        return self.part, self.against


def _waves(share: Floats, most: int) -> Floats:
    """(N, most) half waves over a share between 0 and 1."""
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, most + 1)))


def _smooth(at: View) -> Floats:
    """(N, K) what varies little over a run."""
    turns = np.arange(1, HARMONICS + 1) * at.angle[:, None]
    if not at.angle.any():
        return _polynomials(at.share, SLIDING_DEGREE)
    return np.concatenate([np.cos(turns), np.sin(turns), _polynomials(at.share, DEGREE)], axis=1)


def _polynomials(share: Floats, degree: int) -> Floats:
    """(N, degree) Legendre's over a share between 0 and 1, without the constant."""
    return np.asarray(np.polynomial.legendre.legvander(2.0 * share - 1.0, degree)[:, 1:])


def _each(label: Labels) -> Floats:
    """(N, K) one column for each number from 0 on; none below."""
    return np.asarray((label[:, None] == np.arange(label.max() + 1)).astype(float))


def _ways(columns: Floats, at: View) -> Floats:
    return columns * at.way[:, None]


def _speeds(at: View) -> Floats:
    return _each(at.speed_group) if at.speed_group[0] >= 0 else _waves(at.speed, 4)


def _pressed(at: View) -> Floats:
    """Friction that grows with the load; how it differs between lifting and lowering is weight to a model."""
    return _ways(np.abs(at.load)[:, None] ** [1.0, 2.0], at)


def _bent(at: View) -> Floats:
    """A load that does not draw in proportion."""
    size = np.abs(at.load).max() or 1.0
    return np.column_stack([at.load * np.abs(at.load) / size, at.load**3 / size**2])


def _yielding(at: View) -> Floats:
    """Load where the joint stands a little farther than measured, by as much as it carries."""
    return (at.load * at.slope)[:, None]


def _lagging(at: View) -> Floats:
    """Load where the joint stood a moment ago."""
    return (at.way * at.speed * at.slope)[:, None]


def _harmonics(at: View) -> Floats:
    """First harmonic of the turn in each posture: what a wrong gravity leaves."""
    each = _each(at.posture)
    return np.concatenate([each * np.cos(at.angle)[:, None], each * np.sin(at.angle)[:, None]], axis=1)


def _centred(columns: Floats, at: View, label: Labels) -> Floats:
    """Less their mean over the bins of each label."""
    total = np.bincount(label, at.weight)
    means = [np.bincount(label, at.weight * column) / np.where(total > 0, total, 1.0) for column in columns.T]
    return columns - np.array(means).T[label]


def _within(make: Callable[[View], Floats]) -> Callable[[View], Floats]:
    """Columns as they vary within each run."""
    return lambda at: _centred(make(at), at, at.run)


def _ages(at: View) -> Floats:
    """Time within each recording and direction, since recordings cannot be compared in time."""
    return _centred(_waves(at.age, SLOW), at, 2 * at.clock + (at.way > 0))


def _loads_in_time(at: View) -> Floats:
    return _waves(at.age, 2) * at.load[:, None]


def _warmth(at: View) -> Floats:
    known = np.isfinite(at.temperature)
    mean = float(np.average(at.temperature[known], weights=at.weight[known])) if known.any() else 0.0
    return np.where(known, at.temperature - mean, 0.0)[:, None]


#: What is tried, by part and variable. That which turns round with the direction opposes motion. Of a model that was
#: fitted to the runs nothing is left of friction and offset by direction alone.
TERMS = (
    Term("smooth", "position", _within(_smooth)),
    Term("smooth", "direction", _within(lambda at: _ways(_smooth(at), at))),
    Term("smooth", "posture", _within(_harmonics)),
    Term("smooth", "load", _within(_yielding)),
    Term("start", "travel", _within(lambda at: _ways(np.exp(-at.travel[:, None] / np.array(STARTS)), at))),
    Term("odd", "direction", lambda at: _ways(at.speed[:, None] ** [0.0, 1.0], at)),
    Term("odd", "speed", lambda at: _ways(_speeds(at), at)),
    Term("odd", "load", _pressed),
    Term("odd", "lag", _lagging),
    Term("odd", "posture", lambda at: _ways(_each(at.posture), at)),
    Term("even", "direction", lambda at: at.speed[:, None] ** [0.0, 1.0]),
    Term("even", "posture", lambda at: _each(at.posture)),
    Term("even", "speed", _speeds),
    Term("even", "load", _bent),
    Term("time", "time", lambda at: _ways(_ages(at), at)),
    Term("time", "load", _loads_in_time),
    Term("time", "even", _ages),
    Term("time", "temperature", lambda at: np.concatenate([_ways(_warmth(at), at), _warmth(at)], axis=1)),
)


def fitted(at: View) -> Floats:
    """(N, 5) what is the joint's own in every model, so that a fit has taken it away: friction by direction, inertia.

    Weight is not: it is shared with other joints, which may have bent it. Columns of motions not made are zero.
    """
    ahead, back = at.way > 0, at.way < 0
    return np.column_stack([ahead, back, ahead * at.speed, back * at.speed, at.pull]).astype(float)
