"""What runs that have not been made would say: how far one effect, fitted to them, stays from another's forecast."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.score_test import ABSORBED, ScoreTest, step_of
from pumaid.effect_spec import EffectTerm, columns_each
from pumaid.estimation.fit import Fit, FitRow

Floats = NDArray[np.float64]
Columns = list[Floats | None]

#: Ridge on scaled information: directions that no run shows.
RIDGE = 1e-10
#: Where the search for a rival's nearest shape looks in each round, in steps; how many rounds; the next step's share.
AROUND, ROUNDS, CLOSER = (-1.0, -0.5, 0.0, 0.5, 1.0), 12, 0.4


class Prospect:
    """The data so far and L laps that could follow, as sums of products: first those of the data, then lap by lap.

    Parameters
    ----------
    solved
        The model so far.
    rows
        Laps of one joint each, as `feasible.ahead` makes them.
    """

    def __init__(self, solved: Fit, rows: Sequence[FitRow]) -> None:
        self.solved, self.rows = solved, (*solved.joints, *rows)
        self.laps = [0] * len(solved.joints) + [len(row.bins.first) // 2 for row in rows]
        jacobians: Columns = [row.jacobian for row in self.rows]
        self.jacobians = jacobians
        self.information = self.products(jacobians, jacobians)

    def __len__(self) -> int:
        return sum(self.laps)

    def products(self, left: Columns, right: Columns) -> Floats:
        """(1 + L, A, B) products of (N, A) and (N, B) columns of each row, None standing for zero."""
        a = next(values.shape[1] for values in left if values is not None)
        b = next(values.shape[1] for values in right if values is not None)
        total, pieces = np.zeros((1, a, b)), []
        for one, other, laps in zip(left, right, self.laps, strict=True):
            if one is None or other is None:
                pieces.append(np.zeros((laps, a, b)))
            elif laps:
                pieces.append(np.swapaxes(one.reshape(laps, -1, a), 1, 2) @ other.reshape(laps, -1, b))
            else:
                total[0] += one.T @ other
        return np.concatenate([total, *pieces])

    def squares(self, columns: Columns, count: int) -> Floats:
        """(1 + L, S, p, p) products of the p columns of each of S = `count` shapes among themselves."""
        width = next(values.shape[1] for values in columns if values is not None) // count
        total, pieces = np.zeros((1, count, width, width)), []
        for values, laps in zip(columns, self.laps, strict=True):
            if values is None:
                pieces.append(np.zeros((laps, count, width, width)))
                continue
            parted = values.reshape(laps or 1, -1, count, width)
            found = np.einsum("lnsp,lnsq->lspq", parted, parted)
            if laps:
                pieces.append(found)
            else:
                total += found
        return np.concatenate([total, *pieces])

    def columns(self, shapes: Sequence[EffectTerm]) -> Columns:
        """Whitened (N, V) columns of an effect with several shapes in each row; None where it does not act."""
        out: Columns = []
        for row, laps in zip(self.rows, self.laps, strict=True):
            samples = row.bins.samples
            if laps and "time" in shapes[0].shape:  # what changed at an instant that has passed stays changed
                long = np.full(len(samples), np.inf)
                samples = replace(samples, time=long, elapsed=long)
            found = columns_each(shapes, self.solved.model.robot, samples)
            out.append(row.noise.whiten(row.bins, found) if np.any(found) else None)
        return out if any(values is not None for values in out) else self._nothing(found.shape[1])

    def _nothing(self, width: int) -> Columns:
        """Columns of an effect that acts nowhere."""
        return [np.zeros((len(self.rows[0].bins), width)), *([None] * (len(self.rows) - 1))]

    def forecast(self, trial: ScoreTest) -> Columns:
        """(N, 1) in each row: what the data leave, and what the trial's effect predicts that laps will leave."""
        columns = self.columns([trial.added])
        cross = sum(
            row.jacobian.T @ values
            for row, values, laps in zip(self.rows, columns, self.laps, strict=True)
            if values is not None and not laps
        )
        turned = self.solved.inverse @ cross
        out: Columns = []
        for row, values, laps in zip(self.rows, columns, self.laps, strict=True):
            beyond = -row.jacobian @ turned if values is None else values - row.jacobian @ turned
            out.append((beyond @ trial.sizes if laps else row.residual)[:, None])
        return out


