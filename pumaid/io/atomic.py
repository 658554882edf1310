"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import signal
import stat
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

from pumaid.errors import ResultError, Where
from pumaid.io.alone import PATIENCE, alone

#: What to do about the ways in which a disk refuses; anything else is told in the system's own words.
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


def write_whole(path: Path, data: bytes | str) -> None:
    """Write a file so that readers see the old content or all of the new one, never a part.

    The bytes go to a temporary file in the same folder, are forced to disk, and take the name in one step. Missing
    folders are made. A symbolic link is followed, so the file it points to is replaced and the link stays. A device or
    a pipe (``/dev/stdout``) is written to directly.

    Parameters
    ----------
    path
        The file to write.
    data
        Bytes, or text to be encoded as UTF-8 with its line ends as they are; what is no letter (bytes of a file's name
        that are no UTF-8) becomes a backslash escape.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses; what stood there before stands unchanged.
    """
    content = data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data
    if _is_stream(Path(path)):
        try:
            with os.fdopen(_opened(Path(path)), "wb") as stream:
                stream.write(content)
        except OSError as error:
            raise _refusal(Path(path), error) from error
        return
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its name when the block ends without an error.

    For content that is streamed. An error inside the block leaves nothing behind, neither file nor temporary.

    Parameters
    ----------
    path
        The file to write; missing folders are made.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses, in the block or at its end.
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
        _force_to_disk(temporary)
        _keep_permissions(target, temporary)
        temporary.replace(target)
    except (OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and "loop" not in str(error).lower():
            raise
        raise _refusal(path, error) from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_together(files: Sequence[tuple[Path, bytes]]) -> None:
    """Write files that belong together: all of them, or none.

    Everything is on the disk under hidden names before the first file takes its place; then they do so one right after
    the other in the order given, while Ctrl-C waits and no other run writes to the folder of the last. Only a process
    that is killed in that moment leaves a part.

    Parameters
    ----------
    files
        Paths and contents, the one by which people come to the others last.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses.
    ResultError [results-busy]
        Another run does not let go of the folder.
    """
    plain = [(path, data) for path, data in files if not _is_stream(path)]
    with ExitStack() as stack:
        for path, data in reversed(plain):
            temporary = stack.enter_context(whole_file(path))
            temporary.write_bytes(data)
            _force_to_disk(temporary)
        places = stack.pop_all()
        with places, alone(plain[-1][0].resolve().parent) if plain else nullcontext(), undisturbed():
            places.close()
    for path, data in files:
        if _is_stream(path):
            write_whole(path, data)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let Ctrl-C and a request to end wait until the block is over; it must be short."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {one: signal.signal(one, lambda number, _: came.append(number)) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, signal.SIG_DFL if handler is None else handler)
        for number in came:
            signal.raise_signal(number)


def _is_stream(path: Path) -> bool:
    # /dev/stdout may lead to a plain file that the shell holds open: a new file in its place would not be seen.
    if path.parts[:2] == ("/", "dev"):
        return True
    try:
        mode = path.stat().st_mode
    except (OSError, RuntimeError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _opened(path: Path) -> int:
    """A device or a pipe to write to; a pipe that nobody reads would be waited for without end.

    Raises
    ------
    OSError
        Nobody reads it, or the system refuses.
    """
    waits = os.O_NONBLOCK if stat.S_ISFIFO(path.stat().st_mode) else 0
    how = os.O_WRONLY | (waits or os.O_TRUNC)
    end = time.monotonic() + PATIENCE
    while True:
        try:
            handle = os.open(path, how)
        except OSError as error:
            if not waits or error.errno != errno.ENXIO:
                raise
            if time.monotonic() > end:
                raise OSError(errno.ENXIO, f"it is a pipe that nobody reads (for {PATIENCE:g} s)") from error
            time.sleep(0.02)
        else:
            os.set_blocking(handle, True)
            return handle


def _force_to_disk(path: Path) -> None:
    """Without this a power cut after the renaming could leave an empty file under the final name."""
    handle = os.open(path, os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _keep_permissions(target: Path, temporary: Path) -> None:
    """A replaced file keeps its mode; a new one has what the user's umask gave the temporary."""
    with suppress(FileNotFoundError):
        temporary.chmod(target.stat().st_mode & 0o7777)


def _refusal(path: Path, error: OSError | RuntimeError) -> ResultError:
    number = error.errno if isinstance(error, OSError) else errno.ELOOP
    reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
    mend = _MENDS.get(number or 0, "write elsewhere with -o")
    shown = path.name if len(path.name) <= 80 else path.name[:77] + "..."
    return ResultError("cannot-write", f"cannot write {shown}: {reason}", Where(file=str(path)[:300]), mend)
