"""The parts of an experiment, taken one after the other in the order of the files."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import replace

from pumaid.cluster.part import Part, behind, later
from pumaid.dataset import Dataset, FileFacts, Reject, Run
from pumaid.errors import LogError, Note, Where
from pumaid.io.table import merged_notes
from pumaid.preprocessing import clock
from pumaid.preprocessing.options import SegmentOptions
from pumaid.preprocessing.room import OF_REJECTS, OF_RUNS, Room
from pumaid.preprocessing.segmenter import Segmenter
from pumaid.preprocessing.suspicion import Sums
from pumaid.robot import Robot


class Whole:
    """What is known of all parts so far; bounded like one pass, however many parts there are.

    Parameters
    ----------
    robot, options
        As the parts were read with.
    """

    def __init__(self, robot: Robot, options: SegmentOptions) -> None:
        self._robot, self._options = robot, options
        self._runs, self._rejects = Room[Run](OF_RUNS), Room[Reject](OF_REJECTS)
        self._files, self._notes = list[FileFacts](), list[Note]()
        self._extra: tuple[str, ...] = ()
        self._sums = Sums(robot)
        self._clock: int | None = None
        # Of what lies between the last rest of one part and the first of another, perhaps many parts later.
        self._between = Segmenter(robot, options)

    def copy(self) -> Whole:
        """Another one that goes on from here."""
        other = copy(self)
        other._runs, other._rejects = self._runs.copy(), self._rejects.copy()
        other._files, other._notes = self._files.copy(), self._notes.copy()
        other._sums, other._between = self._sums.copy(), self._between.copy()
        return other

    def add(self, part: Part, *, goes_on: bool = False) -> None:
        """Take the next part, which must not be added once more.

        Parameters
        ----------
        part
            What comes next in the order of the files.
        goes_on
            Whether it is of the same file as the last one.
        """
        for log in behind(self._files, part, self._robot):
            self._between.add(log)
        if not part.is_open:
            self._look()
            self._keep(later(part.dataset, self._clock or 0))
            self._clock = (self._clock or 0) + part.clocks
            self._between = Segmenter(self._robot, self._options, clock=self._clock)
            for log in part.tail:
                self._between.add(log)
        if goes_on:
            first, facts = self._files[-1], part.dataset.files[-1]
            if facts.rows:
                self._files[-1] = replace(first, rows=first.rows + facts.rows, last_time=facts.last_time)
        else:
            self._files += part.dataset.files
            self._notes += part.dataset.notes
        self._extra = self._extra or part.dataset.extra
        self._sums.absorb(part.sums)

    def note(self, notes: Iterable[Note]) -> None:
        """Add what is worth a note of the last file.

        Parameters
        ----------
        notes
            Of its rows; those on its columns came with it.
        """
        self._notes += notes

    def dataset(self, *, refuse: bool) -> Dataset:
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
            As `pumaid.preprocessing.suspicion.Watch` does.
        """
        if not any(facts.rows for facts in self._files):
            what = f"no log has a row of numbers ({', '.join(facts.name for facts in self._files[:3])})"
            raise LogError("empty-log", what, Where(file=self._files[0].name), "record again, or name other files")
        told = self._sums.judged(refuse=refuse)
        self._look()
        runs = tuple(self._runs.records)
        notes = (*merged_notes(self._notes), *told, *clock.notes(runs))
        return Dataset(runs, tuple(self._rejects.records), tuple(self._files), notes, self._extra)

    def _look(self) -> None:
        runs, rejects = self._between.close()
        self._clock = self._between.clock
        self._keep(Dataset(runs, rejects))

    def _keep(self, dataset: Dataset) -> None:
        for run in dataset.runs:
            self._runs.add(run)
        for reject in dataset.rejects:
            self._rejects.add(reject)
