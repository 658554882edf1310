"""How figures look: a palette that colour-blind eyes tell apart, one way to become PNG, SVG, PDF or part of a page."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Ink of text and axes; on a page it becomes the text's colour.
INK = "#2b2f36"

#: Okabe and Ito's colours, which all kinds of colour vision tell apart.
FORWARD, BACKWARD = "#0072b2", "#d55e00"
VERMILION = "#d55e00"
GREY, FAINT = "#8a9099", "#c9ced6"

#: Effect -> colour of areas, the same on light and dark pages since words stand on them; effects beyond the paper's
#: take the rest in turn.
EFFECT_COLOURS = {"gravity": "#0173b2", "coulomb": "#de8f05", "viscous": "#029e73", "inertia": "#cc78bc"}
OTHER_COLOURS = ("#56b4e9", "#ece133", "#7f5fa8", "#ca9161", "#949494")

#: Areas on which dark words are read better than white ones.
PALE = {"#de8f05", "#cc78bc", "#56b4e9", "#ece133", "#ca9161", "#949494"}

#: Colours on a dark page, by those on a light one: lighter where contrast asks for it.
DARK = {
    FORWARD: "#4fb0ea",
    BACKWARD: "#ff8a4c",
    FAINT: "#4a515c",
    GREY: "#9aa3af",
    "#f3f4f6": "#1d2126",
    "#e3e6ea": "#2a3038",
}

#: The form of a figure that is part of a page.
INLINE = "inline"

#: inch: a panel that is read at 400 px without shrinking.
NARROW = 4.5

#: Points a panel shows at most; more would blacken it and swell the page.
MOST_POINTS = 450

#: A hundredth of a point is finer than any screen.
_LONG, _TAG = re.compile(r"(\.\d\d)\d+(?=[\s\"])"), re.compile(r"<[^>]+>")

#: A path's course, and the blanks around its letters, which nobody needs.
_COURSE, _BLANKS = re.compile(r'(?<= d=")[^"]+'), re.compile(r"\s*([A-Za-z])\s*")

_RC = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "text.parse_math": False,  # names of robots, joints and files may hold $
    "path.simplify": True,
    "path.simplify_threshold": 0.1,
    "svg.hashsalt": "pumaid",
    "pdf.fonttype": 42,
}


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure to be drawn.

    Attributes
    ----------
    name
        File name without suffix; unique within a report.
    title, caption
        What it shows, and how to read it: plain sentences.
    make
        Draws it.
    joint
        The joint (from 1) it is about, or None.
    """

    name: str
    title: str
    caption: str
    make: Callable[[], Figure]
    joint: int | None = None

    def file(self, form: str) -> bytes:
        """The figure as ``png``, ``svg`` or ``pdf``."""
        return self.files([form])[form]

    def inline(self) -> str:
        """The figure as an SVG element for a page, in the page's own ink, its ids its own."""
        return self.files([INLINE])[INLINE].decode("utf-8")

    def files(self, forms: Sequence[str]) -> dict[str, bytes]:
        """The figure in several forms (`INLINE` among them) for the price of drawing it once."""
        with styled():
            figure = self.make()
            settle(figure)
            out = {form: saved(figure, form, self.title) for form in forms if form != INLINE}
        if INLINE in forms:
            with styled(text_as_paths=False):
                svg = saved(figure, "svg", self.title).decode("utf-8")
            out[INLINE] = woven(svg, self.name, self.title).encode("utf-8")
        return out


@contextmanager
def styled(*, text_as_paths: bool = True) -> Iterator[None]:
    """Draw in the house's style inside; SVG text as outlines (exact anywhere) or as text (small, can be searched)."""
    looks: Any = {
        **_RC,
        "font.family": ["DejaVu Sans"],
        "svg.fonttype": "path" if text_as_paths else "none",
    }
    with mpl.rc_context(looks):
        yield


def settle(figure: Figure) -> None:
    """Find the layout once and for all; an engine that stays would draw everything twice for every form."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def panels(
    rows: int, *, height: float, width: float = NARROW, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure with `rows` panels below each other, each `height` inch high."""
    figure = Figure(figsize=(width, height * rows + 0.25), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False, sharex=sharex, sharey=sharey)
    return figure, list(axes[:, 0])


