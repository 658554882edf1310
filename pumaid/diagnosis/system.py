"""All joints' bins, whitened, as one nonlinear least squares: the base model with whatever was added to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.added import Added
from pumaid.diagnosis.chain import Chain, Start, pseudo_inverse
from pumaid.diagnosis.field import Field
from pumaid.diagnosis.noise import Noise, noise
from pumaid.loads import along
from pumaid.model import Model

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """One joint of a solved system.

    Attributes
    ----------
    field, noise
        Its bins, with loads by the solution, and what their noise is like.
    acting
        (L,) numbers (from 0) of the parameters of the system, P in all, that this joint feels.
    slim, residual
        (N, L) derivative of the prediction by these, and (N,) what the solution leaves; whitened.
    bare, misfit
        Both in A, not whitened.
    weights, turn
        (D,) what each column of the design counts here, and (D, P) its derivative by the parameters.
    """

    field: Field
    noise: Noise
    acting: Counts
    slim: Floats
    residual: Floats
    bare: Floats
    misfit: Floats
    weights: Floats
    turn: Floats

    @property
    def jacobian(self) -> Floats:
        """(N, P) whitened derivative of the prediction by every parameter of the system."""
        return self._wide(self.slim)

    @property
    def plain(self) -> Floats:
        """(N, P) the same in A, not whitened."""
        return self._wide(self.bare)

    def _wide(self, values: Floats) -> Floats:
        out = np.zeros((len(values), self.turn.shape[1]))
        out[:, self.acting] = values
        return out

    @property
    def drawn(self) -> Floats:
        """(N,) A that the model predicts."""
        return np.asarray(self.field.current - self.misfit)


@dataclass(frozen=True, eq=False)
class Solved:
    """A system at its minimum.

    Attributes
    ----------
    model, added
        The base model and what was added to it.
    rows
        One a joint that moves.
    inverse
        (P, P) pseudo-inverse of the information of all rows.
    start
        Base parameters and ratios of gains at the minimum.
    sizes
        Linear parameters of each of `added`.
    rank
        Directions of the parameters that the data determine.
    """

    model: Model
    added: tuple[Added, ...]
    rows: tuple[Row, ...]
    inverse: Floats
    start: Start
    sizes: tuple[Floats, ...]
    rank: int

    @cached_property
    def square(self) -> float:
        """Sum of squares of the whitened residuals."""
        return sum(float(row.residual @ row.residual) for row in self.rows)

    @property
    def bins(self) -> int:
        """N of all joints."""
        return sum(len(row.field) for row in self.rows)

    @property
    def scale(self) -> float:
        """Variance of a whitened residual: one where the noise model is right."""
        return self.square / max(self.bins - self.rank, 1)

    def signs(self, added: Added) -> Floats:
        """(p,) sign that each parameter of an effect must have at this arm; 0 where either is possible."""
        found = np.array(added.effect.signs(added.shape), dtype=float)
        if len(found) == 0:
            return np.zeros(len(added.effect.parameters(self.model.robot, added.joint or 0)))
        return found * (self.side(added.joint or 0) if added.effect.opposes_motion else 1.0)

    def side(self, joint: int) -> float:
        """+1 where friction of `joint` draws current along the motion, -1 where it counts backwards, else 0."""
        names = self.model.names
        pair = [f"coulomb.j{joint}.{way}" for way in ("plus", "minus")]
        if not all(name in names for name in pair):
            return 0.0
        plus, minus = (float(self.start.base[names.index(name)]) for name in pair)
        return float(np.sign(plus - minus))

    @property
    def noises(self) -> dict[int, Noise]:
        """By joint."""
        return {row.field.joint: row.noise for row in self.rows}

    def row(self, joint: int) -> Row:
        """The row of joint `joint` (from 1)."""
        return next(row for row in self.rows if row.field.joint == joint)


def solve(
    model: Model,
    fields: Sequence[Field],
    start: Start,
    *,
    added: Sequence[Added] = (),
    noises: Mapping[int, Noise] | None = None,
) -> Solved:
    """Least squares over base parameters, ratios of gains and what is added.

    Columns made from gravity's load, and tangents of shapes, are made anew once the parameters have moved.

    Parameters
    ----------
    model
        The base model.
    fields
        One a joint.
    start
        The fitted model.
    added
        Effects beyond the model.
    noises
        By joint; where not given they are taken from the residuals of a first round.
    """
    values = [np.zeros(_width(model, one)) for one in added]
    found = _round(model, fields, start, added=added, values=values, noises=noises)
    if noises is None:
        noises = {row.field.joint: noise(row.field, row.misfit) for row in found.rows}
    elif not added:
        return found
    return _round(model, fields, found.start, added=added, values=found.sizes, noises=noises)


def misfit_at(solved: Solved, field: Field) -> Floats:
    """(N,) A: what the solution leaves of one joint at other bins than its own."""
    loaded = with_loads(solved.model, field, solved.start) if _needs_loads(solved.added) else field
    design = _design(solved.model, loaded, solved.added, solved.sizes)
    return np.asarray(field.current - design @ solved.row(field.joint).weights)


def at_bins(solved: Solved, field: Field) -> Solved:
    """The same solution with one joint's row at other bins, noise as these show it."""
    old = solved.row(field.joint)
    field = with_loads(solved.model, field, solved.start)
    design = _design(solved.model, field, solved.added, solved.sizes)
    kind = noise(field, field.current - design @ old.weights)
    row = row_of(field, kind, design, weights=old.weights, turn=old.turn)
    rows = tuple(row if one.field.joint == field.joint else one for one in solved.rows)
    inverse, rank = pseudo_inverse(information(rows))
    return replace(solved, rows=rows, inverse=inverse, rank=rank)


