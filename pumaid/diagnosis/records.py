"""What a model still gets wrong, which physics is missing, and how sure that is: as records, and as a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

from pumaid import __version__
from pumaid.effects import catalogue
from pumaid.errors import Note
from pumaid.estimate import Estimate
from pumaid.io.write import write_file
from pumaid.maths import Floats
from pumaid.results.documents import as_text, heading, model_digest, plain, read_document, record_from, sealed
from pumaid.robot import EffectChoice
from pumaid.trajectory import NextRun

#: Name of the file in a folder of results.
DIAGNOSIS_NAME = "diagnosis.json"
#: Verdicts of a joint.
ADEQUATE, MISSING, UNEXPLAINED_JOINT = "adequate", "missing", "unexplained"
#: Verdicts of a candidate.
ADD, DOUBTFUL, ABSENT, UNSEEN, STAND_IN = "add", "doubtful", "absent", "unseen", "stand_in"
#: Share of an effect below which adding it does runs that were held out more harm than good, standard errors below it
#: at which these deny the effect, and the standard error beyond which they say nothing of it. Twice the log likelihood
#: of runs held out that an effect may lose them.
HALF, DENIED, BLIND, MOST_LOST = 0.5, 3.0, 0.5, 20.0


#: Notes of a model on logs or a recipe that do not mean what they say: likelier causes than missing physics.
CAUSES = (
    *("position-reversed", "order-wrong", "gravity-wrong", "weight-missing", "scale-wrong", "loads-differ"),
    "logs-disagree",
    *("sign-lost", "velocity-unrelated", "units-disagree", "joints-swapped", "offset-odd"),
)


def causes_in(notes: Iterable[Note]) -> list[Note]:
    """The likelier causes among some notes, the likeliest first."""
    return sorted((note for note in notes if note.slug in CAUSES), key=lambda note: CAUSES.index(note.slug))


@dataclass(frozen=True, slots=True)
class Size:
    """A fitted parameter of a candidate: name, value, standard error (None: not told apart from its shape), unit."""

    name: str
    value: float
    std_error: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class Transfer:
    """Share of the current that an effect adds in runs held out which these really show, with its standard error.

    One where the effect is what was named; little where something else was taken for it. `lost` is what adding
    it takes from twice their log likelihood beyond what the errors of all parameters may: negative where nothing.
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
    def is_denied(self) -> bool:
        """Whether these runs show decidedly less than half of the effect, or are predicted decidedly worse."""
        return HALF - self.share > DENIED * self.std_error or self.lost > MOST_LOST


@dataclass(frozen=True, slots=True)
class Candidate:
    """One effect tried at one joint (None: the whole arm), its shape at its best values.

    `reason` says in a sentence why it has its `verdict`. `p_value` is family-wise: the chance that anything in the
    catalogue looks as good where nothing is missing. `evidence` is twice the gain in log likelihood, less
    (parameters) x log(samples' worth); differences of 10 are decisive. `rmse_after` (A) is of the joint's fitted runs,
    all else refitted; `rmse_heldout_before` and `_after` (A) of fitted runs as fits to the other runs predict them.
    `knots` are a learned curve's, in its variable. `joints` are those of an effect that was tried at several as one:
    `joint` is None, and names of sizes and shapes end in theirs, ``drive@2``.
    """

    effect: str
    joint: int | None
    shape: Mapping[str, float]
    verdict: str
    reason: str
    p_value: float
    evidence: float = 0.0
    rmse_after: float | None = None
    rmse_heldout_before: float | None = None
    rmse_heldout_after: float | None = None
    sizes: tuple[Size, ...] = ()
    rivals: tuple[str, ...] = ()
    command: str = ""
    knots: tuple[float, ...] = ()
    joints: tuple[int, ...] = ()

    def choices(self) -> tuple[EffectChoice, ...]:
        """The effect as a model takes it on, one a joint: its shape is open, but where it may stand there twice."""
        chosen = catalogue()[self.effect].chosen
        return tuple(EffectChoice(part.effect, part.joint, chosen(part.shape)) for part in self.each())

    def each(self) -> tuple[Self, ...]:
        """The same at one joint each."""
        return tuple(
            replace(
                self,
                joint=joint,
                joints=(),
                shape={k.partition("@")[0]: v for k, v in self.shape.items() if k.endswith(f"@{joint}")},
                sizes=tuple(
                    replace(size, name=size.name.partition("@")[0])
                    for size in self.sizes
                    if size.name.endswith(f"@{joint}")
                ),
            )
            for joint in self.joints
        ) or (self,)


