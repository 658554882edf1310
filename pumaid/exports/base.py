"""The contract of a form of export: what one file under ``exports/formats`` states."""

import keyword
import re
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from pumaid.exports.equivalent_bodies import Bodies
from pumaid.exports.formulas import Formulas, Lack


@dataclass(frozen=True, eq=False, slots=True)
class Subject:
    """What is exported: the model, a name for files and functions, and masses with its weight for forms that have them.

    `version` is that of pumaid that made the model; `remarks` are what the user should know of torque constants and
    masses, a sentence each.
    """

    formulas: Formulas
    name: str
    bodies: Bodies | None
    version: str
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Exported:
    """A model in another form: its files' texts by suffix, in the order in which they are written.

    `left_out` is what the form does not hold (effects, and what the format has no place for), `undetermined` are
    parameters that the data did not tell.
    """

    form: str
    name: str
    files: Mapping[str, str]
    left_out: tuple[Lack, ...]
    undetermined: tuple[Lack, ...]
    remarks: tuple[str, ...] = ()


class Form(ABC):
    """A way to write a model down for another program. Its file's name is its name on the command line.

    `title` is a line for people; a form that `has_bodies` writes masses, and so needs torque constants.
    """

    title: ClassVar[str]
    has_bodies: ClassVar[bool] = False

    @abstractmethod
    def texts(self, subject: Subject) -> dict[str, str]:
        """Suffix -> text of each file."""

    def left_out(self, subject: Subject) -> tuple[Lack, ...]:
        """What is not in the files."""
        return subject.formulas.left_out


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
    """A lower-case name of letters, digits and underscores, close to `text`; ``arm`` where nothing is left of it."""
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
