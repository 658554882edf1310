"""The parts of an experiment on a cluster: read where they lie, joined in a tree, judged as a whole."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

from pumaid.cluster.part import Part, goes_on, joined, read_part
from pumaid.errors import LogError, Where
from pumaid.files.table import LogPath, merged_notes
from pumaid.motion.options import DEFAULTS, SegmentOptions
from pumaid.motion.room import Room
from pumaid.motion.seam import Side
from pumaid.records import Evidence, Robot

Sides = tuple[Side | None, Side | None]

#: Parts that one worker joins at a time.
FAN_IN = 8


def gather(
    paths: Sequence[LogPath],
    robot: Robot,
    client: Any,
    *,
    options: SegmentOptions = DEFAULTS,
    refuse: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Evidence:
    """All that later steps know of some logs, read by the workers of a cluster.

    Each file is a task. Where a motion goes on from one file in the next, the two are read again as one. What a worker
    that dies had read is read again by another.

    Parameters
    ----------
    paths
        Files as `expand` gives them; every worker must see them under these names.
    robot
        The arm.
    client
        A ``dask.distributed.Client``.
    options
        Thresholds of the segmentation.
    refuse
        False turns refusals of what cannot be meant into notes.
    progress
        Called with the number of files read, and how many there are.

    Returns
    -------
    evidence
        As `segment` leaves it of the same files.

    Raises
    ------
    LogError
        As of one process; the first file that is refused.
    """
    groups = [(path,) for path in paths]
    futures = [_submitted(client, group, robot, options) for group in groups]
    together = _together(_ends(client, futures, progress))
    if len(together) < len(groups):
        again = [tuple(path for k in one for path in groups[k]) for one in together]
        futures = [
            futures[one[0]] if len(one) == 1 else _submitted(client, group, robot, options)
            for one, group in zip(together, again, strict=True)
        ]
    while len(futures) > 1:
        futures = [client.submit(_joined, *futures[k : k + FAN_IN], pure=False) for k in range(0, len(futures), FAN_IN)]
    return judged(futures[0].result(), refuse=refuse)


def judged(whole: Part, *, refuse: bool) -> Evidence:
    """The evidence of all parts, cells bounded as of one pass, refused where the columns cannot mean what is said.

    Parameters
    ----------
    whole
        All parts joined.
    refuse
        False turns refusals into notes.

    Raises
    ------
    LogError [empty-log]
        No file has a row.
    LogError
        As `pumaid.motion.suspicion.Watch` does.
    """
    evidence = whole.evidence
    if not any(facts.rows for facts in evidence.files):
        what = f"no log has a row of numbers ({', '.join(facts.name for facts in evidence.files[:3])})"
        raise LogError("empty-log", what, Where(file=evidence.files[0].name), "record again, or name other files")
    told = whole.sums.judged(refuse=refuse)
    room = Room()
    for run in evidence.runs:
        room.add(run)
    return replace(evidence, runs=tuple(room.runs), notes=(*merged_notes(evidence.notes), *told))


def _submitted(client: Any, group: Sequence[LogPath], robot: Robot, options: SegmentOptions) -> Any:
    return client.submit(read_part, tuple(group), robot, options, pure=False)


def _sides(part: Part) -> Sides:
    return part.first, part.last


def _joined(*parts: Part) -> Part:
    return reduce(joined, parts)


def _ends(client: Any, futures: Sequence[Any], progress: Callable[[int, int], None] | None) -> list[Sides]:
    """Both ends of each part, in order; raises what the first part that was refused raised."""
    told = [client.submit(_sides, future, pure=False) for future in futures]
    found = []
    for done, one in enumerate(told, start=1):
        found.append(one.result())
        if progress is not None:
            progress(done, len(told))
    return found


def _together(ends: Sequence[Sides]) -> list[list[int]]:
    """Numbers of the parts that must be read as one, in order."""
    out: list[list[int]] = [[0]]
    for number in range(1, len(ends)):
        if goes_on(ends[number - 1][1], ends[number][0]):
            out[-1].append(number)
        else:
            out.append([number])
    return out
