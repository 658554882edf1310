"""What the pass over the logs left, kept from one command to the next; safe to delete at any time.

A file is found by the content of the logs, the parts of the recipe and the options by which it was made, and the
program's own text and numpy's version. So what was kept is never trusted for other logs, and nothing has to be thrown
away by hand.
"""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from pumaid import __version__
from pumaid.dataset import Dataset
from pumaid.io.evidence_npz import is_evidence, read_dataset, write_dataset
from pumaid.io.kept import Shelf, cache_folder, program
from pumaid.robot import Robot

if TYPE_CHECKING:  # readers of logs take a tenth of a second to load, and where something is kept none is needed
    from pumaid.io.table import LogPath

#: Rooms of the program on which the pass depends.
_ROOMS = ("cluster", "io", "maths", "preprocessing", "records", "verbs")
#: Bytes that all kept passes together may have; the ones not used for longest go first.
MOST_BYTES = 2 << 30


def evidence_folder() -> Path | None:
    """Where passes are kept."""
    folder = cache_folder()
    return None if folder is None else folder / "evidence"


def evidence_shelf(folder: Path | None) -> Shelf:
    """A folder as one of kept passes."""
    return Shelf(folder, ".npz", is_ours=is_evidence, most=MOST_BYTES)


class EvidenceCache:
    """The kept evidence of one set of logs, recipe and options.

    Parameters
    ----------
    paths
        The logs as the reader is given them; none is kept unless all are plain files.
    robot
        Of it the name, the joints and the log's format count: the pass sees nothing else.
    options
        Everything else that the pass depends on, as text.
    folder
        Where files are kept; the default is `cache_folder`.
    """

    def __init__(self, paths: Sequence[LogPath], robot: Robot, *, options: str, folder: Path | None = None) -> None:
        self._paths = tuple(paths)
        self._shelf = evidence_shelf(folder or evidence_folder())
        self._before, self._n_joints = _states(self._paths), robot.n_joints
        made_by = [
            program(_ROOMS, __version__),
            np.__version__,
            robot.name,
            repr(robot.joints),
            repr(robot.log),
            options,
        ]
        self._made_by = json.dumps([made_by, [str(path) for path in self._paths]])

    def get(self, *, meanwhile: Callable[[], object] | None = None) -> Dataset | None:
        """What was kept of these very bytes, or None.

        The logs are hashed only where something may fit; `meanwhile` is then called.
        """
        if self._before is None or self._shelf.folder is None or not self._shelf.has(f"{self._prefix()}-*.npz"):
            return None
        with ThreadPoolExecutor() as pool:
            found = pool.map(_digest, self._paths)
            if meanwhile is not None:
                meanwhile()
            digests = list(found)
        if None in digests:
            return None
        name = self._name([str(digest) for digest in digests])
        dataset = read_dataset(self._shelf.folder / name, self._n_joints)
        if dataset is None or [facts.digest for facts in dataset.files] != digests:
            return None
        self._shelf.used(name)
        return dataset

    def put(self, dataset: Dataset) -> None:
        """Keep what a pass left, unless a log changed meanwhile; then remove what is too old and too much."""
        digests = [facts.digest for facts in dataset.files]
        if self._before is None or len(digests) != len(self._paths) or _states(self._paths) != self._before:
            return
        name = self._name(digests)
        self._shelf.put(name, lambda sink: write_dataset(sink, dataset, name))

    def _prefix(self) -> str:
        """Of all but the content, which takes reading: names and sizes tell most misses apart."""
        sizes = [state[0] for state in self._before or ()]
        return hashlib.sha256(f"{self._made_by}{sizes}".encode()).hexdigest()[:16]

    def _name(self, digests: Sequence[str]) -> str:
        whole = hashlib.sha256(f"{self._made_by}{list(digests)}".encode()).hexdigest()
        return f"{self._prefix()}-{whole[:32]}.npz"


def _states(paths: Sequence[LogPath]) -> list[tuple[int, int, int, int]] | None:
    """Size, times of change (ns) and inode of each file; None unless all are plain files."""
    found = []
    try:
        for path in paths:
            state = path.stat()
            if not stat.S_ISREG(state.st_mode):
                return None
            found.append((state.st_size, state.st_mtime_ns, state.st_ctime_ns, state.st_ino))
    except OSError:
        return None
    return found


def _digest(path: LogPath) -> str | None:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
    except OSError:
        return None
