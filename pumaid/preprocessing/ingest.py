"""Logs to a dataset: each file is a task of its own, on any executor, and their results are merged in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from pumaid.dataset import Dataset, FileFacts, Log, Reject, Run
from pumaid.errors import Faults, LogError, Note, PumaidError, Where
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import LogPath
from pumaid.preprocessing import clock
from pumaid.preprocessing.log_checks import findings
from pumaid.preprocessing.log_statistics import LogStatistics
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.preprocessing.segment import REJECT_BINS, RUN_BINS, BoundedRecords, segment
from pumaid.robot import Robot

Task = TypeVar("Task")
Result = TypeVar("Result")

#: Notes of one kind that are printed in full; a campaign of a thousand files may have one in each.
MOST_ALIKE = 3
#: Files a worker that may be read ahead of the one whose turn it is: memory stays bounded.
AHEAD = 3
#: Copies of files that are named.
MOST_NAMED = 5


@dataclass(frozen=True, slots=True)
class FileResult:
    """What one file leaves.

    Attributes
    ----------
    dataset
        Its runs and rejects; recordings are counted from 0 in it.
    sums
        Sums by which the meaning of its columns is checked.
    faults
        What these sums show of the file by itself.
    """

    dataset: Dataset
    sums: LogStatistics
    faults: tuple[LogError, ...]


def ingest(
    paths: Sequence[LogPath],
    robot: Robot,
    *,
    options: SegmentOptions = DEFAULTS,
    extra: Sequence[str] = (),
    trust: bool = False,
    executor: tuple[Executor | None, int] = (None, 1),
    progress: Callable[[int], None] = lambda done: None,
) -> Dataset:
    """Read, check and segment logs.

    The result does not depend on where the files are read. A run ends where its file ends.

    Parameters
    ----------
    paths
        Files as `pumaid.io.paths.expand` gives them.
    robot
        The arm that the recipe says these are logs of.
    options
        Thresholds of the segmentation.
    extra
        Columns to read besides; they arrive in the bins.
    trust
        Turns refusals of what cannot be meant into notes.
    executor
        Where files are read, and its number of workers; this process where it is None.
    progress
        Called with the number of files done.

    Returns
    -------
    dataset
        Runs and rejects in order of file and time; together they hold every sample once.

    Raises
    ------
    LogError, or Faults of it
        A file cannot be read, no file has a row, or the columns cannot mean what the recipe says.
    """
    LogReader(paths, robot, extra=extra).check_extra()
    work = partial(read_file, robot=robot, options=options, extra=tuple(extra))
    results = in_order(work, paths, executor[0], workers=executor[1])
    return _merged(_counted(results, progress), robot, trust=trust)


def read_file(path: LogPath, *, robot: Robot, options: SegmentOptions, extra: tuple[str, ...] = ()) -> FileResult:
    """Read and segment one file; parameters and errors as of `ingest`."""
    reader, sums = LogReader((path,), robot, extra=extra), LogStatistics(robot)
    dataset = segment(_watched(reader, sums), robot, options=options)
    dataset = replace(dataset, files=tuple(reader.files), notes=tuple(reader.notes), extra=tuple(reader.extra))
    return FileResult(dataset, sums, tuple(item for item in findings(sums) if isinstance(item, LogError)))


def _watched(logs: Iterable[Log], sums: LogStatistics) -> Iterator[Log]:
    for log in logs:
        sums.take(log)
        yield log


def in_order(
    work: Callable[[Task], Result], tasks: Iterable[Task], executor: Executor | None, *, workers: int = 1
) -> Iterator[Result]:
    """Results of tasks in the order of the tasks; a task whose worker dies is done in this process.

    Parameters
    ----------
    work
        What is done with a task; what it raises is raised here.
    tasks
        In the order of their results.
    executor
        Does the work; this process does it where there is none.
    workers
        Of the executor.
    """
    if executor is None:
        yield from map(work, tasks)
        return
    waiting: deque[tuple[Task, Future[Result] | None]] = deque()
    for task in tasks:
        try:
            waiting.append((task, executor.submit(work, task)))
        except (BrokenExecutor, RuntimeError):  # its workers died, or the connection to them
            waiting.append((task, None))
        if len(waiting) >= AHEAD * workers:
            yield _result(work, *waiting.popleft())
    while waiting:
        yield _result(work, *waiting.popleft())


def _result(work: Callable[[Task], Result], task: Task, future: Future[Result] | None) -> Result:
    if future is None:
        return work(task)
    try:
        return future.result()
    except Exception as error:
        is_lost = isinstance(error, BrokenExecutor | CancelledError)
        if is_lost or type(error).__module__.startswith("distributed."):
            return work(task)
        raise


def _counted(results: Iterator[FileResult], progress: Callable[[int], None]) -> Iterator[FileResult]:
    for done, result in enumerate(results, start=1):
        progress(done)
        yield result


def _merged(results: Iterator[FileResult], robot: Robot, *, trust: bool) -> Dataset:
    """The files' results as one dataset; recordings are counted through all files."""
    runs, rejects = BoundedRecords[Run](RUN_BINS), BoundedRecords[Reject](REJECT_BINS)
    files: list[FileFacts] = []
    notes: list[Note] = []
    faults: list[LogError] = []
    extra: tuple[str, ...] = ()
    total, shift = LogStatistics(robot), 0
    for result in results:
        part = result.dataset
        shift += _starts_clock(files, part.files)
        for run in part.runs:
            runs.add(replace(run, clock=run.clock + shift) if shift else run)
        for reject in part.rejects:
            rejects.add(replace(reject, clock=reject.clock + shift) if shift else reject)
        shift += max([run.clock for run in part.runs] + [reject.clock for reject in part.rejects], default=0)
        files += part.files
        notes += part.notes
        faults += result.faults
        extra = part.extra
        total.absorb(result.sums)
    if not any(facts.rows for facts in files):
        what = f"no log has a row of numbers ({', '.join(facts.name for facts in files[:3])})"
        raise LogError("empty-log", what, Where(file=files[0].name), "record again, or name other files")
    of_all = findings(total)
    # What all logs show needs no message a file; what one file shows may drown in the others.
    first_of_each = {fault.slug: fault for fault in reversed(faults)}
    refused = [item for item in of_all if isinstance(item, LogError)] or [
        fault for fault in faults if first_of_each[fault.slug] is fault
    ]
    doubts = [item for item in of_all if isinstance(item, Note)]
    notes = [*_merged_notes(notes), *_refused(refused, trust=trust), *doubts, *clock.notes(runs.records)]
    notes += _refused(list(_copies(files)), trust=trust)
    return Dataset(tuple(runs.records), tuple(rejects.records), tuple(files), tuple(notes), extra)


