"""Runs that the user keeps for judging a model: of whole files, or of each joint's last posture."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import Dataset, Run
from pumaid.errors import LogError, Note, Where
from pumaid.kinematics import apart
from pumaid.preprocessing.planned import SAME_POSTURE
from pumaid.records import Estimate

#: Postures that a joint needs to spare one: gravity's two constants and friction's share take three to stay known.
FEWEST_POSTURES = 4
#: A posture counts if it has this share of the runs that the joint's most used one has: moves from posture to posture
#: leave a few runs in postures that nobody meant.
MEANT = 0.25


def hold_out(dataset: Dataset, *, files: Collection[str] = (), postures: bool = False) -> Dataset:
    """Mark more runs as held out, whole files or whole postures at a time, so that no run is fitted in part.

    Parameters
    ----------
    dataset
        What the logs left; runs that the plan holds out stay so.
    files
        Names of log files (as in `Dataset.files`): every run that has a sample in one of them is held out.
    postures
        Of every joint with at least four postures, hold out all runs at the one that was run last.

    Returns
    -------
    dataset
        With `Run.heldout` set and a note on what it is.

    Raises
    ------
    LogError [heldout-nothing]
        No run is meant: the files hold none, or no joint has postures to spare.
    LogError [heldout-all]
        No run of a joint would be left to fit.
    """
    chosen = {number for number, run in enumerate(dataset.runs) if {run.origin, run.last_origin} & set(files)}
    if files and not chosen:
        where = Where(file=sorted(files)[0])
        raise LogError("heldout-nothing", f"there is no run in {_listed(sorted(files))}", where, "name other files")
    told = [f"{len(chosen)} of {_listed(sorted(files))}"] if files else []
    if postures:
        last = _last_postures(dataset.runs)
        joints = sorted({dataset.runs[number].joint for number in last})
        told.append(f"{len(last)} at the last posture of joint {', '.join(map(str, joints))}")
        chosen |= last
    runs = tuple(replace(run, heldout=run.heldout or number in chosen) for number, run in enumerate(dataset.runs))
    _check_left(runs, chosen)
    kept = sum(not run.heldout for run in runs)
    text = f"runs held out: {', '.join(told)}; {kept} of {len(runs)} are left to fit"
    return replace(dataset, runs=runs, notes=(*dataset.notes, Note("held-out", text)))


def otherwise(estimate: Estimate, dataset: Dataset) -> list[Note]:
    """A note where a model's own logs are shared out between fit and judgement in another way than for its fit.

    Parameters
    ----------
    estimate
        It keeps how many runs of each joint were fitted and held out, not which.
    dataset
        Runs as they are held out now. Where its files are not just the model's, nothing can be said.
    """
    if {facts.digest for facts in dataset.files} != set(estimate.logs.values()):
        return []
    told = []
    for fit in estimate.joints:
        own = [run for run in dataset.runs if run.joint == fit.joint]
        now = sum(run.heldout for run in own)
        if now != fit.heldout_runs and len(own) == fit.runs + fit.heldout_runs:
            told.append(f"{now} of joint {fit.joint}'s {len(own)} runs, {fit.heldout_runs} when it was fitted")
    if not told:
        return []
    text = (
        f"other runs are held out than when the model was fitted: {'; '.join(told)}. What is said here of runs that it"
        " saw, and of those that it did not, is not so; was the plan changed, or --heldout used only once?"
    )
    return [Note("held-out-otherwise", text)]


def _last_postures(runs: Sequence[Run]) -> set[int]:
    """Indices of each joint's runs at the posture that was first taken last, where there are enough postures."""
    groups: dict[int, list[list[int]]] = {}
    for number, run in enumerate(runs):
        if not run.heldout:
            own = groups.setdefault(run.joint, [])
            same = (group for group in own if _is_same(runs[group[0]], run))
            group = next(same, None)
            own.append([number]) if group is None else group.append(number)
    for joint, own in groups.items():
        most_used = max(map(len, own))
        groups[joint] = [group for group in own if len(group) >= MEANT * most_used]
    spare = {joint: own[-1] for joint, own in groups.items() if len(own) >= FEWEST_POSTURES}
    if not spare:
        most = max(groups, key=lambda joint: len(groups[joint]), default=None)
        has = "there is no run" if most is None else f"joint {most} has most, {len(groups[most])}"
        what = f"no joint was run in {FEWEST_POSTURES} postures ({has}), so none can be spared"
        raise LogError("heldout-nothing", what, Where(joint=most), "hold out files, or run more postures")
    return {number for group in spare.values() for number in group}


def _is_same(first: Run, second: Run) -> bool:
    return bool(np.all(np.nan_to_num(apart(first.posture, second.posture)) <= SAME_POSTURE))


def _check_left(runs: Sequence[Run], chosen: Collection[int]) -> None:
    for joint in sorted({runs[number].joint for number in chosen}):
        own = [run for run in runs if run.joint == joint]
        if all(run.heldout for run in own):
            files = sorted({run.origin for run in own})
            what = f"all {len(own)} runs of joint {joint} would be held out, and none fitted"
            mend = f"keep one of the files for fitting in which it moves: {_listed(files)}"
            raise LogError("heldout-all", what, Where(joint=joint), mend)


def _listed(names: Sequence[str], most: int = 4) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
