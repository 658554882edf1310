"""Where the files of an experiment are read: in this process, in several here, or on the workers of a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from pumaid import __version__
from pumaid.errors import LogError, Where

#: Processes at most where nobody says how many.
MOST_PROCESSES = 8
#: Bytes of logs for which one more process is started (it takes some 30 ms).
BYTES_A_PROCESS = 8 << 20
#: s to wait for a scheduler.
PATIENCE = 10
#: The address that asks for Dask workers on this machine.
LOCAL = "local"


@contextmanager
def local_processes(n_bytes: Sequence[int], jobs: int = 0) -> Iterator[tuple[Executor | None, int]]:
    """A pool of processes on this machine, and how many; none where one process is as quick.

    Parameters
    ----------
    n_bytes
        Size of each file.
    jobs
        Processes at most; 0 for one a core, but no more than `MOST_PROCESSES`.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = min(jobs or min(cores, MOST_PROCESSES), len(n_bytes), sum(n_bytes) // BYTES_A_PROCESS)
    if workers < 2:
        yield None, 1
        return
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("fork" if "fork" in methods else "spawn")
    pool = ProcessPoolExecutor(workers, context, initializer=_start_worker)
    try:
        yield pool, workers
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
def dask_workers(address: str, jobs: int = 0) -> Iterator[tuple[Executor, int]]:
    """The workers of a Dask cluster as an executor, and how many there are.

    Parameters
    ----------
    address
        Of a scheduler, such as ``tcp://10.0.0.5:8786``; or ``local`` for workers on this machine, which end with it.
    jobs
        Workers where it is local; 0 for one a core.

    Raises
    ------
    LogError [no-cluster]
        Dask is not installed, or no scheduler answers there.
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
    with ExitStack() as stack:
        try:
            if address == LOCAL:
                place: Any = distributed.LocalCluster(
                    n_workers=jobs or None, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
                )
                stack.enter_context(place)
            else:
                place = address
            client = stack.enter_context(distributed.Client(place, timeout=PATIENCE))
            versions = client.get_versions(packages=["pumaid"])
        except (OSError, ValueError, TypeError) as error:
            what = f"no scheduler answers at {address}: {(str(error) or type(error).__name__).splitlines()[0][:200]}"
            mend = "start one with 'dask scheduler', or give --dask local"
            raise LogError("no-cluster", what, where, mend) from error
        if address != LOCAL:
            _check_versions({"the scheduler": versions["scheduler"], **versions["workers"]}, where)
        yield client.get_executor(pure=False), max(1, len(versions["workers"]))


def _check_versions(places: Mapping[str, Any], where: Where) -> None:
    for name, place in places.items():
        version = place["packages"].get("pumaid")
        if version != __version__:
            what = f"{name} has {f'pumaid {version}' if version else 'no pumaid'}, this is pumaid {__version__}"
            mend = f"pip install 'pumaid[dask]=={__version__}' where the scheduler and the workers run"
            raise LogError("cluster-differs", what, where, mend)
