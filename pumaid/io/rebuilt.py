"""Records from parsed JSON, by the types that their fields state."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, TypeVar, Union

import numpy as np

Record = TypeVar("Record")


class Unfit(ValueError):
    """A value that is not what a field states; `path` leads to it, ``joints[0].rmse``."""

    def __init__(self, path: str, what: str) -> None:
        super().__init__(f"{path}: {what}")
        self.path, self.what = path, what


def rebuilt(kind: type[Record], entries: Any, path: str = "") -> Record:
    """A record of dataclass `kind` from a JSON object; entries that it does not know are passed over.

    Parameters
    ----------
    kind
        Fields may be numbers, text, records, tuples and mappings of these, and arrays (null is NaN there).
    entries
        As parsed.
    path
        Where it stands in the document.

    Raises
    ------
    Unfit
        An entry is missing or of another type.
    """
    if not isinstance(entries, Mapping):
        raise Unfit(path, f"a {type(entries).__name__} stands where an object is needed")
    known = _types(typing.cast("Any", kind))
    values = {}
    for item in fields(kind):  # type: ignore[arg-type]
        at = f"{path}.{item.name}".lstrip(".")
        if item.name in entries:
            values[item.name] = _as(known[item.name], entries[item.name], at)
        elif item.default is MISSING and item.default_factory is MISSING:
            raise Unfit(at, "an entry is missing")
    return kind(**values)


@cache
def _types(kind: Any) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _as(kind: Any, value: Any, path: str) -> Any:
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin in (Union, types.UnionType):
        return None if value is None else _as(next(one for one in inside if one is not type(None)), value, path)
    if is_dataclass(kind):
        return rebuilt(typing.cast("type[Any]", kind), value, path)
    if origin is np.ndarray:
        return _array(value, path)
    if origin is tuple:
        items = _listed(value, path)
        of = [inside[0]] * len(items) if inside[-1] is Ellipsis else list(inside)
        if len(of) != len(items):
            raise Unfit(path, f"{len(items)} entries stand where {len(of)} are needed")
        return tuple(_as(one, item, f"{path}[{n}]") for n, (one, item) in enumerate(zip(of, items, strict=True)))
    if origin is not None:
        if not isinstance(value, Mapping):
            raise Unfit(path, f"a {type(value).__name__} stands where an object is needed")
        return {str(key): _as(inside[1], item, f"{path}.{key}") for key, item in value.items()}
    return _plain(kind, value, path)


def _plain(kind: Any, value: Any, path: str) -> Any:
    """A number or a text; a whole number may stand for any number, null for one that JSON lacks, true for none."""
    if value is None and kind is float:
        return math.nan
    allowed = (int, float) if kind is float else (kind,)
    if not isinstance(value, allowed) or (isinstance(value, bool) and kind is not bool):
        raise Unfit(path, f"{str(value)[:40]!r} is no {kind.__name__}")
    return float(value) if kind is float else value


def _listed(value: Any, path: str) -> Sequence[Any]:
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise Unfit(path, f"a {type(value).__name__} stands where a list is needed")
    return value


def _array(value: Any, path: str) -> Any:
    found = np.array([_plain(float, item, path) for item in _listed(value, path)], dtype=float)
    found.setflags(write=False)
    return found
