"""A table in each of its forms."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from pumaid.reporting.forms import Shown, latex, markdown
from pumaid.reporting.grid import Cell, Grid, grid

WIDE = Grid(
    "A title",
    (Cell("link"), *(Cell(str(n)) for n in range(1, 8))),
    tuple((Cell(f"row {r}"), *(Cell("-0.12345", "0.00067") for _ in range(7))) for r in range(3)),
    (("a", "a reason"), ("-", "another")),
    "How to read it.",
)
HOSTILE = grid("50% & more", ("a_b", "c|d"), [["<b>", Cell("1e-9", "0.1e-9", mark="x")]], notes=(("x", "{} ~ ^ \\"),))


def printed(width: int, table: Grid = WIDE) -> str:
    """What a terminal of `width` characters shows."""
    out = io.StringIO()
    Console(file=out, width=width, color_system=None).print(Shown(table))
    return out.getvalue()


@pytest.mark.parametrize("width", [40, 60, 80, 120, 200])
def test_never_wider_than_the_terminal(width):
    """No line is longer than the terminal is wide."""
    assert max(len(line.rstrip()) for line in printed(width).splitlines()) <= width


@pytest.mark.parametrize("width", [40, 80, 200])
def test_nothing_is_lost_in_a_narrow_terminal(width):
    """Every value, error and note is shown whatever the width."""
    text = printed(width)
    assert text.count("-0.12345") == 21 and text.count("0.00067") == 21
    assert "a reason" in text and "How to read it." in text


def test_seven_links_fit_eighty_columns():
    """A seven-joint table needs no splitting at 80 columns: errors go below the values."""
    assert printed(80).count("link") == 1


def test_wide_terminal_puts_errors_beside_values():
    """Where there is room, a value and its error share a line."""
    assert "-0.12345 ± 0.00067" in printed(200)


def test_markdown_has_as_many_cells_in_every_row():
    """A bar or an angle bracket in a name does not break the table."""
    rows = [line for line in markdown(HOSTILE).splitlines() if line.startswith("|")]
    assert {row.replace("\\|", "").count("|") for row in rows} == {3}
    assert "<b>" not in markdown(HOSTILE)


def test_latex_escapes_what_latex_would_read():
    """Special letters are written, not obeyed; powers of ten are mathematics."""
    text = latex(HOSTILE, label="tab:x")
    assert r"50\% \& more" in text and r"a\_b" in text and r"\{\} \textasciitilde{}" in text
    assert r"$1 \cdot 10^{-9} \pm 0.1 \cdot 10^{-9}$" in text
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")


def test_chosen_columns_keep_their_alignment():
    """Taking columns out of a table keeps heads, cells and alignment together."""
    some = WIDE.columns([0, 3])
    assert [head.text for head in some.header] == ["link", "3"] and some.lefts == (0,)
    assert all(len(row) == 2 for row in some.rows)
