"""Which joint moves when: instants of rest, of one joint alone, of several, and the movements they add up to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.speed import SURE, Ticks, slopes

Floats = NDArray[np.float64]

#: Codes of an instant beside +joint and -joint.
REST, SEVERAL = 0, 1_000_000
#: s within which a held joint's slip ends, and its way as a share of what a held joint may drift during a run.
SLIP, SLIP_SHARE = 0.25, 0.25


@dataclass(frozen=True, eq=False, slots=True)
class Course:
    """What every joint does at each of K ticks.

    `velocity` (K, J) rad/s or m/s; `code` (K,) is `REST`, +joint or -joint by direction, or `SEVERAL`;
    `moving` (K, J) says which joints move.
    """

    ticks: Ticks
    velocity: Floats
    code: NDArray[np.int64]
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Stretch:
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


def course(ticks: Ticks, options: SegmentOptions) -> Course:
    """Tell rest, one joint and several apart at every tick.

    A joint moves where its speed is surely above `rest_speed` and above `held_share` of the fastest joint's; the fit
    behind a joint's speed is just long enough to see `rest_speed` through its noise and quantisation.
    """
    n_joints = ticks.position.shape[1]
    velocity = np.empty_like(ticks.position)
    floor = np.empty(n_joints)
    for joint in range(1, n_joints + 1):
        half = ticks.half_width(joint, options.rest_speed / SURE)
        velocity[:, joint - 1] = slopes(ticks.time, ticks.position[:, joint - 1], half)
        # One count back and forth tilts the line by at most 1.5 counts over its length.
        flicker = 2.0 * ticks.quantum[joint - 1] / (ticks.interval * (2 * half + 1))
        floor[joint - 1] = max(options.rest_speed, SURE * ticks.fit_error(joint, half), flicker)
    speed = np.abs(velocity)
    moving = speed > np.maximum(floor, options.held_share * speed.max(axis=1)[:, None])
    fastest = speed.argmax(axis=1)
    signed = np.where(velocity[np.arange(len(speed)), fastest] > 0, 1, -1) * (fastest + 1)
    count = moving.sum(axis=1)
    code = np.where(count == 0, REST, np.where(count == 1, signed, SEVERAL)).astype(np.int64)
    return Course(ticks, velocity, _without_slips(code, ticks, options), moving)


def _without_slips(code: NDArray[np.int64], ticks: Ticks, options: SegmentOptions) -> NDArray[np.int64]:
    """Codes in which a held joint that gives way for a moment, by little, does not end the motion of the moving one.

    What the moving one carries changes the held joints' load, until it passes what their friction holds.
    """
    out = code.copy()
    for one in stretches(code):
        if one.code != SEVERAL or one.before != one.after or one.before in (None, REST):
            continue
        low, high = max(0, one.start - 1), min(len(ticks) - 1, one.stop)
        way = np.ptp(ticks.position[low : high + 1], axis=0)
        way[abs(int(one.before)) - 1] = 0.0
        if ticks.time[high] - ticks.time[low] <= SLIP and way.max() <= SLIP_SHARE * options.held_drift:
            out[one.start : one.stop] = one.before
    return out


def stretches(code: NDArray[np.int64]) -> list[Stretch]:
    """Runs of equal code, in order."""
    borders = np.concatenate([[0], np.flatnonzero(np.diff(code)) + 1, [len(code)]])
    codes = [int(code[start]) for start in borders[:-1]]
    return [
        Stretch(
            start=int(borders[k]),
            stop=int(borders[k + 1]),
            code=codes[k],
            before=codes[k - 1] if k else None,
            after=codes[k + 1] if k + 1 < len(codes) else None,
        )
        for k in range(len(codes))
    ]
