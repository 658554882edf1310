"""What one pass over the logs leaves of them: runs with their bins, what was left out, and the files' facts."""

from __future__ import annotations

import hashlib
import json
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, Where

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Log:
    """N consecutive samples of one file; a long file is a sequence of these.

    Attributes
    ----------
    origin
        The file's name as the user knows it.
    rows
        (N,) row of each sample as an editor counts lines of the file (header is row 1).
    time
        (N,) s, strictly rising within a file.
    position, velocity
        (N, J) rad or m and rad/s or m/s; `velocity` is None where the file has none, and NaN in samples without it.
    current
        (N, J) A; NaN in samples without it, and a whole column where the log lacks that joint.
    temperature
        (N, J) degC, or None.
    extra
        (N, E) columns that the user asked for besides, in the log's own units, NaN where not a number; or None.
    starts_clock
        Whether the clock starts anew here: samples before belong to another recording.
    """

    origin: str
    rows: NDArray[np.int64]
    time: Floats
    position: Floats
    velocity: Floats | None
    current: Floats
    temperature: Floats | None = None
    starts_clock: bool = False
    extra: Floats | None = None

    def __post_init__(self) -> None:
        n_samples, n_joints = self.position.shape
        for name in ("velocity", "current", "temperature"):
            values = getattr(self, name)
            if values is not None and values.shape != (n_samples, n_joints):
                raise ValueError(f"{name} is {values.shape}, position is {(n_samples, n_joints)}")
        if self.extra is not None and len(self.extra) != n_samples:
            raise ValueError(f"extra has {len(self.extra)} rows for {n_samples} samples")
        if self.time.shape != (n_samples,) or self.rows.shape != (n_samples,):
            raise ValueError(f"time is {self.time.shape} and rows {self.rows.shape} for {n_samples} samples")

    def __len__(self) -> int:
        return len(self.time)

    def part(self, index: slice | NDArray[np.int64]) -> Log:
        """Some of the samples, by their numbers."""

        def of(values: Floats | None) -> Floats | None:
            return None if values is None else values[index]

        return replace(
            self,
            rows=self.rows[index],
            time=self.time[index],
            position=self.position[index],
            velocity=of(self.velocity),
            current=self.current[index],
            temperature=of(self.temperature),
            extra=of(self.extra),
            starts_clock=False,
        )

    @classmethod
    def joined(cls, logs: Sequence[Log]) -> Log:
        """Consecutive batches of one file as one; a quantity that some of them lack is NaN there."""
        if len(logs) == 1:
            return logs[0]

        def together(name: str) -> Any:
            values = [getattr(log, name) for log in logs]
            width = next((value.shape[1:] for value in values if value is not None), None)
            if width is None:
                return None
            nothing = (np.full((len(log), *width), np.nan) for log in logs)
            return np.concatenate([n if v is None else v for n, v in zip(nothing, values, strict=True)])

        names = ("rows", "time", "position", "velocity", "current", "temperature", "extra")
        return replace(logs[0], **{name: together(name) for name in names})


Counts = NDArray[np.int64]
Kept = TypeVar("Kept", "Bins", "Means")


@dataclass(frozen=True, eq=False, slots=True)
class Bins:
    """Means over equal spans of time, the form in which effects see a run: of the moving joint, but for the posture.

    Attributes
    ----------
    count
        (M,) samples in each bin.
    time
        (M,) s, on the log's clock.
    position
        (M, J) of all joints, rad or m.
    velocity, acceleration
        (M,) rad/s or m/s, and per s more (all zero where a run is at constant speed).
    current, variance
        (M,) A, and A2 inside the bin.
    temperature
        (M,) degC, NaN where not measured.
    extra
        (M, E) means of the columns `Dataset.extra`, in the log's own units, NaN where not a number; None without.
    """

    count: NDArray[np.int64]
    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    current: Floats
    variance: Floats
    temperature: Floats
    extra: Floats | None = None

    def __len__(self) -> int:
        return len(self.count)


