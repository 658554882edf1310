"""The picture of a segmentation: velocity and position against time, runs in their joint's colour, the rest hatched."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pumaid.dataset import Dataset, Reject, Run
from pumaid.reporting.numbers import in_unit
from pumaid.reporting.plots.style import FAINT, GREY, INK, saved, styled
from pumaid.reporting.runs import by_reason, samples_read
from pumaid.reporting.wording import plural
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Okabe and Ito's colours and two more, which all kinds of colour vision tell apart, one a joint in turn.
JOINT_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f5fa8", "#8c6d1f")

#: Reason -> hatch; others are dotted. Rest is left white: nothing happens there.
HATCHES = {"ramp": "////", "several-joints": "xxxx", "speed-not-constant": "\\\\\\\\", "low-speed": "||||"}
OTHER_HATCH = "...."

#: Background of what is left out.
TINT = "#f3f4f6"

#: Runs in one strip of the picture, and strips at most.
RUNS_A_STRIP, MOST_STRIPS = 36, 8
#: Points drawn of one run or reject where there is one strip; in more, runs are narrower.
MOST_POINTS, NARROW_POINTS = 96, 36
#: Share of a strip's width below which a hatch would be a smudge and a plain tint is drawn.
SMUDGE = 0.004
#: Shown between two recordings that do not share a clock, as a share of their whole time.
APART = 0.01


@dataclass(frozen=True, eq=False, slots=True)
class Curve:
    """A run (`kind` constant or stroke) or a reject (`kind` its reason) as drawn: (M,) shown times, (M, J) courses."""

    kind: str
    joints: tuple[int, ...]
    clock: int
    start: float
    duration: float
    time: Floats
    velocity: Floats
    position: Floats

    @property
    def is_run(self) -> bool:
        """Whether it was kept."""
        return self.kind in ("constant", "stroke")


@dataclass(frozen=True, eq=False, slots=True)
class Strip:
    """A span of shown time, `start` to `stop` (s), and all curves."""

    start: float
    stop: float
    curves: list[Curve]


def drawn(dataset: Dataset, robot: Robot, form: str, *, units: str = "rad") -> bytes:
    """The picture as ``png``, ``svg`` or ``pdf``; arguments as in `draw`."""
    with styled():
        return saved(draw(dataset, robot, units=units), form, f"{robot.name}: runs found")


def draw(dataset: Dataset, robot: Robot, *, units: str = "rad") -> Figure:
    """Draw velocity and position against time from what the one pass kept.

    Recordings that do not share a clock stand one after the other; long campaigns go over several strips.

    Parameters
    ----------
    dataset
        Runs and rejects.
    robot
        Its arm.
    units
        ``"rad"`` or ``"deg"``.
    """
    shifts, total = _shifts(dataset)
    number = max(1, min(MOST_STRIPS, math.ceil(len(dataset.runs) / RUNS_A_STRIP)))
    borders = np.linspace(0.0, max(total, 1e-9), number + 1)
    scale = np.array([in_unit(joint.position_unit, units)[0] for joint in robot.joints])
    curves = _curves(dataset, shifts, scale, most=MOST_POINTS if number == 1 else NARROW_POINTS)
    figure = Figure(figsize=(12.0, (4.6 if number == 1 else 2.5) * number + 0.9), layout="constrained")
    panels = figure.subplots(2 * number, 1, squeeze=False, height_ratios=(3, 2) * number)[:, 0]
    for index in range(number):
        above, below = panels[2 * index], panels[2 * index + 1]
        _strip(above, below, Strip(float(borders[index]), float(borders[index + 1]), curves))
        _labels(above, below, robot=robot, units=units)
    panels[-1].set_xlabel("time (s)")
    figure.legend(handles=_handles(dataset, robot), loc="outside lower center", ncols=6, handlelength=2.2)
    figure.suptitle(_title(dataset, robot), x=0.01, ha="left", fontsize=11, fontweight="bold")
    return figure


def _curves(dataset: Dataset, shifts: dict[int, float], scale: Floats, *, most: int) -> list[Curve]:
    """Every run and reject as it is drawn, in order of time."""
    out = []
    nothing = np.zeros((0, len(scale)))
    items: list[Run | Reject] = [*dataset.runs, *dataset.rejects]
    for item in items:
        shift, bins = shifts[item.clock], item.bins
        course = (np.zeros(0), nothing, nothing)
        if bins is not None:
            step = max(1, math.ceil(len(bins) / most))
            velocity = item.velocity if isinstance(item, Run) else bins.velocity
            course = (bins.time[::step] + shift, velocity[::step] * scale, bins.position[::step] * scale)
        kind = item.kind if isinstance(item, Run) else item.reason
        joints = (item.joint,) if isinstance(item, Run) else item.joints
        out.append(Curve(kind, joints, item.clock, item.start + shift, item.duration, *course))
    return sorted(out, key=lambda curve: curve.start)


def _strip(above: Axes, below: Axes, strip: Strip) -> None:
    shown = [c for c in strip.curves if c.start <= strip.stop and c.start + c.duration >= strip.start]
    _hatched((above, below), strip, [curve for curve in shown if not curve.is_run])
    _held(below, shown)
    left = [(curve, joint) for curve in shown if not curve.is_run for joint in curve.joints if len(curve.time)]
    thin = {"colors": GREY, "linewidths": 0.8}
    _lines(above, [np.column_stack([curve.time, curve.velocity[:, joint - 1]]) for curve, joint in left], **thin)
    _lines(below, [np.column_stack([curve.time, curve.position[:, joint - 1]]) for curve, joint in left], **thin)
    groups: dict[tuple[int, str], list[Curve]] = {}
    for curve in shown:
        if curve.is_run:
            groups.setdefault((curve.joints[0], curve.kind), []).append(curve)
    for (joint, kind), curves in groups.items():
        _runs(above, below, curves, joint=joint, is_constant=kind == "constant")
    above.axhline(0.0, color=INK, linewidth=0.6)
    for axes in (above, below):
        axes.set_xlim(strip.start, strip.stop)
        axes.margins(y=0.08)
        axes.autoscale_view(scalex=False)
    above.tick_params(labelbottom=False)


def _runs(above: Axes, below: Axes, curves: list[Curve], *, joint: int, is_constant: bool) -> None:
    """Velocity and position of the runs of one joint and kind, in the joint's colour."""
    colour = JOINT_COLOURS[(joint - 1) % len(JOINT_COLOURS)]
    velocities = [np.column_stack([curve.time, curve.velocity[:, joint - 1]]) for curve in curves]
    areas = [np.vstack([(line[0, 0], 0.0), line, (line[-1, 0], 0.0)]) for line in velocities]
    alpha = 0.28 if is_constant else 0.12
    above.add_collection(PolyCollection(areas, facecolors=colour, alpha=alpha, linewidths=0), autolim=True)
    _lines(above, velocities, colors=colour, linewidths=1.6, linestyles="-" if is_constant else (0, (4, 1)))
    positions = [np.column_stack([curve.time, curve.position[:, joint - 1]]) for curve in curves]
    _lines(below, positions, colors=colour, linewidths=2.2)


