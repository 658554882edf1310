"""The parts of an experiment on a cluster: read where they lie, joined in a tree, judged as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from pumaid.cluster.part import Part
from pumaid.cluster.pieces import Reading, pieces_of
from pumaid.cluster.whole import Whole
from pumaid.files.table import LogPath
from pumaid.motion.options import DEFAULTS, SegmentOptions
from pumaid.records import Evidence, Robot

#: Parts that one worker joins at a time.
FAN_IN = 8
#: Parts up to which this process takes them one by one, while others are still read; more are joined where they lie.
_ENOUGH = 64
#: Files looked into at a time; a store takes tens of milliseconds to answer.
_LOOKING = 16


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

    Each file is a task, of large Parquet files each few row groups. What a worker that dies had read is read again by
    another.

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
    reading = Reading(robot, options)
    with ThreadPoolExecutor(_LOOKING) as pool:
        pieces = list(pool.map(pieces_of, paths))
    read = [[client.submit(reading.piece, piece, pure=False) for piece in of_one] for of_one in pieces]
    parts = [client.submit(reading.file, path, *of_one, pure=False) for path, of_one in zip(paths, read, strict=True)]
    told = [client.submit(_is_read, future, pure=False) for future in parts]
    each = 1
    while len(parts) > _ENOUGH:
        parts = [client.submit(reading.joined, *some, pure=False) for some in _in_groups(parts)]
        each *= FAN_IN
    del read  # what nobody asks for any more is let go by the cluster
    whole = Whole(robot, options)
    for number in range(len(parts)):
        for done in range(number * each, min((number + 1) * each, len(told))):
            told[done].result()  # raises what the first file that was refused raised
            if progress is not None:
                progress(done + 1, len(told))
        whole.add(parts[number].result())
        parts[number] = None
    return whole.evidence(refuse=refuse)


def _in_groups(parts: Sequence[Any]) -> Iterator[Sequence[Any]]:
    for start in range(0, len(parts), FAN_IN):
        yield parts[start : start + FAN_IN]


def _is_read(_: Part) -> bool:
    return True
