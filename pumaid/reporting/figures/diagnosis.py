"""Findings: the residual before and after an effect is added, with the curves of the effect and its rivals."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pumaid.diagnosis.records import Binned, Curve, Diagnosis, Finding, JointDiagnosis, Unexplained
from pumaid.reporting.figures.style import BACKWARD, FORWARD, GREY, INK, Drawing, direction_handles, panels, zero_line
from pumaid.reporting.formatting import in_unit, joint_title, listed, shortened
from pumaid.reporting.text import form_sentence, label, place, variable_name
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Line styles of an effect and of its rivals, in turn.
DASHES: tuple[Any, ...] = ("-", (0, (4, 2)), (0, (1.2, 1.4)), (0, (6, 2, 1.2, 2)))
COLOURS = {1: FORWARD, -1: BACKWARD, 0: INK}

#: s above which times are in minutes; range of lines in multiples of the largest mark; rows of a figure.
MINUTES, MOST_RANGE, MOST_ROWS = 300.0, 3.0, 6


def finding_figures(finding: Finding, robot: Robot, *, name: str, units: str = "rad") -> list[Drawing]:
    """One figure for each joint whose current the effect changes most; files are called `name` with the joint."""
    drawings = []
    for curve in finding.curves:
        caption = f"Above: residual, means over runs with standard errors; line: current of {label(finding.effect)}."
        rivals = [effect for effect in _effects(curve) if effect != finding.effect]
        if rivals:
            caption += f" Broken: {listed(rivals, 'or')}; where the lines differ, a run would decide."
        caption += f" Below: residual with {label(finding.effect)} in the model."
        draw = partial(draw_curve, finding, curve, robot, units=units)
        drawings.append(Drawing(f"{name}_j{curve.joint}", _title(finding, curve, robot), caption, draw))
    return drawings


def _title(finding: Finding, curve: Curve, robot: Robot) -> str:
    other = "" if finding.joint == curve.joint else f" of {place(finding, robot)}"
    return f"{joint_title(robot, curve.joint)}: {label(finding.effect)}{other}"


def _effects(curve: Curve) -> list[str]:
    """The effect itself and its rivals, in the order of their lines."""
    return list(dict.fromkeys(line.effect for line in curve.lines))


def shape_figures(joint: JointDiagnosis, robot: Robot, units: str = "rad") -> list[Drawing]:
    """The shape of a residual without a name."""
    shape = joint.unexplained
    if shape is None:
        return []
    name = joint_title(robot, joint.joint)
    caption = f"Means of the residual in bins of {variable_name(shape)}. {form_sentence(shape, units)}"
    draw = partial(_draw_shape, shape, name, units=units)
    return [Drawing(f"unexplained_j{joint.joint}", f"{name}: residual that no effect explains", caption, draw)]


def diagnosis_figure(diagnosis: Diagnosis, robot: Robot, units: str = "rad") -> Drawing:
    """All findings in one figure: before on the left, after on the right; shapes without a name below."""
    title = f"{robot.name}: missing effects"
    return Drawing("diagnosis", title, "", partial(_draw_diagnosis, diagnosis, robot, units=units))


def has_figure(diagnosis: Diagnosis) -> bool:
    """Whether there is a curve or a shape to draw."""
    return any(finding.curves for finding in diagnosis.findings) or any(j.unexplained for j in diagnosis.joints)


def _draw_diagnosis(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> Figure:
    curves = [(finding, curve) for finding in diagnosis.findings for curve in finding.curves]
    shapes = [(joint.joint, joint.unexplained) for joint in diagnosis.joints if joint.unexplained is not None]
    count = min(len(curves) + len(shapes), MOST_ROWS)
    figure = Figure(figsize=(8.4, 2.5 * count + 0.3), layout="constrained")
    rows = figure.subplots(count, 2, squeeze=False)
    for row, (finding, curve) in zip(rows, curves, strict=False):
        _before_and_after(row, finding, curve, robot, units=units)
        row[1].set_xlim(row[0].get_xlim())
        row[1].legend(handles=_handles(curve), loc="lower right", fontsize=8, ncols=2)
    for row, (joint, shape) in zip(rows[len(curves) :], shapes, strict=False):
        row[1].remove()
        _shape(row[0], shape, units)
        row[0].set_title(shortened(f"{joint_title(robot, joint)}: no effect explains this", 60))
    return figure


def draw_curve(finding: Finding, curve: Curve, robot: Robot, *, units: str = "rad") -> Figure:
    """Before above, after below."""
    figure, axes = panels(2, height=1.75, sharex=True, sharey=True)
    _before_and_after(axes, finding, curve, robot, units=units)
    axes[0].set_xlabel("")
    figure.legend(handles=_handles(curve), loc="outside lower center", ncols=2, handlelength=2.2)
    return figure


def _draw_shape(shape: Unexplained, title: str, *, units: str = "rad") -> Figure:
    """Free-form means of a residual."""
    figure, (axes,) = panels(1, height=2.4)
    _shape(axes, shape, units)
    axes.set_title(shortened(f"{title}: {shape.form}", 44))
    return figure


def _before_and_after(both: Sequence[Axes], finding: Finding, curve: Curve, robot: Robot, *, units: str) -> None:
    values = np.concatenate([side.centres for side in curve.sides])
    scale, unit = _scale(curve.unit, values, units)
    for axes, is_before in zip(both, (True, False), strict=True):
        _frame(axes, curve.variable, unit)
        for side in curve.sides:
            _marks(axes, side, side.before if is_before else side.after, scale)
        for line in curve.lines if is_before else ():
            dash = _dash(curve, line.effect)
            axes.plot(scale * line.places, line.values, color=COLOURS[line.direction], linestyle=dash, linewidth=1.4)
    top = _range(curve)
    for axes in both:
        axes.set_ylim(-top, top)
    both[0].set_title(shortened(_title(finding, curve, robot), 44))
    both[1].set_title(shortened(f"with {label(finding.effect)}", 44), fontweight="normal")


def _scale(unit: str, values: Floats, units: str) -> tuple[float, str]:
    """Factor and unit of a figure's axis: degrees if asked for, minutes of long times."""
    if unit == "s" and np.nanmax(np.abs(values), initial=0.0) > MINUTES:
        return 1.0 / 60.0, "min"
    scale, shown = in_unit(unit, units)
    return scale, "°C" if shown == "degC" else shown


