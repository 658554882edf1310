"""What a diagnosis says, letter by letter; records are written by hand, so nothing depends on the machine."""

from __future__ import annotations

import io
from pathlib import Path

import diagnoses
import pytest
from rich.console import Console

from pumaid.reporting.tables import diagnosis_parts

GOLD = Path(__file__).with_name("gold")
TOLD = {"rich": diagnoses.rich(), "clean": diagnoses.clean()}


@pytest.mark.parametrize("units", ["rad", "deg"])
@pytest.mark.parametrize("name", ["rich", "clean"])
def test_diagnosis(name, units):
    """Sentences, shape and tables of a diagnosis; a change is written beside the gold file, to be looked at."""
    out = io.StringIO()
    console = Console(file=out, width=100, color_system=None, highlight=False)
    for part in diagnosis_parts(TOLD[name], diagnoses.PUMA, units=units):
        console.print(part)
    made = "".join(f"{line.rstrip()}\n" for line in out.getvalue().splitlines())
    gold = GOLD / f"diagnosis_{name}_{units}.txt"
    actual = gold.with_name(f"{gold.name}.actual")
    if gold.is_file() and gold.read_text(encoding="utf-8") == made:
        actual.unlink(missing_ok=True)
        return
    actual.write_text(made, encoding="utf-8")
    pytest.fail(f"differs from {gold.name}; look at it, then accept: mv {actual} {gold}")
