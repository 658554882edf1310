"""Which log files a user means: files, folders, globs, and what lies in a store (``s3://bucket/logs``)."""

from __future__ import annotations

import difflib
import fnmatch
import glob
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, BinaryIO

from pumaid.errors import LogError, Where
from pumaid.io.log_formats import HEAD_BYTES, endings, log_format

#: Stands for standard input.
STDIN = Path("-")
#: Between a scheme and a path, between the parts of a chain of stores, and schemes of this machine's own files.
SCHEME, _CHAIN, _LOCAL = "://", "::", ("file", "local")

#: Left out of folders: what pumaid itself writes there.
RESULTS_NAME, PLAN_NAME = "results", "plan.csv"


@dataclass(frozen=True, slots=True)
class Remote:
    """A file in a store that fsspec knows."""

    url: str

    def __str__(self) -> str:
        return self.url

    @property
    def name(self) -> str:
        """The part behind the last slash."""
        return self.url.rpartition("/")[2]


#: A log on this machine, or in a store.
LogPath = Path | Remote


def expand(arguments: Iterable[str | Path]) -> list[LogPath]:
    """The log files (at least one) that the arguments of a command name, each once, where it is named first.

    A folder stands for every log below it (by the endings of the formats) in natural order of their names, without
    hidden ones, ``plan.csv`` and folders named ``results``; a glob for what it matches (``**`` crosses folders); ``-``
    for standard input; a path with a scheme (``s3://bucket/logs``) for what is in that store.

    Raises
    ------
    LogError [no-such-log, no-logs, no-store, unreadable-log]
        An argument leads nowhere; with the nearest name.
    """
    paths: dict[str, LogPath] = {}
    for argument in arguments:
        for path in _of_one(str(argument)):
            paths.setdefault(str(path) if isinstance(path, Remote) or path == STDIN else os.path.realpath(path), path)
    if not paths:
        raise LogError("no-logs", "no log was named", mend="name files, folders or globs, or - for standard input")
    return list(paths.values())


