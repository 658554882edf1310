"""The residual budget: how much of what a model leaves is noise, and where the rest lives."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.laid import View, coarse_starts, view
from pumaid.diagnosis.repeats import Repeats, alike, halves
from pumaid.diagnosis.ripples import Track
from pumaid.diagnosis.search import FALSE_ALARM, FEWEST_RUNS, REPEAT, RIPPLE, Search
from pumaid.joint_bins import JointBins, distinct
from pumaid.preprocessing.options import STROKE
from pumaid.preprocessing.replicates import noise_floor, pairs
from pumaid.records import Budget, BudgetPart
from pumaid.robot import Joint

Floats = NDArray[np.float64]

#: A: an RMSE below this is rounding, of which nothing is said.
NOTHING = 1e-7

#: Parts that point to causes, in the order in which they are told.
CAUSES = ("smooth", "fast", "start", "odd", "even", "time")

#: Effects that look like it, by part and variable.
POINTS_TO = {
    ("smooth", "position"): ("spring", "counterbalance", "flexibility"),
    ("smooth", "direction"): ("position_friction", "load_friction"),
    ("smooth", "posture"): ("tilt", "zero_offset", "flexibility", "coupling"),
    ("smooth", "load"): ("flexibility",),
    ("fast", "position"): ("ripple",),
    ("fast", "size"): ("ripple",),
    ("start", "travel"): ("presliding", "inertia"),
    ("odd", "direction"): ("warmup", "thermal_friction"),
    ("odd", "speed"): ("stribeck", "viscous_power"),
    ("odd", "load"): ("load_friction",),
    ("odd", "lag"): ("delay",),
    ("odd", "posture"): ("side_load_friction", "load_friction", "coupling"),
    ("even", "direction"): ("payload",),
    ("even", "posture"): ("tilt", "zero_offset", "coupling", "payload"),
    ("even", "load"): ("torque_droop", "saturation"),
    ("even", "speed"): ("torque_droop", "saturation"),
    ("time", "time"): ("warmup", "friction_step"),
    ("time", "load"): ("torque_constant_drift", "payload"),
    ("time", "even"): ("payload",),
    ("time", "temperature"): ("thermal_friction", "warmup"),
}


def budget(
    bins: JointBins,
    residual: Floats,
    joint: Joint,
    *,
    load: Floats | None = None,
    mean_square: float | None = None,
    floor: float | None = None,
    is_fitted: bool = True,
) -> Budget:
    """Split the mean square of what a model leaves at one joint into parts that add up to it.

    Dependences on position, direction, posture, speed, load, time, temperature and the start of a run, and ripples, are
    taken out one after the other, the surest first, while flipping the signs of whole runs seldom gives as much
    anywhere. What each takes, less what noise brings into its directions, is its part. What repeats between replicates
    and is none of these is unassigned. The rest is noise. Without replicates, what differs from run to run is
    unassigned too, since it may be either.

    Parameters
    ----------
    bins
        The runs of the joint, as fine as they are: ripples are seen down to two bins a wave.
    residual
        (N,) A, measured less predicted, at these bins.
    joint
        Whose runs they are.
    load
        (N,) A that gravity draws by the model; their own where they know it.
    mean_square
        A2 of samples, where it is known better than from the bins.
    floor
        A: the noise floor by replicates, where it is known already.
    is_fitted
        Whether the model was fitted to these very runs, so that friction and weight are already at their best.

    Source
    ------
    R. A. Fisher, The Design of Experiments, for the test by flipped signs; P. H. Westfall and S. S. Young,
    Resampling-Based Multiple Testing (1993), for many tests at once.
    """
    if load is None and bins.samples.loads is not None:
        load = bins.samples.loads.own
    at = view(bins, load, is_revolute=joint.is_revolute)
    floor = noise_floor(pairs(bins.runs))[0] if floor is None else floor
    repeats = _repeats(bins, at)
    track = Track.of(bins, is_revolute=joint.is_revolute)
    search = Search(at, coarse_starts(bins.first, len(bins.count)), track, repeats=repeats, is_fitted=is_fitted)
    left, samples = float(at.weight @ residual**2), float(at.weight.sum())
    inside = _inside(bins, residual) if mean_square is None else max(mean_square * samples - left, 0.0)
    total = (left + inside) / samples if mean_square is None else mean_square
    if total > NOTHING**2:
        search.run(residual, inside=inside)
    parts = _parts(search, joint, total=total, inside=inside)
    return Budget(
        mean_square=total,
        parts=parts,
        runs=len(bins.runs),
        replicates=len(repeats.members) if repeats.levels else 0,
        floor=None if floor is None else floor**2,
        limits=tuple(_limits(bins, at, has_load=load is not None)),
    )


def _repeats(bins: JointBins, at: View) -> Repeats:
    groups = tuple(group for group in bins.groups if len(group) > 1)
    samples = np.bincount(at.run, at.weight).astype(np.float64)
    return Repeats(groups, True, samples) if groups else Repeats(alike(at), False, samples)


def _inside(bins: JointBins, residual: Floats) -> float:
    """A2 times samples: what the residual varies inside bins, the prediction's slope across a bin taken out."""
    predicted, total = bins.current - residual, 0.0
    for first, end in itertools.pairwise([*bins.first, len(residual)]):
        own = slice(first, end)
        if end - first < 2:
            total += float(bins.count[own] @ bins.inside[own])
            continue
        slope, rest = np.gradient(predicted[own]), np.gradient(residual[own])
        within = (slope**2 + 2.0 * slope * rest) * (1.0 - 1.0 / bins.count[own] ** 2) / 12.0
        total += max(float(bins.count[own] @ (bins.inside[own] - within)), 0.0)
    return total


