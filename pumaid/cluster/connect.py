"""The connection to a cluster of ``dask.distributed``, or to workers on this machine."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pumaid.errors import LogError, Where

#: The word that asks for workers on this machine.
LOCAL = "local"
#: Of workers that live for one command. Dask has them give memory back at every chance, and batches of samples then
#: take ten times as many page faults; and it looks a hundred times a second at what they do.
_CONFIG = {
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 256 << 20,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 32 << 20,
    "distributed.worker.profile.enabled": False,
}
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
    """
    where = Where(field=f"--dask {address}")
    try:
        import distributed
    except ImportError as error:
        what = "a cluster needs dask.distributed, which is not installed"
        raise LogError("no-cluster", what, where, "pip install 'pumaid[dask]'") from error
    if address == LOCAL:
        import dask

        with (
            dask.config.set(_CONFIG),
            distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=None,
                silence_logs=logging.ERROR,  # what a user must know comes as pumaid's own messages
            ) as cluster,
            distributed.Client(cluster, direct_to_workers=True) as client,
        ):
            yield client
        return
    try:
        client = distributed.Client(address, timeout=PATIENCE)
    except (OSError, ValueError, TimeoutError) as error:
        what = f"no scheduler answers at {address}: {error}"
        raise LogError("no-cluster", what, where, "start one with 'dask scheduler', or give --dask local") from error
    with client:
        yield client
