"""The experiment: the arm's skeleton, and the runs that logs contain."""

import math
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pumaid.dataset import STROKE, Dataset, Reject, Run
from pumaid.maths import Floats
from pumaid.reporting.figures.style import (
    BACKWARD,
    FAINT,
    FORWARD,
    GREY,
    INK,
    PALETTE,
    TINT,
    Drawing,
    clock_shifts,
    legend,
    styled,
    zero_line,
)
from pumaid.reporting.run_tables import by_reason, samples_read
from pumaid.reporting.text import counted_runs, in_unit, plural
from pumaid.robot import Robot

#: View from the front right and a little above (rad).
AZIMUTH, ELEVATION = -0.96, 0.38


#: Radius of the base, as a share of the reach.
BASE = 0.1

#: Runs of the report's figure; runs in one strip of a figure, and strips.
MOST_RUNS, RUNS_A_STRIP, MOST_STRIPS = 72, 36, 8
#: Points of one run or reject; gap between recordings with separate clocks, as a share of their whole time.
MOST_POINTS, GAP = 48, 0.01
#: Reason of rejection -> hatch; stretches at rest are left white.
HATCHES = {"rest": "", "ramp": "////", "several-joints": "xxxx", "speed-not-constant": "\\\\\\\\", "low-speed": "||||"}


def projected(points: Floats) -> Floats:
    """(N, 2) of (N, 3) points, as seen from far away with the third base axis up."""
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    across = -s * points[:, 0] + c * points[:, 1]
    depth = c * points[:, 0] + s * points[:, 1]
    return np.column_stack([across, points[:, 2] * np.cos(ELEVATION) - depth * np.sin(ELEVATION)])


def frames(robot: Robot, position: Floats) -> tuple[Floats, Floats]:
    """Origins (J+1, 3) in m, the base first, and rotations (J+1, 3, 3) of all links at (J,) positions."""
    rotations, origins = robot.frames(np.asarray(position, dtype=float)[None])
    return np.vstack([np.zeros(3), origins[0]]), np.concatenate([np.eye(3)[None], rotations[0]])


@styled()
def skeleton_figure(robot: Robot, position: Floats) -> Drawing:
    """The arm at (J,) positions, with its axes and their numbers."""
    origins, rotations = frames(robot, position)
    reach = max(float(np.ptp(origins, axis=0).max()), 0.1)
    flat = projected(origins)
    wide, high = np.ptp(flat, axis=0) + 0.5 * reach
    figure = Figure(figsize=(3.4, float(np.clip(3.4 * high / wide, 2.0, 3.8))), layout="constrained")
    axes = figure.subplots()
    axes.plot(*flat.T, color=INK, linewidth=4.5, alpha=0.85, solid_joinstyle="round", zorder=2)
    labels: dict[tuple[float, ...], list[str]] = {}
    for joint, origin, z in zip(robot.joints, origins[1:], rotations[1:, :, 2], strict=True):
        axis = projected(np.array([origin - 0.09 * reach * z, origin, origin + 0.13 * reach * z]))
        colour, marker = (FORWARD, "o") if joint.is_revolute else (BACKWARD, "s")
        axes.plot(axis[:, 0], axis[:, 1], color=colour, linewidth=1.8, zorder=3)
        axes.plot(*axis[1], marker, color=colour, markersize=8, markeredgecolor="none", zorder=4)
        near = [place for place in labels if np.linalg.norm(axis[1] - place) < 0.08 * reach]
        labels.setdefault(near[0] if near else tuple(axis[1].tolist()), []).append(str(joint.number))
    for (x, y), numbers in labels.items():
        axes.annotate(
            ", ".join(numbers), (x, y), (9, 5), zorder=5, fontsize=10.5, fontweight="bold", textcoords="offset points"
        )
    axes.margins(0.12)
    axes.set_xlim(axes.get_xlim()[0], axes.get_xlim()[1] + 0.3 * reach)
    _surroundings(axes, robot, reach)
    return Drawing(
        "arm",
        f"{robot.name}: skeleton",
        "Circles: revolute joints, squares: prismatic joints, short lines: their axes, arrow: gravity. Drawn from the"
        " recipe in the posture of the first run; if this is not your arm, the recipe is wrong.",
        figure,
    )