@dataclass(frozen=True, eq=False, slots=True)
class Means:
    """Means over equal spans of time of all joints, any of which may move: (M,) samples and time (s), (M, J) others.

    `position` is in rad or m, `velocity` in rad/s or m/s, `current` in A, NaN where not measured.
    """

    count: NDArray[np.int64]
    time: Floats
    position: Floats
    velocity: Floats
    current: Floats

    def __len__(self) -> int:
        return len(self.count)


@dataclass(frozen=True, eq=False, slots=True)
class Run:
    """One joint moving alone in one direction while the others are held.

    Attributes
    ----------
    joint
        Moving joint, from 1.
    kind
        ``"constant"`` (constant speed) or ``"stroke"`` (from rest to rest; carries an inertia term).
    origin, first_row, last_row
        File and first and last row of it.
    start, duration
        s.
    posture
        (J,) mean position, rad or m; NaN at the moving joint.
    span
        First and last position of the moving joint, rad or m.
    speed
        Mean velocity, signed, rad/s or m/s.
    ripple
        RMS of velocity about its mean (constant) in the same unit; what the measured speed was worth.
    temperature
        Mean of the moving joint, degC, NaN where not measured.
    samples
        Samples with a current.
    bins
        The run in at most a few hundred means.
    clock
        Number of the recording: runs with the same number share one clock.
    heldout
        Whether the plan keeps this run for judging only.
    stamp_error
        RMS (s) by which time stamps are not when samples were taken; zero where they are, or where no motion tells.
    """

    joint: int
    kind: str
    origin: str
    first_row: int
    last_row: int
    start: float
    duration: float
    posture: Floats
    span: tuple[float, float]
    speed: float
    ripple: float
    temperature: float
    samples: int
    bins: Bins
    clock: int = 0
    heldout: bool = False
    stamp_error: float = 0.0

    @property
    def direction(self) -> int:
        """+1 or -1."""
        return 1 if self.speed > 0 else -1

    @property
    def velocity(self) -> Floats:
        """(M, J) of its bins: the moving joint's as measured, zero of those that are held."""
        out = np.zeros_like(self.bins.position)
        out[:, self.joint - 1] = self.bins.velocity
        return out


@dataclass(frozen=True, eq=False, slots=True)
class Reject:
    """A stretch of a log that is no run, with the reason.

    `reason` is a slug (``ramp``, ``rest``, ``several-joints`` ...), `text` a sentence with the figures; `joints` those
    that moved. `bins` are kept where something moved, so that a model can be compared there too; `clock` is as of a
    `Run`.
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
    bins: Means | None = None
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


#: What a damaged archive makes of zip and numpy, besides a ValueError.
_DAMAGES: tuple[type[Exception], ...] = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError, TypeError),
    *(zipfile.BadZipFile, zlib.error),
)


def save_dataset(sink: BinaryIO, dataset: Dataset, made_from: Mapping[str, Any]) -> None:
    """Write a dataset as plain numpy arrays (npz, nothing pickled).

    Each field of runs and rejects is an array over all of them, each field of their bins one over all bins.

    Parameters
    ----------
    sink
        Binary, opened for writing.
    dataset
        What is written.
    made_from
        What it depends on, as JSON can hold it; `load_dataset` returns it.
    """
    about = {
        "made_from": made_from,
        "files": [asdict(facts) for facts in dataset.files],
        "notes": [{"slug": note.slug, "text": note.text, "where": asdict(note.where)} for note in dataset.notes],
        "extra": dataset.extra,
    }
    arrays = {"about": np.array(json.dumps(about))}
    arrays |= _as_arrays("runs", dataset.runs, Bins) | _as_arrays("rejects", dataset.rejects, Means)
    np.savez(sink, digest=_digest(arrays), **arrays)  # type: ignore[arg-type]


def load_dataset(path: Path) -> tuple[Dataset, dict[str, Any]]:
    """Read what `save_dataset` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    dataset, made_from
        As they were saved, to the bit.

    Raises
    ------
    ValueError
        It is no such file, or not as it was written.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            arrays = dict(archive)
        if not np.array_equal(arrays.pop("digest"), _digest(arrays)):
            raise ValueError("its content is not what was written")
        about = json.loads(str(arrays["about"]))
        runs = tuple(Run(**values) for values in _as_values("runs", arrays, Bins))
        rejects = tuple(Reject(**values) for values in _as_values("rejects", arrays, Means))
        files = tuple(FileFacts(**facts) for facts in about["files"])
        notes = tuple(Note(note["slug"], note["text"], Where(**note["where"])) for note in about["notes"])
        return Dataset(runs, rejects, files, notes, tuple(about["extra"])), about["made_from"]
    except ValueError:
        raise
    except _DAMAGES as error:
        raise ValueError(f"it cannot be read ({type(error).__name__})") from error


