"""The typeface of figures, cut down to what they write: a whole one takes most of the time of making a PDF."""

from __future__ import annotations

import atexit
import functools
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from fontTools import subset  # type: ignore[import-untyped]
from matplotlib.font_manager import FontProperties, findfont, fontManager

#: The typeface that is cut, and what its cut is called.
WHOLE, CUT = "DejaVu Sans", "DejaVu Sans Figures"

#: Letters kept: Latin, Greek, Cyrillic; signs, sub- and superscripts, arrows and mathematical signs.
LETTERS = (*range(0x20, 0x530), *range(0x1D00, 0x2300))

#: Tables that figures do not need and that take long to cut anew for every PDF.
DROPPED = ("GSUB", "GPOS", "GDEF", "FFTM")

#: Weights and slants that figures use.
_FACES: tuple[tuple[str, Literal["normal", "italic"]], ...] = (
    ("normal", "normal"),
    ("bold", "normal"),
    ("normal", "italic"),
)


@functools.cache
def cut_typeface() -> TemporaryDirectory[str]:
    """Make the typeface `CUT` known to matplotlib for as long as this process lives; once, however often it is asked.

    Returns
    -------
    folder
        Holds the font files; goes away with the process.
    """
    folder = TemporaryDirectory(prefix="pumaid-", ignore_cleanup_errors=True)
    atexit.register(folder.cleanup)  # else Python warns of it where warnings are asked for
    for weight, style in _FACES:
        source = findfont(FontProperties(family=WHOLE, weight=weight, style=style))
        place = Path(folder.name) / f"{weight}-{style}.ttf"
        options = subset.Options(hinting=True, name_IDs=["*"])
        options.drop_tables += DROPPED
        with subset.load_font(str(source), options) as font:
            cutter = subset.Subsetter(options)
            cutter.populate(unicodes=LETTERS)
            cutter.subset(font)
            _rename(font)
            font.save(place)
        fontManager.addfont(place)
    return folder


def _rename(font: Any) -> None:
    for record in font["name"].names:
        name = record.toUnicode().replace(WHOLE, CUT).replace(WHOLE.replace(" ", ""), CUT.replace(" ", ""))
        font["name"].setName(name, record.nameID, record.platformID, record.platEncID, record.langID)
