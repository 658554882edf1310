"""Logs to a dataset: a file is a task on any executor (processes, a Dask cluster); results are merged in order."""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any, TypeVar

from pumaid import __version__
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

#: Notes of one kind that are printed in full, and copies of files that are named.
MOST_ALIKE, MOST_COPIES = 3, 5
#: Files whose results may wait for an earlier one's: memory stays bounded.
MOST_WAITING = 64
#: Processes at most where nobody says how many.
MOST_PROCESSES = 8
#: Bytes of logs for which one more process is started (it takes some 30 ms).
BYTES_A_PROCESS = 8 << 20
#: s to wait for a scheduler.
PATIENCE = 10
#: The address that asks for Dask workers on this machine.
LOCAL = "local"


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
    LogReader(paths, robot, extra=extra).check_extra()
    work = partial(read_file, robot=robot, options=options, extra=tuple(extra))
    total = LogStatistics(robot)
    faults: list[LogError] = []

    def checked() -> Iterator[Dataset]:
        for done, (part, sums) in enumerate(in_order(work, paths, executor), start=1):
            faults.extend(item for item in findings(sums) if isinstance(item, LogError))
            total.absorb(sums)
            progress(done)
            yield part

    dataset = _merged(checked())
    if not any(facts.rows for facts in dataset.files):
        what = f"no log has a row of numbers ({', '.join(facts.name for facts in dataset.files[:3])})"
        raise LogError("empty-log", what, Where(file=dataset.files[0].name), "record again, or name other files")
    of_all = findings(total)
    # What all logs show needs no message a file; what one file shows may drown in the others.
    refused = [item for item in of_all if isinstance(item, LogError)]
    refused = refused or list({fault.slug: fault for fault in reversed(faults)}.values())[::-1]
    notes = [*_summarised(dataset.notes), *_refused(refused, trust=trust)]
    notes += [item for item in of_all if isinstance(item, Note)]
    notes += [*clock.notes(dataset.runs), *_refused(_copies(dataset.files), trust=trust)]
    return replace(dataset, notes=tuple(notes))


def read_file(
    path: LogPath, *, robot: Robot, options: SegmentOptions, extra: tuple[str, ...] = ()
) -> tuple[Dataset, LogStatistics]:
    """Read and segment one file, whose recordings count from 0; with sums by which its columns are checked."""
    reader, sums = LogReader((path,), robot, extra=extra), LogStatistics(robot)
    dataset = segment(_summed(reader, sums), robot, options=options)
    return replace(dataset, files=tuple(reader.files), notes=tuple(reader.notes), extra=tuple(reader.extra)), sums


def _summed(logs: Iterable[Log], sums: LogStatistics) -> Iterator[Log]:
    for log in logs:
        sums.take(log)
        yield log


def in_order(work: Callable[[Task], Result], tasks: Sequence[Task], executor: Executor | None) -> Iterator[Result]:
    """Results of tasks in their order, by an executor or this process; a task whose worker dies is done here."""
    if executor is None:
        yield from map(work, tasks)
        return
    waiting: deque[tuple[Task, Future[Result] | None]] = deque()
    for task in tasks:
        try:
            waiting.append((task, executor.submit(work, task)))
        except RuntimeError:  # its workers died, or the connection to them
            waiting.append((task, None))
        if len(waiting) >= MOST_WAITING:
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


def _merged(parts: Iterable[Dataset]) -> Dataset:
    """The files' datasets as one; recordings are counted through all files."""
    runs, rejects = BoundedRecords[Run](RUN_BINS), BoundedRecords[Reject](REJECT_BINS)
    files: list[FileFacts] = []
    notes: list[Note] = []
    extra: tuple[str, ...] = ()
    recordings, last_time = 0, -math.inf
    for part in parts:
        filled = [facts for facts in part.files if facts.rows]
        recordings += bool(filled) and not filled[0].first_time > last_time
        last_time = filled[-1].last_time if filled else last_time
        for run in part.runs:
            runs.add(replace(run, clock=run.clock + recordings))
        for reject in part.rejects:
            rejects.add(replace(reject, clock=reject.clock + recordings))
        recordings += max([*(run.clock for run in part.runs), *(reject.clock for reject in part.rejects)], default=0)
        files += part.files
        notes += part.notes
        extra = part.extra
    return Dataset(tuple(runs.records), tuple(rejects.records), tuple(files), tuple(notes), extra)


