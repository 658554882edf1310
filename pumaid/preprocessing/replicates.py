"""Runs that are alike: those that repeat one another, with the noise floor that they show, and those that are held out.

Runs are kept for judging a model by the plan, by file, or each joint's last posture.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pumaid.dataset import BLOCK, STROKE, Dataset, Run
from pumaid.errors import LogError, Note, Where, listed
from pumaid.estimate import Estimate
from pumaid.maths import Counts, Floats
from pumaid.robot import grouped, near, posture_groups
from pumaid.trajectory import Plan

#: Held positions within this (rad or m) are the same posture to a controller: hundreds of encoder counts, and gravity
#: differs by less than 1 %.
SAME_POSITION = 0.01
#: Speeds within this share are the same speed.
SAME_SPEED = 0.03
#: Share of the shorter run's travel that two replicates must have in common.
OVERLAP = 0.8
#: rad or m; held positions this near are one posture: a controller's steady error, far less than steps of a plan.
PLANNED_POSTURE = 0.05
#: Speeds within this share are the planned one; least mean speed of a stroke, whose mean holds the ramps.
PLANNED_SPEED, STROKE_SPEED = 0.10, 0.4
#: Share of a run's travel that must lie inside the planned span.
INSIDE = 0.5
#: Missing motions, and files, that are named.
MOST_NAMED = 4
#: Postures that a joint needs to spare one: gravity's two constants and friction's share take three to stay known.
FEWEST_POSTURES = 4
#: A posture counts if it has this share of the runs of the joint's most used one.
MEANT = 0.25


def replicates(runs: Sequence[Run]) -> list[list[int]]:
    """Groups of indices into `runs` that repeat one another: same joint, kind, load, posture, speed, direction, span.

    Each begins with its earliest run, by the log's clock and not by the order of files, to which the others are held.
    """
    order = np.array(sorted(range(len(runs)), key=lambda n: (runs[n].start, runs[n].duration, runs[n].speed)), np.int64)
    state = np.array([f"{runs[n].joint} {runs[n].kind} {runs[n].payload}" for n in order])
    speed, is_block = np.array([runs[n].speed for n in order]), np.array([runs[n].kind == BLOCK for n in order])
    posture, span = np.array([runs[n].posture for n in order]), np.array([runs[n].span for n in order]).reshape(-1, 2)
    low, high = span.min(axis=1), span.max(axis=1)

    def repeating(first: int, rest: Counts) -> Counts:
        close = rest[(state[rest] == state[first]) & ~is_block[rest]]
        close = close[np.abs(speed[close] - speed[first]) <= SAME_SPEED * abs(speed[first])]
        close = near(posture, first, close, within=SAME_POSITION)
        turns = _turns(span[first], span[close])
        shared = np.minimum(high[first], high[close] + turns) - np.maximum(low[first], low[close] + turns)
        shorter = np.minimum(high[first] - low[first], high[close] - low[close])
        return np.asarray(close[shared >= OVERLAP * shorter])

    groups = [order[group].tolist() for group in grouped(len(runs), repeating) if len(group) > 1]
    return sorted(groups, key=lambda group: group[0])


def _turns(span: ArrayLike, other: ArrayLike) -> Floats:
    """(...) rad, whole turns by which the middle of one span (2,) is beyond those of others (..., 2)."""
    return 2.0 * np.pi * np.round((np.sum(span) - np.sum(other, axis=-1)) / (4.0 * np.pi))


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """The first of a group of replicates and a later one.

    `more` (A) is what the later one draws beyond the first at the same positions, so that nothing is in it that a model
    of position and speed could explain; `variance` (A2) is that of a sample as both show it.
    """

    first: Run
    later: Run
    more: float
    variance: float
    is_last: bool


def pairs(runs: Sequence[Run]) -> list[Pair]:
    """Of each group of replicates among `runs` the first beside every other one."""
    out = []
    for numbers in replicates(runs):
        first, *repeats = (runs[number] for number in numbers)
        a = _OrderedBins(first)
        for later in repeats:
            b = _OrderedBins(later, turns=float(_turns(first.span, later.span)), smooth=a.smooth)
            more, square = _difference(a, b)
            variance = 0.5 * (more**2 + square) + _inside(a, b)
            out.append(Pair(first, later, more, variance, later is repeats[-1]))
    return out


def noise_floor(repeated: Sequence[Pair]) -> tuple[float | None, str | None]:
    """The RMSE (A, of samples) that no model of position, posture, speed and direction can go below, or why unknown.

    Half the mean squared difference of replicates at the same positions, plus the variance inside bins that the
    current's course from bin to bin does not explain. Physics that repeats within less than a bin counts as noise.

    Source
    ------
    G. E. P. Box, W. G. Hunter and J. S. Hunter, Statistics for Experimenters, ch. 3: pure error from replicates.
    """
    if not repeated:
        return None, "no run is repeated (same posture, speed, direction), so noise cannot be told from missing physics"
    weights = [pair.first.samples + pair.later.samples for pair in repeated]
    return float(np.sqrt(np.average([pair.variance for pair in repeated], weights=weights))), None


class _OrderedBins:
    """A run's bins in order of position (M,), with the first harmonic's regressors (M, 4): cos, sin, one, acceleration.

    `rest` (M,) is the current (A) less the first harmonic `smooth` (4,) of the run with which it is compared, and
    `rises` (M - 1,) its slopes (A/rad or A/m) from one bin to the next.
    """

    def __init__(self, run: Run, *, turns: float = 0.0, smooth: Floats | None = None) -> None:
        bins, position = run.bins, run.bins.position[:, run.joint - 1]
        order = np.argsort(position, kind="stable")
        self.q, self.current = position[order] + turns, bins.current[order]
        self.variance, self.count = bins.variance[order], bins.count[order]
        basis = [np.cos(self.q), np.sin(self.q), np.ones(len(self.q)), bins.acceleration[order]]
        self.basis = np.column_stack(basis)
        self.smooth = np.linalg.lstsq(self.basis, self.current, rcond=1e-6)[0] if smooth is None else smooth
        self.rest = self.current - self.basis @ self.smooth
        self.rises = _ratio(np.diff(self.rest), np.diff(self.q))

    def before(self, q: Floats) -> Counts:
        """The bin before each position, so that it and the next enclose the position."""
        return np.asarray(np.searchsorted(self.q, q).clip(1, len(self.q) - 1) - 1)


def _ratio(values: Floats, width: Floats) -> Floats:
    return np.divide(values, width, out=np.zeros(len(width)), where=width > 0)


def _difference(a: _OrderedBins, b: _OrderedBins) -> tuple[float, float]:
    """Mean (A) by which the second's current is larger at the same positions, and mean square (A2) about it."""
    shared = (b.q >= a.q[0]) & (b.q <= a.q[-1])
    if len(a.q) < 2 or np.count_nonzero(shared) < 2:
        return float(np.average(b.current, weights=b.count) - np.average(a.current, weights=a.count)), 0.0
    k, q = a.before(b.q[shared]), b.q[shared]
    share = _ratio(q - a.q[k], a.q[k + 1] - a.q[k])
    difference = b.rest[shared] - (1.0 - share) * a.rest[k] - share * a.rest[k + 1]
    # Interpolation averages the bins' noise, not what a whole run shares.
    averaging = 0.5 * (1.0 + (1.0 - share) ** 2 + share**2)
    level = float(difference.mean())
    return level, float(np.mean((difference - level) ** 2 / averaging))


