"""Currents and residuals: measured and predicted, the residual by variable, its parts, and what findings explain."""

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pumaid.dataset import BLOCK
from pumaid.diagnosis.records import Curve, Diagnosis, Finding, JointDiagnosis, Unexplained
from pumaid.estimation.evaluate import TOGETHER, Budget, RunScore
from pumaid.maths import Floats
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import (
    COLOURS,
    GREY,
    INK,
    MOST_POINTS,
    Drawing,
    clock_shifts,
    direction_handles,
    dots,
    error_marks,
    legend,
    panels,
    stacked_bars,
    styled,
    zero_line,
)
from pumaid.reporting.formatting import amperes, in_unit, joint_title, listed, posture_text, shortened
from pumaid.reporting.text import (
    BUDGET_CAPTION,
    PART_NAMES,
    VARIABLES,
    budgets,
    form_sentence,
    label,
    part_share,
    place,
)
from pumaid.robot import Robot

#: Postures of a joint in a figure of currents; bins over position (fine enough for a ripple) and other variables.
MOST_POSTURES, FINE, COARSE = 3, 48, 14

#: A variable is drawn if it varies by more than this: speed (share of the largest), A, posture, K; others always.
LEAST = {"speed": 0.05, "gravity": 1e-6, "posture": 0.5, "temperature": 0.5}

#: Part of the residual budget -> colour, in the order of the bars: missing physics, then greys for noise.
PART_COLOURS = {
    "smooth": "#0173b2",
    "fast": "#de8f05",
    "start": "#cc78bc",
    "odd": "#c8500a",
    "even": "#029e73",
    "time": "#ece133",
    "unassigned": "#7f5fa8",
    "noise_inside": "#d3d7dd",
    "noise_shared": "#a9b0ba",
}

#: Line styles of an effect and of its rivals, in turn.
DASHES: tuple[Any, ...] = ("-", (0, (4, 2)), (0, (1.2, 1.4)), (0, (6, 2, 1.2, 2)))

#: s above which times are in minutes; range of a residual in multiples of its largest mark; findings in one figure.
MINUTES, RANGE, MOST_ROWS = 300.0, 1.6, 6


# Currents


@styled()
def current_figure(context: ReportContext, joint: int) -> Drawing:
    """Measured and predicted current of a joint, as in the paper's Fig. 4: one panel a posture.

    Of a joint with blocks of any motion only, one panel a block, against time.
    """
    groups = context.postures(joint)
    is_free = all(score.run.kind == BLOCK for score in groups[0]) and len(groups) == 1
    shown = [[score] for score in groups[0][:MOST_POSTURES]] if is_free else groups[:MOST_POSTURES]
    variable, unit = ("time", "s") if is_free else ("position", context.unit(joint)[1])
    figure, all_axes = panels(len(shown), height=2.35 if len(shown) == 1 else 1.85, sharex=True, sharey=True)
    names = " | ".join(dict.fromkeys(context.unit(other.number)[1] for other in context.robot.joints))
    for axes, group in zip(all_axes, shown, strict=True):
        _course(axes, context, group)
        run = group[0].run
        posture = f"other joints at {posture_text(context.robot, run.posture.tolist(), context.units)} {names}"
        words = f"block from {run.start:.1f} s" if is_free else posture
        axes.text(0.0, 1.02, words, transform=axes.transAxes, fontsize=8.5)
        axes.set_ylabel("current (A)")
        axes.grid(axis="y")
    all_axes[-1].set_xlabel(f"{variable} ({unit})")
    all_axes[0].set_title(shortened(joint_title(context.robot, joint), 40), pad=18)
    ways = [1, -1] if is_free else [score.run.direction for group in shown for score in group]
    legend(figure, [*direction_handles(ways), Line2D([], [], color=INK, linewidth=1.1, label="predicted")])
    caption = "Dots: measured. Lines: predicted, one a run."
    if len(groups) > MOST_POSTURES:
        caption += f" The {MOST_POSTURES} of {len(groups)} postures with most runs."
    return Drawing(
        f"current_j{joint}", f"{joint_title(context.robot, joint)}: current against {variable}", caption, figure
    )


