"""One pass over logs, as the command line asks for it: here, on several cores, or on a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pumaid.cli.options import Pass
from pumaid.cli.output import remark
from pumaid.cli.progress import progress
from pumaid.errors import LogError, Where

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.io.table import LogPath
    from pumaid.preprocessing.options import SegmentOptions
    from pumaid.robot import Robot

#: Runs from which freed memory is given back at the end.
_MANY_RUNS = 1000


def one_pass(
    paths: Sequence[LogPath], robot: Robot, *, trust: bool, extra: Sequence[str], options: SegmentOptions, how: Pass
) -> Dataset:
    """Read, watch and segment logs: on a cluster, on several cores where there is enough to read, or here.

    Parameters
    ----------
    paths
        Files as `expand` gives them.
    robot
        The arm.
    trust
        Turn refusals of what cannot be meant into notes.
    extra
        Columns to read besides.
    options
        Thresholds of the segmentation.
    how
        ``--jobs`` and ``--dask``.
    """
    from pumaid.cluster.memory import give_back_memory, keep_memory

    keep_memory()
    if how.dask:
        dataset = _on_cluster(paths, robot, trust=trust, options=options, how=how)
    elif others := _others(paths, how):
        dataset = _on_cores(paths, robot, others=others, trust=trust, extra=extra, options=options, how=how)
    else:
        dataset = _here(paths, robot, trust=trust, extra=extra, options=options)
    dataset = _single(dataset, trust=trust)
    if len(dataset.runs) > _MANY_RUNS:
        give_back_memory()
    return dataset


def _single(dataset: Dataset, *, trust: bool) -> Dataset:
    """The evidence with notes on what stands twice in the logs; a copy of a file is refused."""
    from pumaid.errors import Faults, LogError, Note
    from pumaid.preprocessing.doubled import doubled

    found = list(doubled(dataset))
    faults = [one for one in found if isinstance(one, LogError)]
    if faults and not trust:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    notes = [
        Note(one.slug, f"{one.what}; {one.mend}", one.where) if isinstance(one, LogError) else one for one in found
    ]
    return replace(dataset, notes=(*dataset.notes, *notes)) if notes else dataset


def _here(
    paths: Sequence[LogPath], robot: Robot, *, trust: bool, extra: Sequence[str], options: SegmentOptions
) -> Dataset:
    """The same by this process."""
    from pumaid.io.table import LogReader
    from pumaid.preprocessing.suspicion import Watch
    from pumaid.verbs.segment import segment

    watched = Watch(LogReader(paths, robot, extra=extra), robot, refuse=not trust)
    with progress("reading logs") as step:
        return segment(
            watched,
            robot,
            options=options,
            progress=lambda rows: step(rows, f"{rows:,} rows"),
        )


def _others(paths: Sequence[LogPath], how: Pass) -> int:
    """How many more processes are worth while."""
    if how.jobs == 1:
        return 0
    from pumaid.cluster.cores import others

    return others(paths, how.jobs, is_busy=not how.is_loaded)


def _on_cores(
    paths: Sequence[LogPath],
    robot: Robot,
    *,
    others: int,
    trust: bool,
    extra: Sequence[str],
    options: SegmentOptions,
    how: Pass,
) -> Dataset:
    """The same by several processes."""
    from pumaid.cluster.cores import spread
    from pumaid.cluster.desk import started
    from pumaid.cluster.pieces import Reading
    from pumaid.io.table import LogReader

    LogReader(paths, robot, extra=extra).check_extra()
    reading = Reading(robot, options, tuple(dict.fromkeys(extra)))
    with started(reading.tried, others) as mates, progress("reading logs") as step:
        return spread(
            paths,
            reading,
            mates,
            refuse=not trust,
            meanwhile=how.load,
            progress=lambda done, count: step(done, f"{done} of {count} files or parts of files"),
        )


@contextmanager
def one_cluster(how: Pass) -> Iterator[Pass]:
    """The same way to read, with one cluster for all experiments that are read meanwhile, from the first on.

    Parameters
    ----------
    how
        With ``--dask`` or without.
    """
    with ExitStack() as stack:

        @cache
        def client() -> Any:
            from pumaid.cluster.connect import connected

            found = stack.enter_context(connected(how.dask, workers=how.jobs or None))
            if not found.scheduler_info()["workers"]:
                remark(f"no worker has come to {how.dask} yet; reading begins with the first (dask worker {how.dask})")
            return found

        yield replace(how, client=how.client or client)


def _on_cluster(paths: Sequence[LogPath], robot: Robot, *, trust: bool, options: SegmentOptions, how: Pass) -> Dataset:
    """The same on the workers of a cluster, a file each."""
    from pumaid.cluster.gather import gather
    from pumaid.io.paths import STDIN

    if STDIN in paths:
        what = "standard input cannot be read by the workers of a cluster"
        raise LogError("no-cluster", what, Where(field=f"--dask {how.dask}"), "name files, or leave --dask away")
    pipe = next((path for path in paths if isinstance(path, Path) and path.exists() and not path.is_file()), None)
    if pipe is not None:
        what = f"{pipe} is a pipe, which the workers of a cluster cannot read"
        raise LogError("no-cluster", what, Where(file=str(pipe)), "name files, or leave --dask away")
    with one_cluster(how) as known, progress("reading logs", total=len(paths)) as step:
        assert known.client is not None
        return gather(
            paths,
            robot,
            known.client(),
            options=options,
            refuse=not trust,
            progress=lambda done, count: step(done, f"{done} of {count} files"),
        )
