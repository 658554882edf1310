"""Forms of source code: formulas in the syntax of another language, and what its templates are filled with."""

import ast
import textwrap
from collections.abc import Mapping
from itertools import groupby
from operator import itemgetter
from pathlib import PurePath
from typing import Any, ClassVar

import jinja2
import numpy as np

from pumaid.exports.base import Form, Subject, commented
from pumaid.exports.formulas import Lack
from pumaid.maths import Floats

#: Width of text in comments.
WIDTH = 108


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
        values |= {f"uses_{quantity}": formulas.uses(quantity) for quantity in ("slope", "tilt", "across")}
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
