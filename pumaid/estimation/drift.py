"""Currents that changed while the logs were recorded: what repeated runs say of it, whatever the model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run
from pumaid.errors import Note, Where
from pumaid.estimation.misfit import SEEN
from pumaid.maths.statistics import two_sided
from pumaid.preprocessing.replicates import Pair
from pumaid.records import JointFit
from pumaid.units import number

Floats = NDArray[np.float64]

#: Repeated runs of a joint that tell of a change, and the chance below which it is one.
FEWEST, CHANCE = 6, 1e-5
#: Share of the noise floor that a change must be to matter; no change below a share of the current does, either.
LARGE = 0.5
#: Condition beyond which a change in proportion to the current cannot be told from the others.
ALIKE = 30.0
#: What a change may be: its unit, what it goes with, and its cause.
KINDS = (
    ("A", "whichever way it moves", "a zero (of its sensor or position) or its load changed"),
    ("A", "in the direction of motion", "friction changed, as with warmth ('pumaid diagnose' tells)"),
    ("%", "in proportion to it", "its gain changed"),
)


def of_drift(joints: Sequence[JointFit], repeated: Mapping[int, Sequence[Pair]]) -> Iterator[Note]:
    """A note for each joint whose later runs drew another current than the same runs earlier.

    The same whichever way the joint moved, a sensor's zero or a load changed; with the motion, friction; in proportion,
    a gain.

    Parameters
    ----------
    joints
        What their repeats differ by.
    repeated
        Joint -> its runs that repeat one another.
    """
    for fit in joints:
        last = [pair for pair in repeated[fit.joint] if pair.is_last]
        ways = np.array([pair.first.direction for pair in last], dtype=float)
        if min(np.count_nonzero(ways > 0), np.count_nonzero(ways < 0)) < FEWEST // 2:
            continue
        drawn = np.array([_mean(pair.first) for pair in last])
        changes = [np.ones(len(last)), ways, drawn]
        if np.linalg.cond(np.column_stack([*changes[:2], drawn / max(float(np.abs(drawn).max()), 1e-12)])) > ALIKE:
            del changes[2]
        matters = max(LARGE * (fit.noise_floor or 0.0), SEEN * float(np.sqrt(np.mean(drawn**2))))
        yield from _found(fit.joint, np.column_stack(changes), np.array([pair.more for pair in last]), matters=matters)


def _found(joint: int, design: Floats, change: Floats, *, matters: float) -> Iterator[Note]:
    """Of (n,) changes (A), by (n, k) what they may go with, those that are more than what matters (A, RMS)."""
    inverse, freedoms = np.linalg.inv(design.T @ design), len(change) - design.shape[1]
    sizes = inverse @ design.T @ change
    left = float(np.sum((change - design @ sizes) ** 2)) / max(freedoms, 1)
    errors = np.sqrt(np.maximum(left * np.diag(inverse), 1e-300))
    for (unit, goes, cause), size, error, column in zip(KINDS, sizes, errors, design.T, strict=False):
        moved = abs(size) * float(np.sqrt(np.mean(column**2)))
        if two_sided(size / error, freedoms) >= CHANCE or moved <= matters:
            continue
        factor = 100.0 if unit == "%" else 1.0
        shown = f"{number(factor * abs(float(size)))} ± {number(factor * float(error))} {unit}"
        told = f"{shown} {'more' if size > 0 else 'less'} {goes}"
        text = f"joint {joint} draws {told} in the last of {len(change)} repeated runs than in the first of them"
        advice = f"{cause}: the numbers are a mean of before and after"
        yield Note("repeats-differ", f"{text}; {advice}", Where(joint=joint))


def _mean(run: Run) -> float:
    """Mean current (A) of a run."""
    return float(np.average(run.bins.current, weights=run.bins.count))
