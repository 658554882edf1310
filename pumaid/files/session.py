"""A virtual robot's logs on disk: a folder of files, and what the robot was."""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import groupby
from pathlib import Path
from typing import Any

from pumaid.errors import ModelError, ResultError, Where
from pumaid.files.alone import alone
from pumaid.files.atomic import write_whole
from pumaid.files.paths import LOG_ENDINGS, STDIN
from pumaid.files.table import write_log
from pumaid.records import Log, Robot

TRUTH_NAME = "truth.json"
#: What simulated logs are called; a truth beside them proves that they are.
_OURS = re.compile(r"session_\d+\.(csv|parquet)")
#: Hidden folder in which a session is written before it takes its place, and s after which one was left by a dead run.
_STAGE, _STALE = ".simulation-", 86_400.0


def write_session(
    folder: Path,
    logs: Iterable[Log],
    robot: Robot,
    *,
    truth: Mapping[str, Any],
    form: str = "parquet",
    force: bool = False,
    progress: Callable[[float], None] = lambda seconds: None,
) -> list[tuple[str, int, float, float]]:
    """Write a session's logs, a file for each `origin`, and the truth beside them.

    All is written to a hidden folder first and then takes its place at once, so that what was there stands whole until
    the new session is, and a folder never holds parts of two.

    Parameters
    ----------
    folder
        Where they go; ``-`` writes all of them as one CSV to standard output, without the truth.
    logs
        In order of time.
    robot
        Names the columns.
    truth
        The document that is written to ``truth.json``.
    form
        ``"parquet"`` or ``"csv"``.
    force
        Whether logs of an earlier simulation in the folder (``session_*`` beside a ``truth.json``) may be replaced.
    progress
        Told the time (s) of the session up to which is written.

    Returns
    -------
    files
        Name, samples, first and last time (s) of each.

    Raises
    ------
    ResultError [logs-in-the-way]
        The folder holds logs already: measured ones and simulated ones must not mix.
    ResultError [cannot-write]
        The disk refuses.
    ResultError [results-busy]
        Another run does not let go of the folder.
    """
    if folder == STDIN:
        write_log(folder, _watched(logs, [], progress), robot)
        return []
    _replaced(folder, force)  # what is refused is refused before the work
    files = []
    with _stage(folder) as stage:
        for origin, batches in groupby(logs, key=lambda log: log.origin):
            seen: list[tuple[int, float, float]] = []
            write_log(stage / f"{origin}.{form}", _watched(batches, seen, progress), robot)
            files.append((f"{origin}.{form}", sum(part[0] for part in seen), seen[0][1], seen[-1][2]))
        write_whole(stage / TRUTH_NAME, json.dumps(truth, indent=2) + "\n")
        with alone(folder), _undisturbed():
            # Looked at again: another run may have written there meanwhile.
            _swap(stage, folder, _replaced(folder, force))
    return files


def read_truth(path: Path) -> dict[str, Any]:
    """The document of a ``truth.json``.

    Raises
    ------
    ModelError [file-not-readable]
        There is no such file, or it is no JSON object.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no JSON"
        mend = "check the path"
        raise ModelError("file-not-readable", f"{path} cannot be read: {reason}", Where(str(path)), mend) from error
    if not isinstance(found, dict):
        raise ModelError("file-not-readable", f"{path} holds no JSON object", Where(str(path)), "give a truth.json")
    return found


def _watched(
    logs: Iterable[Log], seen: list[tuple[int, float, float]], progress: Callable[[float], None]
) -> Iterator[Log]:
    for log in logs:
        seen.append((len(log), float(log.time[0]), float(log.time[-1])))
        progress(float(log.time[-1]))
        yield log


def _replaced(folder: Path, force: bool) -> list[Path]:
    """Files of an earlier simulation whose place a new one takes, the truth last.

    Raises
    ------
    ResultError [logs-in-the-way]
        There are others, or these may not be replaced.
    """
    if not folder.is_dir():
        return []
    truth = folder / TRUTH_NAME
    is_proved = _is_truth(truth)
    there = sorted(path for path in folder.rglob("*") if _is_log(path.relative_to(folder)))
    ours = [path for path in there if is_proved and path.parent == folder and _OURS.fullmatch(path.name)]
    foreign = [path for path in there if path not in ours or not path.is_file()]
    if not is_proved and os.path.lexists(truth):
        foreign.append(truth)
    if foreign or (there and not force):
        first = (foreign or there)[0]
        why = "; no truth.json beside it says that it was simulated" if foreign else ""
        what = f"{folder} holds logs already ({max(len(there), 1)}, such as {first.name}){why}"
        mend = "write to another folder with -o" + ("" if foreign else ", or replace them with --force")
        raise ResultError("logs-in-the-way", what, Where(file=str(first)), mend)
    return [*ours, *([truth] if is_proved else [])]


def _is_log(path: Path) -> bool:
    is_hidden = any(part.startswith(".") for part in path.parts)
    return path.name.lower().endswith(LOG_ENDINGS) and not is_hidden


def _is_truth(path: Path) -> bool:
    try:
        return read_truth(path).get("kind") == "truth"
    except ModelError:
        return False


@contextmanager
def _stage(folder: Path) -> Iterator[Path]:
    """A hidden folder in `folder` that is gone when the block ends, and `folder` with it if nothing else is in it."""
    was_there = folder.exists()
    stage = folder / f"{_STAGE}{secrets.token_hex(6)}"
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
            shutil.rmtree(path, ignore_errors=True)
        if not was_there:
            with suppress(OSError):
                folder.rmdir()


def _left(folder: Path) -> list[Path]:
    """Hidden folders of runs that were killed, long ago: younger ones may be of runs that are still at work."""
    found = []
    with suppress(OSError):
        for path in folder.glob(f"{_STAGE}*"):
            if time.time() - path.stat().st_mtime > _STALE:
                found.append(path)
    return found


@contextmanager
def _undisturbed() -> Iterator[None]:
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


def _swap(stage: Path, folder: Path, old: Sequence[Path]) -> None:
    """Old files out, new ones in, their truth first so that they are known as simulated; a refusal undoes all of it."""
    new = sorted(stage.iterdir(), key=lambda path: (path.name != TRUTH_NAME, path.name))
    away = stage / "old"
    done: list[tuple[Path, Path]] = []
    try:
        away.mkdir()
        for source, target in [(one, away / one.name) for one in old] + [(one, folder / one.name) for one in new]:
            source.rename(target)
            done.append((source, target))
    except OSError as error:
        for source, target in reversed(done):
            target.rename(source)
        what = f"cannot write to {folder}: {error.strerror or error}"
        raise ResultError("cannot-write", what, Where(file=str(folder)), "write elsewhere with -o") from error
