"""Pieces of a log as records: runs, strokes and blocks of any motion in bins, and what is left out with its reason."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from pumaid.dataset import BLOCK, CONSTANT, STROKE, Bins, Log, Reject, Run, arrays_of, finer, finite_means, spans
from pumaid.maths import Counts, Floats, pseudo_inverse
from pumaid.preprocessing.differentiate import Ticks, slopes, velocity
from pumaid.preprocessing.parallel_filter import (
    LONGEST_FILTERED,
    LONGEST_SHARE,
    SMEARED,
    about_line,
    bandwidth,
    cell_length,
    cells,
    position_noise,
    stroke_bins,
)
from pumaid.rigid_body import RigidBody
from pumaid.robot import Robot
from pumaid.units import number

#: Ticks on either side of the straight lines through a run's own ticks.
HALF = 2
#: Turns from which a run gets more bins, so that a ripple of 100 waves a turn is not averaged away, and the turns up to
#: which it does.
MANY_TURNS, MOST_TURNS = 2.0, 64.0

#: s; shortest and longest span of the local cubics; longer ones are calmer, and blunter at the acceleration's corners.
SHORTEST_FIT, LONGEST_FIT = 0.04, 0.4
#: Share of the movement's mean acceleration below which the noise of the smoothed one should stay.
CALM = 0.1
#: Share of a movement that a local cubic may span.
LARGEST_SHARE = 0.15
#: Blocks that a motion is cut into, and s that one lasts at least and about at most: long against the noise's memory.
BLOCKS, SHORTEST_BLOCK, LONGEST_BLOCK = 12, 2.0, 6.0
#: Cells of a joint in a block from which they say anything.
FEWEST_CELLS = 8

#: Numbers beyond it (rad, m, A) are garbage of a logger, no measurements.
LARGEST = 1e6


@dataclass(frozen=True, slots=True)
class SegmentOptions:
    """What counts as a run: every threshold of the segmentation.

    Speeds and lengths are in the joint's own unit: rad for a revolute joint, m for a prismatic one.
    """

    min_duration: float = 0.2  # s at constant speed; noise of currents is correlated over tens of milliseconds
    min_travel: float = 0.02  # rad or m; over less, gravity's sine and cosine cannot be told from a constant
    min_samples: int = 12  # of a run
    # Largest departure of the smoothed speed from its level, as a share; a sinusoid's top within 0.03 is a third of its
    # way, below `plateau_share`, so a sinusoid is never taken for a constant speed.
    speed_tolerance: float = 0.03
    plateau_share: float = 0.4  # of a movement's way, below which its constant part does not represent it: a stroke
    held_share: float = 0.02  # speed of a held joint, as a share of the moving joint's, up to which it counts as held
    held_drift: float = 0.02  # rad or m of a held joint during a run; 0.02 rad change a gravity load by 2 % at most
    rest_speed: float = 0.003  # rad/s or m/s, below which a joint is at rest
    low_speed_share: float = 0.05  # of its peak speed, below which a stroke's friction is not yet sliding
    cell: float | None = None  # s that a cell of a block lasts; None: as the encoder needs
    delay: float = 0.0  # s by which the currents of a row were drawn before its positions
    max_bins: int = 512  # of a run; of more than two turns, half as many for each turn
    # Samples held in memory at a time, many more than the next window sees again; a longer movement is cut.
    window: int = 131_072


#: All defaults.
DEFAULTS = SegmentOptions()

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
    """Samples [start, stop) of a stretch: a run or blocks, of which `label` is the kind, or left out for that reason.

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
        """Whether it is a run, or blocks."""
        return self.label in (CONSTANT, STROKE, BLOCK)


@dataclass(frozen=True, eq=False, slots=True)
class Stretch:
    """N consecutive samples without gaps, and their means over ticks of 20 ms.

    There are no ticks where samples are too few, or no numbers.
    """

    log: Log
    index: Counts  # (N,) their numbers in the window that they come from
    time: Floats  # (N,) s at which they were taken, which stamps need not be
    stamp_error: float = 0.0  # s, RMS by which the stamps differ from it
    ticks: Ticks | None = None


