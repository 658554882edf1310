"""Lists that a text table holds, in its cells or in numbered columns beside the names of joints, as columns."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pumaid.io.formats import LogColumn, floats
from pumaid.io.formats.nested import leaves
from pumaid.maths import Floats

NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_LIST = re.compile(r"(?:array\(\S+ *)?[\[(](.*)[\])]\)?", re.S)
_NUMBERED = re.compile(r"(.*?)[_.\[/ ]?(\d+)\]?")
_IS_NAME = re.compile(r"(?:.*[^a-z])?names?", re.IGNORECASE)
#: What stands around the elements of a list and their quotes, and between elements.
_AROUND, _BETWEEN = r"^[^\[(]*[\[(]+\s*|\s*,?\s*[\])]+[^\])]*$|['\"]", r"[,;\s]+"


class JointColumns:
    """Columns beside those of a text table's `header`, of which some first `rows` are known.

    A list of numbers in cells has columns ``position[0]``. Where cells or numbered columns called ``name`` hold names
    of joints, lists and numbered columns beside them are told by these, row by row: ``elbow/position``. `texts` are the
    indices of columns to be read as text.
    """

    def __init__(self, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self._header = header
        self._cells = [[row[k] if k < len(row) else "" for row in rows] for k in range(len(header))]
        in_cells = [k for k, column in enumerate(self._cells) if any(map(items, column))]
        numbered: dict[str, dict[int, int]] = {}
        for k, name in enumerate(header):
            if match := _NUMBERED.fullmatch(name):
                numbered.setdefault(match[1], {})[int(match[2])] = k
        lists = {stem: [places[n] for n in sorted(places)] for stem, places in numbered.items() if min(places) < 2}
        lists |= {header[k]: [k] for k in in_cells}
        names = [stem for stem, places in lists.items() if _IS_NAME.fullmatch(stem) and self._is_text(places[0])]
        self._names = names[0] if names else ""
        self._lists = {stem: places for stem, places in lists.items() if places[0] in in_cells or self._is_beside(stem)}
        self.texts = {*in_cells, *self._lists.get(self._names, [])}
        self._stems: dict[str, tuple[str, ...]] = {}

    def _is_beside(self, stem: str) -> bool:
        return bool(self._names) and _split(stem)[0] == _split(self._names)[0]

    def _is_text(self, place: int) -> bool:
        words = [word for cell in self._cells[place][:1] for word in items(cell) or [cell]]
        return bool(words) and all(words) and not any(map(NUMBER.fullmatch, words))

    def schema(self) -> list[LogColumn]:
        """All columns, those of the file first; a second name of a numbered one says whose it is in the first row."""
        import pyarrow as pa

        columns = {
            k: pa.array(self._cells[k] if k in self.texts else [*map(_number, self._cells[k])])
            for places in self._lists.values()
            for k in places
        }
        self._stems = {name: stems for name, stems, _ in self._leaves(columns, self._lists)} if columns else {}
        named = self._lists.get(self._names, [])
        first_names = [name for k in named for name in (items(self._cells[k][0]) or [self._cells[k][0]])]
        first = {
            "/".join(filter(None, (_split(stem)[0], joint, _split(stem)[1]))): (self._header[place], joint)
            for stem, places in self._lists.items()
            for joint, place in zip(first_names, places, strict=False)
            if len(places) > 1 and self._is_beside(stem)
        }
        return [
            *map(LogColumn, self._header),
            *(LogColumn(name, "", *first.get(name, ("", ""))) for name in self._stems),
        ]

    def needed(self, names: Sequence[str]) -> list[int]:
        """Indices of the columns of the file that make the named ones."""
        return list(dict.fromkeys(k for name in names for stem in self._stems[name] for k in self._lists[stem]))

    def values(self, columns: Mapping[int, Any], names: Sequence[str]) -> dict[str, Floats]:
        """(N,) of the named columns, by the columns (``pyarrow.Array``) of the file, by index, that make them."""
        import pyarrow as pa

        stems = dict.fromkeys(stem for name in names for stem in self._stems[name])
        inner = {name: values for name, _, values in self._leaves(columns, stems) if name in names} if stems else {}
        size = len(next(iter(columns.values()))) if columns else 0
        return {
            name: floats(inner[name].cast(pa.float64())) if name in inner else np.full(size, np.nan) for name in names
        }

    def _leaves(self, columns: Mapping[int, Any], stems: Iterable[str]) -> Iterator[tuple[str, tuple[str, ...], Any]]:
        arrays = {stem: self._array(stem, [columns[k] for k in self._lists[stem]]) for stem in stems}
        beside = {stem: "name" if stem == self._names else _split(stem)[1] for stem in arrays if self._is_beside(stem)}
        keys = {key: stem for stem, key in beside.items()}
        for name, used, values in leaves({key: arrays[keys[key]] for key in keys}, _split(self._names)[0]):
            yield name, tuple(keys[key] for key in used), values
        for stem in arrays.keys() - beside:
            yield from ((name, (stem,), values) for name, _, values in leaves({stem: arrays[stem]}))

    def _array(self, stem: str, columns: Sequence[Any]) -> Any:
        import pyarrow as pa
        import pyarrow.compute as pc

        if len(columns) > 1:
            flat = [column.to_pylist() if stem == self._names else floats(column) for column in columns]
            kind = pa.string() if stem == self._names else pa.float64()
            return pa.FixedSizeListArray.from_arrays(pa.array(np.array(flat).T.ravel(), kind), len(columns))
        text = pc.replace_substring_regex(columns[0], _AROUND, "")
        parts = pc.split_pattern_regex(pc.if_else(pc.equal(text, ""), pa.scalar(None, pa.string()), text), _BETWEEN)
        return parts if self._is_text(self._lists[stem][0]) else parts.cast(pa.list_(pa.float64()))


def _number(cell: str) -> float:
    return float(cell.replace(",", ".")) if NUMBER.fullmatch(cell) else np.nan


def _split(stem: str) -> tuple[str, str]:
    path, _, key = stem.replace(".", "/").rpartition("/")
    return path, key


def items(cell: str) -> list[str]:
    """Elements of a list as languages print it, without quotes; none if the cell is no list."""
    match = _LIST.fullmatch(cell.strip())
    return [part.strip("'\" ") for part in re.split(_BETWEEN, match[1].strip(" ,")) if part] if match else []
