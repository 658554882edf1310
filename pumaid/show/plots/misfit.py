"""What the model leaves in every joint at a glance: against position and against speed."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pumaid.errors import ResultError, Where
from pumaid.show.numbers import shortened
from pumaid.show.plots.residuals import against_position, against_speed, limited, sides
from pumaid.show.plots.style import GREY, INK, saved, styled, way_handles
from pumaid.show.story import Story

#: Forms of a figure.
FORMS = ("png", "svg", "pdf")


def drawn(story: Story, suffix: str) -> bytes:
    """The figure as a file's content.

    Parameters
    ----------
    story
        With runs of at least one joint.
    suffix
        Of the file's name: ``.png``, ``.svg`` or ``.pdf``.

    Raises
    ------
    ResultError [unknown-figure-form]
        The suffix is another.
    ResultError [nothing-to-draw]
        There is no run.
    """
    form = suffix.lstrip(".").lower()
    if form not in FORMS:
        raise ResultError(
            "unknown-figure-form", f"figures cannot be written as '{suffix}'", mend="use .png, .svg, .pdf"
        )
    if not story.comparison.runs:
        where = Where(file=next(iter(story.comparison.logs), None))
        raise ResultError("nothing-to-draw", "no run was found, so there is no misfit to draw", where, "see: segment")
    with styled():
        return saved(draw(story), form, f"What the model of {story.robot.name} leaves")


def draw(story: Story) -> Figure:
    """One row a joint; position on the left, speed on the right."""
    joints = story.moving()
    figure = Figure(figsize=(7.2, 1.15 * len(joints) + 0.8), layout="constrained")
    all_axes = figure.subplots(len(joints), 2, squeeze=False, sharey="row", width_ratios=(1.7, 1.0))
    for (left, right), joint in zip(all_axes, joints, strict=True):
        both = sides(story, joint)
        floor = story.comparison.joints[joint - 1].noise_floor
        for side in both:
            against_position(left, side, story, joint=joint)
            against_speed(right, side, story, joint=joint)
        for axes in (left, right):
            _ground(axes, floor)
        limited(left, both, floor)
        left.set_ylabel(f"joint {joint} (A)")
        left.set_xlabel(f"position ({story.position_unit(joint)})", labelpad=1)
        right.set_xlabel(f"speed ({story.position_unit(joint)}/s)", labelpad=1)
    all_axes[0][0].set_title(f"{shortened(story.robot.name)}: measured minus predicted")
    handles = [
        *way_handles((score.run.direction for score in story.comparison.runs), backward="s", markersize=4.5),
        Line2D([], [], color=GREY, alpha=0.4, linewidth=7, label="noise floor"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _ground(axes: Axes, floor: float | None) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    if floor is not None:
        axes.axhspan(-floor, floor, color=GREY, alpha=0.18, linewidth=0, zorder=0)
    axes.locator_params(axis="y", nbins=4)
