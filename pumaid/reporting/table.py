"""One table for all forms: cells of value ± error and notes below, as text, Markdown, LaTeX or HTML."""

from __future__ import annotations

import functools
import html
import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.table import Table as RichTable
from rich.text import Text

from pumaid.errors import visible

#: Width of text in a pipe or file, and of notes and sentences on a terminal (characters).
WIDTH = 100

#: Characters to which a column of words is narrowed before a table is split; a word that is no longer stays whole.
NARROW, LONG_WORD = 14, 24

#: Tone of a cell -> its style on a terminal: plain, not distinguishable from zero, not identifiable, no such
#: quantity, above what noise explains.
TONES = {"": "", "weak": "dim", "unknown": "yellow", "absent": "dim", "alarm": "red"}

#: The unit A behind a number, in brackets or alone, not the article.
_AMPERE = re.compile(r"(?<=\d )A\b|(?<=/)A(?=\d?\b)|(?<![\w.])A(?=[)</]|$| s(?![a-z]))")

_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$", "·": r"$\cdot$", "η": r"$\eta$",
    "λ": r"$\lambda$", "°": r"$^\circ$", "²": r"$^2$", "⁺": r"$^+$", "⁻": r"$^-$", "ᵢ": r"$_i$", "₊": r"$_+$",
    "₁": r"$_1$", "₂": r"$_2$", "σ": r"$\sigma$", "→": r"$\to$", "—": "---", "–": "--", "−": "$-$",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Cell:
    """One entry: a value, its standard error, the mark of a note, a tone of `TONES`, and LaTeX for the value."""

    text: str
    error: str = ""
    mark: str = ""
    tone: str = ""
    latex: str = ""

    def lines(self, *, stacked: bool) -> str:
        """The entry on one line, or `stacked` with the error below the value."""
        value = f"{self.text} {self.mark}" if self.mark and stacked else self.text
        error = "" if not self.error else f"\n±{self.error}" if stacked else f" ± {self.error}"
        return f"{value}{error}" + (f" {self.mark}" if self.mark and not stacked else "")


Row = Sequence[Cell | str]


@dataclass(frozen=True)
class Table:
    """A table with (C,) column heads and (R, C) cells; plain strings become cells.

    `notes` are (mark, text) pairs that explain marked cells, `caption` says how to read it; columns (from 0) of `words`
    are aligned left, and wrapped where the terminal is narrow.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Row]
    notes: Sequence[tuple[str, str]] = ()
    caption: str = ""
    words: Sequence[int] = (0,)

    @property
    def cells(self) -> list[list[Cell]]:
        """All rows with every entry as a cell."""
        return [[entry if isinstance(entry, Cell) else Cell(entry) for entry in row] for row in self.rows]

    def columns(self, chosen: Sequence[int]) -> Table:
        """The same table with only the columns `chosen` (from 0)."""
        return replace(
            self,
            header=[self.header[column] for column in chosen],
            rows=[[row[column] for column in chosen] for row in self.rows],
            words=[place for place, column in enumerate(chosen) if column in self.words],
        )

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """On a terminal: errors beside values, else below them, else the columns in several parts."""
        if self.title:
            yield Text(visible(self.title), style="bold")
        if self.rows:
            yield from self._parts(console, options)
        if self.caption:
            yield Paragraph(self.caption, style="dim")
        width = max((len(mark) for mark, _ in self.notes), default=0)
        yield from (Paragraph(f"{mark:>{width}} {text}", 2, hanging=width + 1) for mark, text in self.notes)

    def _parts(self, console: Console, options: ConsoleOptions) -> Iterator[RichTable | Text]:

        def is_wider(table: RichTable) -> bool:
            return Measurement.get(console, options.update(max_width=10**6), table).maximum > options.max_width

        if not is_wider(self._drawn(stacked=False)):
            yield self._drawn(stacked=False)
            return
        labels = [0, 1] if tuple(self.words[:2]) == (0, 1) else [0]
        parts = [labels]
        for column in range(len(labels), len(self.header)):
            if len(parts[-1]) > len(labels) and is_wider(
                self.columns([*parts[-1], column])._drawn(stacked=True, widest=NARROW)
            ):
                parts.append(labels)
            parts[-1] = [*parts[-1], column]
        for number, chosen in enumerate(parts):
            if number:
                yield Text("")
            part = self.columns(chosen)
            shown = [k for k in range(1, len(chosen)) if k not in part.words] or range(len(chosen))
            yield replace(part, rows=[row for row in part.cells if any(row[k].text for k in shown)])._drawn(
                stacked=True
            )

    def _drawn(self, *, stacked: bool, widest: int | None = None) -> RichTable:
        """The table for the terminal; `stacked` words are wrapped, at the width `widest` where that is given."""
        drawn = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
        for column, head in enumerate(self.header):
            is_left = column in self.words
            words = [head, *(word for row in self.cells for word in visible(row[column].text).split())]
            longest = min(max(map(len, words)), LONG_WORD)
            drawn.add_column(
                Text(head),
                justify="left" if is_left else "right",
                overflow="fold",
                no_wrap=not (is_left and stacked),
                min_width=longest if is_left else None,
                max_width=max(longest, widest) if is_left and widest else None,
            )
        for row in self.cells:
            texts = [Text(visible(cell.lines(stacked=stacked)), style=TONES[cell.tone]) for cell in row]
            for text in texts:
                text.highlight_regex(r"±\S+|± \S+", "dim")
            drawn.add_row(*texts)
        return drawn

    def markdown(self) -> str:
        """The table in GitHub's Markdown, notes below it."""

        def escaped(text: str) -> str:
            out = text.replace("\\", "\\\\").replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")
            return "".join(f"\\{letter}" if letter in "*_`[]" else letter for letter in out)

        bars = ["---" if column in self.words else "---:" for column in range(len(self.header))]
        lines = [
            *([f"**{escaped(self.title)}**", ""] if self.title else []),
            "| " + " | ".join(map(escaped, self.header)) + " |",
            "| " + " | ".join(bars) + " |",
            *("| " + " | ".join(escaped(cell.lines(stacked=False)) for cell in row) + " |" for row in self.cells),
            *(["", escaped(self.caption)] if self.caption else []),
            *([""] if self.notes else []),
            *(f"- {escaped(mark)}: {escaped(text)}" for mark, text in self.notes),
        ]
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """The table in LaTeX for the booktabs package, notes below it."""
        aligned = "".join("l" if column in self.words else "r" for column in range(len(self.header)))
        below = [
            *([_tex(self.caption)] if self.caption else []),
            *(rf"$^{{\mathrm{{{_tex(mark)}}}}}$~{_tex(text)}" for mark, text in self.notes),
        ]
        lines = [
            *(r"% needs \usepackage{booktabs}", r"\begin{table}", r"\centering"),
            *([rf"\caption{{{_tex(self.title)}}}"] if self.title else []),
            *(
                rf"\begin{{tabular}}{{{aligned}}}",
                r"\toprule",
                " & ".join(map(_tex, self.header)) + r" \\",
                r"\midrule",
            ),
            *(" & ".join(map(_tex_cell, row)) + r" \\" for row in self.cells),
            *(r"\bottomrule", r"\end{tabular}"),
            *([r"\par\smallskip\footnotesize\raggedright"] if below else []),
            *(rf"{text}\par" for text in below),
            r"\end{table}",
        ]
        return "\n".join(lines) + "\n"

    def html(self) -> str:
        """The table as an HTML element, notes below it."""
        return environment().get_template("table.html").render(table=self)

    _repr_html_ = __html__ = html


