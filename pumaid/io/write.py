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

_MENDS = {
    errno.ENOSPC: "free some space on that disk, or write elsewhere with -o",
    errno.EDQUOT: "your disk quota is used up: free some space, or write elsewhere with -o",
    errno.EROFS: "that disk is read-only: write elsewhere with -o",
    errno.EACCES: "you may not write there: change the folder's permissions, or write elsewhere with -o",
    errno.EPERM: "you may not write there: change the folder's permissions, or write elsewhere with -o",
    errno.EISDIR: "a folder of that name is in the way: give a file name with -o",
    errno.ENOTDIR: "a file stands where a folder is needed: write elsewhere with -o",
    errno.EEXIST: "a file stands where a folder is needed: write elsewhere with -o",
    errno.ENAMETOOLONG: "give a shorter name with -o",
}


def write_file(path: Path, data: bytes | str) -> None:
    """Write a file atomically; missing folders are made.

    A device or a pipe (``/dev/stdout``) is written to directly.

    Parameters
    ----------
    path
        The file to write.
    data
        Bytes, or text to be encoded as UTF-8; surrogates (bytes of a file name that are not UTF-8) become backslash
        escapes.

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

    An error in the block leaves nothing behind. A symbolic link stays; the file that it points to is replaced.

    Parameters
    ----------
    path
        The file to write; missing folders are made.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses, in the block or at its end.
    """
    path = Path(path)
    temporary: Path | None = None
    try:
        target = path.resolve()
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        temporary = target.with_name(f".{target.name[:80]}.{secrets.token_hex(6)}.part")
        yield temporary
        with temporary.open("rb+") as file:  # without this a power cut could leave an empty file under the new name
            os.fsync(file.fileno())
        with suppress(FileNotFoundError):
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
    except OSError as error:
        raise _refusal(path, error) from error
    except RuntimeError as error:  # Python before 3.13 raises it for a loop of symbolic links
        if "loop" not in str(error).lower():
            raise
        raise _refusal(path, OSError(errno.ELOOP, str(error))) from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextmanager
def locked(folder: Path, *, patience: float = PATIENCE) -> Iterator[None]:
    """Keep other processes of this program out of a folder during the block.

    The folder itself is locked (flock), so no lock file remains, and the system releases the lock when a process ends.
    Where the system has no such locks, or the folder cannot be made, the block runs without one.

    Parameters
    ----------
    folder
        Made if it is missing.
    patience
        Longest wait for another process, s.

    Raises
    ------
    ResultError [results-busy]
        Another process holds the lock for longer.
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
    if path.parts[:2] == ("/", "dev"):  # /dev/stdout may be a plain file that the shell holds open
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, RuntimeError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _refusal(path: Path, error: OSError) -> ResultError:
    shown = path.name if len(path.name) <= 80 else path.name[:77] + "..."
    what = f"cannot write {shown}: {error.strerror or error}"
    mend = _MENDS.get(error.errno or 0, "write elsewhere with -o")
    return ResultError("cannot-write", what, Where(file=str(path)[:300]), mend)
