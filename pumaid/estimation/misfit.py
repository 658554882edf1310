"""Joints that their model misses by more than noise, and logs and runs that are not like the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Run, run_columns
from pumaid.errors import ModelError, Note, Where
from pumaid.estimation.rows import Row
from pumaid.estimation.system import Fitted
from pumaid.preprocessing.options import CONSTANT
from pumaid.records import JointFit
from pumaid.units import number

Floats = NDArray[np.float64]

#: Multiple of the noise beyond which a model misses a joint. Logs of the arm that the model is of are within 1.3 times.
FAR = 2.0
#: Share of a joint's current (RMS) that a misfit must be besides, and beyond which it is one whatever the noise: what
#: runs leave by themselves is much too where something is wrong with their samples.
SEEN, MOST = 1e-3, 0.5
#: Runs of a joint that a file must have to be fitted by itself, and how much better it must be met then.
FEWEST, BETTER = 8, 2.0
#: How much worse than all others the runs of a file must be met by what meets those, to be the one that is wrong.
DISOWNED = 4.0
#: How much worse a joint may be met with more effects: each is weighted by its noise, so a little is no fault.
WORSE = 1.5
#: Multiple of the usual run's noise that makes a run odd, and share of the runs that may be: more are another matter.
ODD, MOST_ODD = 5.0, 0.2
#: Multiple of the usual variance inside a bin beyond which their mean is one of outliers.
SPIKY = 10.0
#: Bins from which a run's own outliers are told, and samples of a bin from which its variance has a shape of its own.
ENOUGH, FULL = 24, 8
#: Median of the square of a normal deviate.
ONE_FREEDOM = 0.455
#: Singular values below this share of the largest are left out where one file is fitted by itself.
_RCOND = 1e-3


def missed(fitted: Fitted) -> dict[int, float]:
    """Joint -> RMSE (A) of its fitted runs."""
    out = {}
    for row in fitted.rows:
        values = fitted.system.factors(fitted.gains)[row.joint - 1] * fitted.solution.values
        out[row.joint] = float(np.sqrt(row.squares(values) / row.samples))
    return out


def check_better(before: Mapping[int, float], fitted: Fitted, names: Sequence[str]) -> None:
    """Refuse a fit with more effects that meets a joint's runs far worse: it went astray.

    Parameters
    ----------
    before
        What `missed` told of the fit without them.
    fitted
        With them.
    names
        Of the effects.

    Raises
    ------
    ModelError [effects-astray]
        A joint is missed by `WORSE` times as much.
    """
    for joint, size in missed(fitted).items():
        was = before.get(joint, np.inf)
        if size > WORSE * was and size > SEEN * _current(next(row for row in fitted.rows if row.joint == joint)):
            what = (
                f"the fit with {', '.join(names)} misses joint {joint} by {number(size)} A, without by {number(was)} A"
            )
            mend = "give its shape, as in --add payload:time=400, or add fewer effects; nothing was written"
            raise ModelError("effects-astray", f"{what}: it went astray", Where(joint=joint), mend)


def of_misfit(fitted: Fitted, joints: Sequence[JointFit]) -> list[Note]:
    """A note for each joint whose current the model does not explain, with the file that is to blame if one is.

    Noise is what is left of each run by its own harmonic, or what repeated runs differ by if that is less.

    Parameters
    ----------
    fitted
        The fit of all joints.
    joints
        How well it does, and what repeated runs differ by.
    """
    found = []
    known = {fit.joint: fit for fit in joints}
    for row in fitted.rows:
        values = fitted.system.factors(fitted.gains)[row.joint - 1] * fitted.solution.values
        misses = known[row.joint].rmse or 0.0
        floor, inside = known[row.joint].noise_floor, _rms_inside(row.runs)
        noise = inside if floor is None else min(inside, floor)
        size = _current(row)
        if misses > max(FAR * noise, SEEN * size) or (misses > MOST * size and len(row.runs) >= FEWEST):
            found.append(_note(row, values, misses, noise))
    return found


def of_runs(fitted: Fitted) -> list[Note]:
    """Notes on single runs that are far noisier than the others of their joint, and on noise that is mostly outliers.

    Both pass for noise everywhere else: they make intervals wide, and what they move is told by nothing.
    """
    found = []
    for row in fitted.rows:
        # What accelerates leaves more, by all that a change of speed does.
        runs = [run for run in row.runs if run.kind == CONSTANT]
        if len(runs) < FEWEST:
            continue
        left = np.array([_rms_inside([run]) for run in runs])
        usual = float(np.median(left))
        odd = [run for run, size in zip(runs, left, strict=True) if size > ODD * usual]
        if usual > 0.0 and 0 < len(odd) <= MOST_ODD * len(runs):
            found.append(_odd_runs(odd, usual, of=len(runs)))
        sizes = [] if odd else _outliers(runs)
        if sizes and sizes[1] > SEEN * _current(row):
            shown = f"{number(sizes[1])} A (RMS), where half of the time it is {number(sizes[0])} A"
            text = f"the noise of joint {row.joint}'s current is mostly outliers: {shown}"
            advice = "those that are not there both ways move friction and gravity; look at the samples"
            found.append(Note("current-spikes", f"{text}; {advice}", Where(joint=row.joint)))
    return found


def _outliers(runs: Sequence[Run]) -> list[float]:
    """Usual and RMS noise (A) of runs where it is mostly outliers, inside bins or from bin to bin; else none.

    Each run is judged by itself, since its speed says how quickly what the model lacks comes and goes.
    """
    long = [run for run in runs if len(run.bins) >= ENOUGH]
    counts, _ = _spreads([run.bins.count for run in long])
    full = [run.bins.variance for run, count in zip(long, counts, strict=True) if count >= FULL]
    # Third differences leave nothing of a load's course, and of independent noise 20 times its variance.
    between = [np.diff(left, n=3) ** 2 / 20.0 for left in _beside_harmonics(long)]
    for squares, of_mean in ((full, 1.0), (between, ONE_FREEDOM)):
        usual, mean = _spreads(squares)
        known = usual > 0.0
        usual, mean = usual[known] / of_mean, mean[known]
        if len(usual) >= FEWEST and np.median(mean / usual) > SPIKY:
            return [float(np.sqrt(np.median(usual))), float(np.sqrt(mean.mean()))]
    return []


def _spreads(parts: Sequence[NDArray[np.number]]) -> tuple[Floats, Floats]:
    """(n,) medians and means of n arrays of whatever lengths, none empty."""
    if not parts:
        return np.zeros(0), np.zeros(0)
    sizes = np.array([len(part) for part in parts])
    values, first = np.concatenate(parts), np.cumsum(sizes) - sizes
    means = np.add.reduceat(values, first) / sizes
    for part in np.split(values, first[1:]):
        part.sort()  # in place
    return 0.5 * (values[first + (sizes - 1) // 2] + values[first + sizes // 2]), means


def _beside_harmonics(runs: Sequence[Run]) -> list[Floats]:
    """A, what the first harmonics of runs at constant speed leave of their bins' means, run by run."""
    if not runs:
        return []
    own, sizes = runs[0].joint - 1, np.array([len(run.bins) for run in runs])
    factors = np.array([run.triangle.factor for run in runs])
    harmonics = np.linalg.pinv(factors[:, :, :-1], rcond=1e-6) @ factors[:, :, -1:]
    q = np.concatenate([run.bins.position[:, own] for run in runs])
    current = np.concatenate([run.bins.current for run in runs])
    # Of a sliding joint's cos and sin the harmonics have none.
    columns = run_columns(q, turns=True)
    left = current - np.sum(columns * np.repeat(harmonics[:, :, 0], sizes, axis=0), axis=1)
    return np.split(left, np.cumsum(sizes)[:-1])


