"""Everything that could be missing: each effect at each joint with each shape of its grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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
#: Effect and joint (from 1; None: the whole arm).
Key = tuple[str, int | None]


@dataclass(frozen=True, eq=False, slots=True)
class Candidates:
    """What may be missing: `groups` of one effect at one joint with each shape of its grid, and what is `excluded`.

    Effect and joint (None: the whole arm) of those that cannot act, or cannot be tried, map to the reason.
    """

    groups: tuple[tuple[EffectTerm, ...], ...] = ()
    excluded: Mapping[Key, str] = field(default_factory=dict)

    def shapes(self, key: Key) -> tuple[EffectTerm, ...]:
        """The grid of one effect at one joint."""
        return next((group for group in self.groups if group[0].key == key), ())


def grid_of(solved: Fit, effect: Effect, joint: int | None) -> tuple[EffectTerm, ...]:
    """An effect with each shape at which a search begins, given what the runs of its joint cover, or those of all."""
    rows = {row.bins.joint: row for row in solved.joints}
    if joint in rows:
        covered = extent([rows[joint].bins], joint, rows[joint].drawn)
    else:
        covered = extent([row.bins for row in solved.joints], 0)
    return tuple(EffectTerm(effect, joint, dict(shape)) for shape in effect.grid(solved.model.robot, covered))


def candidates(solved: Fit, effects: Sequence[Effect] | None = None) -> Candidates:
    """Every effect (of the catalogue, where not given) that the model lacks; periodic ones have spectra instead."""
    robot, moving = solved.model.robot, [row.bins.joint for row in solved.joints]
    owners: dict[Scope, Sequence[int | None]] = {Scope.ARM: (None,), Scope.CAUSE: range(1, robot.n_joints + 1)}
    present = {term.key for term in solved.model.effects}
    present |= {(column.effect, column.owner or None) for column in solved.model.columns}
    groups, excluded = [], {}
    tried = [effect for effect in effects or catalogue().values() if not effect.base and effect.periodic is None]
    for effect in tried:
        for joint in owners.get(effect.scope, moving):
            why = None if joint is None else effect.applies(robot, joint)
            if why is not None:
                excluded[effect.name, joint] = why
            elif effect.is_repeatable or (effect.name, joint) not in present:
                groups.append(grid_of(solved, effect, joint))
    return Candidates(tuple(group for group in groups if group), excluded)


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
        return tuple({"times": float(number)} for number in range(3))

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
