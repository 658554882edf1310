"""The house: layers, budgets, docstrings, start-up and forbidden things, read from the source itself."""

from __future__ import annotations

import ast
import graphlib
import inspect
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import pumaid
from pumaid.effects import Effect, catalogue

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pumaid"

#: Room -> the rooms that it may import, itself where it is named.
BASE = {"errors", "units", "maths", "records"}
LAWS = BASE | {"files", "effects", "motion"}
MODEL = {"model", "structure", "system", "reasons", "reporting"}
ROOMS = {
    "errors": set(),
    "units": set(),
    "maths": {"errors", "units", "maths"},
    "records": BASE,
    "files": BASE | {"files"},
    "effects": BASE | {"effects"},
    "motion": BASE | {"motion"},
    **dict.fromkeys(MODEL, LAWS | MODEL),
    "virtual": LAWS | {"virtual"},
    "verbs": LAWS | MODEL | {"virtual"},
    "show": BASE | {"effects", "show"},
    "cli": LAWS | MODEL | {"virtual", "verbs", "show", "cli"},
    "__main__": {"cli"},
}
LONGEST_MODULE, LONGEST_FUNCTION, MOST_POSITIONAL, DEEPEST = 350, 50, 3, 3
HEAVY = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "ruamel", "jinja2")
SOURCES = sorted(PACKAGE.rglob("*.py"))
PROGRAMS = [*SOURCES, *sorted((ROOT / "tools").glob("*.py"))]


def named(path: Path) -> str:
    """A file's path as a test's name."""
    return str(path.relative_to(ROOT))


every_source = pytest.mark.parametrize("path", SOURCES, ids=named)


@cache
def tree(path: Path) -> ast.Module:
    """A file's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


def module_name(path: Path) -> str:
    """``pumaid/records/run.py`` -> ``pumaid.records.run``."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in SOURCES}


def imports(path: Path, *, only_top: bool = False) -> Iterator[str]:
    """Modules that a file imports, anywhere in it or at its top; ``from a import b`` is a.b where that is a module."""
    for node in tree(path).body if only_top else ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            for name in node.names:
                whole = f"{node.module}.{name.name}"
                yield whole if whole in MODULES or node.module == "pumaid" else str(node.module)


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Every function and method of a file."""
    yield from (node for node in ast.walk(tree(path)) if isinstance(node, ast.FunctionDef))


def depth(node: ast.AST) -> int:
    """How deep blocks stand in each other below `node`; an elif is no deeper than its if."""
    blocks = (ast.If, ast.For, ast.While, ast.With, ast.Try, ast.Match)
    deepest = 0
    for child in ast.iter_child_nodes(node):
        chained = isinstance(node, ast.If) and isinstance(child, ast.If) and node.orelse == [child]
        inside = isinstance(child, blocks) and not chained
        if not isinstance(child, ast.FunctionDef | ast.ClassDef):
            deepest = max(deepest, depth(child) + inside)
    return deepest


def calls(path: Path) -> Iterator[tuple[str, int]]:
    """Dotted names that are called, with their lines."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node.lineno


