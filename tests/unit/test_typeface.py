"""The cut typeface writes what the whole one writes, and is a part of its size."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.font_manager import FontProperties, findfont
from matplotlib.ft2font import FT2Font

from pumaid.io.typeface import CUT, WHOLE, cut_typeface

FACES = [("normal", "normal"), ("bold", "normal"), ("normal", "italic")]


def font(family: str, weight: str, style: str) -> FT2Font:
    """The font that matplotlib finds."""
    return FT2Font(str(findfont(FontProperties(family=family, weight=weight, style=style), fallback_to_default=False)))


@pytest.mark.parametrize(("weight", "style"), FACES)
def test_letters_are_as_wide_as_they_were(weight, style):
    """Every letter that figures write is there, as wide as in the whole typeface, in the right weight and slant."""
    cut_typeface()
    cut, whole = font(CUT, weight, style), font(WHOLE, weight, style)
    assert cut.style_name == whole.style_name
    for letter in "Az09 −±·°²ηλ₁⁺ᵢ→Жß…–|":
        assert cut.get_char_index(ord(letter)) or not whole.get_char_index(ord(letter))
        assert cut.load_char(ord(letter)).linearHoriAdvance == whole.load_char(ord(letter)).linearHoriAdvance


def test_it_is_made_once_and_is_small():
    """Asked again it is the same folder; its files are less than half of the whole typeface's."""
    folder = cut_typeface()
    assert cut_typeface() is folder
    whole = Path(str(findfont(FontProperties(family=WHOLE))))
    assert all(file.stat().st_size < 0.5 * whole.stat().st_size for file in Path(folder.name).iterdir())
