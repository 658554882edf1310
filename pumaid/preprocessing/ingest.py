"""Logs to a dataset: a file is a task on any executor (processes, a Dask cluster); results are merged in order."""

import importlib
import logging
import multiprocessing
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from pumaid import __version__
from pumaid.dataset import Dataset, FileFacts
from pumaid.errors import LogError, Note, Where, listed, refuse
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import LogPath
from pumaid.maths import Counts
from pumaid.preprocessing.binning import DEFAULTS, SegmentOptions
from pumaid.preprocessing.log_checks import LogStatistics, findings
from pumaid.preprocessing.segment import bounded, segment
from pumaid.robot import Robot

Task = TypeVar("Task")
Result = TypeVar("Result")

#: Notes of one kind that are printed in full, and copies of files that are named.
MOST_ALIKE = 3
#: Share of a file's samples that stand in another one, and least number of their marks, by which it is a copy.
ALIKE, FEWEST = 0.9, 16
#: Files whose results may wait for an earlier one's: memory stays bounded.
MOST_WAITING = 64
#: Processes at most where nobody says how many.
MOST_PROCESSES = 8
#: Bytes of logs for which one more process is started (it takes some 30 ms).
BYTES_A_PROCESS = 8 << 20
#: s to wait for a scheduler.
PATIENCE = 10


