"""docs/faults.md lists the classes that are tried, with their numbers."""

from __future__ import annotations

import re
from pathlib import Path

from faulty_table import tried

PAGE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| ([^|]+?) \| (\d+) \| *(\d*) \| *(\d*) \| *(\d*) \|$", PAGE, re.MULTILINE)

#: Every class that the program is held to; the names of some say more on the page.
CLASSES = (
    *(
        "empty file",
        "header only",
        "cut Parquet",
        "wrong magic",
        "NaN, inf, text",
        "missing columns",
        "doubled columns",
    ),
    *("renamed columns", "swapped columns", "shuffled rows", "repeated time", "backward time", "gaps", "jitter"),
    *("constant current", "saturated current", "degrees for radians", "wrong joint count", "one joint missing"),
    *("mixed rates", "other robot's log", "byte order marks", "CRLF", "semicolons and decimal commas"),
    *("headers of gigabytes", "huge numbers", "deep YAML", "YAML bombs", "YAML tags", "duplicate keys"),
    *("symbolic links", "unreadable files", "read-only results folder", "full disk", "names with spaces and unicode"),
    *("thousands of files", "a pipe closed early"),
)


def test_the_table_is_of_what_is_tried():
    """Each class of mutations stands there with as many as there are, and the three ends sum up to them."""
    counts = {name: int(number) for name, number, *_ in ROWS}
    assert counts.pop("all") == sum(counts.values()) == tried().total() >= 300
    assert counts == dict(tried())
    assert all(int(number) == sum(int(end or 0) for end in ends) for _, number, *ends in ROWS)


def test_every_class_is_there():
    """No class of faults is left out."""
    table = "\n".join(line for line in PAGE.splitlines() if line.startswith("|"))
    assert [name for name in CLASSES if name not in table] == []
