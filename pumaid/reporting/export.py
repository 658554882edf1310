"""Everything that a report writes, as file names with their content; nothing is written here."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator
from typing import Any

import pandas as pd

from pumaid.estimate import Estimate
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import INLINE
from pumaid.reporting.formatting import in_unit
from pumaid.reporting.page import page
from pumaid.reporting.table import Table
from pumaid.reporting.tables import comparison_table, parameter_table
from pumaid.robot import Robot

#: Forms of a table, with their suffix; those in which a report keeps its tables.
TABLE_FORMS = {"text": "txt", "csv": "csv", "parquet": "parquet", "latex": "tex", "markdown": "md", "json": "json"}
_REPORT_FORMS = ("csv", "parquet", "latex", "markdown")


def export(context: ReportContext, figures: Iterable[tuple[str, dict[str, bytes]]]) -> Iterator[tuple[str, bytes]]:
    """Page, tables and figures of a report.

    Parameters
    ----------
    context
        What it is made from.
    figures
        Name and content by form of all its figures, `INLINE` among the forms.

    Yields
    ------
    name, content
        Relative file name (``tables/parameters.csv``) and bytes; the page comes last.
    """
    for form in _REPORT_FORMS:
        content = parameters_as(context.estimate, context.robot, form, units=context.units)
        yield f"tables/parameters.{TABLE_FORMS[form]}", content
    for form in ("latex", "markdown"):
        table = comparison_table(context.comparison, context.robot)
        yield f"tables/comparison.{TABLE_FORMS[form]}", _table_as(table, form)
    for form in ("csv", "parquet"):
        yield f"tables/runs.{form}", _frame_as(runs_frame(context), form)
    inline = {}
    for name, files in figures:
        inline[name] = files[INLINE].decode("utf-8")
        yield from ((f"figures/{name}.{form}", content) for form, content in files.items() if form != INLINE)
    yield "report.html", page(context, inline=inline).encode("utf-8")


def parameters_as(estimate: Estimate, robot: Robot, form: str, *, units: str = "rad") -> bytes:
    """The parameter table as a file's content, in one of `TABLE_FORMS`.

    Text, LaTeX and Markdown look like the paper's Table I; CSV, Parquet and JSON hold one row a parameter.
    """
    if form in ("csv", "parquet", "json"):
        return _frame_as(parameters_frame(estimate, units), form)
    return _table_as(parameter_table(estimate, robot, units), form)


def _frame_as(frame: pd.DataFrame, form: str) -> bytes:
    if form == "parquet":
        out = io.BytesIO()
        frame.to_parquet(out, index=False)
        return out.getvalue()
    if form == "json":
        records = json.loads(frame.to_json(orient="records", double_precision=15))
        return (json.dumps(records, indent=2, ensure_ascii=False) + "\n").encode("utf-8")
    return frame.to_csv(index=False, lineterminator="\n").encode("utf-8")


def _table_as(table: Table, form: str) -> bytes:
    text = table.text() if form == "text" else table.latex() if form == "latex" else table.markdown()
    return text.encode("utf-8")


def parameters_frame(estimate: Estimate, units: str = "rad") -> pd.DataFrame:
    """One row a parameter.

    Parameters
    ----------
    estimate
        The model.
    units
        ``"rad"`` or ``"deg"``: angles in values and in the column `unit`.

    Returns
    -------
    frame
        Columns name, symbol, joint, unit, value, std_error, ci_low, ci_high, dof, state, reason, next_run; empty where
        a parameter is not identifiable.
    """
    rows: list[dict[str, Any]] = []
    for value in estimate.values:
        scale, unit = in_unit(value.unit, units)
        low, high = value.ci95 if value.ci95 is not None else (None, None)
        amounts = {"value": value.value, "std_error": value.std_error, "ci_low": low, "ci_high": high}
        scaled = {key: None if amount is None else scale * amount for key, amount in amounts.items()}
        head = {"name": value.name, "symbol": value.symbol, "joint": value.joint, "unit": unit}
        tail = {"dof": value.dof, "state": value.state, "reason": value.reason, "next_run": value.next_run}
        rows.append(head | scaled | tail)
    frame = pd.DataFrame(rows)
    numbers = ["value", "std_error", "ci_low", "ci_high", "dof"]
    return frame.astype({**dict.fromkeys(numbers, "float64"), "joint": "Int64"})


def runs_frame(context: ReportContext) -> pd.DataFrame:
    """One row a run: where it lies and how the model does on it; SI, postures in columns ``q1`` to ``qJ``."""
    rows = []
    for score in context.comparison.runs:
        run = score.run
        row: dict[str, Any] = {
            "joint": run.joint,
            "file": run.origin.encode("utf-8", "backslashreplace").decode("utf-8"),  # a name may be none of UTF-8
            "start_s": run.start,
            "duration_s": run.duration,
            "kind": run.kind,
            "speed": run.speed,
            "samples": run.samples,
            "rmse_A": score.rmse,
            "bias_A": score.bias,
            "largest_A": score.largest,
            "explained": score.explained,
            "heldout": run.heldout,
            "undetermined": score.undetermined,
        }
        rows.append(row | {f"q{number}": position for number, position in enumerate(run.posture, start=1)})
    return pd.DataFrame(rows)
