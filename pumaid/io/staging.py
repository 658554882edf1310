"""Several files that take their places at once: a hidden folder, and a swap that a killed run leaves to the next.

A swap is many renamings. Its list is written before the first, so that a run that is killed between two of them leaves
all that is needed to finish it: nothing is lost, and nobody takes half of two sessions for one.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from pumaid.errors import ResultError, Where
from pumaid.io.atomic import undisturbed, write_whole

#: Hidden folder in which files are written before they take their places, and s after which one was left by a dead run.
_STAGE, _STALE = re.compile(r"\.simulation-[0-9a-f]{12}"), 86_400.0
#: In it, what a swap is about to do, and the folder of what it takes out.
_LIST, OUT = "swap.json", "old"
#: What else a run leaves in it.
_OURS = re.compile(r"(session_\d+\.(csv|parquet)|truth\.json|swap\.json)|\.(session_|truth|swap).*\.[0-9a-f]{12}\.part")


@contextmanager
def stage_in(folder: Path) -> Iterator[Path]:
    """A hidden folder in `folder` that is gone when the block ends, and `folder` with it if nothing else is in it.

    Raises
    ------
    ResultError
        What the block raises, with the place where the file would have come.
    """
    was_there = folder.exists()
    stage = folder / f".simulation-{secrets.token_hex(6)}"
    try:
        yield stage
    except ResultError as error:
        # The hidden folder says nothing to people, and is gone when they look.
        inside, file = str(stage) + os.sep, error.where.file or ""
        if not file.startswith(inside):
            raise
        place = Where(file=str(folder / file.removeprefix(inside)))
        raise ResultError(error.slug, error.what, place, error.mend) from error
    finally:
        for path in (stage, *_left(folder)):
            # One in which a swap is still to be finished holds what is nowhere else.
            if not (path / _LIST).exists():
                shutil.rmtree(path, ignore_errors=True)
        if not was_there:
            with suppress(OSError):
                folder.rmdir()


def swap(stage: Path, folder: Path, old: Sequence[Path], *, first: str) -> None:
    """Old files out of a folder, the staged ones in; Ctrl-C waits for it, and a refusal undoes all of it.

    Parameters
    ----------
    stage
        What `stage_in` gave, with the new files.
    folder
        Where they go.
    old
        Files in `folder` to be taken out.
    first
        Name of the new file that comes first.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses.
    """
    new = sorted((path.name for path in stage.iterdir()), key=lambda name: (name != first, name))
    done: list[tuple[Path, Path]] = []
    with undisturbed():
        try:
            write_whole(stage / _LIST, json.dumps({"out": [path.name for path in old], "in": new}))
            for source, target in _steps(stage, folder, [path.name for path in old], new):
                source.rename(target)
                done.append((source, target))
        except OSError as error:
            for source, target in reversed(done):
                target.rename(source)
            (stage / _LIST).unlink(missing_ok=True)
            what = f"cannot write to {folder}: {error.strerror or error}"
            raise ResultError("cannot-write", what, Where(file=str(folder)), "write elsewhere with -o") from error
        (stage / _LIST).unlink()


def unfinished(folder: Path, names: Iterable[str]) -> Path | None:
    """The hidden folder, among these names in `folder`, of a swap that a run did not finish."""
    return next((folder / name for name in names if _STAGE.fullmatch(name) and (folder / name / _LIST).exists()), None)


def finish(folder: Path) -> None:
    """Finish the swap that a killed run left in a folder, if there is one; no other run may be at work there.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses, or the list of what is to be done cannot be read.
    """
    try:
        while stage := unfinished(folder, [path.name for path in folder.iterdir()]):
            _finish(stage, folder)
    except (OSError, ValueError, LookupError, TypeError) as error:
        why = getattr(error, "strerror", None) or error
        what = f"a simulation into {folder} was killed, and what it began cannot be finished: {why}"
        mend = "its files, old and new, are there in a folder .simulation-*; write elsewhere with -o"
        raise ResultError("cannot-write", what, Where(file=str(folder)), mend) from error


def _finish(stage: Path, folder: Path) -> None:
    told = json.loads((stage / _LIST).read_text(encoding="utf-8"))
    out, new = ([Path(str(name)).name for name in told[key]] for key in ("out", "in"))
    for source, target in _steps(stage, folder, out, new):
        # What was taken out may have a namesake by now that came in.
        if not source.exists() or (target.exists() and target.parent != folder):
            continue
        if target.exists():
            raise FileExistsError(errno.EEXIST, f"{target.name} is in the way")
        source.rename(target)
    (stage / _LIST).unlink()
    shutil.rmtree(stage, ignore_errors=True)


def _steps(stage: Path, folder: Path, out: Sequence[str], new: Sequence[str]) -> list[tuple[Path, Path]]:
    """Renamings of a swap, in their order; makes the folder for what is taken out."""
    away = stage / OUT
    away.mkdir(exist_ok=True)
    return [(folder / name, away / name) for name in out] + [(stage / name, folder / name) for name in new]


def _left(folder: Path) -> list[Path]:
    """Hidden folders of runs that were killed, long ago: younger ones may be of runs that are still at work."""
    found = []
    with suppress(OSError):
        for path in folder.iterdir():
            if not _STAGE.fullmatch(path.name) or time.time() - path.lstat().st_mtime < _STALE or path.is_symlink():
                continue
            names = [name for _, folders, names in os.walk(path) for name in [*folders, *names]]
            if all(name == OUT or _OURS.fullmatch(name) for name in names):
                found.append(path)
    return found
