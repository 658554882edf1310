"""Logs to a dataset: each file is a task of its own, on any executor, and their results are merged in order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

from pumaid.dataset import Dataset, FileFacts, Reject, Run
from pumaid.errors import Faults, LogError, Note, PumaidError, Where
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import LogPath
from pumaid.preprocessing import clock
from pumaid.preprocessing.executors import in_order
from pumaid.preprocessing.log_checks import findings
from pumaid.preprocessing.log_statistics import LogStatistics
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.preprocessing.replicates import duplicates
from pumaid.preprocessing.room import OF_REJECTS, OF_RUNS, Room
from pumaid.preprocessing.segment import Segmenter
from pumaid.robot import Robot

#: Notes of one kind that are printed in full; a campaign of a thousand files may have one in each.
MOST_ALIKE = 3


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
    return _checked(_merged(_counted(results, progress), robot, trust=trust), trust=trust)


def read_file(path: LogPath, *, robot: Robot, options: SegmentOptions, extra: tuple[str, ...] = ()) -> FileResult:
    """Read and segment one file.

    Parameters
    ----------
    path, robot, options, extra
        As of `ingest`.

    Raises
    ------
    LogError, or Faults of it
        The file cannot be read.
    """
    reader = LogReader((path,), robot, extra=extra)
    segmenter, sums = Segmenter(robot, options), LogStatistics(robot)
    for log in reader:
        sums.take(log)
        segmenter.add(log)
    runs, rejects = segmenter.close()
    dataset = Dataset(runs, rejects, reader.files, reader.notes, reader.extra)
    faults = tuple(item for item in findings(sums) if isinstance(item, LogError))
    return FileResult(dataset, sums, faults)


def _counted(results: Iterator[FileResult], progress: Callable[[int], None]) -> Iterator[FileResult]:
    for done, result in enumerate(results, start=1):
        progress(done)
        yield result


def _merged(results: Iterator[FileResult], robot: Robot, *, trust: bool) -> Dataset:
    """The files' results as one dataset; recordings are counted through all files."""
    runs, rejects = Room[Run](OF_RUNS), Room[Reject](OF_REJECTS)
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
    found = [item for item in of_all if isinstance(item, LogError)] or [
        fault for fault in faults if first_of_each[fault.slug] is fault
    ]
    doubts = [item for item in of_all if isinstance(item, Note)]
    notes = [*_merged_notes(notes), *_refused(found, trust=trust), *doubts, *clock.notes(runs.records)]
    return Dataset(tuple(runs.records), tuple(rejects.records), tuple(files), tuple(notes), extra)


def _starts_clock(before: Sequence[FileFacts], here: Sequence[FileFacts]) -> bool:
    """Whether the times of the next file do not follow those of the files before."""
    last = [facts.last_time for facts in before if facts.rows]
    first = [facts.first_time for facts in here if facts.rows]
    return bool(last and first) and not first[0] > last[-1]


def _checked(dataset: Dataset, *, trust: bool) -> Dataset:
    """The dataset with notes on what is in the logs twice; a copy of a file is refused."""
    found = list(duplicates(dataset))
    faults = _refused([item for item in found if isinstance(item, LogError)], trust=trust)
    return replace(dataset, notes=(*dataset.notes, *faults, *(item for item in found if isinstance(item, Note))))


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
