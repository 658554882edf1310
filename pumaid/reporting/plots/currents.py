"""Measured and predicted current against position, both directions, as in the paper's Fig. 4."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pumaid.records import RunScore
from pumaid.reporting.numbers import shortened
from pumaid.reporting.plots.style import BACKWARD, FORWARD, INK, Drawing, dots, panels, way_handles
from pumaid.reporting.scores import posture_text
from pumaid.reporting.story import Story

#: Where it stands among the figures of a report.
ORDER = 20

#: Postures shown for a joint; those with most runs.
MOST_POSTURES = 3


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure for each joint that has runs."""
    for joint in story.moving():
        groups = story.postures(joint)
        more = f" The {MOST_POSTURES} of {len(groups)} postures with most runs are shown." * (
            len(groups) > MOST_POSTURES
        )
        yield Drawing(
            f"current_j{joint}",
            f"{story.title(joint)}: current against position",
            "Dots: measured. Lines: predicted, one a run." + more,
            partial(draw, story, joint),
            joint,
        )


def draw(story: Story, joint: int) -> Figure:
    """The figure of joint `joint` (from 1)."""
    groups = story.postures(joint)[:MOST_POSTURES]
    figure, all_axes = panels(len(groups), height=2.35 if len(groups) == 1 else 1.85, sharex=True, sharey=True)
    for axes, group in zip(all_axes, groups, strict=True):
        _posture(axes, story, group)
    all_axes[-1].set_xlabel(f"position of joint {joint} ({story.position_unit(joint)})")
    all_axes[0].set_title(shortened(story.title(joint), 40), pad=18)
    handles = [
        *way_handles((score.run.direction for group in groups for score in group), linestyle="", markersize=4),
        Line2D([], [], color=INK, linewidth=1.1, label="predicted"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=1.2, columnspacing=1.6)
    return figure


def _posture(axes: Axes, story: Story, group: Sequence[RunScore]) -> None:
    course(axes, story, group)
    axes.grid(axis="y")
    axes.set_ylabel("current (A)")
    unit = " | ".join(dict.fromkeys(story.position_unit(other.number) for other in story.robot.joints))
    axes.text(
        0.0, 1.02, f"others held at {posture_text(group[0].run, story.robot, story.units)} {unit}",
        transform=axes.transAxes, fontsize=8.5,
    )  # fmt: skip


def course(axes: Axes, story: Story, group: Sequence[RunScore]) -> None:
    """Measured (dots) and predicted (lines) current of runs in one posture, both directions."""
    joint = group[0].run.joint
    for sign, colour in ((1, FORWARD), (-1, BACKWARD)):
        side = [score for score in group if score.run.direction == sign]
        if side:
            bins = [score.run.bins for score in side]
            position = story.shown(joint, np.concatenate([cell.position[:, joint - 1] for cell in bins]))
            current = np.concatenate([cell.current for cell in bins])
            dots(axes, position, current, colour=colour, size=2.6, alpha=0.75)
        for score in side:
            order = np.argsort(score.run.bins.position[:, joint - 1])
            place = story.shown(joint, score.run.bins.position[order, joint - 1])
            axes.plot(place, score.predicted[order], color=INK, linewidth=0.7, zorder=1.5)
