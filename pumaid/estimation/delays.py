"""Joints that have nothing but strokes, and what a delay of their currents would make of their parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pumaid.dataset import Run
from pumaid.errors import Note, Where
from pumaid.estimation.system import solve, stroke_noise
from pumaid.model import Model
from pumaid.records import Value
from pumaid.units import number

#: Standard errors by which a delay must move a parameter to be told.
MOVED = 3.0
#: Effects that a delay passes for.
TOLD = ("coulomb", "viscous", "inertia")


def of_delays(model: Model, runs: Sequence[Run], values: Sequence[Value]) -> list[Note]:
    """A note for each joint with nothing but strokes whose numbers are others if its current comes late, or early.

    A fit in which a delay is free tells by how much: half a millisecond matters where strokes are short.

    Parameters
    ----------
    model, runs
        What was fitted, and to which runs.
    values
        What was found.
    """
    both = {run.joint for run in runs if run.kind != "stroke"}
    alone = sorted({run.joint for run in runs} - both)
    if not alone:
        return []
    noise = stroke_noise(model, runs, alone=True)
    free, found = solve(model, runs, blocks=model.blocks(runs, noise=noise)).solution, []
    others = dict(zip(model.names, zip(free.values, np.sqrt(np.diag(free.linear.inverse)), strict=False), strict=True))
    for joint in alone:
        own = [value for value in values if value.joint == joint and value.name.split(".")[0] in TOLD]
        off = {value.name: _off(value, *others[value.name]) for value in own}
        worst = max(own, key=lambda value: off[value.name], default=None)
        if worst is None or off[worst.name] <= MOVED:
            continue
        other = f"{worst.name} is {number(others[worst.name][0])}, not {number(worst.value or 0.0)} {worst.unit}"
        text = f"joint {joint} has strokes only, which look as if its current came late, or early: if so, {other}"
        found.append(Note("strokes-late", f"{text}; runs at constant speed tell", Where(joint=joint)))
    return found


def _off(value: Value, other: float, error: float) -> float:
    """Standard errors of both by which another value is off."""
    if value.value is None or not value.std_error:
        return 0.0
    return abs(other - value.value) / float(np.hypot(value.std_error, error))
