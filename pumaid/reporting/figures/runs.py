"""Runs over time: those found in logs, and those of a plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pumaid.dataset import Dataset, Reject, Run
from pumaid.reporting.figures.style import (
    BACKWARD,
    FAINT,
    FORWARD,
    GREY,
    PALETTE,
    TINT,
    Drawing,
    clock_shifts,
    heading,
    legend,
    zero_line,
)
from pumaid.reporting.formatting import in_unit
from pumaid.reporting.run_tables import by_reason, counted_runs, planned_postures, samples_read
from pumaid.robot import Robot
from pumaid.trajectory import Plan

Floats = NDArray[np.float64]

#: Runs of the report's figure; runs in one strip of a figure, and strips.
MOST_RUNS, RUNS_A_STRIP, MOST_STRIPS = 72, 36, 8
#: Points of one run or reject; gap between recordings with separate clocks, as a share of their whole time.
MOST_POINTS, GAP = 48, 0.01
#: Reason of rejection -> hatch; stretches at rest are left white.
HATCHES = {"rest": "", "ramp": "////", "several-joints": "xxxx", "speed-not-constant": "\\\\\\\\", "low-speed": "||||"}


def run_figure(dataset: Dataset, robot: Robot, units: str = "rad") -> Drawing:
    """Velocity and position against time, with runs in their joint's colour."""
    caption = "Velocity and position against time: runs in their joint's colour, strokes dashed, the rest hatched."
    return Drawing("segments", "Runs found in the logs", caption, partial(draw_runs, dataset, robot, units=units))


def beginning(dataset: Dataset) -> Dataset:
    """The dataset up to run number `MOST_RUNS`."""
    if len(dataset.runs) <= MOST_RUNS:
        return dataset
    runs = dataset.runs[:MOST_RUNS]
    last = runs[-1]
    earlier = {run.origin for run in runs} - {last.origin}
    rejects = [r for r in dataset.rejects if r.origin in earlier or (r.origin == last.origin and r.start < last.start)]
    return replace(dataset, runs=runs, rejects=tuple(rejects))


def draw_runs(dataset: Dataset, robot: Robot, *, units: str = "rad") -> Figure:
    """One strip, or several for a long campaign; recordings without a common clock follow one another."""
    items: list[Run | Reject] = [*dataset.runs, *dataset.rejects]
    shifts = clock_shifts(items, GAP)
    count = max(1, min(MOST_STRIPS, math.ceil(len(dataset.runs) / RUNS_A_STRIP)))
    figure = Figure(figsize=(12.0, (4.6 if count == 1 else 2.5) * count + 0.9), layout="constrained")
    panels = figure.subplots(2 * count, 1, squeeze=False, height_ratios=(3, 2) * count)[:, 0]
    total = max((shifts[item.clock] + item.start + item.duration for item in items), default=1.0)
    borders = np.linspace(0.0, max(total, 1e-9), count + 1)
    scale = np.array([in_unit(joint.position_unit, units)[0] for joint in robot.joints])
    names = dict.fromkeys(in_unit(joint.position_unit, units)[1] for joint in robot.joints)
    for (above, below), start, stop in zip(panels.reshape(-1, 2), borders[:-1], borders[1:], strict=True):
        for item in items:
            begin = shifts[item.clock] + item.start
            if begin <= stop and begin + item.duration >= start:
                _item((above, below), item, shift=shifts[item.clock], scale=scale)
        zero_line(above)
        above.tick_params(labelbottom=False)
        above.set_ylabel(f"velocity ({' or '.join(f'{name}/s' for name in names)})")
        below.set_ylabel(f"position ({' or '.join(names)})")
        for axes in (above, below):
            axes.set_xlim(start, stop)
            axes.margins(y=0.08)
            axes.autoscale_view(scalex=False)
    panels[-1].set_xlabel("time (s)")
    legend(figure, _run_handles(dataset, robot), 6)
    read = max(1, samples_read(dataset))
    used = read - sum(reject.samples for reject in dataset.rejects)
    heading(figure, f"{robot.name}: {counted_runs(dataset.runs)}; {100 * used / read:.0f} % of {read:,} samples used")
    return figure


