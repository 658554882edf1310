"""Speed and acceleration from positions: straight lines through short means, and Savitzky-Golay filters.

When samples were taken: at their time stamps, or evenly where the motion shows that only the stamps are not. And
parallel filtering: motion, currents and every column of the rigid body pass one filter, of a stroke or in cells.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pumaid.dataset import Bins, Log, finite_means, spans
from pumaid.maths import Floats
from pumaid.rigid_body import RigidBody

#: s; short against the ramps of real arms, long enough to average tens of samples at 1 kHz.
TICK = 0.02
#: s; longest straight line by which a moving joint is told from one at rest: shorter pauses may be missed.
LONGEST_FIT = 0.5
#: Median absolute third difference of white noise of unit standard deviation.
THIRD_DIFFERENCE = math.sqrt(20.0) * 0.6745
#: Share of the median by which time steps may differ and still be ordinary ones, no gaps.
ORDINARY = 0.25

#: Windows (samples) of the cubics of `acceleration`; the one that shows the acceleration best is taken.
WINDOWS, ORDER = (9, 17, 33, 65), 3
#: Mean square of an acceleration, over that of the noise in it, from which it counts as measured.
SEEN = 10.0
#: Noise below this share of the largest position is rounding.
ROUNDING = 1e-12

#: Unevenness of stamps, RMS as a share of their interval, below which nothing needs to be done.
EVEN = 0.01
#: Samples on either side over which an even clock may drift, and half width of the cubics that filter out slow motion.
DRIFT, SLOW = 128, 16
#: Steps above so many intervals may stand for lost samples; so many stamps on either side tell it from a late stamp.
LONG, BESIDE = 1.45, 8
#: Samples on either side by which the speed is taken, and how many of its standard deviations it must have.
AROUND, CLEAR = 8, 14.0
#: Samples that are summed together, so that their common errors count as one, and fewest such groups.
GROUP, FEWEST = 32, 6
#: Share of the unevenness that the positions show, up to which stamps are corrected, and its largest standard error.
SHOWN, UNCERTAIN = 0.5, 0.15

#: Bins of a stroke at most.
MOST_BINS = 512
#: Position, velocity and acceleration by the step, convolved from five positions; equally blunt: all have the same
#: second moment, a sixth of a squared step.
LEVEL = np.array([0.0, 1.0, 10.0, 1.0, 0.0]) / 12.0
RATE = np.array([-1.0, 14.0, 0.0, -14.0, 1.0]) / 24.0
CURVE = np.array([0.0, 1.0, -2.0, 1.0, 0.0])
#: Samples below which a stroke is not filtered; with some currents missing, averages of fewer leave too few rows.
FEWEST_SAMPLES, FEWEST_OF_SOME = 16, 32
#: Mean steps between currents from which there is a hole between two of them.
MOST_APART = 2.5
#: Largest share of an acceleration's own course, beyond weight and friction, that is taken for noise.
MOST_NOISE = 0.9
#: Samples between which noise is looked for.
LAGS = (1, 2, 3, 5)

#: Samples whose regressor is made at once.
CHUNK = 2048
#: Means over one cell, one after another: their impulse response is a quadratic B-spline, three cells long.
ROUNDS = 3
#: s; shortest and longest cell of a block: currents hold little beyond 20 Hz that bodies cause, motion of arms little
#: beyond 5 Hz.
SHORTEST_CELL, LONGEST_CELL = 0.024, 0.12
#: Noise of a cell's acceleration, as a share of the joint's RMS acceleration, that encoders may leave. Its square is
#: the share by which inertia comes out too small, itself the error that thousands of cells average to.
ACCELERATION_NOISE = 0.005
#: rad/s or m/s, below which a joint may stick: cells that hold a slower sample of it say nothing of its current.
STICKING = 0.05
#: Share of the steps' mean by which sampling may be uneven; beyond it positions are interpolated.
UNEVEN = 1e-3


@lru_cache(64)
def _cubics(window: int, derivative: int) -> Floats:
    """(window, window) matrix whose row k is the derivative, at sample k, of the least-squares cubic."""
    x = np.linspace(-1.0, 1.0, window)
    powers = np.polynomial.legendre.legvander(x, ORDER)
    coefficients = np.polynomial.legendre.legder(np.eye(ORDER + 1), derivative)
    read = np.polynomial.legendre.legval(x, coefficients).T
    return np.asarray(read / (window // 2) ** derivative @ np.linalg.pinv(powers))


def savitzky_golay(values: Floats, window: int, derivative: int) -> Floats:
    """(M,) local cubics through `window` (odd) equally spaced values each; at the ends the outermost are extended.

    `derivative` is 0 for smoothed values, 1 or 2 for derivatives with respect to the sample number.

    Source
    ------
    A. Savitzky and M. J. E. Golay, Anal. Chem. 36 (1964) 1627-1639.
    """
    rows, half = _cubics(window, derivative), window // 2
    inner = np.convolve(values, rows[half][::-1], mode="valid")
    return np.concatenate([rows[:half] @ values[:window], inner, rows[half + 1 :] @ values[-window:]])


def averaging_kernel(window: int) -> Floats:
    """(window - 2,) weights of sum 1 by which the cubics' second derivative averages plain second differences."""
    return np.cumsum(np.cumsum(_cubics(window, 2)[window // 2]))[:-2]


def cubic_window(seconds: float, step: float) -> int:
    """Samples, `step` (s) apart, of a local cubic over so many seconds: odd, at least five."""
    return max(5, 2 * round_half_up(seconds / step / 2) + 1)


def velocity(time: Floats, position: Floats, seconds: float) -> Floats:
    """(N,) velocity by local cubics over a span of time (s); of (N,) times (s), which may be uneven, and positions."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    even = time[0] + step * np.arange(len(time))
    window = min(cubic_window(seconds, step), len(time) - 1 + len(time) % 2)
    return np.interp(time, even, savitzky_golay(np.interp(even, time, position), window, 1) / step)


def acceleration(time: Floats, position: Floats) -> Floats:
    """(M,) second derivative of positions; zeros where it is below the sensor's noise.

    Noise in a regressor would look like a small, well-known inertia. The straight line through the positions is taken
    out first, because time steps that differ by a sample would look like acceleration.
    """
    best, clearest = np.zeros(len(time)), SEEN
    if len(time) < WINDOWS[0]:
        return best
    since = time - time.mean()
    bent = position - position.mean() - since * (since @ position) / (since @ since)
    step, floor = float(time[-1] - time[0]) / (len(time) - 1), ROUNDING * float(np.abs(position).max())
    for window in (window for window in WINDOWS if window <= len(time)):
        rough = bent - savitzky_golay(bent, window, 0)
        curved = savitzky_golay(bent, window, 2)
        noise = float(rough @ rough) / len(rough) * window / (window - ORDER - 1)
        # Mean variance of the second derivative of white noise of variance one.
        gains = np.sum(_cubics(window, 2) ** 2, axis=1)
        gain = gains.sum() + (len(time) - window) * gains[window // 2]
        carried = max(noise, floor**2) * float(gain) / len(time)
        square = float(curved @ curved) / len(curved)
        if square > clearest * carried:
            best, clearest = curved / step**2, square / carried
    return best


def round_half_up(count: float) -> int:
    """Nearest whole number of samples; halves, which rounded times blur, go up."""
    return math.floor(round(count, 3) + 0.5)


def usual_step(time: Floats) -> float:
    """Mean step of (N,) times (s) without gaps and repeats; 0 where there is none."""
    steps = np.diff(time)
    if not len(steps):
        return 0.0
    # The mean of ordinary steps: of rounded stamps the median is one of few values, none of them the clock's.
    median = float(np.median(steps))
    ordinary = steps[np.abs(steps - median) <= ORDINARY * abs(median)]
    return float(ordinary.mean()) if len(ordinary) else median


def slopes(time: Floats, values: Floats, half: int) -> Floats:
    """(K,) slopes of straight lines through each of (K,) rising times (s) and `half` neighbours on either side."""
    size = len(time)
    if size < 2:
        return np.zeros(size)
    t, y = time - time.mean(), values - values.mean()
    sums = np.zeros((5, size + 1))
    np.cumsum([np.ones(size), t, y, t * t, t * y], axis=1, out=sums[:, 1:])
    place = np.arange(size)
    n, sum_t, sum_y, sum_tt, sum_ty = sums[:, np.minimum(place + half + 1, size)] - sums[:, np.maximum(place - half, 0)]
    return np.asarray((sum_ty - sum_t * sum_y / n) / (sum_tt - sum_t * sum_t / n))


class Ticks:
    """Positions averaged over K ticks of 20 ms, in a stretch without gaps of (N,) times and (N, J) positions, N >= 2.

    `edges` (K + 1,) are sample indices of the ticks' borders, `time` (K,) s and `position` (K, J) rad or m; `interval`
    is the mean distance of ticks, s; `noise` (J,) the standard deviation of a tick's mean, quantisation included, and
    `quantum` (J,) the smallest step of the position, rad or m.
    """

    def __init__(self, time: Floats, position: Floats) -> None:
        size = max(1, round_half_up(TICK / usual_step(time)))
        starts = np.arange(0, max(1, len(time) - size // 2), size)
        counts = np.diff(starts, append=len(time))
        self.edges = np.append(starts, len(time))
        # Means about the first sample, which loses no digits to the clock's or the encoder's offset.
        self.position = position[0] + np.add.reduceat(position - position[0], starts, axis=0) / counts[:, None]
        self.time = time[0] + np.add.reduceat(time - time[0], starts) / counts
        steps = np.abs(np.diff(position, axis=0))
        self.quantum = np.where(steps > 1e-9, steps, math.inf).min(axis=0, initial=math.inf)
        self.quantum[np.isinf(self.quantum)] = 0.0
        self.noise = self.quantum / math.sqrt(12.0)
        if len(starts) > 4:
            third = np.median(np.abs(np.diff(self.position, 3, axis=0)), axis=0)
            self.noise = np.maximum(self.noise, third / THIRD_DIFFERENCE)
        self.interval = float(self.time[-1] - self.time[0]) / max(1, len(starts) - 1) or TICK

    def slope_error(self, joint: int, half: int) -> float:
        """Standard deviation of the slope of a straight line through ``2 half + 1`` ticks, rad/s or m/s."""
        width = 2 * half + 1
        return float(self.noise[joint - 1]) / (self.interval * math.sqrt(width * (width * width - 1) / 12.0))

    def half_width(self, joint: int, wanted: float, longest: float = LONGEST_FIT) -> int:
        """Fewest ticks on either side for which the slope's error is at most `wanted` (rad/s or m/s)."""
        largest = max(1, round_half_up(longest / self.interval / 2))
        half = 1
        while half < largest and self.slope_error(joint, half) > wanted:
            half += 1
        return half


def sampling_times(time: Floats, position: Floats) -> tuple[Floats, float]:
    """When samples were taken.

    Stamps may be rounded, or written when a message arrives, while the samples are taken evenly: then the positions of
    a moving joint are smooth from sample to sample. Or samples are uneven and the stamps are right: then positions show
    what the stamps show, times the speed. The slope of a straight line through both decides.

    Of (N,) rising times (s) without gaps and (N, J) positions (rad or m), returns (N,) rising times, and the RMS (s) by
    which the stamps differ from them: zero where they are right or nothing shows.
    """
    if len(time) < GROUP * FEWEST:
        return time, 0.0
    numbers, interval = _sample_numbers(time)
    ahead = time - time[0] - numbers * interval
    uneven = ahead - _moving_average(_moving_average(ahead))
    error = math.sqrt(float(np.mean(uneven**2)))
    if error <= EVEN * interval:
        return time, 0.0
    share, uncertainty = _shown(uneven, position, interval=interval, numbers=numbers)
    even = time - uneven
    is_plausible = -4.5 * uncertainty - UNCERTAIN <= share < SHOWN and uncertainty <= UNCERTAIN
    return (even, error) if is_plausible and (np.diff(even) > 0).all() else (time, 0.0)


def _sample_numbers(time: Floats) -> tuple[Floats, float]:
    """(N,) numbers of the samples, lost ones counted, and the interval (s) of all.

    A late stamp is followed by short steps; behind a lost sample all later stamps are ahead.
    """
    steps, beside = np.diff(time), np.arange(BESIDE)
    interval = float(np.median(time[2 * BESIDE :] - time[: -2 * BESIDE])) / (2 * BESIDE)
    ahead = time - time[0] - np.arange(len(time)) * interval
    long, lost = np.flatnonzero(steps > LONG * interval), np.zeros(len(steps))
    before = np.median(ahead[np.maximum(0, long[:, None] - beside)], axis=1)
    behind = np.median(ahead[np.minimum(len(time) - 1, long[:, None] + 1 + beside)], axis=1)
    lost[long] = np.maximum(0.0, np.round(np.minimum(behind - before, steps[long] - interval) / interval))
    numbers = np.concatenate([[0.0], np.cumsum(1.0 + lost)])
    return numbers, float(time[-1] - time[0]) / float(numbers[-1])


def _moving_average(values: Floats) -> Floats:
    """(N,) means over `DRIFT` neighbours on either side; near the ends of a straight line's continuation."""
    half = min(DRIFT, (len(values) - 1) // 2)
    width = 2 * half + 1
    first, last = (np.polyfit(np.arange(width), part, 1) for part in (values[:width], values[-width:]))
    before, behind = np.polyval(first, np.arange(-half, 0)), np.polyval(last, width + np.arange(half))
    total = np.concatenate([[0.0], np.cumsum(np.concatenate([before, values, behind]))])
    return (total[width:] - total[:-width]) / width


def _shown(uneven: Floats, position: Floats, *, interval: float, numbers: Floats) -> tuple[float, float]:
    """Share of the stamps' unevenness (N,) that the positions show, and its standard error; infinite if unknown."""
    span = interval * (numbers[2 * AROUND :] - numbers[: -2 * AROUND])
    cross, square = np.zeros(-(-len(uneven) // GROUP)), np.zeros(-(-len(uneven) // GROUP))
    groups = np.arange(0, len(uneven), GROUP)
    for column in position.T:
        noise = math.sqrt(float(np.mean(np.diff(column, 3) ** 2)) / 20.0)
        speed = np.zeros(len(column))
        speed[AROUND:-AROUND] = (column[2 * AROUND :] - column[: -2 * AROUND]) / span
        if noise == 0.0:
            continue
        speed[np.abs(speed) <= CLEAR * noise / (2 * AROUND * interval)] = 0.0
        observed, expected = (
            (values - savitzky_golay(values, 2 * SLOW + 1, 0)) / noise for values in (column, speed * uneven)
        )
        cross += np.add.reduceat(expected * observed, groups)
        square += np.add.reduceat(expected * expected, groups)
    total = float(square.sum())
    if total <= 0.0 or total**2 < FEWEST * float(square @ square):
        return 1.0, math.inf
    share = float(cross.sum()) / total
    rest = cross - share * square
    return share, math.sqrt(float(rest @ rest)) / total


def stroke_bins(log: Log, joint: int, *, time: Floats, window: float) -> Bins | None:
    """Bins of a stroke, its motion and current averaged over the same spans; None where currents are too few.

    `log` holds its N samples, currents that are missing NaN; `time` (N,) s is when they were taken.

    An acceleration from positions that are smoothed is blunt at its corners where the current is not: regressed on
    it, sharp currents make inertia, weight and viscous friction too large. With the average that the acceleration is
    by nature, of all columns and of the current, least squares returns the truth whatever the motion.
    A ripple that is faster than the filter stays in the current; what remains of it counts as scatter inside bins.

    Source
    ------
    M. Gautier, Dynamic identification of robots with power model, ICRA 1997: parallel filtering, here by the kernel
    of A. Savitzky and M. J. E. Golay's second derivative.
    """
    position, current = log.position[:, joint - 1], log.current[:, joint - 1]
    measured = np.isfinite(current)
    at = time[measured]
    if len(at) < (FEWEST_SAMPLES if measured.all() else FEWEST_OF_SOME):
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
    plain, instants = sampled[inner][rows], even[inner][rows]
    filtered = (smoothed + _without_motion(sampled[inner] - smoothed, motion, kernel))[rows]
    starts, count = spans(instants, MOST_BINS)
    means = finite_means(np.column_stack([instants - instants[0], motion[rows], filtered]), starts)
    bin_time, (moving, speed, acceleration, binned) = instants[0] + means[:, 0], means[:, 1:].T
    posture = np.column_stack([np.interp(bin_time, log.time, column) for column in log.position.T])
    posture[:, joint - 1] = moving
    weights = np.convolve(curve, np.full(round(len(rows) / len(starts)), 1.0 / round(len(rows) / len(starts))))
    noise = _variance(q) * float(weights @ weights)
    before = np.clip(np.searchsorted(log.time, bin_time, side="right") - 1, 0, len(log) - 1)
    return Bins(
        count=count,
        time=bin_time,
        position=posture,
        velocity=speed,
        acceleration=_calibrated(moving, speed, acceleration, noise=noise),
        current=binned,
        variance=finite_means((plain - np.repeat(binned, count)) ** 2, starts),
        temperature=np.full(len(starts), np.nan) if log.temperature is None else log.temperature[before, joint - 1],
        extra=None if log.extra is None else log.extra[before],
    )


def _calibrated(position: Floats, speed: Floats, acceleration: Floats, *, noise: float) -> Floats:
    """(B,) accelerations less the share of them that is noise of variance `noise`.

    Noise in a regressor makes its parameter too small by its share of what the regressor has beyond the others.

    Source
    ------
    R. J. Carroll et al., Measurement Error in Nonlinear Models, 2nd ed. (2006), ch. 4: regression calibration.
    """
    beyond = _residual(acceleration, [np.cos(position), np.sin(position), speed])
    square = float(beyond @ beyond)
    return acceleration - min(noise * len(beyond) / square, MOST_NOISE) * beyond if square > 0.0 else acceleration


def _without_motion(fast: Floats, motion: Floats, kernel: Floats) -> Floats:
    """(N,) of a current what the filter took out, less what follows the (N, 3) motion and its corners.

    Regressed on weight, friction and inertia it gives nothing: least squares returns what it does of filtered currents.
    """
    position, speed, acceleration = motion.T
    blunter = np.convolve(np.pad(acceleration, len(kernel) // 2, mode="edge"), kernel, mode="valid")
    return _residual(fast, [np.cos(position), np.sin(position), speed, acceleration, blunter])


def _residual(values: Floats, regressors: list[Floats]) -> Floats:
    """(N,) values less their least-squares fit by a constant and the regressors."""
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
    variances = []
    for lag in LAGS:
        if len(position) > 3 * lag + 1:
            inner = position[2 * lag : -lag] - position[lag : -2 * lag]
            variances.append(float(np.mean((position[3 * lag :] - position[: -3 * lag] - 3.0 * inner) ** 2)) / 20.0)
    return min(variances, default=0.0)


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
    width = max(round(SHORTEST_CELL / step), 1)
    smooth = _filtered(position.T - position[:1].T, width)
    rates = np.sqrt(np.mean(np.diff(smooth, 2, axis=1) ** 2, axis=1)) / (width * step) ** 2
    wanted = ACCELERATION_NOISE * np.maximum(rates, 1e-12)
    lengths = (noise * math.sqrt(6.0 * step) / wanted) ** 0.4
    moving = rates > 1e-3 * rates.max(initial=0.0)
    return float(np.clip(lengths[moving].max(initial=0.0), max(SHORTEST_CELL, step), LONGEST_CELL))


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
