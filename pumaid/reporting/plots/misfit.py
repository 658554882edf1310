"""How the model does in every joint at a glance: where the error lives, the current, and what is left of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D

from pumaid.errors import ResultError, Where
from pumaid.reporting.numbers import shortened
from pumaid.reporting.plots import budget
from pumaid.reporting.plots.currents import course
from pumaid.reporting.plots.residuals import (
    LOAD,
    TEMPERATURE,
    TIME,
    Left,
    against_load,
    against_position,
    against_speed,
    against_temperature,
    against_time,
    has_load,
    has_temperature,
    limited,
    sides,
)
from pumaid.reporting.plots.style import GREY, INK, saved, styled, way_handles
from pumaid.reporting.story import Story

#: Columns of the figure that every joint has.
CURRENT, POSITION, SPEED = "current", "position", "speed"

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
    """Where the error lives on top; below it one row a joint, the current first and then what is left of it."""
    joints = story.moving()
    known = {joint: sides(story, joint) for joint in joints}
    columns = _columns(known)
    heights = (0.3 * len(joints) + 1.1, 1.45 * len(joints) + 0.9)
    figure = Figure(figsize=(2.2 + 2.3 * len(columns), sum(heights)), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    _budget(above, story)
    widths = [1.5 if word in (CURRENT, POSITION) else 1.0 for word in columns]
    all_axes = below.subplots(len(joints), len(columns), squeeze=False, width_ratios=widths)
    for row, joint in zip(all_axes, joints, strict=True):
        _row(list(row), columns, story, known[joint])
    for word, axes in zip(columns, all_axes[0], strict=True):
        axes.set_title("measured (dots), predicted" if word == CURRENT else f"error by {word}", fontsize=9.5)
    signs = [side.sign for both in known.values() for side in both]
    band = Line2D([], [], color=GREY, alpha=0.4, linewidth=7, label="noise floor")
    ways = way_handles(signs, backward="s", markersize=4.5)
    below.legend(handles=[*ways, band], loc="outside lower center", ncols=3)
    return figure


def _budget(figure: SubFigure, story: Story) -> None:
    axes = figure.subplots()
    budget.stacked(axes, story)
    axes.set_title(f"{shortened(story.robot.name)}: where the error lives")
    parts = budget.handles(budget.told(story))
    figure.legend(handles=parts, loc="outside right center", handlelength=1.1)


def _columns(known: Mapping[int, list[Left]]) -> list[str]:
    """What is drawn: for all joints alike, as far as any joint shows it."""
    words = [CURRENT, POSITION, SPEED]
    words += ["load"] * any(has_load(both) for both in known.values()) + ["time"]
    return words + ["temperature"] * any(has_temperature(both) for both in known.values())


def _row(row: list[Axes], columns: list[str], story: Story, both: list[Left]) -> None:
    """The panels of one joint; what it does not show stays empty."""
    joint, unit = both[0].joint, story.position_unit(both[0].joint)
    floor = story.comparison.joints[joint - 1].noise_floor
    shown: dict[str, tuple[str, Callable[[Axes, Left], None] | None]] = {
        CURRENT: (f"position ({unit})", None),
        POSITION: (f"position ({unit})", partial(against_position, story=story, joint=joint)),
        SPEED: (f"speed ({unit}/s)", partial(against_speed, story=story, joint=joint)),
        "load": (LOAD, against_load if has_load(both) else None),
        "time": (TIME, against_time),
        "temperature": (TEMPERATURE, against_temperature if has_temperature(both) else None),
    }
    for word, axes in zip(columns, row, strict=True):
        label, against = shown[word]
        if word == CURRENT:
            course(axes, story, story.postures(joint)[0])
        elif against is None:
            axes.set_axis_off()
            continue
        else:
            for side in both:
                against(axes, side)
            _ground(axes, floor)
            limited(axes, both, floor)
            axes.tick_params(axis="y", labelleft=word == POSITION)
        axes.set_xlabel(label, labelpad=1)
    row[0].set_ylabel(f"joint {joint} (A)")


def _ground(axes: Axes, floor: float | None) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    if floor is not None:
        axes.axhspan(-floor, floor, color=GREY, alpha=0.18, linewidth=0, zorder=0)
    axes.locator_params(axis="y", nbins=4)
