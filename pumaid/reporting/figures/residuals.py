"""Currents and residuals: measured and predicted, the residual by variable, its parts, and what findings explain."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from pumaid.dataset import BLOCK
from pumaid.diagnosis.records import Curve, Diagnosis, Finding, JointDiagnosis, Unexplained
from pumaid.estimation.evaluate import TOGETHER, JointScore, RunScore
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import (
    COLOURS,
    GREY,
    INK,
    Drawing,
    clock_shifts,
    direction_handles,
    dots,
    error_marks,
    legend,
    panels,
    stacked_bar,
    zero_line,
)
from pumaid.reporting.formatting import amperes, in_unit, joint_title, listed, posture_text, shortened
from pumaid.reporting.text import (
    BUDGET_CAPTION,
    PART_NAMES,
    form_sentence,
    label,
    part_share,
    place,
    variable_name,
)
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Postures of a joint in a figure of currents; bins over position (fine enough for a ripple) and other variables.
MOST_POSTURES, FINE, COARSE = 3, 48, 14

#: A variable is drawn if it varies by more than this: speed (share of the largest), A, posture, K; others always.
LEAST = {"speed": 0.05, "gravity": 1e-6, "posture": 0.5, "temperature": 0.5}

#: Share of a bar with room for its number.
ROOM = 0.1

#: Part of the residual budget -> colour: greys for noise.
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


def current_figures(context: ReportContext) -> list[Drawing]:
    """Measured and predicted current of each joint, as in the paper's Fig. 4."""
    drawings = []
    for joint in context.moving():
        count = len(context.postures(joint))
        note = f" The {MOST_POSTURES} of {count} postures with most runs." if count > MOST_POSTURES else ""
        variable = "time" if _is_free(context, joint) else "position"
        title = f"{context.title(joint)}: current against {variable}"
        caption = f"Dots: measured. Lines: predicted, one a run.{note}"
        drawings.append(Drawing(f"current_j{joint}", title, caption, partial(_currents, context, joint)))
    return drawings


def _currents(context: ReportContext, joint: int) -> Figure:
    """One panel a posture; of a joint with blocks of any motion only, one a block, against time."""
    is_free = _is_free(context, joint)
    groups = context.postures(joint)[:MOST_POSTURES]
    if is_free:
        groups = [[score] for score in groups[0][:MOST_POSTURES]]
    figure, all_axes = panels(len(groups), height=2.35 if len(groups) == 1 else 1.85, sharex=True, sharey=True)
    unit = " | ".join(dict.fromkeys(context.position_unit(other.number) for other in context.robot.joints))
    for axes, group in zip(all_axes, groups, strict=True):
        _course(axes, context, group)
        axes.grid(axis="y")
        axes.set_ylabel("current (A)")
        posture = posture_text(context.robot, group[0].run.posture.tolist(), context.units)
        words = f"block from {group[0].run.start:.1f} s" if is_free else f"other joints at {posture} {unit}"
        axes.text(0.0, 1.02, words, transform=axes.transAxes, fontsize=8.5)
    place = f"position of joint {joint} ({context.position_unit(joint)})"
    all_axes[-1].set_xlabel("time (s)" if is_free else place)
    all_axes[0].set_title(shortened(context.title(joint), 40), pad=18)
    predicted = Line2D([], [], color=INK, linewidth=1.1, label="predicted")
    ways = [1, -1] if is_free else [score.run.direction for group in groups for score in group]
    legend(figure, [*direction_handles(ways), predicted])
    return figure


def _is_free(context: ReportContext, joint: int) -> bool:
    """Whether a joint has blocks of any motion only."""
    return all(score.run.kind == BLOCK for score in context.comparison.of_joint(joint))


def _course(axes: Axes, context: ReportContext, group: Sequence[RunScore]) -> None:
    """Measured (dots) and predicted (lines) current of runs in one posture, or of a block."""
    joint = group[0].run.joint
    if group[0].run.kind == BLOCK:
        bins = group[0].run.bins
        for sign in (1, -1):
            rows = np.sign(bins.velocity) == sign
            dots(axes, bins.time[rows] - group[0].run.start, bins.current[rows], colour=COLOURS[sign], size=2.6)
        steps = np.diff(bins.time)
        for rows in np.split(np.arange(len(bins)), np.flatnonzero(steps > 1.5 * np.median(steps)) + 1):
            since = bins.time[rows] - group[0].run.start
            axes.plot(since, group[0].predicted[rows], color=INK, linewidth=0.7, zorder=1.5)
        return
    for sign in (1, -1):
        scores = [score for score in group if score.run.direction == sign]
        positions = [context.shown(joint, score.run.bins.position[:, joint - 1]) for score in scores]
        if scores:
            measured = np.concatenate([score.run.bins.current for score in scores])
            dots(axes, np.concatenate(positions), measured, colour=COLOURS[sign], size=2.6, alpha=0.75)
        for score, position in zip(scores, positions, strict=True):
            order = np.argsort(position)
            axes.plot(position[order], score.predicted[order], color=INK, linewidth=0.7, zorder=1.5)