def _copies(files: Sequence[FileFacts]) -> list[LogError]:
    """Files that are the same, byte for byte: counted as two they make errors too small by the root of two."""
    first: dict[str, str] = {}
    copies = {
        facts.name: first[facts.digest]
        for facts in files
        if facts.rows and facts.digest and first.setdefault(facts.digest, facts.name) != facts.name
    }
    more = f" (and {len(copies) - MOST_COPIES} more such files)" if len(copies) > MOST_COPIES else ""
    mend = "leave one of the two out"
    what = f"{{}} is a copy of {{}}{more}: counted twice, errors would come out too small"
    named = list(copies.items())[:MOST_COPIES]
    return [LogError("log-doubled", what.format(*pair), Where(file=pair[0]), mend) for pair in named]


def _refused(faults: Sequence[PumaidError], *, trust: bool) -> list[Note]:
    """Faults are raised, or become notes where the user trusts the logs."""
    if faults and not trust:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    return [Note(fault.slug, f"{fault.what}; {fault.mend}", fault.where) for fault in faults]


def _summarised(notes: Sequence[Note]) -> Iterator[Note]:
    """Of each kind of notes on files the first few, equal texts once, and how many more there are."""
    by_slug: dict[str, dict[str, list[Note]]] = {}
    for note in notes:
        by_slug.setdefault(note.slug, {}).setdefault(note.text, []).append(note)
    for slug, by_text in by_slug.items():
        for text, alike in islice(by_text.items(), MOST_ALIKE):
            more = f"; the same in {len(alike) - 1} more files" if len(alike) > 1 else ""
            yield Note(slug, text + more, alike[0].where)
        rest = list(by_text.values())[MOST_ALIKE:]
        if rest:
            files = ", ".join(str(alike[0].where.file) for alike in rest[:MOST_ALIKE])
            more = " ..." if len(rest) > MOST_ALIKE else ""
            yield Note(slug, f"{len(rest)} more notes of this kind, on {files}{more}")


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
    method = "fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn"
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context(method), initializer=_start_worker)
    try:
        yield pool
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _start_worker() -> None:
    """Ctrl-C, which reaches all processes of a command, ends a worker without a traceback; so does its parent's end."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with, args=[multiprocessing.parent_process()], daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def dask_workers(address: str, jobs: int = 0) -> Iterator[Executor]:
    """The workers of a Dask cluster as an executor; of `LOCAL`, `jobs` workers on this machine (0 for one a core).

    Raises
    ------
    LogError [no-cluster]
        Dask is not installed, or no scheduler answers at the address.
    LogError [cluster-differs]
        The scheduler or a worker has no pumaid, or another version.
    """
    where = Where(field=f"--dask {address}")
    try:
        import distributed
    except ImportError as error:
        what = "a cluster needs dask.distributed, which is not installed"
        raise LogError("no-cluster", what, where, "pip install 'pumaid[dask]'") from error
    for name in ("distributed", "tornado", "asyncio"):  # a cluster that ends logs it as tracebacks
        logging.getLogger(name).setLevel(logging.CRITICAL)
    local = {"n_workers": jobs or None, "threads_per_worker": 1, "dashboard_address": None}
    with ExitStack() as stack:
        try:
            place: Any = address
            if address == LOCAL:
                place = stack.enter_context(distributed.LocalCluster(**local, silence_logs=logging.CRITICAL))
            client = stack.enter_context(distributed.Client(place, timeout=PATIENCE))
            versions = client.get_versions(packages=["pumaid"])
        except (OSError, ValueError, TypeError) as error:
            what = f"no scheduler answers at {address}: {(str(error) or type(error).__name__).splitlines()[0][:200]}"
            mend = "start one with 'dask scheduler', or give --dask local"
            raise LogError("no-cluster", what, where, mend) from error
        if address != LOCAL:
            _check_versions({"the scheduler": versions["scheduler"], **versions["workers"]}, where)
        yield client.get_executor(pure=False)


def _check_versions(places: Mapping[str, Any], where: Where) -> None:
    for name, place in places.items():
        version = place["packages"].get("pumaid")
        if version != __version__:
            what = f"{name} has {f'pumaid {version}' if version else 'no pumaid'}, this is pumaid {__version__}"
            mend = f"pip install 'pumaid[dask]=={__version__}' where the scheduler and the workers run"
            raise LogError("cluster-differs", what, where, mend)
