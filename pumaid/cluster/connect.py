"""The connection to a cluster of ``dask.distributed``, or to workers on this machine."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import resource_tracker
from typing import Any

from pumaid import __version__
from pumaid.cluster.memory import leave_memory
from pumaid.errors import LogError, Where

#: The word that asks for workers on this machine.
LOCAL = "local"
#: Of workers that live for one command: dask looks a hundred times a second at what they do.
_CONFIG = {"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s"}
#: s to wait for a scheduler.
PATIENCE = 10


@contextmanager
def connected(address: str, *, workers: int | None = None) -> Iterator[Any]:
    """A ``dask.distributed.Client``.

    Parameters
    ----------
    address
        Of a scheduler, such as ``tcp://10.0.0.5:8786``; or ``local``.
    workers
        Processes where it is local; the number of cores where not given.

    Raises
    ------
    LogError [no-cluster]
        dask is not installed, or no scheduler answers there.
    LogError [cluster-differs]
        The scheduler or a worker has no pumaid, or another one.
    LogError [cluster-lost]
        The scheduler, or worker after worker, ended before the work was done.
    """
    where = Where(field=f"--dask {address}")
    try:
        import distributed
        from distributed.comm import CommClosedError
    except ImportError as error:
        what = "a cluster needs dask.distributed, which is not installed"
        raise LogError("no-cluster", what, where, "pip install 'pumaid[dask]'") from error
    _keep_quiet()
    with _local(workers) if address == LOCAL else _remote(address, where) as client:
        try:
            yield client
        except (CancelledError, distributed.KilledWorker, CommClosedError) as error:
            said = str(error).strip().partition("\n")[0][:200] or type(error).__name__
            what = f"the cluster went away before all logs were read: {said}"
            mend = "see what its scheduler and workers say, start it again, or leave --dask away"
            raise LogError("cluster-lost", what, where, mend) from error


def _keep_quiet() -> None:
    """What a user can mend comes as a message of pumaid's own; a cluster that ends tells its life as tracebacks."""
    for name in ("asyncio", "tornado", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "distributed", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextmanager
def _local(workers: int | None) -> Iterator[Any]:
    """A client of worker processes on this machine, which end with it."""
    import dask
    import distributed

    with ExitStack() as stack:
        stack.enter_context(dask.config.set(_CONFIG))
        with _interrupts_held():
            cluster = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
            )
        stack.enter_context(cluster)
        yield stack.enter_context(distributed.Client(cluster, direct_to_workers=True))


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Processes that are started meanwhile leave Ctrl-C to this one, which hears of it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it would let interrupts in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _remote(address: str, where: Where) -> Iterator[Any]:
    """A client of a scheduler that somebody started."""
    client, seen = _answer(address, where)
    with client:
        _check_same_program(seen, where)
        try:
            yield client
        finally:
            _leave(client)


def _leave(client: Any) -> None:
    """Have the workers give back the memory that they keep for the next batch."""
    if client.status == "running":  # else nobody would answer
        with suppress(OSError):
            client.run(leave_memory, on_error="ignore")


def _answer(address: str, where: Where) -> tuple[Any, Any]:
    """A client and the versions that run there.

    What answers may be no scheduler at all: then dask takes its bytes for lengths, or waits for ever. So it is asked in
    a thread, which is left behind if it does not end.

    Raises
    ------
    LogError [no-cluster]
        No scheduler answers.
    """
    import distributed

    found: list[tuple[Any, Any]] = []
    failed: list[Exception] = []

    def ask() -> None:
        try:
            client = distributed.Client(address, timeout=PATIENCE)
            found.append((client, client.get_versions(packages=["pumaid"])))
        except Exception as error:
            failed.append(error)

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(2 * PATIENCE)
    if found:
        return found[0]
    said = str(failed[0]) or type(failed[0]).__name__ if failed else f"not within {2 * PATIENCE} s"
    what = f"no scheduler answers at {address}: {said.partition(chr(10))[0][:200]}"
    mend = "start one with 'dask scheduler', or give --dask local"
    raise LogError("no-cluster", what, where, mend) from (failed[0] if failed else None)


def _check_same_program(seen: Any, where: Where) -> None:
    """Parts of logs pass between processes of one pumaid only."""
    for name, found in {"the scheduler": seen["scheduler"], **seen["workers"]}.items():
        version = found["packages"].get("pumaid")
        if version != __version__:
            has = f"pumaid {version}" if version else "no pumaid"
            what = f"{name} has {has}, this is pumaid {__version__}"
            mend = f"pip install 'pumaid[dask]=={__version__}' where the scheduler and the workers run"
            raise LogError("cluster-differs", what, where, mend)
