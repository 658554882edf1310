"""How much of every joint's error is noise, and where the rest lives, as bars that add up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pumaid.records import Budget, JointScore
from pumaid.reporting.budget import CAPTION, LABELS, part_share
from pumaid.reporting.numbers import amperes
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.story import Story

#: Where it stands among the figures of a report.
ORDER = 25

#: Part -> colour: greys for noise, and colours that all kinds of colour vision tell apart for what has a cause.
COLOURS = {
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

#: Colours on which dark words are read better than white ones.
PALE = {"#a9b0ba", "#d3d7dd", "#de8f05", "#cc78bc", "#ece133"}
DARK_WORDS = "#1b1e23"

#: Parts that end a bar, in this order.
LAST = ("unassigned", "noise_inside", "noise_shared")

#: A share below this has no room for a number in its bar.
ROOM = 0.09


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure for the whole arm."""
    if told(story):
        yield Drawing(
            "budget",
            "Where the error lives",
            "Each bar is a joint's whole error squared, split into parts that add up. " + CAPTION,
            lambda: draw(story),
        )


def told(story: Story) -> list[JointScore]:
    """Joints that have a budget."""
    return [score for score in story.comparison.joints if score.budget is not None]


def draw(story: Story) -> Figure:
    """The figure."""
    scores = told(story)
    figure = Figure(figsize=(5.1, 0.42 * len(scores) + 1.5), layout="constrained")
    axes = figure.subplots()
    stacked(axes, story)
    axes.set_title("Where the error lives")
    figure.legend(handles=handles(scores), loc="outside lower center", ncols=2, columnspacing=1.4, handlelength=1.1)
    return figure


def stacked(axes: Axes, story: Story) -> None:
    """One bar a joint, the first on top; shares of the error squared."""
    scores = told(story)
    for place, score in enumerate(scores):
        if score.budget is not None:
            _bar(axes, score.budget, place)
    axes.set_yticks(np.arange(len(scores)), [f"joint {score.joint}" for score in scores])
    axes.set_ylim(len(scores) - 0.5, -0.5)
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], [percent_mark(share) for share in (0.0, 0.25, 0.5, 0.75, 1.0)])
    axes.set_xlabel("share of the error squared", labelpad=1)
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    right = axes.secondary_yaxis("right")
    right.set_yticks(np.arange(len(scores)), [amperes(score.rmse) for score in scores])
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)


def percent_mark(share: float) -> str:
    """A tick's label."""
    return f"{100.0 * share:.0f} %"


def _bar(axes: Axes, budget: Budget, place: int) -> None:
    """Causes first, the largest next to the axis; what nobody can assign, and noise, last."""
    order = sorted(
        budget.parts, key=lambda part: (LAST.index(part.name) if part.name in LAST else -1, -part.mean_square)
    )
    start = 0.0
    for part in order:
        share = part_share(budget, part)
        if share <= 0.0:
            continue
        colour = COLOURS[part.name]
        is_open = part.name == "unassigned" and not part.is_more
        axes.barh(
            place, share, left=start, height=0.72, color=colour, alpha=0.45 if is_open else 1.0, edgecolor="white",
            linewidth=0.6,
        )  # fmt: skip
        if share >= ROOM:
            ink = DARK_WORDS if colour in PALE or is_open else "white"
            axes.text(
                start + 0.5 * share, place, percent_mark(share), ha="center", va="center", color=ink, fontsize=8.5
            )
        start += share


def handles(scores: Sequence[JointScore]) -> list[Patch]:
    """What a legend says: the parts that are there."""
    there = {part.name for score in scores if score.budget for part in score.budget.parts if part.mean_square > 0.0}
    return [Patch(color=colour, label=LABELS[name]) for name, colour in COLOURS.items() if name in there]
