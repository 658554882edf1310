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

from pumaid.dataset import Bins, Dataset, FileFacts, Means, Reject, Run
from pumaid.errors import Note, Where
from pumaid.maths.triangle import Triangle

Arrays = dict[str, NDArray[Any]]

#: The array with what is no array, as JSON.
FIRST = "pumaid_evidence"
#: By what runs and rejects hold: quantities of bins but for suspected columns, those with a column for each joint, and
#: those that may be no number.
MEANS = {
    name: tuple(item.name for item in fields(kind) if item.name != "extra")
    for name, kind in (("run", Bins), ("reject", Means))
}
_WIDE = {"run": ("position",), "reject": ("position", "velocity", "current")}
OPEN = {"run": ("temperature", "extra"), "reject": ("current",)}
#: Fields that are stored as arrays; all others of a record stand in the JSON part.
_ARRAYS = ("posture", "triangle", "bins")


def packed(dataset: Dataset) -> Arrays:
    """Evidence as a few long arrays.

    Parameters
    ----------
    dataset
        As a pass leaves it.
    """
    told = {
        "runs": _columns(dataset.runs),
        "triangles": [(run.triangle.columns, run.triangle.count) for run in dataset.runs],
        "rejects": _columns(dataset.rejects),
        "files": [asdict(facts) for facts in dataset.files],
        "notes": [asdict(note) for note in dataset.notes],
        "extra": dataset.extra,
    }
    arrays: Arrays = {FIRST: np.frombuffer(json.dumps(told, default=_plain_number).encode(), dtype=np.uint8)}
    arrays["posture"] = _joined([run.posture for run in dataset.runs])
    arrays["factor"] = _joined([run.triangle.factor.ravel() for run in dataset.runs])
    arrays |= _bins("run", [run.bins for run in dataset.runs])
    arrays |= _bins("reject", [reject.bins for reject in dataset.rejects])
    return arrays


def unpacked(arrays: Arrays, told: dict[str, Any] | None = None) -> Dataset:
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
    each_run = zip(_plain(told["runs"]), told["triangles"], _all_bins("run", arrays), strict=True)
    for plain, (columns, count), bins in each_run:
        size = len(columns) + 1
        triangle = Triangle(tuple(columns), factor.next(size, size), count)
        plain["span"] = tuple(plain["span"])
        if bins is None:
            raise ValueError("a run has no cells")
        runs.append(Run(**plain, posture=posture.next(n_joints), triangle=triangle, bins=Bins(*bins)))
    rejects = []
    for plain, bins in zip(_plain(told["rejects"]), _all_bins("reject", arrays), strict=True):
        plain["joints"] = tuple(plain["joints"])
        rejects.append(Reject(**plain, bins=None if bins is None else Means(*bins)))
    files = tuple(FileFacts(**facts) for facts in told["files"])
    notes = tuple(Note(one["slug"], one["text"], Where(**one["where"])) for one in told["notes"])
    return Dataset(tuple(runs), tuple(rejects), files, notes, tuple(told["extra"]))


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
    """Columns of each quantity of the bins of runs or rejects (`name`), by the arm's joints."""
    return [n_joints if quantity in _WIDE[name] else 1 for quantity in MEANS[name]]


def _bins(name: str, found: Sequence[Bins | Means | None]) -> Arrays:
    """All quantities of one record behind another in one array, and how many bins each has; -1 where it has none."""
    there = [bins for bins in found if bins is not None]
    extras = [bins.extra if isinstance(bins, Bins) else None for bins in there]
    wide = [0 if extra is None else extra.shape[1] for extra in extras]
    return {
        f"{name}_cells": np.array([-1 if c is None else len(c) for c in found], dtype=np.int64),
        f"{name}_joints": np.array([bins.position.shape[1] for bins in there[:1]], dtype=np.int64),
        f"{name}_extras": np.array(wide, dtype=np.int64),
        f"{name}_means": _joined([values for bins in there for values in _means(name, bins)]),
    }


def _means(name: str, bins: Bins | Means) -> Iterator[NDArray[np.float64]]:
    """The arrays of bins, counts by their bits as if they were such numbers, too."""
    for quantity in MEANS[name]:
        values = getattr(bins, quantity)
        yield np.ascontiguousarray(values, dtype=np.int64).view(np.float64) if quantity == "count" else values
    if isinstance(bins, Bins) and bins.extra is not None:
        yield bins.extra


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


def _all_bins(name: str, arrays: Arrays) -> Iterable[list[Any] | None]:
    """The values of each record's bins, in the order of their fields; None where it has no bins."""
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
