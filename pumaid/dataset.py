"""What one pass over the logs leaves of them: runs with their bins, what was left out, and the files' facts."""

import json
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from fnmatch import fnmatch
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np

from pumaid.errors import Note, Where, listed
from pumaid.maths import Counts, Floats
from pumaid.robot import Payload

#: (Joint from 1, or 0 for the whole arm; clock) -> s on that clock at which it first moved (the arm in any recording).
FirstMotions = Mapping[tuple[int, int], float]


def arrays_of(record: Any) -> dict[str, Any]:
    """The fields of a record that are arrays, by name."""
    named = {item.name: getattr(record, item.name) for item in fields(record)}
    return {name: values for name, values in named.items() if isinstance(values, np.ndarray)}


@dataclass(frozen=True, eq=False, slots=True)
class Log:
    """N consecutive samples of one file; a long file is a sequence of these."""

    origin: str  # the file's name as the user knows it
    rows: Counts  # (N,) row of each sample as an editor counts lines of the file (header is row 1)
    time: Floats  # (N,) s, strictly rising within a file
    position: Floats  # (N, J) rad or m
    velocity: Floats | None  # (N, J) rad/s or m/s, NaN in samples without it; None where the file has none
    current: Floats  # (N, J) A; NaN in samples without it, and a whole column where the log lacks that joint
    temperature: Floats | None = None  # (N, J) degC
    starts_clock: bool = False  # whether the clock starts anew here: samples before belong to another recording
    extra: Floats | None = None  # (N, E) columns that the user asked for besides, in the log's own units
    repeats: Counts | None = None  # (N,) rows left out before each sample, which repeat the sample before them

    def __len__(self) -> int:
        return len(self.time)

    def part(self, index: slice | Counts) -> Self:
        """Some of the samples, by their numbers; a view where these are consecutive and rise."""
        if isinstance(index, np.ndarray) and len(index) and (np.diff(index) == 1).all():
            index = slice(int(index[0]), int(index[-1]) + 1)
        return replace(self, starts_clock=False, **{name: values[index] for name, values in arrays_of(self).items()})

    @classmethod
    def joined(cls, logs: Sequence[Self]) -> Self:
        """Consecutive batches of one file, of the same quantities, as one."""
        if len(logs) == 1:
            return logs[0]
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(log, name) for log in logs]) for name in arrays_of(logs[0])
        }
        return replace(logs[0], **arrays)


@dataclass(frozen=True, eq=False, slots=True)
class Bins:
    """Means over equal spans of time, the form in which effects see a run: of the moving joint, but for the posture."""

    count: Counts  # (M,) samples in each bin
    time: Floats  # (M,) s, on the log's clock
    position: Floats  # (M, J) of all joints, rad or m
    velocity: Floats  # (M,) rad/s or m/s
    acceleration: Floats  # (M,) rad/s2 or m/s2, all zero where a run is at constant speed
    current: Floats  # (M,) A
    variance: Floats  # (M,) A2, of the current inside the bin
    temperature: Floats  # (M,) degC, NaN where not measured
    extra: Floats | None = None  # (M, E) columns `Dataset.extra`, in the log's own units, NaN where not a number
    velocities: Floats | None = None  # (M, J) of all joints, of a block of any motion
    # (M, P) of a block: what each of the rigid body's base parameters asks of the joint
    rigid_body: Floats | None = None
    parts: Floats | None = None  # (M K, 3) of a block: current (A), position, variance (A2) in K parts of each cell

    def __len__(self) -> int:
        return len(self.count)


