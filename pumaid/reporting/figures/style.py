"""How figures look, and how they become PNG, SVG, PDF or part of a page."""

import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pumaid.dataset import Reject, Run
from pumaid.io.write import write_file

#: Ink of text and axes (the page's text colour on a page); greys; Okabe and Ito's colours for the two directions.
INK, GREY, FAINT, TINT = "#2b2f36", "#8a9099", "#c9ced6", "#f3f4f6"
FORWARD, BACKWARD = "#0072b2", "#d55e00"
COLOURS = {1: FORWARD, -1: BACKWARD, 0: INK}

#: Okabe and Ito's colours and two more, distinct for all kinds of colour vision.
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f5fa8", "#8c6d1f")

#: Colours of areas, the same on light and dark pages because text stands on them; those that need dark text.
AREAS = ("#0173b2", "#de8f05", "#029e73", "#cc78bc", "#56b4e9", "#ece133", "#7f5fa8", "#ca9161", "#949494")
DARK_INK, PALE = "#1b1e23", {"#de8f05", "#cc78bc", "#56b4e9", "#ece133", "#ca9161", "#949494"}

#: Colour on a light page -> on a dark one.
DARK = {FORWARD: "#4fb0ea", BACKWARD: "#ff8a4c", FAINT: "#4a515c", GREY: "#9aa3af", TINT: "#1d2126"}

#: The form of a figure that is part of a page.
INLINE = "inline"

#: inch: width of a panel that is legible at 400 px; points of one series at most; share of a bar with room for text.
WIDTH, MOST_POINTS, ROOM = 4.5, 450, 0.11

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
    "path.simplify": False,
    "text.parse_math": False,  # names of robots, joints and files may hold $
    "svg.hashsalt": "pumaid",
    "pdf.fonttype": 42,
}


#: Draw with these looks inside a ``with``, or in a function that is decorated so.
styled = partial(mpl.rc_context, _RC)

#: Form of a file -> what it says of its maker; no dates, so that the bytes are the same each time.
_MAKER: dict[str, dict[str, str | None]] = {
    "png": {"Software": "pumaid"},
    "svg": {"Creator": "pumaid", "Date": None},
    "pdf": {"Creator": "pumaid", "CreationDate": None},
}


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure with its file name without suffix (unique in a report), title and caption."""

    name: str
    title: str
    caption: str
    figure: Figure

    def file(self, form: str) -> bytes:
        """The figure as ``png``, ``svg``, ``pdf`` or `INLINE`: always the same bytes."""
        kind, stream = "svg" if form == INLINE else form, io.BytesIO()
        metadata = {"Title": self.title, **_MAKER[kind]}
        background = "none" if kind == "svg" else "white"
        with styled(), mpl.rc_context({"svg.fonttype": "none" if form == INLINE else "path"}):
            layout = self.figure.get_layout_engine()
            if layout is not None:  # laid out once for all forms
                layout.execute(self.figure)
                self.figure.set_layout_engine(None)
            self.figure.savefig(stream, format=kind, dpi=200, metadata=metadata, facecolor=background)
        data = stream.getvalue()
        return inlined(data.decode("utf-8"), self.name, self.title).encode("utf-8") if form == INLINE else data

    def _repr_png_(self) -> bytes:
        return self.file("png")

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as PNG, SVG or PDF, by the file's ending."""
        write_file(Path(path), self.file(Path(path).suffix.lstrip(".").lower()))


def inlined(svg: str, name: str, title: str) -> str:
    """An SVG document as an element of a page: its ids begin with the drawing's name, its colours are the page's."""
    body = re.sub(r"<(metadata|style)\b.*?</\1>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    body = re.sub(r'(?<![\w-])(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
    body = re.sub(r"<[^>]+>", lambda tag: re.sub(r"(\.\d\d)\d+(?=[\s\"])", r"\1", tag[0]), body)
    for light in DARK:
        body = body.replace(light, f"var(--c{light[1:]}, {light})")
    body = body.replace(INK, "currentColor")
    body = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--figure-font, sans-serif)", body)
    opening, rest = body.split(">", 1)
    width = re.search(r' width="([\d.]+)pt"', opening)
    natural = f' style="--natural: {float(width[1]) / 0.75:.0f}px"' if width else ""
    opening = re.sub(r' (width|height)="[^"]*"', "", opening)
    label = f'<svg role="img" aria-label="{escape(title, quote=True)}"{natural}'
    return f"{opening.replace('<svg', label, 1)}>{rest}"


def panels(rows: int, columns: int = 1, *, height: float, width: float = WIDTH, **shared: Any) -> tuple[Figure, Any]:
    """A figure and its (rows, columns) panels, each `height` by `width` inch; `shared` are sharex and sharey."""
    figure = Figure(figsize=(width * columns, height * rows + 0.25), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **shared)


def direction_handles(signs: Iterable[int]) -> list[Patch]:
    """Legend of the directions of motion that are there: 1 forward, -1 backward."""
    present = set(signs)
    return [
        Patch(color=COLOURS[sign], label=label) for sign, label in ((1, "forward"), (-1, "backward")) if sign in present
    ]


def legend(figure: Figure, handles: Sequence[Artist], columns: int = 3, *, title: str = "") -> None:
    """A legend below all panels, and a title above them where there is one."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, handlelength=1.2)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")


def error_marks(axes: Axes, x: Any, y: Any, *, errors: Any, sign: int = 1, **look: Any) -> None:
    """Marks with error bars, in the colour and form of a direction of motion; 0: of both."""
    style: Any = {"markersize": 4.0, "linestyle": "", "elinewidth": 1.1, "markeredgecolor": "none", "zorder": 4}
    axes.errorbar(x, y, yerr=errors, color=COLOURS[sign], marker="s" if sign < 0 else "o", **style | look)


def dots(axes: Axes, x: Any, y: Any, *, colour: str, size: float, alpha: float = 0.5, limit: int = MOST_POINTS) -> None:
    """Points as one line with gaps, a tenth of what markers take in SVG; of more than `limit` every k-th."""
    if not len(x):
        return
    step = max(1, -(-len(x) // limit))
    x, y = np.asarray(x, dtype=float)[::step], np.asarray(y, dtype=float)[::step]
    length = 1e-4 * max(float(np.ptp(x)), 1e-9)  # lines without length are not drawn everywhere
    across, up = np.column_stack([x, x + length, np.nan * x]), np.column_stack([y, y, np.nan * y])
    # Strokes this short would be snapped to nothing in PNG.
    axes.plot(
        across.ravel(),
        up.ravel(),
        color=colour,
        alpha=alpha,
        linewidth=size,
        solid_capstyle="round",
        zorder=2,
        snap=False,
    )


def zero_line(axes: Axes, floor: float | None = None) -> None:
    """A line at zero, and the band of a noise floor (A) around it."""
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=1)
    if floor is not None:
        axes.axhspan(-floor, floor, color=GREY, alpha=0.18, linewidth=0, zorder=0)


def clock_shifts(items: Iterable[Run | Reject], gap: float = 0.0) -> dict[int, float]:
    """Time (s) added to each clock so that recordings follow one another from 0, `gap` as a share of all between."""
    times = pd.DataFrame(
        ((item.clock, item.start, item.start + item.duration) for item in items), columns=["clock", "start", "end"]
    )
    spans = times.groupby("clock").agg({"start": "min", "end": "max"})
    lengths = spans["end"] - spans["start"]
    return dict((lengths + gap * lengths.sum()).cumsum().shift(fill_value=0.0) - spans["start"])
