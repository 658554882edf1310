"""Parallel filtering: motion, currents and every column of the rigid body pass one filter, of a stroke or in cells."""

import math
from dataclasses import dataclass

import numpy as np

from pumaid.dataset import Bins, Log, finite_means, spans
from pumaid.maths import Floats
from pumaid.preprocessing.differentiate import averaging_kernel, cubic_window
from pumaid.rigid_body import RigidBody

#: Bins of a stroke at most.
MOST_BINS = 512
#: Position, velocity and acceleration by the step, convolved from five positions; equally blunt: all have the same
#: second moment, a sixth of a squared step.
LEVEL = np.array([0.0, 1.0, 10.0, 1.0, 0.0]) / 12.0
RATE = np.array([-1.0, 14.0, 0.0, -14.0, 1.0]) / 24.0
CURVE = np.array([0.0, 1.0, -2.0, 1.0, 0.0])
#: Samples below which a stroke is not filtered; with some currents missing, averages of fewer leave too few rows.
FEWEST, FEWEST_OF_SOME = 16, 32
#: Mean steps between currents from which there is a hole between two of them.
MOST_APART = 2.5
#: Share of an acceleration's own course, beyond weight and friction, that may be noise: inertia comes out too small by
#: as much, and by tens of times that where the current's noise is slow. Most of a stroke that a filter spans to that
#: end; beyond it the share of noise is taken out, up to a largest one.
MOST_NOISE, MOST_SPANNED, LARGEST_SHARE = 0.003, 1.0 / 6.0, 0.9
#: Samples between which noise is looked for.
LAGS = (1, 2, 3, 5)

#: Samples whose regressor is made at once.
CHUNK = 2048
#: Means over one cell, one after another: their impulse response is a quadratic B-spline, three cells long.
ROUNDS = 3
#: s; shortest and longest cell of a block: currents hold little beyond 20 Hz that bodies cause, motion of arms little
#: beyond 5 Hz. Longest part of one whose current is kept, so that ripples of some 40 Hz are not averaged away.
SHORTEST_CELL, LONGEST_CELL, PART = 0.024, 0.12, 0.012
#: Noise of a cell's acceleration, as a share of the joint's RMS acceleration, that encoders may leave. Its square is
#: the share by which inertia comes out too small, itself the error that thousands of cells average to.
ACCELERATION_NOISE = 0.005
#: rad/s or m/s, below which a joint may stick: cells that hold a slower sample of it say nothing of its current.
STICKING = 0.05
#: Noise of speeds from one sample to the next that is left, as a share of the RMS speed, where it is beyond half of
#: `STICKING`: samples are averaged so far that no more is, but at least so many means are in a cell.
SPEED_NOISE, FEWEST_MEANS = 0.05, 3
#: Share of the power of a current's rate that is left beyond a filter's end; how long a cell is that holds most of what
#: the filter made of a jump, in periods of that end; s, and share of a motion, at most, so that cells are left between
#: two turns.
NEXT_TO_NONE, SMEARED, LONGEST_FILTERED, LONGEST_SHARE = 1e-4, 0.75, 0.15, 0.05
#: Share of the steps' mean by which sampling may be uneven; beyond it positions are interpolated.
UNEVEN = 1e-3


