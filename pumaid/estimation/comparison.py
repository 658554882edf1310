"""A model held against measurements, per joint and per run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.errors import Note

Floats = NDArray[np.float64]

#: Name of the share of the current that no effect of the model explains.
UNEXPLAINED = "unexplained"

#: Between the names of effects whose sum the fitted data determine although not each of them: ``coulomb+viscous``.
TOGETHER = "+"


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One part of what a model leaves at a joint.

    Attributes
    ----------
    name
        ``noise_shared`` (noise that a run has as a whole), ``noise_inside`` (noise inside runs), ``smooth`` (within a
        run, a few waves over its travel), ``fast`` (within a run, a ripple), ``start`` (where a run begins), ``odd``
        (between runs, turns round with the direction), ``even`` (between runs, the same both ways), ``time`` (with time
        or temperature), ``unassigned`` (repeats, and is none of these).
    mean_square
        A2: what a model with that physics would take away; never negative.
    p_value
        Chance of as much in data where nothing is missing, all parts of the joint considered; None where not tested.
    is_more
        Whether that is more than noise would give.
    against
        Variables that show it, the strongest first: ``position``, ``direction``, ``posture``, ``speed``, ``load``,
        ``travel``, ``lag``, ``time``, ``even`` (time, the same both ways), ``temperature``; ``size`` of a ripple that
        changes along the run.
    cycles, per
        Of a ripple: cycles per ``turn`` of the joint, or per ``m`` of a sliding one, the strongest first.
    gearing
        Of each of these, how many cycles it makes per turn of the motor; empty where the gear ratio is not known.
    points_to
        Names of the effects that look like this.
    """

    name: str
    mean_square: float
    p_value: float | None = None
    is_more: bool = False
    against: tuple[str, ...] = ()
    cycles: tuple[float, ...] = ()
    per: str = ""
    gearing: tuple[float, ...] = ()
    points_to: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Budget:
    """The mean square of what a model leaves at one joint, in parts that add up to it.

    Attributes
    ----------
    mean_square
        A2, of samples: the RMSE squared.
    parts
        Every part, in the order of `BudgetPart.name`.
    runs, replicates
        How many runs there are, and how many of them repeat another.
    floor
        A2: half the mean squared difference of repeated runs; None without replicates.
    limits
        What these runs cannot split, by slug: ``no-replicates``, ``one-direction``, ``one-posture``, ``one-speed``,
        ``two-speeds``, ``few-runs``, ``strokes``, ``several-clocks``, ``no-load``.
    """

    mean_square: float
    parts: tuple[BudgetPart, ...]
    runs: int
    replicates: int
    floor: float | None = None
    limits: tuple[str, ...] = ()

    def part(self, name: str) -> BudgetPart:
        """The part called `name`."""
        return next(part for part in self.parts if part.name == name)

    def by_name(self) -> dict[str, float]:
        """Name -> A2 of every part."""
        return {part.name: part.mean_square for part in self.parts}

    @property
    def noise(self) -> float:
        """A2 that no model can remove."""
        return sum(part.mean_square for part in self.parts if part.name.startswith("noise"))


@dataclass(frozen=True, eq=False, slots=True)
class RunScore:
    """One run against the model.

    Attributes
    ----------
    run
        The run.
    rmse, bias
        Over its samples: root mean square and mean of measured minus predicted, A.
    largest
        Largest absolute residual of a bin, A.
    predicted
        (M,) A at the run's bins.
    undetermined
        Whether the prediction leans on what the fitted data did not determine, with `reason`.
    explained
        1 minus the residual's share of the squares about the joint's mean current, no unit; None without variance.
    parts
        Effect -> (M,) its part of `predicted`, A; one part for effects that cannot be told apart, as in the joint's
        `shares`.
    """

    run: Run
    rmse: float
    bias: float
    largest: float
    predicted: Floats
    undetermined: bool = False
    reason: str | None = None
    explained: float | None = None
    parts: dict[str, Floats] = field(default_factory=dict)

    @property
    def residual(self) -> Floats:
        """(M,) measured minus predicted at the run's bins, A."""
        return self.run.bins.current - self.predicted


@dataclass(frozen=True, slots=True)
class JointScore:
    """One joint over its runs; held-out runs are counted apart unless there are no others.

    Attributes
    ----------
    joint
        From 1.
    runs, samples
        How many stand behind the figures.
    rmse, bias
        Over samples, A; None without runs.
    explained
        Share of the current's variance about its mean, no unit.
    noise_floor, noise_floor_reason
        RMSE that no model goes below (A), or why it is not known.
    rms
        Root mean square of the measured current, A.
    shares
        Effect -> its share of the mean square of the current, no unit; with `UNEXPLAINED` for what the model leaves
        they add up to 1. A negative share relieves the motor. Effects of which the fitted data determine the sum only
        stand together, joined by `TOGETHER`.
    heldout_runs, heldout
        Runs that the plan keeps for judging, and their RMSE, A.
    undetermined
        Runs of which the model could not know enough.
    budget
        Where the error lives: its square in parts; None without runs.
    """

    joint: int
    runs: int
    samples: int
    rmse: float | None
    bias: float | None
    explained: float | None
    noise_floor: float | None
    noise_floor_reason: str | None = None
    rms: float | None = None
    shares: dict[str, float] = field(default_factory=dict)
    heldout_runs: int = 0
    heldout: float | None = None
    undetermined: int = 0
    budget: Budget | None = None


@dataclass(frozen=True, slots=True)
class OutsideScore:
    """One joint outside runs, by the `reason` that the stretches are no runs (ramps, several joints moving).

    Inertia is missing there by design. `rmse` and `bias` are of bin means while the joint moves, A.
    """

    joint: int
    reason: str
    samples: int
    rmse: float
    bias: float


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """A model against measurement on some logs.

    Attributes
    ----------
    robot
        Its name.
    joints
        One a joint of the arm.
    runs
        In order of the evidence, held-out ones too.
    outside
        What lies outside runs.
    rmse
        Over all samples of the runs behind `joints`, A; None without runs.
    heldout
        Over all samples of held-out runs, A; None where there are none.
    logs
        Name -> SHA-256.
    notes
        What a user should know.
    recipe_digest, version
        SHA-256 of the recipe, and of which version of the program the model is.
    """

    robot: str
    joints: tuple[JointScore, ...]
    runs: tuple[RunScore, ...]
    outside: tuple[OutsideScore, ...] = ()
    rmse: float | None = None
    logs: dict[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    heldout: float | None = None
    recipe_digest: str = ""
    version: str = ""

    def of_joint(self, joint: int) -> tuple[RunScore, ...]:
        """Scores of the runs in which `joint` (from 1) moves."""
        return tuple(score for score in self.runs if score.run.joint == joint)

    def worst(self, count: int) -> tuple[RunScore, ...]:
        """The `count` runs with the largest RMSE against their joint's noise floor, or its RMSE where unknown."""
        scale = {score.joint: score.noise_floor or score.rmse or 1.0 for score in self.joints}
        return tuple(sorted(self.runs, key=lambda score: -score.rmse / scale[score.run.joint])[:count])
