"""The model: where each joint's current goes, the parameters and how well they are known, and their history."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pumaid.estimate import JointFit, Value
from pumaid.estimation.evaluate import TOGETHER, UNEXPLAINED, JointScore
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import (
    AREAS,
    BACKWARD,
    FORWARD,
    GREY,
    INK,
    Drawing,
    panels,
    stacked_bar,
)
from pumaid.reporting.formatting import amperes, in_unit, shortened
from pumaid.reporting.tables import row_of
from pumaid.reporting.text import changes, is_structural
from pumaid.results.history import Errors, Ladder, Rung
from pumaid.units import number

Floats = NDArray[np.float64]

#: Effect -> colour of its share; other effects take the rest of the palette in turn.
EFFECT_COLOURS = dict(zip(("gravity", "coulomb", "viscous", "inertia"), AREAS, strict=False))
OTHER_COLOURS = AREAS[4:]
EFFECT_NAMES = {"coulomb": "Coulomb friction", "viscous": "viscous friction"}

#: Share of a bar with room for its number.
ROOM = 0.15

#: Panels of the parameters: title, rows of the parameter table.
PANELS = (
    ("gravity: k·g, m·g (A)", (("gravity", "x"), ("gravity", "y"), ("gravity", "mass"))),
    ("Coulomb friction (A)", (("coulomb", "plus"), ("coulomb", "minus"))),
    ("viscous friction ({unit})", (("viscous", "plus"), ("viscous", "minus"))),
    ("gain ratio ηᵢ/ηᵢ₊₁", (("gain_ratio", ""),)),
)
_MARKERS = ((FORWARD, "o", -0.12), (BACKWARD, "s", 0.12), (GREY, "D", 0.0))

#: Models in the figure of a history; inch of its width on a page; characters a model's label has for each inch.
MOST_MODELS, PAGE_WIDTH, LETTERS = 8, 4.9, 9.2


# Shares of the current


def share_figure(context: ReportContext) -> Drawing:
    """Where each joint's current goes."""
    caption = (
        "Left: shares of the mean square of each joint's current, which heats the motor. Right: RMSE (dot) and noise"
        " floor (bar)."
    )
    if any(TOGETHER in name for score in context.comparison.joints for name in score.shares):
        caption += " The fitted logs do not separate effects that share a colour."
    title = f"{context.robot.name}: what the motor currents are spent on"
    return Drawing("spent", title, caption, partial(shares, context))


def shares(context: ReportContext) -> Figure:
    """Bars of shares on the left, what is left on the right."""
    scores = [score for score in context.comparison.joints if score.shares]
    names = [name for name in _ordered(scores) if name != UNEXPLAINED]
    rest = [name for name in names if name not in EFFECT_COLOURS]
    colours = {name: EFFECT_COLOURS[name] for name in names if name in EFFECT_COLOURS}
    colours |= {name: OTHER_COLOURS[k % len(OTHER_COLOURS)] for k, name in enumerate(rest)}
    colours |= {UNEXPLAINED: BACKWARD}
    figure = Figure(figsize=(5.1, 0.42 * len(scores) + 1.95), layout="constrained")
    title = f"{shortened(context.robot.name)}\nWhat the motor currents are spent on"
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    bars, errors = figure.subplots(1, 2, width_ratios=(2.35, 1.0), sharey=True)
    places = np.arange(len(scores))[::-1]
    negative = min(0.0, *(sum(share for share in score.shares.values() if share < 0.0) for score in scores))
    for place, score in zip(places, scores, strict=True):
        parts = [(score.shares.get(name, 0.0), colour, 1.0) for name, colour in colours.items()]
        end = stacked_bar(bars, float(place), parts, room=ROOM * (1.0 - 1.5 * negative))
        bars.text(end + 0.02, place, amperes(score.rms), va="center", fontsize=9.5)
    bars.set_xlim(1.05 * negative if negative < -0.01 else 0.0, 1.3 - negative)
    bars.set_yticks(places, [f"{s.joint}  {shortened(context.robot.joint(s.joint).name, 20)}" for s in scores])
    bars.set_ylim(-0.6, len(scores) - 0.4)
    bars.set_xticks([0.0, 0.5, 1.0], ["0 %", "50 %", "100 %"])
    bars.spines["bottom"].set_bounds(0.0, 1.0)
    bars.set_title("shares, RMS current", fontsize=9.5, fontweight="normal")
    bars.set_xlabel("share of mean square current", x=0.4)
    _error_bars(errors, places, scores)
    for axes in (bars, errors):
        axes.tick_params(axis="y", left=False)
        axes.spines["left"].set_visible(False)
    handles: list[Patch | Line2D] = [Patch(color=colour, label=_label(name)) for name, colour in colours.items()]
    handles.append(Line2D([], [], linestyle="", marker="o", markersize=6.5, color=BACKWARD, label="RMSE"))
    handles.append(Patch(color=GREY, alpha=0.45, label="noise floor"))
    columns = 2 if any(TOGETHER in name for name in names) else 3
    figure.legend(handles=handles, loc="outside lower left", ncols=columns, handlelength=1.0, columnspacing=1.4)
    return figure


