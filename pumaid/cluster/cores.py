"""The pass over logs on several cores of this machine: pieces are read by this process and by others beside it."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from itertools import islice

from pumaid.cluster.desk import Desk, in_order
from pumaid.cluster.mate import CAN_FORK, Mate
from pumaid.cluster.part import Part
from pumaid.cluster.pieces import Reading, file_taken, pieces_of, raised, state_of
from pumaid.cluster.whole import Whole
from pumaid.dataset import Dataset
from pumaid.io.table import LogPath

#: Bytes of logs for which one more process pays; starting it takes some 20 ms, and as much what it sends back.
WORTH = 8 << 20
#: The same where this one has other work to do meanwhile and what is loaded here is there at once.
WORTH_MEANWHILE = 1 << 18
#: Processes at most where nobody says how many.
MOST = 8


def spread(
    paths: Sequence[LogPath],
    reading: Reading,
    mates: Sequence[Mate],
    *,
    refuse: bool = True,
    meanwhile: Callable[[], object] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """All that later steps know of some logs, read by this process and others.

    Files, and row groups of large Parquet files, are read each by itself and joined in their order.

    Parameters
    ----------
    paths
        Files as `expand` gives them, all of which can be opened by their names.
    reading
        How they are read.
    mates
        Other processes; they may be none.
    refuse
        False turns refusals of what cannot be meant into notes.
    meanwhile
        Called when the others have begun, before this process reads, too.
    progress
        Called with the number of pieces joined, and how many there are.

    Returns
    -------
    dataset
        As `segment` leaves it of the same files, to the bit.

    Raises
    ------
    LogError
        As of one process; the first file that is refused.
    """
    states = [state_of(path) for path in paths]
    pieces = [pieces_of(path, each=len(paths) / (1 + len(mates))) for path in paths]
    one_by_one = [piece for of_one in pieces for piece in of_one]
    desk = Desk(one_by_one, len(mates) + 1)
    whole, stop = Whole(reading.robot, reading.options), 0
    with closing(in_order(desk, reading.tried, mates, meanwhile=meanwhile)) as results:
        found = _counted(map(raised, results), len(one_by_one), progress)
        for path, state, of_one in zip(paths, states, pieces, strict=True):
            stop += len(of_one)
            own, again = islice(found, len(of_one)), partial(_at_once, desk, stop, reading=reading, path=path)
            whole = file_taken(whole, own, len(of_one), path=path, state=state, again=again)
            deque(own, maxlen=0)
    return whole.dataset(refuse=refuse)


def _at_once(desk: Desk, stop: int, *, reading: Reading, path: LogPath) -> Part:
    """A file that is read as a whole after all; what nobody has begun of its pieces, up to `stop`, stays unread."""
    desk.drop(stop)
    return reading.file(path)


def _counted(
    found: Iterator[Part | None], count: int, progress: Callable[[int, int], None] | None
) -> Iterator[Part | None]:
    """The same, with word of how many there were."""
    for done, part in enumerate(found, start=1):
        if progress is not None:
            progress(done, count)
        yield part


def others(paths: Sequence[LogPath], jobs: int, *, is_busy: bool = False) -> int:
    """How many more processes are worth while for some files.

    Parameters
    ----------
    paths
        Files as `expand` gives them.
    jobs
        Processes at most, this one included; 0 for the machine's cores, but no more than `MOST`.
    is_busy
        Whether this one has something else to do first.
    """
    jobs = jobs or usual()
    if jobs < 2 or not all(path.is_file() for path in paths):
        return 0
    size = sum(path.stat().st_size for path in paths)
    found = min(jobs, size // WORTH)
    if len(paths) < found:
        found = min(found, sum(len(pieces_of(path)) for path in paths))
    return max(found - 1, int(is_busy and CAN_FORK and size >= WORTH_MEANWHILE), 0)


def usual() -> int:
    """Processes where nobody says how many: one for each core that this one may use, but no more than `MOST`."""
    return min(MOST, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