def record(
    stretch: Stretch, piece: Piece, robot: Robot, *, body: RigidBody, options: SegmentOptions, clock: int
) -> tuple[list[Run], Reject | None]:
    """The runs that a piece (not empty) of a stretch is, and what of it is left out; `clock` numbers the recording.

    `body` says what each joint feels in blocks.
    """
    log = stretch.log.part(slice(piece.start, piece.stop))
    if piece.is_run:
        log = replace(log, current=np.where(np.abs(log.current) < LARGEST, log.current, np.nan))
    runs, n_lost = [], len(log)
    if piece.label == BLOCK:
        runs = block_runs(log, stretch.time[piece.start : piece.stop], body, length=options.cell)
        n_lost *= not runs
        piece = replace(piece, label="several-joints" if len(piece.joints) > 1 else "speed-not-constant")
    elif piece.is_run:
        moving = log.current[:, piece.joints[0] - 1]
        # A current of 0 throughout is that of a motor that is off.
        measured = np.flatnonzero(np.isfinite(moving) & np.nan_to_num(moving).any())
        runs = _run_alone(stretch, piece, log, measured=measured, robot=robot, options=options) if len(measured) else []
        n_lost -= len(measured) * len(runs)
        piece = replace(piece, label="no-current")
    runs = [replace(run, clock=clock, stamp_error=stretch.stamp_error) for run in runs]
    if not n_lost:
        return runs, None
    duration = float(log.time[-1] - log.time[0])
    units = [robot.joint(joint).position_unit for joint in piece.joints] or ["rad"]
    text = REASONS[piece.label].format(
        joints=", ".join(map(str, piece.joints)),
        first=piece.joints[0] if piece.joints else "",
        last=piece.joints[-1] if piece.joints else "",
        unit=units[0],
        last_unit=units[-1],
        figure=number(piece.figure, 3),
        duration=number(duration, 3),
        samples=n_lost,
        options=options,
    )
    rows, start = (int(log.rows[0]), int(log.rows[-1])), float(log.time[0])
    return runs, Reject(log.origin, *rows, start, duration, piece.joints, piece.label, text, n_lost, clock=clock)


def _run(part: Log, bins: Bins, joint: int, *, position: Floats, kind: str, **more: Any) -> Run:
    """Samples of a log as a run of a joint; `position` (N, J) has the posture as its mean, `more` are other fields."""
    posture = position.mean(axis=0)
    posture[joint - 1] = np.nan
    return Run(
        joint=joint,
        kind=kind,
        origin=part.origin,
        first_row=int(part.rows[0]),
        last_row=int(part.rows[-1]),
        start=float(part.time[0]),
        duration=float(part.time[-1] - part.time[0]),
        posture=posture,
        ripple=float(np.std(bins.velocity)),
        temperature=float(finite_means(bins.temperature, np.zeros(1, np.int64), bins.count)[0]),
        bins=bins,
        **more,
    )


def _run_alone(
    stretch: Stretch, piece: Piece, log: Log, *, measured: Counts, robot: Robot, options: SegmentOptions
) -> list[Run]:
    """The run of one joint that a piece is, `measured` of whose samples have a current; none where too few have."""
    joint, part = piece.joints[0], log.part(measured)
    position, time = log.position[:, joint - 1], log.time
    if piece.label == STROKE:
        speed = float((position[-1] - position[0]) / max(time[-1] - time[0], 1e-12))
        bins: Bins | None = stroke_bins(log, joint, time=stretch.time[piece.start : piece.stop], window=piece.window)
    else:
        t = time - time.mean()
        speed = float(t @ (position - position.mean())) / max(float(t @ t), 1e-300)
        turns = abs(float(position[-1] - position[0])) / math.tau if robot.joint(joint).is_revolute else 0.0
        size = math.ceil(options.max_bins * min(max(turns, MANY_TURNS), MOST_TURNS) / MANY_TURNS)
        bins = _constant_bins(stretch, piece, part, size=size)
    if bins is None:
        return []
    span = (float(position[0]), float(position[-1]))
    return [
        _run(part, bins, joint, position=part.position, kind=piece.label, span=span, speed=speed, samples=len(part))
    ]


