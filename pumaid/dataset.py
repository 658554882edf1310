"""What one pass over the logs leaves of them: runs with triangle and bins, what was left out, and the files' facts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note
from pumaid.maths.triangle import Triangle

Floats = NDArray[np.float64]

#: Regressors of a run's triangle: at constant speed, and for a stroke from rest to rest.
CONSTANT_COLUMNS = ("cos", "sin", "one")
STROKE_COLUMNS = ("cos", "sin", "one", "velocity", "acceleration")


def run_columns(position: Floats, *, turns: bool, motion: tuple[Floats, Floats] | None = None) -> Floats:
    """What the columns of a run's triangle are at some instants.

    Parameters
    ----------
    position
        (N,) of the moving joint, rad or m.
    turns
        Whether it is revolute: of a prismatic joint's position weight knows nothing.
    motion
        (N,) velocity and (N,) acceleration, where there are strokes.

    Returns
    -------
    columns
        (N, 3) over `CONSTANT_COLUMNS`, or (N, 5) over `STROKE_COLUMNS`.
    """
    columns = np.zeros((3 if motion is None else 5, len(position)))
    if turns:
        np.cos(position, out=columns[0])
        np.sin(position, out=columns[1])
    columns[2] = 1.0
    if motion is not None:
        columns[3:] = motion
    return columns.T


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
    triangle
        Over `CONSTANT_COLUMNS` or `STROKE_COLUMNS`, target the moving joint's current; cos and sin of the measured
        position (rad); of a prismatic joint cos and sin are zero columns.
    bins
        The run in at most a few hundred means.
    clock
        Number of the recording: runs with the same number share one clock.
    heldout
        Whether the plan keeps this run for judging only.
    last_origin
        File of `last_row` where a run goes on into another file, else empty.
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
    triangle: Triangle
    bins: Bins
    clock: int = 0
    heldout: bool = False
    last_origin: str = ""
    stamp_error: float = 0.0

    @property
    def samples(self) -> int:
        """Samples absorbed."""
        return self.triangle.count

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
    that moved. `bins` are kept where something moved, so that a model can be compared there too. `last_origin` is the
    file of `last_row` where that is another one, else empty; `clock` is as of a `Run`.
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
    last_origin: str = ""
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
