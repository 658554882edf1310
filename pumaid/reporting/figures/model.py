"""The model: where each joint's current goes, the parameters and how well they are known, and their history."""

import textwrap
from collections import Counter
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pumaid.estimation.evaluate import TOGETHER, UNEXPLAINED
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
    stacked_bars,
    styled,
    zero_line,
)
from pumaid.reporting.formatting import amperes, in_unit, shortened
from pumaid.reporting.tables import row_of
from pumaid.reporting.text import changes, is_structural
from pumaid.results.history import Ladder

#: Effect -> colour of its share; other effects take the rest of the palette in turn.
EFFECT_COLOURS = dict(zip(("gravity", "coulomb", "viscous", "inertia"), AREAS, strict=False))
EFFECT_NAMES = {"coulomb": "Coulomb friction", "viscous": "viscous friction"}

#: Panels of the parameters: title, rows of the parameter table.
PANELS = (
    ("gravity: k·g, m·g (A)", (("gravity", "x"), ("gravity", "y"), ("gravity", "mass"))),
    ("Coulomb friction (A)", (("coulomb", "plus"), ("coulomb", "minus"))),
    ("viscous friction ({unit})", (("viscous", "plus"), ("viscous", "minus"))),
    ("gain ratio ηᵢ/ηᵢ₊₁", (("gain_ratio", ""),)),
)

#: Models in the figure of a history; inch of its width on a page; characters a model's label has for each inch.
MOST_MODELS, PAGE_WIDTH, LETTERS = 8, 4.9, 9.2


@styled()
def share_figure(context: ReportContext) -> Drawing:
    """Where each joint's current goes: one bar a joint, with the RMS current beside it."""
    scores = [score for score in context.comparison.joints if score.shares]
    total = Counter[str]()
    for score in scores:
        total.update({name: abs(share) for name, share in score.shares.items() if name != UNEXPLAINED})
    # The paper's effects first, then those with the largest share in the whole arm.
    order, palette = list(EFFECT_COLOURS), cycle(AREAS[4:])
    first = {name: name.split(TOGETHER)[0] for name in total}
    rank = {name: ([*order, first[name]].index(first[name]), name.count(TOGETHER)) for name in total}
    names = sorted(total, key=lambda name: (rank[name], -total[name]))
    colours = {name: EFFECT_COLOURS.get(name) or next(palette) for name in names} | {UNEXPLAINED: BACKWARD}
    figure = Figure(figsize=(5.1, 0.42 * len(scores) + 1.75), layout="constrained")
    bars = {
        f"{score.joint}  {shortened(context.robot.joint(score.joint).name, 20)}": (
            [(score.shares.get(name, 0.0), colour, 1.0) for name, colour in colours.items()],
            amperes(score.rms),
        )
        for score in scores
    }
    stacked_bars(figure.subplots(), bars, "share of mean square current")
    handles = []
    for name, colour in colours.items():
        effects = [EFFECT_NAMES.get(effect, effect.replace("_", " ")) for effect in name.split(TOGETHER)]
        words = [effect.removesuffix(" friction") for effect in effects] if len(effects) > 1 else effects
        handles.append(Patch(color=colour, label=" + ".join(words)))
    is_merged = any(TOGETHER in name for name in names)
    legend(figure, handles, 2 if is_merged else 3)
    heading(figure, f"{shortened(context.robot.name)}\nWhat the motor currents are spent on")
    caption = "Shares of the mean square of each joint's current, which heats the motor; right: RMS current."
    caption += " The fitted logs do not separate effects that share a colour." if is_merged else ""
    return Drawing("spent", f"{context.robot.name}: what the motor currents are spent on", caption, figure)


@styled()
def parameter_figure(context: ReportContext) -> Drawing:
    """Values by link with their confidence intervals."""
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
    caption = (
        "Blue circles: x and forward terms; orange squares: y and backward terms; n/i: not identifiable. Intervals"
        " narrower than the mark are hidden by it."
    )
    title = f"{context.robot.name}: parameters with 95 % confidence intervals"
    return Drawing("parameters", title, caption, figure)


@styled()
def history_figure(ladder: Ladder, *, width: float = 7.2) -> Drawing:
    """The whole arm's error of each model, from the first to the current one, as steps."""
    path = ladder.path
    path = path if len(path) <= MOST_MODELS else (path[0], *path[1 - MOST_MODELS :])
    figure = Figure(figsize=(width, 3.6), layout="constrained")
    axes, edges = figure.subplots(), np.arange(len(path) + 1)
    values = np.array([list(rung.whole.values()) for rung in path], dtype=float).T
    fitted, heldout, floor = np.column_stack([values, values[:, -1]])
    axes.step(edges, fitted, where="post", color=FORWARD, linewidth=2.4, label="fitted runs")
    axes.step(edges, heldout, "--", where="post", color=BACKWARD, linewidth=2.4, label="held-out runs")
    look: Any = {"color": GREY, "alpha": 0.28, "linewidth": 0, "zorder": 0}
    axes.fill_between(edges, 0.0, floor, step="post", label="noise floor", **look)
    axes.set(ylim=(0.0, 1.18 * np.nanmax(values, initial=0.0) or 1.0), xlim=(0, len(path)), ylabel="RMSE (A)")
    labels, room = [], int(LETTERS * width / len(path))
    for before, rung in zip((None, *path), path, strict=False):
        lines = []
        for phrase in changes(rung) if before is None or rung.parent == before.number else ["several steps"]:
            effect, at, joints = phrase.partition("@")
            lines += textwrap.wrap(effect.replace("_", " "), max(room, 8), break_long_words=False)
            lines += [f"joint{'s' * (not joints.isdecimal())} {joints}"] if at else []
        labels.append("\n".join([str(rung.number), *(lines if room >= 8 else [])]))
    axes.set_xticks(edges[:-1] + 0.5, labels)
    axes.set_title(f"{shortened(ladder.robot)}: error of each model", pad=10)
    legend(figure, axes.get_legend_handles_labels()[0])
    caption = "One step a model, labelled by what it adds. Grey: noise floor, from the differences of repeated runs."
    return Drawing("ladder", f"{ladder.robot}: error of each model", caption, figure)