@every_source
def test_imports_go_down(path):
    """A module imports only from the rooms below its own."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    if parts == ("__init__",):
        pytest.skip("the package's front door imports by name when asked")
    allowed = {f"pumaid.{room}" for room in ROOMS[parts[0]]}
    ours = [name for name in imports(path) if name.split(".")[0] == "pumaid" and name != "pumaid.__version__"]
    assert [name for name in ours if ".".join(name.split(".")[:2]) not in allowed] == []


def test_imports_are_absolute():
    """Every import names its module in full, so that the layer test sees it."""
    relative = [n for path in SOURCES for n in ast.walk(tree(path)) if isinstance(n, ast.ImportFrom) and n.level]
    assert relative == []


def test_verbs_do_not_import_verbs():
    """What two verbs need sinks a layer."""
    assert [
        path.name for path in PACKAGE.glob("verbs/*.py") for n in imports(path) if n.startswith("pumaid.verbs")
    ] == []


def test_no_cycles():
    """No module is imported, over however many steps, by one that it imports."""
    graph = {name: {used for used in imports(path) if used in MODULES} for name, path in MODULES.items()}
    graphlib.TopologicalSorter(graph).prepare()


@every_source
def test_module_budget(path):
    """A module is short enough to be read in one sitting."""
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST_MODULE


def length(function: ast.FunctionDef) -> int:
    """Lines of a function without its docstring and decorators."""
    first = function.body[0]
    told = ast.get_docstring(function, clean=False) is not None
    docstring = (first.end_lineno or 0) - first.lineno + 1 if told else 0
    return (function.end_lineno or 0) - function.lineno + 1 - docstring


@every_source
def test_function_budget(path):
    """A function fits on a screen, docstring apart."""
    assert {f.name: length(f) for f in functions(path) if length(f) > LONGEST_FUNCTION} == {}


@every_source
def test_nesting_budget(path):
    """Blocks do not stand deeper than three in each other."""
    assert {f.name: depth(f) for f in functions(path) if depth(f) > DEEPEST} == {}


@every_source
def test_positional_budget(path):
    """At most three arguments go by position, one more behind an underscore; click calls its commands by keyword."""
    crowded = {}
    if path.name == "errors.py":
        pytest.skip("an error takes slug, what, where and mend in the order in which they are printed")
    for function in functions(path):
        names = [a.arg for a in (*function.args.posonlyargs, *function.args.args) if a.arg not in ("self", "cls")]
        called_by_click = path.parent.name == "commands" and function.name == "command"
        if len(names) > MOST_POSITIONAL + (function.name[0] == "_") and not called_by_click:
            crowded[function.name] = names
    assert crowded == {}


def public(path: Path) -> Iterator[tuple[str, object]]:
    """Public classes, functions and methods that a module defines, contract methods' overrides left out."""
    module = sys.modules.get(module_name(path)) or __import__(module_name(path), fromlist=["_"])
    for name, thing in vars(module).items():
        if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(thing) or inspect.isfunction(thing):
            yield name, thing
        if inspect.isclass(thing):
            yield from methods(thing)


def methods(owner: type) -> Iterator[tuple[str, object]]:
    """Public methods and properties of a class that no class above it declares."""
    kinds = (property, classmethod, staticmethod)
    for name, held in vars(owner).items():
        inherited = any(name in vars(base) for base in owner.__mro__[1:])
        if not name.startswith("_") and not inherited and (inspect.isroutine(held) or isinstance(held, kinds)):
            yield f"{owner.__name__}.{name}", held


@every_source
def test_docstrings(path):
    """Every public name says what it is."""
    if path.name == "__main__.py":
        pytest.skip("importing it runs the program")
    assert ast.get_docstring(tree(path)), "the module has none"
    assert [name for name, thing in public(path) if not inspect.getdoc(thing)] == []


def sections(thing: object) -> list[str]:
    """Names listed under ``Parameters`` of a docstring, in order; empty where there is no such section."""
    lines = (inspect.getdoc(thing) or "").splitlines()
    if "Parameters" not in lines:
        return []
    start = lines.index("Parameters") + 2
    ends = [n for n in range(start, len(lines) - 1) if lines[n + 1].startswith("---")]
    listed = [line for line in lines[start : ends[0] if ends else None] if line and not line.startswith(" ")]
    return [name.strip(" *") for line in listed for name in line.split(":")[0].split(",")]


@every_source
def test_docstrings_name_real_parameters(path):
    """A docstring's list of parameters is the function's own."""
    if path.name == "__main__.py":
        pytest.skip("importing it runs the program")
    wrong = {}
    for name, thing in public(path):
        told = sections(thing)
        if told and callable(thing):
            real = [one for one in inspect.signature(thing).parameters if one not in ("self", "cls", "args", "kwargs")]
            if told != [one for one in real if one in told] or (inspect.isfunction(thing) and set(told) != set(real)):
                wrong[name] = (told, real)
    assert wrong == {}


@pytest.mark.parametrize("path", PROGRAMS, ids=named)
def test_nothing_unfinished(path):
    """No stub, no note to oneself, no file whose name says nothing."""
    text = path.read_text(encoding="utf-8")
    assert [word for word in ("TODO", "FIXME", "XXX", "raise NotImplementedError") if word in text] == []
    assert path.stem not in ("utils", "helpers", "common", "misc")


@every_source
def test_library_neither_prints_nor_exits(path):
    """Library code raises or returns; only the command line talks and leaves."""
    if path.parent.name in ("cli", "commands") or path.name == "__main__.py":
        pytest.skip("the command line talks")
    loud = ("print", "exit", "quit", "sys.exit", "warnings.warn", "sys.stdout.write", "sys.stderr.write")
    assert [(name, line) for name, line in calls(path) if name in loud] == []
    assert [node.lineno for node in ast.walk(tree(path)) if isinstance(node, ast.Assert)] == []


