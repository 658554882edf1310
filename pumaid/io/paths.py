"""Which log files a user means: files, folders, globs, and what lies in a store (``s3://bucket/logs``)."""

from __future__ import annotations

import difflib
import fnmatch
import glob
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath, PurePosixPath
from typing import Any, BinaryIO

from pumaid.errors import LogError, Where
from pumaid.io.log_formats import HEAD_BYTES, endings, log_format

#: Stands for standard input.
STDIN = Path("-")
#: Between a scheme and a path, between the parts of a chain of stores, and schemes of this machine's own files.
SCHEME, _CHAIN, _LOCAL = "://", "::", ("file", "local")

#: Left out of folders: what pumaid itself writes there.
_OWN_FOLDERS = frozenset({"results"})
_OWN_FILES = frozenset({"plan.csv"})


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
    """The log files that the arguments of a command name.

    A folder stands for every log below it (by the endings of the formats) in natural order of their names, without
    hidden ones, ``plan.csv`` and folders named ``results``; a glob for what it matches (``**`` crosses folders); ``-``
    for standard input; a path with a scheme (``s3://bucket/logs``) for what is in that store. A file that several
    arguments name is taken once, where it is named first.

    Parameters
    ----------
    arguments
        As the user typed them.

    Returns
    -------
    paths
        At least one.

    Raises
    ------
    LogError [no-such-log, no-logs, no-store, unreadable-log]
        An argument leads nowhere; with the nearest name.
    """
    found: dict[str, LogPath] = {}
    for argument in arguments:
        for path in _of_one(str(argument)):
            found.setdefault(str(path) if isinstance(path, Remote) or path == STDIN else os.path.realpath(path), path)
    if not found:
        raise LogError("no-logs", "no log was named", mend="name files, folders or globs, or - for standard input")
    return list(found.values())


