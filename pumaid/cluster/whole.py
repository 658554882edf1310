"""The parts of an experiment, taken one after the other in the order of the files."""

from __future__ import annotations

from pumaid.cluster.part import Part, behind, between, later
from pumaid.errors import LogError, Note, Where
from pumaid.files.table import merged_notes
from pumaid.motion.options import SegmentOptions
from pumaid.motion.room import Room
from pumaid.motion.suspicion import Sums
from pumaid.records import Evidence, FileFacts, Log, Reject, Robot


class Whole:
    """What is known of all parts so far; bounded like one pass, however many parts there are.

    Parameters
    ----------
    robot, options
        As the parts were read with.
    """

    def __init__(self, robot: Robot, options: SegmentOptions) -> None:
        self._robot, self._options = robot, options
        self._room, self._rejects = Room(), list[Reject]()
        self._files, self._notes = list[FileFacts](), list[Note]()
        self._extra: tuple[str, ...] = ()
        self._sums = Sums(robot)
        self._waiting: tuple[Log, ...] = ()
        self._clock: int | None = None

    def add(self, part: Part) -> None:
        """Take the next part, which must not be used any more."""
        head = behind(self._files, part, self._robot)
        self._waiting = (*self._waiting, *head)
        if not part.is_open:
            self._look()
            self._keep(later(part.evidence, self._clock or 0))
            self._clock = (self._clock or 0) + part.clocks
            self._waiting = part.tail
        self._files += part.evidence.files
        self._notes += part.evidence.notes
        self._extra = self._extra or part.evidence.extra
        self._sums.absorb(part.sums)

    def evidence(self, *, refuse: bool) -> Evidence:
        """As `segment` leaves it of the same files; refused where the columns cannot mean what is said.

        Parameters
        ----------
        refuse
            False turns refusals into notes.

        Raises
        ------
        LogError [empty-log]
            No file has a row.
        LogError
            As `pumaid.motion.suspicion.Watch` does.
        """
        if not any(facts.rows for facts in self._files):
            what = f"no log has a row of numbers ({', '.join(facts.name for facts in self._files[:3])})"
            raise LogError("empty-log", what, Where(file=self._files[0].name), "record again, or name other files")
        told = self._sums.judged(refuse=refuse)
        self._look()
        notes = (*merged_notes(self._notes), *told)
        return Evidence(tuple(self._room.runs), tuple(self._rejects), tuple(self._files), notes, self._extra)

    def _look(self) -> None:
        found, self._clock = between(self._waiting, self._robot, self._options, clock=self._clock)
        self._keep(found)
        self._waiting = ()

    def _keep(self, evidence: Evidence) -> None:
        for run in evidence.runs:
            self._room.add(run)
        self._rejects += evidence.rejects
