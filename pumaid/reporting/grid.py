"""A table before it has a form: cells with value, error and mark, and the notes below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

#: What a cell's tone may be: plain, not told from zero, not determined, absent by construction, asking for attention.
TONES = ("", "weak", "unknown", "absent", "alarm")


@dataclass(frozen=True, slots=True)
class Cell:
    """One entry.

    Attributes
    ----------
    text
        The value.
    error
        Its standard error, or empty.
    mark
        Letter of the note that explains it, or empty.
    tone
        One of `TONES`.
    latex
        How LaTeX shall write `text`; escaped text where empty.
    """

    text: str
    error: str = ""
    mark: str = ""
    tone: str = ""
    latex: str = ""

    @property
    def line(self) -> str:
        """All of it on one line."""
        whole = f"{self.text} ± {self.error}" if self.error else self.text
        return f"{whole} {self.mark}" if self.mark else whole

    @property
    def stacked(self) -> str:
        """The error below the value."""
        head = f"{self.text} {self.mark}" if self.mark else self.text
        return f"{head}\n±{self.error}" if self.error else head


@dataclass(frozen=True, slots=True)
class Grid:
    """A table.

    Attributes
    ----------
    title
        What it shows.
    header
        (C,) column heads, units in them.
    rows
        Each (C,) cells.
    notes
        (mark, text) pairs that explain marked cells.
    caption
        One or two sentences on how to read it, or empty.
    lefts
        Columns (from 0) that hold words and so are aligned left; the first where not told.
    """

    title: str
    header: tuple[Cell, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[tuple[str, str], ...] = ()
    caption: str = ""
    lefts: tuple[int, ...] = field(default=(0,))

    def columns(self, chosen: Sequence[int]) -> Grid:
        """The same table with only the columns `chosen` (from 0), in that order."""
        return Grid(
            self.title,
            tuple(self.header[c] for c in chosen),
            tuple(tuple(row[c] for c in chosen) for row in self.rows),
            self.notes,
            self.caption,
            tuple(place for place, c in enumerate(chosen) if c in self.lefts),
        )


def grid(title: str, header: Sequence[str], rows: Sequence[Sequence[str | Cell]], **more: object) -> Grid:
    """A table of plain words.

    Parameters
    ----------
    title, header
        As in `Grid`.
    rows
        Words or cells.
    more
        Further fields of `Grid`.
    """
    cells = tuple(tuple(item if isinstance(item, Cell) else Cell(item) for item in row) for row in rows)
    return Grid(title, tuple(Cell(head) for head in header), cells, **more)  # type: ignore[arg-type]
