"""Formulas in the syntax of other languages, and what the templates of source code are filled with."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.exports.base import Subject, commented
from pumaid.exports.formulas import Lack, Term

Floats = NDArray[np.float64]

#: Width of text in comments.
WIDTH = 108

_OPERATORS: dict[type[ast.AST], tuple[str, int]] = {
    ast.Add: ("+", 0),
    ast.Sub: ("-", 0),
    ast.Mult: ("*", 1),
    ast.Div: ("/", 1),
    ast.Pow: ("**", 3),
    ast.Gt: (">", 0),
    ast.Lt: ("<", 0),
    ast.GtE: (">=", 0),
    ast.LtE: ("<=", 0),
    ast.Eq: ("==", 0),
}
#: How tightly a sum, a product, a minus sign, a power and a name bind.
_SUM, _PRODUCT, _MINUS, _POWER, _NAME = range(5)


@dataclass(frozen=True, slots=True)
class LanguageSyntax:
    """A language of source code.

    Attributes
    ----------
    functions
        Name of a function in a formula -> its name in the language, or a text with ``{}`` for the argument.
    power
        ``call`` for ``pow(x, y)``, else the operator.
    quantities
        From a joint (from 1) and the number of joints to the text of each quantity of a formula; others keep their
        names.
    brackets
        What stands around, between the entries and between the rows of a table.
    """

    functions: Mapping[str, str]
    power: str
    quantities: Callable[[int, int], Mapping[str, str]]
    brackets: tuple[str, str, str]

    def text(self, term: Term, joints: int) -> str:
        """A term's formula."""
        return self._node(ast.parse(term.formula, mode="eval").body, self.quantities(term.joint, joints))[0]

    def table(self, values: Floats) -> str:
        """Numbers, none rounded, rows on lines of their own."""
        start, end, between = self.brackets
        if values.ndim == 1:
            return f"{start}{', '.join(map(number, values))}{end}"
        rows = [", ".join(map(number, row)) for row in values]
        inner = [f"{start}{row}{end}" for row in rows] if between == "," else rows
        return f"{start}\n    " + f"{between}\n    ".join(inner) + f"\n{end}"

    def _node(self, node: ast.expr, named: Mapping[str, str]) -> tuple[str, int]:
        """Text and how tightly it binds."""

        def inside(part: ast.expr, needed: int) -> str:
            text, rank = self._node(part, named)
            return text if rank >= needed else f"({text})"

        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return number(node.value), _NAME
        if isinstance(node, ast.Name):
            return named.get(node.id, node.id), _NAME
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return f"-{inside(node.operand, _POWER)}", _MINUS
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            arguments = ", ".join(self._node(argument, named)[0] for argument in node.args)
            call = self.functions[node.func.id]
            return call.replace("{}", arguments) if "{}" in call else f"{call}({arguments})", _NAME
        if isinstance(node, ast.Compare):
            sign, _ = _OPERATORS[type(node.ops[0])]
            return f"({inside(node.left, _SUM)} {sign} {inside(node.comparators[0], _SUM)})", _NAME
        if not isinstance(node, ast.BinOp):
            raise ValueError(f"no formula has {ast.unparse(node)}")
        sign, rank = _OPERATORS[type(node.op)]
        if rank < _POWER:
            return f"{inside(node.left, rank)} {sign} {inside(node.right, rank + 1)}", rank
        if self.power == "call":
            return f"pow({inside(node.left, _SUM)}, {inside(node.right, _SUM)})", _NAME
        return f"{inside(node.left, _NAME)} {self.power} {inside(node.right, _NAME)}", _POWER


def number(value: float) -> str:
    """A number that each of the languages reads as exactly this double."""
    return repr(float(value))


def context(subject: Subject, dialect: LanguageSyntax, *, left_out: tuple[Lack, ...]) -> dict[str, Any]:
    """What a template of source code is filled with.

    Parameters
    ----------
    subject
        The model.
    dialect
        The language.
    left_out
        What the form does not hold, for the head.
    """
    told, robot = subject.formulas, subject.formulas.robot
    n = robot.n_joints
    alphas = robot.alphas
    tables = {
        "twist": np.column_stack([np.cos(alphas), np.sin(alphas)]),
        "theta": np.array([joint.theta for joint in robot.joints]),
        "d": np.array([joint.d for joint in robot.joints]),
        "g": np.array(robot.gravity, dtype=float),
        "moments": told.moments,
        "ratios": told.ratios,
        "felt": told.felt,
        "coulomb": told.coulomb,
        "viscous": told.viscous,
        "shaft": told.shaft,
    }

    def written(joint: int, *, is_friction: bool) -> list[dict[str, Any]]:
        terms = told.of_joint(joint, is_friction=is_friction)
        return [{"joint": joint, "effect": term.effect, "text": dialect.text(term, n)} for term in terms]

    start, end, _ = dialect.brackets
    joints = range(1, n + 1)
    frictions = [(joint, written(joint, is_friction=True)) for joint in joints]
    return {name: dialect.table(values) for name, values in tables.items()} | {
        "name": subject.name,
        "NAME": subject.name.upper(),
        "n": n,
        "title": title(subject),
        "head": head(subject, left_out),
        "turns": f"{start}{', '.join(str(int(joint.is_revolute)) for joint in robot.joints)}{end}",
        "geared": bool((told.shaft != np.eye(n)).any()),
        "holds": [term for joint in joints for term in written(joint, is_friction=False)],
        "frictions": [(joint, terms) for joint, terms in frictions if terms],
        "uses_slope": told.uses("slope"),
        "uses_tilt": told.uses("tilt"),
        "uses_across": told.uses("across"),
        "uses_felt": told.uses("tilt") or told.uses("across"),
    }


def title(subject: Subject) -> str:
    """A line: which arm, by which program."""
    return commented(f"{subject.robot}: motor currents of gravity and friction, by pumaid {subject.version}.")


def head(subject: Subject, left_out: tuple[Lack, ...]) -> list[str]:
    """Lines for the head of a file: the model, its joints, what is left out, what the data did not tell."""
    told = subject.formulas
    digest = told.estimate.recipe_digest[:12]
    lines = [title(subject), f"Recipe {commented(told.robot.origin)} (SHA-256 {digest})." if digest else "", ""]
    lines.append("Joints: " + ", ".join(f"{joint.number} {commented(joint.name)}" for joint in told.robot.joints) + ".")
    effects = dict.fromkeys(term.effect for term in told.terms)
    lines += ["Beyond gravity, Coulomb and viscous friction: " + (", ".join(effects) if effects else "nothing") + "."]
    lines += ["", *listed("Left out:", left_out, nothing="Nothing of the model is left out.")]
    lines += ["", *listed("Not determined by the data, and so of the size that disturbs least:", told.undetermined)]
    return [part for line in lines for part in (textwrap.wrap(line, WIDTH, subsequent_indent="    ") or [""])]


def listed(start: str, lacks: tuple[Lack, ...], *, nothing: str = "Every parameter was determined.") -> list[str]:
    """A heading and a line for each of `lacks`."""
    return [start, *(f"  {commented(one.name)}: {commented(one.reason)}" for one in lacks)] if lacks else [nothing]