def stroke_bins(log: Log, joint: int, *, time: Floats, window: float) -> Bins | None:
    """Bins of a stroke, its motion and current averaged over the same spans; None where currents are too few.

    `log` holds its N samples, currents that are missing NaN; `time` (N,) s is when they were taken.

    An acceleration from positions that are smoothed is blunt at its corners where the current is not: regressed on
    it, sharp currents make inertia, weight and viscous friction too large. With the average that the acceleration is
    by nature, of all columns and of the current, least squares returns the truth whatever the motion.
    A ripple that is faster than the filter stays in the current; what remains of it counts as scatter inside bins, but
    what follows the motion's corners, which the average takes from motion and current alike.
    `window` (s) is the shortest span of the filter: it grows until accelerations hold next to no noise, which would
    make inertia too small; of what no filter of a short stroke takes out they are calibrated.

    Source
    ------
    M. Gautier, Dynamic identification of robots with power model, ICRA 1997: parallel filtering, here by the kernel
    of A. Savitzky and M. J. E. Golay's second derivative. R. J. Carroll et al., Measurement Error in Nonlinear Models,
    2nd ed. (2006), ch. 3 and 4.
    """
    position, current = log.position[:, joint - 1], log.current[:, joint - 1]
    measured = np.isfinite(current)
    at = time[measured]
    if len(at) < (FEWEST if measured.all() else FEWEST_OF_SOME):
        return None
    # As many instants as there are currents: interpolated ones would be smoother than they are.
    even = np.linspace(at[0], at[-1], len(at))
    step = float(even[1] - even[0])
    kernel = averaging_kernel(min(cubic_window(window, step), len(at) // 4 * 2 + 1))
    q, sampled = np.interp(even, time, position), np.interp(even, at, current[measured])
    level, rate, curve = (np.convolve(kernel, part) for part in (LEVEL, RATE, CURVE))
    rate, curve = rate / step, curve / step**2
    motion = np.column_stack([np.convolve(q, weights, mode="valid") for weights in (level, rate, curve)])
    smoothed = np.convolve(sampled, level, mode="valid")
    inner = slice(len(level) // 2, len(at) - len(level) // 2)
    # What is interpolated across a hole is no row.
    right = np.clip(np.searchsorted(at, even[inner]), 1, len(at) - 1)
    rows = at[right] - at[right - 1] < MOST_APART * step if not measured.all() else np.ones(len(right), np.bool_)
    instants = even[inner][rows]
    filtered = (smoothed + _without_motion(sampled[inner] - smoothed, motion, kernel))[rows]
    starts, count = spans(instants, MOST_BINS)
    means = finite_means(np.column_stack([instants - instants[0], motion[rows], filtered]), starts)
    bin_time, (moving, speed, acceleration, binned) = instants[0] + means[:, 0], means[:, 1:].T
    posture = np.column_stack([np.interp(bin_time, log.time, column) for column in log.position.T])
    posture[:, joint - 1] = moving
    beyond = _residual(acceleration, [np.cos(moving), np.sin(moving), speed])
    share = _noise_share(q, curve, beyond, per_bin=round(len(rows) / len(starts)))
    if share > MOST_NOISE and len(kernel) < MOST_SPANNED * len(at):
        return stroke_bins(log, joint, time=time, window=max(1.25 * window, window + 2.0 * step))
    before = np.clip(np.searchsorted(log.time, bin_time, side="right") - 1, 0, len(log) - 1)
    return Bins(
        count=count,
        time=bin_time,
        position=posture,
        velocity=speed,
        acceleration=acceleration - min(share, LARGEST_SHARE) * beyond,
        current=binned,
        variance=finite_means((filtered - np.repeat(binned, count)) ** 2, starts),
        temperature=np.full(len(starts), np.nan) if log.temperature is None else log.temperature[before, joint - 1],
        extra=None if log.extra is None else log.extra[before],
    )


def _noise_share(position: Floats, curve: Floats, beyond: Floats, *, per_bin: int) -> float:
    """Share of noise in the square of accelerations `beyond` (B,) other columns, means of `per_bin` from positions."""
    weights = np.convolve(curve, np.full(per_bin, 1.0 / per_bin))
    return _variance(position) * float(weights @ weights) * len(beyond) / max(float(beyond @ beyond), 1e-300)


def _without_motion(fast: Floats, motion: Floats, kernel: Floats) -> Floats:
    """(N,) of a current what the filter took out, less what follows the (N, 3) motion and its corners.

    Regressed on weight, friction and inertia it gives nothing: least squares returns what it does of filtered currents.
    """
    position, speed, acceleration = motion.T
    blunter = np.convolve(np.pad(acceleration, len(kernel) // 2, mode="edge"), kernel, mode="valid")
    return _residual(fast, [np.cos(position), np.sin(position), speed, acceleration, blunter])


def _residual(values: Floats, regressors: list[Floats]) -> Floats:
    columns = np.column_stack([np.ones(len(values)), *regressors])
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def position_noise(position: Floats) -> float:
    """Standard deviation of the noise of (N,) positions, an encoder's steps among it."""
    steps = np.abs(np.diff(position))
    quantum = float(steps[steps > 1e-9].min(initial=math.inf)) if (steps > 1e-9).any() else 0.0
    return max(quantum / math.sqrt(12.0), math.sqrt(_variance(position))) if quantum else 0.0


def _variance(position: Floats) -> float:
    """Variance of the noise of (N,) positions, from third differences, in which their course is next to nothing.

    Rounding at a steady speed is a tone, which differences at one lag may enlarge; the least of several lags is taken.
    """
    thirds = (
        position[3 * lag :] - position[: -3 * lag] - 3.0 * (position[2 * lag : -lag] - position[lag : -2 * lag])
        for lag in LAGS
        if len(position) > 3 * lag + 1
    )
    return min((float(np.mean(third**2)) / 20.0 for third in thirds), default=0.0)


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """M cells of a block, one every `step` s: means over a window of three cells, of what was sampled or follows of it.

    `time` (M,) s; `position`, `velocity`, `acceleration` and `current` (M, J), the current NaN where the joint may
    stick or where one was not measured; `columns` of each joint are (M, p): A per unit of each parameter it feels.
    Of the `width` samples of the cell itself are `variance` (M, J) A2 of the current about a straight line, and `parts`
    (J, M, k, 2), means of current and position over k parts.
    """

    step: float
    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    current: Floats
    columns: tuple[Floats, ...]
    variance: Floats
    parts: Floats
    width: int


def cell_length(time: Floats, position: Floats, noise: Floats) -> float:
    """s; the shortest cell in which accelerations are known, from (N,) times, (N, J) positions and their noise (J,).

    Source: the noise of second differences that pass three means over T, sigma sqrt(6 dt / T) / T^2.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    width = max(round(SHORTEST_CELL / step), 1)
    smooth = _filtered(position.T - position[:1].T, width)
    rates = np.sqrt(np.mean(np.diff(smooth, 2, axis=1) ** 2, axis=1)) / (width * step) ** 2
    lengths = (noise * math.sqrt(6.0 * step) / (ACCELERATION_NOISE * np.maximum(rates, 1e-12))) ** 0.4
    moving = rates > 1e-3 * rates.max(initial=0.0)
    return float(np.clip(lengths[moving].max(initial=0.0), max(SHORTEST_CELL, step), LONGEST_CELL))


def cells(time: Floats, position: Floats, current: Floats, *, body: RigidBody, length: float) -> Cells | None:
    """A block of (N,) times, (N, J) positions and currents in cells of some `length` (s); None where it is too short.

    Velocities and accelerations are plain central differences: the one filter smooths them, products of them, and the
    current alike, so that least squares returns the truth whatever the motion. Positions in steps so coarse that these
    would be noise are averaged over some samples first, and currents with them.

    Source: M. Gautier, ICRA 1997 (parallel filtering), with differences inside the filter.
    """
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    if len(time) < 3 or step <= 0.0:
        return None
    even = time[0] + step * np.arange(len(time))
    if np.abs(np.diff(time) - step).max() > UNEVEN * step:
        position = np.column_stack([np.interp(even, time, column) for column in position.T])
        current = np.column_stack([np.interp(even, time, column) for column in current.T])
    raw, lag = current.T, min(max(round(length / step), 1), len(time) - 1)
    speed = np.sqrt(np.mean((position[lag:] - position[:-lag]) ** 2, axis=0)) / (lag * step)
    noise = np.where(speed > STICKING, [position_noise(column) for column in position.T], 0.0)
    wanted = (noise / (math.sqrt(2.0) * step * np.maximum(SPEED_NOISE * speed, 0.5 * STICKING))) ** (2.0 / 3.0)
    averaged = max(min(math.ceil(wanted.max()), int(length / (FEWEST_MEANS * step))), 1)
    groups, step = len(even) // averaged, averaged * step
    even, position, current = (
        part[: groups * averaged].reshape(groups, averaged, *part.shape[1:]).mean(axis=1)
        for part in (even, position, current)
    )
    width = max(round(length / step), 1)
    if groups - 2 < 4 * width:
        return None
    q = np.ascontiguousarray(position.T)
    rate = (q[:, 2:] - q[:, :-2]) / (2.0 * step)
    acceleration = (q[:, 2:] - 2.0 * q[:, 1:-1] + q[:, :-2]) / step**2
    inner = q[:, 1:-1]
    turning = body.robot.shaft_velocity(rate.T).T
    sticks = (np.abs(turning) < STICKING) | (np.gradient(np.sign(turning), axis=1) != 0.0)  # or it turns round between
    sampled = np.where(sticks, np.nan, current.T[:, 1:-1])
    middle = _filtered(np.concatenate([even[None, 1:-1] - even[0], inner, rate, acceleration]), width).T
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
    count, k = inner.shape[1] // width - 2, max(round(width / max(int(PART / step + 1e-6), 1)), 1)
    place, edges = np.arange(width)[:, None], np.arange(k + 1) * (width / k)
    shares = np.maximum(np.minimum(place + 1, edges[1:]) - np.maximum(place, edges[:-1]), 0.0) * (k / width)
    within = [v[:, width : (count + 1) * width].reshape(-1, count, width) for v in (current.T[:, 1:-1], inner)]
    samples = raw[:, (width + 1) * averaged : ((count + 1) * width + 1) * averaged].reshape(-1, count, width * averaged)
    variance, measured = about_line(samples).T, np.stack([v @ shares for v in within], axis=-1)
    time = even[0] + middle[:, 0]
    return Cells(width * step, time, position, velocity, curve, drawn.T, columns, variance, measured, width * averaged)


def bandwidth(current: Floats, step: float) -> float:
    """Hz at which a filter ended (N, J) currents, one every `step` s: beyond, rates have no noise or jump."""
    rate = np.diff(np.nan_to_num(current), axis=0)
    power = np.abs(np.fft.rfft(np.hanning(len(rate))[:, None] * rate, axis=0)) ** 2
    beyond = np.cumsum(power[::-1], axis=0)[::-1]
    last = np.count_nonzero(beyond > NEXT_TO_NONE * beyond[0], axis=0)
    return float(last[beyond[0] > 0.0].min(initial=len(power))) / (len(current) * step)


def about_line(values: Floats) -> Floats:
    """(...) mean squares of (..., k) values about the straight line through them."""
    way = np.arange(values.shape[-1]) - 0.5 * (values.shape[-1] - 1)
    return np.asarray(values.var(axis=-1) - (values @ way) ** 2 / max(len(way) * float(way @ way), 1.0))


def _filtered(values: Floats, width: int) -> Floats:
    """(K, M) of (K, N): means over `width` samples, `ROUNDS` times one after another, every `width`-th of them."""
    return _summed(_weighted(values, width))


def _weighted(values: Floats, width: int) -> Floats:
    """(K, N // width, ROUNDS) sums over cells of (K, N) values, by their weights in each mean that they enter."""
    mean = np.full(width, 1.0 / width)
    weights = np.pad(np.convolve(np.convolve(mean, mean), mean), (1, 1)).reshape(ROUNDS, width)
    count = values.shape[1] // width
    return values[:, : count * width].reshape(len(values), count, width) @ weights.T


def _summed(weighted: Floats) -> Floats:
    """(K, M) means over cells and their neighbours."""
    return np.sum([weighted[:, k : weighted.shape[1] - ROUNDS + 1 + k, k] for k in range(ROUNDS)], axis=0)
