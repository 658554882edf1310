"""The house: layers, budgets, docstrings, start-up and forbidden things, read from the source itself."""

import ast
import graphlib
import importlib.util
import inspect
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest
from ceilings import CEILINGS

import pumaid
from pumaid.effects import Effect, catalogue

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pumaid"

#: Rooms from the ground up; a module imports from its own room and from the rooms of floors below it.
FLOORS = (
    {"errors", "units"},
    {"maths", "robot", "trajectory"},
    {"dataset", "estimate"},
    {"effects", "io", "rigid_body"},
    {"preprocessing", "simulation"},
    {"joint_bins"},
    {"model", "effect_spec"},
    {"estimation"},
    {"exports", "results", "design"},
    {"diagnosis"},
    {"reporting"},
    {"experiment"},
    {"api", "cli"},
    {"__main__"},
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
#: Virtual robots state their physics apart from the effects that are to find it.
APART = {"simulation": {"effects", "preprocessing"}}
LONGEST_MODULE, LONGEST_FUNCTION, MOST_POSITIONAL, DEEPEST = 600, 60, 3, 3
HEAVY = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "ruamel", "jinja2")
SOURCES = sorted(PACKAGE.rglob("*.py"))
PROGRAMS = [*SOURCES, *sorted((ROOT / "tools").glob("*.py"))]


def offenders(rule: Callable[[Path], object], paths: Iterable[Path] = SOURCES) -> dict[str, object]:
    """What `rule` finds in each file, without the files in which it finds nothing."""
    found = {str(path.relative_to(ROOT)): rule(path) for path in paths}
    return {name: what for name, what in found.items() if what}


@cache
def tree(path: Path) -> ast.Module:
    """A file's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


def module_name(path: Path) -> str:
    """``pumaid/io/write.py`` -> ``pumaid.io.write``."""
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


def upward(path: Path) -> list[str]:
    """Imports from a floor above the file's own, or from a room that it stands apart from."""
    room = path.relative_to(PACKAGE).with_suffix("").parts[0]
    if room == "__init__":  # the package's front door imports by name when asked
        return []
    ours = [name for name in imports(path) if name.split(".")[0] == "pumaid" and name != "pumaid.__version__"]
    rooms = {name: name.split(".")[1] for name in ours}
    above = [name for name, other in rooms.items() if other != room and FLOOR[other] > FLOOR[room]]
    return above + [name for name, other in rooms.items() if other in APART.get(room, ())]


def test_no_cycles():
    """No module is imported, over however many steps, by one that it imports."""
    graph = {name: {used for used in imports(path) if used in MODULES} for name, path in MODULES.items()}
    assert set(graphlib.TopologicalSorter(graph).static_order()) >= set(MODULES)


def too_long(path: Path) -> int:
    """Lines of a module that cannot be read in one sitting."""
    lines = len(path.read_text(encoding="utf-8").splitlines())
    return lines if lines > LONGEST_MODULE else 0


def length(function: ast.FunctionDef) -> int:
    """Lines of a function, signature and docstring among them."""
    return (function.end_lineno or 0) - function.lineno + 1


def beyond_a_screen(path: Path) -> list[str]:
    """Functions that do not fit on a screen, or with blocks deeper than three in each other."""
    return [f.name for f in functions(path) if length(f) > LONGEST_FUNCTION or depth(f) > DEEPEST]


def crowded(path: Path) -> dict[str, int]:
    """Functions with more than three arguments by position (four behind an underscore), and how many."""
    # An error takes slug, what, where and mend in the order in which they are printed.
    counts = {}
    for function in functions(path) if path.name != "errors.py" else ():
        names = [a.arg for a in (*function.args.posonlyargs, *function.args.args) if a.arg not in ("self", "cls")]
        if len(names) > MOST_POSITIONAL + (function.name[0] == "_"):
            counts[function.name] = len(names)
    return counts


PRONOUNS = re.findall(r"\w+", "one own found known told seen kept left some every others each here most")


def statements(paths: Iterable[Path]) -> int:
    """Statements of some files, docstrings among them: what denser lines cannot make fewer."""
    return sum(isinstance(node, ast.stmt) for path in paths for node in ast.walk(tree(path)))


def lines(paths: Iterable[Path]) -> int:
    """Lines of some files."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def words(paths: Iterable[Path]) -> int:
    """Words of some documents."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in paths)


