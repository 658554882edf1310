"""Nothing that is read is ever run: no pickle, no eval, no YAML that builds objects, anywhere in the program."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "pumaid").rglob("*.py"))
#: Modules that turn bytes into code or objects with code, and calls that do.
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "code", "codeop", "jsonpickle"}
#: Formulas of effects are code of the package, or of a file of effects that the user names; no data becomes one.
FORMULAS = ROOT / "pumaid" / "effects" / "formula.py"
CALLS = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "pd.read_pickle", "yaml.unsafe_load"}


def forbidden(path: Path) -> list[str]:
    """Imports and calls of a file that could run what was read."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [name.name for name in node.names] if isinstance(node, ast.Import) else [str(node.module)]
            found += [name for name in names if name.split(".")[0] in MODULES]
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in CALLS:
            found.append(f"{ast.unparse(node.func)} on line {node.lineno}")
        elif isinstance(node, ast.keyword) and node.arg in ("allow_pickle", "shell"):
            found += [node.arg] if getattr(node.value, "value", True) is not False else []
    return found


def test_nothing_that_is_read_is_run():
    """No module of the program can turn a recipe, a log, a model or a plan into code."""
    assert {str(path): found for path in SOURCES if path != FORMULAS and (found := forbidden(path))} == {}


def test_yaml_is_read_safely():
    """Every YAML reader is the safe one in pure Python."""
    readers = [
        ast.unparse(node)
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("YAML")
    ]
    assert readers and all("typ='safe'" in reader or "typ='rt'" in reader for reader in readers), readers