def _constant_bins(stretch: Stretch, piece: Piece, log: Log, *, size: int) -> Bins:
    """At most `size` bins of a run's samples with a current; velocity is that of ticks inside the run only."""
    assert stretch.ticks is not None
    ticks, joint = stretch.ticks, piece.joints[0] - 1
    low = int(np.searchsorted(ticks.edges, piece.start))
    high = int(np.searchsorted(ticks.edges, piece.stop, side="right")) - 1
    velocity = np.full(len(log), piece.figure)
    if high - low >= 3:
        inside = ticks.time[low:high]
        velocity = np.interp(log.time, inside, slopes(inside, ticks.position[low:high, joint], HALF))
    starts, count = spans(log.time, size)
    current = finite_means(log.current[:, joint], starts)
    return Bins(
        count=count,
        time=log.time[0] + finite_means(log.time - log.time[0], starts),  # seconds since 1970 would lose digits
        position=finite_means(log.position, starts),
        velocity=finite_means(velocity, starts),
        acceleration=np.zeros(len(starts)),
        current=current,
        variance=finite_means((log.current[:, joint] - np.repeat(current, count)) ** 2, starts),
        temperature=np.full(len(starts), np.nan)
        if log.temperature is None
        else finite_means(log.temperature[:, joint], starts),
        extra=None if log.extra is None else finite_means(log.extra, starts),
    )


