"""The contract of a form of export (one file under ``exports/formats``), and what forms of a kind share.

`SourceForm` puts formulas into the syntax of another language, by templates; `add` and `written` make XML.
"""

import ast
import keyword
import re
import textwrap
import unicodedata
import xml.etree.ElementTree as ET
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import PurePath
from typing import Any, ClassVar

import jinja2
import numpy as np

from pumaid.exports.equivalent_bodies import Bodies
from pumaid.exports.formulas import Formulas, Lack
from pumaid.maths import Floats

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


class Form(ABC):
    """A way to write a model down for another program. Its file's name is its name on the command line.

    A form that `has_bodies` writes masses, and so needs torque constants.
    """

    has_bodies: ClassVar[bool] = False

    @abstractmethod
    def texts(self, subject: Subject) -> dict[str, str]:
        """Suffix -> text of each file."""

    def left_out(self, subject: Subject) -> tuple[Lack, ...]:
        """What is not in the files."""
        return subject.formulas.left_out


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
    name = subject.formulas.robot.name
    return commented(f"{name}: motor currents of gravity and friction, by pumaid {subject.version}.")


def head(subject: Subject, left_out: tuple[Lack, ...]) -> list[str]:
    """Lines for the head of a file: the model, its joints, what is left out, what the data did not tell."""
    formulas = subject.formulas
    digest = formulas.estimate.recipe_digest[:12]
    lines = [title(subject), f"Recipe {commented(formulas.robot.origin)} (SHA-256 {digest})." if digest else "", ""]
    lines.append(
        "Joints: " + ", ".join(f"{n} {commented(joint.name)}" for n, joint in enumerate(formulas.robot.joints, 1)) + "."
    )
    effects = ", ".join(dict.fromkeys(term.effect for term in formulas.terms)) or "nothing"
    lines += [f"Beyond gravity, Coulomb and viscous friction: {effects}.", ""]
    lines += ["Left out:" if left_out else "Nothing of the model is left out.", *_listed(left_out), ""]
    start = "Not determined by the data, and so of the size that disturbs least:"
    lines += [start if formulas.undetermined else "Every parameter was determined.", *_listed(formulas.undetermined)]
    return [part for line in lines for part in (textwrap.wrap(line, WIDTH, subsequent_indent="    ") or [""])]


def _listed(lacks: tuple[Lack, ...]) -> list[str]:
    return [f"  {commented(lack.name)}: {commented(lack.reason)}" for lack in lacks]


# Source code


class SourceForm(Form):
    """A form of source code, made by `templates` in ``exports/templates``, whose first suffixes are the files'.

    `names` are functions and quantities of a formula -> their text in the language: ``{i}`` is the term's joint;
    ``load_`` is that of all ``load_M``, ``{m}`` being M; others keep their names. `power` is the function x, y -> x to
    the power y (empty where the language writes ``**``), `first` the index of the first joint, and `brackets` what
    stands around the rows of a table and between them.
    """

    templates: ClassVar[tuple[str, ...]]
    names: ClassVar[Mapping[str, str]]
    power: ClassVar[str] = ""
    first: ClassVar[int] = 0
    brackets: ClassVar[tuple[str, str, str]] = ("[", "]", ",")

    def texts(self, subject: Subject) -> dict[str, str]:
        formulas, robot = subject.formulas, subject.formulas.robot
        tables = {
            "placed": robot.placements[:, :3, :3].reshape(-1, 9),
            "d": np.array([joint.d for joint in robot.joints]),
            "g": np.array(robot.gravity, dtype=float),
        }
        fields = ("moments", "ratios", "felt", "coulomb", "viscous", "shaft")
        tables |= {name: getattr(formulas, name) for name in fields}
        start, end, _ = self.brackets
        terms = sorted(formulas.terms, key=lambda term: term.joint)
        kinds: dict[bool, list[dict[str, Any]]] = {False: [], True: []}
        for term in terms:
            text = ast.unparse(_Translation(self, term.joint).visit(ast.parse(term.formula, mode="eval")))
            kinds[term.is_friction].append({"joint": term.joint, "effect": term.effect, "text": text})
        values: dict[str, Any] = {name: self._table(table) for name, table in tables.items()} | {
            "name": subject.name,
            "NAME": subject.name.upper(),
            "n": robot.n_joints,
            "title": title(subject),
            "head": head(subject, self.left_out(subject)),
            "turns": f"{start}{', '.join(str(int(joint.is_revolute)) for joint in robot.joints)}{end}",
            "geared": bool((formulas.shaft != np.eye(robot.n_joints)).any()),
            "holds": kinds[False],
            "frictions": [(joint, list(group)) for joint, group in groupby(kinds[True], key=itemgetter("joint"))],
        }
        words = " ".join(term.formula for term in formulas.terms)
        values |= {
            f"uses_{name}": bool(re.search(rf"\b{name}(_\w+)?\b", words)) for name in ("slope", "tilt", "across")
        }
        environment = jinja2.Environment(
            loader=jinja2.PackageLoader("pumaid.exports"),
            autoescape=False,  # names go into comments only
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
            undefined=jinja2.StrictUndefined,
        )
        return {PurePath(name).suffixes[0]: environment.get_template(name).render(values) for name in self.templates}

    def _table(self, values: Floats) -> str:
        """Numbers, none rounded, rows on lines of their own."""
        start, end, between = self.brackets
        if values.ndim == 1:
            return f"{start}{', '.join(map(repr, values.tolist()))}{end}"
        rows = [", ".join(map(repr, row)) for row in values.tolist()]
        inner = [f"{start}{row}{end}" for row in rows] if between == "," else rows
        return f"{start}\n    " + f"{between}\n    ".join(inner) + f"\n{end}"


