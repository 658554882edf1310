"""Files from outside: effects that are named and what is refused of them; and what docs/contributing.md promises."""

import re
import sys
from pathlib import Path

import jinja2
import numpy as np
import pytest
from command import run

import pumaid.effects
import pumaid.exports.formats
import pumaid.io.formats
import pumaid.reporting.page
from pumaid.effects import ARM, breach, catalogue, column_checks, example, include
from pumaid.errors import ModelError
from pumaid.exports import every_form, export
from pumaid.io.formats import log_formats
from pumaid.io.log_reader import LogReader
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.reporting.page import all_contents, all_figures, page
from pumaid.reporting.table import environment

PAGE = Path(__file__).parents[2] / "docs" / "contributing.md"
#: The example of the manual.
CHURNING = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
#: An effect as short as it may be.
SHORT = """
from pumaid.effects import Effect, Family, Parameter, Trace
import numpy as np

class Square(Effect):
    title, equation, source, family, trace = "t", "c q^2", "a book, 1999", Family.POSITION, (Trace.POSITION,)
    def parameters(self, robot, number):
        return (Parameter("c", "A/rad2", "m", "c", 0.1),)
    def columns(self, robot, samples, *, number=None, shape=None):
        return samples.position[:, samples.joint - 1][:, None] ** 2
"""


@pytest.fixture(autouse=True)
def own_catalogue(monkeypatch):
    """What a test includes is gone after it."""
    monkeypatch.setattr(pumaid.effects, "_INCLUDED", {})
    catalogue.cache_clear()
    yield
    catalogue.cache_clear()


@pytest.fixture
def written(tmp_path):
    """A function that writes a file of effects."""

    def write(text: str, name: str = "square.py") -> Path:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return write


def test_a_file_joins_the_catalogue(written):
    """A file that is included is an effect of its name, and the rest of the catalogue stays."""
    before = set(catalogue())
    path = written(SHORT)
    effect = include(path)
    assert set(catalogue()) == before | {"square"} and catalogue()["square"] is effect
    path.write_text("raise ValueError", encoding="utf-8")
    assert include(path) is effect  # named twice, it is not run again


def test_the_manuals_example_is_an_effect(written):
    """The example of the manual keeps the contract and has its peak at the speed that its shape says."""
    effect = include(written(CHURNING, "churning.py"))
    seen = example(1, with_loads=False)
    speeds = np.linspace(0.05, 1.0, len(seen))
    velocity = np.zeros_like(seen.velocity)
    velocity[:, 0] = speeds
    samples = pumaid.Samples(1, seen.position, velocity, direction=np.ones(len(seen)))
    current = effect.columns(ARM, samples, shape={"speed": 0.5})
    assert speeds[current[:, 0].argmax()] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("name", "text", "slug", "word"),
    [
        ("square.py", "", "effect-file", "not none"),
        ("square.py", SHORT + SHORT.replace("Square", "Other"), "effect-file", "Square, Other"),
        ("square.py", "import a_module_that_is_not_there", "effect-file", "ModuleNotFoundError"),
        ("square.py", "class Own(Exception): ...\nraise Own('no licence')", "effect-file", "Own: no licence"),
        ("square.py", "raise SystemExit(0)", "effect-file", "SystemExit: 0"),
        ("square.py", "def broken(:\n", "effect-file", "SyntaxError"),
        ("square.py", SHORT + "\nclass Child(Square): ...\n", "effect-file", "not Square, Child"),
        ("Square.py", SHORT, "effect-file", ""),
        ("square.txt", SHORT, "effect-file", ""),
        ("absent.py", None, "effect-file", ""),
        ("stribeck.py", SHORT, "effect-taken", ""),
        ("base.py", SHORT, "effect-taken", ""),
    ],
)
def test_no_effect_in_the_file(written, tmp_path, name, text, slug, word):
    """What cannot be run, does not hold one effect, is not there, or has a name that none can have or one has."""
    path = tmp_path / name if text is None else written(text, name)
    with pytest.raises(ModelError) as told:
        include(path)
    assert told.value.slug == slug and word in str(told.value) and path.name in str(told.value)
    assert "square" not in catalogue()


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("    def columns", '    formula = "c * q ** power"\n    def columns', "power"),
        ("    def columns", '    formula = "c ** 2 * q"\n    def columns', "not linear"),
        ("    def columns", '    formula = "c * q"\n    def columns', "not what its columns say"),
        ('"c q^2"', '""', "equation"),
        ('"t"', "None", "title"),
        ("(Trace.POSITION,)", "('position',)", "trace"),
        ("0.1),)", "0.1, 0.5, 0.9),)", "not between"),
        ('return (Parameter("c", "A/rad2", "m", "c", 0.1),)', "return ()", "no parameters"),
        (" ** 2", " / abs(samples.position).max()", "which other instants"),
        ("[:, None] ** 2", "", "(24,)"),
        ("return samples.position[:", "return samples.temperature[:, None] * samples.position[:", "not all finite"),
        ("return samples.position[:", "samples.position[0] = 0\n        return samples.position[:", "read-only"),
        ("return samples.pos", "return samples.loads.moving[:, None] * samples.pos", "needs_loads = True"),
        ("    def parameters", '    look_alikes = ("nobody",)\n    def parameters', "nobody"),
        ("    def parameters", "    base = True\n    def parameters", "base"),
        ("    def parameters", "    def grid(self, robot, extent):\n        return ()\n    def parameters", "grid"),
    ],
)
def test_a_broken_promise_is_told(written, old, new, word):
    """What an effect promises and does not keep is said in words."""
    assert old in SHORT
    with pytest.raises(ModelError) as told:
        include(written(SHORT.replace(old, new)))
    assert told.value.slug == "effect-contract" and word in str(told.value)


