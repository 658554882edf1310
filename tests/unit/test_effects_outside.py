"""Effects from outside the package: a file that is named, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from command import run

import pumaid.effects
from pumaid.effects import catalogue, include
from pumaid.effects.plugins import ARM, breach, column_checks, example
from pumaid.errors import ModelError

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
