"""A fitted model: values with their uncertainty, and all that is needed to predict with it."""

import math
from dataclasses import dataclass, field

from pumaid.errors import Note
from pumaid.maths import Floats
from pumaid.robot import EffectChoice

IDENTIFIED, GIVEN, NOT_IDENTIFIABLE = "identified", "given", "not_identifiable"


@dataclass(frozen=True, slots=True)
class Value:
    """One parameter, SI in `unit`, of a joint or link (from 1; None: the whole arm); numbers None where not identified.

    `name` is as in ``gravity.l3.x``, ``gain_ratio.2.3``, `symbol` the paper's short name (``k3x``); `dof` are the
    degrees of freedom behind the interval. `state` is ``identified``, ``given`` or ``not_identifiable``; then `reason`
    says why, and `next_run` which run would show it, None where nothing would or nothing need.
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
class JointResult:
    """How well a model meets the runs of one joint (from 1), held-out ones apart unless there are no others.

    `rmse` (A) is over samples, `noise_floor` (A) the RMSE that no model goes below, or `noise_floor_reason` says why it
    is not known, and where runs are blocks of any motion, `noise_inside` (A) what comes and goes within tenths of a
    second; `heldout_runs` are those that the plan keeps for judging, `heldout` their RMSE (A), None without.
    """

    joint: int
    runs: int
    samples: int
    rmse: float | None = None
    noise_floor: float | None = None
    noise_floor_reason: str | None = None
    noise_inside: float | None = None
    heldout_runs: int = 0
    heldout: float | None = None


@dataclass(frozen=True, slots=True)
class JointFit(JointResult):
    """How well one joint is fitted; `posture_groups` counts the distinct sets of held positions, `kinds` runs by kind,
    `run_level` (A) is the noise that a run shares.
    """

    run_level: float | None = None
    posture_groups: int = 0
    kinds: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """A fitted model.

    `robot`, `recipe_digest` and `origin` are name, SHA-256 and file name of the recipe, `geometry` the digest of its
    joints and gravity; `effects` physics beyond the paper's model, shapes filled in. `values` has every parameter and
    neighbour ratio, identified or not, `combinations` sums that are determined where their terms are not, `recursive`
    the recursion's own values, before the joint refinement; `method`, ``"joint"`` or ``"recursive"``, says which are
    shown. For prediction there are all p linear parameters' `names`, minimum-norm `solution` and `covariance` (p, p),
    and `scales` (J, J): row i, column j the factor eta_i/eta_j by which link j's parameters act in joint i's current;
    NaN where it is not determined, 1 on the diagonal, 0 where j < i. `blind` (p, b) are directions in which the data do
    not determine `solution`, as long as their parameters are plausibly large (as much as their joint's RMS current): a
    row of regressors, ratios included, times this is the current (A) by which a prediction may be off, beyond its
    covariance. `logs` maps names to SHA-256; `heldout` is the RMSE (A) over all runs that were kept for judging.
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
    recursive: tuple[Value, ...] = ()
    method: str = "joint"
    recipe_digest: str = ""
    geometry: str = ""
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

    def pooled(self, name: str) -> float | None:
        """The arm's ``rmse``, ``heldout`` or ``noise_floor`` (A), joints weighted by their fitted samples.

        None unless known of every fitted joint.
        """
        fitted = [fit for fit in self.joints if fit.rmse is not None]
        values = [getattr(fit, name) for fit in fitted]
        if not fitted or None in values:
            return None
        squares = sum(fit.samples * value**2 for fit, value in zip(fitted, values, strict=True))
        return math.sqrt(squares / sum(fit.samples for fit in fitted))