def test_shipped_effects_keep_the_contract():
    """What is asked of others holds for our own; of the paper's model, what its columns are."""
    for effect in catalogue().values():
        if effect.base:
            checks = [check for n in range(1, 7) for check in column_checks(effect, n, n)]
            assert not any(any(check.values()) for check in checks) and re.search(r"\d", effect.source)
        else:
            assert breach(effect, names=catalogue()) is None


def test_ctrl_c_stays_ctrl_c(written):
    """Who stops the program while a file is loaded has stopped the program."""
    with pytest.raises(KeyboardInterrupt):
        include(written("raise KeyboardInterrupt"))


def test_command_line_takes_files(written):
    """``pumaid effects NAME --effects FILE`` explains an effect that the user wrote; a broken one is refused."""
    path = written(CHURNING, "churning.py")
    shown = run("effects", "churning", "--effects", path).stdout
    assert "s a (v/speed)^2" in shown and "--add churning@" in shown
    assert "error[effect-file]" in run("effects", "--effects", written("x = "), code=3).stderr


LOG_FORMAT = '''
"""Numbers behind a line with their names."""
import numpy as np
from pumaid.io.formats import Batch, LogColumn, LogSource

class DummyLog(LogSource):
    """DUMMY, names, rows of numbers."""
    endings = (".dummy",)

    @classmethod
    def sniff(cls, head):
        return head.startswith(b"DUMMY")

    def schema(self):
        self._names = self.path.read_text().splitlines()[1].split()
        return [LogColumn(name) for name in self._names]

    def batches(self, names):
        rows = np.loadtxt(self.path, skiprows=2)
        places = [self._names.index(name) for name in names]
        yield Batch(3 + np.arange(len(rows)), rows[:, places].T.copy())
'''
SECTION = '''
"""A dummy."""
from pumaid.reporting.page import Section

def greeting(context):
    return {"words": f"This is {context.robot.name}."}

SECTIONS = (Section("dummy", "Dummy section", 1, greeting),)
'''
FORM = '''
"""A dummy."""
from pumaid.exports import Form

def ratios(subject):
    return {".txt": repr(subject.formulas.ratios.tolist())}, ()

FORMS = {"dummy": Form(ratios)}
'''


@pytest.fixture
def added(tmp_path, monkeypatch):
    """A function that has a file found in a package's folder, as if it stood there."""
    caches = (catalogue, every_form, log_formats, environment)

    def add(package, text: str, name: str = "dummy") -> None:
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
        monkeypatch.delitem(sys.modules, f"{package.__name__}.{name}", raising=False)
        for cache in caches:
            cache.cache_clear()

    yield add
    monkeypatch.undo()
    for package in (pumaid.effects, pumaid.io.formats, pumaid.reporting.page, pumaid.exports.formats):
        sys.modules.pop(f"{package.__name__}.dummy", None)
    for cache in caches:
        cache.cache_clear()


def test_an_effect_is_one_file(added):
    """It is in the catalogue, and the command line explains it."""
    added(pumaid.effects, SHORT)
    told = run("effects", "dummy").stdout
    assert "dummy" in catalogue() and "c q^2" in told and "--add dummy@" in told


def test_a_log_format_is_one_file(added, tmp_path):
    added(pumaid.io.formats, LOG_FORMAT)
    robot = read_recipe(shipped_recipes()["pendulum2"])
    names = ["t", "q1", "q2", "i1", "i2"]
    rows = np.column_stack([np.arange(50) * 0.01, *np.random.default_rng(0).normal(size=(4, 50))])
    path = tmp_path / "session.dummy"
    path.write_text("DUMMY\n" + " ".join(names) + "\n" + "\n".join(" ".join(map(str, row)) for row in rows))
    (log,) = LogReader(path, robot)
    assert np.allclose(log.current, rows[:, 3:])


def test_a_report_section_is_one_file_and_its_template(added, context, tmp_path, monkeypatch):
    added(pumaid.reporting.page, SECTION)
    (tmp_path / "dummy.html").write_text("<p>{{ words }}</p>", encoding="utf-8")
    package = jinja2.PackageLoader
    both = lambda name: jinja2.ChoiceLoader([package(name), jinja2.FileSystemLoader(tmp_path)])  # noqa: E731
    monkeypatch.setattr(jinja2, "PackageLoader", both)
    contents = all_contents(context)
    text = page(context, contents, dict.fromkeys((drawing.name for drawing in all_figures(contents)), "<svg/>"))
    assert "Dummy section" in text and f"This is {context.robot.name}." in text


def test_an_export_is_one_file(added, context, tmp_path):
    added(pumaid.exports.formats, FORM)
    assert export(context.estimate, context.robot, form="dummy").files[".txt"].startswith("[[1.0")
    model = tmp_path / "model.json"
    pumaid.write_model(model, context.estimate)
    told = run("export", str(model), "--format", "dummies", code=2).stderr
    assert "'dummies' is not one of c, dummy, json" in " ".join(told.split())


def test_the_page_names_each():
    """The page walks through each kind, each within a screenful of forty lines but for the effect's table."""
    parts = dict(part.partition("\n")[::2] for part in PAGE.read_text(encoding="utf-8").split("\n## ")[1:])
    assert {"An effect", "A log format", "A report section", "An export", "The noise of a run"} <= set(parts)
    assert all(len(part.splitlines()) <= 40 for name, part in parts.items() if name != "An effect")
