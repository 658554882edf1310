"""A virtual robot's logs on disk: a folder of files, and what the robot was."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

from pumaid.dataset import Log
from pumaid.errors import ModelError, ResultError, Where
from pumaid.io.log_formats import endings
from pumaid.io.log_writer import write_log
from pumaid.io.paths import STDIN
from pumaid.io.write import locked, write_file
from pumaid.robot import Robot

TRUTH_NAME = "truth.json"
#: What simulated logs are called; a truth beside them proves that they are.
_OURS = re.compile(r"session_\d+\.(csv|parquet)")


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

    Each file is written atomically; a session that is interrupted leaves the files written so far and the truth.

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
    files = []
    with locked(folder):
        for path in _replaced(folder, force):
            path.unlink()
        write_file(folder / TRUTH_NAME, json.dumps(truth, indent=2) + "\n")
        for origin, batches in groupby(logs, key=lambda log: log.origin):
            seen: list[tuple[int, float, float]] = []
            write_log(folder / f"{origin}.{form}", _watched(batches, seen, progress), robot)
            files.append((f"{origin}.{form}", sum(part[0] for part in seen), seen[0][1], seen[-1][2]))
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
    return path.name.lower().endswith(endings()) and not is_hidden


def _is_truth(path: Path) -> bool:
    try:
        return read_truth(path).get("kind") == "truth"
    except ModelError:
        return False