# Residuals


def residual_figures(context: ReportContext) -> list[Drawing]:
    """The residual of each joint against position, speed, load, time, posture and temperature, as far as they vary."""
    drawings = []
    for joint in context.moving():
        postures = [group[0].run.posture.tolist() for group in context.postures(joint)[:4]]
        texts = [f"{k} = {posture_text(context.robot, p, context.units)}" for k, p in enumerate(postures, start=1)]
        caption = f"Postures ({context.position_unit(joint)}): {'; '.join(texts)}."
        title = f"{context.title(joint)}: residual"
        drawings.append(Drawing(f"residual_j{joint}", title, caption, partial(_residuals, context, joint)))
    return drawings


def _residuals(context: ReportContext, joint: int) -> Figure:
    """One panel a variable."""
    bins = joint_residuals(context, joint)
    names = varying(bins)
    figure, all_axes = panels(len(names), height=1.28 if len(names) > 2 else 1.6, sharey=True)
    for axes, name in zip(all_axes, names, strict=True):
        _binned(axes, bins, name, context.comparison.joints[joint - 1].noise_floor)
        axes.set_ylabel("residual (A)")
    all_axes[0].set_title(f"{shortened(context.title(joint), 40)}: residual")
    legend(figure, direction_handles(bins["direction"]))
    return figure


def joint_residuals(context: ReportContext, joint: int) -> pd.DataFrame:
    """The bins of a joint's runs: direction, run and residual (A), then what it may depend on, in units of the axes."""
    unit, shifts = context.position_unit(joint), clock_shifts([score.run for score in context.comparison.runs])
    parts: list[pd.DataFrame] = []
    for posture, group in enumerate(context.postures(joint), start=1):
        for score in group:
            run, bins = score.run, score.run.bins
            speed = np.abs(bins.velocity) if run.kind == BLOCK else np.full(len(bins.time), abs(run.speed))
            columns = {
                "direction": np.sign(bins.velocity) if run.kind == BLOCK else run.direction,
                "run": len(parts),
                "residual": score.residual,
                f"position ({unit})": context.shown(joint, bins.position[:, joint - 1]),
                f"speed ({unit}/s)": context.shown(joint, speed),
                "gravity current (A)": _load(score),
                "time (min)": (bins.time + shifts[run.clock]) / 60.0,
                "posture (number)": float(posture),
                "temperature (°C)": bins.temperature,
            }
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def varying(bins: pd.DataFrame) -> list[str]:
    """Names of the variables that vary enough to show a dependence; position and time always."""
    names = []
    for name in bins.columns[3:]:
        word, spread = name.split()[0], bins[name].max() - bins[name].min()
        least = LEAST.get(word, -1.0) * (bins[name].max() if word == "speed" else 1.0)
        names += [name] if spread > least else []
    return names


def _load(score: RunScore) -> Floats:
    """(M,) A of gravity; NaN where only a sum with it is known, 0 where the joint carries no weight."""
    is_merged = any("gravity" in name.split(TOGETHER) and name != "gravity" for name in score.parts)
    return score.parts.get("gravity", np.full(len(score.predicted), np.nan if is_merged else 0.0))


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
        dots(axes, side[name].to_numpy(), side["residual"].to_numpy(), colour=COLOURS[sign], size=1.6, alpha=0.28)
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


def budgets(context: ReportContext) -> list[JointScore]:
    """Joints that have a budget."""
    return [score for score in context.comparison.joints if score.budget is not None]


def budget_figure(context: ReportContext) -> Drawing:
    """Parts of each joint's mean squared residual, one bar a joint."""
    return Drawing("budget", "Residual budget", BUDGET_CAPTION, partial(_budget, context))


def _budget(context: ReportContext) -> Figure:
    figure = Figure(figsize=(5.1, 0.42 * len(budgets(context)) + 1.5), layout="constrained")
    axes = figure.subplots()
    legend(figure, _budget_bars(axes, context), 2)
    axes.set_title("Residual budget")
    return figure