def _parts(search: Search, joint: Joint, *, total: float, inside: float) -> tuple[BudgetPart, ...]:
    """Every part; `inside` is A2 times samples inside bins."""
    samples = float(search.at.weight.sum())
    explained: dict[str, float] = dict.fromkeys(CAUSES, 0.0)
    for one in search.found:
        gain = max(one.fall - one.noise, 0.0)
        if one.frequency:
            more = min(gain * (_averaging(search, one.frequency) - 1.0), inside)
            gain, inside = gain + more, inside - more
        explained[one.key[0]] += gain / samples
    rest = max(total - sum(explained.values()), 0.0)
    unassigned = min(_unassigned(search) / samples, rest)
    noise = rest - unassigned
    shared = min(_shared(search) / samples, noise)
    causes = [_cause(search, name, joint, explained[name]) for name in CAUSES]
    chance = search.chance.get(REPEAT) if search.repeats.groups else None
    is_more = unassigned > 0.0 and chance is not None and chance <= FALSE_ALARM
    return (
        BudgetPart("noise_shared", shared),
        BudgetPart("noise_inside", noise - shared),
        *causes,
        BudgetPart("unassigned", unassigned, chance, is_more),
    )


def _cause(search: Search, name: str, joint: Joint, mean_square: float) -> BudgetPart:
    own = sorted((one for one in search.found if one.key[0] == name), key=lambda one: -one.fall)
    tried = [chance for key, chance in search.chance.items() if key[0] == name]
    ripples = [
        one.frequency if joint.is_revolute else one.frequency / (2.0 * np.pi) for one in own if one.key == RIPPLE
    ]
    gearing = joint.gear_ratio if joint.is_revolute else None
    return BudgetPart(
        name=name,
        mean_square=mean_square,
        p_value=min((one.chance for one in own), default=min(tried, default=None)),
        is_more=bool(own),
        against=tuple(dict.fromkeys(one.key[1] for one in own)),
        cycles=tuple(ripples),
        per="" if not ripples else "turn" if joint.is_revolute else "m",
        gearing=tuple(cycles / gearing for cycles in ripples) if gearing else (),
        points_to=tuple(dict.fromkeys(effect for one in own for effect in POINTS_TO[one.key])),
    )


def _averaging(search: Search, frequency: float) -> float:
    """By how much the square of a ripple is larger than what its bins' means hold."""
    track = search.track
    within = np.minimum(0.5 * frequency * track.width, 0.5 * np.pi)
    several = np.add.reduceat(track.weight, track.first) / track.lengths
    fine = within / several
    kept = np.where(several > 1.0, np.sin(within) / np.maximum(several * np.sin(fine), 1e-12), 1.0)
    weight = np.add.reduceat(track.weight, track.first)
    return float(weight.sum() / (weight @ kept**2))


def _unassigned(search: Search) -> float:
    """A2 times samples that repeat and have no name, and what may be noise or not: in too few runs, without repeats."""
    repeats = search.repeats
    if not search.left.any():
        return 0.0
    if len(search.track.first) < FEWEST_RUNS:
        slow = search.track.slow(search.left)
        return slow if search.is_worth(slow) else 0.0
    total = 0.0
    if search.chance.get(REPEAT, 1.0) <= FALSE_ALARM:
        shared = float(repeats.products(search.at, search.left)[0].sum()) * repeats.scale
        total += shared if search.is_worth(shared) else 0.0
    if not repeats.levels:
        both = halves(search.thin, search.thin_left())
        total += max(float(repeats.samples @ (both[:, 0] * both[:, 1])), 0.0)
    return total


def _shared(search: Search) -> float:
    """A2 times samples of the level that noise gives a run as a whole, by replicates; 0 where there are none."""
    if not search.repeats.levels:
        return 0.0
    return search.repeats.level(halves(search.thin, search.thin_left())) * search.repeats.scale


def _limits(bins: JointBins, at: View, *, has_load: bool) -> list[str]:
    """What these runs cannot split."""
    runs = bins.runs
    speeds = len(distinct([abs(run.speed) for run in runs]))
    strokes = any(run.kind == STROKE for run in runs)
    claims = {
        "few-runs": len(runs) < FEWEST_RUNS,
        "no-replicates": all(len(group) < 2 for group in bins.groups),
        "one-direction": len({run.direction for run in runs}) == 1,
        "one-posture": int(at.posture.max()) == 0,
        "one-speed": speeds == 1 and not strokes,
        "two-speeds": speeds == 2 and not strokes,
        "strokes": strokes,
        "several-clocks": int(at.clock.max()) > 0,
        "no-load": not has_load,
    }
    return [slug for slug, is_so in claims.items() if is_so]