@every_source
def test_only_the_command_line_catches_everything(path):
    """Nobody swallows our own bugs; the command line turns them into exit code 4."""
    if path.name == "failures.py":
        pytest.skip("this is the place")
    handlers = [node for node in ast.walk(tree(path)) if isinstance(node, ast.ExceptHandler)]
    broad = [n.lineno for n in handlers if n.type is None or ast.unparse(n.type) in ("Exception", "BaseException")]
    assert broad == []


@every_source
def test_randomness_and_clocks_are_passed(path):
    """Random numbers come from a generator; clocks are read only by the command line and by files."""
    known = ("np.random.default_rng", "np.random.Generator", "np.random.SeedSequence")
    assert [name for name, _ in calls(path) if name.startswith("np.random.") and name not in known] == []
    if path.relative_to(PACKAGE).parts[0] not in ("cli", "files"):
        clocks = (
            "time.time",
            "time.monotonic",
            "time.perf_counter",
            "datetime.now",
            "date.today",
            "datetime.datetime.now",
        )
        assert [name for name, _ in calls(path) if name in clocks] == []


@every_source
def test_degrees_live_in_units(path):
    """Only units.py turns degrees into radians and back."""
    turning = ("deg2rad", "rad2deg", "degrees", "radians")
    named_so = [(name, line) for name, line in calls(path) if name.split(".")[-1] in turning]
    assert path.name == "units.py" or named_so == []


def test_one_effect_a_file():
    """An effect's file holds one final effect and gives it its name."""
    files = {path.stem for path in (PACKAGE / "effects").glob("*.py")} - {"__init__", "base"}
    assert set(catalogue()) == files
    for name, effect in catalogue().items():
        defined = [
            node.name for node in tree(PACKAGE / "effects" / f"{name}.py").body if isinstance(node, ast.ClassDef)
        ]
        assert type(effect).__name__ in defined
        assert type(effect).__bases__ == (Effect,), f"{name} inherits from an effect"


@pytest.mark.parametrize("path", sorted((PACKAGE / "verbs").glob("[!_]*.py")), ids=named)
def test_one_verb_a_file(path):
    """A verb's file has one public function, of the file's name."""
    outside = [node.name for node in tree(path).body if isinstance(node, ast.FunctionDef) and node.name[0] != "_"]
    assert outside == [path.stem]


@pytest.mark.parametrize("path", sorted((PACKAGE / "cli" / "commands").glob("[!_]*.py")), ids=named)
def test_commands_are_light(path):
    """A command's file imports nothing of weight until it runs, and defines ``command``."""
    ours = ("pumaid.cli", "pumaid.errors", "pumaid.units", "pumaid.__version__")
    top = [name for name in imports(path, only_top=True) if name.split(".")[0] == "pumaid"]
    assert [name for name in top if not name.startswith(ours)] == []
    assert any(function.name == "command" for function in functions(path))


def test_help_imports_nothing_heavy():
    """``import pumaid`` and ``pumaid --help`` wait for none of the numerical libraries."""
    program = (
        "import sys, pumaid\n"
        "from pumaid.cli import group\n"
        "group.main(['--help'], standalone_mode=False)\n"
        f"sys.exit(','.join(name for name in {HEAVY!r} if name in sys.modules) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


PUBLIC = [
    *("Cells", "Combination", "Comparison", "EffectChoice", "Estimate", "Evidence", "Faults", "FileFacts", "Joint"),
    *("JointFit", "JointScore", "Log", "LogError", "LogFormat", "LogReader", "ModelError", "Motion", "Note"),
    *("OutsideScore", "Plan", "Posture", "PumaidError", "RecipeError", "Reject", "ResultError", "Robot", "Run"),
    *("RunScore", "Samples", "Value", "Where", "catalogue", "compare", "identify", "plan", "read_model"),
    *("read_recipe", "segment", "simulate", "write_model"),
]


def test_public_names_are_pinned():
    """What ``import pumaid`` offers changes only on purpose."""
    assert sorted(name for name in pumaid.__all__ if name != "__version__") == PUBLIC


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_are_there(name):
    """Every name that the package promises can be had from it."""
    assert getattr(pumaid, name).__name__ == name