def _digest(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
    """(32,) SHA-256 over names, types, shapes and content."""
    whole = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        whole.update(f"{name} {values.dtype} {values.shape} ".encode())
        whole.update(values.tobytes())
    return np.frombuffer(whole.digest(), dtype=np.uint8)


def _as_arrays(name: str, records: Sequence[Run | Reject], kind: type[Bins | Means]) -> dict[str, Any]:
    """Field -> array over all records or bins; `bins` holds how many each record has, -1 where it has none."""
    arrays: dict[str, Any] = {}
    for item in fields(records[0]) if records else ():
        values = [getattr(record, item.name) for record in records]
        if item.name == "bins":
            arrays[f"{name}.bins"] = np.array([-1 if bins is None else len(bins) for bins in values])
            columns = {
                part.name: [getattr(bins, part.name) for bins in values if bins is not None] for part in fields(kind)
            }
            arrays |= {
                f"{name}.bins.{part}": np.concatenate(column)
                for part, column in columns.items()
                if column and column[0] is not None
            }
        elif item.name == "joints":
            arrays[f"{name}.joints"] = np.array([" ".join(map(str, joints)) for joints in values])
        else:
            arrays[f"{name}.{item.name}"] = np.array(values)
    return arrays


def _as_values(name: str, arrays: Mapping[str, NDArray[Any]], kind: type[Bins | Means]) -> Iterator[dict[str, Any]]:
    """Field -> value of each record, one after the other."""
    if f"{name}.bins" not in arrays:
        return
    plain = {key.removeprefix(f"{name}."): values for key, values in arrays.items() if key.startswith(f"{name}.")}
    columns = {key.removeprefix("bins."): plain.pop(key) for key in list(plain) if key.startswith("bins.")}
    counts = plain.pop("bins").tolist()
    lists = {key: list(values) if key == "posture" else values.tolist() for key, values in plain.items()}
    first = 0
    for number, count in enumerate(counts):
        record = {key: values[number] for key, values in lists.items()}
        bins = {key: values[first : first + count] for key, values in columns.items()}
        record["bins"] = kind(**bins) if count >= 0 else None
        first += max(count, 0)
        if name == "runs":
            record["span"] = tuple(record["span"])
        else:
            record["joints"] = tuple(map(int, record["joints"].split()))
        yield record


def coarser(parts: list[Kept], most: int) -> Kept:
    """The bins of consecutive pieces as one set of at most `most`."""
    whole = parts[0] if len(parts) == 1 else _together(parts)
    if len(whole) <= most:
        return whole
    count, starts = whole.count, spans(whole.time, most)
    total = np.add.reduceat(count, starts)
    names = [item.name for item in fields(whole) if item.name not in ("count", "extra")]
    given = [getattr(whole, name) for name in names]
    # All columns at once: each call of numpy costs as much as the sums of one of them.
    table = np.concatenate([values.T if values.ndim > 1 else values[None] for values in given])
    means = np.add.reduceat(table * count, starts, axis=1) / total
    borders = accumulate((values.shape[1] if values.ndim > 1 else 1 for values in given), initial=0)
    found: dict[str, Any] = {
        name: np.ascontiguousarray(means[low:high].T) if values.ndim > 1 else means[low]
        for name, values, (low, high) in zip(names, given, pairwise(borders), strict=True)
    }
    if isinstance(whole, Bins):
        spread = whole.current - np.repeat(found["current"], np.diff(starts, append=len(count)))
        found["variance"] = found["variance"] + np.add.reduceat(spread * spread * count, starts) / total
        if whole.extra is not None:
            found["extra"] = _known_mean(whole.extra, starts, count)
    return type(whole)(**found, count=total)


def _together(parts: list[Kept]) -> Kept:
    """Consecutive bins as one set."""
    columns = ([getattr(part, item.name) for part in parts] for item in fields(parts[0]))
    joined: list[Any] = [None if any(one is None for one in column) else np.concatenate(column) for column in columns]
    return type(parts[0])(*joined)


def spans(time: Floats, most: int) -> Counts:
    """Where at most `most` equal spans of (M,) rising times begin, those without an instant left out."""
    borders = time[0] + np.arange(most) * ((time[-1] - time[0]) / most)
    return _each_once(np.searchsorted(time, borders))


def _each_once(rising: Counts) -> Counts:
    """Rising numbers without repeats."""
    return rising[np.append(True, rising[1:] != rising[:-1])]


def _known_mean(values: Floats, starts: Counts, count: Counts) -> Floats:
    """(M, E) means of bins of `count` samples each, those without a number left out."""
    weight = np.where(np.isfinite(values), count[:, None], 0)
    total = np.add.reduceat(weight, starts, axis=0)
    sums = np.add.reduceat(np.nan_to_num(values) * weight, starts, axis=0)
    return np.divide(sums, total, out=np.full(sums.shape, np.nan), where=total > 0)


@dataclass(frozen=True, slots=True)
class Campaign:
    """What only all runs together tell.

    Attributes
    ----------
    begun
        (joint from 1, or 0 for the whole arm; clock) -> s on that clock at which it first moved.
    leads
        (file, first row) of a run -> rad or m that its joint had travelled before, while it sped up.
    """

    begun: Mapping[tuple[int, int], float] = field(default_factory=dict)
    leads: Mapping[tuple[str, int], float] = field(default_factory=dict)

    @classmethod
    def of(cls, runs: Iterable[Run], rejects: Iterable[Reject] = ()) -> Campaign:
        """Of all runs of the logs, held-out ones too, and of what is no run."""
        runs = tuple(runs)
        begun: dict[tuple[int, int], float] = {}
        for run in runs:
            for key in ((run.joint, run.clock), (0, run.clock)):
                begun[key] = min(run.start, begun.get(key, run.start))
        before = {(reject.origin, reject.last_row + 1): reject for reject in rejects}
        ramps = [(run, before.get((run.origin, run.first_row))) for run in runs]
        leads = {(run.origin, run.first_row): _lead(run, ramp) for run, ramp in ramps if ramp is not None}
        return cls(begun, leads)

    def since(self, joint: int, clock: int, time: Floats) -> Floats:
        """(M,) s since `joint` (0: any joint) first moved, at (M,) s on a clock; as they are where it never did."""
        return time - self.begun.get((joint, clock), 0.0)

    def lead(self, run: Run) -> float:
        """What the joint had travelled (rad or m) since it last stood or turned back when `run` began; 0 if unknown."""
        return self.leads.get((run.origin, run.first_row), 0.0)


def _lead(run: Run, ramp: Reject) -> float:
    """From the farthest that a ramp reaches back."""
    if ramp.joints != (run.joint,) or ramp.bins is None:
        return 0.0
    back = run.direction * (run.span[0] - ramp.bins.position[:, run.joint - 1])
    return max(float(back.max()), 0.0)
