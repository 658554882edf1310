"""The picture of an effect's signature: its current against the variable in which it lives, in both directions."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pumaid.effects import Effect
from pumaid.reporting.plots.style import BACKWARD, FORWARD, GREY, INK, NARROW, Drawing, panels
from pumaid.reporting.signature import Signature, signature

#: Letters of one line above and below the panel: what its width holds of either size of type.
TITLE, LINE = 45, 72


def drawing(effect: Effect) -> Drawing:
    """An effect's signature as a figure of its own."""
    return Drawing(
        effect.name,
        f"{effect.name}: {effect.title}",
        "Current at the example values of its parameters, moving forward and backward.",
        lambda: draw(effect),
    )


def draw(effect: Effect) -> Figure:
    """The figure."""
    shown = signature(effect)
    figure, (axes,) = panels(1, height=2.6, width=NARROW)
    axes.axhline(0.0, color=INK, linewidth=0.7, zorder=1)
    for name, value in shown.marks:
        if shown.values[0] <= value <= shown.values[-1]:
            _mark(axes, name, value)
    _curves(axes, shown)
    axes.set_xlim(shown.values[0], shown.values[-1])
    axes.margins(y=0.14)
    axes.set_xlabel(f"{shown.variable} ({shown.unit})")
    axes.set_ylabel("current (A)")
    axes.set_title(_lines(effect.title, TITLE), pad=20)
    values = ", ".join(part.replace(" ", "\N{NO-BREAK SPACE}") for part in shown.text.split(", "))
    below = f"{effect.name}: {effect.equation}\n{values}"
    figure.supxlabel(_lines(below, LINE), fontsize=8, color=GREY, x=0.02, ha="left")
    return figure


def _curves(axes: Axes, shown: Signature) -> None:
    """Both ways; one curve where they are the same."""
    x = shown.values
    if shown.is_same_both_ways:
        axes.plot(x, _broken(shown.forward), color=INK, linewidth=1.8, label="both directions")
    else:
        axes.plot(x, _broken(shown.forward), color=FORWARD, linewidth=1.8, label="forward")
        axes.plot(x, _broken(shown.backward), color=BACKWARD, linewidth=1.8, linestyle=(0, (4, 1.5)), label="backward")
    axes.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.98), ncols=2, handlelength=2.2, borderpad=0.2)


def _broken(curve: np.ndarray) -> np.ndarray:
    """A curve without the upright stroke of a jump."""
    steps = np.abs(np.diff(curve))
    jump = steps > 0.5 * max(float(np.ptp(curve)), 1e-300)
    out = curve.astype(float).copy()
    out[1:][jump] = np.nan
    return out


def _mark(axes: Axes, name: str, value: float) -> None:
    axes.axvline(value, color=GREY, linewidth=0.9, linestyle=(0, (1, 2)), zorder=1)
    axes.annotate(
        name.replace("_", " "),
        (value, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(3, -2),
        textcoords="offset points",
        va="top",
        fontsize=8,
        color=GREY,
    )


def _lines(text: str, width: int) -> str:
    return "\n".join(part for line in text.split("\n") for part in textwrap.wrap(line, width))
