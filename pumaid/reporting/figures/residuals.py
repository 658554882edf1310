"""Measured and predicted currents, and the residual against everything that could cause it."""

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
from numpy.typing import NDArray

from pumaid.estimation.evaluate import TOGETHER, JointScore, RunScore
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import (
    BACKWARD,
    FORWARD,
    GREY,
    INK,
    Drawing,
    clock_shifts,
    direction_handles,
    dots,
    panels,
    stacked_bar,
    zero_line,
)
from pumaid.reporting.formatting import amperes, posture_text, shortened
from pumaid.reporting.text import BUDGET_CAPTION, PART_NAMES, part_share

Floats = NDArray[np.float64]

#: Postures of a joint in a figure of currents; bins over position (fine enough for a ripple) and other variables.
MOST_POSTURES, FINE, COARSE = 3, 48, 14

#: A variable is drawn if it varies by more than this: speed (share of the largest), temperature (K), load (A).
SPEED_CHANGE, TEMPERATURE_CHANGE, LOAD_CHANGE = 0.05, 0.5, 1e-6

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


# Currents


def current_figures(context: ReportContext) -> list[Drawing]:
    """Measured and predicted current of each joint, as in the paper's Fig. 4."""
    drawings = []
    for joint in context.moving():
        count = len(context.postures(joint))
        note = f" The {MOST_POSTURES} of {count} postures with most runs." if count > MOST_POSTURES else ""
        title = f"{context.title(joint)}: current against position"
        caption = f"Dots: measured. Lines: predicted, one a run.{note}"
        drawings.append(Drawing(f"current_j{joint}", title, caption, partial(_currents, context, joint)))
    return drawings


def _currents(context: ReportContext, joint: int) -> Figure:
    """One panel a posture."""
    groups = context.postures(joint)[:MOST_POSTURES]
    figure, all_axes = panels(len(groups), height=2.35 if len(groups) == 1 else 1.85, sharex=True, sharey=True)
    unit = " | ".join(dict.fromkeys(context.position_unit(other.number) for other in context.robot.joints))
    for axes, group in zip(all_axes, groups, strict=True):
        _course(axes, context, group)
        axes.grid(axis="y")
        axes.set_ylabel("current (A)")
        posture = posture_text(context.robot, group[0].run.posture.tolist(), context.units)
        axes.text(0.0, 1.02, f"other joints at {posture} {unit}", transform=axes.transAxes, fontsize=8.5)
    all_axes[-1].set_xlabel(f"position of joint {joint} ({context.position_unit(joint)})")
    all_axes[0].set_title(shortened(context.title(joint), 40), pad=18)
    handles = direction_handles(score.run.direction for group in groups for score in group)
    handles.append(Line2D([], [], color=INK, linewidth=1.1, label="predicted"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=1.2)
    return figure


def _course(axes: Axes, context: ReportContext, group: Sequence[RunScore]) -> None:
    """Measured (dots) and predicted (lines) current of runs in one posture."""
    joint = group[0].run.joint
    for sign, colour in ((1, FORWARD), (-1, BACKWARD)):
        scores = [score for score in group if score.run.direction == sign]
        places = [context.shown(joint, score.run.bins.position[:, joint - 1]) for score in scores]
        if scores:
            measured = np.concatenate([score.run.bins.current for score in scores])
            dots(axes, np.concatenate(places), measured, colour=colour, size=2.6, alpha=0.75)
        for score, place in zip(scores, places, strict=True):
            order = np.argsort(place)
            axes.plot(place[order], score.predicted[order], color=INK, linewidth=0.7, zorder=1.5)


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
    names, floor = varying(bins), context.comparison.joints[joint - 1].noise_floor
    figure, all_axes = panels(len(names), height=1.28 if len(names) > 2 else 1.6, sharey=True)
    for axes, name in zip(all_axes, names, strict=True):
        _binned(axes, bins, name, floor)
        axes.set_ylabel("residual (A)")
    all_axes[0].set_title(f"{shortened(context.title(joint), 40)}: residual")
    handles = direction_handles(bins["direction"], backward="s")
    figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=1.2)
    return figure


