"""Everything that a report makes, as file names with their content; nothing is written here."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import pandas as pd
from rich.console import Console

from pumaid.records import Estimate
from pumaid.reporting.forms import Shown, latex, markdown
from pumaid.reporting.grid import Grid
from pumaid.reporting.numbers import in_unit
from pumaid.reporting.plots.style import INLINE, Drawing
from pumaid.reporting.report import page
from pumaid.reporting.scores import comparison_grid
from pumaid.reporting.story import Story
from pumaid.reporting.tables import parameter_grid
from pumaid.reporting.visible import Visible
from pumaid.robot import Robot

#: Forms of a table, with their suffix.
TABLE_FORMS = {"text": "txt", "csv": "csv", "parquet": "parquet", "latex": "tex", "markdown": "md", "json": "json"}

#: Forms of a figure.
FIGURE_FORMS = ("png", "svg", "pdf")

#: Forms in which a report keeps its tables.
_KEPT = ("csv", "parquet", "latex", "markdown")


def files_of(drawing: Drawing, forms: Sequence[str]) -> tuple[str, dict[str, bytes]]:
    """A figure's name, and its files by form, the page's own among them.

    Parameters
    ----------
    drawing
        What is drawn.
    forms
        Some of `FIGURE_FORMS`.
    """
    return drawing.name, drawing.files([*forms, INLINE])


def export(story: Story, figures: Iterable[tuple[str, dict[str, bytes]]]) -> Iterator[tuple[str, bytes]]:
    """Page, tables and figures of a story.

    Parameters
    ----------
    story
        What is told.
    figures
        All of its drawings as `files_of` makes them.

    Yields
    ------
    name, content
        Relative file name (``tables/parameters.csv``) and bytes; the page comes last.
    """
    for form in _KEPT:
        yield (
            f"tables/parameters.{TABLE_FORMS[form]}",
            parameters_as(story.estimate, story.robot, form, units=story.units),
        )
    for form in ("latex", "markdown"):
        grid = comparison_grid(story.comparison, story.robot)
        yield f"tables/comparison.{TABLE_FORMS[form]}", _grid_as(grid, form)
    for form in ("csv", "parquet"):
        yield f"tables/runs.{form}", _frame_as(runs_frame(story), form)
    inline = {}
    for figure, files in figures:
        inline[figure] = files[INLINE].decode("utf-8")
        yield from ((f"figures/{figure}.{form}", content) for form, content in files.items() if form != INLINE)
    yield "report.html", page(story, drawn=inline).encode("utf-8")


def parameters_as(estimate: Estimate, robot: Robot, form: str, *, units: str = "rad") -> bytes:
    """The parameter table as a file's content.

    Text, LaTeX and Markdown look like the paper's Table I; CSV, Parquet and JSON hold one row a parameter.

    Parameters
    ----------
    estimate, robot
        The model and its arm.
    form
        One of `TABLE_FORMS`.
    units
        ``"rad"`` or ``"deg"``.
    """
    if form in ("csv", "parquet", "json"):
        return _frame_as(parameters_frame(estimate, units), form)
    return _grid_as(parameter_grid(estimate, robot, units), form)


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
        times, unit = in_unit(value.unit, units)
        low, high = value.ci95 if value.ci95 is not None else (None, None)
        amounts = {"value": value.value, "std_error": value.std_error, "ci_low": low, "ci_high": high}
        scaled = {key: None if amount is None else times * amount for key, amount in amounts.items()}
        head = {"name": value.name, "symbol": value.symbol, "joint": value.joint, "unit": unit}
        tail = {"dof": value.dof, "state": value.state, "reason": value.reason, "next_run": value.next_run}
        rows.append(head | scaled | tail)
    frame = pd.DataFrame(rows)
    numbers = ["value", "std_error", "ci_low", "ci_high", "dof"]
    return frame.astype({**dict.fromkeys(numbers, "float64"), "joint": "Int64"})


def runs_frame(story: Story) -> pd.DataFrame:
    """One row a run: where it lies and how the model does on it; SI, postures in columns ``q1`` to ``qJ``."""
    rows = []
    for score in story.comparison.runs:
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
        rows.append(row | {f"q{number}": held for number, held in enumerate(run.posture, start=1)})
    return pd.DataFrame(rows)


def _frame_as(frame: pd.DataFrame, form: str) -> bytes:
    if form == "parquet":
        out = io.BytesIO()
        frame.to_parquet(out, index=False)
        return out.getvalue()
    if form == "json":
        records = json.loads(frame.to_json(orient="records", double_precision=15))
        return (json.dumps(records, indent=2, ensure_ascii=False) + "\n").encode("utf-8")
    return frame.to_csv(index=False, lineterminator="\n").encode("utf-8")


def _grid_as(grid: Grid, form: str) -> bytes:
    if form == "text":
        out = io.StringIO()
        Console(file=out, width=100, color_system=None).print(Visible(Shown(grid)))
        return "".join(f"{line.rstrip()}\n" for line in out.getvalue().splitlines()).encode("utf-8")
    return (latex(grid) if form == "latex" else markdown(grid)).encode("utf-8")
