"""Which log files a user means: files, folders and globs."""

from __future__ import annotations

import difflib
import fnmatch
import glob
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePath

from pumaid.errors import LogError, Where
from pumaid.io.remote import Remote, found_below, is_remote

#: Stands for standard input.
STDIN = Path("-")

#: Endings that are taken from a folder; a file named outright may end in anything, its first bytes tell what it is.
LOG_ENDINGS = (".csv", ".csv.gz", ".parquet")

#: Left out of folders: what pumaid itself writes there.
_OWN_FOLDERS = frozenset({"results"})
_OWN_FILES = frozenset({"plan.csv"})


def natural(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key by which ``run_2`` comes before ``run_10``."""
    parts = re.split(r"(\d+)", text)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part)


def expand(arguments: Iterable[str | Path]) -> list[Path | Remote]:
    """The log files that the arguments of a command name.

    A folder stands for every ``*.csv``, ``*.csv.gz`` and ``*.parquet`` below it in natural order of their names,
    without hidden ones, ``plan.csv`` and folders named ``results``; a glob for what it matches (``**`` crosses
    folders); ``-`` for standard input; a path with a scheme (``s3://bucket/logs``) for what is in that store. A file
    that several arguments name is taken once, where it is named first.

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
    LogError [no-such-log, no-logs, unreadable-log]
        Every argument that leads nowhere is told, with the nearest name.
    """
    found: dict[str, Path | Remote] = {}
    empty = True
    for argument in arguments:
        empty = False
        for path in _of_one(str(argument)):
            found.setdefault(_key(path), path)
    if empty:
        raise LogError("no-logs", "no log was named", mend="name files, folders or globs, or - for standard input")
    return list(found.values())


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


def _key(path: Path | Remote) -> str:
    """The same for all names of one file."""
    if isinstance(path, Remote):
        return path.url
    return "-" if path == STDIN else os.path.realpath(path)


def _of_one(argument: str) -> Iterable[Path | Remote]:
    if is_remote(argument):
        return found_below(argument, is_log=_is_log, order=_order)
    path = Path(argument)
    if path == STDIN:
        return [STDIN]
    try:
        if path.is_dir():
            return _of_folder(path)
        if path.exists():
            return [path]
    except OSError as error:
        raise unreadable(path, error) from error
    if glob.has_magic(argument):
        return _of_glob(argument)
    if path.is_symlink():
        what = f"{argument} is a link that leads to no file ({path.readlink()})"
        raise LogError("no-such-log", what, Where(file=argument), "mend or remove the link")
    raise LogError("no-such-log", f"there is no file or folder {argument}", Where(file=argument), _nearest(path))


def _of_folder(folder: Path) -> list[Path]:
    """Sorted by their parts, so that the files of a sub-folder stay together."""
    found = [path for path in _walk(folder) if _is_log(path.relative_to(folder))]
    if not found:
        others = sorted(path.name for path in _walk(folder))
        shown = f"; it holds {', '.join(others[:3])}{' ...' if len(others) > 3 else ''}" if others else "; it is empty"
        what = f"no log below {folder}{shown}"
        raise LogError("no-logs", what, Where(file=str(folder)), f"logs end in {', '.join(LOG_ENDINGS)}")
    return sorted(found, key=lambda path: _order(path.relative_to(folder)))


def _is_log(path: PurePath) -> bool:
    """Whether a file is taken for a log because of where it lies in a folder that was named."""
    is_hidden = any(part.startswith(".") for part in path.parts)
    is_own = path.name in _OWN_FILES or not _OWN_FOLDERS.isdisjoint(path.parts[:-1])
    return path.name.lower().endswith(LOG_ENDINGS) and not is_hidden and not is_own


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
    parent = path.parent
    if not parent.is_dir():
        missing = path
        while not missing.parent.exists():
            missing = missing.parent
        return f"{missing.parent} has no {missing.name}; {_nearest(missing)}" if missing != path else "check the path"
    try:
        names = [item.name for item in parent.iterdir() if not item.name.startswith(".")]
    except OSError:
        return "check the path"
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=0.5)
    if near:
        return f"did you mean {parent / near[0]}?"
    shown = sorted(names, key=natural)[:5]
    return f"{parent} holds {', '.join(shown)}{' ...' if len(names) > 5 else ''}" if shown else f"{parent} is empty"


def unreadable(path: Path | Remote, error: OSError) -> LogError:
    """A refusal of the system to let a log be read, in the program's form."""
    reason = error.strerror or str(error)
    return LogError(
        "unreadable-log",
        f"{path} cannot be read: {reason}",
        Where(file=str(path)),
        "check its permissions and the disk",
    )