def import_depth() -> int:
    """Modules on the longest chain of imports at the top of files, the faces of packages left out."""
    faces = {name for name, path in MODULES.items() if path.name == "__init__.py"}
    graph = {
        name: {used for used in imports(path, only_top=True) if used in MODULES and used not in faces}
        for name, path in MODULES.items()
        if name not in faces
    }
    depths: dict[str, int] = {}
    for name in graphlib.TopologicalSorter(graph).static_order():
        depths[name] = 1 + max((depths[used] for used in graph[name]), default=0)
    return max(depths.values())


def class_names_twice() -> dict[str, list[str]]:
    """Names that several modules give to classes of theirs, an underscore in front or not."""
    homes: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name.lstrip("_"), []).append(str(path.relative_to(PACKAGE)))
    return {name: where for name, where in homes.items() if len(where) > 1}


def pronouns() -> int:
    """Variables that are bound to a pronoun."""
    names = (node for path in SOURCES for node in ast.walk(tree(path)) if isinstance(node, ast.Name))
    return sum(node.id in PRONOUNS for node in names if isinstance(node.ctx, ast.Store))


def test_whole_budget():
    """The house as a whole stays within what it may cost; `tests/ceilings.py` says what, and only ever falls."""
    checks = [*(ROOT / "tests").rglob("*.py"), *(ROOT / "tools").rglob("*.py")]
    documents = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    measured = {
        "lines": lines(SOURCES),
        "statements": statements(SOURCES),
        "modules": len([path for path in SOURCES if path.stat().st_size]),
        "import depth": import_depth(),
        "lines of tests and tools": lines(checks),
        "words of documents": words(documents),
        "class names with two meanings": len(class_names_twice()),
        "variables named by a pronoun": pronouns(),
    }
    over = {name: number for name, number in measured.items() if number > CEILINGS[name]}
    assert over == {}


def public(path: Path) -> Iterator[tuple[str, object]]:
    """Public classes, functions and methods that a module defines, overrides of contract methods left out."""
    if path.name == "__main__.py":  # importing it runs the program
        return
    module = importlib.import_module(module_name(path))
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


def undocumented(path: Path) -> list[str]:
    """Public names, or the module itself, that do not say what they are."""
    names = [name for name, thing in public(path) if not inspect.getdoc(thing)]
    return names if ast.get_docstring(tree(path)) else [path.stem, *names]


def misnamed(path: Path) -> dict[str, set[str]]:
    """Public functions whose list of parameters is not their own, and classes that list what they do not take."""
    wrong = {}
    for name, thing in public(path):
        section = re.search(r"\nParameters\n-+\n(.*?)(?=\n\w+\n---|\Z)", inspect.getdoc(thing) or "", re.DOTALL)
        if section and callable(thing):
            heads = re.findall(r"^\S.*$", section[1], re.MULTILINE)
            listed = {word.strip(" *") for head in heads for word in head.split(":")[0].split(",")}
            taken = set(inspect.signature(thing).parameters) - {"self", "cls"}
            strays = listed - taken if inspect.isclass(thing) else listed ^ taken
            wrong |= {name: strays} if strays else {}
    return wrong


def test_nothing_unfinished():
    assert offenders(lambda path: "raise NotImplementedError" in path.read_text(encoding="utf-8"), PROGRAMS) == {}
    assert [path for path in PROGRAMS if path.stem in ("utils", "helpers", "common", "misc")] == []


def loud(path: Path) -> list[tuple[str, int]]:
    """Calls that talk or leave, and asserts that do more than tell the type checker what cannot be."""
    if path.parent.name in ("cli", "commands") or path.name == "__main__.py":
        return []
    talking = ("print", "exit", "quit", "sys.exit", "warnings.warn", "sys.stdout.write", "sys.stderr.write")
    asserts = [node for node in ast.walk(tree(path)) if isinstance(node, ast.Assert)]
    strict = [node for node in asserts if not re.search(r" is not None|isinstance\(", ast.unparse(node.test))]
    return [call for call in calls(path) if call[0] in talking] + [("assert", node.lineno) for node in strict]


