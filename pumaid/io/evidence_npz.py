"""Evidence as one npz file of plain arrays, and back, to the bit; nothing in it is ever executed.

The file holds a digest of its content and name, which shows damage and edits that do not redo it. It is no signature:
who can write the file can redo it, too. So what passes it is looked at all the same.
"""

from __future__ import annotations

import hashlib
import json
import stat
import struct
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import CONSTANT_COLUMNS, STROKE_COLUMNS, Dataset, FileFacts, Reject, Run
from pumaid.errors import Where
from pumaid.io.packing import FIRST, MEANS, OPEN, Arrays, fields_of, packed, unpacked, widths_of

Counts = NDArray[np.int64]

#: The member with the digest of all others; the first is `FIRST`, by which a file is known to be one of these.
_DIGEST = "digest"
#: What stands in JSON for a field of each type; a list for all others.
_JSON: dict[str, set[type]] = {"int": {int}, "float": {float, int}, "str": {str}, "bool": {bool}}
#: Fields of runs and rejects that are finite numbers, and the regressors of each kind of run.
_FINITE = ("start", "duration", "speed", "ripple", "stamp_error")
_KINDS = {("constant", CONSTANT_COLUMNS), ("stroke", STROKE_COLUMNS)}
#: Bytes of an array's header, of the head of a member before its name, and of what is hashed at a time.
_HEADER, _LOCAL, _PIECE = 128, 30, 4 << 20
#: What reading any file at all can end in.
_UNFIT = (ArithmeticError, EOFError, LookupError, MemoryError, OSError, RuntimeError, TypeError, ValueError)


def write_dataset(sink: BinaryIO, dataset: Dataset, name: str) -> None:
    """Write evidence to a binary stream, for a file that shall be called `name`."""
    arrays = packed(dataset)
    np.savez(sink, **arrays, **{_DIGEST: digest_of(arrays, name)})  # type: ignore[arg-type]


def read_dataset(path: Path, n_joints: int) -> Dataset | None:
    """The evidence of an arm of `n_joints` that a file holds, or None where it is not as `write_evidence` left it."""
    try:
        arrays = _stored(path)
        if arrays.pop(_DIGEST).tobytes() != digest_of(arrays, path.name).tobytes():
            return None
        told = json.loads(arrays[FIRST].tobytes())
        _check(told, arrays, n_joints)
        return unpacked(arrays, told)
    except (*_UNFIT, zipfile.BadZipFile, struct.error):
        return None


def is_evidence(path: Path) -> bool:
    """Whether a file begins as one that `write_evidence` wrote; only such are ever removed."""
    head = f"{FIRST}.npy".encode()
    try:
        with path.open("rb") as stream:
            return stream.read(30 + len(head))[30:] == head
    except OSError:
        return False


def _types() -> dict[str, type]:
    """Name -> type of all members."""
    bins = {"cells": np.int64, "joints": np.int64, "extras": np.int64, "means": np.float64}
    each = {f"{name}_{part}": kind for name in ("run", "reject") for part, kind in bins.items()}
    return {FIRST: np.uint8, "posture": np.float64, "factor": np.float64, **each, _DIGEST: np.uint8}


def _stored(path: Path) -> Arrays:
    """All members of a file; ValueError where one is not what numpy writes for an array of its type, to the byte.

    Only plain files are opened: a pipe would be waited for. No text of the file is taken for a type or a length, so
    nothing unfolds to more than it holds.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError("no plain file")
    types = {f"{name}.npy": kind for name, kind in _types().items()}
    with path.open("rb") as stream:
        with zipfile.ZipFile(stream) as archive:
            members = archive.infolist()
        if [one.filename for one in members] != list(types):
            raise ValueError("other members")
        return {one.filename[:-4]: _array(stream, one, types[one.filename]) for one in members}


def _array(stream: BinaryIO, member: zipfile.ZipInfo, kind: type) -> NDArray[Any]:
    stream.seek(member.header_offset)
    stream.seek(sum(struct.unpack("<2H", stream.read(_LOCAL)[-4:])), 1)
    count = (member.file_size - _HEADER) // np.dtype(kind).itemsize
    header = BytesIO()
    facts = {"descr": np.lib.format.dtype_to_descr(np.dtype(kind)), "fortran_order": False, "shape": (count,)}
    np.lib.format.write_array_header_1_0(header, facts)
    if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 1 or stream.read(_HEADER) != header.getvalue():
        raise ValueError("another kind of array")
    out: NDArray[Any] = np.empty(count, dtype=kind)
    if stream.readinto(out.view(np.uint8)) != out.nbytes:  # type: ignore[attr-defined]
        raise ValueError("the file ends before its arrays")
    return out


def digest_of(arrays: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.uint8]:
    """SHA-256 of a file's name and of its arrays, each by the digests of its pieces."""
    whole = hashlib.sha256(name.encode())
    with ThreadPoolExecutor(2) as pool:
        for key, values in arrays.items():
            data = memoryview(values.view(np.uint8))  # type: ignore[arg-type]
            pieces = [data[start : start + _PIECE] for start in range(0, len(data), _PIECE)]
            hashed = pool.map if len(pieces) > 1 else map
            whole.update(f" {key} {values.dtype.str} {len(data)} ".encode())
            whole.update(b"".join(hashed(lambda piece: hashlib.sha256(piece).digest(), pieces)))
    return np.frombuffer(whole.digest(), dtype=np.uint8)


