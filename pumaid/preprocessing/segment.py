"""One pass over samples: rest, one joint at constant velocity, a stroke, or left out; in memory of bounded size.

Joints are told at rest from moving, and movements at constant velocity from others, by velocities at ticks of 20 ms.
Any other motion is left out as a piece whose bins hold the means of all joints.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from operator import itemgetter

import numpy as np

from pumaid.dataset import BLOCK, CONSTANT, STROKE, Dataset, Log, Reject, Run, coarser
from pumaid.errors import Note, Where
from pumaid.maths import Counts, Flags, Floats
from pumaid.preprocessing.binning import DEFAULTS, LARGEST, Piece, SegmentOptions, Stretch, record, sliding
from pumaid.preprocessing.clock import sampling_times
from pumaid.preprocessing.differentiate import Ticks, round_half_up, slopes, usual_step
from pumaid.preprocessing.parallel_filter import LONGEST_FILTERED, SMEARED
from pumaid.rigid_body import base_parameters
from pumaid.robot import Robot

#: Samples before the last movement of a window that the next window sees again.
CONTEXT = 1024
#: Bins of all runs together (some 100 bytes each for six joints), those of all blocks (five times as large, and a fit
#: takes all of them: a quarter of an hour as it is, an hour at 6 Hz), and those that a run keeps in any case.
RUN_BINS, BLOCK_BINS, FEWEST_BINS = 1_500_000, 150_000, 16

#: A time step above so many usual ones, and above so many seconds, is a gap.
GAP_STEPS, GAP_TIME = 5.0, 0.05
#: s from sample to sample over which missing positions are bridged, and samples on either side by which they are.
BRIDGED, BESIDE = 0.1, 4
#: Fewest samples from which a speed can be taken.
FEWEST = 6
#: Codes of a tick beside +joint and -joint; where the data end.
REST, SEVERAL, END_OF_DATA = 0, 1_000_000, 2_000_000
#: Standard deviations of a speed that count as surely moving (one false alarm in about 1e5 ticks).
SURE = 4.5
#: s; a shorter motion of one joint between motions of several is a chance: the others just turn back.
LONE = 1.0

#: s; least motion of a recording that is taken as blocks, and of each of its moves; least of a move where a tenth of
#: all is runs, between which shorter ones lead. The longest pause that does not part motion in two.
LEAST_MOTION, LEAST_MOVE, LEAST_BESIDE, TENTH, PAUSE = 4.0, 0.5, 12.0, 0.1, 2.0

#: s; longest straight line by which the speed of a slow or noisy movement is judged.
LONGEST_LINE = 1.0
#: Standard deviations of the smoothed speed allowed beside the tolerance.
SPREAD = 3.0
#: Departure from a speed, in units of the tolerance, that does not end a run where the same speed goes on behind it.
HICCUP = 3.0
#: Share of a movement's largest acceleration above which an end of a constant velocity is a ramp's, and s of each end
#: in which that is looked for.
SETTLED, END = 0.002, 0.5
#: s dropped at the beginning of a constant velocity, where the speed still settles, and at its end, where the onset of
#: a ramp hides in the tolerance.
SETTLING, LEAVING = 0.08, 0.04
#: Share of a movement's largest acceleration above which a steady speed is a slow ramp.
RAMPING = 0.25


def segment(
    logs: Iterable[Log],
    robot: Robot,
    *,
    options: SegmentOptions = DEFAULTS,
    watch: Callable[[Log], None] = lambda log: None,
) -> Dataset:
    """Find the stretches in which one joint moves alone, and reduce each to bins.

    Speed is taken from position. A movement of one joint yields its stretches of constant velocity; where they are too
    small a part of it and it goes from rest to rest, all of it is a stroke. The rest is left out, with its reason.
    A run ends where a file ends.

    `logs` are consecutive batches, SI; their `starts_clock` begins a new recording, and the iterable's attributes
    `files`, `notes` and `extra`, if any, are taken over; `watch` is called with each batch. Runs and rejects are in
    order of time and together hold every sample once.
    """
    body, options = base_parameters(robot), replace(options, delay=robot.log.delay)
    runs: list[Run] = []
    rejects: list[Reject] = []
    for (clock, _), batches in groupby(_by_recording(logs, robot.n_joints, watch), key=itemgetter(0)):
        for stretch, pieces in _windows((log for _, log in batches), options):
            before = Piece(0, 0, "")
            for piece in pieces:
                made, reject = record(stretch, piece, robot, body=body, options=options, clock=clock)
                runs += [replace(run, lead=_lead(stretch, before, run)) for run in made]
                rejects += [reject] if reject else []
                before = piece
            runs = bounded(runs)
    rejects.sort(key=lambda item: (item.clock, item.start, item.first_row))
    files, notes, extra = (tuple(getattr(logs, name, ())) for name in ("files", "notes", "extra"))
    moved = [run for run in runs if run.stamp_error > 0.0]
    if moved:
        error = 1e3 * math.sqrt(sum(run.stamp_error**2 for run in moved) / len(moved))
        text = (
            f"in {len(moved)} of {len(runs)} runs the positions show that samples were taken more evenly than their"
            f" time stamps say, which are {error:.2g} ms RMS off; an even clock is used for them. If you can, log the"
            " instant of sampling in microseconds"
        )
        notes = (*notes, Note("clock-evened", text, Where(file=moved[0].origin, row=moved[0].first_row)))
    if filtered := [run for run in runs if run.band > 0.0]:
        band = min(run.band for run in filtered)
        text = (
            f"currents hold next to nothing beyond {band:.2g} Hz, as filtered ones do: cells are longer for it, and"
            " friction near where a joint turns round is blurred all the same. Log them unfiltered"
        )
        if SMEARED / band > LONGEST_FILTERED:
            text += ": so little is left that intervals may not hold the truth, nor names of what is missing"
        notes = (*notes, Note("current-filtered", text, Where(file=filtered[0].origin)))
    return Dataset(tuple(runs), tuple(rejects), files, notes, extra)


def bounded(runs: list[Run]) -> list[Run]:
    """The runs, the longest in half as many bins, or a quarter, or less, where all have more than `RUN_BINS`, or those
    of blocks more than `BLOCK_BINS`; each keeps `FEWEST_BINS`.
    """
    for is_block, allowed in ((False, RUN_BINS), (True, BLOCK_BINS)):
        sizes = np.array([len(run.bins) * ((run.kind == BLOCK) == is_block) for run in runs], dtype=int)
        limit = int(sizes.max(initial=0))
        while np.minimum(sizes, limit).sum() > allowed and limit > FEWEST_BINS:
            limit = max(FEWEST_BINS, limit // 2)
        shortened = {k: coarser(runs[k].bins, limit) for k in np.flatnonzero(sizes > limit).tolist()}
        runs = [replace(run, bins=shortened[k]) if k in shortened else run for k, run in enumerate(runs)]
    return runs


def _by_recording(
    logs: Iterable[Log], n_joints: int, watch: Callable[[Log], None]
) -> Iterator[tuple[tuple[int, str], Log]]:
    clock, has_begun = 0, False
    for log in logs:
        if not isinstance(log, Log):
            raise TypeError(f"{str(log)[:40]!r} is no samples; of files: pumaid.segment(FILES, recipe=FILE)")
        watch(log)
        if log.position.shape[1] != n_joints:
            raise ValueError(f"{log.origin} has {log.position.shape[1]} joints, the robot has {n_joints}")
        clock += log.starts_clock and has_begun
        if len(log):
            has_begun = True
            yield (clock, log.origin), log


def _windows(batches: Iterable[Log], options: SegmentOptions) -> Iterator[tuple[Stretch, list[Piece]]]:
    """Stretches of one file's batches with their pieces, a window of samples at a time; every sample in one piece."""
    waiting: list[Log] = []
    context = 0  # samples at the front whose pieces were given before
    for batch in batches:
        waiting.append(batch)
        while sum(map(len, waiting)) >= options.window:
            joined = Log.joined(waiting)
            parts, cut = _clipped(joined.part(slice(0, options.window)), context, options, ends=False)
            yield from parts
            # The last movement is looked at again with what follows it, unless it fills half of the window.
            context = min(CONTEXT, cut // 2) if cut < options.window else 0
            waiting = [joined.part(slice(cut - context, None))]
    yield from _clipped(Log.joined(waiting), context, options, ends=True)[0]


def _clipped(
    log: Log, context: int, options: SegmentOptions, *, ends: bool
) -> tuple[list[tuple[Stretch, list[Piece]]], int]:
    """Stretches with their pieces from `context` up to the last movement, or to the end; and where that is."""
    parts = list(stretches(log, options))
    last = max((int(stretch.index[start]) for stretch, _, start in parts), default=0)
    cut = last if len(log) // 2 < last and not ends else len(log)
    out = []
    for stretch, pieces, _ in parts:
        low, high = np.searchsorted(stretch.index, [context, cut]).tolist()
        clipped = (replace(piece, start=max(piece.start, low), stop=min(piece.stop, high)) for piece in pieces)
        out.append((stretch, [piece for piece in clipped if piece.stop > piece.start]))
    return out, cut


def _lead(stretch: Stretch, before: Piece, run: Run) -> float:
    """What the joint of a run had travelled (rad or m) while it sped up, in the piece before; 0 if unknown."""
    if before.is_run or before.joints != (run.joint,):
        return 0.0
    # From the farthest that the ramp reaches back.
    back = run.direction * (run.span[0] - stretch.log.position[slice(before.start, before.stop), run.joint - 1])
    return max(float(back.max()), 0.0)


def stretches(log: Log, options: SegmentOptions) -> Iterator[tuple[Stretch, list[Piece], int]]:
    """Gapless stretches of consecutive samples of one recording, cut into pieces that hold every sample once.

    With the sample at which the last movement of the stretch begins, 0 where nothing is known of movements.
    """
    log = _bridged(log)
    good = np.isfinite(log.time) & (np.abs(log.position) < LARGEST).all(axis=1)
    bad, index = np.flatnonzero(~good), np.flatnonzero(good)
    time = log.time[index]
    steps = np.diff(time)
    broken = (steps > max(GAP_STEPS * usual_step(time), GAP_TIME)) | (steps <= 0)
    apart = [np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1), np.split(index, np.flatnonzero(broken) + 1)]
    for part in filter(len, (part for parts in apart for part in parts)):
        samples = log.part(part)
        if len(part) >= FEWEST and good[part[0]]:
            sampled, error = sampling_times(samples.time, samples.position, samples.repeats)
            if options.delay:
                then = [np.interp(sampled - options.delay, sampled, column) for column in samples.position.T]
                samples = replace(samples, position=np.column_stack(then))
            ticks = Ticks(sampled, samples.position)
            velocity, moving = _moving(ticks, options)
            fastest, count = np.abs(velocity).argmax(axis=1), moving.sum(axis=1)
            signed = np.where(velocity[np.arange(len(velocity)), fastest] > 0, 1, -1) * (fastest + 1)
            code = np.select([count == 0, count == 1], [REST, signed], SEVERAL)
            stretch = Stretch(samples, part, sampled, error, ticks)
            pieces, last = _pieces(stretch, ticks, code, moving=moving, options=options)
            yield stretch, _with_blocks(pieces, sampled), last
        else:
            label = "gap" if good[part[0]] else "not-a-number"
            yield Stretch(samples, part, samples.time), [Piece(0, len(part), label)], 0