@dataclass(frozen=True, eq=False, slots=True)
class Run:
    """One joint moving alone in one direction while the others are held; or one joint in a block of any motion."""

    joint: int  # moving joint, from 1
    kind: str  # "constant" (constant speed), "stroke" (from rest to rest) or "block" (any motion of all joints)
    origin: str  # file
    first_row: int  # of the file
    last_row: int
    start: float  # s
    duration: float  # s
    posture: Floats  # (J,) mean position, rad or m; NaN at the moving joint
    span: tuple[float, float]  # first and last position of the moving joint, rad or m
    speed: float  # mean velocity, signed, rad/s or m/s
    ripple: float  # RMS of velocity about its mean, rad/s or m/s; what the measured speed was worth
    temperature: float  # mean of the moving joint, degC, NaN where not measured
    samples: int  # with a current
    bins: Bins
    clock: int = 0  # number of the recording: runs with the same number share one clock
    heldout: bool = False  # whether the plan keeps this run for judging only
    stamp_error: float = 0.0  # RMS by which time stamps are not when samples were taken, s; zero where that is unknown
    band: float = 0.0  # Hz beyond which a filter left nothing of the currents of a block; 0 where cells average as much
    lead: float = 0.0  # rad or m that the joint had travelled since it last stood or turned back; 0 if unknown
    payload: Payload | None = None  # the known load that the last link carried

    @property
    def accelerates(self) -> bool:
        """Whether it is no run at constant speed."""
        return self.kind != CONSTANT

    @property
    def direction(self) -> int:
        """+1 or -1."""
        return 1 if self.speed > 0 else -1

    @property
    def velocity(self) -> Floats:
        """(M, J) of its bins: the moving joint's as measured, zero of those that are held."""
        if self.bins.velocities is not None:
            return self.bins.velocities
        out = np.zeros_like(self.bins.position)
        out[:, self.joint - 1] = self.bins.velocity
        return out


@dataclass(frozen=True, eq=False, slots=True)
class Reject:
    """A stretch of a log that is no run, with the reason.

    `reason` is a slug (``ramp``, ``rest``, ``several-joints`` ...), `text` a sentence with the figures; `joints` those
    that moved; `clock` is as of a `Run`.
    """

    origin: str
    first_row: int
    last_row: int
    start: float
    duration: float
    joints: tuple[int, ...]
    reason: str
    text: str
    samples: int
    clock: int = 0


@dataclass(frozen=True, slots=True)
class FileFacts:
    """One log file: name, SHA-256 of its bytes, rows read, median sampling interval (s), first and last time (s)."""

    name: str
    digest: str
    rows: int
    interval: float
    first_time: float
    last_time: float


@dataclass(frozen=True, eq=False, slots=True)
class Dataset:
    """All that later steps know of the logs.

    `runs` and `rejects` in order of file and time; `notes` what looked suspicious in the files; `extra` names the
    columns of the logs that the bins hold besides.
    """

    runs: tuple[Run, ...]
    rejects: tuple[Reject, ...] = ()
    files: tuple[FileFacts, ...] = ()
    notes: tuple[Note, ...] = ()
    extra: tuple[str, ...] = ()

    def of_joint(self, joint: int) -> tuple[Run, ...]:
        """Runs in which `joint` (from 1) moves."""
        return tuple(run for run in self.runs if run.joint == joint)


#: Kinds of runs.
CONSTANT, STROKE, BLOCK = "constant", "stroke", "block"

#: What a damaged archive makes of zip and numpy.
_DAMAGES: tuple[type[Exception], ...] = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError, TypeError),
    *(ValueError, zipfile.BadZipFile, zlib.error),
)


def save_dataset(sink: BinaryIO, dataset: Dataset, made_from: Mapping[str, Any]) -> None:
    """Write a dataset as plain numpy arrays (npz, nothing pickled).

    Each field of the bins is one array over all bins; everything else is JSON, in the array `about`. `made_from` says
    what the dataset depends on, as JSON can hold it; `load_dataset` returns it.
    """
    binned = [arrays_of(run.bins) for run in dataset.runs]
    facts = [{item.name: getattr(run, item.name) for item in fields(run)} for run in dataset.runs]
    lengths = [{name: len(values) for name, values in arrays.items()} for arrays in binned]
    about = {
        "made_from": made_from,
        "extra": dataset.extra,
        **{name: [asdict(item) for item in getattr(dataset, name)] for name in ("rejects", "files", "notes")},
        "runs": [values | {"bins": bins} for values, bins in zip(facts, lengths, strict=True)],
    }
    names = dict.fromkeys(name for arrays in binned for name in arrays)
    arrays = {name: np.concatenate([arrays[name] for arrays in binned if name in arrays]) for name in names}
    text = json.dumps(about, default=np.ndarray.tolist).encode()
    np.savez(sink, about=np.frombuffer(text, np.uint8), **arrays)  # type: ignore[arg-type]


