"""Tables as they are printed, letter by letter; records are written by hand, so nothing depends on the machine."""

from __future__ import annotations

from pathlib import Path

import pytest
import report_contexts

from pumaid.reporting.documents import parameters_as

GOLD = Path(__file__).with_name("gold")


@pytest.mark.parametrize("units", ["rad", "deg"])
@pytest.mark.parametrize(("form", "suffix"), [("text", "txt"), ("markdown", "md"), ("latex", "tex"), ("csv", "csv")])
def test_parameter_table(form, suffix, units):
    """Table I of the paper in every readable form; a change is written beside the gold file, to be looked at."""
    told = report_contexts.table_one()
    made = parameters_as(told.estimate, told.robot, form, units=units)
    gold = GOLD / f"table1_{units}.{suffix}"
    actual = gold.with_name(f"{gold.name}.actual")
    if gold.is_file() and gold.read_bytes() == made:
        actual.unlink(missing_ok=True)
        return
    actual.parent.mkdir(exist_ok=True)
    actual.write_bytes(made)
    pytest.fail(f"differs from {gold.name}; look at it, then accept: mv {actual} {gold}")