def joint_residuals(context: ReportContext, joint: int) -> pd.DataFrame:
    """The bins of a joint's runs: direction, run and residual (A), then what it may depend on, in units of the axes."""
    unit, shifts = context.position_unit(joint), clock_shifts([score.run for score in context.comparison.runs])
    parts: list[pd.DataFrame] = []
    for posture, group in enumerate(context.postures(joint), start=1):
        for score in group:
            run, bins = score.run, score.run.bins
            columns = {
                "direction": run.direction,
                "run": len(parts),
                "residual": score.residual,
                f"position ({unit})": context.shown(joint, bins.position[:, joint - 1]),
                f"speed ({unit}/s)": context.shown(joint, np.full(len(bins.time), abs(run.speed))),
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
        values = bins[name].to_numpy()
        values = values[np.isfinite(values)]
        spread = float(np.ptp(values)) if len(values) else 0.0
        least = {"speed": SPEED_CHANGE * float(np.max(values, initial=0.0)), "temperature": TEMPERATURE_CHANGE}
        least |= {"gravity": LOAD_CHANGE, "posture": 0.5, "position": -1.0, "time": -1.0}
        names += [name] if spread > least[name.split()[0]] else []
    return names


def _load(score: RunScore) -> Floats:
    """(M,) A of gravity; NaN where only a sum with it is known, 0 where the joint carries no weight."""
    is_merged = any("gravity" in name.split(TOGETHER) and name != "gravity" for name in score.parts)
    return score.parts.get("gravity", np.full(len(score.predicted), np.nan if is_merged else 0.0))


def _binned(axes: Axes, bins: pd.DataFrame, name: str, floor: float | None) -> None:
    """Residuals as dots, and means over runs in bins of a variable with their standard errors."""
    zero_line(axes, floor)
    is_fine, is_grouped = name.startswith("position"), name.startswith(("speed", "posture"))
    line, size = ("-", 2.4) if is_fine else ("", 4.2)
    for sign, colour, marker in ((1, FORWARD, "o"), (-1, BACKWARD, "s")):
        side = bins[(bins["direction"] == sign) & np.isfinite(bins[name])]
        if side.empty:
            continue
        x, residual = side[name].to_numpy(), side["residual"].to_numpy()
        labels = _groups(x) if is_grouped else _bin_numbers(x, FINE if is_fine else COARSE)
        x = x * (1.0 + 0.006 * sign) if is_grouped else x
        dots(axes, x, residual, colour=colour, size=1.6, alpha=0.28)
        places = pd.Series(x).groupby(labels).mean()
        means = pd.Series(residual).groupby([labels, side["run"].to_numpy()]).mean().groupby(level=0)
        look: dict[str, Any] = {"linewidth": 0.8, "color": colour, "markersize": size, "elinewidth": 1.1, "zorder": 4}
        axes.errorbar(places, means.mean(), yerr=means.sem(), fmt=marker + line, markeredgecolor="none", **look)
    axes.margins(x=0.05 if is_fine else 0.08)
    axes.set_xlabel(name, labelpad=1)
    # The same scale above and below zero, with room for 99 % of the residuals.
    top = 1.3 * max(float(bins["residual"].abs().quantile(0.99)), 1.2 * (floor or 0.0), 1e-9)
    axes.set_ylim(-top, top)


def _bin_numbers(x: Floats, bins: int) -> Floats:
    low, high = x.min(), x.max()
    edges = np.linspace(low, high if high > low else low + 1.0, bins + 1)
    return np.clip(np.digitize(x, edges) - 1, 0, bins - 1).astype(float)


def _groups(x: Floats) -> Floats:
    """Number of the group of like values: those that differ by less than 3 % of the largest belong together."""
    values = np.unique(x)
    steps = np.diff(values) > 0.03 * max(float(np.abs(values).max()), 1e-12)
    return np.concatenate([[0.0], np.cumsum(steps)])[np.searchsorted(values, x)]


def campaign_figure(context: ReportContext) -> Drawing:
    """Error of each run in the order of the logs."""
    caption = (
        "One mark a run: mean residual, bar: ± RMSE, band: noise floor. Diamonds: held-out runs. Hollow: the prediction"
        " depends on parameters that are not identified."
    )
    return Drawing("campaign", "Error of each run", caption, partial(_campaign, context))


def _campaign(context: ReportContext) -> Figure:
    """One panel a joint."""
    joints = context.moving()
    figure, all_axes = panels(len(joints), height=0.92 if len(joints) > 2 else 1.7, width=4.9, sharex=True)
    for axes, joint in zip(all_axes, joints, strict=True):
        floor, top = context.comparison.joints[joint - 1].noise_floor, 0.0
        zero_line(axes, floor)
        for number, score in enumerate(context.comparison.runs, start=1):
            if score.run.joint == joint:
                colour = FORWARD if score.run.direction > 0 else BACKWARD
                face = "none" if score.undetermined else colour
                marker = "D" if score.run.heldout else "o"
                look: dict[str, Any] = {"color": colour, "markersize": 3.2, "markerfacecolor": face, "elinewidth": 0.7}
                axes.errorbar(number, score.bias, yerr=score.rmse, fmt=marker, zorder=3, **look)
                top = max(top, abs(score.bias) + score.rmse)
        top = 1.15 * max(top, floor or 0.0, 1e-9)
        axes.set_ylim(-top, top)
        axes.set_ylabel(f"joint {joint}\n(A)", fontsize=9)
        axes.locator_params(axis="y", nbins=3)
    all_axes[0].set_title("Error of each run")
    all_axes[-1].set_xlabel("run, in the order of the logs")
    handles = direction_handles(score.run.direction for score in context.comparison.runs)
    if any(score.run.heldout for score in context.comparison.runs):
        handles.append(Line2D([], [], linestyle="", marker="D", markersize=4, color=INK, label="held out"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handletextpad=0.2)
    return figure


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
    handles = _budget_bars(axes, context)
    axes.set_title("Residual budget")
    figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=1.1)
    return figure


def _budget_bars(axes: Axes, context: ReportContext) -> list[Patch]:
    """Draw the bars, significant parts first, unassigned parts and noise last; what the legend says of them."""
    order, scores, names = list(PART_COLOURS)[-3:], budgets(context), set()
    for place, score in enumerate(scores):
        budget = score.budget
        assert budget is not None
        parts = sorted(budget.parts, key=lambda p: (order.index(p.name) if p.name in order else -1, -p.mean_square))
        bar = []
        for part in parts:
            is_open = part.name == "unassigned" and not part.is_more
            bar.append((part_share(budget, part), PART_COLOURS[part.name], 0.45 if is_open else 1.0))
            names |= {part.name} if part.mean_square > 0.0 else set()
        stacked_bar(axes, place, bar, room=ROOM)
    axes.set_yticks(range(len(scores)), [f"joint {score.joint}" for score in scores])
    axes.set(ylim=(len(scores) - 0.5, -0.5), xlim=(0.0, 1.0))
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0 %", "25 %", "50 %", "75 %", "100 %"])
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
    drawn = {name.split(" (")[0] for joint in bins for name in varying(bins[joint])}
    words = [word for word in ("position", "speed", "gravity current", "time", "temperature") if word in drawn]
    heights = (0.3 * len(bins) + 1.1, 1.45 * len(bins) + 0.9)
    figure = Figure(figsize=(4.5 + 2.3 * len(words), sum(heights)), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    axes = above.subplots()
    above.legend(handles=_budget_bars(axes, context), loc="outside right center", handlelength=1.1)
    axes.set_title(f"{shortened(context.robot.name)}: residual budget")
    widths = [1.5, 1.5, *[1.0] * (len(words) - 1)]
    all_axes = below.subplots(len(bins), 1 + len(words), squeeze=False, width_ratios=widths)
    for row, joint in zip(all_axes, bins, strict=True):
        _overview_row(row, context, joint, words=words, bins=bins[joint])
    heads = ("measured (dots), predicted", *(f"residual by {word}" for word in words))
    for head, axes in zip(heads, all_axes[0], strict=True):
        axes.set_title(head, fontsize=9.5)
    band = Line2D([], [], color=GREY, alpha=0.4, linewidth=7, label="noise floor")
    ways = direction_handles((score.run.direction for score in context.comparison.runs), backward="s")
    below.legend(handles=[*ways, band], loc="outside lower center", ncols=3)
    return figure


def _overview_row(
    row: Sequence[Axes], context: ReportContext, joint: int, *, words: Sequence[str], bins: pd.DataFrame
) -> None:
    _course(row[0], context, context.postures(joint)[0])
    row[0].set_xlabel(f"position ({context.position_unit(joint)})", labelpad=1)
    row[0].set_ylabel(f"joint {joint} (A)")
    names = {name.split(" (")[0]: name for name in varying(bins)}
    for word, axes in zip(words, row[1:], strict=True):
        if word not in names:
            axes.set_axis_off()
            continue
        _binned(axes, bins, names[word], context.comparison.joints[joint - 1].noise_floor)
        axes.locator_params(axis="y", nbins=4)
        axes.tick_params(axis="y", labelleft=word == "position")
