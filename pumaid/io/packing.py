"""Evidence as a few long arrays, and back, to the bit; one by one its records would be ten small ones each."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, Where
from pumaid.maths.triangle import Triangle
from pumaid.records import Cells, Evidence, FileFacts, Means, Reject, Run

Arrays = dict[str, NDArray[Any]]

#: The array with what is no array, as JSON.
FIRST = "pumaid_evidence"
#: By what runs and rejects hold: quantities of cells but for suspected columns, those with a column for each joint, and
#: those that may be no number.
MEANS = {
    name: tuple(item.name for item in fields(kind) if item.name != "extra")
    for name, kind in (("run", Cells), ("reject", Means))
}
_WIDE = {"run": ("position",), "reject": ("position", "velocity", "current")}
OPEN = {"run": ("temperature", "extra"), "reject": ("current",)}
#: Fields that are stored as arrays; all others of a record stand in the JSON part.
_ARRAYS = ("posture", "triangle", "cells")


def packed(evidence: Evidence) -> Arrays:
    """Evidence as a few long arrays.

    Parameters
    ----------
    evidence
        As a pass leaves it.
    """
    told = {
        "runs": _columns(evidence.runs),
        "triangles": [(run.triangle.columns, run.triangle.count) for run in evidence.runs],
        "rejects": _columns(evidence.rejects),
        "files": [asdict(facts) for facts in evidence.files],
        "notes": [asdict(note) for note in evidence.notes],
        "extra": evidence.extra,
    }
    arrays: Arrays = {FIRST: np.frombuffer(json.dumps(told, default=_plain_number).encode(), dtype=np.uint8)}
    arrays["posture"] = _joined([run.posture for run in evidence.runs])
    arrays["factor"] = _joined([run.triangle.factor.ravel() for run in evidence.runs])
    arrays |= _cells("run", [run.cells for run in evidence.runs])
    arrays |= _cells("reject", [reject.cells for reject in evidence.rejects])
    return arrays


def unpacked(arrays: Arrays, told: dict[str, Any] | None = None) -> Evidence:
    """The evidence that was packed into some arrays, of which all its records' are views.

    Parameters
    ----------
    arrays
        As `packed` leaves them.
    told
        What the first of them says, where it was read already.

    Raises
    ------
    ValueError, TypeError, LookupError
        They are other arrays.
    """
    told = json.loads(arrays[FIRST].tobytes()) if told is None else told
    posture, factor = (_Taken(arrays[name]) for name in ("posture", "factor"))
    n_joints = len(arrays["posture"]) // max(1, len(told["triangles"]))
    runs = []
    each_run = zip(_plain(told["runs"]), told["triangles"], _all_cells("run", arrays), strict=True)
    for plain, (columns, count), cells in each_run:
        size = len(columns) + 1
        triangle = Triangle(tuple(columns), factor.next(size, size), count)
        plain["span"] = tuple(plain["span"])
        if cells is None:
            raise ValueError("a run has no cells")
        runs.append(Run(**plain, posture=posture.next(n_joints), triangle=triangle, cells=Cells(*cells)))
    rejects = []
    for plain, cells in zip(_plain(told["rejects"]), _all_cells("reject", arrays), strict=True):
        plain["joints"] = tuple(plain["joints"])
        rejects.append(Reject(**plain, cells=None if cells is None else Means(*cells)))
    files = tuple(FileFacts(**facts) for facts in told["files"])
    notes = tuple(Note(one["slug"], one["text"], Where(**one["where"])) for one in told["notes"])
    return Evidence(tuple(runs), tuple(rejects), files, notes, tuple(told["extra"]))


def fields_of(kind: type) -> dict[str, str]:
    """The plain fields of a record and their types."""
    return {item.name: str(item.type) for item in fields(kind) if item.name not in _ARRAYS}


def _columns(records: Sequence[Run | Reject]) -> dict[str, list[Any]]:
    """Each plain field of all records; by records it would take eight times as long to read."""
    names = fields_of(type(records[0])) if records else []
    return {name: [getattr(record, name) for record in records] for name in names}


def _plain(columns: dict[str, list[Any]]) -> Iterator[dict[str, Any]]:
    """The plain fields of each record."""
    for values in zip(*columns.values(), strict=True):
        yield dict(zip(columns, values, strict=True))


def _plain_number(value: object) -> object:
    """One of numpy's numbers as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is nothing that evidence holds")


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate([part.ravel() for part in parts]) if parts else np.zeros(0)


def widths_of(name: str, n_joints: int) -> list[int]:
    """Columns of each quantity of the cells of runs or rejects (`name`), by the arm's joints."""
    return [n_joints if quantity in _WIDE[name] else 1 for quantity in MEANS[name]]


def _cells(name: str, found: Sequence[Cells | Means | None]) -> Arrays:
    """All quantities of one record behind another in one array, and how many cells each has; -1 where it has none."""
    there = [cells for cells in found if cells is not None]
    extras = [cells.extra if isinstance(cells, Cells) else None for cells in there]
    wide = [0 if extra is None else extra.shape[1] for extra in extras]
    return {
        f"{name}_cells": np.array([-1 if c is None else len(c) for c in found], dtype=np.int64),
        f"{name}_joints": np.array([cells.position.shape[1] for cells in there[:1]], dtype=np.int64),
        f"{name}_extras": np.array(wide, dtype=np.int64),
        f"{name}_means": _joined([values for cells in there for values in _means(name, cells)]),
    }


def _means(name: str, cells: Cells | Means) -> Iterator[NDArray[np.float64]]:
    """The arrays of cells, counts by their bits as if they were such numbers, too."""
    for quantity in MEANS[name]:
        values = getattr(cells, quantity)
        yield np.ascontiguousarray(values, dtype=np.int64).view(np.float64) if quantity == "count" else values
    if isinstance(cells, Cells) and cells.extra is not None:
        yield cells.extra


class _Taken:
    """An array that is handed out from its front."""

    def __init__(self, values: NDArray[Any]) -> None:
        self.values, self.at = values, 0

    def next(self, *shape: int) -> NDArray[Any]:
        size = math.prod(shape)
        part = self.values[self.at : self.at + size]
        if len(part) < size:
            raise ValueError("an array ends before its records")
        self.at += size
        return part.reshape(shape)


def _all_cells(name: str, arrays: Arrays) -> Iterable[list[Any] | None]:
    """The values of each record's cells, in the order of their fields; None where it has no cells."""
    taken, extras = _Taken(arrays[f"{name}_means"]), iter(arrays[f"{name}_extras"].tolist())
    joints = next(iter(arrays[f"{name}_joints"].tolist()), 0)
    widths = widths_of(name, joints)
    ends = list(accumulate(widths))
    kinds = [quantity in _WIDE[name] for quantity in MEANS[name]]
    places = [(is_wide, end - width, end) for is_wide, width, end in zip(kinds, widths, ends, strict=True)]
    for count in arrays[f"{name}_cells"].tolist():
        if count < 0:
            yield None
            continue
        extra = next(extras)
        own = taken.next(count * (ends[-1] + extra))
        parts = [(is_wide, own[count * start : count * stop]) for is_wide, start, stop in places]
        counts, *means = [part.reshape(count, joints) if is_wide else part for is_wide, part in parts]
        more = [own[count * ends[-1] :].reshape(count, extra)] if extra else []
        yield [counts.view(np.int64), *means, *more]