def _check(told: dict[str, Any], arrays: Arrays, n_joints: int) -> None:
    """ValueError, or what Python raises, where entries are none that a pass leaves."""
    columns = [tuple(columns) for columns, _ in told["triangles"]]
    counts = np.array(_typed([count for _, count in told["triangles"]], {int}), dtype=np.int64)
    runs, rejects = told["runs"], told["rejects"]
    for kind, held in ((Run, runs), (Reject, rejects)):
        _check_columns(held, fields_of(kind))
    numbers = np.array(runs.get("joint", []), dtype=np.int64)
    spans = np.array(_typed(list(chain(*runs.get("span", []))), _JSON["float"]), dtype=float)
    posture, moved = arrays["posture"].reshape(len(numbers), n_joints), _typed(list(chain(*rejects.get("joints", []))))
    extras = len(_typed(told["extra"], {str}))
    _need(set(zip(runs.get("kind", []), columns, strict=True)) <= _KINDS)
    _need(set(map(len, runs.get("span", []))) <= {2} and bool(np.isfinite(spans).all()))
    _need(all(1 <= joint <= n_joints for joint in {*numbers.tolist(), *moved}))
    outer = np.arange(1, n_joints + 1) != numbers[:, None]
    _need(bool(np.isfinite(posture[outer]).all() and np.isfinite(arrays["factor"]).all()))
    _need(len(arrays["factor"]) == sum((len(names) + 1) ** 2 for names in columns))
    for name, samples in (("run", counts), ("reject", np.array(rejects.get("samples", []), dtype=np.int64))):
        _check_bins(name, arrays, samples, widths=[*widths_of(name, n_joints), extras if name == "run" else 0])
    _typed([text for note in told["notes"] for text in (note["slug"], note["text"])], {str})
    for record, entries in ((FileFacts, told["files"]), (Where, [note["where"] for note in told["notes"]])):
        _check_columns({name: [one[name] for one in entries] for name in fields_of(record)}, fields_of(record))


def _need(is_so: bool) -> None:
    if not is_so:
        raise ValueError("entries that no pass leaves")


def _typed(values: list[Any], allowed: Iterable[type] = (int,)) -> list[Any]:
    _need(isinstance(values, list) and set(map(type, values)) <= set(allowed))
    return values


def _check_columns(columns: dict[str, list[Any]], kinds: Mapping[str, str]) -> None:
    """Fields of records by the types that these state."""
    _need(not columns or columns.keys() == kinds.keys())
    for name, values in columns.items():
        kind, _, other = kinds[name].partition(" | ")
        _typed(values, _JSON.get(kind, {list}) | ({type(None)} if other else set()))
        if kind == "int" and not other:
            np.array(values, dtype=np.int64)  # raises where one is too large
        if name in _FINITE:
            _need(bool(np.isfinite(np.array(values, dtype=float)).all()))


def _check_bins(name: str, arrays: Arrays, samples: Counts, *, widths: list[int]) -> None:
    """Of as many bins as there is room for, counts add up to `samples`, and only what may be is no number."""
    sizes, means = arrays[f"{name}_cells"], arrays[f"{name}_means"]
    there = sizes[sizes > 0]
    _need(bool(((sizes > 0) | (sizes == -1)).all() and (there <= len(means)).all() and (samples >= 0).all()))
    _need(int(there.sum()) * sum(widths) == len(means) and len(there if name == "run" else sizes) == len(samples))
    _need(arrays[f"{name}_joints"].tolist() == [widths[MEANS[name].index("position")]][: len(there)])
    _need(arrays[f"{name}_extras"].tolist() == [widths[-1]] * len(there))
    counts = means[_places(there, widths, 0)].view(np.int64)
    _need(bool((counts > 0).all() and (counts <= samples.max(initial=0)).all()))
    ends = np.cumsum(there)
    _need(np.diff(np.cumsum(counts)[ends - 1], prepend=0).tolist() == samples[sizes > 0].tolist())
    quantities = enumerate((*MEANS[name], "extra"))
    free = [_places(there, widths, n) for n, quantity in quantities if quantity in OPEN[name]]
    _need(_odd(means) == sum(_odd(means[places]) for places in free))


def _odd(values: NDArray[np.float64]) -> int:
    """How many are no finite numbers."""
    return len(values) - int(np.count_nonzero(np.isfinite(values)))


def _places(there: Counts, widths: Sequence[int], number: int) -> Counts:
    """Where in an array of means those of quantity `number` stand, of records with so many bins `there`."""
    lengths, ends = there * widths[number], np.cumsum(there * sum(widths))
    starts = ends - there * sum(widths[number:])
    return np.repeat(starts - (np.cumsum(lengths) - lengths), lengths) + np.arange(int(lengths.sum()))
