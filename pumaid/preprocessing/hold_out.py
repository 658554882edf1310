"""Runs that are kept for judging a model: by the plan or by file."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import BLOCK, STROKE, Dataset, Run
from pumaid.errors import LogError, Note, Where, listed
from pumaid.estimate import Estimate
from pumaid.robot import Robot
from pumaid.trajectory import Motion, Plan

#: rad or m; held positions this near are one posture: a controller's steady error, far less than steps of a plan.
PLANNED_POSTURE = 0.05
#: Speeds within this share are the planned one; least mean speed of a stroke, whose mean holds the ramps.
PLANNED_SPEED, STROKE_SPEED = 0.10, 0.4
#: Share of a run's travel that must lie inside the planned span.
INSIDE = 0.5
#: Missing motions, and files, that are named.
MOST_NAMED = 4


def match_with_plan(dataset: Dataset, plan: Plan, robot: Robot) -> Dataset:
    """Mark the runs that the plan keeps for judging, with the loads that it says they carry.

    A run is a planned motion where joint, posture, direction and speed (within 10 %; of a stroke, whose mean holds the
    ramps, no less than 40 %) agree and at least half of its way lies in the planned span. Of several such motions the
    nearest in speed and way counts; a run that fits none is left as it is, but carries what planned runs before and
    after it do. A note tells planned motions that were not found. Raises LogError (payload-unclear) where one of these
    is planned with and without a load: which of the others carried it nobody knows.
    """
    motions = plan.motions
    if not dataset.runs or not motions:
        return dataset
    purposes = np.array([motion.purpose for motion in motions])
    moved, hold = np.array([motion.joint for motion in motions]), np.array([motion.hold for motion in motions], float)
    ends = np.array([(motion.start, motion.end) for motion in motions])
    velocity = np.array([motion.velocity for motion in motions]) * np.sign(ends @ [-1.0, 1.0])
    low, high = ends.min(axis=1), ends.max(axis=1)
    runs, missing, planned, more = [], np.ones(len(motions), dtype=np.bool_), list[int | None](), list[int]()
    for run in dataset.runs:
        share, (first, last) = run.speed / velocity, sorted(run.span)
        is_stroke = (run.kind == STROKE) & (share >= STROKE_SPEED) & (share <= 1.0)
        slower = np.where(is_stroke, 0.0, np.abs(share - 1.0))
        shared = np.minimum(high, last) - np.maximum(low, first)
        whole = np.maximum(high, last) - np.minimum(low, first)
        off = np.abs(np.delete(hold - run.posture, run.joint - 1, axis=1)).max(axis=1, initial=0.0)
        fits = (moved == run.joint) & (off <= PLANNED_POSTURE) & (slower <= PLANNED_SPEED)
        fits &= shared >= INSIDE * (last - first)
        away = np.where(fits, slower / PLANNED_SPEED + 1.0 - shared / whole, np.inf)
        if not np.isfinite(away).any() or run.kind == BLOCK:
            runs.append(run)
            planned.append(None)
            continue
        purpose = purposes[int(np.argmin(away))]
        runs.append(replace(run, heldout=bool(purpose == "heldout")))
        # Repeats of a motion are as near: each is found once, and a run too many counts for another that it fits.
        free = np.where(missing & (purposes == purpose), away, np.inf)
        is_more = not np.isfinite(free).any()
        planned.append(int(np.argmin(away if is_more else free)))
        more += [int(np.argmin(away))] * is_more
        missing[planned[-1]] = False
    lost = np.flatnonzero(missing).tolist()
    named = [f"run {k + 1} (joint {motions[k].joint} {'down' if velocity[k] < 0 else 'up'})" for k in lost]
    text = f"{len(lost)} of {len(motions)} planned runs are not in the logs: {listed(named, MOST_NAMED)}"
    notes = [*dataset.notes, *([Note("plan-run-missing", text)] if lost else [])]
    if any(motion.payload for motion in motions):
        for k in (*lost, *more):
            off = np.abs(np.delete(hold - hold[k], moved[k] - 1, axis=1)).max(axis=1, initial=0.0)
            alike = (
                (moved == moved[k]) & (np.abs(velocity / velocity[k] - 1.0) <= PLANNED_SPEED) & (off <= PLANNED_POSTURE)
            )
            if len({motions[n].payload for n in np.flatnonzero(alike)}) > 1:
                what = f"run {k + 1} is planned with and without a load, and the logs have another number of such runs"
                mend = "log each load in files of its own, named in the recipe (files: {tool.csv: {payload: ...}})"
                raise LogError("payload-unclear", what, Where(joint=motions[k].joint), mend)
        runs = _loaded(runs, [None if k is None else motions[k] for k in planned], robot)
    return replace(dataset, runs=tuple(runs), notes=tuple(notes))


def _loaded(runs: Sequence[Run], planned: Sequence[Motion | None], robot: Robot) -> list[Run]:
    """Runs with the loads of their `planned` motions, others with that of those before and after them if it is one."""
    sides, out = list[dict[int, Motion | None]](), list[Run]()
    order = sorted(range(len(runs)), key=lambda n: (runs[n].clock, runs[n].start))
    for way in (order, order[::-1]):
        latest, side = None, dict[int, Motion | None]()
        for n in way:
            latest = side[n] = planned[n] or latest
        sides.append(side)
    for n, run in enumerate(runs):
        payloads = {motion.payload for motion in (side[n] for side in sides) if motion}
        if len(payloads) < 2:
            payload = next(iter(payloads), None)
            out.append(replace(run, payload=payload and robot.carried(payload)))
    return out


def hold_out(dataset: Dataset, files: Collection[str]) -> Dataset:
    """Mark all runs of `files` (as in `Dataset.files`) as held out, too; a note counts.

    Raises
    ------
    LogError [heldout-nothing]
        The files hold no run, or no run of a joint would be left to fit.
    """
    chosen = {number for number, run in enumerate(dataset.runs) if run.origin in files}
    if not chosen:
        what = f"there is no run in {listed(sorted(files))}"
        raise LogError("heldout-nothing", what, Where(file=sorted(files)[0]), "name other files")
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


def is_fitted_to(estimate: Estimate, dataset: Dataset) -> bool:
    """Whether these logs, and no others, are those that the model was fitted to."""
    return {facts.digest for facts in dataset.files} == set(estimate.logs.values())


def held_out_otherwise(estimate: Estimate, dataset: Dataset) -> list[Note]:
    """A note where a model's own logs are divided into fitted and held-out runs in another way than for its fit.

    The estimate says how many runs of each joint were fitted and held out, not which; of other logs it says nothing.
    """
    fits = estimate.joints if is_fitted_to(estimate, dataset) else ()
    marks = {fit.joint: [run.heldout for run in dataset.of_joint(fit.joint)] for fit in fits}
    same = [fit for fit in fits if len(marks[fit.joint]) == fit.runs + fit.heldout_runs]
    changed = [str(fit.joint) for fit in same if sum(marks[fit.joint]) != fit.heldout_runs]
    text = (
        f"other runs of joint {', '.join(changed)} are held out than when the model was fitted. Scores of held-out runs"
        " are therefore wrong; was the plan changed, or --heldout used only once?"
    )
    return [Note("held-out-otherwise", text)] if changed else []
