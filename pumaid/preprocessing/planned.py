"""Runs held against the plan by which they were made: which are kept for judging, which planned ones are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset, Run
from pumaid.errors import Note, Where
from pumaid.preprocessing.options import STROKE
from pumaid.trajectory import Motion, Plan

Floats = NDArray[np.float64]

#: Held positions this near to the planned ones (rad or m) are the planned posture: a controller's steady error, far
#: less than the steps between planned postures.
SAME_POSTURE = 0.05
#: Speeds within this share are the planned speed.
SAME_SPEED = 0.10
#: Least mean speed, as a share of the planned speed, of a run from rest to rest that hardly kept it.
_STROKE = 0.4
#: Share of a run's travel that must lie inside the planned span.
_INSIDE = 0.5
#: Share of runs that may be none of the plan's: moves from posture to posture leave some that are as good as any.
_FEW = 0.25
#: Missing motions that are named; of more, the count.
_MOST_NAMED = 4


def mark_heldout(dataset: Dataset, plan: Plan) -> Dataset:
    """Mark the runs that the plan keeps for judging.

    A run is a planned motion where joint, posture, direction and speed (within 10 %; of a run from rest to rest, whose
    mean holds the ramps, no less than 40 %) agree and at least half of its way lies in the planned span. Of several
    motions that would fit the nearest in speed and way counts; a run that fits none is left as it is.

    Parameters
    ----------
    dataset
        What the logs left.
    plan
        By which they were made.

    Returns
    -------
    dataset
        With `Run.heldout` set, and notes on planned motions that were not found, and on runs that no motion planned
        where they are many (moves between postures leave a few, which are fitted).
    """
    if not dataset.runs or not plan.motions:
        return dataset
    if any(len(motion.hold) != len(run.posture) for motion in plan.motions[:1] for run in dataset.runs[:1]):
        return dataset
    kinds = _Kinds(plan.motions)
    found = [kinds.nearest(run) for run in dataset.runs]
    runs = tuple(
        run if kind is None else replace(run, heldout=kinds.purpose(kind) == "heldout")
        for run, kind in zip(dataset.runs, found, strict=True)
    )
    missing = kinds.missing(dataset.runs, found)
    notes = (*dataset.notes, *_on_missing(plan, missing), *_on_strays(runs, found))
    return replace(dataset, runs=runs, notes=notes)


class _Kinds:
    """A plan's motions without their repeats: each kind once, with the motions that are of it."""

    def __init__(self, motions: Sequence[Motion]) -> None:
        self.members: dict[tuple[object, ...], list[int]] = {}
        for number, motion in enumerate(motions):
            held = tuple(round(p, 6) for k, p in enumerate(motion.hold) if k != motion.joint - 1)
            key = (motion.joint, held, motion.start, motion.end, motion.velocity, motion.purpose)
            self.members.setdefault(key, []).append(number)
        self.keys = list(self.members)
        first = [motions[numbers[0]] for numbers in self.members.values()]
        self.motions = first
        self.joint = np.array([motion.joint for motion in first])
        self.hold = np.array([motion.hold for motion in first])
        self.ends = np.array([(motion.start, motion.end) for motion in first])
        self.velocity = np.array([motion.velocity for motion in first]) * np.sign(self.ends[:, 1] - self.ends[:, 0])

    def nearest(self, run: Run) -> int | None:
        """The kind that the run is of, or none."""
        fits, away = self._away(run)
        return int(np.argmin(np.where(fits, away, np.inf))) if np.any(fits) else None

    def _away(self, run: Run) -> tuple[NDArray[np.bool_], Floats]:
        """(K,) the kinds that the run may be of, and how far it is from each in speed and way."""
        away = np.abs(self.hold - run.posture)
        away[:, run.joint - 1] = 0.0
        slower = np.abs(run.speed / self.velocity - 1.0)
        if run.kind == STROKE:
            # Its speed is a mean that holds the ramps.
            share = run.speed / self.velocity
            slower = np.where((share >= _STROKE) & (share <= 1.0), 0.0, slower)
        low, high = np.min(self.ends, axis=1), np.max(self.ends, axis=1)
        shared = np.minimum(high, max(run.span)) - np.maximum(low, min(run.span))
        fits = (self.joint == run.joint) & (np.max(away, axis=1) <= SAME_POSTURE)
        fits &= (shared >= _INSIDE * abs(run.span[1] - run.span[0])) & (slower <= SAME_SPEED)
        # Tours and parts of them share a speed: of motions as fast, that with which it shares most of its way.
        whole = np.maximum(high, max(run.span)) - np.minimum(low, min(run.span))
        return fits, slower / SAME_SPEED + 1.0 - shared / whole

    def purpose(self, kind: int) -> str:
        """``fit`` or ``heldout``."""
        return self.motions[kind].purpose

    def missing(self, runs: Sequence[Run], found: Sequence[int | None]) -> list[int]:
        """Numbers (from 1) of planned motions for which there are too few runs.

        Of a motion that came late to its speed so little may be left that it looks like one over a part of its way; a
        run that is one too many of its kind therefore counts for another kind, too few of which are there, if it fits.
        """
        left = [len(self.members[key]) for key in self.keys]
        spare: list[tuple[Run, int]] = []
        for run, kind in zip(runs, found, strict=True):
            if kind is not None and left[kind] > 0:
                left[kind] -= 1
            elif kind is not None:
                spare.append((run, kind))
        for run, own in spare:
            fits = self._away(run)[0]
            others = (int(k) for k in np.flatnonzero(fits) if left[k] > 0)
            other = next((k for k in others if self.purpose(k) == self.purpose(own)), None)
            if other is not None:
                left[other] -= 1
        return sorted(
            number + 1
            for key, lacking in zip(self.keys, left, strict=True)
            for number in self.members[key][len(self.members[key]) - lacking :]
        )


def _on_missing(plan: Plan, missing: Sequence[int]) -> tuple[Note, ...]:
    if not missing:
        return ()
    named = ", ".join(_described(plan.motions[number - 1], number) for number in missing[:_MOST_NAMED])
    more = f" and {len(missing) - _MOST_NAMED} more" if len(missing) > _MOST_NAMED else ""
    text = f"{len(missing)} of {len(plan.motions)} planned runs are not in the logs: {named}{more}"
    return (Note("plan-run-missing", text, Where(field=f"runs[{missing[0]}]")),)


def _described(motion: Motion, number: int) -> str:
    way = "up" if motion.end > motion.start else "down"
    return f"run {number} (joint {motion.joint} {way})"


def _on_strays(runs: Sequence[Run], found: Sequence[int | None]) -> tuple[Note, ...]:
    strays = [run for run, kind in zip(runs, found, strict=True) if kind is None]
    if len(strays) <= _FEW * len(runs):
        return ()
    first = strays[0]
    text = (
        f"{len(strays)} of {len(runs)} runs are none that the plan has, the first of joint {first.joint} at"
        f" {first.start:.1f} s; they are fitted; is it the plan of these logs?"
    )
    return (Note("plan-run-unplanned", text, Where(file=first.origin, row=first.first_row)),)
