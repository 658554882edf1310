"""The bilinear system in Gram matrices: base parameters, ratios of gains, and what is added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Scope, catalogue
from pumaid.model import Model

Floats = NDArray[np.float64]

#: Eigenvalues of the scaled information below this share of the largest are directions that the data do not show.
FLAT = 1e-10
#: Columns shorter than this share of the longest are zero but for rounding.
FAINT = 1e-12
#: Gauss-Newton steps; the start is already a least-squares solution.
STEPS = 6
SETTLED = 1e-9
#: Natural logarithm by which a ratio that the data hardly show may move from where the fit left it: a factor of ten.
SPREAD = 2.3


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """Where a system starts: (p,) base parameters, (J, J) ratios of gains (NaN where unknown)."""

    base: Floats
    scales: Floats


class Chain:
    """The bilinear system over [base parameters, logarithms of gains (J), what is added] in Gram matrices."""

    def __init__(self, model: Model, start: Start, numbers: Sequence[int], grams: Sequence[Floats]) -> None:
        scopes = [catalogue()[column.effect].scope for column in model.columns]
        self.is_link = np.array([scope is Scope.LINK for scope in scopes])
        self.owner = np.where(self.is_link, model.owners - 1, 0)
        self.start, self.numbers, self.grams = start, numbers, grams
        self.base = np.nan_to_num(start.scales)

    def scales(self, theta: Floats) -> Floats:
        """(J, J) ratios, unknown ones zero."""
        p, n = len(self.start.base), len(self.base)
        change = theta[p : p + n]
        return np.asarray(self.base * np.exp(change[:, None] - change[None, :]))

    def moved(self, theta: Floats) -> Start:
        """The parameters as a start."""
        scales = np.where(np.isnan(self.start.scales), np.nan, self.scales(theta))
        return Start(theta[: len(self.start.base)].copy(), scales)

    def effective(self, theta: Floats, i: int) -> tuple[Floats, Floats]:
        """What each column of the design counts in joint i (from 0), and the derivative of that by theta."""
        p, n = len(self.start.base), len(self.base)
        factor = np.where(self.is_link, self.scales(theta)[i][self.owner], 1.0)
        weights = np.concatenate([factor * theta[:p], theta[p + n :]])
        turn = np.zeros((len(weights), len(theta)))
        turn[np.arange(p), np.arange(p)] = factor
        turn[np.arange(p, len(weights)), np.arange(p + n, len(theta))] = 1.0
        outer = np.flatnonzero(self.is_link & (self.owner != i))
        turn[outer, p + i] = weights[outer]
        turn[outer, p + self.owner[outer]] = -weights[outer]
        return weights, turn

    def cost(self, theta: Floats) -> float:
        """Sum of squares, with the prior of the ratios."""
        total = float(np.sum((self._change(theta) / SPREAD) ** 2))
        for i, gram in zip(self.numbers, self.grams, strict=True):
            w = np.append(self.effective(theta, i)[0], -1.0)
            total += float(w @ gram @ w)
        return total

    def _change(self, theta: Floats) -> Floats:
        p = len(self.start.base)
        return theta[p : p + len(self.base)]

    def normal(self, theta: Floats) -> tuple[Floats, Floats]:
        """Information (P, P) and slope (P,) of the sum of squares, with the prior of the ratios."""
        information, slope = np.zeros((len(theta), len(theta))), np.zeros(len(theta))
        for i, gram in zip(self.numbers, self.grams, strict=True):
            weights, turn = self.effective(theta, i)
            information += turn.T @ gram[:-1, :-1] @ turn
            slope += turn.T @ (gram[:-1, -1] - gram[:-1, :-1] @ weights)
        own = len(self.start.base) + np.arange(len(self.base))
        information[own, own] += 1.0 / SPREAD**2
        slope[own] -= self._change(theta) / SPREAD**2
        return information, slope

    def least(self, width: int) -> Floats:
        """The minimum, from the start, in directions that the data show."""
        theta = np.concatenate([self.start.base, np.zeros(len(self.base)), np.zeros(width - len(self.start.base))])
        own = slice(len(self.start.base), len(self.start.base) + len(self.base))
        cost = self.cost(theta)
        for _ in range(STEPS):
            information, slope = self.normal(theta)
            step = pseudo_inverse(information)[0] @ slope
            step[own] = np.clip(step[own], -1.0, 1.0)
            share, trial, fresh = 1.0, theta, cost
            while share > 1e-3 and not fresh < cost:
                trial = theta + share * step
                fresh, share = self.cost(trial), share / 2.0
            if not fresh < cost:
                break
            fall, theta, cost = cost - fresh, trial, fresh
            if fall < SETTLED * cost:
                break
        return theta


def pseudo_inverse(information: Floats) -> tuple[Floats, int]:
    """Pseudo-inverse (P, P) in scaled columns, and the rank."""
    if len(information) == 1 and information[0, 0] > 0.0:
        return 1.0 / information, 1
    size = np.sqrt(np.maximum(np.diagonal(information), 0.0))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > FAINT * size.max(initial=0.0))
    values, vectors = np.linalg.eigh(information * unit[:, None] * unit[None, :])
    kept = values > FLAT * values[-1]
    half = vectors[:, kept] / np.sqrt(values[kept])
    return (unit[:, None] * half) @ (half.T * unit[None, :]), int(np.count_nonzero(kept))
