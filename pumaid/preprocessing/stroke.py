"""Movements from rest to rest: smoothed velocity and acceleration, and the part in which friction surely slides."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.differentiate import derivatives
from pumaid.preprocessing.options import SegmentOptions

Floats = NDArray[np.float64]

#: s; shortest and longest span of the local cubics; longer ones are calmer, and blunter at the acceleration's corners.
SHORTEST_FIT, LONGEST_FIT = 0.04, 0.4
#: Share of the movement's mean acceleration below which the noise of the smoothed one should stay.
CALM = 0.1
#: Share of a movement that a local cubic may span.
LARGEST_SHARE = 0.15


@dataclass(frozen=True, eq=False, slots=True)
class Smooth:
    """Samples [start, stop) of a movement: `time` (s), `velocity` and `acceleration`, (stop - start,) each.

    Times are those at which samples were taken, which stamps need not be; `window` (s) is what each cubic spanned.
    """

    start: int
    stop: int
    time: Floats
    velocity: Floats
    acceleration: Floats
    window: float

    def within(self, start: int, stop: int) -> Smooth:
        """The same for fewer samples."""
        part = slice(start - self.start, stop - self.start)
        return Smooth(start, stop, self.time[part], self.velocity[part], self.acceleration[part], self.window)


def smooth(time: Floats, position: Floats, *, bounds: tuple[int, int], noise: float) -> Smooth:
    """Velocity and acceleration of a movement.

    Parameters
    ----------
    time, position
        (N,) s and rad or m of a stretch without gaps.
    bounds
        First sample of the movement and the one behind its last.
    noise
        Standard deviation of one sample's position (rad or m).
    """
    start, stop = bounds
    duration = max(1e-9, float(time[stop - 1] - time[start]))
    interval = duration / max(1, stop - start)
    # From rest to rest over `way`: a triangle of speed has acceleration 4 way / duration^2.
    wanted = max(1e-12, CALM * 4.0 * abs(float(position[stop - 1] - position[start])) / duration**2)
    # A local cubic's acceleration has the noise sqrt(720 interval) / span^2.5, per noise of a sample.
    span = (noise * math.sqrt(720.0 * interval) / wanted) ** 0.4
    window = min(max(span, SHORTEST_FIT, 7.0 * interval), max(LONGEST_FIT, 7.0 * interval), LARGEST_SHARE * duration)
    margin = math.ceil(window / interval) + 3
    low, high = max(0, start - margin), min(len(time), stop + margin)
    velocity, acceleration = derivatives(time[low:high], position[low:high], window)
    return Smooth(low, high, time[low:high], velocity, acceleration, window).within(start, stop)


def sliding(course: Smooth, direction: int, options: SegmentOptions) -> tuple[int, int]:
    """Samples [start, stop) between which the speed stays above the share of its peak that `options` ask for."""
    speed = direction * course.velocity
    fast = np.flatnonzero(speed > max(options.rest_speed, options.low_speed_share * float(speed.max(initial=0.0))))
    if not len(fast):
        return course.start, course.start
    return course.start + int(fast[0]), course.start + int(fast[-1]) + 1
