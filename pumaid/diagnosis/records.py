"""What a model still gets wrong, which physics is missing, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note
from pumaid.trajectory import NextRun

Floats = NDArray[np.float64]

#: Verdicts of a joint.
ADEQUATE, MISSING, UNEXPLAINED_JOINT = "adequate", "missing", "unexplained"
#: Verdicts of a candidate.
ADD, DOUBTFUL, ABSENT, UNSEEN = "add", "doubtful", "absent", "unseen"


@dataclass(frozen=True, slots=True)
class Size:
    """A fitted parameter of a candidate: name, value and standard error, unit."""

    name: str
    value: float
    std_error: float
    unit: str


#: Share of an effect below which adding it does runs that were held out more harm than good, standard errors below it
#: at which these deny the effect, and the standard error beyond which they say nothing of it.
HALF, DENIED, BLIND = 0.5, 3.0, 0.5
#: Twice the log likelihood of runs held out that an effect may lose them.
MOST_LOST = 20.0


@dataclass(frozen=True, slots=True)
class Transfer:
    """Share of the current that an effect adds in runs held out which these really show, with its standard error.

    One where the effect is what was named; little where something else was taken for it. `lost` is what adding
    it takes from twice their log likelihood: negative where they are predicted better.
    """

    share: float
    std_error: float
    lost: float

    @property
    def is_clear(self) -> bool:
        """Whether these runs tell the share."""
        return self.std_error <= BLIND

    @property
    def is_partial(self) -> bool:
        """Whether they show decidedly less than the effect: something else is there as well, or instead."""
        return 1.0 - self.share > DENIED * self.std_error

    @property
    def is_little(self) -> bool:
        """Whether they show decidedly less than half of it."""
        return HALF - self.share > DENIED * self.std_error

    @property
    def is_denied(self) -> bool:
        """Whether these runs show decidedly less than half of the effect, or are predicted decidedly worse."""
        return self.is_little or self.lost > MOST_LOST


@dataclass(frozen=True, slots=True)
class Candidate:
    """One effect tried at one joint (None: the whole arm), its shape at its best values.

    Attributes
    ----------
    verdict, reason
        ``add``, ``doubtful``, ``absent`` or ``unseen``, and why, in a sentence.
    p_value
        Family-wise: the chance that anything in the catalogue looks as good in data where nothing is missing.
    evidence
        Twice the gain in log likelihood, less (parameters) x log(samples' worth); differences of 10 are decisive.
    rmse_after
        RMSE (A) of the joint's fitted runs with it, all else refitted.
    rmse_heldout_before, rmse_heldout_after
        RMSE (A) of fitted runs as fits to the other runs predict them, without and with it.
    posture_gain
        Share of the error in postures left out that it removes; None with fewer than four postures.
    sizes, rivals, command
        Its parameters, names of effects that these data cannot tell from it, and what adds it.
    """

    effect: str
    joint: int | None
    shape: Mapping[str, float]
    verdict: str
    reason: str
    p_value: float
    evidence: float
    rmse_after: float | None = None
    rmse_heldout_before: float | None = None
    rmse_heldout_after: float | None = None
    posture_gain: float | None = None
    sizes: tuple[Size, ...] = ()
    rivals: tuple[str, ...] = ()
    command: str = ""


@dataclass(frozen=True, slots=True)
class Limit:
    """What these data could not have shown: the smallest size of an effect seen with 80 % chance, or why none is.

    `parameter` and `unit` say what the size is of; `size` is None where no size could be seen, `reason` then says why.
    """

    effect: str
    joint: int | None
    parameter: str
    size: float | None
    unit: str
    reason: str | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Unexplained:
    """The shape of what no effect explains: free-form means over bins of one variable.

    `form` is such as ``f(q)`` or ``s f(v)``; `centres` (B,) of the bins, `means` and `errors` (B,) A; `peak` where
    it is largest, `share` of the excess over the noise floor that it takes away, `text` the same for people. `is_clear`
    says whether the shape itself is more than chance; else it is the nearest of shapes that all fit badly.
    """

    form: str
    variable: str
    unit: str
    centres: Floats
    means: Floats
    errors: Floats
    peak: float
    share: float
    text: str
    is_clear: bool = True


@dataclass(frozen=True, eq=False, slots=True)
class JointDiagnosis:
    """What is wrong at one joint.

    Attributes
    ----------
    verdict, text
        ``adequate``, ``missing`` or ``unexplained``; in plain sentences.
    rmse, noise_floor
        A, of the fitted runs; the floor None where no run is repeated.
    repeats
        Share of the residual that repeats between replicates, and the chance of that much by noise alone (None: no
        replicates).
    budget
        Parts of the residual's mean square (A2) that add up to it, by name.
    candidates, unexplained, limits
        What passed and what came near, best first; the shape of what remains; what could not have been seen.
    weakened
        Sentences: what weakens this diagnosis (no replicates, one posture ...).
    """

    joint: int
    verdict: str
    text: str
    rmse: float | None
    noise_floor: float | None
    repeats: tuple[float, float] | None = None
    budget: Mapping[str, float] = field(default_factory=dict)
    candidates: tuple[Candidate, ...] = ()
    unexplained: Unexplained | None = None
    limits: tuple[Limit, ...] = ()
    weakened: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Binned:
    """What a model leaves in one direction of motion, in bins of one variable, before and after an effect is added.

    `direction` is 1, -1 or 0 (both together); `centres` (B,) in the curve's unit; `before` and `after` (B,) A are means
    over runs of what is left, `errors` (B,) A their standard errors (NaN of a single run); `runs` (B,) how many runs
    stand behind each.
    """

    direction: int
    centres: Floats
    before: Floats
    after: Floats
    errors: Floats
    runs: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """What adding `effect` changes in one direction of motion: (G,) A at `places` (G,), NaN where it is not known."""

    effect: str
    direction: int
    places: Floats
    values: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Curve:
    """An effect as the data show it: what is left against the variable in which the effect lives.

    `joint` is the one whose current is drawn; `variable` a word or two (``speed``, ``position`` ...), `unit` its unit
    (SI); `lines` the effect's own first, then its rivals'; `period` of a folded variable, else None.
    """

    joint: int
    variable: str
    unit: str
    sides: tuple[Binned, ...]
    lines: tuple[Line, ...]
    period: float | None = None


@dataclass(frozen=True, slots=True)
class Finding:
    """What the user should add: an effect at a joint (None: the whole arm), its rivals and what would decide.

    `rmse_heldout_before` and `_after` (A) are of runs that no fit saw, `transfer` says how much of the effect these
    show, where they can. `curves` let it be seen, one for each joint whose current it changes most.
    """

    effect: str
    joint: int | None
    shape: Mapping[str, float]
    verdict: str
    rivals: tuple[str, ...]
    p_value: float
    text: str
    command: str
    rmse_heldout_before: float | None = None
    rmse_heldout_after: float | None = None
    sizes: tuple[Size, ...] = ()
    next_run: NextRun | None = None
    curves: tuple[Curve, ...] = ()
    transfer: Transfer | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Diagnosis:
    """A diagnosis of all joints of one model on some logs.

    `findings` stand strongest first; `applied` are those of earlier diagnoses that this model holds, in the order in
    which they were added. `model` is the SHA-256 of the model file, `logs` maps names to those of the logs.
    """

    robot: str
    joints: tuple[JointDiagnosis, ...]
    findings: tuple[Finding, ...]
    model: str = ""
    logs: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    recipe_digest: str = ""
    version: str = ""
    applied: tuple[Finding, ...] = ()