class _Translation(ast.NodeTransformer):
    """Puts the language's names and powers into the formula of a joint."""

    def __init__(self, form: SourceForm, joint: int) -> None:
        self.form, self.joint = form, joint

    def visit_Name(self, node: ast.Name) -> ast.expr:
        first, names = self.form.first, self.form.names
        head, _, number = node.id.rpartition("_")
        text, m = (names[f"{head}_"], int(number)) if number.isdigit() else (names.get(node.id, node.id), 1)
        return ast.Name(text.format(i=self.joint - 1 + first, m=m - 1 + first))

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        assert isinstance(node.value, int | float)
        return ast.Constant(float(node.value))  # C divides integers as integers

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        return node.operand.operand if isinstance(node.operand, ast.UnaryOp) else node  # C reads -- as a decrement

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        is_call = self.form.power and isinstance(node.op, ast.Pow)
        return ast.Call(ast.Name(self.form.power), [node.left, node.right], []) if is_call else node


# XML

_PHYSICS = (
    "masses, Coulomb and viscous friction have no place for it; c, python, json and matlab have where it can be written"
)


def xml_name(text: str) -> str:
    """A name without what XML cannot hold, such as control characters."""
    return "".join(letter if letter.isprintable() else "_" for letter in text)


def add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    """A new element in `parent`; no number is rounded, and zero has no sign."""
    out = ET.SubElement(parent, tag)
    for name, value in attributes.items():
        out.set(name, value if isinstance(value, str) else " ".join(repr(x + 0.0) for x in np.ravel(value).tolist()))
    return out


def bodies_of(subject: Subject) -> Bodies:
    """The masses, which every form that asks for them is given."""
    assert subject.bodies is not None
    return subject.bodies


def written(root: ET.Element, subject: Subject, *, left_out: tuple[Lack, ...], remark: str) -> str:
    """A whole XML file, with a comment at its head that says what it is and what is not in it."""
    lines = [*head(subject, left_out), ""]
    lines += [
        part
        for line in (*bodies_of(subject).remarks, remark)
        for part in textwrap.wrap(commented(line), WIDTH, subsequent_indent="    ")
    ]
    ET.indent(root)
    comment = "\n".join(f"  {line}".rstrip() for line in lines)
    return f'<?xml version="1.0" encoding="utf-8"?>\n<!--\n{comment}\n-->\n{ET.tostring(root, encoding="unicode")}\n'


def weights_only(subject: Subject) -> tuple[Lack, ...]:
    """What a chain of masses with friction leaves out of a model."""
    formulas = subject.formulas
    lacks = {lack.name: lack for lack in formulas.left_out}
    for term in formulas.terms:
        lacks.setdefault(term.effect, Lack(term.effect, _PHYSICS))
    lacks["direction"] = Lack("direction of friction", "the mean of forward and backward is written")
    if (formulas.shaft != 0).sum() > len(formulas.shaft):
        lacks["shaft"] = Lack("coupled gears", "friction follows each joint's own velocity, not its motor shaft's")
    lacks["inertia"] = Lack("inertia", "moments of inertia are made up (balls of aluminium); no current showed them")
    return tuple(lacks.values())
