"""Text tables with a row for each joint, as columns of each joint: a row's time, and what the rows after it tell."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pumaid.io.formats import LogColumn, floats
from pumaid.io.formats.joint_columns import JointColumns
from pumaid.maths import Floats

#: Last words of the names of a column that says which joint a row is of.
_JOINT = {"joint", "name", "id", "motor", "servo", "axis", "actuator", "gelenk", "achse", "articulation"}


class TidyColumns(JointColumns):
    """Columns ``elbow/position`` of a table whose rows are of one joint after the other, as its column `place` says.

    They have values in the rows of the first joint, each joint's from its next row, and none in the other rows.
    """

    def __init__(self, header: Sequence[str], rows: Sequence[Sequence[str]], place: int) -> None:
        super().__init__(header, rows)
        self._place, self.texts = place, {place}
        self._names_in_turn = [*dict.fromkeys(self._cells[place])]
        rest = [(k, name) for k, name in enumerate(header) if k != place]
        self._wanted = {f"{joint}/{name}": (joint, k) for joint in self._names_in_turn for k, name in rest}

    @classmethod
    def place_of(cls, header: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
        """The index of the column that names two joints or more in turn, -1 if there is none."""
        for k, name in enumerate(header):
            cells = [row[k] for row in rows if k < len(row)]
            joints = [*dict.fromkeys(cells)]
            is_in_turn = 1 < len(joints) <= len(cells) // 2 and cells == (joints * len(cells))[: len(cells)]
            if is_in_turn and all(joints) and re.split(r"[^a-z]+", name.lower().strip())[-1] in _JOINT:
                return k
        return -1

    def schema(self) -> list[LogColumn]:
        """All columns, those of the file first."""
        return [*map(LogColumn, self._header), *map(LogColumn, self._wanted)]

    def needed(self, names: Sequence[str]) -> list[int]:
        """As `JointColumns`."""
        return list(dict.fromkeys(k for name in names for k in (self._place, self._wanted[name][1])))

    def values(self, columns: Mapping[int, Any], names: Sequence[str]) -> dict[str, Floats]:
        """As `JointColumns`; what a block of rows cuts off is lost."""
        joints = np.array(columns[self._place].to_pylist()) if names else np.zeros(0)
        first = np.flatnonzero(joints == self._names_in_turn[0])
        ends = np.append(first[1:], len(joints))
        out = {name: np.full(len(joints), np.nan) for name in names}
        for name in names if len(first) else ():
            joint, k = self._wanted[name]
            rows = np.append(np.flatnonzero(joints == joint), len(joints))
            after = rows[np.searchsorted(rows, first)]
            out[name][first[after < ends]] = floats(columns[k])[after[after < ends]]
        return out