def _item(both: tuple[Axes, Axes], item: Run | Reject, *, shift: float, scale: Floats) -> None:
    """Velocity (above) and position (below) of one run, with the joints that it holds, or of one rejected stretch."""
    above, below = both
    is_run, joints = isinstance(item, Run), [item.joint] if isinstance(item, Run) else item.joints
    if isinstance(item, Reject) and item.reason != "rest":
        hatch = HATCHES.get(item.reason, "....")
        for axes in both:
            start = item.start + shift
            look: dict[str, Any] = {"facecolor": TINT, "edgecolor": FAINT, "hatch": hatch, "linewidth": 0.0}
            axes.axvspan(start, start + item.duration, zorder=0.5, **look)
    if item.bins is None:
        return
    step = max(1, len(item.bins) // MOST_POINTS)
    time, position = item.bins.time[::step] + shift, item.bins.position[::step] * scale
    velocity = (item.velocity if isinstance(item, Run) else item.bins.velocity)[::step] * scale
    for joint in range(1, len(scale) + 1):
        colour = PALETTE[(joint - 1) % len(PALETTE)]
        if joint not in joints:
            below.plot(time, position[:, joint - 1], color=colour, linewidth=0.7, alpha=0.45, zorder=1)
            continue
        look = {"color": colour if is_run else GREY, "linewidth": 1.7 if is_run else 0.8, "zorder": 3 if is_run else 2}
        look["linestyle"] = "--" if isinstance(item, Run) and item.kind == "stroke" else "-"
        above.plot(time, velocity[:, joint - 1], **look)
        below.plot(time, position[:, joint - 1], **look)
        if is_run:
            above.fill_between(time, 0.0, velocity[:, joint - 1], color=colour, alpha=0.18, linewidth=0)


def _run_handles(dataset: Dataset, robot: Robot) -> list[Patch]:
    handles = []
    for joint in robot.joints:
        count = len(dataset.of_joint(joint.number))
        colour = PALETTE[(joint.number - 1) % len(PALETTE)]
        label = f"{joint.number} {joint.name}: {count} run{'s' * (count > 1)}"
        handles += [Patch(facecolor=colour, alpha=0.6, label=label)] if count else []
    read = max(1, samples_read(dataset))
    for reason, rejects in by_reason(dataset.rejects).items():
        label = f"{reason.replace('-', ' ')}: {100 * sum(reject.samples for reject in rejects) / read:.1f} %"
        face = "white" if reason == "rest" else TINT
        hatch = HATCHES.get(reason, "....")
        handles.append(Patch(facecolor=face, edgecolor=GREY, linewidth=0.5, hatch=hatch, label=label))
    return handles


# Timetable of a plan


def timetable_figure(plan: Plan, robot: Robot, times: Floats) -> Drawing:
    """When each run of a plan is made; `times` (M, 2) s of start and end."""
    return Drawing("timetable", f"{robot.name}: timetable of the plan", "", partial(timetable, plan, robot, times))


def timetable(plan: Plan, robot: Robot, times: Floats) -> Figure:
    """One strip a joint: speed (square root, forward up) against time, with the letter of the posture below."""
    figure = Figure(figsize=(12.0, 0.95 * robot.n_joints + 1.15), layout="constrained")
    strips = figure.subplots(robot.n_joints, 1, squeeze=False, sharex=True)[:, 0]
    minutes = np.asarray(times, dtype=float).reshape(-1, 2) / 60.0
    last = float(minutes.max(initial=0.0)) or 1.0
    by_motion = {motion: posture.letter for posture in planned_postures(plan) for motion in posture.motions}
    letters = [by_motion[motion] for motion in plan.motions]
    for axes, joint in zip(strips, robot.joints, strict=True):
        numbers = [k for k, motion in enumerate(plan.motions) if motion.joint == joint.number]
        scale, unit = in_unit(joint.position_unit, "deg")
        speeds = {k: plan.motions[k].velocity * scale for k in numbers}
        highest = max(speeds.values(), default=1.0)
        for k in numbers:
            motion = plan.motions[k]
            height = math.copysign(math.sqrt(speeds[k] / highest), motion.end - motion.start)
            colour = BACKWARD if motion.purpose == "heldout" else FORWARD
            axes.bar(minutes[k, 0], height, np.diff(minutes[k]), align="edge", color=colour, edgecolor=colour)
        _letters(axes, numbers, letters, minutes, room=0.008 * last)
        zero_line(axes)
        axes.set(ylim=(-1.75, 1.1), xlim=(0.0, 1.002 * last))
        axes.set_yticks([-1.0, 0.0, 1.0], [f"{-highest:.3g}", "0", f"{highest:.3g}"], fontsize=8)
        axes.set_ylabel(
            f"{joint.number} {joint.name[:16]}\n({unit}/s)", fontsize=8.5, rotation=0, ha="right", va="center"
        )
    strips[-1].set_xlabel("time (min)")
    different = len(set(plan.motions))
    title = f"{robot.name}: {len(plan.motions)} runs in {last:.0f} min, {different} different ones and repeats"
    heading(figure, title)
    handles = [Patch(color=FORWARD, label="fit"), Patch(color=BACKWARD, label="hold-out")]
    handles += [Patch(facecolor=TINT, edgecolor=GREY, label="posture of the other joints (letter)")]
    handles += [Patch(alpha=0.0, label="height: square root of speed, forward up")]
    legend(figure, handles, 4)
    return figure


def _letters(axes: Axes, numbers: Sequence[int], letters: Sequence[str], minutes: Floats, *, room: float) -> None:
    """A box with its letter below each series of runs in one posture; letters only as far as there is `room` (min)."""
    before = -math.inf
    for (letter, _), series in groupby(enumerate(numbers), key=lambda pair: (letters[pair[1]], pair[1] - pair[0])):
        runs = [run for _, run in series]
        begin, end = float(minutes[runs[0], 0]), float(minutes[runs[-1], 1])
        axes.fill_between([begin, end], -1.7, -1.2, facecolor=TINT, edgecolor=GREY, linewidth=0.5)
        middle = 0.5 * (begin + end)
        if middle - before > room:
            axes.text(middle, -1.45, letter, ha="center", va="center", fontsize=7)
            before = middle