def _ordered(scores: Sequence[JointScore]) -> list[str]:
    """Names of shares: the paper's effects first, then by their share in the whole arm."""
    total: dict[str, float] = {}
    for score in scores:
        for name, share in score.shares.items():
            total[name] = total.get(name, 0.0) + abs(share)
    order = list(EFFECT_COLOURS)
    rank = {name: order.index(first) if (first := name.split(TOGETHER)[0]) in order else len(order) for name in total}
    return sorted(total, key=lambda name: (rank[name], name.count(TOGETHER), -total[name]))


def _label(share: str) -> str:
    effects = [EFFECT_NAMES.get(effect, effect.replace("_", " ")) for effect in share.split(TOGETHER)]
    return effects[0] if len(effects) == 1 else " + ".join(effect.removesuffix(" friction") for effect in effects)


def _error_bars(axes: Axes, places: NDArray[Any], scores: Sequence[JointScore]) -> None:
    for place, score in zip(places, scores, strict=True):
        axes.barh(place, score.noise_floor or 0.0, height=0.66, color=GREY, alpha=0.45, linewidth=0)
        if score.rmse is not None:
            axes.plot(score.rmse, place, "o", color=BACKWARD, markersize=6.5, zorder=3)
            look: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": 9}
            axes.annotate(number(score.rmse, 2), (score.rmse, place), (7, 0), **look)
    largest = max(max(score.rmse or 0.0, score.noise_floor or 0.0) for score in scores)
    axes.set_xlim(0.0, 1.7 * largest or 1.0)
    axes.locator_params(axis="x", nbins=2)
    axes.xaxis.set_major_formatter(lambda current, _: f"{current:g}")
    axes.set_title("RMSE", fontsize=9.5, fontweight="normal")
    axes.set_xlabel("current (A)")
    axes.tick_params(labelleft=False)


# Parameters


def parameter_figures(context: ReportContext) -> list[Drawing]:
    """The parameters with their intervals."""
    if not any(value.ci95 is not None for value in context.estimate.values):
        return []
    caption = (
        "Blue circles: x and forward terms; orange squares: y and backward terms; n/i: not identifiable. Intervals"
        " narrower than the mark are hidden by it."
    )
    title = f"{context.robot.name}: parameters with 95 % confidence intervals"
    return [Drawing("parameters", title, caption, partial(intervals, context))]


def intervals(context: ReportContext) -> Figure:
    """Values by link with confidence intervals."""
    values = context.estimate.values
    rows = {row_of(value) for value in values if value.value is not None}
    chosen = [(title, keys) for title, keys in PANELS if rows & set(keys)] or [PANELS[0]]
    figure, all_axes = panels(len(chosen), height=1.45, sharex=True)
    for axes, (title, keys) in zip(all_axes, chosen, strict=True):
        shown = [value for value in values if row_of(value) in keys]
        units = dict.fromkeys(in_unit(value.unit, context.units)[1] for value in shown)
        axes.axhline(0.0, color=INK, linewidth=0.7)
        axes.set_title(title.format(unit=" | ".join(units)), fontsize=9.5, fontweight="normal")
        for value in shown:
            scale = np.linalg.norm(context.robot.gravity) if keys[0][0] == "gravity" else 1.0
            scale *= in_unit(value.unit, context.units)[0]
            _interval(axes, value, float(scale), min(keys.index(row_of(value)), 2))
        drawn = {value.joint for value in shown if value.value is not None}
        for joint in {value.joint for value in shown if not is_structural(value)} - drawn:
            axes.annotate("n/i", (joint or 0, 0.0), (0, 3), textcoords="offset points", ha="center", fontsize=8.5)
        axes.margins(y=0.18)
        axes.grid(axis="y")
    all_axes[-1].set_xticks(range(1, context.robot.n_joints + 1))
    all_axes[-1].set(xlim=(0.5, context.robot.n_joints + 0.5), xlabel="link")
    return figure


