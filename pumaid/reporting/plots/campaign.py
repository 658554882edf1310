"""The error of every run over the campaign: what drifts, what jumps, which runs stand out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pumaid.records import RunScore
from pumaid.reporting.plots.style import BACKWARD, FORWARD, GREY, INK, Drawing, panels, way_handles
from pumaid.reporting.story import Story

#: Where it stands among the figures of a report.
ORDER = 50


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure for the whole arm."""
    if story.comparison.runs:
        yield Drawing(
            "campaign",
            "Error of every run over the campaign",
            "One mark a run: mean of measured minus predicted, the stem its RMSE; the band is the joint's noise floor."
            " Diamonds: held out from fitting. Hollow: the fitted data did not determine all that the run needs.",
            lambda: draw(story),
        )


def draw(story: Story) -> Figure:
    """The figure."""
    joints = story.moving()
    figure, all_axes = panels(len(joints), height=0.92 if len(joints) > 2 else 1.7, width=4.9, sharex=True)
    numbers = {id(score): number for number, score in enumerate(story.comparison.runs, start=1)}
    for axes, joint in zip(all_axes, joints, strict=True):
        scores = story.comparison.of_joint(joint)
        floor = story.comparison.joints[joint - 1].noise_floor
        if floor is not None:
            axes.axhspan(-floor, floor, color=GREY, alpha=0.18, linewidth=0, zorder=0)
        axes.axhline(0.0, color=INK, linewidth=0.7, zorder=1)
        _marks(axes, [(numbers[id(score)], score) for score in scores])
        top = 1.15 * max([floor or 0.0, *(abs(score.bias) + score.rmse for score in scores)])
        axes.set_ylim(-top, top) if top > 0 else None
        axes.set_ylabel(f"joint {joint}\n(A)", fontsize=9)
        axes.locator_params(axis="y", nbins=3)
    all_axes[0].set_title("Error of every run")
    all_axes[-1].set_xlabel("run, in the order of the logs")
    handles = way_handles((score.run.direction for score in story.comparison.runs), linestyle="", markersize=4)
    if any(score.run.heldout for score in story.comparison.runs):
        handles.append(Line2D([], [], linestyle="", marker="D", markersize=4, color=INK, label="held out"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handletextpad=0.2)
    return figure


def _marks(axes: Axes, numbered: list[tuple[int, RunScore]]) -> None:
    looks: dict[tuple[int, bool, bool], list[tuple[int, RunScore]]] = {}
    for number, score in numbered:
        key = (score.run.direction, score.run.heldout, score.undetermined)
        looks.setdefault(key, []).append((number, score))
    for (sign, heldout, hollow), chosen in looks.items():
        colour = FORWARD if sign > 0 else BACKWARD
        place = np.array([float(number) for number, _ in chosen])
        bias = np.array([score.bias for _, score in chosen])
        rmse = np.array([score.rmse for _, score in chosen])
        axes.vlines(place, bias - rmse, bias + rmse, color=colour, linewidth=0.9, alpha=0.45)
        face = "none" if hollow else colour
        axes.plot(place, bias, "D" if heldout else "o", color=colour, markersize=3.2, markerfacecolor=face, zorder=3)
