"""Everything that could be missing: each effect at each joint with each shape of its grid, as columns over bins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Effect, Scope, catalogue
from pumaid.effects.base import NO_SHAPE, Family, Parameter, Shape
from pumaid.estimation.fit import Fit
from pumaid.joint_bins import JointBins, extent
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
    robot, joints = solved.model.robot, [row.bins.joint for row in solved.joints]
    variants: list[CandidateShape] = []
    excluded: dict[tuple[str, int | None], str] = {}
    columns: dict[tuple[bool, int], list[Floats]] = {(is_wide, k): [] for is_wide in (False, True) for k in joints}
    width = dict.fromkeys([*joints, 0], 0)
    extents = {row.bins.joint: extent([row.bins], row.bins.joint, row.drawn) for row in solved.joints}
    everywhere = extent([row.bins for row in solved.joints], 0)
    for effect in effects or catalogue().values():
        for owner in _owners(solved, effect):
            why = None if owner is None else effect.applies(robot, owner)
            if why is not None:
                excluded[effect.name, owner] = why
            if why is not None or _is_present(solved, effect, owner):
                continue
            shapes = effect.grid(robot, extents.get(owner or 0, everywhere))
            place = owner or 0 if effect.scope is Scope.JOINT else 0
            for row in (row for row in solved.joints if place in (0, row.bins.joint)):
                made = effect.columns_each(robot, row.bins.samples, number=owner or 0, shapes=shapes)
                columns[place == 0, row.bins.joint] += made
            count = made[0].shape[1] if shapes else 0
            for shape in shapes:
                numbers = tuple(range(width[place], width[place] + count))
                variants.append(CandidateShape(EffectTerm(effect, owner, dict(shape)), numbers, place == 0))
                width[place] += count
    local, wide = (
        {row.bins.joint: _stacked(columns[is_wide, row.bins.joint], len(row.bins)) for row in solved.joints}
        for is_wide in (False, True)
    )
    return CandidateColumns(tuple(variants), local, wide, excluded)


def _owners(solved: Fit, effect: Effect) -> Iterable[int | None]:
    """Joints at which an effect is tried, None for the whole arm."""
    if effect.base or effect.periodic is not None:
        return ()
    if effect.scope is Scope.ARM:
        return (None,)
    if effect.scope is Scope.CAUSE:
        return range(1, solved.model.robot.n_joints + 1)
    return [row.bins.joint for row in solved.joints]


def _is_present(solved: Fit, effect: Effect, owner: int | None) -> bool:
    """Whether the model has the effect there already, and only once is possible."""
    chosen = {term.key for term in solved.model.effects}
    chosen |= {(column.effect, column.owner or None) for column in solved.model.columns}
    return not effect.is_repeatable and (effect.name, owner) in chosen


def _stacked(columns: list[Floats], bins: int) -> Floats:
    """(bins, V) all columns, nothing where a value is not known."""
    return np.nan_to_num(np.column_stack(columns)) if columns else np.zeros((bins, 0))


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

    @classmethod
    def of(cls, dataset: Dataset, column: str) -> Suspect:
        """A column that `dataset` carries, scaled by what it does in these runs."""
        place = dataset.extra.index(column)
        parts = [run.bins.extra[:, place] for run in dataset.runs if run.bins.extra is not None]
        values = np.concatenate(parts) if parts else np.zeros(1)
        values = values[np.isfinite(values)]
        middle, spread = (float(values.mean()), float(values.std())) if len(values) else (0.0, 0.0)
        return cls(column, place, middle=middle, spread=spread)

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
        load = np.zeros(len(samples)) if samples.loads is None else samples.loads.moving
        factor = (np.ones(len(samples)), samples.direction, load)[int(shape.get("times", 0.0))]
        return np.asarray((x * factor)[:, None])


#: s in which the transient of a position controller dies down (servo drives have bandwidths of 3 to 10 Hz).
SETTLING_TIME = 0.025
#: Speeds beyond which the transients of single speeds are not told apart but scaled with speed.
MOST_SPEEDS = 6


class Settling(Effect):
    """s b exp(-t/T), t the time since the run began, T `SETTLING_TIME`: one b for each speed.

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
        return tuple(Parameter(f"b{k}", "A", "at the start of a run", f"b{k}") for k in range(groups))

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
        fading = samples.direction * np.exp(-since / SETTLING_TIME)
        return np.column_stack([group * fading for group in groups])


def settling(bins: Sequence[JointBins]) -> tuple[EffectTerm, ...]:
    """One for each joint of which all runs are at constant speed."""
    steady = [item for item in bins if not item.is_stroke.any()]
    return tuple(EffectTerm(Settling(item.speeds), item.joint, NO_SHAPE) for item in steady)
