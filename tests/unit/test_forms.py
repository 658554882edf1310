"""YAML that remembers its lines."""

import pytest

from pumaid.errors import nearest
from pumaid.io.forms import parsed_yaml

TEXT = "name: x\nlist:\n  - a: 1\n  - a: 2\n    b: [1.5,\n        true]\n"


def test_plain_values() -> None:
    """Numbers, truth values and text come as in any YAML 1.2 reader."""
    assert parsed_yaml(TEXT.encode(), "x.yaml").data == {"name": "x", "list": [{"a": 1}, {"a": 2, "b": [1.5, True]}]}


@pytest.mark.parametrize(
    ("path", "line"),
    [((), 1), (("list",), 2), (("list", 1), 4), (("list", 1, "b"), 5), (("list", 1, "b", 1), 6), (("list", 1, "c"), 4)],
)
def test_lines(path: tuple, line: int) -> None:
    """Every value knows its line; what is not there has the line of what it is missing from."""
    assert parsed_yaml(TEXT.encode(), "x.yaml").line_of(path) == line


def test_a_key_twice_is_kept_as_a_fault() -> None:
    """A doubled key is not an error of reading, so that other faults can be told with it."""
    document = parsed_yaml(b"a: 1\nb: 2\na: 3\n", "twice.yaml")
    (fault,) = document.doubled
    assert (document.line_of(fault.path), fault.slug) == (3, "recipe-bad-key")


@pytest.mark.parametrize(
    ("word", "found"), [("revolut", "revolute"), ("Prismatc", "prismatic"), ("LIMITS", "limits"), ("xyzzy", None)]
)
def test_nearest(word: str, found: str | None) -> None:
    """The nearest known word, or none where nothing is near."""
    assert nearest(word, ["revolute", "prismatic", "limits"]) == found
