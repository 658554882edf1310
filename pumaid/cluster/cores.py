"""The pass over logs on several cores of this machine: pieces are read by this process and by others beside it."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from threading import Condition, Thread

from pumaid.cluster.mate import CAN_FORK, Mate
from pumaid.cluster.part import Part
from pumaid.cluster.pieces import Found, Reading, file_taken, pieces_of, raised, state_of
from pumaid.cluster.whole import Whole
from pumaid.files.table import LogPath
from pumaid.records import Evidence

#: Bytes of logs for which one more process pays; starting it takes some 20 ms, and as much what it sends back.
WORTH = 8 << 20
#: The same where this one has other work to do meanwhile and what is loaded here is there at once.
WORTH_MEANWHILE = 1 << 18
#: Processes at most where nobody says how many.
MOST = 8
#: Pieces a process that may be read and not yet joined: memory stays bounded where one of them takes long.
_AHEAD = 3


def spread(
    paths: Sequence[LogPath],
    reading: Reading,
    mates: Sequence[Mate],
    *,
    refuse: bool = True,
    meanwhile: Callable[[], object] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Evidence:
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
    evidence
        As `segment` leaves it of the same files, to the bit.

    Raises
    ------
    LogError
        As of one process; the first file that is refused.
    """
    states = [state_of(path) for path in paths]
    pieces = [pieces_of(path, each=len(paths) / (1 + len(mates))) for path in paths]
    one_by_one = [piece for of_one in pieces for piece in of_one]
    desk = _Desk(one_by_one, len(mates) + 1)
    found = _counted(_in_order(desk, reading, mates, meanwhile), len(one_by_one), progress)
    whole, stop = Whole(reading.robot, reading.options), 0
    for path, state, of_one in zip(paths, states, pieces, strict=True):
        stop += len(of_one)
        own, again = islice(found, len(of_one)), partial(_at_once, desk, stop, reading=reading, path=path)
        whole = file_taken(whole, own, len(of_one), path=path, state=state, again=again)
        deque(own, maxlen=0)
    return whole.evidence(refuse=refuse)


def _at_once(desk: _Desk, stop: int, *, reading: Reading, path: LogPath) -> Part:
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


@contextmanager
def started(reading: Reading, count: int) -> Iterator[list[Mate]]:
    """So many other processes, or fewer where the system has no more; they are gone afterwards.

    Parameters
    ----------
    reading
        How they read.
    count
        None where it is 0.
    """
    with ExitStack() as stack:
        mates: list[Mate] = []
        with suppress(OSError):
            mates.extend(stack.enter_context(Mate(reading)) for _ in range(count))
        yield mates


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
    jobs = jobs or min(MOST, _cores())
    if jobs < 2 or not all(path.is_file() for path in paths):
        return 0
    size = sum(path.stat().st_size for path in paths)
    found = min(jobs, size // WORTH)
    if len(paths) < found:
        found = min(found, sum(len(pieces_of(path)) for path in paths))
    return max(found - 1, int(is_busy and CAN_FORK and size >= WORTH_MEANWHILE), 0)


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(eq=False, slots=True)
class _Desk:
    """Pieces to read and what was read, shared by this process's threads."""

    pieces: Sequence[LogPath]
    n_readers: int
    found: dict[int, Found] = field(default_factory=dict)
    given: int = 0
    taken: int = 0
    is_closed: bool = False
    changed: Condition = field(default_factory=Condition)
    back: list[int] = field(default_factory=list)
    wanted: int = 0

    def next(self, *, waits: bool) -> int | None:
        """Number of a piece that nobody reads; None if there is none (or, unless one `waits`, none for now)."""
        with self.changed:
            while not self.is_closed:
                self.given = max(self.given, self.wanted)
                self.back = [number for number in self.back if number >= self.wanted]
                if self.back:
                    return self.back.pop()
                if self.given >= len(self.pieces):
                    return None
                if self.given < self.taken + _AHEAD * self.n_readers:
                    self.given += 1
                    return self.given - 1
                if not waits:
                    return None
                self.changed.wait()
            return None

    def spare(self) -> int | None:
        """Number of a piece for one who is still busy, where there are enough for all others."""
        with self.changed:
            if len(self.pieces) - self.given <= self.n_readers:
                return None
        return self.next(waits=False)

    def drop(self, stop: int) -> None:
        """No piece before this number is wanted any more."""
        with self.changed:
            self.wanted, self.taken = stop, max(self.taken, stop)
            self.changed.notify_all()

    def put(self, number: int, found: Found) -> None:
        with self.changed:
            if number >= self.wanted:
                self.found[number] = found
            self.changed.notify_all()

    def give_back(self, numbers: Iterable[int]) -> None:
        with self.changed:
            self.back.extend(numbers)
            self.changed.notify_all()


def _in_order(
    desk: _Desk, reading: Reading, mates: Sequence[Mate], meanwhile: Callable[[], object] | None
) -> Iterator[Part | None]:
    """What is read of the pieces, in their order, none for unwanted ones; this process reads, too, while it waits."""
    threads = [Thread(target=_ask, args=(mate, desk), daemon=True) for mate in mates]
    for thread in threads:
        thread.start()
    try:
        if meanwhile is not None:
            meanwhile()
        for number in range(len(desk.pieces)):
            yield raised(_awaited(desk, number, reading))
    finally:
        with desk.changed:
            desk.is_closed = True
            desk.changed.notify_all()


def _awaited(desk: _Desk, number: int, reading: Reading) -> Found:
    while True:
        with desk.changed:
            if number < desk.wanted:
                desk.found.pop(number, None)
                return None
            if number in desk.found:
                desk.taken = number + 1
                desk.changed.notify_all()
                return desk.found.pop(number)
        own = desk.next(waits=False)
        if own is not None:
            desk.put(own, reading.tried(desk.pieces[own]))
            continue
        with desk.changed:
            while number not in desk.found and not desk.back:
                desk.changed.wait()


def _ask(mate: Mate, desk: _Desk) -> None:
    """Have pieces read by another process; what it cannot bring to an end is given back."""
    asked = deque[int]()
    with suppress(OSError, EOFError, MemoryError), ExitStack() as ended:
        ended.callback(lambda: desk.give_back(asked))
        while (number := desk.spare() if asked else desk.next(waits=True)) is not None or asked:
            if number is not None:
                asked.append(number)
                mate.ask(desk.pieces[number])
            if number is None or len(asked) > 1:
                desk.put(asked[0], mate.take())
                asked.popleft()
        # It takes itself apart while the last pieces are joined.
        mate.leave()