def natural(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key by which ``run_2`` comes before ``run_10``."""
    parts = re.split(r"(\d+)", text)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part)


def is_remote(argument: str) -> bool:
    """Whether an argument has a scheme."""
    return SCHEME in argument


def meant(pattern: str, names: Sequence[str]) -> list[str]:
    """Of log files that were read (`names`, as of `expand`) those that a path, bare name, folder or glob means.

    Raises
    ------
    LogError [heldout-nothing]
        None is meant; with the nearest name.
    """
    real = Path(os.path.realpath(pattern))
    chosen = [
        name
        for name in names
        if Path(os.path.realpath(name)).is_relative_to(real)
        or fnmatch.fnmatch(name, pattern)
        or fnmatch.fnmatch(Path(name).name, pattern)
    ]
    if not chosen:
        near = difflib.get_close_matches(Path(pattern).name, [Path(name).name for name in names], n=1)
        shown = ", ".join(names[:5]) + (f" ... ({len(names)} in all)" if len(names) > 5 else "")
        mend = f"did you mean {near[0]}?" if near else f"the logs that were read are {shown}"
        raise LogError("heldout-nothing", f"no log that was read is {pattern}", Where(file=pattern), mend)
    return chosen


@contextmanager
def local_copy(path: LogPath) -> Iterator[Path]:
    """A log as a plain file: itself, or a temporary copy of what is in a store, a pipe or standard input.

    Raises
    ------
    LogError [unreadable-log, not-a-log]
        It cannot be read, or it is of no format that is read.
    """
    try:
        if isinstance(path, Path) and path != STDIN and path.is_file():
            yield path
            return
        with _stream(path) as stream, tempfile.NamedTemporaryFile(prefix="pumaid-") as copy:
            head = stream.read(HEAD_BYTES)
            log_format(head, str(path))  # what is no log may never end
            copy.write(head)
            shutil.copyfileobj(stream, copy)
            copy.flush()
            yield Path(copy.name)
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: LogPath, error: OSError) -> LogError:
    what = f"{path} cannot be read: {error.strerror or error}"
    return LogError("unreadable-log", what, Where(file=str(path)), "check its permissions and the disk")


@contextmanager
def _stream(path: LogPath) -> Iterator[BinaryIO]:
    if path == STDIN:
        yield sys.stdin.buffer
    elif isinstance(path, Path):
        with path.open("rb") as stream:
            yield stream
    else:
        store, place = _store(path.url)
        with _refusals(), store.open(place, "rb") as stream:
            yield stream


def _of_one(argument: str) -> list[LogPath]:
    if is_remote(argument):
        return _of_store(argument)
    path = Path(argument)
    if path == STDIN:
        return [STDIN]
    try:
        names = _matching(
            argument,
            is_file=lambda name: Path(name).exists() and not Path(name).is_dir(),
            is_folder=os.path.isdir,
            matches=lambda pattern: glob.glob(pattern, recursive=True),  # noqa: PTH207 - absolute patterns and **
            below=_walk,
        )
    except OSError as error:
        raise _unreadable(path, error) from error
    if names:
        return [Path(name) for name in names]
    where = Where(file=argument)
    if path.is_dir():
        what = f"no log below {argument}; it holds {_shown(item.name for item in path.iterdir()) or 'nothing'}"
        raise LogError("no-logs", what, where, f"logs end in {', '.join(endings())}")
    if path.is_symlink():
        what = f"{argument} is a link that leads to no file ({path.readlink()})"
        raise LogError("no-such-log", what, where, "mend or remove the link")
    if glob.has_magic(argument):
        raise LogError("no-such-log", f"nothing matches {argument}", where, "try the folder itself")
    raise LogError("no-such-log", f"there is no file or folder {argument}", where, _nearest(path))


def _matching(
    place: str,
    *,
    is_file: Callable[[str], bool],
    is_folder: Callable[[str], bool],
    matches: Callable[[str], list[str]],
    below: Callable[[str], Iterable[str]],
) -> list[str]:
    """The file at a place, the logs below a folder, or what a glob matches: files, else the logs in its folders."""
    if is_file(place):
        return [place]
    names = sorted([place] if is_folder(place) else matches(place), key=_order)
    files = [name for name in names if is_file(name) and not PurePath(name).name.startswith(".")]
    if files:
        return files
    logs = []
    for folder in filter(is_folder, names):
        inside = {os.path.relpath(name, folder): name for name in below(folder)}
        logs += [inside[path] for path in sorted(filter(is_log, inside), key=_order)]
    return logs


def is_log(path: str) -> bool:
    """Whether a file is taken for a log because of where it lies in a folder that was named."""
    *folders, name = PurePath(path).parts
    is_hidden = any(part.startswith(".") for part in (*folders, name))
    return name.lower().endswith(endings()) and not is_hidden and name != PLAN_NAME and RESULTS_NAME not in folders


def _order(path: str) -> list[tuple[tuple[int, int, str], ...]]:
    """Files of a folder stay together, and run_2 comes before run_10."""
    return [natural(part) for part in PurePath(path).parts]


def _walk(folder: str) -> Iterator[str]:
    """Files below a folder; links to folders are followed, each folder once, so that circles end."""
    visited: set[str] = set()

    def refuse(error: OSError) -> None:
        raise error

    for root, folders, names in os.walk(folder, onerror=refuse, followlinks=True):
        real = os.path.realpath(root)
        folders[:] = [] if real in visited else [name for name in folders if not name.startswith(".")]
        yield from (os.path.join(root, name) for name in names if real not in visited)  # noqa: PTH118 - a text
        visited.add(real)


def _nearest(path: Path) -> str:
    """The nearest existing name in the nearest existing folder."""
    folder = next(parent for parent in path.parents if parent.exists())
    try:
        names = [item.name for item in folder.iterdir()]
    except OSError:
        return "check the path"
    near = difflib.get_close_matches(path.relative_to(folder).parts[0], names, n=1, cutoff=0.5)
    return f"did you mean {folder / near[0]}?" if near else f"{folder} holds {_shown(names) or 'nothing'}"


def _shown(names: Iterable[str]) -> str:
    visible = sorted((name for name in names if not name.startswith(".")), key=natural)
    return ", ".join(visible[:5]) + (" ..." if len(visible) > 5 else "")


def _of_store(url: str) -> list[LogPath]:
    """The logs at a URL: one file, a folder, or a glob.

    Raises
    ------
    LogError [no-such-log, no-store]
        Nothing is there; or the store cannot be reached.
    """
    store, place = _store(url)
    try:
        with _refusals():
            names = _matching(place, is_file=store.isfile, is_folder=store.isdir, matches=store.glob, below=store.find)
    except OSError as error:
        what, mend = f"{url} cannot be listed: {error}", "check the address and the access rights"
        raise LogError("no-store", what, Where(file=url), mend) from error
    if not names:
        raise LogError("no-such-log", f"no log is at {url}", Where(file=url), "check the path")
    scheme = url.partition(SCHEME)[0]
    # Only in a machine's own file system does a path begin at its root.
    return [Remote(scheme + SCHEME + (name if scheme in _LOCAL else name.lstrip("/"))) for name in names]


def _store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    if _CHAIN in url:
        what = f"{url}: an address within another one is not read"
        raise LogError("no-store", what, Where(file=url), "copy the files to a folder first")
    try:
        import fsspec
    except ImportError as error:
        what = f"{url} is in a store, and fsspec is not installed"
        raise LogError("no-store", what, Where(file=url), "pip install 'pumaid[dask]'") from error
    try:
        with _refusals():
            store, place = fsspec.core.url_to_fs(url)
    except OSError as error:
        mend = f"is {url.partition(SCHEME)[0]} the right scheme? Some need a package of their own"
        raise LogError("no-store", f"{url}: {error}", Where(file=url), mend) from error
    return store, str(place)


@contextmanager
def _refusals() -> Iterator[None]:
    """Whatever a store's own library raises, as a refusal of the system."""
    try:
        yield
    except (OSError, MemoryError, LogError):
        raise
    except Exception as error:
        raise OSError(f"{error} ({type(error).__name__})" if str(error) else type(error).__name__) from error
