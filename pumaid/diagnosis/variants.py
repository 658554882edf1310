"""Everything that could be missing: each effect at each joint with each shape of its grid, as columns on bins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import EffectTerm
from pumaid.effects import Effect, Scope, catalogue
from pumaid.estimation.fit import Fit, FitRow
from pumaid.joint_bins import distinct
from pumaid.records import Extent

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Variant:
    """One candidate with one shape.

    Attributes
    ----------
    added
        Effect, joint and shape.
    columns
        Numbers of its columns in the matrix of its kind.
    is_wide
        Whether it acts in several joints.
    """

    added: EffectTerm
    columns: tuple[int, ...]
    is_wide: bool


@dataclass(frozen=True, eq=False, slots=True)
class Catalogue:
    """All variants with their columns, not whitened.

    Attributes
    ----------
    variants
        Of every effect, local ones by joint first.
    local
        Joint (from 1) -> (N, V) columns of effects that act there alone.
    wide
        Joint (from 1) -> (N, W) columns, in that joint, of effects that act in several.
    excluded
        (effect, joint or None) -> why it cannot act or cannot be tried.
    """

    variants: tuple[Variant, ...]
    local: dict[int, Floats]
    wide: dict[int, Floats]
    excluded: dict[tuple[str, int | None], str]


def build(solved: Fit, effects: Sequence[Effect] | None = None) -> Catalogue:
    """Columns of every effect that is not in the model, at the loads of `solved`; periodic ones have spectra instead.

    Parameters
    ----------
    solved
        The model so far.
    effects
        What to try; all that are no part of every model where not given.
    """
    tried = [one for one in (effects or catalogue().values()) if not one.base and one.periodic is None]
    variants: list[Variant] = []
    excluded: dict[tuple[str, int | None], str] = {}
    local: dict[int, list[Floats]] = {row.bins.joint: [] for row in solved.joints}
    wide: dict[int, list[Floats]] = {row.bins.joint: [] for row in solved.joints}
    width = dict.fromkeys([*local, 0], 0)
    extents = {row.bins.joint: row.bins.extent(row.drawn) for row in solved.joints}
    whole = _whole(solved, extents)
    for effect in tried:
        for owner in _owners(solved, effect):
            why = None if owner is None else effect.applies(solved.model.robot, owner)
            if why is None and _present(solved, effect, owner):
                continue
            if why is not None:
                excluded[effect.name, owner] = why
                continue
            here = extents.get(owner or 0) or whole
            shapes = effect.grid(solved.model.robot, here)
            place = owner if effect.scope is Scope.JOINT and owner is not None else 0
            some = [row for row in solved.joints if place in (0, row.bins.joint)]
            each = [_columns(solved, effect, owner, row=row, shapes=shapes) for row in some]
            for row, columns in zip(some, each, strict=True):
                (wide if place == 0 else local)[row.bins.joint] += columns
            count = each[0][0].shape[1] if each[0] else 0
            for shape in shapes:
                own = tuple(range(width[place], width[place] + count))
                variants.append(Variant(EffectTerm(effect, owner, dict(shape)), own, place == 0))
                width[place] += count
    return Catalogue(tuple(variants), _stacked(local, solved), _stacked(wide, solved), excluded)


def _columns(
    solved: Fit, effect: Effect, owner: int | None, *, row: FitRow, shapes: Sequence[Mapping[str, float]]
) -> list[Floats]:
    return effect.columns_each(solved.model.robot, row.bins.samples, number=owner or 0, shapes=shapes)


def _owners(solved: Fit, effect: Effect) -> Iterable[int | None]:
    if effect.scope is Scope.ARM:
        return (None,)
    if effect.scope is Scope.CAUSE:
        return range(1, solved.model.robot.n_joints + 1)
    return [row.bins.joint for row in solved.joints]


def _present(solved: Fit, effect: Effect, owner: int | None) -> bool:
    """Whether the model has the effect there already, and only once is possible."""
    if effect.is_repeatable:
        return False
    inside = any(one.key == (effect.name, owner) for one in solved.model.effects)
    chosen = {(column.effect, column.owner or None) for column in solved.model.columns}
    return inside or (effect.name, owner) in chosen


def _whole(solved: Fit, extents: dict[int, Extent]) -> Extent:
    """Of all joints together, for what acts in several."""
    every = list(extents.values())
    elapsed = sorted(float(row.bins.samples.elapsed[k]) for row in solved.joints for k in row.bins.first)
    return Extent(
        joint=None,
        speeds=distinct([speed for one in every for speed in one.speeds]),
        position=(min(one.position[0] for one in every), max(one.position[1] for one in every)),
        finest=min(one.finest for one in every),
        travel=max(one.travel for one in every),
        starts=tuple(elapsed),
        duration=max(float(row.bins.samples.elapsed.max()) for row in solved.joints),
        current=max(one.current for one in every),
        postures=max(one.postures for one in every),
    )


def _stacked(parts: dict[int, list[Floats]], solved: Fit) -> dict[int, Floats]:
    return {row.bins.joint: _together(parts[row.bins.joint], len(row.bins)) for row in solved.joints}


def _together(columns: list[Floats], bins: int) -> Floats:
    """(bins, V) all columns, nothing where one is not known."""
    out = np.column_stack(columns) if columns else np.zeros((bins, 0))
    return out if np.isfinite(out).all() else np.nan_to_num(out)
