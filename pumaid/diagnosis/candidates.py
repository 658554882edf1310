"""Everything that could be missing: each effect at each joint with each shape of its grid, as columns over bins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import EffectTerm
from pumaid.effects import Effect, Scope, catalogue
from pumaid.effects.base import NO_SHAPE, Family, Parameter, Shape
from pumaid.estimation.fit import Fit, FitRow
from pumaid.joint_bins import JointBins, distinct
from pumaid.preprocessing.options import CONSTANT
from pumaid.robot import Robot
from pumaid.samples import Extent, Samples

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class CandidateShape:
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
class CandidateColumns:
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

    variants: tuple[CandidateShape, ...]
    local: dict[int, Floats]
    wide: dict[int, Floats]
    excluded: dict[tuple[str, int | None], str]


def candidate_columns(solved: Fit, effects: Sequence[Effect] | None = None) -> CandidateColumns:
    """Columns of every effect that is not in the model, at the loads of `solved`; periodic ones have spectra instead.

    Parameters
    ----------
    solved
        The model so far.
    effects
        What to try; all that are no part of every model where not given.
    """
    tried = [
        candidate
        for candidate in (effects or catalogue().values())
        if not candidate.base and candidate.periodic is None
    ]
    variants: list[CandidateShape] = []
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
            extent = extents.get(owner or 0) or whole
            shapes = effect.grid(solved.model.robot, extent)
            place = owner if effect.scope is Scope.JOINT and owner is not None else 0
            rows = [row for row in solved.joints if place in (0, row.bins.joint)]
            blocks = [_columns(solved, effect, owner, row=row, shapes=shapes) for row in rows]
            for row, columns in zip(rows, blocks, strict=True):
                (wide if place == 0 else local)[row.bins.joint] += columns
            count = blocks[0][0].shape[1] if blocks[0] else 0
            for shape in shapes:
                numbers = tuple(range(width[place], width[place] + count))
                variants.append(CandidateShape(EffectTerm(effect, owner, dict(shape)), numbers, place == 0))
                width[place] += count
    return CandidateColumns(tuple(variants), _stacked(local, solved), _stacked(wide, solved), excluded)


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
    inside = any(term.key == (effect.name, owner) for term in solved.model.effects)
    chosen = {(column.effect, column.owner or None) for column in solved.model.columns}
    return inside or (effect.name, owner) in chosen


def _whole(solved: Fit, extents: dict[int, Extent]) -> Extent:
    """Of all joints together, for what acts in several."""
    joints = list(extents.values())
    elapsed = sorted(float(row.bins.samples.elapsed[k]) for row in solved.joints for k in row.bins.first)
    return Extent(
        joint=None,
        speeds=distinct([speed for extent in joints for speed in extent.speeds]),
        position=(min(extent.position[0] for extent in joints), max(extent.position[1] for extent in joints)),
        finest=min(extent.finest for extent in joints),
        travel=max(extent.travel for extent in joints),
        starts=tuple(elapsed),
        duration=max(float(row.bins.samples.elapsed.max()) for row in solved.joints),
        current=max(extent.current for extent in joints),
        postures=max(extent.postures for extent in joints),
    )


def _stacked(parts: dict[int, list[Floats]], solved: Fit) -> dict[int, Floats]:
    return {row.bins.joint: _together(parts[row.bins.joint], len(row.bins)) for row in solved.joints}


def _together(columns: list[Floats], bins: int) -> Floats:
    """(bins, V) all columns, nothing where one is not known."""
    out = np.column_stack(columns) if columns else np.zeros((bins, 0))
    return out if np.isfinite(out).all() else np.nan_to_num(out)


#: What the column is multiplied by, in the order of the shape ``times``.
TIMES = ("nothing", "direction", "load")


class Suspect(Effect):
    """a x, s a x or a tau x, with x a column of the logs less its mean, s the direction and tau gravity's load.

    Parameters
    ----------
    column
        Its name.
    place
        Its number in `Samples.extra`.
    middle, spread
        Mean and standard deviation over the runs, in the column's own unit.
    """

    title = "A suspected column of the logs"
    source = "the user's suspicion"
    family = Family.SUSPECT
    needs_loads: ClassVar[bool] = True

    def __init__(self, column: str, place: int, *, middle: float, spread: float) -> None:
        self.column, self.place, self.middle, self.spread = column, place, middle, spread

    @property
    def name(self) -> str:
        """``suspect:COLUMN``."""
        return f"suspect:{self.column}"

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("a", "A", f"current per standard deviation ({self.spread:.4g}) of {self.column}", "a{n}"),)

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        return (Shape("times", "1", "0: as it is, 1: times direction, 2: times load", 0.0, 2.0, 1.0, False),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        return tuple({"times": float(number)} for number in range(len(TIMES)))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        if samples.extra is None or self.spread <= 0.0:
            return np.zeros((len(samples), 1))
        x = np.nan_to_num((samples.extra[:, self.place] - self.middle) / self.spread)
        load = np.zeros(len(samples)) if samples.loads is None else samples.loads.own
        factor = (np.ones(len(samples)), samples.direction, load)[int(shape.get("times", 0.0))]
        return np.asarray((x * factor)[:, None])


#: s in which the transient of a position controller dies down; two of them span what servo drives do (bandwidths of 3
#: to 10 Hz).
SETTLING_TIMES = (0.025,)
#: Speeds beyond which the transients of single speeds are not told apart but scaled with speed.
MOST_SPEEDS = 6


class Settling(Effect):
    """s b exp(-t/T), t the time since the run began: one for each speed and each T of `SETTLING_TIMES`.

    Inertia makes it: at the end of a ramp the speed is off by a few tenths of a per cent, and to mend that in some tens
    of milliseconds draws more than friction does. It is no finding, since every arm has it.
    """

    title = "The current in which the speed settles"
    source = "S.-K. Lin, eq. (35): acceleration feedback within the load compensator"
    family = Family.START
    opposes_motion: ClassVar[bool] = False

    def __init__(self, speeds: Sequence[float]) -> None:
        self.speeds = np.asarray(speeds, dtype=float)

    @property
    def name(self) -> str:
        """No name of the catalogue."""
        return "settling"

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        groups = 2 if len(self.speeds) > MOST_SPEEDS else len(self.speeds)
        return tuple(
            Parameter(f"b{k}", "A", "at the start of a run", f"b{k}") for k in range(groups * len(SETTLING_TIMES))
        )

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        v = np.abs(samples.velocity[:, samples.joint - 1])
        since = samples.travel / np.maximum(v, 1e-9)
        if len(self.speeds) > MOST_SPEEDS:
            groups = [np.ones(len(v)), v]
        else:
            nearest = np.abs(v[:, None] - self.speeds[None, :]).argmin(axis=1)
            groups = [(nearest == k).astype(float) for k in range(len(self.speeds))]
        return np.column_stack(
            [samples.direction * group * np.exp(-since / T) for T in SETTLING_TIMES for group in groups]
        )


def settling(every: Sequence[JointBins]) -> tuple[EffectTerm, ...]:
    """One for each joint that has runs at constant speed."""
    out = []
    for bins in every:
        steady = [abs(run.speed) for run in bins.runs if run.kind == CONSTANT]
        if len(steady) == len(bins.runs):
            out.append(EffectTerm(Settling(bins.speeds), bins.joint, NO_SHAPE))
    return tuple(out)
