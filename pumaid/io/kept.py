"""Where what a command worked out is kept for the next one, under which names, and how much of it.

Everything there is safe to delete at any time, and what cannot be read or written is passed over: it is a help, not a
need. Nothing is ever removed but what `Shelf.put` wrote.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import stat
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO

from pumaid import __version__

#: s after which a file that was never finished was left by a command that was killed.
_ABANDONED = 86_400.0


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


@cache
def program(rooms: Sequence[str], version: str = __version__) -> str:
    """Digest of the program's own text, as far as it is in these folders of it, and of its version.

    The version alone stays the same while the program is worked on.

    Parameters
    ----------
    rooms
        Folders of the package; the empty name stands for what lies beside them.
    version
        Of the program.
    """
    whole = hashlib.sha256(version.encode())
    for room in rooms:
        for path in sorted((Path(__file__).parents[1] / room).glob("*.py")):
            whole.update(path.read_bytes())
    return whole.hexdigest()


class Shelf:
    """A folder of kept files of one kind.

    Parameters
    ----------
    folder
        None where nothing can be kept.
    ending
        Of the files' names, such as ``.npz``; before it stand 16 and 32 hexadecimal digits.
    is_ours
        Whether a file begins as one of this kind; only such are ever removed.
    most
        Bytes that all of them together may have; the ones not used for longest go first.
    """

    def __init__(self, folder: Path | None, ending: str, *, is_ours: Callable[[Path], bool], most: int) -> None:
        self.folder, self._is_ours, self._most = folder, is_ours, most
        name = rf"[0-9a-f]{{16}}-[0-9a-f]{{32}}{re.escape(ending)}"
        self._finished, self._unfinished = re.compile(name), re.compile(rf"\.{name}\.[0-9a-f]{{12}}\.part")

    def has(self, pattern: str) -> bool:
        """Whether there is such a file; a folder that cannot be looked into has none."""
        try:
            return self.folder is not None and any(self.folder.glob(pattern))
        except OSError:
            return False

    def size(self) -> int:
        """Bytes of all that is kept."""
        return sum(size for _, size, _ in self._kept())

    def used(self, name: str) -> None:
        """Note that a file was of use, so that others go first."""
        if self.folder is not None:
            with suppress(OSError):
                os.utime(self.folder / name)

    def put(self, name: str, write: Callable[[BinaryIO], object]) -> None:
        """Keep what `write` writes, whole or not at all; then remove what is too old and too much."""
        if self.folder is None:
            return
        temporary = self.folder / f".{name}.{secrets.token_hex(6)}.part"
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            with temporary.open("xb") as sink:
                write(sink)
            temporary.replace(self.folder / name)
            self._make_room()
        except OSError:
            return
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)

    def _kept(self) -> list[tuple[float, int, Path]]:
        """Last use (s), bytes and path of every file that was put here, by its name and its first bytes."""
        found = []
        with suppress(OSError):
            for path in self.folder.iterdir() if self.folder is not None else ():
                state = path.lstat()
                if self._finished.fullmatch(path.name) and stat.S_ISREG(state.st_mode) and self._is_ours(path):
                    found.append((state.st_mtime, state.st_size, path))
        return sorted(found)

    def _make_room(self) -> None:
        """Remove kept files, longest unused first, until the rest is not too much; nothing else is touched."""
        kept = self._kept()
        too_much = sum(size for _, size, _ in kept) - self._most
        for _, size, path in kept:
            if too_much <= 0:
                break
            with suppress(OSError):
                path.unlink()
            too_much -= size
        long_ago = time.time() - _ABANDONED
        for path in self.folder.iterdir() if self.folder is not None else ():
            if self._unfinished.fullmatch(path.name) and path.lstat().st_mtime < long_ago:
                with suppress(OSError):
                    path.unlink()