def _inside(a: _OrderedBins, b: _OrderedBins) -> float:
    """Mean variance (A2) inside the bins of two runs, less what the current's slope makes of a bin's width.

    What the slope adds to the first harmonic's is squared as a product of both runs', whose noise is independent.
    """
    counts = int(a.count.sum()) + int(b.count.sum())
    variance = float(a.variance @ a.count + b.variance @ b.count) / counts
    if len(a.q) < 2 or len(b.q) < 2:
        return variance
    width, smooth = np.gradient(b.q), b.smooth
    bend = _ratio(np.gradient(b.basis[:, 3]), width)
    harmonic = b.basis[:, 0] * smooth[1] - b.basis[:, 1] * smooth[0] + bend * smooth[3]
    first, second = a.rises[a.before(0.5 * (b.q[1:] + b.q[:-1]))], b.rises
    along = 0.5 * (harmonic[1:] + harmonic[:-1])
    inner = np.diff(b.q) ** 2 * (along * (first + second) + first * second)
    spread = float(np.mean((harmonic * width) ** 2) + np.mean(inner)) / 12.0
    return max(variance - spread * (1.0 - 1.0 / float(b.count.mean()) ** 2), 0.0)


def match_with_plan(dataset: Dataset, plan: Plan) -> Dataset:
    """Mark the runs that the plan keeps for judging.

    A run is a planned motion where joint, posture, direction and speed (within 10 %; of a stroke, whose mean holds the
    ramps, no less than 40 %) agree and at least half of its way lies in the planned span. Of several such motions the
    nearest in speed and way counts; a run that fits none is left as it is. A note tells planned motions that were
    not found.
    """
    motions = plan.motions
    if not dataset.runs or not motions:
        return dataset
    purposes = np.array([motion.purpose for motion in motions])
    moved, hold = np.array([motion.joint for motion in motions]), np.array([motion.hold for motion in motions], float)
    ends = np.array([(motion.start, motion.end) for motion in motions])
    velocity = np.array([motion.velocity for motion in motions]) * np.sign(ends @ [-1.0, 1.0])
    low, high = ends.min(axis=1), ends.max(axis=1)
    runs, missing = [], np.ones(len(motions), dtype=np.bool_)
    for run in dataset.runs:
        share, (first, last) = run.speed / velocity, sorted(run.span)
        slower = np.abs(share - 1.0)
        if run.kind == STROKE:
            slower = np.where((share >= STROKE_SPEED) & (share <= 1.0), 0.0, slower)
        shared = np.minimum(high, last) - np.maximum(low, first)
        whole = np.maximum(high, last) - np.minimum(low, first)
        off = np.abs(np.delete(hold - run.posture, run.joint - 1, axis=1)).max(axis=1, initial=0.0)
        fits = (moved == run.joint) & (off <= PLANNED_POSTURE) & (slower <= PLANNED_SPEED)
        fits &= shared >= INSIDE * (last - first)
        away = np.where(fits, slower / PLANNED_SPEED + 1.0 - shared / whole, np.inf)
        if not np.isfinite(away).any() or run.kind == BLOCK:
            runs.append(run)
            continue
        purpose = purposes[int(np.argmin(away))]
        runs.append(replace(run, heldout=bool(purpose == "heldout")))
        # Repeats of a motion are as near: each is found once, and a run too many counts for another that it fits.
        free = np.where(missing & (purposes == purpose), away, np.inf)
        missing[int(np.argmin(free))] &= not np.isfinite(free).any()
    lost = np.flatnonzero(missing).tolist()
    named = [f"run {k + 1} (joint {motions[k].joint} {'down' if velocity[k] < 0 else 'up'})" for k in lost]
    text = f"{len(lost)} of {len(motions)} planned runs are not in the logs: {listed(named, MOST_NAMED)}"
    notes = [*dataset.notes, *([Note("plan-run-missing", text)] if lost else [])]
    return replace(dataset, runs=tuple(runs), notes=tuple(notes))


