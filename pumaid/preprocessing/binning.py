"""Pieces of a log as records: runs in bins of equal duration, and what is left out with its reason."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Log, Means, Reject, Run, finite_means, mean_times, spans
from pumaid.preprocessing.differentiate import Ticks, slopes
from pumaid.preprocessing.options import CONSTANT, LARGEST, STROKE, SegmentOptions
from pumaid.preprocessing.strokes import stroke_bins
from pumaid.robot import Robot
from pumaid.units import number

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Ticks on either side of the straight lines through a run's own ticks.
HALF = 2
#: Turns from which a run gets more bins, so that a ripple of 100 waves a turn is not averaged away, and the turns up to
#: which it does.
MANY_TURNS, MOST_TURNS = 2.0, 64.0

#: Why a piece is no run; the figures in braces are filled in from it.
REASONS: dict[str, str] = {
    "rest": "no joint is faster than {options.rest_speed:g} rad/s or m/s for {duration} s",
    "ramp": "joint {joints} changes its speed for {duration} s around its runs",
    "several-joints": "joints {joints} move at the same time for {duration} s",
    "between-several": "joint {joints} moves alone for only {duration} s between motions of several joints",
    "too-short": "joint {joints} moves {figure} {unit} in {duration} s, too little of it at one speed; a run needs "
    "{options.min_duration:g} s, {options.min_travel:g} {unit} and {options.min_samples} samples",
    "speed-not-constant": "joint {joints} moves {figure} {unit} in {duration} s, never within "
    "{options.speed_tolerance:.1%} of one speed for {options.min_duration:g} s",
    "low-speed": "joint {joints} is below {options.low_speed_share:.1%} of its peak speed {figure} {unit}/s "
    "where its stroke begins or ends, for {duration} s",
    "drift-of-held-joint": "while joint {first} moves, joint {last} drifts {figure} {last_unit}; "
    "{options.held_drift:g} are allowed",
    "no-current": "the current of joint {joints} is missing, or 0 throughout (motor off), in {samples} samples",
    "not-a-number": "a position or the time is no number, or beyond 1e6, in {samples} samples",
    "gap": "{samples} samples stand between gaps in time, too few in a row for a speed",
}


@dataclass(frozen=True, slots=True)
class Piece:
    """Samples [start, stop) of a stretch: a run, whose kind `label` is, or left out for the reason `label`.

    `joints` (from 1) move in it; `figure` is a run's velocity (of a stroke: at its peak), or the number that the reason
    depends on; `window` (s) is the span of the local cubics that suit a stroke.
    """

    start: int
    stop: int
    label: str
    joints: tuple[int, ...] = ()
    figure: float = 0.0
    window: float = 0.0

    @property
    def is_run(self) -> bool:
        """Whether it is a run."""
        return self.label in (CONSTANT, STROKE)


@dataclass(frozen=True, eq=False, slots=True)
class JointMotion:
    """What each of J joints does at K ticks of 20 ms.

    `velocity` (K, J) rad/s or m/s; `moving` (K, J) says which joints move; `code` (K,) is 0 at rest, +joint or -joint
    by direction, or another number where several move.
    """

    ticks: Ticks
    velocity: Floats
    moving: NDArray[np.bool_]
    code: Ints


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """N consecutive samples without gaps.

    Attributes
    ----------
    log, index
        The samples, and (N,) their numbers in the window that they come from.
    time, stamp_error
        (N,) s at which they were taken, which stamps need not be; RMS by which the stamps differ from it, s.
    motion
        None where samples are too few, or no numbers.
    """

    log: Log
    index: Ints
    time: Floats
    stamp_error: float = 0.0
    motion: JointMotion | None = None


def record(
    stretch: Stretch, piece: Piece, robot: Robot, *, options: SegmentOptions, clock: int
) -> tuple[Run | None, Reject | None]:
    """The run that a piece (not empty) of a stretch is, and what of it is left out; `clock` numbers the recording."""
    log = stretch.log.part(slice(piece.start, piece.stop))
    log = replace(log, current=np.where(np.abs(log.current) < LARGEST, log.current, np.nan))
    if not piece.is_run:
        return None, _reject(stretch, piece, log, robot=robot, options=options, clock=clock)
    current = log.current[:, piece.joints[0] - 1]
    # A current of 0 throughout is that of a motor that is off.
    measured = np.flatnonzero(np.isfinite(current) & np.nan_to_num(current).any())
    run = _run(stretch, piece, log, measured=measured, robot=robot, options=options) if len(measured) else None
    n_lost = len(log) - len(measured) if run else len(log)
    if not n_lost:
        return run and replace(run, clock=clock), None
    lost = replace(piece, label="no-current")
    reject = _reject(stretch, lost, log, robot=robot, options=options, clock=clock)
    text = _reason(lost, log, samples=n_lost, robot=robot, options=options)
    return run and replace(run, clock=clock), replace(reject, samples=n_lost, text=text)


def _reject(stretch: Stretch, piece: Piece, log: Log, *, robot: Robot, options: SegmentOptions, clock: int) -> Reject:
    """A piece that is no run; where something moved, with the means of all joints."""
    bins = None
    if piece.joints and stretch.motion is not None:
        starts, count = spans(log.time, options.reject_bins)
        time, ticks = mean_times(log.time, starts), stretch.motion.ticks.time
        bins = Means(
            count=count,
            time=time,
            position=finite_means(log.position, starts),
            velocity=np.column_stack([np.interp(time, ticks, column) for column in stretch.motion.velocity.T]),
            current=finite_means(log.current, starts),
        )
    return Reject(
        origin=log.origin,
        first_row=int(log.rows[0]),
        last_row=int(log.rows[-1]),
        start=float(log.time[0]),
        duration=float(log.time[-1] - log.time[0]),
        joints=piece.joints,
        reason=piece.label,
        text=_reason(piece, log, samples=len(log), robot=robot, options=options),
        samples=len(log),
        bins=bins,
        clock=clock,
    )


def _reason(piece: Piece, log: Log, *, samples: int, robot: Robot, options: SegmentOptions) -> str:
    """Why `samples` of a piece, whose log it is, are no run, in a sentence with its figures."""
    units = [robot.joint(joint).position_unit for joint in piece.joints] or ["rad"]
    return REASONS[piece.label].format(
        joints=", ".join(map(str, piece.joints)),
        first=piece.joints[0] if piece.joints else "",
        last=piece.joints[-1] if piece.joints else "",
        unit=units[0],
        last_unit=units[-1],
        figure=number(piece.figure, 3),
        duration=number(float(log.time[-1] - log.time[0]), 3),
        samples=samples,
        options=options,
    )


def _run(
    stretch: Stretch, piece: Piece, log: Log, *, measured: Ints, robot: Robot, options: SegmentOptions
) -> Run | None:
    """A run, `measured` of whose samples have a current; None of a stroke for which these are too few."""
    joint, part = piece.joints[0], log.part(measured)
    position, time = log.position[:, joint - 1], log.time
    if piece.label == STROKE:
        speed = float((position[-1] - position[0]) / max(time[-1] - time[0], 1e-12))
        bins = stroke_bins(log, joint, time=stretch.time[piece.start : piece.stop], window=piece.window)
        if bins is None:
            return None
    else:
        t = time - time.mean()
        speed = float(t @ (position - position.mean())) / max(float(t @ t), 1e-300)
        turns = abs(float(position[-1] - position[0])) / math.tau if robot.joint(joint).is_revolute else 0.0
        size = math.ceil(options.max_bins * min(max(turns, MANY_TURNS), MOST_TURNS) / MANY_TURNS)
        bins = _bins(part, joint, velocity=_velocity(stretch, piece)[measured], size=size)
    posture = part.position.mean(axis=0)
    posture[joint - 1] = np.nan
    warmth = np.full(1, np.nan) if part.temperature is None else part.temperature[:, joint - 1]
    return Run(
        joint=joint,
        kind=piece.label,
        origin=part.origin,
        first_row=int(part.rows[0]),
        last_row=int(part.rows[-1]),
        start=float(part.time[0]),
        duration=float(part.time[-1] - part.time[0]),
        posture=posture,
        span=(float(position[0]), float(position[-1])),
        speed=speed,
        ripple=float(np.std(bins.velocity)),
        temperature=float(finite_means(warmth, np.zeros(1, np.int64))[0]),
        samples=len(part),
        bins=bins,
        stamp_error=stretch.stamp_error,
    )


def _velocity(stretch: Stretch, piece: Piece) -> Floats:
    """(N,) velocity of a run's moving joint, from ticks inside the run only."""
    assert stretch.motion is not None
    ticks, time = stretch.motion.ticks, stretch.log.time[piece.start : piece.stop]
    low = int(np.searchsorted(ticks.edges, piece.start))
    high = int(np.searchsorted(ticks.edges, piece.stop, side="right")) - 1
    if high - low < 3:
        return np.full(len(time), piece.figure)
    inside = ticks.time[low:high]
    return np.interp(time, inside, slopes(inside, ticks.position[low:high, piece.joints[0] - 1], HALF))


def _bins(log: Log, joint: int, *, velocity: Floats, size: int) -> Bins:
    """At most `size` bins of samples with a current, and the joint's (N,) velocity."""
    starts, count = spans(log.time, size)
    sampled = log.current[:, joint - 1]
    current = finite_means(sampled, starts)
    temperature = np.full(len(log), np.nan) if log.temperature is None else log.temperature[:, joint - 1]
    return Bins(
        count=count,
        time=mean_times(log.time, starts),
        position=finite_means(log.position, starts),
        velocity=finite_means(velocity, starts),
        acceleration=np.zeros(len(starts)),
        current=current,
        variance=finite_means((sampled - np.repeat(current, count)) ** 2, starts),
        temperature=finite_means(temperature, starts),
        extra=None if log.extra is None else finite_means(log.extra, starts),
    )