def ingest(
    paths: Sequence[LogPath],
    robot: Robot,
    *,
    options: SegmentOptions = DEFAULTS,
    extra: Sequence[str] = (),
    trust: bool = False,
    executor: Executor | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Dataset:
    """Read, check and segment logs; the result does not depend on where the files are read.

    `paths` are as `pumaid.io.paths.expand` gives them, `extra` columns to read besides, which arrive in the bins.
    `trust` turns refusals of what cannot be meant into notes; files are read by `executor`, or this process where it is
    None; `progress` is called with the number of files done.

    Raises
    ------
    LogError, or Faults of it
        A file cannot be read, no file has a row, or the columns cannot mean what the recipe says.
    """
    work = partial(read_file, robot=robot, options=options, extra=tuple(extra))
    total, dataset, faults, marks = LogStatistics(robot), Dataset(()), [], []
    for done, (part, sums) in enumerate(in_order(work, paths, executor), start=1):
        dataset = _joined(dataset, part)
        faults += [item for item in findings(sums) if isinstance(item, LogError)]
        marks.append(sums.marks)
        total.absorb(sums)
        progress(done)
    if not any(facts.rows for facts in dataset.files):
        what = f"no log has a row of numbers ({listed([facts.name for facts in dataset.files], 3)})"
        raise LogError("empty-log", what, Where(file=dataset.files[0].name), "record again, or name other files")
    of_all = findings(total)
    # What all logs show needs no message a file; what one file shows may drown in the different.
    filled = sum(facts.rows > 0 for facts in dataset.files)
    refused = [_of_few(item, faults, filled) for item in of_all if isinstance(item, LogError)]
    refused = refused or list({fault.slug: fault for fault in reversed(faults)}.values())[::-1]
    refused += _copies(dataset.files, marks)
    refuse([] if trust else refused)
    believed = [Note(item.slug, f"{item.what}; {item.mend}", item.where) for item in refused]
    notes = [*_summarised(dataset.notes), *believed, *(item for item in of_all if isinstance(item, Note))]
    return replace(dataset, notes=tuple(notes))


def _of_few(item: LogError, faults: Sequence[LogError], n_files: int) -> LogError:
    """What all files show together; or, where at most half of them show it, what the first of these shows."""
    shown = [fault for fault in faults if fault.slug == item.slug and fault.what.split()[0] == item.what.split()[0]]
    names = [*dict.fromkeys(str(fault.where.file) for fault in shown)]
    if not 0 < len(names) <= n_files / 2:
        return item
    what = f"of {n_files} logs this is of {listed(names, 3)} only: write it as the others are, or identify it apart"
    return LogError(item.slug, shown[0].what, shown[0].where, f"{what}; or, if all are so, {shown[0].mend}")


def read_file(
    path: LogPath, *, robot: Robot, options: SegmentOptions, extra: tuple[str, ...] = ()
) -> tuple[Dataset, LogStatistics]:
    """Read and segment one file, whose recordings count from 0; with sums by which its columns are checked."""
    reader, sums = LogReader(path, robot, extra=extra), LogStatistics(robot)
    dataset = segment(reader, robot, options=options, watch=sums.take)
    sums.robot = reader.robot
    sums.intervals = [facts.interval for facts in dataset.files if facts.interval > 0.0]
    return dataset, sums


def in_order(work: Callable[[Task], Result], tasks: Sequence[Task], executor: Executor | None) -> Iterator[Result]:
    """Results of tasks in their order, by an executor or this process; what is lost with a worker is done here."""
    for k in range(0, len(tasks), MOST_WAITING):
        batch, done = tasks[k : k + MOST_WAITING], 0
        try:
            for result in (executor.map if executor else map)(work, batch):
                done += 1
                yield result
        except Exception as error:
            is_lost = isinstance(error, BrokenExecutor | CancelledError)
            if not executor or not (is_lost or type(error).__module__.startswith("distributed.")):
                raise
        yield from map(work, batch[done:])


def _joined(whole: Dataset, part: Dataset) -> Dataset:
    """Two files' datasets as one; the second's recordings are counted on, and begin anew where its time does."""
    before, now = ([facts for facts in dataset.files if facts.rows] for dataset in (whole, part))
    last = max([0, *(run.clock for run in whole.runs[-1:]), *(reject.clock for reject in whole.rejects[-1:])])
    last += bool(before and now) and not now[0].first_time > before[-1].last_time
    runs = [*whole.runs, *(replace(run, clock=run.clock + last) for run in part.runs)]
    rejects = (*whole.rejects, *(replace(reject, clock=reject.clock + last) for reject in part.rejects))
    return Dataset(tuple(bounded(runs)), rejects, (*whole.files, *part.files), (*whole.notes, *part.notes), part.extra)


def _copies(files: Sequence[FileFacts], marks: Sequence[Counts]) -> Iterator[LogError]:
    """Files whose samples stand in an earlier one, or hold those of one, by their `marks`, whatever their times."""
    first, pairs = dict[int, int](), dict[str, str]()
    for number, (facts, part) in enumerate(zip(files, marks, strict=True)):
        for other, count in Counter(first[mark] for mark in part.tolist() if mark in first).most_common(1):
            limit = min(part[-1], marks[other][-1])  # of each file the least marks are there
            if count > max(FEWEST, ALIKE * min((chosen <= limit).sum() for chosen in (part, marks[other]))):
                pairs[facts.name] = f"{facts.name} has the samples of {files[other].name} again"
        first = dict.fromkeys(part.tolist(), number) | first
    if pairs:
        more = f" ... ({len(pairs)} in all)" if len(pairs) > MOST_ALIKE else ""
        yield LogError(
            "log-doubled",
            f"{'; '.join([*pairs.values()][:MOST_ALIKE])}{more}: counted twice, errors would come out too small, and"
            " those of held-out samples would be those of the fit",
            Where(file=next(iter(pairs))),
            "leave one of the two out",
        )


def _summarised(notes: Sequence[Note]) -> Iterator[Note]:
    for slug in dict.fromkeys(note.slug for note in notes):
        alike = [*dict.fromkeys(note for note in notes if note.slug == slug)]
        yield from alike[:MOST_ALIKE]
        rest = [str(note.where.file) for note in alike[MOST_ALIKE:]]
        if rest:
            yield Note(slug, f"{len(rest)} more notes of this kind, on {listed(rest, MOST_ALIKE)}")


@contextmanager
def local_processes(n_bytes: Sequence[int], jobs: int = 0) -> Iterator[Executor | None]:
    """A pool of processes on this machine for files of some sizes; None where one process is as quick.

    `jobs` are the processes at most; 0 for one a core, but no more than `MOST_PROCESSES`.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = min(jobs or min(cores, MOST_PROCESSES), len(n_bytes), sum(n_bytes) // BYTES_A_PROCESS)
    if workers < 2:
        yield None
        return
    importlib.import_module("pyarrow.parquet")  # once, before the processes part
    method = "fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn"
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context(method), initializer=_start_worker)
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _start_worker() -> None:
    """Ctrl-C, which reaches all processes of a command, ends a worker without a traceback; so does its parent's end."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent: Any = multiprocessing.parent_process()
    threading.Thread(target=lambda: parent.join() or os._exit(1), daemon=True).start()


@contextmanager
def dask_workers(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster as an executor.

    Raises
    ------
    LogError [no-cluster]
        Dask is not installed, no scheduler answers at the address, or it or a worker has no pumaid or another version.
    """
    where = Where(field=f"--dask {address}")
    try:
        import distributed
    except ImportError as error:
        what = "a cluster needs dask.distributed, which is not installed"
        raise LogError("no-cluster", what, where, "pip install 'pumaid[dask]'") from error
    for name in ("distributed", "tornado", "asyncio"):  # a cluster that ends logs it as tracebacks
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as stack:
        try:
            client = stack.enter_context(distributed.Client(address, timeout=PATIENCE))
            versions = client.get_versions(packages=["pumaid"])
        except (OSError, ValueError, TypeError) as error:
            what = f"no scheduler answers at {address}: {(str(error) or type(error).__name__).splitlines()[0][:200]}"
            mend = "start one with 'dask scheduler'; --jobs reads in processes of this machine"
            raise LogError("no-cluster", what, where, mend) from error
        places = (versions["scheduler"], *versions["workers"].values())
        different = sorted({str(place["packages"].get("pumaid")) for place in places} - {__version__})
        if different:
            what = f"scheduler or workers have pumaid {listed(different)}, this is pumaid {__version__}"
            mend = f"pip install 'pumaid[dask]=={__version__}' where the scheduler and the workers run"
            raise LogError("no-cluster", what, where, mend)
        yield client.get_executor(pure=False)