def _budget_bars(axes: Axes, context: ReportContext) -> list[Patch]:
    """Draw the bars, significant parts first, unassigned parts and noise last; what the legend says of them."""
    order, scores, names = list(PART_COLOURS)[-3:], budgets(context), set()
    for row, score in enumerate(scores):
        budget = score.budget
        assert budget is not None
        parts = sorted(budget.parts, key=lambda p: (order.index(p.name) if p.name in order else -1, -p.mean_square))
        bar = []
        for part in parts:
            is_open = part.name == "unassigned" and not part.is_more
            bar.append((part_share(budget, part), PART_COLOURS[part.name], 0.45 if is_open else 1.0))
            names |= {part.name} if part.mean_square > 0.0 else set()
        stacked_bar(axes, row, bar, room=ROOM)
    axes.set_yticks(range(len(scores)), [f"joint {score.joint}" for score in scores])
    axes.set(ylim=(len(scores) - 0.5, -0.5), xlim=(0.0, 1.0))
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlabel("share of the mean squared residual (right: RMSE)", labelpad=1)
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(len(scores)), [amperes(score.rmse) for score in scores])
    for side, spine in ((axes, "left"), (right, "right")):
        side.tick_params(axis="y", length=0)
        side.spines[spine].set_visible(False)
    return [Patch(color=colour, label=PART_NAMES[name]) for name, colour in PART_COLOURS.items() if name in names]


# All of it at a glance


def overview_figure(context: ReportContext) -> Drawing:
    """The budget on top; below it a row a joint, the current first and then its residual by variable."""
    return Drawing("overview", f"{context.robot.name}: model errors", "", partial(_overview, context))


def _overview(context: ReportContext) -> Figure:
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
    for row, (joint, names) in zip(rows, drawn.items(), strict=True):
        _course(row[0], context, context.postures(joint)[0])
        row[0].set_xlabel(f"position ({context.position_unit(joint)})", labelpad=1)
        row[0].set_ylabel(f"joint {joint} (A)")
        for word, axes in zip(words, row[1:], strict=True):
            if word not in names:
                axes.set_axis_off()
                continue
            _binned(axes, bins[joint], names[word], context.comparison.joints[joint - 1].noise_floor)
            axes.tick_params(axis="y", labelleft=word == "position")
    heads = ("measured (dots), predicted", *(f"residual by {word}" for word in words))
    for head, axes in zip(heads, rows[0], strict=True):
        axes.set_title(head, fontsize=9.5)
    band = Patch(color=GREY, alpha=0.4, label="noise floor")
    legend(below, [*direction_handles(score.run.direction for score in context.comparison.runs), band])
    return figure


# Findings


def finding_figures(finding: Finding, robot: Robot, *, name: str, units: str = "rad") -> list[Drawing]:
    """One figure for each joint whose current the effect changes most; files are called `name` with the joint."""
    drawings = []
    for curve in finding.curves:
        caption = f"Above: residual, means over runs with standard errors; line: current of {label(finding.effect)}."
        rivals = [effect for effect in _effects(curve) if effect != finding.effect]
        if rivals:
            caption += f" Broken: {listed(rivals, 'or')}; where the lines differ, a run would decide."
        caption += f" Below: residual with {label(finding.effect)} in the model."
        draw = partial(draw_curve, finding, curve, robot, units=units)
        drawings.append(Drawing(f"{name}_j{curve.joint}", _finding_title(finding, curve, robot), caption, draw))
    return drawings


def _finding_title(finding: Finding, curve: Curve, robot: Robot) -> str:
    other = "" if finding.joint == curve.joint else f" of {place(finding, robot)}"
    return f"{joint_title(robot, curve.joint)}: {label(finding.effect)}{other}"


def _effects(curve: Curve) -> list[str]:
    """The effect itself and its rivals, in the order of their lines."""
    return list(dict.fromkeys(line.effect for line in curve.lines))


def shape_figures(joint: JointDiagnosis, robot: Robot, units: str = "rad") -> list[Drawing]:
    """The shape of a residual without a name."""
    shape = joint.unexplained
    if shape is None:
        return []
    name = joint_title(robot, joint.joint)
    caption = f"Means of the residual in bins of {variable_name(shape)}. {form_sentence(shape, units)}"

    def draw() -> Figure:
        figure, (axes,) = panels(1, height=2.4)
        _shape(axes, shape, units)
        axes.set_title(shortened(f"{name}: {shape.form}", 44))
        return figure

    return [Drawing(f"unexplained_j{joint.joint}", f"{name}: residual that no effect explains", caption, draw)]