def _frame(axes: Axes, variable: str, unit: str) -> None:
    zero_line(axes)
    axes.set_xlabel(f"{variable} ({unit})" if unit else variable, labelpad=1)
    axes.set_ylabel("residual (A)")
    axes.locator_params(axis="y", nbins=5)


def _marks(axes: Axes, side: Binned, values: Floats, scale: float) -> None:
    look: dict[str, Any] = {"fmt": "s" if side.direction < 0 else "o", "color": COLOURS[side.direction]}
    look |= {"markersize": 4.0, "elinewidth": 1.1, "markeredgecolor": "none", "zorder": 4}
    axes.errorbar(scale * side.centres, values, yerr=side.errors, **look)


def _shape(axes: Axes, shape: Unexplained, units: str) -> None:
    scale, unit = _scale(shape.unit, shape.centres, units)
    _frame(axes, variable_name(shape), unit)
    if shape.form.startswith("v "):
        axes.set_ylabel(f"viscous (A s/{shape.unit})")
    look: dict[str, Any] = {"fmt": "o-", "color": FORWARD, "markersize": 3.6, "linewidth": 1.0, "elinewidth": 1.1}
    axes.errorbar(scale * shape.centres, shape.means, yerr=shape.errors, **look)
    axes.axvline(scale * shape.peak, color=GREY, linewidth=0.8, linestyle=":", zorder=0)


def _range(curve: Curve) -> float:
    """Half the range of the residual: all marks, and lines where there are runs."""
    marks = np.concatenate([values for side in curve.sides for values in (side.before, side.after)])
    largest = max(float(np.nanmax(np.abs(marks), initial=0.0)), 1e-9)
    places = np.concatenate([side.centres for side in curve.sides])
    lines = [line.values[(line.places >= places.min()) & (line.places <= places.max())] for line in curve.lines]
    farthest = float(np.nanmax(np.abs(np.concatenate(lines)), initial=0.0)) if lines else 0.0
    return 1.35 * min(max(largest, farthest), MOST_RANGE * largest)


def _dash(curve: Curve, effect: str) -> Any:
    return DASHES[_effects(curve).index(effect) % len(DASHES)]


def _handles(curve: Curve) -> list[Line2D]:
    ways = direction_handles((side.direction for side in curve.sides), backward="s")
    return [*ways, *(Line2D([], [], color=INK, linestyle=_dash(curve, name), label=name) for name in _effects(curve))]
