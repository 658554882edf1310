"""A model held against measurements, per joint and per run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note
from pumaid.records.run import Run

Floats = NDArray[np.float64]

#: Name of the share of the current that no effect of the model explains.
UNEXPLAINED = "unexplained"

#: Between the names of effects whose sum the fitted data determine although not each of them: ``coulomb+viscous``.
TOGETHER = "+"


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
        Largest absolute residual of a cell, A.
    predicted
        (M,) A at the run's cells.
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
        """(M,) measured minus predicted at the run's cells, A."""
        return self.run.cells.current[:, self.run.joint - 1] - self.predicted


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


@dataclass(frozen=True, slots=True)
class OutsideScore:
    """One joint outside runs, by the `reason` that the stretches are no runs (ramps, several joints moving).

    Inertia is missing there by design. `rmse` and `bias` are of cell means while the joint moves, A.
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