def diagnosis_figure(diagnosis: Diagnosis, robot: Robot, units: str = "rad") -> Drawing | None:
    """All findings in one figure: before on the left, after on the right; shapes without a name below.

    None where there is nothing to draw.
    """
    curves = [(finding, curve) for finding in diagnosis.findings for curve in finding.curves]
    shapes = [(joint.joint, joint.unexplained) for joint in diagnosis.joints if joint.unexplained is not None]
    count = min(len(curves) + len(shapes), MOST_ROWS)

    def draw() -> Figure:
        figure = Figure(figsize=(8.4, 2.5 * count + 0.3), layout="constrained")
        rows = figure.subplots(count, 2, squeeze=False)
        for row, (finding, curve) in zip(rows, curves, strict=False):
            row[1].sharex(row[0])
            _before_and_after(row, finding, curve, robot, units=units)
            row[1].legend(handles=_handles(curve), loc="lower right", fontsize=8, ncols=2)
        for row, (joint, shape) in zip(rows[len(curves) :], shapes, strict=False):
            row[1].remove()
            _shape(row[0], shape, units)
            row[0].set_title(shortened(f"{joint_title(robot, joint)}: no effect explains this", 60))
        return figure

    return Drawing("diagnosis", f"{robot.name}: missing effects", "", draw) if count else None


def draw_curve(finding: Finding, curve: Curve, robot: Robot, *, units: str = "rad") -> Figure:
    """Before above, after below."""
    figure, axes = panels(2, height=1.75, sharex=True)
    _before_and_after(axes, finding, curve, robot, units=units)
    axes[0].set_xlabel("")
    legend(figure, _handles(curve), 2)
    return figure


def _before_and_after(both: Sequence[Axes], finding: Finding, curve: Curve, robot: Robot, *, units: str) -> None:
    values = np.concatenate([side.centres for side in curve.sides])
    scale, unit = _scale(curve.unit, values, units)
    largest = 1e-9
    for axes, name in zip(both, ("before", "after"), strict=True):
        _frame(axes, curve.variable, unit)
        for side in curve.sides:
            means = getattr(side, name)
            error_marks(axes, scale * side.centres, means, errors=side.errors, sign=side.direction)
            largest = max(largest, float(np.nanmax(np.abs(means), initial=0.0)))
    for line in curve.lines:
        look: dict[str, Any] = {"color": COLOURS[line.direction], "linestyle": _dash(curve, line.effect)}
        both[0].plot(scale * line.places, line.values, linewidth=1.4, **look)
    for axes in both:
        axes.set_ylim(-RANGE * largest, RANGE * largest)
    both[0].set_title(shortened(_finding_title(finding, curve, robot), 44))
    both[1].set_title(shortened(f"with {label(finding.effect)}", 44), fontweight="normal")


def _scale(unit: str, values: Floats, units: str) -> tuple[float, str]:
    """Factor and unit of an axis: degrees if asked for, minutes of long times."""
    if unit == "s" and np.nanmax(np.abs(values), initial=0.0) > MINUTES:
        return 1.0 / 60.0, "min"
    scale, shown = in_unit(unit, units)
    return scale, "°C" if shown == "degC" else shown


def _frame(axes: Axes, variable: str, unit: str) -> None:
    zero_line(axes)
    axes.set_xlabel(f"{variable} ({unit})" if unit else variable, labelpad=1)
    axes.set_ylabel("residual (A)")


def _shape(axes: Axes, shape: Unexplained, units: str) -> None:
    scale, unit = _scale(shape.unit, shape.centres, units)
    _frame(axes, variable_name(shape), unit)
    if shape.form.startswith("v "):
        axes.set_ylabel(f"viscous (A s/{shape.unit})")
    error_marks(axes, scale * shape.centres, shape.means, errors=shape.errors, linestyle="-", linewidth=1.0)
    axes.axvline(scale * shape.peak, color=GREY, linewidth=0.8, linestyle=":", zorder=0)


def _dash(curve: Curve, effect: str) -> Any:
    return DASHES[_effects(curve).index(effect) % len(DASHES)]


def _handles(curve: Curve) -> list[Patch | Line2D]:
    lines = [Line2D([], [], color=INK, linestyle=_dash(curve, name), label=name) for name in _effects(curve)]
    return [*direction_handles(side.direction for side in curve.sides), *lines]