@functools.cache
def environment() -> Any:
    """The templates of the report, as a `jinja2.Environment`; what they are given is escaped."""
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("pumaid.reporting"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return made


def renamed(part: Any, unit: str) -> Any:
    """A text, table or paragraph, also of a list or mapping, that says another unit of currents where it says A."""
    if unit == "A":
        return part
    if isinstance(part, str):
        return _AMPERE.sub(unit, part)
    if isinstance(part, list | tuple):
        return [renamed(item, unit) for item in part]
    if isinstance(part, dict):
        return {key: renamed(item, unit) for key, item in part.items()}
    return (
        replace(part, **{field.name: renamed(getattr(part, field.name), unit) for field in fields(part)})
        if isinstance(part, Table | Paragraph | Cell)
        else part
    )


def _tex(text: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in text)


def _tex_cell(cell: Cell) -> str:
    text = cell.latex or _tex(cell.text)
    if cell.error:
        sizes = [re.sub(r"e\+?(-?)0*(\d+)$", r" \\cdot 10^{\1\2}", size) for size in (cell.text, cell.error)]
        text = rf"${sizes[0]} \pm {sizes[1]}$"
    return text + (rf"$^{{\mathrm{{{_tex(cell.mark)}}}}}$" if cell.mark else "")


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A heading (bold), a sentence or a command to paste, wrapped at `WIDTH` on a terminal.

    `indent` of all lines, `hanging` of those after the first; a long command goes on behind backslashes.
    """

    text: str
    indent: int = 0
    style: str = ""
    is_command: bool = False
    hanging: int = 0

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        room, before = min(options.max_width, WIDTH) - 2 * self.is_command, " " * self.indent
        lines = textwrap.wrap(
            visible(self.text),
            room,
            initial_indent=before,
            subsequent_indent=before + " " * (2 if self.is_command else self.hanging),
            break_long_words=False,
            break_on_hyphens=False,
        )
        yield Text((" \\\n" if self.is_command else "\n").join(lines), style=self.style)

    def __html__(self) -> str:
        """A command, a heading or a sentence of a page."""
        kind = 'pre class="command" tabindex="0"' if self.is_command else "h3" if self.style == "bold" else "p"
        return f"<{kind}>{html.escape(self.text)}</{kind.split()[0]}>"