def _interval(axes: Axes, value: Value, scale: float, look: int) -> None:
    if value.value is None or value.ci95 is None:
        return
    colour, marker, shift = _MARKERS[look]
    middle, low, high = (scale * item for item in (value.value, *value.ci95))
    style: dict[str, Any] = {"fmt": marker, "color": colour, "markersize": 4.5, "elinewidth": 1.4, "capsize": 2.5}
    axes.errorbar(
        (value.joint or 0) + shift, middle, yerr=np.maximum([[middle - low], [high - middle]], 0.0), zorder=3, **style
    )


# History


def history_figure(ladder: Ladder, *, width: float = 7.2) -> Drawing:
    """The error of each model from the first to the current one."""
    caption = "One step a model, labelled by what it adds. Grey: noise floor, from the differences of repeated runs."
    return Drawing("ladder", f"{ladder.robot}: error of each model", caption, partial(history, ladder, width=width))


def history(ladder: Ladder, *, width: float = 7.2) -> Figure:
    """The whole arm above, each joint below; only one panel where one joint moves."""
    path = ladder.path
    path = path if len(path) <= MOST_MODELS else (path[0], *path[1 - MOST_MODELS :])
    joints = [fit.joint for fit in path[-1].joints if any(rung.joints[fit.joint - 1].rmse is not None for rung in path)]
    columns = 2 if len(joints) in (2, 4) or width <= PAGE_WIDTH else 3
    rows = -(-len(joints) // columns) if len(joints) > 1 else 0
    figure = Figure(figsize=(width, 3.6 + 1.35 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=[3.1, *[1.35] * rows])
    main = figure.add_subplot(grid[0, :])
    whole = [rung.whole if len(joints) != 1 else rung.joints[joints[0] - 1] for rung in path]
    _steps(main, whole, width=2.4)
    main.set_xticks(np.arange(len(path)) + 0.5, _model_labels(path, int(LETTERS * width / len(path))))
    main.set_ylabel("RMSE (A)")
    main.set_title(f"{shortened(ladder.robot)}: error of each model", pad=10)
    for place, joint in enumerate(joints if rows else []):
        axes = figure.add_subplot(grid[1 + place // columns, place % columns])
        _steps(axes, [rung.joints[joint - 1] for rung in path], width=1.6)
        axes.set_xticks(np.arange(len(path)) + 0.5, [str(rung.number) for rung in path])
        axes.set_title(f"joint {joint} (A)", fontsize=9, fontweight="normal")
        axes.locator_params(axis="y", nbins=3)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=FORWARD, linewidth=2.4, label="fitted runs"),
        Line2D([], [], color=BACKWARD, linewidth=2.4, linestyle="--", label="held-out runs"),
        Patch(color=GREY, alpha=0.28, linewidth=0, label="noise floor"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=1.6)
    return figure


def _steps(axes: Axes, errors: Sequence[Errors | JointFit], *, width: float) -> None:
    edges, largest = np.arange(len(errors) + 1), 0.0
    for name, colour, dash in (("noise_floor", GREY, "-"), ("heldout", BACKWARD, "--"), ("rmse", FORWARD, "-")):
        values = np.array([np.nan if (x := getattr(error, name)) is None else x for error in errors], dtype=float)
        if np.isnan(values).all():
            continue
        largest = max(largest, float(np.nanmax(values)))
        steps = np.append(values, values[-1])
        if name == "noise_floor":
            axes.fill_between(edges, 0.0, steps, step="post", color=GREY, alpha=0.28, linewidth=0)
        else:
            axes.step(edges, steps, where="post", color=colour, linewidth=width, linestyle=dash)
    axes.set(ylim=(0.0, 1.18 * largest or 1.0), xlim=(0, len(errors)))


def _model_labels(path: Sequence[Rung], room: int) -> list[str]:
    """Number and changes of each model in lines of about `room` characters; the number alone without room."""
    labels = []
    for before, rung in zip((None, *path), path, strict=False):
        is_next = before is None or rung.parent == before.number
        lines = []
        for phrase in changes(rung) if is_next else ["several steps"]:
            name, at, joints = phrase.partition("@")
            lines += textwrap.wrap(name.replace("_", " "), max(room, 8), break_long_words=False)
            lines += [f"joint{'s' * (not joints.isdecimal())} {joints}"] if at else []
        labels.append("\n".join([str(rung.number), *(lines if room >= 8 else [])]))
    return labels