def _odd_runs(odd: Sequence[Run], usual: float, *, of: int) -> Note:
    first, joint = odd[0], odd[0].joint
    which = f"1 of {of} runs of joint {joint} is" if len(odd) == 1 else f"{len(odd)} of {of} runs of joint {joint} are"
    sizes = f"{number(_rms_inside(odd))} A (RMS), in half of the runs by {number(usual)} A"
    text = (
        f"{which} not like the others: inside, the current leaves its course by {sizes}; the first begins at"
        f" {number(first.start)} s. Did the arm touch something? It moves the numbers, and no interval knows of it"
    )
    return Note("run-stands-out", text, Where(file=first.origin, row=first.first_row, joint=joint))


def _note(row: Row, values: Floats, misses: float, noise: float) -> Note:
    text = f"the model misses the current of joint {row.joint} by {number(misses)} A (RMS)"
    misfit, advice = row.target - row.regressors @ values, "payload, zero, unit or a column's name another one?"
    stranger = max(_strangers(row, misfit), default=None)
    if stranger is not None:
        _, name, own, others = stranger
        told = f"what meets all other runs to {number(others)} A misses those of {name} by {number(own)} A"
        why = f"{text}, since the logs disagree: {told}; is it another arm's, or was {advice}"
        return Note("logs-disagree", why, Where(file=name, joint=row.joint))
    odd = max(_odd_files(row, misfit), default=None)
    if odd is None:
        advice = "its intervals may not hold the truth; 'pumaid diagnose' tells what is missing, if no column is wrong"
        told = f"where noise is {number(noise)} A"
        return Note("model-misses", f"{text}, {told}: {advice}", Where(joint=row.joint))
    _, name, before, after = odd
    told = f"the runs of {name} alone would be met to {number(after)} A instead of {number(before)} A"
    why = f"{text}, since the logs disagree: {told}; are they, or the others, another arm's, or was {advice}"
    return Note("logs-disagree", why, Where(file=name, joint=row.joint))