def sliding(
    time: Floats, position: Floats, bounds: tuple[int, int], *, noise: float, options: SegmentOptions
) -> tuple[int, int, float, float]:
    """Where a movement's speed is above the share of its peak that `options` ask for.

    The movement, samples [start, stop) of `bounds`, goes upwards; `noise` (rad or m) is the standard deviation of one
    of the (N,) positions. Returned are samples [start, stop), the span (s) of the local cubics by which speed is taken,
    and its peak.
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
    speed = velocity(time[low:high], position[low:high], window)[start - low : stop - low]
    peak = float(speed.max(initial=0.0))
    fast = np.flatnonzero(speed > max(options.rest_speed, options.low_speed_share * peak))
    return (start + int(fast[0]), start + int(fast[-1]) + 1, window, peak) if len(fast) else (start, start, window, 0.0)


def block_runs(log: Log, time: Floats, body: RigidBody, *, length: float | None = None) -> list[Run]:
    """A piece of any motion as blocks, each a run of every joint that moves and draws current in it.

    `time` (N,) s is when its samples were taken, `length` (s) that of a cell, where not as the encoder needs.
    """
    current = np.where(np.nan_to_num(log.current).any(axis=0), log.current, np.nan)
    noise = np.array([position_noise(column) for column in log.position.T])
    duration = float(time[-1] - time[0])
    band = bandwidth(current, duration / max(len(time) - 1, 1))
    shortest = cell_length(time, log.position, noise)
    wanted = min(SMEARED / band, LONGEST_FILTERED, LONGEST_SHARE * duration)
    table = cells(time, log.position, current, body=body, length=length or max(shortest, wanted))
    if table is None:
        return []
    count = max(int(duration / min(max(duration / BLOCKS, SHORTEST_BLOCK), LONGEST_BLOCK)), 1)
    edges = np.linspace(time[0], time[-1], count + 1)
    sample = np.clip(np.searchsorted(time, edges), 0, len(time) - 1).tolist()
    runs, blocks = [], dict[int, list[Bins]]()
    n_columns, beside = table.columns[0].shape[1], np.searchsorted(time, table.time)
    for k in np.flatnonzero(np.isfinite(table.current).sum(axis=0) >= FEWEST_CELLS).tolist():
        cells_of_joint = Bins(
            count=np.full(len(beside), table.width),
            time=table.time,
            position=table.position,
            velocity=table.velocity[:, k],
            acceleration=table.acceleration[:, k],
            current=table.current[:, k],
            variance=table.variance[:, k],
            temperature=np.full(len(beside), np.nan) if log.temperature is None else log.temperature[beside, k],
            extra=None if log.extra is None else log.extra[beside],
            velocities=table.velocity,
            rigid_body=np.pad(table.columns[k], ((0, 0), (n_columns - table.columns[k].shape[1], 0))),
        )
        blocks[k + 1] = _blocks(cells_of_joint, k + 1, table.parts[k], edges[1:-1])
    for place, (first, last) in enumerate(pairwise(sample)):
        part = log.part(slice(first, last + 1))
        for joint, bins in ((joint, those[place]) for joint, those in blocks.items()):
            if len(bins) >= FEWEST_CELLS:
                moving, speed = bins.position[:, joint - 1], float(np.sqrt(np.mean(bins.velocity**2)))
                runs.append(
                    _run(
                        part,
                        bins,
                        joint,
                        position=bins.position,
                        band=band * (wanted > shortest),
                        kind=BLOCK,
                        span=(float(moving.min()), float(moving.max())),
                        speed=speed,
                        samples=round(float(bins.count.sum())),
                    )
                )
    return runs


#: What a part of a cell counts beside the cell where motion is fitted to cells: enough where these hardly show it.
FAINT = 1e-4


def _blocks(bins: Bins, joint: int, parts: Floats, edges: Floats) -> list[Bins]:
    """Of M cells those with a current, in blocks that `edges` (s) part, with (M, k, 2) `parts` in the same motion."""

    def chosen(bins: Bins, rows: Counts) -> Bins:
        return Bins(**{name: values[rows] for name, values in arrays_of(bins).items()})

    def regressors(bins: Bins) -> Floats:
        return np.column_stack([bins.velocity, np.sign(bins.velocity), np.ones(len(bins)), np.asarray(bins.rigid_body)])

    rows, k = np.flatnonzero(np.isfinite(bins.current)), parts.shape[1]
    inner, table = chosen(bins, rows), np.pad(parts, ((0, 0), (0, 0), (0, 1)))
    split = np.split(np.arange(len(rows)), np.searchsorted(inner.time, edges))
    if k == 1:
        return [chosen(inner, part) for part in split]
    cells, fine = regressors(inner), regressors(finer(replace(bins, parts=table.reshape(-1, 3)), joint))
    fine = fine.reshape(len(bins), -1)[rows].reshape(-1, cells.shape[1])
    # What cells hardly show, as where few joints move, they would fit to noise: there the parts tell it.
    square, slope = cells.T @ cells + FAINT * (fine.T @ fine), cells.T @ inner.current
    values = pseudo_inverse(square)[0] @ (slope + FAINT * (fine.T @ parts[rows, :, 0].ravel()))
    missed, table = parts[rows, :, 0] - (fine @ values).reshape(-1, k), table[rows]
    # Polynomials end where blocks do, as at a gap.
    apart = np.ptp(inner.time) * np.searchsorted(edges, inner.time, side="right")
    design = regressors(finer(replace(inner, time=inner.time + apart, parts=table.reshape(-1, 3)), joint))
    missed -= (design @ (pseudo_inverse(design.T @ design)[0] @ (design.T @ missed.ravel()))).reshape(-1, k)
    # In cells variance is about a straight line, and the filter took some of the mean square of that line.
    between, within = about_line(missed), np.maximum(inner.variance - about_line(table[..., 0]), 0.0)
    more = np.mean(missed**2) - np.mean(between + (inner.current - cells @ values) ** 2)
    table[..., 0], table[..., 2] = (design @ values).reshape(-1, k) + missed, within[:, None]
    inner = replace(inner, variance=within + between + max(float(more), 0.0))
    return [replace(chosen(inner, part), parts=table[part].reshape(-1, 3)) for part in split]
