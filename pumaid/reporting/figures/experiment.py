"""The experiment: the runs that logs contain."""

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
    FAINT,
    GREY,
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

#: Runs of the report's figure; runs in one strip of a figure, and strips.
MOST_RUNS, RUNS_A_STRIP, MOST_STRIPS = 72, 36, 8
#: Points of one run or reject; gap between recordings with separate clocks, as a share of their whole time.
MOST_POINTS, GAP = 48, 0.01
#: Reason of rejection -> hatch; stretches at rest are left white.
HATCHES = {"rest": "", "ramp": "////", "several-joints": "xxxx", "speed-not-constant": "\\\\\\\\", "low-speed": "||||"}


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