def _course(axes: Axes, context: ReportContext, group: Sequence[RunScore]) -> None:
    """Measured (dots) and predicted (lines) current of runs in one posture, or of blocks against time."""
    for score in group:
        run, bins = score.run, score.run.bins
        is_block = run.kind == BLOCK
        x = bins.time - run.start if is_block else bins.position[:, run.joint - 1] * context.unit(run.joint)[0]
        ways = np.sign(bins.velocity) if is_block else np.full(len(x), run.direction)
        order, steps = np.argsort(x), np.diff(np.sort(x))
        pauses: Any = np.flatnonzero(steps > 1.5 * np.median(steps)) + 1 if is_block else []
        for rows in np.split(order, pauses):
            axes.plot(x[rows], score.predicted[rows], color=INK, linewidth=0.7, zorder=1.5)
        for sign in (1, -1):
            look: dict[str, Any] = {"colour": COLOURS[sign], "size": 2.6, "limit": -(-2 * MOST_POINTS // len(group))}
            dots(axes, x[ways == sign], bins.current[ways == sign], alpha=0.7, **look)


# Residuals


@styled()
def residual_figure(context: ReportContext, joint: int) -> Drawing:
    """A joint's residual against position, speed, load, time, posture and temperature, as far as they vary."""
    bins = joint_residuals(context, joint)
    names = varying(bins)
    figure, all_axes = panels(len(names), height=1.28 if len(names) > 2 else 1.6, sharey=True)
    for axes, name in zip(all_axes, names, strict=True):
        _binned(axes, bins, name, context.comparison.joints[joint - 1].noise_floor)
        axes.set_ylabel("residual (A)")
    all_axes[0].set_title(f"{shortened(joint_title(context.robot, joint), 40)}: residual")
    legend(figure, direction_handles(bins["direction"]))
    postures = [group[0].run.posture.tolist() for group in context.postures(joint)[:4]]
    texts = [f"{k} = {posture_text(context.robot, p, context.units)}" for k, p in enumerate(postures, start=1)]
    caption = f"Postures ({context.unit(joint)[1]}): {'; '.join(texts)}."
    return Drawing(f"residual_j{joint}", f"{joint_title(context.robot, joint)}: residual", caption, figure)


def joint_residuals(context: ReportContext, joint: int) -> pd.DataFrame:
    """The bins of a joint's runs: direction, run and residual (A), then what it may depend on, in units of the axes."""
    (scale, unit), shifts = context.unit(joint), clock_shifts([score.run for score in context.comparison.runs])
    parts: list[pd.DataFrame] = []
    for posture, group in enumerate(context.postures(joint), start=1):
        for score in group:
            run, bins = score.run, score.run.bins
            is_block = run.kind == BLOCK
            speed = np.abs(bins.velocity) if is_block else np.full(len(bins.time), abs(run.speed))
            # A's gravity is not known where only a sum with it is, and 0 where the joint carries no weight.
            is_merged = any("gravity" in name.split(TOGETHER) and name != "gravity" for name in score.parts)
            columns = {
                "direction": np.sign(bins.velocity) if is_block else run.direction,
                "run": len(parts),
                "residual": score.residual,
                f"position ({unit})": scale * bins.position[:, joint - 1],
                f"speed ({unit}/s)": scale * speed,
                "gravity current (A)": score.parts.get("gravity", np.nan if is_merged else 0.0),
                "time (min)": (bins.time + shifts[run.clock]) / 60.0,
                "posture (number)": float(posture),
                "temperature (°C)": bins.temperature,
            }
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def varying(bins: pd.DataFrame) -> list[str]:
    """Names of the variables that vary enough to show a dependence; position and time always."""
    least = {name: LEAST.get(name.split()[0], -1.0) for name in bins.columns[3:]}
    least = {name: x * bins[name].max() if name.startswith("speed") else x for name, x in least.items()}
    return [name for name, limit in least.items() if bins[name].max() - bins[name].min() > limit]


def _binned(axes: Axes, bins: pd.DataFrame, name: str, floor: float | None) -> None:
    """Residuals as dots, and means over runs in bins of a variable with their standard errors."""
    zero_line(axes, floor)
    is_position = name.startswith("position")
    look = {"markersize": 2.4, "linestyle": "-", "linewidth": 0.8} if is_position else {"markersize": 4.2}
    count = COARSE if name.startswith(("gravity", "time", "temperature")) else FINE
    for sign in (1, -1):
        side = bins[(bins["direction"] == sign) & np.isfinite(bins[name])]
        if side.empty:
            continue
        dots(axes, side[name], side["residual"], colour=COLOURS[sign], size=1.6, alpha=0.28)
        labels = pd.cut(side[name], count, labels=False)
        means = side.groupby([labels, "run"])["residual"].mean().groupby(level=0)
        error_marks(axes, side[name].groupby(labels).mean(), means.mean(), errors=means.sem(), sign=sign, **look)
    axes.margins(x=0.05)
    axes.locator_params(axis="x", nbins=6)  # small currents have long labels
    axes.set_xlabel(name, labelpad=1)
    # The same scale above and below zero, with room for 99 % of the residuals.
    top = 1.3 * max(float(bins["residual"].abs().quantile(0.99)), 1.2 * (floor or 0.0), 1e-9)
    axes.set_ylim(-top, top)


# Residual budget


@styled()
def budget_figure(context: ReportContext) -> Drawing:
    """Parts of each joint's mean squared residual, one bar a joint."""
    figure = Figure(figsize=(5.1, 0.42 * len(budgets(context.comparison)) + 1.5), layout="constrained")
    axes = figure.subplots()
    legend(figure, _budget_bars(axes, context), 2)
    axes.set_title("Residual budget")
    return Drawing("budget", "Residual budget", BUDGET_CAPTION, figure)


def _budget_bars(axes: Axes, context: ReportContext) -> list[Patch]:
    """Draw the bars, significant parts first, unassigned parts and noise last; what the legend says of them."""
    joints, order = budgets(context.comparison), list(PART_COLOURS)

    def bar(budget: Budget) -> list[tuple[float, str, float]]:
        parts = sorted(budget.parts, key=lambda part: (max(order.index(part.name), 5), -part.mean_square))
        opacity = [0.45 if part.name == "unassigned" and not part.is_more else 1.0 for part in parts]
        return [(part_share(budget, p), PART_COLOURS[p.name], alpha) for p, alpha in zip(parts, opacity, strict=True)]

    rmse = {joint: amperes(context.comparison.joints[joint - 1].rmse) for joint in joints}
    bars = {f"joint {joint}": (bar(budget), rmse[joint]) for joint, budget in joints.items()}
    stacked_bars(axes, bars, "share of the mean squared residual (right: RMSE)")
    names = {part.name for budget in joints.values() for part in budget.parts if part.mean_square > 0.0}
    return [Patch(color=colour, label=PART_NAMES[name]) for name, colour in PART_COLOURS.items() if name in names]


# All of it at a glance


@styled()
def overview_figure(context: ReportContext) -> Drawing:
    """The budget on top; below it a row a joint, the current first and then its residual by variable."""
    bins = {joint: joint_residuals(context, joint) for joint in context.moving()}
    drawn = {joint: {name.split(" (")[0]: name for name in varying(frame)} for joint, frame in bins.items()}
    words = [word for word in dict.fromkeys(word for names in drawn.values() for word in names) if word != "posture"]
    heights = (0.3 * len(bins) + 1.1, 1.45 * len(bins) + 0.9)
    figure = Figure(figsize=(4.5 + 2.3 * len(words), sum(heights)), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    axes = above.subplots()
    above.legend(handles=_budget_bars(axes, context), loc="outside right center", handlelength=1.1)
    axes.set_title(f"{shortened(context.robot.name)}: residual budget")
    widths = [1.5, 1.5, *[1.0] * (len(words) - 1)]
    rows = below.subplots(len(bins), 1 + len(words), squeeze=False, width_ratios=widths)
    for (first, *row), (joint, names) in zip(rows, drawn.items(), strict=True):
        _course(first, context, context.postures(joint)[0])
        first.set_xlabel(f"position ({context.unit(joint)[1]})", labelpad=1)
        first.set_ylabel(f"joint {joint} (A)")
        for word, axes in zip(words, row, strict=True):
            if word not in names:
                axes.set_axis_off()
                continue
            _binned(axes, bins[joint], names[word], context.comparison.joints[joint - 1].noise_floor)
            axes.tick_params(axis="y", labelleft=word == "position")
    heads = ("measured (dots), predicted", *(f"residual by {word}" for word in words))
    for head, axes in zip(heads, rows[0], strict=True):
        axes.set_title(head, fontsize=9.5)
    ways = direction_handles(score.run.direction for score in context.comparison.runs)
    legend(below, [*ways, Patch(color=GREY, alpha=0.4, label="noise floor")])
    return Drawing("overview", f"{context.robot.name}: model errors", "", figure)


# Findings


@styled()
def finding_figure(finding: Finding, curve: Curve, robot: Robot, *, name: str, units: str = "rad") -> Drawing:
    """What an effect explains at the joint of one of its curves: without it above, with it below."""
    figure, axes = panels(2, height=1.75, sharex=True)
    legend(figure, _before_and_after(axes, finding, curve, robot, units=units), 2)
    axes[0].set_xlabel("")
    effect = label(finding.effect)
    caption = f"Above: residual, means over runs with standard errors; line: current of {effect}."
    rivals = list(dict.fromkeys(line.effect for line in curve.lines if line.effect != finding.effect))
    if rivals:
        caption += f" Broken: {listed(rivals, 'or')}; where the lines differ, a run would decide."
    caption += f" Below: residual with {effect} in the model."
    return Drawing(f"{name}_j{curve.joint}", _title(finding, curve, robot), caption, figure)


def _title(finding: Finding, curve: Curve, robot: Robot) -> str:
    other = "" if finding.joint == curve.joint else f" of {place(finding, robot)}"
    return f"{joint_title(robot, curve.joint)}: {label(finding.effect)}{other}"


@styled()
def shape_figure(joint: JointDiagnosis, robot: Robot, units: str = "rad") -> Drawing:
    """The shape of a joint's residual that no effect explains."""
    name, shape = joint_title(robot, joint.joint), joint.unexplained
    assert shape is not None
    figure, (axes,) = panels(1, height=2.4)
    _shape(axes, shape, units)
    axes.set_title(shortened(f"{name}: {shape.form}", 44))
    variable = VARIABLES.get(shape.variable, shape.variable)
    caption = f"Means of the residual in bins of {variable}. {form_sentence(shape, units)}"
    return Drawing(f"unexplained_j{joint.joint}", f"{name}: residual that no effect explains", caption, figure)


@styled()
def diagnosis_figure(diagnosis: Diagnosis, robot: Robot, units: str = "rad") -> Drawing | None:
    """All findings in one figure: before on the left, after on the right; shapes without a name below.

    None where there is nothing to draw.
    """
    curves = [(finding, curve) for finding in diagnosis.findings for curve in finding.curves]
    shapes = [(joint.joint, joint.unexplained) for joint in diagnosis.joints if joint.unexplained is not None]
    count = min(len(curves) + len(shapes), MOST_ROWS)
    if not count:
        return None
    figure = Figure(figsize=(8.4, 2.5 * count + 0.3), layout="constrained")
    rows = figure.subplots(count, 2, squeeze=False)
    for row, (finding, curve) in zip(rows, curves, strict=False):
        row[1].sharex(row[0])
        handles = _before_and_after(row, finding, curve, robot, units=units)
        row[1].legend(handles=handles, loc="lower right", fontsize=8, ncols=2)
    for row, (joint, shape) in zip(rows[len(curves) :], shapes, strict=False):
        row[1].remove()
        _shape(row[0], shape, units)
        row[0].set_title(shortened(f"{joint_title(robot, joint)}: no effect explains this", 60))
    return Drawing("diagnosis", f"{robot.name}: missing effects", "", figure)


def _before_and_after(
    both: Sequence[Axes], finding: Finding, curve: Curve, robot: Robot, *, units: str
) -> list[Artist]:
    """The residual without and with an effect, at one scale; what the legend says of it."""
    values = np.concatenate([side.centres for side in curve.sides])
    dashes = dict(zip(dict.fromkeys(line.effect for line in curve.lines), cycle(DASHES), strict=False))
    largest = 1e-9
    for axes, name in zip(both, ("before", "after"), strict=True):
        scale = _frame(axes, curve.variable, curve.unit, values, units=units)
        for side in curve.sides:
            means = getattr(side, name)
            error_marks(axes, scale * side.centres, means, errors=side.errors, sign=side.direction)
            largest = max(largest, float(np.nanmax(np.abs(means), initial=0.0)))
    for line in curve.lines:
        look: dict[str, Any] = {"color": COLOURS[line.direction], "linestyle": dashes[line.effect]}
        both[0].plot(scale * line.places, line.values, linewidth=1.4, **look)
    for axes, title in zip(both, (_title(finding, curve, robot), f"with {label(finding.effect)}"), strict=True):
        axes.set_ylim(-RANGE * largest, RANGE * largest)
        axes.set_title(shortened(title, 44))
    lines = [Line2D([], [], color=INK, linestyle=dash, label=name) for name, dash in dashes.items()]
    return [*direction_handles(side.direction for side in curve.sides), *lines]


def _shape(axes: Axes, shape: Unexplained, units: str) -> None:
    scale = _frame(axes, VARIABLES.get(shape.variable, shape.variable), shape.unit, shape.centres, units=units)
    if shape.form.startswith("v "):
        axes.set_ylabel(f"viscous (A s/{shape.unit})")
    error_marks(axes, scale * shape.centres, shape.means, errors=shape.errors, linestyle="-", linewidth=1.0)
    axes.axvline(scale * shape.peak, color=GREY, linewidth=0.8, linestyle=":", zorder=0)


def _frame(axes: Axes, variable: str, unit: str, values: Floats, *, units: str) -> float:
    """Label the axes of a residual; the factor of the variable: degrees if asked for, minutes of long times."""
    is_long = unit == "s" and np.nanmax(np.abs(values), initial=0.0) > MINUTES
    scale, word = (1.0 / 60.0, "min") if is_long else in_unit(unit, units)
    zero_line(axes)
    word = "°C" if word == "degC" else word
    axes.set_xlabel(f"{variable} ({word})" if word else variable, labelpad=1)
    axes.set_ylabel("residual (A)")
    return scale