def _lines(axes: Axes, lines: list[Floats], **look: Any) -> None:
    if lines:
        axes.add_collection(LineCollection(lines, **look), autolim=True)


def _held(axes: Axes, shown: list[Curve]) -> None:
    """Positions of all joints as thin lines, through rests too."""
    for clock in dict.fromkeys(curve.clock for curve in shown):
        parts = [curve for curve in shown if curve.clock == clock and len(curve.time)]
        if not parts:
            continue
        time, position = (np.concatenate([getattr(part, name) for part in parts]) for name in ("time", "position"))
        for joint in range(position.shape[1]):
            colour = JOINT_COLOURS[joint % len(JOINT_COLOURS)]
            axes.plot(time, position[:, joint], color=colour, linewidth=0.7, alpha=0.45, zorder=1)


def _hatched(panels: tuple[Axes, Axes], strip: Strip, rejects: list[Curve]) -> None:
    least = SMUDGE * (strip.stop - strip.start)
    for reason in dict.fromkeys(curve.kind for curve in rejects if curve.kind != "rest"):
        spans = [(curve.start, curve.duration) for curve in rejects if curve.kind == reason]
        wide, thin = [span for span in spans if span[1] >= least], [span for span in spans if span[1] < least]
        for axes in panels:
            style: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "linewidth": 0.0, "zorder": 0.5}
            axes.broken_barh(wide, (0, 1), facecolor=TINT, hatch=_hatch(reason), edgecolor=FAINT, **style)
            axes.broken_barh(thin, (0, 1), facecolor=FAINT, alpha=0.5, **style)


def _labels(above: Axes, below: Axes, *, robot: Robot, units: str) -> None:
    kinds = dict.fromkeys(in_unit(joint.position_unit, units)[1] for joint in robot.joints)
    above.set_ylabel("velocity (" + " or ".join(f"{kind}/s" for kind in kinds) + ")")
    below.set_ylabel("position (" + " or ".join(kinds) + ")")


def _shifts(dataset: Dataset) -> tuple[dict[int, float], float]:
    """What is added to each clock's times so that recordings stand one after the other from 0, and their end (s)."""
    spans: dict[int, tuple[float, float]] = {}
    items: list[Run | Reject] = [*dataset.runs, *dataset.rejects]
    for item in items:
        low, high = spans.get(item.clock, (math.inf, -math.inf))
        spans[item.clock] = (min(low, item.start), max(high, item.start + item.duration))
    whole = sum(high - low for low, high in spans.values())
    shifts, at = {}, 0.0
    for clock in sorted(spans):
        low, high = spans[clock]
        shifts[clock] = at - low
        at += high - low + APART * whole
    return shifts, at - APART * whole if spans else 1.0


def _handles(dataset: Dataset, robot: Robot) -> list[Patch]:
    handles = []
    for joint in robot.joints:
        runs = dataset.of_joint(joint.number)
        colour = JOINT_COLOURS[(joint.number - 1) % len(JOINT_COLOURS)]
        if runs:
            name = f"{joint.number} {joint.name}: {len(runs)} run{'s' * (len(runs) > 1)}"
            handles.append(Patch(facecolor=colour, alpha=0.6, label=name))
    read = max(1, samples_read(dataset))
    for reason, rejects in by_reason(dataset.rejects).items():
        share = f"{reason.replace('-', ' ')}: {100 * sum(reject.samples for reject in rejects) / read:.1f} %"
        look: dict[str, Any] = {"facecolor": "white" if reason == "rest" else TINT, "hatch": _hatch(reason)}
        handles.append(Patch(edgecolor=GREY, linewidth=0.5, label=share, **look))
    return handles


def _hatch(reason: str) -> str:
    return "" if reason == "rest" else HATCHES.get(reason, OTHER_HATCH)


def _title(dataset: Dataset, robot: Robot) -> str:
    kept, read = sum(run.samples for run in dataset.runs), max(1, samples_read(dataset))
    strokes = sum(run.kind == "stroke" for run in dataset.runs)
    steady = len(dataset.runs) - strokes
    counts = [f"{plural(steady, 'run')} at constant speed"] * bool(steady or not strokes)
    counts += [f"{plural(strokes, 'stroke')} from rest to rest (dashed)"] * bool(strokes)
    return f"{robot.name}: {' and '.join(counts)}; {100 * kept / read:.0f} % of {read:,} samples kept"
