"""The parts of an experiment on a cluster: read where they lie, many joined in a tree, judged as a whole."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

from pumaid.cluster.memory import keep_memory
from pumaid.cluster.part import Part
from pumaid.cluster.pieces import SMALL, Found, Reading, State, file_taken, pieces_of, raised, state_of
from pumaid.cluster.whole import Whole
from pumaid.dataset import Dataset
from pumaid.io.table import LogPath
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.robot import Robot

#: Parts that one worker joins at a time.
FAN_IN = 8
#: Parts up to which this process takes them one by one, while others are still read; more are joined where they lie.
_ENOUGH = 64
#: Files looked into at a time; a store takes tens of milliseconds to answer.
_LOOKING = 16


@dataclass(frozen=True, eq=False, slots=True)
class _Node:
    """Of the tree: parts to come of one file, or one part of several files.

    Attributes
    ----------
    path
        The first file.
    parts
        The futures of all pieces of a file, or one of a part.
    size
        Bytes of the logs.
    files
        How many files.
    state
        What the file is known by, of a single one.
    """

    path: LogPath
    parts: tuple[Any, ...]
    size: int
    files: int = 1
    state: State = ()


def gather(
    paths: Sequence[LogPath],
    robot: Robot,
    client: Any,
    *,
    options: SegmentOptions = DEFAULTS,
    refuse: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """All that later steps know of some logs, read by the workers of a cluster.

    Each file is a task; of a Parquet file that is large, or one of few, each few row groups. What a worker that dies
    had read is read again by another.

    Parameters
    ----------
    paths
        Files as `expand` gives them; every worker must see them under these names.
    robot
        The arm.
    client
        A ``dask.distributed.Client``.
    options
        Thresholds of the segmentation.
    refuse
        False turns refusals of what cannot be meant into notes.
    progress
        Called with the number of files read, and how many there are.

    Returns
    -------
    dataset
        As `segment` leaves it of the same files.

    Raises
    ------
    LogError
        As of one process; the first file that is refused.
    """
    reading = Reading(robot, options)
    each = len(paths) / max(1, sum(client.nthreads().values()))
    with ThreadPoolExecutor(_LOOKING) as pool:
        looked = pool.map(partial(_looked_into, each=each), paths)
    # The files in their order: this process takes the first while others are still read.
    leaves = [
        _Node(
            path,
            tuple(client.submit(_tried, reading, piece, pure=False, priority=-number) for piece in pieces),
            state[0],
            state=state,
        )
        for number, (path, (pieces, state)) in enumerate(zip(paths, looked, strict=True))
    ]
    nodes, whole, done = deque(_tree(client, reading, leaves)), Whole(robot, options), 0
    del leaves  # what was taken is let go by the cluster
    while nodes:
        node = nodes.popleft()
        found = (raised(part.result()) for part in node.parts)
        again = partial(_read_at_once, client, reading, node.path)
        whole = file_taken(whole, found, len(node.parts), path=node.path, state=node.state, again=again)
        done += node.files
        if progress is not None:
            progress(done, len(paths))
    return whole.dataset(refuse=refuse)


def _tried(reading: Reading, piece: LogPath) -> Found:
    """As `Reading.tried`, by a worker."""
    keep_memory()
    return reading.tried(piece)


def _looked_into(path: LogPath, *, each: float) -> tuple[Sequence[LogPath], State]:
    """The pieces of a file, and what it is known by."""
    state = state_of(path)
    return pieces_of(path, each=each), state


def _tree(client: Any, reading: Reading, nodes: list[_Node]) -> list[_Node]:
    """The parts that this process takes: joined where there are many of small files, level by level."""
    while len(nodes) > _ENOUGH:
        bundles = list(_bundles(nodes))
        if len(bundles) == len(nodes):
            break
        nodes = [_joined(client, reading, bundle) if len(bundle) > 1 else bundle[0] for bundle in bundles]
    return nodes


def _bundles(nodes: Sequence[_Node]) -> Iterator[list[_Node]]:
    """Consecutive nodes that become one, of no more logs than a small file: what comes at a time stays bounded."""
    bundle: list[_Node] = []
    for node in nodes:
        is_full = len(bundle) == FAN_IN or sum(one.size for one in bundle) + node.size > SMALL
        if bundle and (is_full or max(len(node.parts), len(bundle[-1].parts)) > 1):
            yield bundle
            bundle = []
        bundle.append(node)
    if bundle:
        yield bundle


def _joined(client: Any, reading: Reading, bundle: Sequence[_Node]) -> _Node:
    part = client.submit(reading.joined, *(node.parts[0] for node in bundle), pure=False)
    return _Node(bundle[0].path, (part,), sum(node.size for node in bundle), sum(node.files for node in bundle))


def _read_at_once(client: Any, reading: Reading, path: LogPath) -> Part:
    part = raised(client.submit(_tried, reading, path, pure=False).result())
    assert part is not None  # what is none is a part of a file
    return part