def load_dataset(path: Path) -> tuple[Dataset, dict[str, Any]]:
    """Read what `save_dataset` wrote, to the bit: the dataset, and what it was made from.

    Raises
    ------
    ValueError
        It is no such file, or damaged.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = dict(archive)
        about = json.loads(arrays.pop("about").tobytes())
        runs = []
        for values in about["runs"]:
            bins = {}
            for name, length in values["bins"].items():
                bins[name], arrays[name] = np.split(arrays[name], [length])
            payload = values["payload"] and tuple(values["payload"])
            more = {"posture": np.array(values["posture"]), "span": tuple(values["span"]), "payload": payload}
            runs.append(Run(**values | more | {"bins": Bins(**bins)}))
        rejects = [Reject(**values | {"joints": tuple(values["joints"])}) for values in about["rejects"]]
        files = tuple(FileFacts(**facts) for facts in about["files"])
        notes = tuple(Note(note["slug"], note["text"], Where(**note["where"])) for note in about["notes"])
        return Dataset(tuple(runs), tuple(rejects), files, notes, tuple(about["extra"])), about["made_from"]
    except _DAMAGES as error:
        raise ValueError(f"it cannot be read ({type(error).__name__})") from error


def with_payloads(dataset: Dataset, payloads: Mapping[str, Payload]) -> Dataset:
    """Runs with the known loads of their files, by names or patterns of these; a note tells which fit no file."""
    files = {*(facts.name for facts in dataset.files), *(run.origin for run in dataset.runs)}
    names = {name: [key for key in payloads if fnmatch(Path(name).name, key)] for name in files}
    carried = {name: payloads[keys[-1]] for name, keys in names.items() if keys}
    runs = tuple(replace(run, payload=carried.get(run.origin, run.payload)) for run in dataset.runs)
    idle = sorted({*payloads}.difference(*names.values()))
    text = f"the recipe states a payload for {listed(idle)}, and none of these logs is called so; is the name right?"
    return replace(dataset, runs=runs, notes=(*dataset.notes, *([Note("payload-unused", text)] * bool(idle))))


def coarser(bins: Bins, size: int) -> Bins:
    """The same in at most `size` bins, without parts of these."""
    bins = replace(bins, parts=None)
    if len(bins) <= size:
        return bins
    # In a block friction changes its sign.
    turns = np.flatnonzero(np.diff(np.sign(bins.velocity)) * (bins.rigid_body is not None)) + 1
    starts, arrays = np.union1d(spans(bins.time, max(size - len(turns), 1))[0], turns), arrays_of(bins)
    means = finite_means(np.column_stack(list(arrays.values())), starts, bins.count)
    ends = np.cumsum([values.size // len(bins) for values in arrays.values()])[:-1]
    columns: dict[str, Any] = dict(zip(arrays, np.split(means, ends, axis=1), strict=True))
    columns = {name: values.reshape(-1, *arrays[name].shape[1:]) for name, values in columns.items()}
    spread = bins.current - np.repeat(columns["current"], np.diff(starts, append=len(bins)))
    if bins.rigid_body is not None:
        spread = _unexplained(bins, spread, starts)
    columns["variance"] += finite_means(spread**2, starts, bins.count)
    return Bins(**columns | {"count": np.add.reduceat(bins.count, starts)})


def finer(bins: Bins, joint: int) -> Bins:
    """A block in its cells' parts, its motion that of polynomials of which the cells' window makes five cells each."""
    parts = np.asarray(bins.parts)
    k, place, steps = len(parts) // len(bins), np.arange(len(bins)), np.diff(bins.time)
    number = np.cumsum(np.append(0, steps > 1.5 * steps.min(initial=np.inf)))  # of what no gap parts
    first, end = np.searchsorted(number, number), np.searchsorted(number, number, side="right")
    size = np.minimum(end - first, 5)
    start = np.clip(place - size // 2, first, end - size)
    at, shares = (place - start)[:, None] + (np.arange(k) + 0.5) / k - 0.5, np.zeros((len(bins), k, 5))
    for n in range(1, 6):
        cells = _moments(np.arange(float(n)), 1.0, 3)[:, :n]
        shares[size == n, :, :n] = _moments(at[size == n], 1.0 / k)[..., :n] @ np.linalg.inv(cells)
    around = np.clip(start[:, None] + np.arange(5), 0, place[-1])
    columns: dict[str, Any] = {
        name: np.repeat(values, k, axis=0)
        if name in ("temperature", "extra")
        else np.einsum("mkn,mn...->mk...", shares, values[around]).reshape(-1, *values.shape[1:])
        for name, values in arrays_of(replace(bins, parts=None)).items()
    }
    columns["current"], columns["position"][:, joint - 1], columns["variance"] = parts.T
    return Bins(**columns | {"count": columns["count"] / k})


def _moments(x: Floats, width: float, rounds: int = 1) -> Floats:
    """(..., 5) means of the powers 0 to 4 over windows about (...,) x: of `rounds` means over `width`."""
    v, fourth = rounds * width**2 / 12.0, rounds * (rounds / 48.0 - 1.0 / 120.0) * width**4
    return np.stack([x**0, x, x**2 + v, x**3 + 3.0 * x * v, x**4 + 6.0 * x**2 * v + fourth], axis=-1)


def _unexplained(bins: Bins, spread: Floats, starts: Counts) -> Floats:
    """(N,) A of a block's current about the means from each start on that no motion of its rigid body and friction
    explains, in size as before the regression took its share; nothing where that leaves no freedom.
    """
    assert bins.rigid_body is not None
    columns = np.column_stack([bins.rigid_body, bins.velocity, np.sign(bins.velocity)])
    columns -= np.repeat(finite_means(columns, starts, bins.count), np.diff(starts, append=len(bins)), axis=0)
    basis, count = np.linalg.qr(columns[:, columns.any(axis=0)])[0], len(bins) - len(starts)
    free = max(count - basis.shape[1], 0)
    return np.asarray((spread - basis @ (basis.T @ spread)) * np.sqrt(count / free) if free else 0.0 * spread)


def spans(time: Floats, size: int) -> tuple[Counts, Counts]:
    """Where at most `size` equal spans of (N,) rising times begin, empty ones left out, and how many each holds."""
    starts = np.arange(len(time))
    if len(time) > size:
        starts = np.unique(np.searchsorted(time, time[0] + np.arange(size) * ((time[-1] - time[0]) / size)))
    return starts, np.diff(starts, append=len(time))


def finite_means(values: Floats, starts: Counts, count: Counts | None = None) -> Floats:
    """(M,) or (M, E) means of the numbers from each start on, weighted by `count`; NaN where there are none."""
    good = np.isfinite(values)
    if count is None and good.all():
        return np.asarray((np.add.reduceat(values, starts, axis=0).T / np.diff(starts, append=len(values))).T)
    weights = np.ones(len(values), np.int64) if count is None else count
    weight = good * (weights if values.ndim == 1 else weights[:, None])
    total = np.add.reduceat(weight, starts, axis=0)
    sums = np.add.reduceat(np.where(good, values, 0.0) * weight, starts, axis=0)
    return np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)


def first_motions(runs: Iterable[Run]) -> FirstMotions:
    """When joints first moved, by all runs, held-out ones too; the arm's own time goes on from log to log."""
    chosen, past = list(runs), 0.0
    starts = [((joint, run.clock), run.start) for run in chosen for joint in (0, run.joint)]
    out = dict(sorted(starts, key=itemgetter(1), reverse=True))  # of equal keys the last one stays: the earliest
    for clock in sorted({run.clock for run in chosen}):
        last = max(run.start + run.duration for run in chosen if run.clock == clock)
        out[0, clock], past = out[0, clock] - past, past + last - out[0, clock]
    return out
