"""The little of MATLAB that an export uses, turned into Python line by line, where no Octave is installed.

Arrays are called as MATLAB indexes them, from 1: ``z(i, :)``. What this does not know it refuses.
"""

import re
from collections.abc import Callable
from copy import deepcopy
from types import SimpleNamespace

import numpy as np


class Table(np.ndarray):
    """An array of numbers that counts from 1 and is indexed by calling."""

    def _places(self, keys):
        places = tuple(slice(None) if key is all else int(key) - 1 for key in keys)
        vector = len(places) == 1 and self.ndim == 2
        return np.unravel_index(places[0], self.shape) if vector and places[0] != slice(None) else places

    def __call__(self, *keys):
        return _result(self.ravel() if keys == (all,) else self[self._places(keys)])

    def store(self, keys, value) -> None:
        self[self._places(keys)] = value


def _result(found):
    return np.asarray(found, dtype=float).view(Table) if np.ndim(found) else float(found)


KNOWN = {name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "abs", "sign", "power")}
KNOWN |= {"max": np.maximum, "min": np.minimum, "floor": np.floor, "numel": np.size, "struct": SimpleNamespace}
KNOWN |= {"copied": deepcopy, "isempty": lambda values: np.size(values) == 0}
KNOWN |= {"cross": lambda a, b: _result(np.cross(a, b)), "dot": lambda a, b: float(np.sum(a * b))}
KNOWN |= {"zeros": lambda rows, width: _result(np.zeros(rows if width == 1 else (rows, width))), "literal": _result}


def as_python(text: str, name: str) -> Callable:
    """The function `name` of a MATLAB function file; it returns numpy arrays."""
    code = re.sub(r"%[^\n]*", "", text)
    code = re.sub(r"\[([^\[\]=]*)\](?!\s*=)", lambda found: _literal(found[1]), code)
    lines, indent, outputs, depth = [], 0, "", 0
    for line in filter(None, (line.strip().rstrip(";") for line in code.split("\n"))):
        word = line.split()[0]
        if word == "function":
            found = re.fullmatch(r"function (?:\[(.*)\]|(\w+)) = (\w+)\((.*)\)", line)
            outputs, depth, indent = found[1] or found[2], 0, 1
            given = ", ".join(f"{one}=None" for one in found[4].split(", ") if one)
            lines.append(f"def {found[3]}({given}):")
            names = found[4].replace(", ", " is not None, ")
            lines.append(f"    nargin = sum([{names} is not None])" if found[4] else "    c = struct()")
        elif word == "end" and depth == 0:
            lines.append(f"    return {outputs}")
        elif word == "end":
            depth, indent = depth - 1, indent - 1
        else:
            dedent = 1 if word in ("else", "elseif") else 0
            lines.append("    " * (indent - dedent) + _line(line))
            if word in ("if", "for"):
                depth, indent = depth + 1, indent + 1
    space: dict = dict(KNOWN)
    exec("\n".join(lines), space)

    def run(*given):
        return [np.asarray(one) for one in space[name](*map(_result, given))]

    return run


def _literal(inside: str) -> str:
    rows = [", ".join(row.split()) if "," not in row else row.strip() for row in inside.split(";")]
    return "literal((" + "".join(f"({row},)," for row in rows) + "))"


def _line(line: str) -> str:
    line = line.replace("~=", "!=").replace("||", "or").replace("&&", "and").replace("^", "**").replace(":)", "all)")
    line = line.replace("c.shaft * qd", "c.shaft @ qd")
    if line.startswith("error("):
        return f"raise ValueError({line[6:-1]})"
    if found := re.fullmatch(r"for (\w+) = (\w+):(\w+)", line):
        return f"for {found[1]} in range({found[2]}, {found[3]} + 1):"
    if found := re.fullmatch(r"\[(.*)\] = (.*)", line):
        return f"{found[1]} = {found[2]}"
    if found := re.fullmatch(r"(if|elseif) (.*)", line):
        return f"{'elif' if found[1] == 'elseif' else 'if'} {found[2]}:"
    if line == "else":
        return "else:"
    if found := re.fullmatch(r"(\w+) = ([a-z]\w*)", line):
        return f"{found[1]} = copied({found[2]})"
    if found := re.fullmatch(r"(\w+)\((.*?)\) = (.*)", line):
        return f"{found[1]}.store(({found[2]},), {found[3]})"
    return line
