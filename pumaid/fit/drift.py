"""Currents that changed while the logs were recorded: what repeated runs say of it, whatever the model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, Where
from pumaid.maths.statistics import two_sided
from pumaid.motion.replicates import repeats
from pumaid.records import JointFit, Run
from pumaid.units import number

Floats = NDArray[np.float64]

#: Repeated runs of a joint that tell of a change, and the chance below which it is one.
FEWEST, CHANCE = 6, 1e-5
#: Share of the noise floor that a change must be to matter.
LARGE = 0.5
#: Condition beyond which a change in proportion to the current cannot be told from the others.
ALIKE = 30.0


#: What a change may be: its unit, what it goes with, and its cause.
KINDS = (
    ("A", "whichever way it moves", "a zero (of its sensor or position) or its load changed"),
    ("A", "in the direction of motion", "friction changed, as with warmth ('pumaid diagnose' tells)"),
    ("%", "in proportion to it", "its gain changed"),
)


def of_drift(runs: Sequence[Run], joints: Sequence[JointFit]) -> Iterator[Note]:
    """A note for each joint whose later runs drew another current than the same runs earlier.

    The same whichever way the joint moved, a sensor's zero or a load changed; with the motion, friction; in proportion,
    a gain.

    Parameters
    ----------
    runs
        All of some logs.
    joints
        What their repeats differ by.
    """
    for fit in joints:
        pairs = repeats([run for run in runs if run.joint == fit.joint])
        ways = np.array([first.direction for first, _, _ in pairs], dtype=float)
        if fit.noise_floor is None or min(np.count_nonzero(ways > 0), np.count_nonzero(ways < 0)) < FEWEST // 2:
            continue
        drawn = np.array([_mean(first) for first, _, _ in pairs])
        changes = [np.ones(len(pairs)), ways, drawn]
        if np.linalg.cond(np.column_stack([*changes[:2], drawn / max(float(np.abs(drawn).max()), 1e-12)])) > ALIKE:
            del changes[2]
        yield from _found(fit, np.column_stack(changes), np.array([level for _, _, level in pairs]))


def _found(fit: JointFit, design: Floats, change: Floats) -> Iterator[Note]:
    """Of (n,) changes (A), by (n, k) what they may go with."""
    inverse, freedoms = np.linalg.inv(design.T @ design), len(change) - design.shape[1]
    sizes = inverse @ design.T @ change
    left = float(np.sum((change - design @ sizes) ** 2)) / max(freedoms, 1)
    errors = np.sqrt(np.maximum(left * np.diag(inverse), 1e-300))
    for (unit, goes, cause), size, error, column in zip(KINDS, sizes, errors, design.T, strict=False):
        moved = abs(size) * float(np.sqrt(np.mean(column**2)))
        if two_sided(size / error, freedoms) >= CHANCE or moved <= LARGE * (fit.noise_floor or 0.0):
            continue
        factor = 100.0 if unit == "%" else 1.0
        shown = f"{number(factor * abs(float(size)))} ± {number(factor * float(error))} {unit}"
        told = f"{shown} {'more' if size > 0 else 'less'} {goes}"
        text = f"joint {fit.joint} draws {told} in the last of {len(change)} repeated runs than in the first of them"
        advice = f"{cause}: the numbers are a mean of before and after"
        yield Note("repeats-differ", f"{text}; {advice}", Where(joint=fit.joint))


def _mean(run: Run) -> float:
    """Mean current (A) of a run."""
    return float(np.average(run.cells.current[:, run.joint - 1], weights=run.cells.count))
