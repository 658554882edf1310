"""The forms that a table can take: terminal, Markdown, LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from pumaid.reporting.grid import Cell, Grid
from pumaid.reporting.visible import visible

#: Notes are set no wider than this (characters): longer lines are hard to read.
READABLE = 100

_STYLES = {"": "", "weak": "dim", "unknown": "yellow", "absent": "dim", "alarm": "red"}


class Shown:
    """A table for the terminal, as wide as it may be: errors beside values, else below them, else split by columns."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        natural = Measurement.get(console, options, _table(self.grid, stacked=False)).maximum
        told = max((len(text) + 4 for _, text in self._told()), default=0)
        return Measurement(20, min(max(natural, min(told, READABLE)), options.max_width))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        if self.grid.title:
            yield Text(self.grid.title, style="bold")
        wide = options.update(max_width=10_000)
        flat = _table(self.grid, stacked=False)
        if Measurement.get(console, wide, flat).maximum <= options.max_width:
            yield flat
        else:
            yield from self._split(console, options)
        for mark, text in self._told():
            yield _note(mark, text, min(options.max_width, READABLE))

    def _told(self) -> list[tuple[str, str]]:
        return [*([("", self.grid.caption)] if self.grid.caption else []), *self.grid.notes]

    def _split(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        wide = options.update(max_width=10_000)
        chosen, first = [0], True
        for column in range(1, len(self.grid.header)):
            wanted = _table(self.grid.columns([*chosen, column]), stacked=True)
            if len(chosen) > 1 and Measurement.get(console, wide, wanted).maximum > options.max_width:
                yield from _part(self.grid.columns(chosen), first=first)
                chosen, first = [0], False
            chosen.append(column)
        yield from _part(self.grid.columns(chosen), first=first)


def _part(part: Grid, *, first: bool) -> Iterator[RenderableType]:
    if not first:
        yield Text("")
    yield _table(part, stacked=True)


def _table(grid: Grid, *, stacked: bool) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for place, head in enumerate(grid.header):
        left = place in grid.lefts
        table.add_column(Text(head.text), justify="left" if left else "right", no_wrap=not left or not stacked)
    for row in grid.rows:
        table.add_row(*(_styled(cell, stacked=stacked) for cell in row))
    return table


def _styled(cell: Cell, *, stacked: bool) -> Text:
    text = Text(visible(cell.stacked if stacked else cell.line), style=_STYLES[cell.tone])
    if cell.error:
        text.stylize("dim", text.plain.index("±"))
    return text


def _note(mark: str, text: str, width: int) -> RenderableType:
    if not mark:
        return Padding(Text(text, style="dim"), (0, 0, 0, 0), expand=False) if width else Text(text)
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(justify="right", width=3)
    table.add_column(max_width=width - 5)
    table.add_row(mark, Text(text))
    return table


def markdown(grid: Grid) -> str:
    """A table in Markdown (GitHub's dialect), notes below it."""
    bars = [("---" if place in grid.lefts else "---:") for place in range(len(grid.header))]
    lines = [f"**{_md(grid.title)}**", ""] if grid.title else []
    lines += ["| " + " | ".join(_md(head.text) for head in grid.header) + " |", "| " + " | ".join(bars) + " |"]
    lines += ["| " + " | ".join(_md(cell.line) for cell in row) + " |" for row in grid.rows]
    lines += ["", _md(grid.caption)] if grid.caption else []
    if grid.notes:
        lines += ["", *(f"- {_md(mark)}: {_md(text)}" for mark, text in grid.notes)]
    return "\n".join(lines) + "\n"


def _md(text: str) -> str:
    out = text.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")
    return "".join(f"\\{letter}" if letter in "*_`[]" else letter for letter in out)


_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "·": r"$\cdot$",
    "η": r"$\eta$",
    "λ": r"$\lambda$",
    "°": r"$^\circ$",
    "²": r"$^2$",
    "⁺": r"$^+$",
    "⁻": r"$^-$",
    "₁": r"$_1$",
    "₂": r"$_2$",
    "σ": r"$\sigma$",
    "—": "---",
}


def latex(grid: Grid, label: str = "") -> str:
    """A floating table in LaTeX for the booktabs package, notes below it.

    Parameters
    ----------
    grid
        The table.
    label
        For ``\\ref``; none where empty.
    """
    aligned = "".join("l" if place in grid.lefts else "r" for place in range(len(grid.header)))
    lines = [r"% needs \usepackage{booktabs}", r"\begin{table}", r"\centering"]
    lines += [rf"\caption{{{_tex(grid.title)}}}"] if grid.title else []
    lines += [rf"\label{{{label}}}"] if label else []
    lines += [rf"\begin{{tabular}}{{{aligned}}}", r"\toprule", _tex_row(grid.header), r"\midrule"]
    lines += [_tex_row(row) for row in grid.rows]
    lines += [r"\bottomrule", r"\end{tabular}"]
    told = [_tex(grid.caption)] if grid.caption else []
    told += [rf"$^{{\mathrm{{{_tex(mark)}}}}}$~{_tex(text)}" for mark, text in grid.notes]
    lines += [r"\par\smallskip\footnotesize\raggedright", *(rf"{text}\par" for text in told)] if told else []
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _tex(text: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in text)


def _tex_row(row: Sequence[Cell]) -> str:
    return " & ".join(_tex_cell(cell) for cell in row) + r" \\"


def _tex_cell(cell: Cell) -> str:
    text = cell.latex or _tex(cell.text)
    if cell.error:
        text = rf"${_number(cell.text)} \pm {_number(cell.error)}$"
    return text + (rf"$^{{\mathrm{{{_tex(cell.mark)}}}}}$" if cell.mark else "")


def _number(text: str) -> str:
    mantissa, found, power = text.partition("e")
    return rf"{mantissa} \cdot 10^{{{int(power)}}}" if found else mantissa
