"""What the segmentation found and left out, as tables, CSV and JSON."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from pumaid.dataset import Dataset, Reject, Run
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import in_unit
from pumaid.reporting.wording import plural
from pumaid.robot import Robot
from pumaid.units import number

#: Columns of the CSV form; lengths of prismatic joints are in m where rad stands.
CSV_HEADER = (
    "run", "file", "last_file", "first_row", "last_row", "start_s", "duration_s", "joint", "name", "kind", "from_rad",
    "to_rad", "speed_rad_s", "ripple_rad_s", "samples", "temperature_degC", "heldout",
)  # fmt: skip


def run_grid(dataset: Dataset, robot: Robot, *, units: str = "rad") -> Grid:
    """Every run: where, which joint, how.

    Parameters
    ----------
    dataset
        What one pass over the logs left.
    robot
        Its arm.
    units
        ``"rad"`` or ``"deg"``.
    """
    angle = "°" if units == "deg" else "rad"
    lengths = "" if robot.is_revolute.all() else " or m"
    header = ["run", "file", "start s", "lasts s", "joint", "kind", f"others at {angle}{lengths}"]
    header += [
        f"from {angle}{lengths}",
        f"to {angle}{lengths}",
        f"speed {angle}/s{' or m/s' if lengths else ''}",
        "samples",
    ]
    names = shortened([run.origin for run in dataset.runs])
    rows = [
        _run_row(index, run, robot, units=units, name=names[run.origin]) for index, run in enumerate(dataset.runs, 1)
    ]
    told = "posture: the held joints in order, · stands for the moving one; of a stroke the mean speed is told."
    return grid(
        f"{robot.name}: {_counted(dataset.runs)}", header, rows, caption=told if rows else "", lefts=(1, 4, 5, 6)
    )


def joint_grid(dataset: Dataset, robot: Robot, *, units: str = "rad") -> Grid:
    """What the runs of each joint amount to: counts, speeds both ways, postures, time."""
    rows = []
    for joint in robot.joints:
        runs = dataset.of_joint(joint.number)
        times, unit = in_unit(f"{joint.position_unit}/s", units)
        there = [run.speed * times for run in runs if run.speed > 0]
        back = [run.speed * times for run in runs if run.speed < 0]
        kinds = [str(sum(run.kind == kind for run in runs) or "—") for kind in ("constant", "stroke")]
        postures = {tuple(np.round(np.delete(run.posture, joint.number - 1), 1)) for run in runs}
        cells = [f"{joint.number} {joint.name}", *kinds, _range(there), _range(back), unit, str(len(postures) or "—")]
        rows.append([*cells, number(sum(run.duration for run in runs), 4) if runs else "—"])
    header = ("joint", "constant", "strokes", "speeds forward", "speeds backward", "", "postures", "time s")
    return grid("Runs by joint", header, rows, lefts=(0, 3, 4, 5))


def left_grid(dataset: Dataset) -> Grid:
    """What was left out and why, the most first, with the longest stretch of each reason as an example."""
    read = samples_read(dataset)
    rows = []
    for reason, rejects in by_reason(dataset.rejects).items():
        longest = max(rejects, key=lambda reject: reject.samples)
        samples = sum(reject.samples for reject in rejects)
        time = number(sum(reject.duration for reject in rejects), 4)
        where = f"rows {longest.first_row}–{longest.last_row}: {longest.text}"
        rows.append([reason, str(len(rejects)), str(samples), f"{100 * samples / read:.1f} %", time, where])
    kept = sum(run.samples for run in dataset.runs)
    title = f"Left out: {read - kept} of {read} samples ({100 * (read - kept) / max(1, read):.1f} %)"
    return grid(title, ("reason", "stretches", "samples", "share", "time s", "the longest"), rows, lefts=(0, 5))


def reject_grid(dataset: Dataset) -> Grid:
    """Every stretch left out, with its rows."""
    names = shortened([reject.origin for reject in dataset.rejects])
    rows = [
        [names[one.origin], f"{one.first_row}–{_last_row(one)}", f"{one.start:.2f}", one.reason, one.text]
        for one in dataset.rejects
    ]
    return grid("Stretches left out", ("file", "rows", "start s", "reason", "why"), rows, lefts=(0, 1, 3, 4))


def shortened(names: Iterable[str]) -> dict[str, str]:
    """Every file name by itself, or without the folders that all of them share."""
    every = {name: PurePath(name) for name in names}
    shared = 0
    for parts in zip(*(path.parent.parts for path in every.values()), strict=False):
        if len(set(parts)) > 1:
            break
        shared += 1
    return {name: str(PurePath(*path.parts[shared:])) for name, path in every.items()}


def by_reason(rejects: Iterable[Reject]) -> dict[str, list[Reject]]:
    """Rejects by their reason, the reason with most samples first."""
    groups: dict[str, list[Reject]] = {}
    for reject in rejects:
        groups.setdefault(reject.reason, []).append(reject)
    return dict(sorted(groups.items(), key=lambda item: -sum(reject.samples for reject in item[1])))


def samples_read(dataset: Dataset) -> int:
    """Samples of all runs and rejects together, which is all that were read."""
    return sum(run.samples for run in dataset.runs) + sum(reject.samples for reject in dataset.rejects)


def segments_document(dataset: Dataset, robot: Robot) -> dict[str, Any]:
    """Runs, stretches left out and sums for JSON; SI, angles in rad."""
    left = by_reason(dataset.rejects)
    return {
        "samples": samples_read(dataset),
        "kept": sum(run.samples for run in dataset.runs),
        "runs": [_run_entry(index, run, robot) for index, run in enumerate(dataset.runs, 1)],
        "left_out": {reason: sum(reject.samples for reject in rejects) for reason, rejects in left.items()},
        "rejects": [_reject_entry(reject) for reject in dataset.rejects],
        "notes": [note.as_json() for note in dataset.notes],
    }


def runs_csv(dataset: Dataset, robot: Robot) -> str:
    """The runs as CSV in SI, postures as further columns ``q1`` to ``qJ``, empty at the moving joint."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*CSV_HEADER, *(f"q{joint.number}" for joint in robot.joints)])
    for index, run in enumerate(dataset.runs, 1):
        entry = _run_entry(index, run, robot)
        values = [entry[key] for key in ("run", "file", "last_file", "first_row", "last_row", "start", "duration")]
        values += [entry["joint"], entry["name"], entry["kind"], *entry["span"], entry["speed"], entry["ripple"]]
        values += [entry["samples"], entry["temperature"], entry["heldout"], *entry["posture"]]
        writer.writerow(["" if value is None else value for value in values])
    return out.getvalue()