def hidden_sources(path: Path) -> list[str]:
    """Calls of numpy's global random state, and of clocks outside the command line and the files."""
    known = ("np.random.default_rng", "np.random.Generator", "np.random.SeedSequence")
    clocks = {"time.time", "time.monotonic", "time.perf_counter", "datetime.now", "date.today", "datetime.datetime.now"}
    may_look = path.relative_to(PACKAGE).parts[0] in ("cli", "io")
    names = [name for name, _ in calls(path)]
    return [n for n in names if (n.startswith("np.random.") and n not in known) or (n in clocks and not may_look)]


def turning(path: Path) -> list[tuple[str, int]]:
    """Calls that turn degrees into radians or back, which only units.py does."""
    words = ("deg2rad", "rad2deg", "degrees", "radians")
    return [call for call in calls(path) if call[0].split(".")[-1] in words and path.name != "units.py"]


def test_one_effect_a_file():
    """An effect's file holds one final effect and gives it its name."""
    files = {path.stem for path in (PACKAGE / "effects").glob("*.py")} - {"__init__", "base", "formula"}
    assert set(catalogue()) == files
    for name, effect in catalogue().items():
        defined = [
            node.name for node in tree(PACKAGE / "effects" / f"{name}.py").body if isinstance(node, ast.ClassDef)
        ]
        assert type(effect).__name__ in defined
        assert type(effect).__bases__ == (Effect,), f"{name} inherits from an effect"


def heavy_command(path: Path) -> list[str]:
    """Our own modules, beyond the light ones, that commands import before one runs."""
    if path.parent.name != "commands":
        return []
    light = ("pumaid.cli", "pumaid.errors", "pumaid.units", "pumaid.__version__")
    top = [name for name in imports(path, only_top=True) if name.split(".")[0] == "pumaid"]
    return [name for name in top if not name.startswith(light)]


RULES = (
    upward,
    too_long,
    beyond_a_screen,
    crowded,
    undocumented,
    misnamed,
    loud,
    hidden_sources,
    turning,
    heavy_command,
)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_no_file_breaks_a_rule(rule):
    assert offenders(rule) == {}


def test_help_imports_nothing_heavy():
    """``import pumaid``, ``--version`` and the help of every command wait for none of the numerical libraries."""
    program = (
        "import sys, pumaid\n"
        "from pumaid.cli import group\n"
        "for words in ['--version'], ['--help'], *([name, '--help'] for name in group.list_commands(None)):\n"
        "    group.main(words, standalone_mode=False)\n"
        f"sys.exit(','.join(name for name in {HEAVY!r} if name in sys.modules) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_dataset_needs_no_reader(tmp_path):
    """Where the dataset was written, a second command loads neither Arrow nor scipy's optimisers; none loads pandas."""
    arm = PACKAGE.parent / "sample_logs" / "pendulum"
    words = ["identify", str(arm / "logs"), "--recipe", str(arm / "recipe.yaml"), "--results", str(tmp_path)]
    program = (
        f"import sys\nfrom pumaid.cli import group\ngroup.main({words!r}, standalone_mode=False)\n"
        "heavy = 'pandas', 'pyarrow', 'scipy.optimize', 'scipy.ndimage'\n"
        "print(','.join(name for name in heavy if name in sys.modules))"
    )
    first, second = (
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.splitlines()
        for _ in range(2)
    )
    assert first[-1] == "pyarrow" and second[-1] == "" and first[:-1] == second[:-1]


PUBLIC = re.findall(
    r"\w+",
    """
    Answer Arm Bins Budget BudgetPart Candidate Combination Comparison Curve Dataset Diagnosis Drawing
    EffectChoice Estimate Exported Faults FileFacts Finding History Identified Joint JointDiagnosis JointFit
    JointScore Ladder Limit Log LogError LogFormat LogReader ModelError Motion NextRun Note Plan Posture
    PumaidError RecipeError Reject ResultError Robot Run RunScore Rung Samples Size Trajectory Unexplained Value
    Where catalogue compare diagnose export identify load plan read_diagnosis read_history read_model
    read_recipe segment simulate write_diagnosis write_model
    """,
)


def test_public_names_are_pinned():
    """What ``import pumaid`` offers changes only on purpose, and can be had from it."""
    assert sorted(name for name in pumaid.__all__ if name != "__version__") == PUBLIC
    assert [getattr(pumaid, name).__name__ for name in PUBLIC] == PUBLIC
