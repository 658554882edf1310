"""Pieces of a log as records: runs in bins of equal duration, and what is left out with its reason."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Log, Means, Reject, Run, finite_means, spans
from pumaid.preprocessing.differentiate import slopes
from pumaid.preprocessing.options import LARGEST, STROKE, SegmentOptions
from pumaid.preprocessing.stretches import Piece, Stretch
from pumaid.preprocessing.strokes import Filtered, filtered_stroke
from pumaid.robot import Robot
from pumaid.units import number

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Ticks on either side of the straight lines through a run's own ticks.
HALF = 2
#: Bins of a stroke at most.
MOST_OF_STROKE = 512
#: Turns from which a run gets more bins, so that a ripple of 100 waves a turn is not averaged away, and the turns up to
#: which it does.
MANY_TURNS, MOST_TURNS = 2.0, 64.0

#: Why a piece is no run; the figures in braces are filled in from it.
REASONS: dict[str, str] = {
    "rest": "no joint is faster than {rest_speed} for {duration} s",
    "ramp": "joint {joints} changes its speed for {duration} s around its runs",
    "several-joints": "joints {joints} move at the same time for {duration} s",
    "between-several": "joint {joints} moves alone for only {duration} s between motions of several joints",
    "too-short": "joint {joints} moves {figure} {unit} in {duration} s, too little of it at one speed; a run needs "
    "{min_duration} s, {min_travel} {unit} and {min_samples} samples",
    "speed-not-constant": "joint {joints} moves {figure} {unit} in {duration} s, never within {speed_tolerance} of one "
    "speed for {min_duration} s",
    "low-speed": "joint {joints} is below {low_speed_share} of its peak speed {figure} {unit}/s where its stroke "
    "begins or ends, for {duration} s",
    "drift-of-held-joint": "while joint {first} moves, joint {last} drifts {figure} {last_unit}; {held_drift} are "
    "allowed",
    "no-current": "the current of joint {joints} is missing, or 0 throughout (motor off), in {samples} samples",
    "not-a-number": "a position or the time is no number, or beyond 1e6, in {samples} samples",
    "gap": "{samples} samples stand between gaps in time, too few in a row for a speed",
}


def records(
    stretch: Stretch, piece: Piece, robot: Robot, *, options: SegmentOptions, clock: int
) -> Iterator[Run | Reject]:
    """The run that a piece (not empty) of a stretch is, and what of it is left out; `clock` numbers the recording."""
    log = stretch.log.part(slice(piece.start, piece.stop))
    reject = _reject(stretch, piece, log, options=options, clock=clock)
    if not piece.kind:
        yield replace(reject, text=_reason_text(piece, log, robot, options=options))
        return
    current = log.current[:, piece.joints[0] - 1]
    # A current of 0 throughout is that of a motor that is off.
    usable = (np.abs(current) < LARGEST) & current.any()
    missing = np.flatnonzero(~usable)
    if len(missing):
        lost = replace(piece, kind="", reason="no-current")
        text = _reason_text(lost, log.part(missing), robot, options=options)
        yield replace(reject, reason=lost.reason, text=text, samples=len(missing))
    if len(missing) < len(log):
        run = _run(stretch, piece, log, usable=np.flatnonzero(usable), robot=robot, options=options)
        yield replace(run, clock=clock)


def _reason_text(piece: Piece, log: Log, robot: Robot, *, options: SegmentOptions) -> str:
    """Why a piece is no run, in a sentence with its figures; `log` holds its samples."""
    units = [robot.joint(joint).position_unit for joint in piece.joints] or ["rad"]
    return REASONS[piece.reason].format(
        joints=", ".join(str(joint) for joint in piece.joints),
        first=piece.joints[0] if piece.joints else "",
        last=piece.joints[-1] if piece.joints else "",
        unit=units[0],
        last_unit=units[-1],
        figure=number(piece.figure, 3),
        duration=number(float(log.time[-1] - log.time[0]), 3),
        samples=len(log),
        rest_speed=f"{options.rest_speed:g} rad/s or m/s",
        min_duration=f"{options.min_duration:g}",
        min_travel=f"{options.min_travel:g}",
        min_samples=options.min_samples,
        speed_tolerance=f"{100 * options.speed_tolerance:g} %",
        low_speed_share=f"{100 * options.low_speed_share:g} %",
        held_drift=f"{options.held_drift:g}",
    )


def _reject(stretch: Stretch, piece: Piece, log: Log, *, options: SegmentOptions, clock: int) -> Reject:
    bins = None
    if piece.joints and stretch.motion is not None:
        starts, count = _equal_spans(log.time, options.reject_bins)
        time, ticks = _mean_times(log.time, starts, count), stretch.motion.ticks.time
        bins = Means(
            count=count,
            time=time,
            position=_means(log.position, starts, count),
            velocity=np.column_stack([np.interp(time, ticks, column) for column in stretch.motion.velocity.T]),
            current=finite_means(np.where(np.abs(log.current) < LARGEST, log.current, np.nan), starts),
        )
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
    """(N,) velocity and acceleration of a run's moving joint; at constant speed from ticks inside the run only."""
    if piece.smoothed is not None:
        return piece.smoothed.velocity, piece.smoothed.acceleration
    assert stretch.motion is not None
    ticks = stretch.motion.ticks
    low = int(np.searchsorted(ticks.edges, piece.start))
    high = int(np.searchsorted(ticks.edges, piece.stop, side="right")) - 1
    if high - low < 3:
        return np.full(len(log), piece.figure), np.zeros(len(log))
    time = ticks.time[low:high]
    velocity = np.interp(log.time, time, slopes(time, ticks.position[low:high, piece.joints[0] - 1], HALF))
    return velocity, np.zeros(len(log))


