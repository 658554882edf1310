"""YAML that remembers its lines."""

from __future__ import annotations

from pathlib import Path

import pytest

from pumaid.errors import ModelError
from pumaid.io.forms import nearest, read_yaml

TEXT = "name: x\nlist:\n  - a: 1\n  - a: 2\n    b: [1.5,\n        true]\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "some.yaml"
    path.write_text(TEXT)
    return path


def test_plain_values(file: Path) -> None:
    """Numbers, truth values and text come as in any YAML 1.2 reader."""
    assert read_yaml(file).data == {"name": "x", "list": [{"a": 1}, {"a": 2, "b": [1.5, True]}]}


@pytest.mark.parametrize(
    ("path", "line"),
    [((), 1), (("list",), 2), (("list", 1), 4), (("list", 1, "b"), 5), (("list", 1, "b", 1), 6), (("list", 1, "c"), 4)],
)
def test_lines(file: Path, path: tuple, line: int) -> None:
    """Every value knows its line; what is not there has the line of what it is missing from."""
    assert read_yaml(file).line_of(path) == line


def test_a_key_twice_is_kept_as_a_fault(tmp_path: Path) -> None:
    """A doubled key is not an error of reading, so that other faults can be told with it."""
    path = tmp_path / "twice.yaml"
    path.write_text("a: 1\nb: 2\na: 3\n")
    (fault,) = read_yaml(path).doubled
    assert (fault.where.line, fault.slug) == (3, "recipe-bad-key")


def test_the_error_is_of_the_kind_asked_for(tmp_path: Path) -> None:
    """A reader of plans is refused with the plan's kind of error."""
    with pytest.raises(ModelError):
        read_yaml(tmp_path / "absent.yaml", kind=ModelError)


@pytest.mark.parametrize(
    ("word", "found"), [("revolut", "revolute"), ("Prismatc", "prismatic"), ("LIMITS", "limits"), ("xyzzy", None)]
)
def test_nearest(word: str, found: str | None) -> None:
    """The nearest known word, or none where nothing is near."""
    assert nearest(word, ["revolute", "prismatic", "limits"]) == found