def _surroundings(axes: Axes, robot: Robot, reach: float) -> None:
    """The base's disc, and an arrow along gravity, if there is any, in the upper right corner."""
    axes.set_aspect("equal")
    axes.axis("off")
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    disc = projected(BASE * reach * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]))
    axes.fill(*disc.T, color=FAINT, linewidth=0, zorder=0)
    if np.any(robot.gravity):
        x, y = 28 * projected(np.array([robot.gravity]) / np.linalg.norm(robot.gravity))[0]
        style: dict[str, Any] = {"arrowstyle": "<|-", "color": GREY, "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0}
        look: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
        axes.annotate("", (0.94, 0.84), (x, y), arrowprops=style, zorder=7, **look)
        axes.annotate("g", (0.94, 0.84), (0, 4), ha="center", fontsize=10, style="italic", **look)


# Runs


@styled()
def run_figure(dataset: Dataset, robot: Robot, units: str = "rad", *, limit: int | None = None) -> Drawing:
    """Velocity and position against time, with runs in their joint's colour; of the first `limit` runs only.

    One strip, or several for a long campaign; recordings without a common clock follow one another.
    """
    items: list[Run | Reject] = [*dataset.runs, *dataset.rejects]
    runs, shifts = dataset.runs[:limit], clock_shifts(items, GAP)
    is_cut = len(runs) < len(dataset.runs)
    count = max(1, min(MOST_STRIPS, math.ceil(len(runs) / RUNS_A_STRIP)))
    figure = Figure(figsize=(12.0, (4.6 if count == 1 else 2.5) * count + 0.9), layout="constrained")
    panels = figure.subplots(2 * count, 1, squeeze=False, height_ratios=(3, 2) * count)[:, 0]
    ends = [shifts[item.clock] + item.start + item.duration for item in items]
    borders = np.linspace(0.0, max([1e-9, *ends[: len(runs) if is_cut else None]]), count + 1)
    scale, names = zip(*(in_unit(joint.position_unit, units) for joint in robot.joints), strict=True)
    for (above, below), start, stop in zip(panels.reshape(-1, 2), borders[:-1], borders[1:], strict=True):
        for item, end in zip(items, ends, strict=True):
            if end - item.duration <= stop and end >= start:
                _item((above, below), item, shift=shifts[item.clock], scale=np.array(scale))
        zero_line(above)
        above.tick_params(labelbottom=False)
        for axes, name in ((above, "velocity ({}/s)"), (below, "position ({})")):
            axes.set_ylabel(" or ".join(name.format(unit) for unit in dict.fromkeys(names)))
            axes.set_xlim(start, stop)
            axes.margins(y=0.08)
            axes.autoscale_view(scalex=False)
    panels[-1].set_xlabel("time (s)")
    read, handles = max(1, samples_read(dataset)), []
    for joint, colour in zip(robot.joints, cycle(PALETTE), strict=False):
        count = len(dataset.of_joint(joint.number))
        label = f"{joint.number} {joint.name}: {plural(count, 'run')}"
        handles += [Patch(facecolor=colour, alpha=0.6, label=label)] if count else []
    for reason, rejects in by_reason(dataset.rejects).items():
        label = f"{reason.replace('-', ' ')}: {100 * sum(reject.samples for reject in rejects) / read:.1f} %"
        face, hatch = "white" if reason == "rest" else TINT, HATCHES.get(reason, "....")
        handles.append(Patch(facecolor=face, edgecolor=GREY, linewidth=0.5, hatch=hatch, label=label))
    used = read - sum(reject.samples for reject in dataset.rejects)
    title = f"{robot.name}: {counted_runs(dataset.runs)}; {100 * used / read:.0f} % of {read:,} samples used"
    legend(figure, handles, 6, title=title)
    caption = f"The first {limit} of {len(dataset.runs)} runs. " if is_cut else ""
    caption += "Velocity and position against time: runs in their joint's colour, strokes dashed, the rest hatched."
    return Drawing("segments", "Runs found in the logs", caption, figure)


def _item(both: tuple[Axes, Axes], item: Run | Reject, *, shift: float, scale: Floats) -> None:
    """Velocity (above) and position (below) of one run, with the joints that it holds; a reject is hatched."""
    above, below = both
    if isinstance(item, Reject):
        for axes in both if item.reason != "rest" else ():
            look: dict[str, Any] = {"edgecolor": FAINT, "hatch": HATCHES.get(item.reason, "...."), "linewidth": 0.0}
            axes.axvspan(item.start + shift, item.start + shift + item.duration, facecolor=TINT, zorder=0.5, **look)
        return
    step = slice(None, None, max(1, len(item.bins) // MOST_POINTS))
    time, position = item.bins.time[step] + shift, item.bins.position[step] * scale
    velocity = item.velocity[step] * scale
    for joint in range(1, len(scale) + 1):
        colour = PALETTE[(joint - 1) % len(PALETTE)]
        look = {"color": colour, "linewidth": 0.7, "alpha": 0.45, "zorder": 1}
        if joint == item.joint:
            look = {"color": colour, "linewidth": 1.7, "zorder": 3, "linestyle": "--" if item.kind == STROKE else "-"}
            above.plot(time, velocity[:, joint - 1], **look)
            above.fill_between(time, 0.0, velocity[:, joint - 1], color=colour, alpha=0.18, linewidth=0)
        below.plot(time, position[:, joint - 1], **look)
