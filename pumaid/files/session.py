"""A virtual robot's logs on disk: a folder of files, and what the robot was."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from pumaid.errors import ModelError, ResultError, Where
from pumaid.files.atomic import write_whole
from pumaid.files.paths import STDIN
from pumaid.files.table import write_log
from pumaid.records import Log, Robot

TRUTH_NAME = "truth.json"
_PATTERN = "session_*"


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
        Whether logs of an earlier simulation in the folder (``session_*``) may be removed.
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
    """
    if folder == STDIN:
        write_log(folder, _watched(logs, [], progress), robot)
        return []
    _make_room(folder, force)
    files = []
    for origin, batches in groupby(logs, key=lambda log: log.origin):
        seen: list[tuple[int, float, float]] = []
        write_log(folder / f"{origin}.{form}", _watched(batches, seen, progress), robot)
        files.append((f"{origin}.{form}", sum(part[0] for part in seen), seen[0][1], seen[-1][2]))
    write_whole(folder / TRUTH_NAME, json.dumps(truth, indent=2) + "\n")
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


def _make_room(folder: Path, force: bool) -> None:
    if not folder.is_dir():
        return
    there = sorted(path for path in folder.rglob("*") if path.suffix.lower() in (".csv", ".parquet"))
    ours = set(folder.glob(_PATTERN))
    foreign = [path for path in there if path not in ours]
    if foreign or (there and not force):
        first = (foreign or there)[0]
        what = f"{folder} holds logs already ({len(there)}, such as {first.name})"
        mend = "write to another folder with -o" + ("" if foreign else ", or replace them with --force")
        raise ResultError("logs-in-the-way", what, Where(file=str(first)), mend)
    for path in there:
        path.unlink()
