"""When samples were taken: at their time stamps, or evenly where the motion shows that only the stamps are not."""

import math

import numpy as np

from pumaid.maths import Counts, Floats
from pumaid.preprocessing.differentiate import savitzky_golay

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


def sampling_times(time: Floats, position: Floats, repeats: Counts | None = None) -> tuple[Floats, float]:
    """When samples were taken.

    Stamps may be rounded, or written when a message arrives, while the samples are taken evenly: then the positions of
    a moving joint are smooth from sample to sample. Or samples are uneven and the stamps are right: then positions show
    what the stamps show, times the speed. The slope of a straight line through both decides.

    Of (N,) rising times (s) without gaps and (N, J) positions (rad or m), returns (N,) rising times, and the RMS (s) by
    which the stamps differ from them: zero where they are right or nothing shows. (N,) `repeats` were logged before
    each sample, so that none was lost there.
    """
    if len(time) < GROUP * FEWEST:
        return time, 0.0
    numbers, interval = _sample_numbers(time, np.zeros(len(time)) if repeats is None else repeats)
    ahead = time - time[0] - numbers * interval
    uneven = ahead - _moving_average(_moving_average(ahead))
    error = math.sqrt(float(np.mean(uneven**2)))
    if error <= EVEN * interval:
        return time, 0.0
    share, uncertainty = _shown(uneven, position, interval=interval, numbers=numbers)
    even = time - uneven
    is_plausible = -4.5 * uncertainty - UNCERTAIN <= share < SHOWN and uncertainty <= UNCERTAIN
    return (even, error) if is_plausible and (np.diff(even) > 0).all() else (time, 0.0)


def _sample_numbers(time: Floats, repeats: Counts | Floats) -> tuple[Floats, float]:
    """(N,) numbers of the samples, lost ones counted, and the interval (s) of all.

    A late stamp is followed by short steps; behind a lost sample all later stamps are ahead.
    """
    steps, beside = np.diff(time), np.arange(BESIDE)
    interval = float(np.median(time[2 * BESIDE :] - time[: -2 * BESIDE])) / (2 * BESIDE)
    ahead = time - time[0] - np.arange(len(time)) * interval
    long, lost = np.flatnonzero((steps > LONG * interval) & (repeats[1:] == 0)), np.zeros(len(steps))
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
