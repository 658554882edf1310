"""The contract of a form of export (listed by a file under ``exports/formats``), and the heads of files."""

import keyword
import re
import textwrap
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from pumaid.exports.equivalent_bodies import Bodies
from pumaid.exports.formulas import Formulas, Lack

#: Width of text in comments.
WIDTH = 108


@dataclass(frozen=True, eq=False, slots=True)
class Subject:
    """What is exported: the model, a name for files and functions, and masses with its weight for forms that have them.

    `version` is that of pumaid that made the model.
    """

    formulas: Formulas
    name: str
    bodies: Bodies | None
    version: str


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


@dataclass(frozen=True, slots=True)
class Form:
    """A way to write a model down for another program; a module of ``formats`` lists its own, by name, in ``FORMS``.

    `write` returns suffix -> text of each file, and what is not in the files. A form that `has_bodies` writes masses,
    and so needs torque constants.
    """

    write: Callable[[Subject], tuple[dict[str, str], tuple[Lack, ...]]]
    has_bodies: bool = False


# Names and heads

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


def title(subject: Subject) -> str:
    """A line: which arm, by which program."""
    return commented(
        f"{subject.formulas.robot.name}: motor currents of gravity and friction, by pumaid {subject.version}."
    )


def head(subject: Subject, left_out: tuple[Lack, ...], remarks: Sequence[str] = ()) -> list[str]:
    """Lines for the head of a file: the model, its joints, what is left out, what the data did not tell, remarks."""
    formulas = subject.formulas
    digest = formulas.estimate.recipe_digest[:12]
    joints = ", ".join(f"{n} {commented(joint.name)}" for n, joint in enumerate(formulas.robot.joints, 1))
    effects = ", ".join(dict.fromkeys(term.effect for term in formulas.terms)) or "nothing"
    start = "Not determined by the data, and so of the size that disturbs least:"
    lines = [
        title(subject),
        f"Recipe {commented(formulas.robot.origin)} (SHA-256 {digest})." if digest else "",
        "",
        f"Joints: {joints}.",
        f"Beyond gravity, Coulomb and viscous friction: {effects}.",
        "",
        "Left out:" if left_out else "Nothing of the model is left out.",
        *_listed(left_out),
        "",
        start if formulas.undetermined else "Every parameter was determined.",
        *_listed(formulas.undetermined),
        *(["", *map(commented, remarks)] if remarks else []),
    ]
    return [part for line in lines for part in (textwrap.wrap(line, WIDTH, subsequent_indent="    ") or [""])]


def _listed(lacks: tuple[Lack, ...]) -> list[str]:
    return [f"  {commented(lack.name)}: {commented(lack.reason)}" for lack in lacks]
