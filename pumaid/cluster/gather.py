"""The parts of an experiment on a cluster: read where they lie, many joined in a tree, judged as a whole."""

from __future__ import annotations

from collections import deque
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
    files = deque(_of_file(client, reading, *one, order=-n) for n, one in enumerate(zip(paths, pieces, strict=True)))
    parts = _one_by_one(files) if len(files) <= _ENOUGH else _by_tree(client, reading, files)
    whole = Whole(robot, options)
    for done, part in enumerate(parts, start=1):
        if part is not None:
            whole.add(part)
        if progress is not None:
            progress(done, len(paths))
    return whole.evidence(refuse=refuse)


def _of_file(client: Any, reading: Reading, path: LogPath, pieces: Sequence[LogPath], *, order: int) -> Any:
    """The part of a file, to come; a file of one piece is one task, so that it is on its way when the next is read."""
    read = [client.submit(reading.piece, piece, pure=False, priority=order) for piece in pieces]
    if pieces == [path]:
        return read[0]
    return client.submit(reading.file, path, *read, pure=False, priority=order + 1)


def _one_by_one(files: deque[Any]) -> Iterator[Part]:
    """Each file's part; what was taken is let go by the cluster."""
    while files:
        yield files.popleft().result()


def _by_tree(client: Any, reading: Reading, files: deque[Any]) -> Iterator[Part | None]:
    """Once a file: the part it is joined in, with the last of its files; None with the others."""
    told = deque(client.submit(_is_read, part, pure=False) for part in files)
    parts, each = files, 1
    while len(parts) > _ENOUGH:
        parts = deque(client.submit(reading.joined, *some, pure=False) for some in _in_groups(parts))
        each *= FAN_IN
    while told:
        for still in reversed(range(min(each, len(told)))):
            told.popleft().result()  # raises what the first file that was refused raised
            yield None if still else parts.popleft().result()


def _in_groups(parts: deque[Any]) -> Iterator[Sequence[Any]]:
    while parts:
        yield [parts.popleft() for _ in range(min(FAN_IN, len(parts)))]


def _is_read(_: Part) -> bool:
    return True
