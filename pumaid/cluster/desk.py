"""Tasks that this process and others beside it take from one desk, and what comes of them in their order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from threading import Condition, Thread
from typing import Any

from pumaid.cluster.mate import Mate, Work

#: Tasks a process that may be done and not yet taken: memory stays bounded where one of them takes long.
_AHEAD = 3


@contextmanager
def started(work: Work, count: int) -> Iterator[list[Mate]]:
    """So many other processes, or fewer where the system has no more; they are gone afterwards.

    Parameters
    ----------
    work
        What they do with a task.
    count
        None where it is 0.
    """
    with ExitStack() as stack:
        mates: list[Mate] = []
        with suppress(OSError):
            mates.extend(stack.enter_context(Mate(work)) for _ in range(count))
        yield mates


@dataclass(eq=False, slots=True)
class Desk:
    """Tasks and what came of them, shared by this process's threads.

    Attributes
    ----------
    tasks
        In the order in which their results are wanted.
    n_hands
        Processes that take them.
    """

    tasks: Sequence[Any]
    n_hands: int
    found: dict[int, Any] = field(default_factory=dict)
    given: int = 0
    taken: int = 0
    is_closed: bool = False
    changed: Condition = field(default_factory=Condition)
    back: list[int] = field(default_factory=list)
    wanted: int = 0

    def next(self, *, waits: bool) -> int | None:
        """Number of a task that nobody has; None if there is none (or, unless one `waits`, none for now)."""
        with self.changed:
            while not self.is_closed:
                self.given = max(self.given, self.wanted)
                self.back = [number for number in self.back if number >= self.wanted]
                if self.back:
                    return self.back.pop()
                if self.given >= len(self.tasks):
                    return None
                if self.given < self.taken + _AHEAD * self.n_hands:
                    self.given += 1
                    return self.given - 1
                if not waits:
                    return None
                self.changed.wait()
            return None

    def spare(self) -> int | None:
        """Number of a task for one who is still busy, where there are enough for all others."""
        with self.changed:
            if len(self.tasks) - self.given <= self.n_hands:
                return None
        return self.next(waits=False)

    def drop(self, stop: int) -> None:
        """No task before this number is wanted any more."""
        with self.changed:
            self.wanted, self.taken = stop, max(self.taken, stop)
            self.changed.notify_all()

    def put(self, number: int, found: Any) -> None:
        """What came of a task."""
        with self.changed:
            if number >= self.wanted:
                self.found[number] = found
            self.changed.notify_all()

    def give_back(self, numbers: Iterable[int]) -> None:
        """Tasks that another has to do."""
        with self.changed:
            self.back.extend(numbers)
            self.changed.notify_all()


def in_order(
    desk: Desk, work: Work, mates: Sequence[Mate], *, meanwhile: Callable[[], object] | None = None
) -> Generator[Any, None, None]:
    """What comes of the tasks, in their order, None of unwanted ones; this process takes some, too, while it waits.

    Parameters
    ----------
    desk
        With as many hands as there are mates and one.
    work
        What is done with a task; what it raises, it raises here.
    mates
        Other processes that do the same; they may be none.
    meanwhile
        Called when they have begun, before this process takes a task, too.
    """
    threads = [Thread(target=_ask, args=(mate, desk), daemon=True) for mate in mates]
    for thread in threads:
        thread.start()
    try:
        if meanwhile is not None:
            meanwhile()
        for number in range(len(desk.tasks)):
            yield _awaited(desk, number, work)
    finally:
        with desk.changed:
            desk.is_closed = True
            desk.changed.notify_all()


def _awaited(desk: Desk, number: int, work: Work) -> Any:
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
            desk.put(own, work(desk.tasks[own]))
            continue
        with desk.changed:
            while number not in desk.found and not desk.back:
                desk.changed.wait()


def _ask(mate: Mate, desk: Desk) -> None:
    """Have tasks done by another process; what it cannot bring to an end is given back."""
    asked = deque[int]()
    with suppress(OSError, EOFError, MemoryError), ExitStack() as ended:
        ended.callback(lambda: desk.give_back(asked))
        while (number := desk.spare() if asked else desk.next(waits=True)) is not None or asked:
            if number is not None:
                asked.append(number)
                mate.ask(desk.tasks[number])
            if number is None or len(asked) > 1:
                desk.put(asked[0], mate.take())
                asked.popleft()
        # It takes itself apart while the last ones are taken.
        mate.leave()
