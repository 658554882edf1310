"""Logs to a dataset: a file is a task on any executor (processes, a Dask cluster); results are merged in order."""

import logging
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import repeat
from typing import Any, TypeVar

from pumaid import __version__
from pumaid.dataset import Dataset, FileFacts, Reject, Run
from pumaid.errors import Faults, LogError, Note, PumaidError, Where
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import LogPath
from pumaid.preprocessing.binning import DEFAULTS, SegmentOptions
from pumaid.preprocessing.log_checks import LogStatistics, findings
from pumaid.preprocessing.segment import bounded, segment
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
    notes += _refused(_copies(dataset.files), trust=trust)
    return replace(dataset, notes=tuple(notes))


def read_file(
    path: LogPath, *, robot: Robot, options: SegmentOptions, extra: tuple[str, ...] = ()
) -> tuple[Dataset, LogStatistics]:
    """Read and segment one file, whose recordings count from 0; with sums by which its columns are checked."""
    reader, sums = LogReader((path,), robot, extra=extra), LogStatistics(robot)
    return segment(reader, robot, options=options, watch=sums.take), sums


def in_order(work: Callable[[Task], Result], tasks: Sequence[Task], executor: Executor | None) -> Iterator[Result]:
    """Results of tasks in their order, by an executor or this process; a task whose worker dies is done here."""
    for k in range(0, len(tasks), MOST_WAITING):
        batch = tasks[k : k + MOST_WAITING]
        futures: list[Future[Result] | None] = []
        with suppress(RuntimeError):  # its workers died, or the connection to them
            futures.extend(executor.submit(work, task) if executor else None for task in batch)
        futures += [None] * (len(batch) - len(futures))
        yield from map(_result, repeat(work), batch, futures)


def _result(work: Callable[[Task], Result], task: Task, future: Future[Result] | None) -> Result:
    try:
        return future.result() if future else work(task)
    except Exception as error:
        is_lost = isinstance(error, BrokenExecutor | CancelledError)
        if future and (is_lost or type(error).__module__.startswith("distributed.")):
            return work(task)
        raise


def _merged(parts: Iterable[Dataset]) -> Dataset:
    """The files' datasets as one; recordings are counted through all files."""
    whole, recordings, last_time = Dataset(()), 0, -math.inf
    runs: list[Run] = []
    rejects: list[Reject] = []
    files: list[FileFacts] = []
    notes: list[Note] = []
    for part in parts:
        filled = [facts for facts in part.files if facts.rows]
        recordings += bool(filled) and not filled[0].first_time > last_time
        last_time = filled[-1].last_time if filled else last_time
        runs = bounded(runs + [replace(run, clock=run.clock + recordings) for run in part.runs])
        rejects += [replace(reject, clock=reject.clock + recordings) for reject in part.rejects]
        recordings = max([recordings, *(run.clock for run in runs[-1:]), *(reject.clock for reject in rejects[-1:])])
        files += part.files
        notes += part.notes
        whole = part
    return Dataset(tuple(runs), tuple(rejects), tuple(files), tuple(notes), whole.extra)


def _copies(files: Sequence[FileFacts]) -> list[LogError]:
    """Files that are the same, byte for byte: counted as two they make errors too small by the root of two."""
    first: dict[str, str] = {}
    filled = [facts for facts in files if facts.rows and facts.digest]
    copies = [facts for facts in filled if first.setdefault(facts.digest, facts.name) != facts.name]
    more = f" (and {len(copies) - MOST_COPIES} more such files)" if len(copies) > MOST_COPIES else ""
    faults = []
    for facts in copies[:MOST_COPIES]:
        what = f"{facts.name} is a copy of {first[facts.digest]}{more}: counted twice, errors would come out too small"
        faults.append(LogError("log-doubled", what, Where(file=facts.name), "leave one of the two out"))
    return faults


def _refused(faults: Sequence[PumaidError], *, trust: bool) -> list[Note]:
    """Faults are raised, or become notes where the user trusts the logs."""
    if faults and not trust:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    return [Note(fault.slug, f"{fault.what}; {fault.mend}", fault.where) for fault in faults]


def _summarised(notes: Sequence[Note]) -> Iterator[Note]:
    """Of each kind of notes on files the first few, equal texts once, and how many more there are."""
    alike: dict[str, dict[str, list[Note]]] = {}
    for note in notes:
        alike.setdefault(note.slug, {}).setdefault(note.text, []).append(note)
    for slug, by_text in alike.items():
        first = [same[0] for same in by_text.values()]
        for note in first[:MOST_ALIKE]:
            count = len(by_text[note.text]) - 1
            yield replace(note, text=f"{note.text}; the same in {count} more files") if count else note
        rest = [str(note.where.file) for note in first[MOST_ALIKE:]]
        if rest:
            more = " ..." if len(rest) > MOST_ALIKE else ""
            yield Note(slug, f"{len(rest)} more notes of this kind, on {', '.join(rest[:MOST_ALIKE])}{more}")


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
    parent: Any = multiprocessing.parent_process()
    threading.Thread(target=lambda: parent.join() or os._exit(1), daemon=True).start()


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
    local = {"n_workers": jobs or None, "threads_per_worker": 1, "dashboard_address": ":0"}
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
        for name, place in {"the scheduler": versions["scheduler"], **versions["workers"]}.items():
            version = place["packages"].get("pumaid")
            if version != __version__:
                what = f"{name} has {f'pumaid {version}' if version else 'no pumaid'}, this is pumaid {__version__}"
                mend = f"pip install 'pumaid[dask]=={__version__}' where the scheduler and the workers run"
                raise LogError("cluster-differs", what, where, mend)
        yield client.get_executor(pure=False)