def _starts_clock(before: Sequence[FileFacts], following: Sequence[FileFacts]) -> bool:
    """Whether the times of the next file do not follow those of the files before."""
    last = [facts.last_time for facts in before if facts.rows]
    first = [facts.first_time for facts in following if facts.rows]
    return bool(last and first) and not first[0] > last[-1]


def _copies(files: Sequence[FileFacts]) -> Iterator[LogError]:
    """Files that are the same, byte for byte: counted as two they make errors too small by the root of two."""
    first: dict[str, str] = {}
    copies = {
        facts.name: first[facts.digest]
        for facts in files
        if facts.rows and facts.digest and first.setdefault(facts.digest, facts.name) != facts.name
    }
    more = f" (and {len(copies) - MOST_NAMED} more such files)" if len(copies) > MOST_NAMED else ""
    for copy, original in list(copies.items())[:MOST_NAMED]:
        what = f"{copy} is a copy of {original}{more}: counted twice, errors would come out too small"
        yield LogError("log-doubled", what, Where(file=copy), "leave one of the two out")


def _refused(faults: Sequence[PumaidError], *, trust: bool) -> list[Note]:
    """Faults are raised, or become notes where the user trusts the logs."""
    if faults and not trust:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    return [Note(fault.slug, f"{fault.what}; {fault.mend}", fault.where) for fault in faults]


def _merged_notes(notes: Sequence[Note]) -> Iterator[Note]:
    """What several files share word for word once; of each kind the first few, and how many more there are."""
    groups: dict[tuple[str, str], list[Note]] = {}
    for note in notes:
        groups.setdefault((note.slug, note.text), []).append(note)
    by_slug: dict[str, list[Note]] = {}
    for (slug, text), alike in groups.items():
        more = f"; the same in {len(alike) - 1} more files" if len(alike) > 1 else ""
        by_slug.setdefault(slug, []).append(Note(slug, text + more, alike[0].where))
    for slug, several in by_slug.items():
        yield from several[:MOST_ALIKE]
        if rest := several[MOST_ALIKE:]:
            files = list(dict.fromkeys(str(note.where.file) for note in rest))
            named = ", ".join(files[:MOST_ALIKE]) + (" ..." if len(files) > MOST_ALIKE else "")
            yield Note(slug, f"{len(rest)} more notes of this kind, on {named}")