def _rms_inside(runs: Sequence[Run]) -> float:
    """RMS current (A) that the runs' own harmonics leave."""
    left = sum(float(run.triangle.factor[-1, -1]) ** 2 for run in runs)
    freedom = sum(run.samples - len(run.triangle.columns) for run in runs)
    return float(np.sqrt(left / max(freedom, 1)))


def _current(row: Row) -> float:
    """RMS current (A) of the joint, by the bins of all its runs."""
    count = np.concatenate([run.bins.count for run in row.runs])
    current = np.concatenate([run.bins.current for run in row.runs])
    return float(np.sqrt(np.average(current**2, weights=count)))


def _strangers(row: Row, misfit: Floats) -> Iterator[tuple[float, str, float, float]]:
    """Files that all others disown: by how much, name, RMS (A) of their runs and of all others by what meets those."""
    origins, rest = np.array([run.origin for run in row.runs]), row.rest / row.samples
    samples = np.array([run.samples for run in row.runs])
    for name in dict.fromkeys(origins.tolist()):
        own, others = np.flatnonzero(origins == name), np.flatnonzero(origins != name)
        if len(others) >= FEWEST:
            theirs = float(np.sqrt(_left_in_halves(row, misfit, others) / samples[others].sum() + rest))
            ours = float(np.sqrt(_left(row, misfit, others, own) / samples[own].sum() + rest))
            if ours > DISOWNED * theirs:
                yield ours / theirs, name, ours, theirs


def _odd_files(row: Row, misfit: Floats) -> Iterator[tuple[float, str, float, float]]:
    """Files that corrections of their own would meet far better: by how much, name, RMS (A) before and after."""
    origins, rest = np.array([run.origin for run in row.runs]), row.rest / row.samples
    for name in dict.fromkeys(origins.tolist()):
        own = np.flatnonzero(origins == name)
        if FEWEST <= len(own) < len(origins):
            samples = sum(row.runs[n].samples for n in own)
            before = float(np.sqrt(np.sum(misfit[own] ** 2) / samples + rest))
            after = float(np.sqrt(_left_in_halves(row, misfit, own) / samples + rest))
            if before > BETTER * after:
                yield before / after, name, before, after


def _left_in_halves(row: Row, misfit: Floats, own: NDArray[np.int64]) -> float:
    """Sum of squares (A2) of some runs by corrections of their own.

    These are found from one half of the runs and judged on the other, so that noise gains nothing.
    """
    # Neighbouring runs go to and fro: pairs of them keep both directions in each half.
    first = np.isin(np.arange(len(own)) % 4, (0, 3))
    return sum(_left(row, misfit, own[part], own[~part]) for part in (first, ~first))


def _left(row: Row, misfit: Floats, seen: NDArray[np.int64], judged: NDArray[np.int64]) -> float:
    """Sum of squares (A2) of some runs once what others show is taken out."""
    width = row.regressors.shape[2]
    rows, target = row.regressors[seen].reshape(-1, width), misfit[seen].ravel()
    correction = np.linalg.lstsq(rows, target, rcond=_RCOND)[0]
    return float(np.sum((misfit[judged] - row.regressors[judged] @ correction) ** 2))
