"""docs/contributing.md holds: an effect, a log format, a report section, an export are one new file each."""

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
from pumaid.effects import catalogue
from pumaid.exports import every_form, export
from pumaid.io.formats import log_formats
from pumaid.io.log_reader import LogReader
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.reporting.page import all_contents, all_figures, page
from pumaid.reporting.table import environment

EFFECT = '''
"""A dummy."""
from pumaid.effects import Effect, Family, Parameter, Trace

class Dummy(Effect):
    """A current with the cube of the position."""
    title, formula, source, family, trace = "Dummy", "a * q ** 3", "chapter 1", Family.TORQUE, (Trace.POSITION,)

    def parameters(self, robot, number):
        return (Parameter("a", "A/{unit}3", "size", "a{n}", 0.1),)
'''
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
from pumaid.exports.base import Form

class Dummy(Form):
    """The ratios alone."""

    def texts(self, subject):
        return {".txt": repr(subject.formulas.ratios.tolist())}
'''


@pytest.fixture
def added(tmp_path, monkeypatch):
    """A function that has a file found in a package's folder, as if it stood there."""
    caches = (catalogue, pumaid.effects._built_in, every_form, log_formats, environment)

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
    added(pumaid.effects, EFFECT)
    told = run("effects", "dummy").stdout
    assert "dummy" in catalogue() and "a q^3" in told and "--add dummy@" in told


def test_a_log_format_is_one_file(added, tmp_path):
    """A file of it is read like any log."""
    added(pumaid.io.formats, LOG_FORMAT)
    robot = read_recipe(shipped_recipes()["pendulum2"])
    names = ["t", "q1", "q2", "i1", "i2"]
    rows = np.column_stack([np.arange(50) * 0.01, *np.random.default_rng(0).normal(size=(4, 50))])
    path = tmp_path / "session.dummy"
    path.write_text("DUMMY\n" + " ".join(names) + "\n" + "\n".join(" ".join(map(str, row)) for row in rows))
    (log,) = LogReader(path, robot)
    assert np.allclose(log.current, rows[:, 3:])


def test_a_report_section_is_one_file_and_its_template(added, context, tmp_path, monkeypatch):
    """It stands on the page at the place that its order says."""
    added(pumaid.reporting.page, SECTION)
    (tmp_path / "dummy.html").write_text("<p>{{ words }}</p>", encoding="utf-8")
    package = jinja2.PackageLoader
    both = lambda name: jinja2.ChoiceLoader([package(name), jinja2.FileSystemLoader(tmp_path)])  # noqa: E731
    monkeypatch.setattr(jinja2, "PackageLoader", both)
    contents = all_contents(context)
    text = page(context, contents, dict.fromkeys((drawing.name for drawing in all_figures(contents)), "<svg/>"))
    assert "Dummy section" in text and f"This is {context.robot.name}." in text


def test_an_export_is_one_file(added, context):
    """It is a form like any other."""
    added(pumaid.exports.formats, FORM)
    assert export(context.estimate, context.robot, form="dummy").files[".txt"].startswith("[[1.0")


def test_the_page_names_each():
    """The page walks through each kind, each within a screenful of forty lines but for the effect's table."""
    text = (Path(__file__).parents[2] / "docs" / "contributing.md").read_text(encoding="utf-8")
    parts = dict(part.partition("\n")[::2] for part in text.split("\n## ")[1:])
    assert {"An effect", "A log format", "A report section", "An export", "The noise of a run"} <= set(parts)
    assert all(len(part.splitlines()) <= 40 for name, part in parts.items() if name != "An effect")