def natural(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key by which ``run_2`` comes before ``run_10``."""
    parts = re.split(r"(\d+)", text)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part)


def is_remote(argument: str) -> bool:
    """Whether an argument has a scheme."""
    return SCHEME in argument


def meant(pattern: str, names: Sequence[str]) -> list[str]:
    """Of log files that were read, those that a user means.

    Parameters
    ----------
    pattern
        A path, a bare file name, a folder, or a glob of paths or of bare names.
    names
        The files, as `expand` named them.

    Returns
    -------
    names
        In their order.

    Raises
    ------
    LogError [heldout-nothing]
        None is meant; with the nearest name.
    """
    real = os.path.realpath(pattern)
    found = [
        name
        for name in names
        if os.path.realpath(name) == real
        or real in map(str, Path(os.path.realpath(name)).parents)
        or fnmatch.fnmatch(name, pattern)
        or fnmatch.fnmatch(Path(name).name, pattern)
    ]
    if not found:
        near = difflib.get_close_matches(Path(pattern).name, [Path(name).name for name in names], n=1)
        shown = ", ".join(names[:5]) + (f" ... ({len(names)} in all)" if len(names) > 5 else "")
        mend = f"did you mean {near[0]}?" if near else f"the logs that were read are {shown}"
        raise LogError("heldout-nothing", f"no log that was read is {pattern}", Where(file=pattern), mend)
    return found


@contextmanager
def local_copy(path: LogPath) -> Iterator[Path]:
    """A log as a plain file: itself, or a temporary copy of what is in a store, a pipe or standard input.

    Raises
    ------
    LogError [unreadable-log, not-a-log]
        It cannot be read, or it is of no known format.
    """
    try:
        if isinstance(path, Path) and path != STDIN and path.is_file():
            yield path
            return
        with _stream(path) as stream, tempfile.NamedTemporaryFile(prefix="pumaid-") as copy:
            head = _first_bytes(stream)
            log_format(head, str(path))  # what is no log may never end
            copy.write(head)
            shutil.copyfileobj(stream, copy)
            copy.flush()
            yield Path(copy.name)
    except OSError as error:
        raise unreadable(path, error) from error


def unreadable(path: LogPath, error: OSError) -> LogError:
    """A refusal of the system to let a log be read, in the program's form."""
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


def _first_bytes(stream: BinaryIO) -> bytes:
    head = b""
    while len(head) < HEAD_BYTES and (more := stream.read(HEAD_BYTES - len(head))):
        head += more
    return head


def _of_one(argument: str) -> Iterable[LogPath]:
    if is_remote(argument):
        return _of_store(argument)
    path = Path(argument)
    if path == STDIN:
        return [STDIN]
    try:
        mode = path.stat().st_mode
        return _of_folder(path) if stat.S_ISDIR(mode) else [path]
    except FileNotFoundError:
        if glob.has_magic(argument):
            return _of_glob(argument)
    except OSError as error:
        raise unreadable(path, error) from error
    if path.is_symlink():
        what = f"{argument} is a link that leads to no file ({path.readlink()})"
        raise LogError("no-such-log", what, Where(file=argument), "mend or remove the link")
    raise LogError("no-such-log", f"there is no file or folder {argument}", Where(file=argument), _nearest(path))


def _of_folder(folder: Path) -> list[Path]:
    """Sorted by their parts, so that the files of a sub-folder stay together."""
    files = {path.relative_to(folder): path for path in _walk(folder)}
    found = [inside for inside in files if _is_log(inside)]
    if not found:
        others = sorted(path.name for path in files)
        shown = f"; it holds {', '.join(others[:3])}{' ...' if len(others) > 3 else ''}" if others else "; it is empty"
        what = f"no log below {folder}{shown}"
        raise LogError("no-logs", what, Where(file=str(folder)), f"logs end in {', '.join(endings())}")
    return [files[inside] for inside in sorted(found, key=_order)]


def _is_log(path: PurePath) -> bool:
    """Whether a file is taken for a log because of where it lies in a folder that was named."""
    is_hidden = any(part.startswith(".") for part in path.parts)
    is_own = path.name in _OWN_FILES or not _OWN_FOLDERS.isdisjoint(path.parts[:-1])
    return path.name.lower().endswith(endings()) and not is_hidden and not is_own


def _order(path: PurePath) -> list[tuple[tuple[int, int, str], ...]]:
    """Files of a folder stay together, and run_2 comes before run_10."""
    return [natural(part) for part in path.parts]


def _walk(folder: Path) -> Iterator[Path]:
    """Visible files below a folder; links to folders are followed, each folder once, so that circles end."""
    seen: set[str] = set()

    def refuse(error: OSError) -> None:
        raise unreadable(Path(error.filename or folder), error) from error

    for root, folders, names in os.walk(folder, onerror=refuse, followlinks=True):
        real = os.path.realpath(root)
        if real in seen:
            folders.clear()
            continue
        seen.add(real)
        folders[:] = [name for name in folders if not name.startswith(".") and name not in _OWN_FOLDERS]
        yield from (Path(root) / name for name in names if not name.startswith(".") and (Path(root) / name).is_file())


def _of_glob(pattern: str) -> list[Path]:
    matches = sorted((Path(match) for match in glob.glob(pattern, recursive=True)), key=lambda path: natural(str(path)))  # noqa: PTH207 - absolute patterns and ** in one call
    files = [path for path in matches if path.is_file()]
    # A glob of folders means what is in them; one that also matches files (**) already has their content.
    if not files:
        files = [path for folder in matches if folder.is_dir() for path in _of_folder(folder)]
    if not files:
        raise LogError("no-such-log", f"nothing matches {pattern}", Where(file=pattern), "try the folder itself")
    return files


def _nearest(path: Path) -> str:
    """The nearest existing name in the nearest existing folder."""
    missing = path
    while not missing.parent.exists():
        missing = missing.parent
    parent = missing.parent
    try:
        names = [item.name for item in parent.iterdir() if not item.name.startswith(".")]
    except OSError:
        return "check the path"
    near = difflib.get_close_matches(missing.name, names, n=1, cutoff=0.5)
    if near:
        return f"did you mean {parent / near[0]}?"
    shown = sorted(names, key=natural)[:5]
    return f"{parent} holds {', '.join(shown)}{' ...' if len(names) > 5 else ''}" if shown else f"{parent} is empty"


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
            names = _names(store, place)
    except OSError as error:
        what, mend = f"{url} cannot be listed: {error}", "check the address and the access rights"
        raise LogError("no-store", what, Where(file=url), mend) from error
    if not names:
        raise LogError("no-such-log", f"no log is at {url}", Where(file=url), "check the path")
    scheme = url.partition(SCHEME)[0]
    # Only in a machine's own file system does a path begin at its root.
    return [Remote(scheme + SCHEME + (name if scheme in _LOCAL else name.lstrip("/"))) for name in names]


def _names(store: Any, place: str) -> list[str]:
    if store.isfile(place):
        return [place]
    folders = [place] if store.isdir(place) or not glob.has_magic(place) else store.glob(place)
    files = [name for name in folders if store.isfile(name) and not PurePosixPath(name).name.startswith(".")]
    if files:
        return sorted(files, key=lambda name: _order(PurePosixPath(name)))
    found = []
    for folder in sorted(folders, key=lambda name: _order(PurePosixPath(name))):
        inside = {PurePosixPath(name).relative_to(PurePosixPath(folder)): name for name in store.find(folder)}
        found += [inside[path] for path in sorted(filter(_is_log, inside), key=_order)]
    return found


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