def _run_row(index: int, run: Run, robot: Robot, *, units: str, name: str) -> list[str | Cell]:
    joint = robot.joint(run.joint)
    times, _ = in_unit(joint.position_unit, units)
    speed = in_unit(f"{joint.position_unit}/s", units)[0] * run.speed
    first, last = (number(position * times, 4) for position in run.span)
    held = " ".join(_held(value, robot, place, units) for place, value in enumerate(run.posture))
    kind = Cell(run.kind, mark="held out" if run.heldout else "")
    cells: list[str | Cell] = [
        str(index),
        name,
        f"{run.start:.2f}",
        f"{run.duration:.2f}",
        f"{run.joint} {joint.name}",
        kind,
    ]
    return [*cells, held, first, last, number(speed, 4), str(run.samples)]


def _held(value: float, robot: Robot, place: int, units: str) -> str:
    if not math.isfinite(value):
        return "·"
    shown = value * in_unit(robot.joints[place].position_unit, units)[0]
    text = f"{shown:.0f}" if units == "deg" and robot.joints[place].is_revolute else f"{shown:.2f}"
    return text[1:] if float(text) == 0 and text.startswith("-") else text


def _run_entry(index: int, run: Run, robot: Robot) -> dict[str, Any]:
    return {
        "run": index,
        "joint": run.joint,
        "name": robot.joint(run.joint).name,
        "kind": run.kind,
        "file": run.origin,
        "last_file": run.last_origin or run.origin,
        "first_row": run.first_row,
        "last_row": run.last_row,
        "clock": run.clock,
        "start": run.start,
        "duration": run.duration,
        "posture": [_known(value) for value in run.posture],
        "span": list(run.span),
        "speed": run.speed,
        "ripple": run.ripple,
        "samples": run.samples,
        "temperature": _known(run.temperature),
        "heldout": run.heldout,
    }


def _reject_entry(reject: Reject) -> dict[str, Any]:
    return {
        "reason": reject.reason,
        "text": reject.text,
        "joints": list(reject.joints),
        "file": reject.origin,
        "last_file": reject.last_origin or reject.origin,
        "first_row": reject.first_row,
        "last_row": reject.last_row,
        "start": reject.start,
        "duration": reject.duration,
        "samples": reject.samples,
    }


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _last_row(reject: Reject) -> str:
    return f"{reject.last_row} of {reject.last_origin}" if reject.last_origin else str(reject.last_row)


def _counted(runs: Sequence[Run]) -> str:
    constant = sum(run.kind == "constant" for run in runs)
    strokes = len(runs) - constant
    words = [f"{plural(constant, 'run')} at constant speed"] if constant or not strokes else []
    return " and ".join([*words, *([f"{plural(strokes, 'stroke')} from rest to rest"] if strokes else [])])


def _range(speeds: Sequence[float]) -> str:
    if not speeds:
        return "—"
    low, high = sorted((min(speeds, key=abs), max(speeds, key=abs)), key=abs)
    return number(low, 3) if len(speeds) == 1 else f"{number(low, 3)} to {number(high, 3)}"
