"""What a residual can depend on at each bin of a joint."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.joint_bins import JointBins, distinct, posture_groups
from pumaid.preprocessing.options import CONSTANT

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

#: Distinct speeds beyond which friction over speed is a smooth curve, not a mean for each.
MOST_SPEEDS = 8
#: Postures beyond which the rest count as one.
MOST_POSTURES = 24
#: Bins of a run: the first ones as they are, where a start shows, the others in groups.
FIRST, GROUPS = 16, 48


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """What the columns are made of at N bins of one joint.

    Attributes
    ----------
    weight
        (N,) samples.
    run
        (N,) number of the run from 0.
    share
        (N,) position between the lowest (0) and the highest (1) of the joint.
    angle
        (N,) position in rad; zero throughout for a sliding joint.
    way
        (N,) +1 or -1.
    speed
        (N,) share of the largest speed; `speed_group` its number where speeds are few.
    age
        (N,) share of the longest recording, s since the joint's first motion in it.
    travel
        (N,) share of the span since the motion began.
    temperature
        (N,) degC, NaN where not measured.
    load
        (N,) A that gravity draws by the model, NaN where not known.
    slope
        (N,) A per span: how the load changes along the position.
    pull
        (N,) acceleration as a share of the largest; zero at constant speed.
    speed_group, posture, clock
        (N,) numbers from 0; `speed_group` is -1 throughout where speeds are many.
    """

    weight: Floats
    run: Labels
    share: Floats
    angle: Floats
    way: Floats
    speed: Floats
    age: Floats
    travel: Floats
    temperature: Floats
    load: Floats
    slope: Floats
    pull: Floats
    speed_group: Labels
    posture: Labels
    clock: Labels

    def __len__(self) -> int:
        return len(self.weight)

    def coarse(self, starts: Labels) -> View:
        """Means over groups of bins that begin at `starts` (within one run each)."""
        total = np.add.reduceat(self.weight, starts)
        out: dict[str, Any] = {}
        for item in fields(View):
            values = getattr(self, item.name)
            whole = np.issubdtype(values.dtype, np.integer)
            out[item.name] = values[starts] if whole else np.add.reduceat(values * self.weight, starts) / total
        return View(**(out | {"weight": total}))


def view(bins: JointBins, load: Floats | None, *, is_revolute: bool) -> View:
    """The bins of a joint.

    Parameters
    ----------
    bins
        N of them.
    load
        (N,) A that gravity draws by the model, or None.
    is_revolute
        Whether the joint turns.
    """
    samples, own, runs = bins.samples, bins.joint - 1, bins.runs
    q = samples.position[:, own]
    speed = np.abs(samples.velocity[:, own])
    speeds = distinct([abs(run.speed) for run in runs])
    by_run = np.searchsorted(np.array(speeds) * (1.0 + 1e-9), [abs(run.speed) for run in runs], side="right") - 1
    few = len(speeds) <= MOST_SPEEDS and all(run.kind == CONSTANT for run in runs)
    posture = np.zeros(len(runs), dtype=np.int64)
    for number, group in enumerate(sorted(posture_groups(runs), key=lambda group: -len(group))):
        posture[group] = min(number, MOST_POSTURES)
    clocks = np.unique([run.clock for run in runs], return_inverse=True)[1]
    run, span = samples.run.astype(np.int64), float(np.ptp(q)) or 1.0
    return View(
        weight=bins.count,
        run=run,
        share=(q - q.min()) / span,
        angle=q if is_revolute else np.zeros(len(q)),
        way=samples.direction,
        speed=speed / (speed.max() or 1.0),
        age=samples.time / (samples.time.max() or 1.0),
        travel=samples.travel / span,
        temperature=samples.temperature,
        load=np.full(len(q), np.nan) if load is None else load,
        slope=np.full(len(q), np.nan) if load is None else _slopes(load, q / span, bins.first),
        pull=samples.acceleration / (np.abs(samples.acceleration).max() or 1.0),
        speed_group=(np.maximum(by_run, 0) if few else np.full(len(runs), -1))[run],
        posture=posture[run],
        clock=clocks[run],
    )


def _slopes(load: Floats, share: Floats, first: Labels) -> Floats:
    """(N,) derivative of a load by the position, run by run; 0 where a run stands still."""
    out = np.zeros_like(load)
    for own in np.split(np.arange(len(load)), first[1:]):
        if len(own) > 1:
            rise, way = np.gradient(load[own]), np.gradient(share[own])
            out[own] = np.divide(rise, way, out=np.zeros(len(own)), where=way != 0.0)
    return out


def coarse_starts(first: Labels, bins: int) -> Labels:
    """First bins of the groups in which all but ripples are looked for.

    Parameters
    ----------
    first
        (R,) each run's first bin.
    bins
        N.
    """
    pieces = []
    for start, end in itertools.pairwise([*first, bins]):
        inner = np.arange(end - start)
        if len(inner) > FIRST + GROUPS:
            inner = np.append(np.arange(FIRST), np.linspace(FIRST, len(inner), GROUPS + 1).astype(np.int64)[:-1])
        pieces.append(start + inner)
    return np.concatenate(pieces)