def _bridged(log: Log) -> Log:
    """With positions that are missing for a moment on a cubic through the samples about them, and no current there."""
    missing = np.isnan(log.position)
    if not missing.any():
        return log
    bad, position, current = np.flatnonzero(missing.any(axis=1)), log.position.copy(), log.current.copy()
    for burst in np.split(bad, np.flatnonzero(np.diff(bad) > 1) + 1):
        first, after = int(burst[0]), int(burst[-1]) + 1
        near = np.r_[first - BESIDE : first, after : after + BESIDE]
        if near[0] < 0 or near[-1] >= len(log) or log.time[after] - log.time[first - 1] > BRIDGED:
            continue
        since, there = log.time[near] - log.time[first], log.position[near]
        if np.isfinite(since).all() and (np.abs(there) < LARGEST).all():
            for joint in np.flatnonzero(missing[burst].any(axis=0)):
                lost = burst[missing[burst, joint]]
                position[lost, joint] = np.polynomial.Polynomial.fit(since, there[:, joint], 3)(
                    log.time[lost] - log.time[first]
                )
            current[burst] = np.nan
    return replace(log, position=position, current=current)


def _moving(ticks: Ticks, options: SegmentOptions) -> tuple[Floats, Flags]:
    """(K, J) velocities, and which joints move.

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
    return velocity, speed > np.maximum(floor, options.held_share * speed.max(axis=1)[:, None])


def _pieces(
    stretch: Stretch, ticks: Ticks, code: Counts, *, moving: Flags, options: SegmentOptions
) -> tuple[list[Piece], int]:
    """Runs and left-out pieces of a stretch in order, neighbours that are left out for the same reason as one.

    With the sample at which the last movement begins: ticks of one code.
    """
    out: list[Piece] = []
    borders = [0, *(np.flatnonzero(np.diff(code)) + 1).tolist(), len(code)]
    codes: list[int] = [END_OF_DATA, *code[borders[:-1]].tolist(), END_OF_DATA]
    for k, (first, last) in enumerate(pairwise(borders)):
        start, stop = ticks.edges[[first, last]].tolist()
        counts = moving[first:last].sum(axis=0)
        joints = tuple(int(j) + 1 for j in np.argsort(-counts, kind="stable") if counts[j])
        pieces = [Piece(start, stop, "rest")]
        if codes[k + 1] == SEVERAL:
            pieces = [Piece(start, stop, "several-joints", joints)]
        elif codes[k + 1] != REST:
            pieces = _of_movement(stretch, ticks, (first, last), codes=codes[k : k + 3], options=options)
        for piece in pieces:
            if out and not piece.is_run and out[-1].label == piece.label:
                joints = tuple(dict.fromkeys((*out[-1].joints, *piece.joints)))
                out[-1] = replace(out[-1], stop=piece.stop, joints=joints, figure=max(out[-1].figure, piece.figure))
            else:
                out.append(piece)
    return out, int(ticks.edges[borders[-2]])


def _of_movement(
    stretch: Stretch, ticks: Ticks, bounds: tuple[int, int], *, codes: Sequence[int], options: SegmentOptions
) -> list[Piece]:
    """Runs and left-out pieces of a movement of one joint; a run is left out where a held joint went too far.

    The movement, ticks [first, last) of `bounds`, has the second of three codes; the others are those on either side.
    """
    before, code, after = codes
    joint, time = abs(code), stretch.time
    start, stop = ticks.edges[list(bounds)].tolist()
    position = stretch.log.position[:, joint - 1]

    def way(part: Piece) -> float:
        return abs(float(position[part.stop - 1] - position[part.start]))

    def is_long(part: Piece) -> bool:
        is_lasting = time[part.stop - 1] - time[part.start] >= options.min_duration
        return part.stop - part.start >= options.min_samples and is_lasting and way(part) >= options.min_travel

    whole, duration = Piece(start, stop, "ramp", (joint,)), float(time[stop - 1] - time[start])
    whole = replace(whole, figure=way(whole))
    if whole.figure < options.rest_speed * options.min_duration:
        return [Piece(start, stop, "rest")]
    if before == after == SEVERAL and duration < LONE:
        return [replace(whole, label="between-several")]
    constant = _constant_velocities(ticks, bounds, joint, options)
    runs = [run for run in constant if is_long(run)]
    is_whole = END_OF_DATA not in (before, after)
    if not runs or (is_whole and sum(map(way, runs)) < options.plateau_share * whole.figure):
        runs, label = [], "too-short" if constant or duration < 2 * options.min_duration else "speed-not-constant"
        whole = replace(whole, label=label)
        if is_whole and {before, after} <= {REST, -code} and way(whole) >= options.min_travel:
            noise = float(ticks.noise[joint - 1]) * float(ticks.edges[1] - ticks.edges[0]) ** 0.5
            sign = float(np.sign(code))
            first, last, window, peak = sliding(time, sign * position, (start, stop), noise=noise, options=options)
            stroke = Piece(first, last, STROKE, (joint,), figure=sign * peak, window=window)
            runs = [stroke] if is_long(stroke) else []
            whole = replace(whole, label="low-speed", figure=peak) if runs else replace(whole, label="too-short")
    out, at = [], start
    for run in runs:
        low, high = np.searchsorted(ticks.edges, [run.start, run.stop])
        held = ticks.position[[low, max(high - 1, low)]]
        drift = np.where(np.arange(held.shape[1]) == joint - 1, 0.0, np.abs(held[1] - held[0]))
        out.append(replace(whole, start=at, stop=run.start))
        if drift.max() > options.held_drift:
            joints = (joint, int(np.argmax(drift)) + 1)
            run = replace(run, label="drift-of-held-joint", joints=joints, figure=float(drift.max()))
        out.append(run)
        at = run.stop
    return [piece for piece in (*out, replace(whole, start=at)) if piece.stop > piece.start]


def _with_blocks(pieces: list[Piece], time: Floats) -> list[Piece]:

    def seconds(chosen: Iterable[Piece]) -> float:
        return sum(float(time[piece.stop - 1] - time[piece.start]) for piece in chosen)

    moving = [piece for piece in pieces if piece.joints]
    has_runs = seconds(piece for piece in moving if piece.is_run) > TENTH * seconds(moving)
    if not has_runs and seconds(moving) < LEAST_MOTION:
        return pieces
    least = LEAST_BESIDE if has_runs else LEAST_MOVE

    out: list[Piece] = []
    for is_border, group in groupby(pieces, lambda p: p.is_run or (not p.joints and seconds([p]) > PAUSE)):
        part = list(group)
        active = [k for k, piece in enumerate(part) if piece.joints]
        if is_border or seconds(part[k] for k in active) < least:
            out += part
            continue
        first, last = active[0], active[-1]
        joints = sorted({joint for k in active for joint in part[k].joints})
        out += [*part[:first], Piece(part[first].start, part[last].stop, BLOCK, tuple(joints)), *part[last + 1 :]]
    return out


def _constant_velocities(ticks: Ticks, bounds: tuple[int, int], joint: int, options: SegmentOptions) -> list[Piece]:
    """Every stretch of constant velocity of a joint's movement, ticks [begin, end) of `bounds`, in order of time.

    Ticks whose speed, smoothed as little as noise allows, stays within the tolerance of its median, less those at the
    ends to whose velocity a ramp may contribute.
    """
    begin, end = bounds
    position, time = ticks.position[:, joint - 1], ticks.time[begin:end]
    duration = max(ticks.interval, float(time[-1] - time[0]))
    typical = abs(float(position[end - 1] - position[begin])) / duration
    longest = min(LONGEST_LINE, 0.25 * len(time) * ticks.interval)
    half = ticks.half_width(joint, options.speed_tolerance * typical / SPREAD, longest)
    low, high = max(0, begin - half), min(len(ticks.time), end + half)
    velocity = slopes(ticks.time[low:high], position[low:high], half)[begin - low : end - low]
    speed, acceleration, error = np.abs(velocity), slopes(time, velocity, 1), ticks.slope_error(joint, half)
    peak = float(np.abs(acceleration).max())
    negligible = max(SETTLED * peak, SURE * error / (2.0**0.5 * ticks.interval))
    reach = max(1, round_half_up(0.7 * options.min_duration / ticks.interval))
    runs = []
    for start, stop in _steady(speed, reach, share=options.speed_tolerance, error=SPREAD * error):
        inside = np.abs(acceleration[start:stop])
        quarter, size = len(inside) // 4, min(round_half_up(END / ticks.interval), len(inside) // 3)
        # Ends that accelerate: surely above 1.48 medians (the spread) of the middle half.
        far = inside > max(negligible, SURE * 1.48 * float(np.median(inside[quarter : len(inside) - quarter])))
        front, back = (int(np.flatnonzero(end).max(initial=-1)) + 1 for end in (far[:size], far[::-1][:size]))
        first, last = start + front, stop - back
        # Where the data begin or end there is no ramp.
        if begin + start > 0:
            first = max(first, start + round_half_up(SETTLING / ticks.interval))
        if begin + stop < len(ticks.time):
            last = min(last, stop - round_half_up(LEAVING / ticks.interval))
        if last - first < 2:
            continue
        level, x = float(np.median(velocity[first:last])), time[first:last] - time[first:last].mean()
        if abs(float(x @ velocity[first:last] / (x @ x))) <= RAMPING * peak:
            low, high = ticks.edges[[begin + first, begin + last]].tolist()
            runs.append(Piece(low, high, CONSTANT, (joint,), figure=level))
    return runs


def _steady(speed: Floats, reach: int, *, share: float, error: float) -> list[tuple[int, int]]:
    """Tick ranges longer than `reach` with the speed near its median; with a hiccup between them they are joined."""
    if len(speed) <= reach:
        return []
    half = reach // 2
    around = np.lib.stride_tricks.sliding_window_view(np.pad(speed, half, mode="edge"), 2 * half + 1)
    waiting = [
        (max(0, a - half), min(len(speed), b + half))
        for a, b in _true_ranges(np.ptp(around, axis=1) <= 2.0 * (share * speed + error))
    ]
    cores = []
    while waiting:
        a, b = waiting.pop()
        level = float(np.median(speed[a:b]))
        inside = _true_ranges(np.abs(speed[a:b] - level) <= share * level + error)
        if inside:
            first, last = max(inside, key=lambda part: part[1] - part[0])
            waiting += [part for part in ((a + last, b), (a, a + first)) if part[1] - part[0] > reach]
            cores.append((a + first, a + last))
    out: list[tuple[int, int]] = []
    for start, stop in sorted(cores):
        begin, end = out[-1] if out else (start, stop)
        level = float(np.median(speed[begin:end]))
        hiccup = np.abs(speed[end:start] - level).max(initial=0.0) / HICCUP
        away = max(abs(float(np.median(speed[start:stop])) - level), hiccup)
        if out and away <= share * level + error and start - end <= max(end - begin, stop - start):
            out[-1] = (begin, stop)
        else:
            out.append((start, stop))
    return out


def _true_ranges(values: Flags) -> list[tuple[int, int]]:
    """[start, stop) of every run of true values."""
    borders = np.flatnonzero(np.diff(values.astype(np.int8), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in borders.reshape(-1, 2)]
