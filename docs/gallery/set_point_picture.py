"""The figure of docs/gallery/set_point.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from puma import DEG
from set_point import RUNGS, SECONDS, Ladder, Trial

from pumaid.reporting.figures.style import styled

Floats = NDArray[np.float64]

#: Rung -> colour; what is added grows darker towards what works best.
COLOURS = ("#8a9099", "#e69f00", "#56b4e9", "#cc79a7", "#00573e")


def draw(path: Path, ladder: Ladder, trials: list[Trial], many: Floats) -> None:
    """Bars of all steps, the paper's step of one joint in time, and the current that the wrist's gears explain."""
    with styled():
        figure = Figure(figsize=(10.0, 7.0), layout="constrained")
        whole = figure.subplot_mosaic([["bars", "bars"], ["trace", "gears"]], height_ratios=[1.1, 1.0])
        _bars(whole["bars"], many)
        _trace(whole["trace"], trials)
        _gears(whole["gears"], ladder)
        figure.savefig(path, dpi=110, facecolor="white")


def _bars(axes: Axes, many: Floats) -> None:
    mean, worst = many.mean(axis=0), many.max(axis=0)
    for k, (name, colour) in enumerate(zip(RUNGS, COLOURS, strict=True)):
        place = np.arange(6) + 0.16 * (k - 2)
        axes.bar(place, mean[k], 0.15, color=colour, label=name)
        axes.plot(place, worst[k], "_", color="#2b2f36", ms=7, mew=1.2, label="worst step" if k == 4 else None)
    axes.set_yscale("log")
    axes.set_ylim(0.004, 3.0)
    axes.set_yticks([0.01, 0.1, 1.0], ["0.01", "0.1", "1"])
    axes.set_xticks(np.arange(6), [f"joint {j}" for j in range(1, 7)])
    axes.set_ylabel("steady-state error (deg)")
    axes.grid(axis="y")
    axes.set_axisbelow(True)
    lines, names = axes.get_legend_handles_labels()
    order = [names.index(name) for name in (*RUNGS, "worst step")]
    look = {"ncols": 6, "loc": "upper center", "fontsize": 8.5, "columnspacing": 1.2, "handlelength": 1.2}
    axes.legend([lines[k] for k in order], [names[k] for k in order], **look)
    axes.set_title(f"What is left of a step, mean of {len(many)} steps of {len(many) // 6} robots")


def _trace(axes: Axes, trials: list[Trial], joint: int = 3) -> None:
    ends, shown = [], [0, 1, 2, 4]
    for k in shown:
        axes.plot(trials[k].time[::10], np.abs(trials[k].error[::10, joint - 1]) / DEG, color=COLOURS[k], lw=1.8)
        ends.append(abs(float(trials[k].error[-1, joint - 1])) / DEG)
    height = -1.0
    for k, end in sorted(zip(shown, ends, strict=True), key=lambda pair: pair[1]):
        height = max(height + 0.075, end)
        axes.annotate(
            f"{end:.2f}  {RUNGS[k]}", (SECONDS, height), (6, 0), textcoords="offset points", va="center",
            color=COLOURS[k], fontsize=8.5, annotation_clip=False,
        )  # fmt: skip
    axes.set_xlim(0.8, SECONDS)
    axes.set_ylim(0.0, 1.0)
    axes.set_xlabel("time after the step (s)")
    axes.set_ylabel("size of the error (deg)")
    axes.set_title(f"Joint {joint} comes to rest: the paper's step")


def _gears(axes: Axes, ladder: Ladder) -> None:
    runs = [run for run in ladder.dataset.runs if run.joint == 5 and abs(abs(run.speed) / DEG - 30.0) < 1.0][:2]
    for run in runs:
        measured, plain, geared = ladder.seen(run, 6)
        q = run.bins.position[:, 4] / DEG
        first = run is runs[0]
        axes.plot(q, measured, ".", color="#8a9099", ms=3, label="measured" if first else None)
        axes.plot(
            q, plain, "--", color=COLOURS[2], lw=1.6, label="friction by joint 6, which stands" if first else None
        )
        axes.plot(q, geared, color=COLOURS[4], lw=1.6, label="friction by its shaft, (38)-(40)" if first else None)
        way, low = ("forward" if run.speed > 0 else "backward"), int(np.argmin(q))
        axes.annotate(way, (q[low], geared[low]), (0, 9), textcoords="offset points", fontsize=8.5)
    axes.set_xlabel("position of joint 5 (deg)")
    axes.set_ylabel("current of motor 6 (A)")
    axes.set_title("Motor 6 while only joint 5 moves")
    axes.set_ylim(-0.32, 0.36)
    axes.legend(loc="center", bbox_to_anchor=(0.55, 0.36), fontsize=8.5)
