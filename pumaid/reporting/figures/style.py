"""How figures look, and how they become PNG, SVG, PDF or part of a page."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from pumaid.dataset import Reject, Run

Floats = NDArray[np.float64]

#: Ink of text and axes (the page's text colour on a page); greys; Okabe and Ito's colours for the two directions.
INK, GREY, FAINT, TINT = "#2b2f36", "#8a9099", "#c9ced6", "#f3f4f6"
FORWARD, BACKWARD = "#0072b2", "#d55e00"
COLOURS = {1: FORWARD, -1: BACKWARD, 0: INK}

#: Okabe and Ito's colours and two more, distinct for all kinds of colour vision.
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f5fa8", "#8c6d1f")

#: Colours of areas, the same on light and dark pages because text stands on them; those that need dark text.
AREAS = ("#0173b2", "#de8f05", "#029e73", "#cc78bc", "#56b4e9", "#ece133", "#7f5fa8", "#ca9161", "#949494")
PALE = {"#de8f05", "#cc78bc", "#56b4e9", "#ece133", "#ca9161", "#949494", "#a9b0ba", "#d3d7dd"}

#: Colour on a light page -> on a dark one.
DARK = {FORWARD: "#4fb0ea", BACKWARD: "#ff8a4c", FAINT: "#4a515c", GREY: "#9aa3af", TINT: "#1d2126"}

#: The form of a figure that is part of a page.
INLINE = "inline"

#: inch: width of a panel that is legible at 400 px; points drawn of one series at most.
WIDTH, MOST_POINTS = 4.5, 450

_RC: Any = {
    "font.size": 9.5,
    "font.family": ["DejaVu Sans"],
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    **dict.fromkeys(("axes.edgecolor", "axes.labelcolor", "axes.titlecolor", "text.color"), INK),
    **dict.fromkeys(("xtick.color", "ytick.color"), INK),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    **dict.fromkeys(("axes.facecolor", "figure.facecolor", "savefig.facecolor"), "none"),
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.2,
    "hatch.linewidth": 1.0,
    "axes.formatter.useoffset": False,
    "text.parse_math": False,  # names of robots, joints and files may hold $
    "svg.hashsalt": "pumaid",
    "pdf.fonttype": 42,
}


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure to be drawn: file name without suffix (unique in a report), title, caption, and what draws it."""

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]

    def files(self, forms: Sequence[str]) -> dict[str, bytes]:
        """The figure in several forms (``png``, ``svg``, ``pdf``, `INLINE`), drawn once; always the same bytes."""
        with styled():
            figure = self.draw()
            layout = figure.get_layout_engine()
            if layout is not None:
                layout.execute(figure)
                figure.set_layout_engine(None)
            out = {form: _saved(figure, form, self.title) for form in forms if form != INLINE}
        if INLINE in forms:
            with styled(), mpl.rc_context({"svg.fonttype": "none"}):
                out[INLINE] = inlined(_saved(figure, "svg", self.title).decode("utf-8"), self).encode("utf-8")
        return out

    def file(self, form: str) -> bytes:
        """The figure in one form."""
        return self.files([form])[form]

    def inline(self) -> str:
        """The figure as an SVG element for a page."""
        return self.file(INLINE).decode("utf-8")


def styled() -> AbstractContextManager[None]:
    """Draw with these looks inside."""
    return mpl.rc_context(_RC)


def _saved(figure: Figure, form: str, title: str) -> bytes:
    out = io.BytesIO()
    maker: dict[str, dict[str, str | None]] = {
        "png": {"Software": "pumaid"},
        "svg": {"Creator": "pumaid", "Date": None},
        "pdf": {"Creator": "pumaid", "CreationDate": None},
    }
    metadata = {"Title": title, **maker[form]}
    figure.savefig(out, format=form, dpi=200, metadata=metadata, facecolor="none" if form == "svg" else "white")
    return out.getvalue()


def inlined(svg: str, drawing: Drawing) -> str:
    """An SVG document as an element of a page: its ids begin with the drawing's name, its colours are the page's."""
    body = re.sub(r"<(metadata|style)\b.*?</\1>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    body = re.sub(r'(?<![\w-])(id="|href="#|url\(#)', rf"\g<1>{drawing.name}-", body)
    body = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\.\d\d)\d+(?=[\s\"])", r"\1", tag[0]), body)
    for light in DARK:
        body = body.replace(light, f"var(--c{light[1:]}, {light})")
    body = body.replace(INK, "currentColor")
    body = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--figure-font, sans-serif)", body)
    opening, rest = body.split(">", 1)
    width = re.search(r' width="([\d.]+)pt"', opening)
    natural = f' style="--natural: {float(width[1]) / 0.75:.0f}px"' if width else ""
    opening = re.sub(r' (width|height)="[^"]*"', "", opening)
    label = f'<svg role="img" aria-label="{escape(drawing.title, quote=True)}"{natural}'
    return f"{opening.replace('<svg', label, 1)}>{rest}"