def saved(figure: Figure, form: str, title: str) -> bytes:
    """The bytes of a figure; the same figure gives the same bytes.

    Parameters
    ----------
    figure
        What was drawn.
    form
        ``png``, ``svg`` or ``pdf``.
    title
        Goes into the file's metadata.
    """
    out = io.BytesIO()
    metadata: dict[str, str | None] = {"Title": title}
    if form == "svg":
        metadata |= {"Date": None, "Creator": "pumaid"}
    elif form == "pdf":
        metadata |= {"CreationDate": None, "Creator": "pumaid"}
    else:
        metadata = {"Title": title, "Software": "pumaid"}
    paper = "none" if form == "svg" else "white"
    figure.savefig(out, format=form, dpi=200, metadata=metadata, facecolor=paper)
    return out.getvalue()


def woven(svg: str, name: str, title: str) -> str:
    """An SVG document as an element of a page.

    Parameters
    ----------
    svg
        What matplotlib wrote.
    name
        Put before every id, so that figures of one page do not disturb each other.
    title
        For those who hear the page.
    """
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"<style.*?</style>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{name}-', body)
    body = re.sub(r'(xlink:href|href)="#', rf'\1="#{name}-', body)
    body = body.replace("url(#", f"url(#{name}-")
    body = _TAG.sub(lambda tag: _LONG.sub(r"\1", tag[0]), body)
    body = _COURSE.sub(lambda course: _BLANKS.sub(r"\1", course[0]).strip(), body)
    for light in {INK, *DARK}:
        spot = "currentColor" if light == INK else f"var(--c{light[1:]}, {light})"
        body = body.replace(light, spot)
    body = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--figure-font, sans-serif)", body)
    label = f'role="img" aria-label="{escape(title, quote=True)}"'
    width = re.search(r'<svg[^>]*?width="([\d.]+)pt"', body)
    natural = f' style="--natural: {float(width[1]) / 0.75:.0f}px"' if width else ""
    opening, rest = body.split(">", 1)
    opening = re.sub(r' (width|height)="[^"]*"', "", opening)
    return f"{opening.replace('<svg', f'<svg {label}{natural}', 1)}>{rest}"


def way_handles(signs: Iterable[int], **look: Any) -> list[Line2D]:
    """What a legend says of the directions that were run: 1 forward, -1 backward."""
    present = set(signs)
    ways = ((1, FORWARD, "o", "forward"), (-1, BACKWARD, look.pop("backward", "o"), "backward"))
    return [
        Line2D([], [], marker=mark, color=colour, label=word, **look)
        for sign, colour, mark, word in ways
        if sign in present
    ]


def dots(axes: Axes, x: Floats, y: Floats, *, colour: str, size: float = 2.2, alpha: float = 0.5) -> None:
    """Many points as one path: a tenth of what markers take in SVG; of more than `MOST_POINTS` every k-th."""
    step = max(1, int(np.ceil(len(x) / MOST_POINTS)))
    shown = np.column_stack([x, y])[::step]
    shown = shown[np.isfinite(shown).all(axis=1)]
    if not len(shown):
        return
    vertices = np.repeat(shown, 2, axis=0)
    vertices[1::2, 0] += 1e-4 * max(float(np.ptp(shown[:, 0])), 1e-9)  # a line without length is not drawn everywhere
    path = Path(vertices, np.tile([Path.MOVETO, Path.LINETO], len(shown)))
    path.should_simplify = False
    patch = PathPatch(path, fill=False, edgecolor=colour, linewidth=size, alpha=alpha, capstyle="round", zorder=2)
    patch.set_snap(False)  # strokes this short would be snapped to nothing in PNG
    axes.add_artist(patch)  # not add_patch, which would look for the extent of every single stroke
    axes.update_datalim(shown)
    axes.autoscale_view()


def effect_colour(effect: str, others: list[str]) -> str:
    """The colour of an effect; `others` are those beyond the paper's model, in the order in which they are shown."""
    if effect in EFFECT_COLOURS:
        return EFFECT_COLOURS[effect]
    return OTHER_COLOURS[others.index(effect) % len(OTHER_COLOURS)]