@dataclass(frozen=True, slots=True)
class Finding(Candidate):
    """What the user should add: a candidate, and what would tell it from its rivals.

    Its command adds the findings before it, too. `forecast` (A) is the RMSE, with its standard error (None of one run),
    that this gives in the runs held out of the joints in which the effect acts; `rmse_heldout_before` and `_after` are
    of these runs, too. Without such runs it is None, and they are cross-validated. `transfer` says how much of the
    effect these runs show, where they can. `worth` is the fall of that RMSE over the joint's noise; findings that have
    more come first. `curves` let it be seen, one for each joint whose current it changes most.
    """

    next_run: NextRun | None = None
    curves: tuple[Curve, ...] = ()
    transfer: Transfer | None = None
    forecast: float | None = None
    forecast_error: float | None = None
    worth: float | None = None


@dataclass(frozen=True, slots=True)
class Limit:
    """The smallest size of an effect's `parameter` that is seen with 80 % chance; None where none, `reason` why.

    `up_to` (rad of phase per rad or m) is the frequency beyond which it does not hold; None of an effect that has none.
    """

    effect: str
    joint: int | None
    parameter: str
    size: float | None
    unit: str
    reason: str | None = None
    up_to: float | None = None


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


@dataclass(frozen=True, slots=True)
class Repeats:
    """Share of a residual's mean square that repeats between replicates, and the chance of that much by noise alone.

    `floor` is the RMS (A) of bins that no model of position, posture, speed and direction removes.
    """

    share: float
    p_value: float
    floor: float | None = None


@dataclass(frozen=True, eq=False, slots=True)
class JointDiagnosis:
    """What is wrong at one joint: its `verdict`, in plain sentences in `text`.

    `rmse` and `noise_floor` (A) are of the fitted runs; the floor and `repeats` are None where no run is repeated;
    `noise_inside` (A) is the noise inside blocks of any motion.
    `budget` are parts of the residual's mean square (A2) that add up to it. `candidates` passed or came near, best
    first; `limits` could not have been seen; `weakened` are sentences on what weakens this diagnosis.
    """

    joint: int
    verdict: str
    text: str
    rmse: float | None
    noise_floor: float | None
    repeats: Repeats | None = None
    budget: Mapping[str, float] = field(default_factory=dict)
    candidates: tuple[Candidate, ...] = ()
    unexplained: Unexplained | None = None
    limits: tuple[Limit, ...] = ()
    weakened: tuple[str, ...] = ()
    noise_inside: float | None = None


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


@dataclass(frozen=True, eq=False, slots=True)
class Diagnosis:
    """A diagnosis of all joints of one model on some logs (name -> SHA-256).

    `findings` stand strongest first; `applied` are those of earlier diagnoses that this model holds, in the order in
    which they were added. `model` and `recipe` hold the SHA-256 of these, under ``sha256``.
    """

    robot: str
    joints: tuple[JointDiagnosis, ...]
    findings: tuple[Finding, ...]
    model: Mapping[str, str] = field(default_factory=dict)
    logs: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    applied: tuple[Finding, ...] = ()
    recipe: Mapping[str, str] = field(default_factory=dict)
    version: str = __version__


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """As JSON; SI, angles in rad."""
    return sealed(heading("diagnosis") | plain(diagnosis))


def write_diagnosis(path: Path, diagnosis: Diagnosis) -> None:
    """Write a diagnosis file atomically; raises ResultError (cannot-write)."""
    write_file(Path(path), as_text(diagnosis_document(diagnosis)))


def read_diagnosis(path: Path) -> Diagnosis:
    """Read a diagnosis file; raises ResultError (file-not-readable, file-damaged)."""
    return read_document(Path(path), "diagnosis", partial(record_from, Diagnosis))


def stale(diagnosis: Diagnosis, estimate: Estimate, logs: Mapping[str, str]) -> tuple[str, ...]:
    """Why a diagnosis may not hold for a model and logs (name -> SHA-256): sentences, none where it does."""
    changed = {
        "The diagnosis is of another model than this page.": diagnosis.model.get("sha256") != model_digest(estimate),
        "The diagnosis is of other logs than this page.": set(diagnosis.logs.values()) != set(logs.values()),
    }
    out = [text for text, is_so in changed.items() if is_so]
    return (*out, "Make it again with: pumaid diagnose MODEL LOGS...") if out else ()
