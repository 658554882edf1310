"""Which joint moves when: rest, one joint alone, several joints."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.differentiate import Ticks, slopes
from pumaid.preprocessing.options import SegmentOptions

Floats = NDArray[np.float64]

#: Standard deviations of a speed that count as surely moving (one false alarm in about 1e5 ticks).
SURE = 4.5
#: Codes of a tick beside +joint and -joint.
REST, SEVERAL = 0, 1_000_000
#: s within which a held joint's slip ends, and its way as a share of what a held joint may drift during a run.
SLIP, SLIP_SHARE = 0.25, 0.25


@dataclass(frozen=True, eq=False, slots=True)
class JointMovement:
    """What every joint does at each of K ticks.

    `velocity` (K, J) rad/s or m/s; `code` (K,) is `REST`, +joint or -joint by direction, or `SEVERAL`;
    `moving` (K, J) says which joints move.
    """

    ticks: Ticks
    velocity: Floats
    code: NDArray[np.int64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Movement:
    """Ticks [start, stop) of one code, with the codes on either side (None at the end of the data)."""

    start: int
    stop: int
    code: int
    before: int | None
    after: int | None

    @property
    def joint(self) -> int:
        """Moving joint, from 1, where exactly one moves."""
        return abs(self.code)

    @property
    def from_rest(self) -> bool:
        """Whether it begins at rest or at a reversal, and ends so."""
        ends_of_motion = (REST, -self.code)
        return self.before in ends_of_motion and self.after in ends_of_motion


def motion_of(ticks: Ticks, options: SegmentOptions) -> JointMovement:
    """Tell rest, one joint and several apart at every tick.

    A joint moves where its speed is surely above `rest_speed` and above `held_share` of the fastest joint's; the line
    behind a joint's speed is just long enough to see `rest_speed` through its noise and quantisation.
    """
    velocity, floor = np.empty_like(ticks.position), np.empty(ticks.position.shape[1])
    for joint in range(1, len(floor) + 1):
        half = ticks.half_width(joint, options.rest_speed / SURE)
        velocity[:, joint - 1] = slopes(ticks.time, ticks.position[:, joint - 1], half)
        # One count back and forth tilts the line by at most 1.5 counts over its length.
        flicker = 2.0 * ticks.quantum[joint - 1] / (ticks.interval * (2 * half + 1))
        floor[joint - 1] = max(options.rest_speed, SURE * ticks.slope_error(joint, half), flicker)
    speed = np.abs(velocity)
    moving = speed > np.maximum(floor, options.held_share * speed.max(axis=1)[:, None])
    fastest, count = speed.argmax(axis=1), moving.sum(axis=1)
    signed = np.where(velocity[np.arange(len(speed)), fastest] > 0, 1, -1) * (fastest + 1)
    code = np.where(count == 0, REST, np.where(count == 1, signed, SEVERAL)).astype(np.int64)
    return JointMovement(ticks, velocity, _without_slips(code, ticks, options), moving)


def _without_slips(code: NDArray[np.int64], ticks: Ticks, options: SegmentOptions) -> NDArray[np.int64]:
    """Codes in which a held joint that gives way by little, for a moment, does not end the motion of another.

    The moving joint changes the held joints' load, until it passes what their friction holds.
    """
    out = code.copy()
    for part in movements(code):
        if part.code != SEVERAL or part.before != part.after or part.before in (None, REST):
            continue
        low, high = max(0, part.start - 1), min(len(ticks) - 1, part.stop)
        way = np.ptp(ticks.position[low : high + 1], axis=0)
        way[abs(int(part.before)) - 1] = 0.0
        if ticks.time[high] - ticks.time[low] <= SLIP and way.max() <= SLIP_SHARE * options.held_drift:
            out[part.start : part.stop] = part.before
    return out


def movements(code: NDArray[np.int64]) -> list[Movement]:
    """Ranges of equal code, in order."""
    borders = np.concatenate([[0], np.flatnonzero(np.diff(code)) + 1, [len(code)]]).tolist()
    codes: list[int | None] = [None, *code[borders[:-1]].tolist(), None]
    return [
        Movement(start, stop, int(codes[k + 1] or 0), before=codes[k], after=codes[k + 2])
        for k, (start, stop) in enumerate(pairwise(borders))
    ]
