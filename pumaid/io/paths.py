"""Which log files a user means: files, folders, globs, and what lies in a store (``s3://bucket/logs``)."""

import fnmatch
import glob
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path, PurePath
from typing import Any

from pumaid.errors import LogError, Where, meant
from pumaid.io.formats import HEAD_BYTES, endings, log_format, refusing

#: Stands for standard input.
STDIN = Path("-")
#: Between a scheme and a path, and schemes of this machine's own files.
SCHEME, _LOCAL = "://", ("file", "local")
#: Left out of folders: what pumaid itself writes there.
RESULTS_NAME, PLAN_NAME, DATASET = "results", "plan.csv", "dataset.npz"

#: A log on this machine, or its URL in a store that fsspec knows.
LogPath = Path | str


class _Disk:
    """This machine's files by the names that fsspec gives the same questions."""

    isdir, open = staticmethod(os.path.isdir), staticmethod(open)
    glob = staticmethod(partial(glob.glob, recursive=True))  # `**` crosses folders

    @staticmethod
    def isfile(path: str) -> bool:
        """Whether there is anything but a folder, such as a pipe."""
        return os.path.exists(path) and not os.path.isdir(path)  # noqa: PTH110, PTH112 - texts

    @staticmethod
    def find(folder: str) -> Iterator[str]:
        """Files below a folder; links to folders are followed, each folder once, so that circles end."""
        visited: set[str] = set()

        def refuse(error: OSError) -> None:
            raise error

        for root, folders, names in os.walk(folder, onerror=refuse, followlinks=True):
            real = os.path.realpath(root)
            folders[:] = [] if real in visited else [name for name in folders if not name.startswith(".")]
            yield from (os.path.join(root, name) for name in names if real not in visited)  # noqa: PTH118 - a text
            visited.add(real)


def expand(arguments: Iterable[str | Path]) -> list[LogPath]:
    """The log files (at least one) that the arguments of a command name, each once, where it is named first.

    A folder stands for every log below it (by the endings of the formats) in natural order of their names, without
    hidden ones, ``plan.csv``, ``dataset.npz`` and folders named ``results``; a glob for what it matches (``**`` crosses
    folders); ``-`` for standard input; a path with a scheme (``s3://bucket/logs``) for what is in that store.

    Raises
    ------
    LogError [no-such-log, file-not-readable]
        An argument leads nowhere, with the nearest name, or into a store or folder that refuses.
    """
    paths: dict[str, LogPath] = {}
    for argument in map(str, arguments):
        for path in [STDIN] if argument == str(STDIN) else _matching(argument):
            paths.setdefault(str(path) if is_remote(path) or path == STDIN else os.path.realpath(path), path)
    if not paths:
        raise LogError("no-such-log", "no log was named", mend="name files, folders or globs, or - for standard input")
    return list(paths.values())


def is_remote(argument: object) -> bool:
    """Whether an argument is a text with a scheme."""
    return isinstance(argument, str) and SCHEME in argument


def _matching(argument: str) -> list[LogPath]:
    """The file of this name, the logs below a folder, or what a glob matches: files, else the logs in its folders."""
    with refusing(argument):
        store, place = _store(argument)
        names = sorted([place] if store.isfile(place) or store.isdir(place) else store.glob(place), key=_order)
        files = [name for name in names if store.isfile(name)]
        for folder in [] if files else filter(store.isdir, names):
            inside = {os.path.relpath(name, folder): name for name in store.find(folder)}
            files += [inside[path] for path in sorted(filter(is_log, inside), key=_order)]
        if not files:
            what = f"no file, folder or glob leads to a log: {argument}"
            mend = f"logs end in {', '.join(endings())}; check the address"
            if not is_remote(argument):  # the nearest existing name in the nearest existing folder
                path = Path(argument)
                folder = next(parent for parent in (path, *path.parents) if parent.exists())
                nearby = [item.name for item in folder.iterdir() if item.exists() and not item.name.startswith(".")]
                mend += f": in {folder}, {meant((*path.relative_to(folder).parts, '')[0], sorted(nearby))}"
            raise LogError("no-such-log", what, Where(file=argument), mend)
    if not is_remote(argument):
        return [Path(name) for name in files]
    scheme = argument.partition(SCHEME)[0]
    # Only in a machine's own file system does a path begin at its root.
    return [scheme + SCHEME + (name if scheme in _LOCAL else name.lstrip("/")) for name in files]


def is_log(path: str) -> bool:
    """Whether a file is taken for a log because of where it lies in a folder that was named."""
    *folders, name = PurePath(path).parts
    return (
        name.lower().endswith(endings())
        and not any(part.startswith(".") for part in (*folders, name))
        and name not in (PLAN_NAME, DATASET)
        and RESULTS_NAME not in folders
    )


def _order(path: str) -> list[list[tuple[int, int, str]]]:
    parts = [re.findall(r"(\d+)|(\D+)", part) for part in PurePath(path).parts]
    return [[(0, int(digits), "") if digits else (1, 0, text) for digits, text in part] for part in parts]


def chosen_logs(pattern: str, names: Sequence[str]) -> list[str]:
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
        raise LogError(
            "heldout-nothing",
            f"no log that was read is {pattern}",
            Where(file=pattern),
            f"name it among the logs, too, as in LOGS... {pattern} --heldout {pattern}"
            if real.exists()
            else meant(Path(pattern).name, [Path(name).name for name in names]),
        )
    return chosen


@contextmanager
def local_copy(path: LogPath) -> Iterator[Path]:
    """A log as a plain file: itself, or a temporary copy of what is in a store, a pipe or standard input.

    Raises
    ------
    LogError [file-not-readable, not-a-log]
        It cannot be read, or it is of no format that is read.
    """
    name = str(path)
    with refusing(name, (OSError,)):
        if isinstance(path, Path) and path != STDIN and path.is_file():
            yield path
            return
        store, place = _store(path)
        with tempfile.NamedTemporaryFile(prefix="pumaid-") as copy:
            with (
                refusing(name),
                nullcontext(sys.stdin.buffer) if path == STDIN else store.open(place, "rb") as stream,
            ):
                head = stream.read(HEAD_BYTES)
                log_format(head, name)  # what is no log may never end
                copy.write(head)
                shutil.copyfileobj(stream, copy)
                copy.flush()
            yield Path(copy.name)


def _store(path: LogPath) -> tuple[Any, str]:
    """The file system of a path or URL, and the place in it; LogError [file-not-readable] where there is none."""
    if not is_remote(path):
        return _Disk, str(path)
    with refusing(str(path)):
        import fsspec

        if "::" in str(path):
            raise OSError("an address within another one is not read")
        store, place = fsspec.core.url_to_fs(str(path))
        return store, str(place)
