"""Any motion in cells: currents and every column of the rigid body through one filter; blocks of cells as runs."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pumaid.dataset import BLOCK, Bins, Log, Run, finite_means
from pumaid.maths import Counts, Floats
from pumaid.preprocessing.binning import Piece, Stretch, position_noise
from pumaid.rigid_body import RigidBody

#: Samples whose regressor is made at once.
CHUNK = 2048
#: Means over one cell, one after another: their impulse response is a quadratic B-spline, three cells long.
ROUNDS = 3
#: s; shortest and longest cell: currents hold little beyond 20 Hz that bodies cause, motion of arms little beyond 5 Hz.
SHORTEST, LONGEST = 0.024, 0.12
#: Noise of a cell's acceleration, as a share of the joint's RMS acceleration, that encoders may leave. Its square is
#: the share by which inertia comes out too small, itself the error that thousands of cells average to.
ACCELERATION_NOISE = 0.005
#: rad/s or m/s, below which a joint may stick: cells that hold a slower sample of it say nothing of its current.
STICKING = 0.05
#: Share of the steps' mean by which sampling may be uneven; beyond it positions are interpolated.
UNEVEN = 1e-3


#: Blocks that a motion is cut into, and s that one lasts at least and about at most: long against the noise's memory.
BLOCKS, SHORTEST_BLOCK, LONGEST_BLOCK = 12, 2.0, 6.0
#: Cells of a joint in a block from which they say anything.
FEWEST_CELLS = 8


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """M cells of a block, one every `step` s: means over a window of three cells, of what was sampled or follows of it.

    `time` (M,) s; `position`, `velocity`, `acceleration` and `current` (M, J), the current NaN where the joint may
    stick or where one was not measured; `columns` of each joint are (M, p): A per unit of each parameter it feels.
    """

    step: float
    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    current: Floats
    columns: tuple[Floats, ...]


def cell_length(time: Floats, position: Floats, noise: Floats) -> float:
    """s; the shortest cell in which accelerations are known, from (N,) times, (N, J) positions and their noise (J,).

    Source: the noise of second differences that pass three means over T, sigma sqrt(6 dt / T) / T^2.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    width = max(round(SHORTEST / step), 1)
    smooth = _filtered(position.T - position[:1].T, width)
    rates = np.sqrt(np.mean(np.diff(smooth, 2, axis=1) ** 2, axis=1)) / (width * step) ** 2
    wanted = ACCELERATION_NOISE * np.maximum(rates, 1e-12)
    lengths = (noise * math.sqrt(6.0 * step) / wanted) ** 0.4
    moving = rates > 1e-3 * rates.max(initial=0.0)
    return float(np.clip(lengths[moving].max(initial=0.0), max(SHORTEST, step), LONGEST))


