"""A finding seen: what is left before and after an effect is added, its own line and its rivals'."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pumaid.errors import ResultError
from pumaid.records import Binned, Curve, Diagnosis, Finding, JointDiagnosis
from pumaid.reporting.findings import listed_or, place
from pumaid.reporting.numbers import in_unit, shortened
from pumaid.reporting.plots.style import (
    BACKWARD,
    FORWARD,
    GREY,
    INK,
    Drawing,
    panels,
    saved,
    settle,
    styled,
    way_handles,
)
from pumaid.reporting.story import Story, joint_title
from pumaid.reporting.verdicts import form_sentence, variable_word
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Where it stands among the figures of a report.
ORDER = 60

#: Strokes of the rivals' lines, in turn; the effect's own is unbroken.
DASHES = ((0, (4, 2)), (0, (1.2, 1.4)), (0, (6, 2, 1.2, 2)))

#: s: beyond this a time is told in minutes.
MINUTES = 300.0

#: Times the largest mark that a line may ask for room.
MOST_LINE = 3.0

#: Rows that a picture has room for.
MOST_ROWS = 6


def drawings(story: Story) -> Iterator[Drawing]:
    """A figure for each curve of each finding, those already added last, and for each shape without a name."""
    told = story.diagnosis
    if told is None:
        return
    for kind, findings in (("finding", told.findings), ("added", told.applied)):
        for number, found in enumerate(findings, start=1):
            for curve in found.curves:
                yield Drawing(
                    f"{kind}_{number}_j{curve.joint}",
                    curve_title(found, curve, story.robot),
                    curve_caption(found, curve),
                    partial(draw_curve, found, curve, story.robot, units=story.units),
                    curve.joint,
                )
    for joint in told.joints:
        if joint.unexplained is not None:
            yield Drawing(
                f"unexplained_j{joint.joint}",
                f"{story.title(joint.joint)}: what no effect explains",
                f"Means of what is left over bins of one variable. {form_sentence(joint.unexplained, story.units)}",
                partial(draw_shape, joint, story.robot, units=story.units),
                joint.joint,
            )


def curve_title(found: Finding, curve: Curve, robot: Robot) -> str:
    """Whose current, and which effect."""
    title = joint_title(robot, curve.joint)
    return f"{title}: {found.effect}" + ("" if found.joint == curve.joint else f" of {place(found, robot)}")


def curve_caption(found: Finding, curve: Curve) -> str:
    """How to read a finding's figure."""
    words = "Above: what the model leaves, means over runs with their standard errors; the line is what"
    words += f" {found.effect} changes."
    if len({line.effect for line in curve.lines}) > 1:
        rivals = listed_or(list(dict.fromkeys(line.effect for line in curve.lines[1:] if line.effect != found.effect)))
        words += f" Broken: {rivals}, which these data cannot tell from it; where the lines part, a run would decide."
    return f"{words} Below: what is left with {found.effect} in the model."


def drawn(diagnosis: Diagnosis, robot: Robot, form: str, *, units: str = "rad") -> bytes:
    """All findings in one picture, as the content of a file.

    Parameters
    ----------
    diagnosis, robot
        What was found on which arm.
    form
        ``png``, ``svg`` or ``pdf``.
    units
        ``"rad"`` or ``"deg"``.

    Raises
    ------
    ResultError [nothing-to-draw]
        Nothing was found that has a curve.
    """
    with styled():
        figure = draw(diagnosis, robot, units=units)
        settle(figure)
        return saved(figure, form, f"What is missing from the model of {robot.name}")


def can_be_drawn(diagnosis: Diagnosis) -> bool:
    """Whether there is a curve or a shape to draw."""
    return any(found.curves for found in diagnosis.findings) or any(one.unexplained for one in diagnosis.joints)


