"""Columns that hold lists and structs, as columns of numbers: elements by their number, fields and joints by name."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pumaid.errors import LogError, Where
from pumaid.io.formats import LogColumn, floats
from pumaid.maths import Counts, Floats

#: Arrays that have a column a joint, counted from 1, in a log that needs no `log` block.
_CANONICAL = ("q", "qd", "i", "temp")
#: Of longer lists (images) nothing becomes a column.
MOST_ELEMENTS = 64
#: The list by which the other lists beside it are told apart, as in a joint state of ROS.
_NAMES = "name"


def element(name: str, index: int) -> str:
    """The column of an element (from 0) of an array: ``action[0]``, but ``q1`` of the array ``q``."""
    return f"{name}{index + 1}" if name in _CANONICAL else f"{name}[{index}]"


def leaves(columns: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, tuple[str, ...], Any]]:
    """Columns without nesting: the name, the keys in `columns` (N rows each) that hold it, and (N,) values.

    A field is called ``path.key``, an element of a list ``path[0]``; beside a list of texts that is called ``name``,
    element and name belong together whatever their order: ``path/elbow/effort``.
    """
    names = columns.get(_NAMES)
    has_names = names is not None and _is_list(names.type) and str(names.type.value_type) == "string"
    for key, column in columns.items():
        if has_names and _is_list(column.type):
            for joint, places in _places_by_name(names) if key != _NAMES else ():
                yield "/".join(filter(None, (path, joint, key))), (_NAMES, key), _elements(column, places)
        else:
            yield from ((name, (key,), values) for name, values in _inner(".".join(filter(None, (path, key))), column))


def table(columns: Mapping[str, Any], names: Sequence[str], file: str) -> Floats:
    """(C, N) numbers of the named columns (leaves) of some columns with N rows, NaN where there are none.

    Raises
    ------
    LogError [not-a-number]
        A column holds something else.
    """
    inner = {name: values for name, _, values in leaves(columns)}
    values = np.full((len(names), len(next(iter(columns.values())))), np.nan)
    for row, name in zip(values, names, strict=True):
        if name in inner:
            row[:] = _numbers(inner[name], name, file)
    return values


def _numbers(column: Any, name: str, file: str) -> Floats:
    import pyarrow as pa

    if log_column(name, column.type).unit:
        column = column.view(pa.int64())
    try:
        return floats(column if pa.types.is_float64(column.type) else column.cast(pa.float64(), safe=False))
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
        what = f"column {name} holds {column.type}, not numbers: {str(error).splitlines()[0][:100]}"
        raise LogError(
            "not-a-number", what, Where(file=file, column=name), "write it as numbers, a column for each joint"
        ) from error


def log_column(name: str, kind: Any) -> LogColumn:
    """The column of this Arrow type; time stamps and durations have a unit of their own."""
    return LogColumn(name, kind.unit if str(kind).startswith(("timestamp", "duration")) else "")


def _inner(path: str, column: Any) -> Iterator[tuple[str, Any]]:
    if str(column.type).startswith("struct<"):
        fields = dict(zip((field.name for field in column.type), column.flatten(), strict=True))
        yield from ((name, values) for name, _, values in leaves(fields, path))
    elif _is_list(column.type):
        longest = int(_sizes(column).max(initial=0))
        for index in range(longest if longest <= MOST_ELEMENTS else 0):
            yield from _inner(element(path, index), _elements(column, np.full(len(column), index)))
    else:
        yield path, column


def _is_list(kind: Any) -> bool:
    return str(kind).startswith(("list<", "large_list<", "fixed_size_list<"))


def _sizes(column: Any) -> Counts:
    import pyarrow.compute as pc

    return np.array(pc.fill_null(pc.list_value_length(column), 0), dtype=np.int64)


def _elements(column: Any, places: Counts) -> Any:
    import pyarrow as pa
    import pyarrow.compute as pc

    sizes = _sizes(column)
    return pc.list_flatten(column).take(
        pa.array(np.cumsum(sizes) - sizes + places, mask=(places < 0) | (places >= sizes))
    )


def _places_by_name(names: Any) -> Iterator[tuple[str, Counts]]:
    import pyarrow.compute as pc

    sizes = _sizes(names)
    encoded = pc.list_flatten(names).dictionary_encode()
    codes = np.array(pc.fill_null(encoded.indices, -1))
    rows = np.repeat(np.arange(len(names)), sizes)
    indices = np.arange(len(codes)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    for code, name in enumerate(encoded.dictionary.to_pylist()[:MOST_ELEMENTS]):
        places = np.full(len(names), -1)
        places[rows[codes == code]] = indices[codes == code]
        yield name, places