def hold_out(dataset: Dataset, *, files: Collection[str] = (), postures: bool = False) -> Dataset:
    """Mark more runs as held out, whole files or whole postures at a time, so that no run is fitted in part.

    Held out are all runs of `files` (as in `Dataset.files`); with `postures`, of every joint with at least four
    postures, all runs at the one that was run last. Runs that the plan holds out stay so; a note counts.

    Raises
    ------
    LogError [heldout-nothing]
        No run is meant: the files hold none, or no joint has postures to spare; or no run of a joint would be left to
        fit.
    """
    chosen = {number for number, run in enumerate(dataset.runs) if run.origin in files}
    if files and not chosen:
        where = Where(file=sorted(files)[0])
        raise LogError("heldout-nothing", f"there is no run in {listed(sorted(files))}", where, "name other files")
    chosen |= _last_postures(dataset.runs) if postures else set()
    runs = tuple(replace(run, heldout=run.heldout or number in chosen) for number, run in enumerate(dataset.runs))
    for joint in sorted({runs[number].joint for number in chosen}):
        moving = [run for run in runs if run.joint == joint]
        if all(run.heldout for run in moving):
            what = f"all {len(moving)} runs of joint {joint} would be held out, and none fitted"
            mend = f"keep one of the files for fitting in which it moves: {listed(sorted({r.origin for r in moving}))}"
            raise LogError("heldout-nothing", what, Where(joint=joint), mend)
    fitted = sum(not run.heldout for run in runs)
    text = f"{len(runs) - fitted} runs are held out, {len(chosen)} of them as was asked; {fitted} are left to fit"
    return replace(dataset, runs=runs, notes=(*dataset.notes, Note("held-out", text)))


def held_out_otherwise(estimate: Estimate, dataset: Dataset) -> list[Note]:
    """A note where a model's own logs are divided into fitted and held-out runs in another way than for its fit.

    The estimate says how many runs of each joint were fitted and held out, not which; of other logs it says nothing.
    """
    is_its_own = {facts.digest for facts in dataset.files} == set(estimate.logs.values())
    changed = []
    for fit in estimate.joints if is_its_own else ():
        marks = [run.heldout for run in dataset.of_joint(fit.joint)]
        changed += [str(fit.joint)] * (len(marks) == fit.runs + fit.heldout_runs and sum(marks) != fit.heldout_runs)
    text = (
        f"other runs of joint {', '.join(changed)} are held out than when the model was fitted. Scores of held-out runs"
        " are therefore wrong; was the plan changed, or --heldout used only once?"
    )
    return [Note("held-out-otherwise", text)] if changed else []


def _last_postures(runs: Sequence[Run]) -> set[int]:
    """Indices of each joint's runs at the posture that was first taken last, where there are enough postures."""
    last: set[int] = set()
    for joint in sorted({run.joint for run in runs}):
        numbers = [number for number, run in enumerate(runs) if run.joint == joint and not run.heldout]
        groups = posture_groups(np.array([runs[number].posture for number in numbers]), PLANNED_POSTURE)
        most_used = max(map(len, groups), default=0)
        groups = [group for group in groups if len(group) >= MEANT * most_used]
        last |= {numbers[k] for k in groups[-1]} if len(groups) >= FEWEST_POSTURES else set()
    if not last:
        what = f"no joint was run in {FEWEST_POSTURES} postures, so none can be spared"
        raise LogError("heldout-nothing", what, mend="hold out files, or run more postures")
    return last