class Duel:
    """How far `pretender` stays from what `truth` predicts, fitted with its shapes to the data and to laps.

    Parameters
    ----------
    prospect
        Data and laps.
    truth, pretender
        On `prospect.solved`, at their best shapes; without a pretender the model alone is fitted.
    shapes
        Others that the pretender may take.

    Source
    ------
    A. C. Atkinson and V. V. Fedorov, The design of experiments for discriminating between two rival models, Biometrika
    62 (1975) 57-70, with the data so far in both fits.
    """

    def __init__(
        self, prospect: Prospect, truth: ScoreTest, pretender: ScoreTest | None, shapes: Sequence[EffectTerm] = ()
    ) -> None:
        self.prospect, solved = prospect, prospect.solved
        self.scale = (solved.square - truth.statistic) / max(solved.size - solved.rank, 1)
        self.target = prospect.forecast(truth)
        self.slope = prospect.products(prospect.jacobians, self.target)
        square = prospect.products(self.target, self.target)[:, 0, 0]
        self.square = np.where(np.arange(len(square)) == 0, 0.0, square)
        self.shapes: list[EffectTerm] = []
        p, n = prospect.information.shape[1], len(square)
        self.parts: tuple[Floats, ...] = (np.zeros((n, p, 0)), np.zeros((n, 0)), np.zeros((n, 1, 0, 0)))
        self.signs = np.zeros((1, 0))
        if pretender is not None:
            self.shapes = [pretender.added, *shapes]
            self.parts, self.signs = self._parts(self.shapes), self._signs(self.shapes)

    def allow(self, shapes: Sequence[EffectTerm]) -> None:
        """Let the pretender take these shapes too."""
        if not shapes:
            return
        fresh = self._parts(shapes)
        joined = zip(self.parts, fresh, (2, 1, 1), strict=True)
        self.parts = tuple(np.concatenate([old, new], axis=axis) for old, new, axis in joined)
        self.signs = np.concatenate([self.signs, self._signs(shapes)])
        self.shapes += shapes

    def _signs(self, shapes: Sequence[EffectTerm]) -> Floats:
        """(S, p) that parameters must have."""
        return np.array([self.prospect.solved.signs(one) for one in shapes])

    def _parts(self, shapes: Sequence[EffectTerm]) -> tuple[Floats, Floats, Floats]:
        """Of columns: (1 + L, P, V) with the model, (1 + L, V) with the target, (1 + L, S, p, p) among themselves."""
        columns = self.prospect.columns(shapes)
        cross = self.prospect.products(self.prospect.jacobians, columns)
        score = self.prospect.products(self.target, columns)[:, 0]
        return cross, score, self.prospect.squares(columns, len(shapes))

    def gains(self, weights: Floats) -> Floats:
        """Twice the log likelihood that the pretender loses against the truth when laps are added to the data.

        Parameters
        ----------
        weights
            (M, L) how often each lap is made.

        Returns
        -------
        gains
            (M,)
        """
        left = self._left(self.parts, np.vstack([np.zeros(weights.shape[1]), weights]), self.signs).min(axis=1)
        return np.asarray(np.maximum(left[1:] - left[0], 0.0) / self.scale)

    def nearest(self, weights: Floats) -> list[EffectTerm]:
        """The shape with which the pretender comes nearest after (L,) laps; none where it has none to choose."""
        robot = self.prospect.solved.model.robot
        row = weights[None, :]
        if not self.shapes:
            return []
        start = self.shapes[int(self._left(self.parts, row, self.signs)[0].argmin())]
        known = start.effect.shapes(robot, start.joint or 0)
        bounds = {one.name: one for one in known if one.is_searched and one.name in start.shape}
        if not bounds:
            return []
        low, high = (np.array([getattr(one, end) for one in bounds.values()]) for end in ("low", "high"))
        middle = np.array([start.shape[name] for name in bounds])
        step = np.array([step_of(start, name, self.prospect.solved) for name in bounds])
        around = np.array(list(itertools.product(AROUND, repeat=len(bounds))))
        for _ in range(ROUNDS):
            points = np.clip(middle + around * step, low, high)
            some = [
                replace(start, shape={**start.shape, **dict(zip(bounds, one, strict=True))}) for one in points.tolist()
            ]
            best = int(self._left(self._parts(some), row, self._signs(some))[0].argmin())
            is_far = np.abs(points[best] - middle).max() >= 0.9 * np.abs(step).min()
            middle, nearest = points[best], some[best]
            step = step if is_far else CLOSER * step
        return [nearest]

    def _left(self, parts: Sequence[Floats], weights: Floats, signs: Floats) -> Floats:
        """(M, S) sum of squares that a fit of each shape leaves, less that of the data before any fit."""
        used = np.flatnonzero(weights.any(axis=0))

        def total(part: Floats) -> Floats:
            flat = weights[:, used] @ part[1 + used].reshape(len(used), -1)
            return np.asarray(part[0] + flat.reshape(len(weights), *part.shape[1:]))

        cross, score, gram = (total(part) for part in parts)
        information, slope = total(self.prospect.information), total(self.slope)
        size = np.sqrt(np.einsum("mpp->mp", information))
        unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
        scaled = information * unit[:, :, None] * unit[:, None, :] + RIDGE * np.eye(information.shape[1])
        both = np.concatenate([cross, slope], axis=2) * unit[:, :, None]
        turned = np.linalg.solve(scaled, both)
        explained = np.einsum("mpv,mp->mv", both, turned[:, :, -1])
        split = (*both.shape[:2], gram.shape[1], gram.shape[2])
        inner = gram - np.einsum("mksp,mksq->mspq", both[..., :-1].reshape(split), turned[..., :-1].reshape(split))
        beyond = (score - explained[:, :-1]).reshape(inner.shape[:3])
        is_seen = np.einsum("mspp->msp", inner) > ABSORBED * np.einsum("mspp->msp", gram)
        inner = inner * (is_seen[..., None] & is_seen[..., None, :]) + np.eye(gram.shape[2]) * ~is_seen[..., None]
        beyond = np.where(is_seen, beyond, 0.0)
        return np.asarray((total(self.square) - explained[:, -1])[:, None] - _fall(inner, beyond, signs))


def _fall(inner: Floats, score: Floats, signs: Floats) -> Floats:
    """(M, S) fall of the sum of squares by parameters that have the signs (S, p) which they must have.

    At the best of them some parameters are zero and the others free: every such choice is tried.
    """
    width, out = signs.shape[1], np.zeros(score.shape[:2])
    ruled = np.flatnonzero(signs.any(axis=0))
    for count in range(len(ruled) + 1):
        for zero in itertools.combinations(ruled.tolist(), count):
            own = [k for k in range(width) if k not in zero]
            sizes = np.linalg.solve(inner[..., own, :][..., own], score[..., own, None])[..., 0]
            fall = np.einsum("msp,msp->ms", score[..., own], sizes)
            out = np.maximum(out, np.where((sizes * signs[:, own] >= 0.0).all(axis=2), fall, 0.0))
    return out