def _run(stretch: Stretch, piece: Piece, log: Log, *, usable: Ints, robot: Robot, options: SegmentOptions) -> Run:
    joint = piece.joints[0]
    measured, (velocity, acceleration) = log.position[:, joint - 1], _motion(stretch, piece, log)
    part = log.part(usable)
    posture = part.position.mean(axis=0)
    posture[joint - 1] = np.nan
    warmth = np.nan if part.temperature is None else part.temperature[:, joint - 1]
    filtered = _filtered(piece, log)
    if filtered is None:
        size = _bins_of_turns(measured, options) if robot.joint(joint).is_revolute else options.max_bins
        bins = _bins_of_run(part, joint, (velocity[usable], acceleration[usable]), size)
    else:
        bins = _bins_of_stroke(log, joint, filtered)
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


def _bins_of_turns(position: Floats, options: SegmentOptions) -> int:
    """Bins at most of a run with these angles."""
    turns = abs(float(position[-1] - position[0])) / math.tau
    return math.ceil(options.max_bins * min(max(turns, MANY_TURNS), MOST_TURNS) / MANY_TURNS)


def _bins_of_run(log: Log, joint: int, motion: tuple[Floats, Floats], size: int) -> Bins:
    """At most `size` bins of samples with a current, and (N,) velocity and acceleration of the joint."""
    starts, count = _equal_spans(log.time, size)
    sampled = log.current[:, joint - 1]
    current = _means(sampled, starts, count)
    warmth = np.full(len(log), np.nan) if log.temperature is None else log.temperature[:, joint - 1]
    return Bins(
        count=count,
        time=_mean_times(log.time, starts, count),
        position=_means(log.position, starts, count),
        velocity=_means(motion[0], starts, count),
        acceleration=_means(motion[1], starts, count),
        current=current,
        variance=_means((sampled - np.repeat(current, count)) ** 2, starts, count),
        temperature=finite_means(warmth, starts),
        extra=None if log.extra is None else finite_means(log.extra, starts),
    )


def _filtered(piece: Piece, log: Log) -> Filtered | None:
    """A stroke's motion and current through one filter; None for other runs, and where its samples are too few."""
    if piece.smoothed is None:
        return None
    joint = piece.joints[0] - 1
    current = np.where(np.abs(log.current[:, joint]) < LARGEST, log.current[:, joint], np.nan)
    return filtered_stroke(piece.smoothed, log.position[:, joint], current)


def _bins_of_stroke(log: Log, joint: int, filtered: Filtered) -> Bins:
    """Bins of a stroke whose motion and current went through one filter.

    What is left of the plain current beside the filtered one counts as scatter inside bins.
    """
    starts, count = _equal_spans(filtered.time, MOST_OF_STROKE)
    time = _mean_times(filtered.time, starts, count)
    before = np.clip(np.searchsorted(log.time, time, side="right") - 1, 0, len(log) - 1)
    position = np.column_stack([np.interp(time, log.time, column) for column in log.position.T])
    position[:, joint - 1] = _means(filtered.position, starts, count)
    current, velocity = _means(filtered.current, starts, count), _means(filtered.velocity, starts, count)
    acceleration = _means(filtered.acceleration, starts, count)
    return Bins(
        count=count,
        time=time,
        position=position,
        velocity=velocity,
        acceleration=filtered.calibrated(position[:, joint - 1], velocity, acceleration),
        current=current,
        variance=_means((filtered.plain - np.repeat(current, count)) ** 2, starts, count),
        temperature=np.full(len(starts), np.nan) if log.temperature is None else log.temperature[before, joint - 1],
        extra=None if log.extra is None else log.extra[before],
    )


def _equal_spans(time: Floats, size: int) -> tuple[Ints, Ints]:
    """Where at most `size` equal spans of (N,) times begin, empty ones left out, and how many samples each has."""
    starts = np.arange(len(time)) if len(time) <= size else spans(time, size)
    return starts, np.diff(starts, append=len(time))


def _means(values: Floats, starts: Ints, count: Ints) -> Floats:
    """(M,) or (M, J) means of the `count` (M,) values from each start on."""
    sums = np.add.reduceat(values, starts, axis=0)
    return np.asarray(sums / (count if values.ndim == 1 else count[:, None]))


def _mean_times(time: Floats, starts: Ints, count: Ints) -> Floats:
    """(M,) mean times, from the first on: seconds since 1970 would lose digits in a sum."""
    return time[0] + _means(time - time[0], starts, count)