def draw(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> Figure:
    """A row a finding: before on the left, after on the right; shapes without a name below."""
    rows: list[tuple[Finding, Curve] | JointDiagnosis] = [
        (found, curve) for found in diagnosis.findings for curve in found.curves
    ]
    rows += [one for one in diagnosis.joints if one.unexplained is not None]
    if not rows:
        raise ResultError("nothing-to-draw", "nothing was found that could be drawn", mend="see: pumaid compare")
    rows = rows[:MOST_ROWS]
    figure = Figure(figsize=(8.4, 2.5 * len(rows) + 0.3), layout="constrained")
    for axes, row in zip(figure.subplots(len(rows), 2, squeeze=False), rows, strict=True):
        if isinstance(row, JointDiagnosis):
            axes[1].remove()
            _shape(axes[0], row, robot, units=units)
            axes[0].set_title(shortened(f"{joint_title(robot, row.joint)}: no effect explains this", 60))
            continue
        found, curve = row
        _panel(axes[0], curve, before=True, units=units)
        _panel(axes[1], curve, before=False, units=units)
        _level(list(axes), curve)
        axes[0].set_title(shortened(curve_title(found, curve, robot), 44))
        axes[1].set_title(shortened(f"with {found.effect}", 44))
        axes[1].set_xlim(axes[0].get_xlim())
        axes[1].legend(handles=_handles(curve), loc="lower right", fontsize=8, ncols=2)
    return figure


def draw_curve(found: Finding, curve: Curve, robot: Robot, *, units: str = "rad") -> Figure:
    """Before above, after below."""
    figure, (above, below) = panels(2, height=1.75, sharex=True, sharey=True)
    _panel(above, curve, before=True, units=units)
    _panel(below, curve, before=False, units=units)
    _level([above, below], curve)
    above.set_xlabel("")
    above.set_title(shortened(curve_title(found, curve, robot), 44))
    below.set_title(shortened(f"with {found.effect}", 44), fontweight="normal")
    figure.legend(handles=_handles(curve), loc="outside lower center", ncols=2, handlelength=2.2)
    return figure


def draw_shape(found: JointDiagnosis, robot: Robot, *, units: str = "rad") -> Figure:
    """Free-form means of what no effect explains."""
    figure, (axes,) = panels(1, height=2.4)
    _shape(axes, found, robot, units=units)
    axes.set_title(shortened(f"{joint_title(robot, found.joint)}: {_form(found)}", 44))
    return figure


def _form(found: JointDiagnosis) -> str:
    return found.unexplained.form if found.unexplained is not None else ""


def _shape(axes: Axes, found: JointDiagnosis, robot: Robot, *, units: str) -> None:
    shape = found.unexplained
    if shape is None:
        return
    times, unit = scaled(shape.unit, shape.centres, units)
    word = variable_word(shape)
    _ground(axes, f"{word} ({unit})" if unit else word)
    if shape.form.startswith("v "):
        axes.set_ylabel(f"viscous (A s/{shape.unit})")
    axes.errorbar(
        times * shape.centres, shape.means, yerr=shape.errors, fmt="o-", color=FORWARD, markersize=3.6, linewidth=1.0,
        elinewidth=1.1, markeredgecolor="none",
    )  # fmt: skip
    axes.axvline(times * shape.peak, color=GREY, linewidth=0.8, linestyle=":", zorder=0)


def scaled(unit: str, values: Floats, units: str) -> tuple[float, str]:
    """What values are multiplied by in a picture, and the unit then: degrees where asked for, minutes of long times."""
    if unit == "s" and np.nanmax(np.abs(values), initial=0.0) > MINUTES:
        return 1.0 / 60.0, "min"
    times, shown = in_unit(unit, units)
    return times, "°C" if shown == "degC" else shown


def _panel(axes: Axes, curve: Curve, *, before: bool, units: str) -> None:
    times, unit = scaled(curve.unit, np.concatenate([side.centres for side in curve.sides]), units)
    _ground(axes, f"{curve.variable} ({unit})" if unit else curve.variable)
    for side in curve.sides:
        _marks(axes, side, side.before if before else side.after, times=times)
    for line in curve.lines if before else ():
        axes.plot(
            times * line.places,
            line.values,
            color=_colour(line.direction),
            linestyle=_stroke(curve, line.effect),
            linewidth=1.4,
            zorder=3,
        )


def _marks(axes: Axes, side: Binned, values: Floats, *, times: float) -> None:
    mark = "s" if side.direction < 0 else "o"
    axes.errorbar(
        times * side.centres, values, yerr=side.errors, fmt=mark, color=_colour(side.direction), markersize=4.0,
        elinewidth=1.1, markeredgecolor="none", zorder=4,
    )  # fmt: skip


def _ground(axes: Axes, label: str) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    axes.set_xlabel(label, labelpad=1)
    axes.set_ylabel("left (A)")
    axes.locator_params(axis="y", nbins=5)


def _level(both: Sequence[Axes], curve: Curve) -> None:
    """The same scale before and after, which shows the marks, and of lines what lies between the runs."""
    marks = [values for side in curve.sides for values in (side.before, side.after)]
    top = max(float(np.nanmax(np.abs(np.concatenate(marks)), initial=0.0)), 1e-9)
    places = np.concatenate([side.centres for side in curve.sides])
    between = [line.values[(line.places >= places.min()) & (line.places <= places.max())] for line in curve.lines]
    farthest = float(np.nanmax(np.abs(np.concatenate(between)), initial=0.0)) if between else 0.0
    top = 1.35 * min(max(top, farthest), MOST_LINE * top)
    for axes in both:
        axes.set_ylim(-top, top)


def _colour(direction: int) -> str:
    return {1: FORWARD, -1: BACKWARD}.get(direction, INK)


def _stroke(curve: Curve, effect: str) -> Literal["-"] | tuple[float, Sequence[float]]:
    names = list(dict.fromkeys(line.effect for line in curve.lines))
    number = names.index(effect)
    return "-" if number == 0 else DASHES[(number - 1) % len(DASHES)]


def _handles(curve: Curve) -> list[Line2D]:
    names = list(dict.fromkeys(line.effect for line in curve.lines))
    ways = way_handles((side.direction for side in curve.sides), backward="s", markersize=4.5, linestyle="none")
    return [*ways, *(Line2D([], [], color=INK, linestyle=_stroke(curve, name), label=name) for name in names)]