def panels(rows: int, *, height: float, width: float = WIDTH, **shared: Any) -> tuple[Figure, list[Axes]]:
    """A figure with `rows` panels below each other, each `height` inch high; `shared` are sharex and sharey."""
    figure = Figure(figsize=(width, height * rows + 0.25), layout="constrained")
    return figure, list(figure.subplots(rows, 1, squeeze=False, **shared)[:, 0])


def direction_handles(signs: Iterable[int]) -> list[Patch]:
    """Legend of the directions of motion that are there: 1 forward, -1 backward."""
    present = set(signs)
    return [
        Patch(color=COLOURS[sign], label=label) for sign, label in ((1, "forward"), (-1, "backward")) if sign in present
    ]


def legend(figure: Figure | SubFigure, handles: Sequence[Artist], columns: int = 3) -> None:
    """A legend below all panels."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, handlelength=1.2)


def heading(figure: Figure, text: str) -> None:
    """A title above all panels."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=11, fontweight="bold")


def error_marks(axes: Axes, x: Any, y: Any, *, errors: Any, sign: int = 1, **look: Any) -> None:
    """Marks with error bars, in the colour and form of a direction of motion; 0: of both."""
    style: Any = {"markersize": 4.0, "linestyle": "", "elinewidth": 1.1, "markeredgecolor": "none", "zorder": 4}
    axes.errorbar(x, y, yerr=errors, color=COLOURS[sign], marker="s" if sign < 0 else "o", **style | look)


def dots(axes: Axes, x: Floats, y: Floats, *, colour: str, size: float = 2.2, alpha: float = 0.5) -> None:
    """Points as one path, a tenth of what markers take in SVG; of more than `MOST_POINTS` every k-th."""
    points = np.column_stack([x, y])[:: max(1, -(-len(x) // MOST_POINTS))]
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return
    vertices = np.repeat(points, 2, axis=0)
    vertices[1::2, 0] += 1e-4 * max(float(np.ptp(points[:, 0])), 1e-9)  # lines without length are not drawn everywhere
    path = Path(vertices, np.tile([Path.MOVETO, Path.LINETO], len(points)))
    path.should_simplify = False
    patch = PathPatch(path, fill=False, edgecolor=colour, linewidth=size, alpha=alpha, capstyle="round", zorder=2)
    patch.set_snap(False)  # strokes this short would be snapped to nothing in PNG
    axes.add_artist(patch)
    axes.update_datalim(points)
    axes.autoscale_view()


def zero_line(axes: Axes, floor: float | None = None) -> None:
    """A line at zero, and the band of a noise floor (A) around it."""
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    if floor is not None:
        axes.axhspan(-floor, floor, color=GREY, alpha=0.18, linewidth=0, zorder=0)


def stacked_bar(axes: Axes, place: float, parts: Iterable[tuple[float, str, float]], *, room: float) -> float:
    """A bar of (share, colour, opacity), negative ones beyond zero, with the shares above `room`; its right end."""
    ends = {True: 0.0, False: 0.0}
    for share, colour, alpha in parts:
        start = ends[share >= 0.0]
        axes.barh(place, share, left=start, height=0.68, color=colour, alpha=alpha, linewidth=0)
        ends[share >= 0.0] += share
        if share >= room:
            look: Any = {
                "color": "#1b1e23" if colour in PALE else INK if alpha < 1.0 else "white",
                "fontweight": "bold",
            }
            axes.text(start + share / 2.0, place, f"{100.0 * share:.0f} %", ha="center", va="center", **look)
    return ends[True]


def clock_shifts(items: Iterable[Run | Reject], gap: float = 0.0) -> dict[int, float]:
    """Time (s) added to each clock so that recordings follow one another from 0, `gap` as a share of all between."""
    spans: dict[int, tuple[float, float]] = {}
    for item in items:
        low, high = spans.get(item.clock, (math.inf, -math.inf))
        spans[item.clock] = (min(low, item.start), max(high, item.start + item.duration))
    pause = gap * sum(high - low for low, high in spans.values())
    shifts, at = {}, 0.0
    for clock, (low, high) in sorted(spans.items()):
        shifts[clock] = at - low
        at += high - low + pause
    return shifts
