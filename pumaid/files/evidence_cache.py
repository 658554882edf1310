"""What the pass over the logs left, kept from one command to the next; safe to delete at any time.

A file is found by the content of the logs, the parts of the recipe and the options by which it was made, and the
program's own text and numpy's version. So what was kept is never trusted for other logs, and nothing has to be thrown
away by hand. What cannot be read or written is passed over: a cache is a help, not a need.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import secrets
import stat
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from pumaid import __version__
from pumaid.files.evidence_npz import is_evidence, read_evidence, write_evidence
from pumaid.records import Evidence, Robot

if TYPE_CHECKING:  # readers of logs take a tenth of a second to load, and where something is kept none is needed
    from pumaid.files.table import LogPath

#: Rooms of the program on which the pass depends.
_ROOMS = ("cluster", "files", "maths", "motion", "records", "verbs")
#: Bytes that all kept files together may have; the ones not used for longest go first.
MOST_BYTES = 2 << 30
#: s after which a file that was never finished was left by a command that was killed.
_ABANDONED = 86_400.0
_OURS = re.compile(r"[0-9a-f]{16}-[0-9a-f]{32}\.npz")
_UNFINISHED = re.compile(r"\.[0-9a-f]{16}-[0-9a-f]{32}\.npz\.[0-9a-f]{12}\.part")


def cache_folder() -> Path | None:
    """Where things are kept: ``PUMAID_CACHE``, else ``pumaid`` in the platform's folder for caches.

    None for a user who has no home folder: then nothing is kept.
    """
    named = os.environ.get("PUMAID_CACHE")
    if named:
        return Path(named)
    try:
        if sys.platform == "win32":
            return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "pumaid" / "Cache"
        if sys.platform == "darwin":
            return Path.home() / "Library" / "Caches" / "pumaid"
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pumaid"
    except RuntimeError:
        return None


def evidence_folder() -> Path | None:
    """Where passes are kept."""
    folder = cache_folder()
    return None if folder is None else folder / "evidence"


def cache_fault(folder: Path | None) -> str | None:
    """Why nothing can be kept in a folder; None where it can, or could if it were made."""
    if folder is None:
        return "there is no home folder, so nothing is kept; set PUMAID_CACHE to a folder"
    for path in (folder, *folder.parents):
        try:
            mode = path.stat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            if path.is_symlink():
                return f"{path} is a link that leads nowhere, so nothing is kept"
            continue
        except OSError as error:
            return f"{path} cannot be looked at ({error.strerror}), so nothing is kept"
        if not stat.S_ISDIR(mode):
            return f"{path} is no folder, so nothing is kept"
        can = os.access(path, os.R_OK | os.W_OK | os.X_OK if path == folder else os.W_OK | os.X_OK)
        return None if can else f"{path} may not be read and written, so nothing is kept"
    return None


def cache_size(folder: Path) -> int:
    """Bytes of the kept files in a folder."""
    return sum(size for _, size, _ in _kept(folder))


@cache
def _program(version: str) -> str:
    """Digest of the program that makes the pass; its version, which stays while it is worked on, is not enough."""
    whole = hashlib.sha256(version.encode())
    for room in _ROOMS:
        for path in sorted((Path(__file__).parents[1] / room).glob("*.py")):
            whole.update(path.read_bytes())
    return whole.hexdigest()


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
        self._folder = folder or evidence_folder()
        self._before, self._n_joints = _states(self._paths), robot.n_joints
        made_by = [_program(__version__), np.__version__, robot.name, repr(robot.joints), repr(robot.log), options]
        self._made_by = json.dumps([made_by, [str(path) for path in self._paths]])

    def get(self) -> Evidence | None:
        """What was kept of these very bytes, or None. The logs are hashed only where something may fit."""
        if self._before is None or self._folder is None or not _has(self._folder, f"{self._prefix()}-*.npz"):
            return None
        with ThreadPoolExecutor() as pool:
            digests = list(pool.map(_digest, self._paths))
        if None in digests:
            return None
        path = self._folder / self._name([str(digest) for digest in digests])
        evidence = read_evidence(path, self._n_joints)
        if evidence is None or [facts.digest for facts in evidence.files] != digests:
            return None
        with suppress(OSError):
            os.utime(path)
        return evidence

    def put(self, evidence: Evidence) -> None:
        """Keep what a pass left, unless a log changed meanwhile; then remove what is too old and too much."""
        digests = [facts.digest for facts in evidence.files]
        if self._folder is None or self._before is None or len(digests) != len(self._paths):
            return
        if _states(self._paths) != self._before:
            return
        name = self._name(digests)
        temporary = self._folder / f".{name}.{secrets.token_hex(6)}.part"
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            with temporary.open("xb") as sink:
                write_evidence(sink, evidence, name)
            temporary.replace(self._folder / name)
            _make_room(self._folder, MOST_BYTES)
        except OSError:
            return
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)

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


def _has(folder: Path, pattern: str) -> bool:
    """Whether a folder has such a file; one that cannot be looked into has none."""
    try:
        return any(folder.glob(pattern))
    except OSError:
        return False


def _digest(path: LogPath) -> str | None:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
    except OSError:
        return None


def _kept(folder: Path) -> list[tuple[float, int, Path]]:
    """Last use (s), bytes and path of every file that this module wrote, by name and by its first bytes."""
    found = []
    with suppress(OSError):
        for path in folder.iterdir():
            state = path.lstat()
            if _OURS.fullmatch(path.name) and stat.S_ISREG(state.st_mode) and is_evidence(path):
                found.append((state.st_mtime, state.st_size, path))
    return sorted(found)


def _make_room(folder: Path, most: int) -> None:
    """Remove kept files, longest unused first, until the rest has at most `most` bytes; nothing else is touched."""
    kept = _kept(folder)
    too_much = sum(size for _, size, _ in kept) - most
    for _, size, path in kept:
        if too_much <= 0:
            break
        with suppress(OSError):
            path.unlink()
        too_much -= size
    long_ago = time.time() - _ABANDONED
    for path in folder.iterdir():
        if _UNFINISHED.fullmatch(path.name) and path.lstat().st_mtime < long_ago:
            with suppress(OSError):
                path.unlink()
