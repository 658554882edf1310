"""A fitted model: values with their uncertainty, and all that is needed to predict with it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note
from pumaid.robot import EffectChoice

Floats = NDArray[np.float64]

IDENTIFIED, GIVEN, NOT_IDENTIFIABLE = "identified", "given", "not_identifiable"


@dataclass(frozen=True, slots=True)
class Value:
    """One parameter.

    Attributes
    ----------
    name, symbol
        ``gravity.l3.x``, ``coulomb.j1.plus``, ``gain_ratio.2.3`` ..., and the paper's short name, ``k3x``.
    joint
        Joint or link that owns it, from 1; None for one of the whole arm.
    value, std_error, ci95, dof
        SI, in `unit`; None where not identifiable. `dof` are the degrees of freedom behind the interval.
    state, reason, next_run
        ``identified``, ``given`` or ``not_identifiable``; why it is not identifiable, and the run that would show it,
        in words, None where nothing would or nothing need.
    """

    name: str
    symbol: str
    joint: int | None
    unit: str
    value: float | None = None
    std_error: float | None = None
    ci95: tuple[float, float] | None = None
    dof: float | None = None
    state: str = IDENTIFIED
    reason: str | None = None
    next_run: str | None = None


@dataclass(frozen=True, slots=True)
class Combination:
    """A sum of parameters that the data determine although its terms are not: weights by name, value, error, unit."""

    terms: dict[str, float]
    value: float
    std_error: float
    unit: str
    text: str


@dataclass(frozen=True, slots=True)
class JointFit:
    """How well one joint is fitted: counts, RMSE of samples (A), noise floor (A) or None with the reason.

    `posture_groups` counts the distinct sets of held positions; `kinds` counts runs by kind. `heldout_runs` are those
    that the plan keeps for judging, `heldout` their RMSE (A), None without.
    """

    joint: int
    runs: int
    samples: int
    rmse: float | None
    noise_floor: float | None
    noise_floor_reason: str | None = None
    run_level: float | None = None
    posture_groups: int = 0
    kinds: dict[str, int] = field(default_factory=dict)
    heldout_runs: int = 0
    heldout: float | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """A fitted model.

    Attributes
    ----------
    robot, recipe_digest, origin
        Name, SHA-256 and file name of the recipe.
    effects
        Physics beyond the paper's model that is in it, shapes filled in.
    values, combinations
        Every parameter and neighbour ratio, identified or not; sums that are determined where their terms are not.
    names, solution, covariance
        (p,) all linear parameters of the model, their minimum-norm solution and covariance (p, p): for prediction.
    scales
        (J, J): row i, column j the factor eta_i/eta_j by which link j's parameters act in joint i's current;
        NaN where it is not determined, 1 on the diagonal, 0 where j < i.
    blind
        (p, b) directions in which the data do not determine `solution`, each as long as its parameters are plausibly
        large (as much as their joint's RMS current): a row of regressors, ratios included, times this is the current
        (A) by which a prediction may be off, beyond its covariance.
    stroke_postures
        Positions (J,) at which the other joints were held, with the moving joint's number, one a group that has its own
        inertia: ``J1``, ``J2`` ... of a joint in this order.
    recursive, method
        The recursion's own values, before the joint refinement, and which is shown: ``"joint"`` or ``"recursive"``.
    logs
        Name -> SHA-256 of the logs that were fitted.
    heldout
        RMSE (A) over all runs that were kept for judging, None without.
    """

    robot: str
    joints: tuple[JointFit, ...]
    values: tuple[Value, ...]
    names: tuple[str, ...]
    solution: Floats
    covariance: Floats
    scales: Floats
    blind: Floats
    effects: tuple[EffectChoice, ...] = ()
    combinations: tuple[Combination, ...] = ()
    stroke_postures: tuple[tuple[int, tuple[float, ...]], ...] = ()
    recursive: tuple[Value, ...] = ()
    method: str = "joint"
    recipe_digest: str = ""
    origin: str = ""
    logs: dict[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    version: str = ""
    heldout: float | None = None

    def value(self, name: str) -> Value:
        """The parameter or ratio called `name`; KeyError where there is none."""
        return {value.name: value for value in self.values}[name]

    def joint(self, number: int) -> JointFit:
        """The fit of joint `number` (from 1)."""
        return self.joints[number - 1]
