"""Writing files atomically: a reader sees the old content or all of the new one, never a part."""

from __future__ import annotations

import errno
import importlib
import os
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pumaid.errors import ResultError, Where

#: Longest wait for another process that writes to the same folder, and how often the lock is tried, s.
PATIENCE, PAUSE = 20.0, 0.02

_ELSEWHERE = "write elsewhere with -o"
_MENDS = {
    errno.ENOSPC: f"free some space on that disk, or {_ELSEWHERE}",
    errno.EDQUOT: f"your disk quota is used up: free some space, or {_ELSEWHERE}",
    errno.EROFS: f"that disk is read-only: {_ELSEWHERE}",
    errno.EACCES: f"you may not write there: change the folder's permissions, or {_ELSEWHERE}",
    errno.EISDIR: "a folder of that name is in the way: give a file name with -o",
    errno.ENOTDIR: f"a file stands where a folder is needed: {_ELSEWHERE}",
    errno.EEXIST: f"a file stands where a folder is needed: {_ELSEWHERE}",
    errno.ENAMETOOLONG: "give a shorter name with -o",
}


def write_file(path: Path, data: bytes | str) -> None:
    """Write a file atomically, missing folders with it; a device or a pipe (``/dev/stdout``) directly.

    Text is encoded as UTF-8; surrogates (bytes of a file name that are not UTF-8) become backslash escapes.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses; the old content is unchanged.
    """
    content = data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data
    if _is_stream(Path(path)):
        try:
            Path(path).write_bytes(content)
        except OSError as error:
            raise _refusal(Path(path), error) from error
        return
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def refuse_to_replace(path: Path) -> None:
    """Refuse to write a file where one stands that a user may have edited.

    Raises
    ------
    ResultError [file-exists]
        There is a file of that name.
    """
    if str(path) != "-" and path.exists():
        mend = "replace it with --force, or write to another file with -o"
        raise ResultError("file-exists", f"{path} is there already", Where(file=str(path)), mend)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that is renamed to it when the block ends without an error.

    An error in the block leaves nothing behind. A symbolic link stays; the file that it points to is replaced. Missing
    folders are made.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses, in the block or at its end.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
    try:
        if target.is_symlink():
            raise OSError(errno.ELOOP, "links that lead to one another")
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        yield temporary
        with temporary.open("rb+") as file:  # without this a power cut could leave an empty file under the new name
            os.fsync(file.fileno())
        with suppress(FileNotFoundError):
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
    except OSError as error:
        raise _refusal(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path, *, patience: float = PATIENCE) -> Iterator[None]:
    """Keep other processes of this program out of a folder during the block.

    The folder itself, made if it is missing, is locked (flock), so no lock file remains, and the system releases the
    lock when a process ends. Where there are no such locks the block runs without one.

    Raises
    ------
    ResultError [results-busy]
        Another process holds the lock for longer than `patience` (s).
    """
    try:
        fcntl = importlib.import_module("fcntl")
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        end = time.monotonic() + patience
        while not _locks(fcntl, handle):
            if time.monotonic() > end:
                what = f"another run of pumaid has been writing to {folder} for {patience:g} s"
                mend = "wait until it is over, or write elsewhere with --results"
                raise ResultError("results-busy", what, Where(file=str(folder)), mend)
            time.sleep(PAUSE)
        yield
    finally:
        os.close(handle)


def _locks(fcntl: object, handle: int) -> bool:
    """Whether the lock was taken, or the file system has none."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # type: ignore[attr-defined]
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _is_stream(path: Path) -> bool:
    """Whether it is a device or a pipe; /dev/stdout may be a plain file that the shell holds open."""
    with suppress(OSError):
        mode = path.stat().st_mode
        return path.parts[:2] == ("/", "dev") or not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))
    return False


def _refusal(path: Path, error: OSError) -> ResultError:
    shown = path.name if len(path.name) <= 80 else path.name[:77] + "..."
    what = f"cannot write {shown}: {error.strerror or error}"
    mend = _MENDS.get(error.errno or 0, "write elsewhere with -o")
    return ResultError("cannot-write", what, Where(file=str(path)[:300]), mend)
