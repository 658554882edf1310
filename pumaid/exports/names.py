"""Names that other languages accept, made from names that users gave."""

from __future__ import annotations

import keyword
import re
import unicodedata

#: Words that are no name in C or MATLAB; Python's own are asked of Python.
RESERVED = frozenset(
    re.findall(
        r"\w+",
        "auto break case char const continue default do double else enum extern float for goto if inline int long"
        " register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while"
        " end function otherwise parfor persistent global spmd elseif classdef catch main",
    )
)

#: MATLAB cuts names at 63 characters; what is put behind one has room.
LONGEST = 40


def identifier(text: str) -> str:
    """A lower-case name of letters, digits and underscores, close to `text`; ``arm`` where nothing is left of it.

    Parameters
    ----------
    text
        Any text, such as a robot's name.
    """
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")[:LONGEST].strip("_")
    if not name:
        return "arm"
    if name[0].isdigit():
        name = f"arm_{name}"
    return f"{name}_model" if name in RESERVED or keyword.iskeyword(name) else name


def commented(text: str) -> str:
    """`text` on one line, without what ends or begins a comment in C, XML, MATLAB or Python, quotes and braces kept."""
    line = "".join(letter if letter.isprintable() else " " for letter in " ".join(text.split()))
    line = line.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").replace("\\", "/")
    return line.replace('"""', "'''").replace("--", "- -").replace("--", "- -")
