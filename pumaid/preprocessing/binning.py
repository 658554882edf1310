"""Pieces of a log as records: runs in bins of equal duration, and what is left out with its reason."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Log, Means, Reject, Run
from pumaid.preprocessing.differentiate import slopes
from pumaid.preprocessing.options import LARGEST, STROKE, SegmentOptions
from pumaid.preprocessing.parallel import Filtered, filtered_stroke
from pumaid.preprocessing.reasons import reason_text
from pumaid.preprocessing.stretches import Piece, Stretch
from pumaid.robot import Robot

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Binned = TypeVar("Binned", Bins, Means)

#: Ticks on either side of the straight lines through a run's own ticks.
HALF = 2
#: Bins of a stroke at most.
MOST_OF_STROKE = 512
#: Turns from which a run gets more bins, so that a ripple of 100 waves a turn is not averaged away, and the turns up to
#: which it does.
MANY_TURNS, MOST_TURNS = 2.0, 64.0


def records(
    stretch: Stretch, piece: Piece, robot: Robot, *, options: SegmentOptions, clock: int
) -> Iterator[Run | Reject]:
    """The run that a piece is, and what of it is left out.

    Parameters
    ----------
    stretch, piece
        A stretch and one of its pieces, not empty.
    robot
        Supplies the joints' kinds.
    options
        Thresholds.
    clock
        Number of the recording.
    """
    log = stretch.log.part(slice(piece.start, piece.stop))
    reject = _reject(stretch, piece, log, options=options, clock=clock)
    if not piece.kind:
        yield replace(reject, text=reason_text(piece, log, robot, options=options))
        return
    current = log.current[:, piece.joints[0] - 1]
    # A current of 0 throughout is that of a motor that is off.
    usable = (np.abs(current) < LARGEST) & current.any()
    missing = np.flatnonzero(~usable)
    if len(missing):
        lost = replace(piece, kind="", reason="no-current")
        text = reason_text(lost, log.part(missing), robot, options=options)
        yield replace(reject, reason=lost.reason, text=text, samples=len(missing))
    if len(missing) < len(log):
        run = _run(stretch, piece, log, usable=np.flatnonzero(usable), robot=robot, options=options)
        yield replace(run, clock=clock)


def _reject(stretch: Stretch, piece: Piece, log: Log, *, options: SegmentOptions, clock: int) -> Reject:
    bins = None
    if piece.joints and stretch.motion is not None:
        rate = (stretch.motion.ticks.time, stretch.motion.velocity)
        bins = bins_of_all_joints(log, rate, most=options.reject_bins)
    return Reject(
        origin=log.origin,
        first_row=int(log.rows[0]),
        last_row=int(log.rows[-1]),
        start=float(log.time[0]),
        duration=float(log.time[-1] - log.time[0]),
        joints=piece.joints,
        reason=piece.reason,
        text="",
        samples=len(log),
        bins=bins,
        clock=clock,
    )


def _motion(stretch: Stretch, piece: Piece, log: Log) -> tuple[Floats, Floats]:
    """(N,) velocity and acceleration of a run's moving joint."""
    if piece.course is not None:
        return piece.course.velocity, piece.course.acceleration
    velocity = np.interp(log.time, *_tick_velocity(stretch, piece))
    return velocity, np.zeros(len(velocity))


def _tick_velocity(stretch: Stretch, piece: Piece) -> tuple[Floats, Floats]:
    """Times and velocities of the moving joint at ticks, from inside the run only."""
    assert stretch.motion is not None
    ticks = stretch.motion.ticks
    low = int(np.searchsorted(ticks.edges, piece.start))
    high = int(np.searchsorted(ticks.edges, piece.stop, side="right")) - 1
    if high - low < 3:
        return ticks.time[:1], np.full(1, piece.figure)
    time = ticks.time[low:high]
    return time, slopes(time, ticks.position[low:high, piece.joints[0] - 1], HALF)


def _run(stretch: Stretch, piece: Piece, log: Log, *, usable: Ints, robot: Robot, options: SegmentOptions) -> Run:
    joint, turns = piece.joints[0], robot.joint(piece.joints[0]).is_revolute
    measured, (velocity, acceleration) = log.position[:, joint - 1], _motion(stretch, piece, log)
    part, motion = log.part(usable), (velocity[usable], acceleration[usable])
    posture = part.position.mean(axis=0)
    posture[joint - 1] = np.nan
    warmth = np.nan if part.temperature is None else part.temperature[:, joint - 1]
    filtered = _filtered(piece, log)
    if filtered is None:
        bins = bins_of_run(part, joint, motion, most=_most(measured, options, turns=turns))
    else:
        bins = bins_of_stroke(log, joint, filtered)
    return Run(
        joint=joint,
        kind=piece.kind,
        origin=part.origin,
        first_row=int(part.rows[0]),
        last_row=int(part.rows[-1]),
        start=float(part.time[0]),
        duration=float(part.time[-1] - part.time[0]),
        posture=posture,
        span=(float(measured[0]), float(measured[-1])),
        speed=_mean_velocity(log.time, measured, kind=piece.kind),
        ripple=float(np.std(velocity)),
        temperature=float(np.nanmean(warmth)) if np.isfinite(warmth).any() else np.nan,
        samples=len(part),
        bins=bins,
        stamp_error=stretch.stamp_error,
    )


