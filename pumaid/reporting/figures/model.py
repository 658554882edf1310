"""The model: where each joint's current goes, the parameters and how well they are known, and their history."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pumaid.estimation.evaluate import TOGETHER, UNEXPLAINED, JointScore
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import (
    AREAS,
    BACKWARD,
    FORWARD,
    GREY,
    Drawing,
    error_marks,
    heading,
    legend,
    panels,
    stacked_bar,
    zero_line,
)
from pumaid.reporting.formatting import amperes, in_unit, shortened
from pumaid.reporting.tables import row_of
from pumaid.reporting.text import changes, is_structural
from pumaid.results.history import Ladder, Rung

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

#: Models in the figure of a history; inch of its width on a page; characters a model's label has for each inch.
MOST_MODELS, PAGE_WIDTH, LETTERS = 8, 4.9, 9.2


# Shares of the current


def share_figure(context: ReportContext) -> Drawing:
    """Where each joint's current goes."""
    caption = "Shares of the mean square of each joint's current, which heats the motor; right: RMS current."
    if any(TOGETHER in name for score in context.comparison.joints for name in score.shares):
        caption += " The fitted logs do not separate effects that share a colour."
    title = f"{context.robot.name}: what the motor currents are spent on"
    return Drawing("spent", title, caption, partial(shares, context))


def shares(context: ReportContext) -> Figure:
    """One bar a joint, with the RMS current beside it."""
    scores = [score for score in context.comparison.joints if score.shares]
    names = [name for name in _ordered(scores) if name != UNEXPLAINED]
    rest = [name for name in names if name not in EFFECT_COLOURS]
    colours = {name: EFFECT_COLOURS[name] for name in names if name in EFFECT_COLOURS}
    colours |= {name: OTHER_COLOURS[k % len(OTHER_COLOURS)] for k, name in enumerate(rest)}
    colours |= {UNEXPLAINED: BACKWARD}
    figure = Figure(figsize=(5.1, 0.42 * len(scores) + 1.75), layout="constrained")
    heading(figure, f"{shortened(context.robot.name)}\nWhat the motor currents are spent on")
    axes = figure.subplots()
    negative = min(0.0, *(sum(share for share in score.shares.values() if share < 0.0) for score in scores))
    for row, score in enumerate(scores):
        parts = [(score.shares.get(name, 0.0), colour, 1.0) for name, colour in colours.items()]
        end = stacked_bar(axes, row, parts, room=ROOM * (1.0 - 1.5 * negative))
        axes.text(end + 0.02, row, amperes(score.rms), va="center", fontsize=9.5)
    axes.set_xlim(1.05 * negative if negative < -0.01 else 0.0, 1.2 - negative)
    axes.set_yticks(
        range(len(scores)), [f"{s.joint}  {shortened(context.robot.joint(s.joint).name, 20)}" for s in scores]
    )
    axes.set_ylim(len(scores) - 0.4, -0.6)
    axes.set_xticks([0.0, 0.5, 1.0], ["0 %", "50 %", "100 %"])
    axes.spines["bottom"].set_bounds(0.0, 1.0)
    axes.set_xlabel("share of mean square current", x=0.4)
    axes.tick_params(axis="y", left=False)
    axes.spines["left"].set_visible(False)
    handles = [Patch(color=colour, label=_label(name)) for name, colour in colours.items()]
    legend(figure, handles, 2 if any(TOGETHER in name for name in names) else 3)
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
        zero_line(axes)
        shown = [value for value in values if row_of(value) in keys]
        units = dict.fromkeys(in_unit(value.unit, context.units)[1] for value in shown)
        axes.set_title(title.format(unit=" | ".join(units)), fontsize=9.5, fontweight="normal")
        gravity = np.linalg.norm(context.robot.gravity) if keys[0][0] == "gravity" else 1.0
        for value in shown:
            scale = gravity * in_unit(value.unit, context.units)[0]
            sign = (1, -1, 0)[keys.index(row_of(value))]
            if value.value is not None and value.ci95 is not None:
                low, high = value.ci95
                errors = scale * np.array([[value.value - low], [high - value.value]])
                x = (value.joint or 0) - 0.12 * sign
                error_marks(axes, x, scale * value.value, errors=np.maximum(errors, 0.0), sign=sign, capsize=2.5)
        drawn = {value.joint for value in shown if value.value is not None}
        for joint in {value.joint for value in shown if not is_structural(value)} - drawn:
            axes.annotate("n/i", (joint or 0, 0.0), (0, 3), textcoords="offset points", ha="center", fontsize=8.5)
        axes.margins(y=0.18)
        axes.grid(axis="y")
    all_axes[-1].set_xticks(range(1, context.robot.n_joints + 1))
    all_axes[-1].set(xlim=(0.5, context.robot.n_joints + 0.5), xlabel="link")
    return figure


# History


def history_figure(ladder: Ladder, *, width: float = 7.2) -> Drawing:
    """The error of each model from the first to the current one."""
    caption = "One step a model, labelled by what it adds. Grey: noise floor, from the differences of repeated runs."
    return Drawing("ladder", f"{ladder.robot}: error of each model", caption, partial(history, ladder, width=width))


def history(ladder: Ladder, *, width: float = 7.2) -> Figure:
    """The whole arm's error as steps."""
    path = ladder.path
    path = path if len(path) <= MOST_MODELS else (path[0], *path[1 - MOST_MODELS :])
    figure = Figure(figsize=(width, 3.6), layout="constrained")
    axes, edges, largest = figure.subplots(), np.arange(len(path) + 1), 0.0
    for name, colour, dash in (("noise_floor", GREY, "-"), ("heldout", BACKWARD, "--"), ("rmse", FORWARD, "-")):
        values = np.array([getattr(rung.whole, name) for rung in path], dtype=float)
        largest = max(largest, float(np.nanmax(values, initial=0.0)))
        steps = np.append(values, values[-1])
        if name == "noise_floor":
            axes.fill_between(edges, 0.0, steps, step="post", color=GREY, alpha=0.28, linewidth=0)
        else:
            axes.step(edges, steps, where="post", color=colour, linewidth=2.4, linestyle=dash)
    axes.set(ylim=(0.0, 1.18 * largest or 1.0), xlim=(0, len(path)), ylabel="RMSE (A)")
    axes.set_xticks(edges[:-1] + 0.5, _model_labels(path, int(LETTERS * width / len(path))))
    axes.set_title(f"{shortened(ladder.robot)}: error of each model", pad=10)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=FORWARD, linewidth=2.4, label="fitted runs"),
        Line2D([], [], color=BACKWARD, linewidth=2.4, linestyle="--", label="held-out runs"),
        Patch(color=GREY, alpha=0.28, linewidth=0, label="noise floor"),
    ]
    legend(figure, handles)
    return figure


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
