"""One formula, written once as text, in the syntax of several languages."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

#: How each function of a formula is called in a language.
C_NAMES = {"sin": "sin", "cos": "cos", "exp": "exp", "sqrt": "sqrt", "abs": "fabs", "max": "fmax"}
NUMPY_NAMES = {name: f"np.{name}" for name in ("sin", "cos", "exp", "sqrt", "abs")} | {"max": "np.maximum"}
MATLAB_NAMES = {name: name for name in C_NAMES}

_OPERATORS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_ATOM, _POWER, _MINUS, _PRODUCT, _SUM = 4, 3, 2, 1, 0
_RANKS: dict[type[ast.operator], int] = {
    ast.Add: _SUM,
    ast.Sub: _SUM,
    ast.Mult: _PRODUCT,
    ast.Div: _PRODUCT,
    ast.Pow: _POWER,
}


@dataclass(frozen=True, slots=True)
class Language:
    """How a formula is written: names of functions, what a power looks like, names of the quantities.

    Attributes
    ----------
    functions
        Name in a formula -> name in the language.
    power
        ``call`` for ``pow(x, y)``, else the operator.
    quantities
        Name in a formula -> text in the language; a name that is not here stays as it is.
    """

    functions: Mapping[str, str]
    power: str
    quantities: Mapping[str, str]

    def written(self, formula: str) -> str:
        """`formula` in this language.

        Parameters
        ----------
        formula
            Sums, products, powers and the functions sin, cos, exp, sqrt, abs, max in Python's syntax.
        """
        return self._node(ast.parse(formula, mode="eval").body)[0]

    def _node(self, node: ast.expr) -> tuple[str, int]:
        """Text and how tightly it binds."""
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return number(node.value), _ATOM
        if isinstance(node, ast.Name):
            return self.quantities.get(node.id, node.id), _ATOM
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return f"-{self._inside(node.operand, _POWER)}", _MINUS
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.functions:
            arguments = ", ".join(self._node(one)[0] for one in node.args)
            return f"{self.functions[node.func.id]}({arguments})", _ATOM
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return self._operation(node)
        raise ValueError(f"no formula has {ast.unparse(node)}")

    def _operation(self, node: ast.BinOp) -> tuple[str, int]:
        rank = _RANKS[type(node.op)]
        if rank == _POWER:
            if self.power == "call":
                return f"pow({self._node(node.left)[0]}, {self._node(node.right)[0]})", _ATOM
            return f"{self._inside(node.left, _ATOM)} {self.power} {self._inside(node.right, _ATOM)}", _POWER
        left, right = self._inside(node.left, rank), self._inside(node.right, rank + 1)
        return f"{left} {_OPERATORS[type(node.op)]} {right}", rank

    def _inside(self, node: ast.expr, needed: int) -> str:
        text, rank = self._node(node)
        return text if rank >= needed else f"({text})"


class _Filled(ast.NodeTransformer):
    """Names that have a value become numbers; names of functions stay."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values = values

    def visit_Call(self, node: ast.Call) -> ast.expr:
        node.args = [self.visit(one) for one in node.args]
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id not in self.values:
            return node
        value = float(self.values[node.id])
        size = ast.Constant(abs(value))
        return ast.UnaryOp(ast.USub(), size) if value < 0.0 else size


def filled(formula: str, values: Mapping[str, float]) -> str:
    """`formula` with numbers, none of them rounded, in place of the names that have one.

    Parameters
    ----------
    formula
        As for `Language.written`.
    values
        By name; all finite.
    """
    return ast.unparse(ast.fix_missing_locations(_Filled(values).visit(ast.parse(formula, mode="eval"))))


def number(value: float) -> str:
    """A number that each of the languages reads as exactly this double."""
    return repr(float(value))
