"""Logs that do not mean what the recipe says: wrong units, swapped columns, dead currents."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import copy, deepcopy

from pumaid.dataset import FileFacts
from pumaid.errors import Faults, LogError, Note
from pumaid.preprocessing import doubts, signals
from pumaid.preprocessing.tally import Tally
from pumaid.records import Log
from pumaid.robot import Robot


class Watch:
    """Passes a stream of logs on and keeps sums of it; at its end it refuses or flags what cannot be meant.

    All logs together are judged, and each file by itself: what is wrong in one may drown in the others. A fault from
    which wrong numbers would certainly follow is raised when the stream ends, so before anything is made
    of it; a doubt is a note. Each comes with the figures behind it and with what to change. The samples themselves are
    passed on untouched, so one pass suffices.

    Parameters
    ----------
    logs
        Consecutive batches, SI. What the iterable tells of its files (`files`, `notes`, `extra`) is taken over.
    robot
        The arm that the recipe says these are logs of.
    refuse
        False turns refusals into notes: for a user who knows better.

    Raises
    ------
    LogError
        At the end of the stream: [looks-like-degrees, units-disagree, time-unit, constant-current, joints-swapped,
        velocity-of-another, current-copied]. Several are told together (`Faults`).

    Examples
    --------
    >>> dataset = segment(Watch(LogReader(expand(["logs/"]), robot), robot), robot)  # doctest: +SKIP
    """

    def __init__(self, logs: Iterable[Log], robot: Robot, *, refuse: bool = True) -> None:
        self._logs, self._robot, self._refuse = logs, robot, refuse
        self._found: list[Note] = []

    @property
    def files(self) -> tuple[FileFacts, ...]:
        """Facts of the files read so far, as the stream below tells them."""
        return tuple(getattr(self._logs, "files", ()))

    @property
    def extra(self) -> tuple[str, ...]:
        """Names of the columns that the stream below reads besides."""
        return tuple(getattr(self._logs, "extra", ()))

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes of the stream below, and doubts once it has ended."""
        return (*getattr(self._logs, "notes", ()), *self._found)

    def __iter__(self) -> Iterator[Log]:
        sums = Sums(self._robot)
        self._found = []
        for log in self._logs:
            sums.take(log)
            yield log
        self._found = sums.judged(refuse=self._refuse)


class Sums:
    """What is kept of a stream to judge it by: sums of all logs, and what each file by itself shows.

    Parameters
    ----------
    robot
        The arm that the recipe says these are logs of.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot, self._between = robot, Tally(robot)
        # The first and the last file may go on in the logs before and behind; those between are judged.
        self._ends: list[Tally] = []
        self._faults: list[LogError] = []

    def copy(self) -> Sums:
        """Another one that goes on from here."""
        other = copy(self)
        other._between, other._ends = deepcopy((self._between, self._ends), {id(self._robot): self._robot})
        other._faults = self._faults.copy()
        return other

    def take(self, log: Log) -> None:
        """Add a batch."""
        if not self._ends or log.origin != self._ends[-1].origin:
            self._put([Tally(self._robot, log.origin)])
        self._ends[-1].take(log)

    def absorb(self, other: Sums) -> None:
        """Add what was kept of logs that come after these.

        Parameters
        ----------
        other
            Of the same robot; it must not be used any more.
        """
        theirs = other._ends
        if self._ends and theirs and self._ends[-1].origin == theirs[0].origin:
            self._ends[-1].absorb(theirs[0])
        else:
            self._put(theirs[:1])
        if len(theirs) > 1:
            self._judge(1)
            self._between.absorb(other._between)
            self._faults += other._faults
            self._ends.append(theirs[1])

    def settle(self) -> None:
        """Judge the files at the ends, too, now: where they do not go on, who adds these to others need not."""
        for tally in self._ends:
            tally.faults = _faults(tally)

    def _put(self, files: Sequence[Tally]) -> None:
        self._ends += files
        if len(self._ends) > 2:
            self._judge(1)

    def _judge(self, number: int) -> None:
        """Judge the file of this number among the ends, if there is one."""
        for tally in self._ends[number : number + 1]:
            self._faults += _faults(tally)
            self._between.absorb(tally)
        del self._ends[number : number + 1]

    def judged(self, *, refuse: bool) -> list[Note]:
        """Doubts about all that was taken; it must not be used any more.

        Parameters
        ----------
        refuse
            False turns refusals into notes.

        Raises
        ------
        LogError
            As `Watch`.
        """
        ends = [_faults(tally) for tally in self._ends]
        faults = [
            *(fault for end in ends[:1] for fault in end),
            *self._faults,
            *(fault for end in ends[1:] for fault in end),
        ]
        total = self._ends[0] if self._ends else Tally(self._robot)
        for tally in (self._between, *self._ends[1:]):
            total.absorb(tally)
        of_all, doubtful = suspicions(total)
        # What all logs show needs no telling file by file; what one file shows may drown in the others.
        found = of_all or _first_of_each(faults)
        if found and refuse:
            raise found[0] if len(found) == 1 else Faults(found)
        return [Note(fault.slug, f"{fault.what}; {fault.mend}", fault.where) for fault in found] + doubtful


def _faults(tally: Tally) -> list[LogError]:
    return suspicions(tally)[0] if tally.faults is None else tally.faults


def _first_of_each(faults: Iterable[LogError]) -> list[LogError]:
    """Of faults of one kind the first file's; a thousand files may have the same."""
    first: dict[str, LogError] = {}
    for fault in faults:
        first.setdefault(fault.slug, fault)
    return list(first.values())


def suspicions(tally: Tally) -> tuple[list[LogError], list[Note]]:
    """What the sums of a whole stream tell: faults that must be refused, and doubts.

    Parameters
    ----------
    tally
        Of all logs of one robot.

    Returns
    -------
    faults, notes
        In the order in which a user should look at them: units first, since they cause most of the rest.
    """
    found: list[LogError | Note] = [*doubts.of_units(tally)]
    if not any(isinstance(item, LogError) for item in found):
        found += [
            *doubts.of_limits(tally),
            *signals.of_velocity(tally),
            *signals.of_position(tally),
            *signals.of_current(tally),
            *doubts.of_order(tally),
        ]
        found += doubts.of_rest(tally)
    return [item for item in found if isinstance(item, LogError)], [item for item in found if isinstance(item, Note)]
