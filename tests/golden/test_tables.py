"""Tables and diagnoses as they are printed, letter by letter; records are written by hand, so no machine matters."""

from pathlib import Path

import diagnoses
import pytest
import report_contexts

from pumaid.reporting.diagnosis import diagnosis_parts
from pumaid.reporting.documents import parameters_frame
from pumaid.reporting.tables import parameter_table

GOLD = Path(__file__).with_name("gold")


def check(name: str, made: bytes) -> None:
    """Hold a text against its gold file; a change is written beside it, to be looked at."""
    gold = GOLD / name
    actual = gold.with_name(f"{name}.actual")
    if gold.is_file() and gold.read_bytes() == made:
        actual.unlink(missing_ok=True)
        return
    actual.write_bytes(made)
    pytest.fail(f"differs from {name}; look at it, then accept: mv {actual} {gold}")


@pytest.mark.parametrize("units", ["rad", "deg"])
def test_parameter_table(units):
    paper = report_contexts.table_one()
    table = parameter_table(paper.estimate, paper.robot, units)
    for suffix, text in (("txt", report_contexts.printed(table)), ("md", table.markdown()), ("tex", table.latex())):
        check(f"table1_{units}.{suffix}", text.encode())
    check(f"table1_{units}.csv", parameters_frame(paper.estimate, units).to_csv(index=False).encode())


@pytest.mark.parametrize("units", ["rad", "deg"])
@pytest.mark.parametrize("name", ["rich", "clean"])
def test_diagnosis(name, units):
    parts = diagnosis_parts(getattr(diagnoses, name)(), diagnoses.PUMA, units=units)
    check(f"diagnosis_{name}_{units}.txt", report_contexts.printed(*parts).encode())