def _mean_velocity(time: Floats, position: Floats, *, kind: str) -> float:
    """Slope (per s) of the straight line through all samples of a constant velocity, or from end to end of a stroke."""
    if kind == STROKE:
        return float((position[-1] - position[0]) / max(time[-1] - time[0], 1e-12))
    t = time - time.mean()
    return float(t @ (position - position.mean())) / max(float(t @ t), 1e-300)


def _most(position: Floats, options: SegmentOptions, *, turns: bool) -> int:
    """Most bins of a run with these positions."""
    count = abs(float(position[-1] - position[0])) / math.tau if turns else 0.0
    return math.ceil(options.max_bins * min(max(count, MANY_TURNS), MOST_TURNS) / MANY_TURNS)


def bins_of_run(log: Log, joint: int, motion: tuple[Floats, Floats], *, most: int) -> Bins:
    """Bins of a run of one joint.

    Parameters
    ----------
    log
        N samples, at least one, all with a current of the joint.
    joint
        The moving joint, from 1.
    motion
        (N,) velocity and acceleration of the joint.
    most
        Bins at most.
    """
    own = joint - 1
    starts, count = _equal_spans(log.time, most)
    velocity, acceleration = motion
    current = _means(log.current[:, own], starts, count)
    spread = log.current[:, own] - np.repeat(current, count)
    warmth = None if log.temperature is None else _known_means(log.temperature[:, own], starts, np.inf)
    return Bins(
        count=count,
        time=_mean_times(log.time, starts, count),
        position=_means(log.position, starts, count),
        velocity=_means(velocity, starts, count),
        acceleration=_means(acceleration, starts, count),
        current=current,
        variance=_means(spread * spread, starts, count),
        temperature=np.full(len(starts), np.nan) if warmth is None else warmth,
        extra=None if log.extra is None else _known_means(log.extra, starts, np.inf),
    )


def _filtered(piece: Piece, log: Log) -> Filtered | None:
    """A stroke's motion and current through one filter; None for other runs, and where its samples are too few."""
    if piece.course is None:
        return None
    joint = piece.joints[0] - 1
    current = np.where(np.abs(log.current[:, joint]) < LARGEST, log.current[:, joint], np.nan)
    return filtered_stroke(piece.course, log.position[:, joint], current)


def bins_of_stroke(log: Log, joint: int, filtered: Filtered) -> Bins:
    """Bins of a stroke whose motion and current went through one filter.

    Parameters
    ----------
    log
        N samples.
    joint
        The moving joint, from 1.
    filtered
        Motion and current of the joint; what is left of the plain current beside it counts as scatter inside bins.
    """
    own = joint - 1
    starts, count = _equal_spans(filtered.time, MOST_OF_STROKE)
    time = _mean_times(filtered.time, starts, count)
    before = np.clip(np.searchsorted(log.time, time, side="right") - 1, 0, len(log) - 1)
    position = np.column_stack([np.interp(time, log.time, column) for column in log.position.T])
    position[:, own] = _means(filtered.position, starts, count)
    current, velocity = _means(filtered.current, starts, count), _means(filtered.velocity, starts, count)
    acceleration = filtered.calibrated(position[:, own], velocity, _means(filtered.acceleration, starts, count))
    return Bins(
        count=count,
        time=time,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        current=current,
        variance=_means((filtered.plain - np.repeat(current, count)) ** 2, starts, count),
        temperature=np.full(len(starts), np.nan) if log.temperature is None else log.temperature[before, own],
        extra=None if log.extra is None else log.extra[before],
    )


def bins_of_all_joints(log: Log, rate: tuple[Floats, Floats], *, most: int) -> Means:
    """Bins of what is no run; `rate` are (K,) times and (K, J) velocities of all joints to interpolate."""
    starts, count = _equal_spans(log.time, most)
    time = _mean_times(log.time, starts, count)
    return Means(
        count=count,
        time=time,
        position=_means(log.position, starts, count),
        velocity=np.column_stack([np.interp(time, rate[0], column) for column in rate[1].T]),
        current=_known_means(log.current, starts, LARGEST),
    )


def _equal_spans(time: Floats, most: int) -> tuple[Ints, Ints]:
    """Where at most `most` equal spans of (N,) times begin, empty ones left out, and how many samples each has."""
    number = min(most, len(time))
    borders = time[0] + np.arange(number) * ((time[-1] - time[0]) / number)
    starts = np.arange(number) if number == len(time) else np.unique(np.searchsorted(time, borders))
    return starts, np.diff(starts, append=len(time))


def _means(values: Floats, starts: Ints, count: Ints) -> Floats:
    """(M,) or (M, J) means of the `count` (M,) values from each start on."""
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / (count if values.ndim == 1 else count[:, None]))


def _mean_times(time: Floats, starts: Ints, count: Ints) -> Floats:
    """(M,) mean times, from the first on: seconds since 1970 would lose digits in a sum."""
    return time[0] + _means(time - time[0], starts, count)


def _known_means(values: Floats, starts: Ints, largest: float) -> Floats:
    """Means of the numbers below `largest`; NaN where there are none."""
    good = np.abs(values) < largest
    known = np.add.reduceat(good.astype(float), starts, axis=0)
    total = np.add.reduceat(np.where(good, values, 0.0), starts, axis=0)
    return np.divide(total, known, out=np.full(total.shape, np.nan), where=known > 0)