def elsewhere(solved: Solved, field: Field) -> Row:
    """One joint of the solution at runs that were not fitted, their noise like that of fitted runs as fast."""
    old = solved.row(field.joint)
    field = with_loads(solved.model, field, solved.start)
    kind = old.noise.at(old.field, np.array([abs(run.speed) for run in field.runs]), field.step)
    design = _design(solved.model, field, solved.added, solved.sizes)
    return row_of(field, kind, design, weights=old.weights, turn=old.turn)


def row_of(field: Field, kind: Noise, design: Floats, *, weights: Floats, turn: Floats) -> Row:
    """One joint at a solution.

    Parameters
    ----------
    field, kind
        Its bins, with loads by the solution, and what their noise is like.
    design
        (N, D) at the bins.
    weights, turn
        Of the solution, as in `Row`.
    """
    live = np.flatnonzero(design.any(axis=0))
    acting = np.flatnonzero(turn[live].any(axis=0))
    bare = design[:, live] @ turn[np.ix_(live, acting)]
    misfit = field.current - design[:, live] @ weights[live]
    white = kind.whiten(field, np.column_stack([bare, misfit]))
    return Row(field, kind, acting, white[:, :-1], white[:, -1], bare, misfit, weights, turn)


def information(rows: Sequence[Row]) -> Floats:
    """(P, P) of all rows."""
    width = rows[0].turn.shape[1]
    total = np.zeros((width, width))
    for row in rows:
        total[np.ix_(row.acting, row.acting)] += row.slim.T @ row.slim
    return total


def loaded(solved: Solved) -> Solved:
    """The same solution with every field's loads as it has them."""
    rows = [replace(row, field=with_loads(solved.model, row.field, solved.start)) for row in solved.rows]
    return replace(solved, rows=tuple(rows))


def with_loads(model: Model, field: Field, start: Start) -> Field:
    """The field with gravity's loads by the parameters given."""
    found = along(model, field.samples, field.lengths, solution=start.base, scales=start.scales)
    return replace(field, samples=replace(field.samples, loads=found))


def _needs_loads(added: Sequence[Added]) -> bool:
    return any(one.effect.needs_loads for one in added)


def _width(model: Model, one: Added) -> int:
    return len(one.effect.parameters(model.robot, one.joint or 0))


def _round(
    model: Model,
    fields: Sequence[Field],
    start: Start,
    *,
    added: Sequence[Added],
    values: Sequence[Floats],
    noises: Mapping[int, Noise] | None,
) -> Solved:
    """Gauss-Newton on the rows' Gram matrices, with loads and tangents as they are at `start`."""
    loaded = [with_loads(model, field, start) for field in fields] if _needs_loads(added) else fields
    designs = [_design(model, field, added, values) for field in loaded]
    kinds = [noises[field.joint] if noises is not None else _white(field) for field in loaded]
    grams = [_gram(field, kind, design) for field, kind, design in zip(loaded, kinds, designs, strict=True)]
    chain = Chain(model, start, [field.joint - 1 for field in loaded], grams)
    theta = chain.least(designs[0].shape[1])
    inverse, rank = pseudo_inverse(chain.normal(theta)[0])
    rows = []
    for field, kind, design in zip(loaded, kinds, designs, strict=True):
        weights, turn = chain.effective(theta, field.joint - 1)
        rows.append(row_of(field, kind, design, weights=weights, turn=turn))
    p = len(start.base)
    ends = np.cumsum([len(one) for one in values])
    sizes = np.split(theta[p + len(start.scales) :], ends)[: len(values)]
    return Solved(model, tuple(added), tuple(rows), inverse, chain.moved(theta), tuple(sizes), rank)


def _gram(field: Field, kind: Noise, design: Floats) -> Floats:
    """(D + 1, D + 1) products of the whitened columns of the design and the current."""
    live = np.append(np.flatnonzero(design.any(axis=0)), design.shape[1])
    white = kind.whiten(field, np.column_stack([design[:, live[:-1]], field.current]))
    out = np.zeros((design.shape[1] + 1, design.shape[1] + 1))
    out[np.ix_(live, live)] = white.T @ white
    return out


def _white(field: Field) -> Noise:
    flat = np.ones(len(field.runs))
    return Noise(0.0 * flat, flat, 0.0, from_replicates=False)


def _design(model: Model, field: Field, added: Sequence[Added], values: Sequence[Floats]) -> Floats:
    """(N, p + added parameters + tangents)."""
    columns = [one.columns(model, field.samples) for one in added]
    tangents = [one.tangent(model, field.samples, size) for one, size in zip(added, values, strict=True)]
    return np.column_stack([field.base, *columns, *tangents]) if added else field.base