def cells(time: Floats, position: Floats, current: Floats, *, body: RigidBody, length: float) -> Cells | None:
    """A block of (N,) times, (N, J) positions and currents in cells of some `length` (s); None where it is too short.

    Velocities and accelerations are plain central differences: the one filter smooths them, products of them, and the
    current alike, so that least squares returns the truth whatever the motion.

    Source: M. Gautier, ICRA 1997 (parallel filtering), with differences inside the filter.
    """
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    if len(time) < 3 or step <= 0.0:
        return None
    even = time[0] + step * np.arange(len(time))
    if np.abs(np.diff(time) - step).max() > UNEVEN * step:
        position = np.column_stack([np.interp(even, time, column) for column in position.T])
        current = np.column_stack([np.interp(even, time, column) for column in current.T])
    width = max(round(length / step), 1)
    if len(time) - 2 < 4 * width:
        return None
    q = np.ascontiguousarray(position.T)
    rate = (q[:, 2:] - q[:, :-2]) / (2.0 * step)
    acceleration = (q[:, 2:] - 2.0 * q[:, 1:-1] + q[:, :-2]) / step**2
    inner = q[:, 1:-1]
    sampled = np.where(np.abs(rate) < STICKING, np.nan, current.T[:, 1:-1])
    motion = np.concatenate([even[None, 1:-1] - even[0], inner, rate, acceleration])
    middle = _filtered(motion, width).T
    position, velocity, curve = np.split(middle[:, 1:], 3, axis=1)
    parts: list[list[Floats]] = []
    size = max(CHUNK // width, 1) * width
    for first in range(0, inner.shape[1], size):
        part = slice(first, first + size)
        rows = body.rows(inner[:, part], rate[:, part], acceleration[:, part])
        parts.append([_weighted(columns, width) for columns in rows])
    columns = tuple(_summed(np.concatenate(part, axis=1)).T for part in zip(*parts, strict=True))
    drawn = _filtered(np.nan_to_num(sampled), width)
    drawn[_filtered(np.isnan(sampled).astype(float), width) > 1e-9] = np.nan
    return Cells(width * step, even[0] + middle[:, 0], position, velocity, curve, drawn.T, columns)


def _filtered(values: Floats, width: int) -> Floats:
    """(K, M) of (K, N): means over `width` samples, `ROUNDS` times one after another, every `width`-th of them."""
    return _summed(_weighted(values, width))


def _weighted(values: Floats, width: int) -> Floats:
    """(K, N // width, ROUNDS) sums over cells of (K, N) values, by their weights in each mean that they enter."""
    mean = np.full(width, 1.0 / width)
    kernel = np.convolve(np.convolve(mean, mean), mean)
    weights = np.pad(kernel, (1, 1)).reshape(ROUNDS, width)
    count = values.shape[1] // width
    return values[:, : count * width].reshape(len(values), count, width) @ weights.T


def _summed(weighted: Floats) -> Floats:
    """(K, M) means over cells and their neighbours."""
    count = weighted.shape[1] - ROUNDS + 1
    return np.sum([weighted[:, k : k + count, k] for k in range(ROUNDS)], axis=0)


def block_runs(
    stretch: Stretch, piece: Piece, body: RigidBody, *, clock: int, length: float | None = None
) -> list[Run]:
    """A piece of any motion as blocks, each a run of every joint that moves and draws current in it.

    `length` (s) is that of a cell, where not as the encoder needs.
    """
    part = slice(piece.start, piece.stop)
    log, time = stretch.log.part(part), stretch.time[part]
    current = np.where(np.nan_to_num(log.current).any(axis=0), log.current, np.nan)
    noise = np.array([position_noise(column) for column in log.position.T])
    length = length or cell_length(time, log.position, noise)
    table = cells(time, log.position, current, body=body, length=length)
    if table is None:
        return []
    duration = float(time[-1] - time[0])
    count = max(round(duration / min(max(duration / BLOCKS, SHORTEST_BLOCK), LONGEST_BLOCK)), 1)
    edges = np.linspace(time[0], time[-1], count + 1)
    ends = np.searchsorted(table.time, edges[1:-1])
    sample = np.clip(np.searchsorted(time, edges), 0, len(time) - 1)
    runs = []
    for number, rows in enumerate(np.split(np.arange(len(table.time)), ends)):
        whole = (int(sample[number]), int(sample[number + 1]))
        for joint in range(1, log.position.shape[1] + 1):
            chosen = rows[np.isfinite(table.current[rows, joint - 1])]
            if len(chosen) >= FEWEST_CELLS:
                run = _run(log, time, table, joint=joint, rows=chosen, samples=whole, clock=clock)
                runs.append(replace(run, stamp_error=stretch.stamp_error))
    return runs


def _run(
    log: Log, time: Floats, table: Cells, *, joint: int, rows: Counts, samples: tuple[int, int], clock: int
) -> Run:
    """Some cells of one joint, of the block's `samples`, as a run."""
    moving, (first, last) = joint - 1, samples
    width = max(round(table.step * (len(time) - 1) / float(time[-1] - time[0])), 1)
    starts = np.searchsorted(time, table.time[rows] - 0.5 * table.step)
    inside = np.clip(starts[:, None] + np.arange(width), 0, len(time) - 1)
    beside = np.clip(np.searchsorted(time, table.time[rows]), 0, len(time) - 1)
    sampled, place = np.nan_to_num(log.current[inside, moving]), np.arange(width) - 0.5 * (width - 1)
    slope = sampled @ place / max(float(place @ place), 1.0)
    position, velocity, n_columns = table.position[rows], table.velocity[rows], table.columns[0].shape[1]
    posture = position.mean(axis=0)
    posture[moving] = np.nan
    warmth = np.full(len(rows), np.nan) if log.temperature is None else log.temperature[beside, moving]
    bins = Bins(
        count=np.full(len(rows), width),
        time=table.time[rows],
        position=position,
        velocity=velocity[:, moving],
        acceleration=table.acceleration[rows, moving],
        current=table.current[rows, moving],
        variance=(sampled - slope[:, None] * place).var(axis=1),  # about a straight line
        temperature=warmth,
        extra=None if log.extra is None else log.extra[beside],
        velocities=velocity,
        rigid_body=np.pad(table.columns[moving][rows], ((0, 0), (n_columns - table.columns[moving].shape[1], 0))),
    )
    return Run(
        joint=joint,
        kind=BLOCK,
        origin=log.origin,
        first_row=int(log.rows[first]),
        last_row=int(log.rows[last]),
        start=float(log.time[first]),
        duration=float(log.time[last] - log.time[first]),
        posture=posture,
        span=(float(position[:, moving].min()), float(position[:, moving].max())),
        speed=float(np.sqrt(np.mean(velocity[:, moving] ** 2))),
        ripple=float(np.std(velocity[:, moving])),
        temperature=float(finite_means(warmth, np.zeros(1, np.int64))[0]),
        samples=width * len(rows),
        bins=bins,
        clock=clock,
    )
