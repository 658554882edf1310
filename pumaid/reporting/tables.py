"""Tables of what was found: the paper's Table I first of all."""

from __future__ import annotations

import string
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from pumaid.effects import catalogue
from pumaid.records import IDENTIFIED, NOT_IDENTIFIABLE, Estimate, JointFit, Value
from pumaid.reporting.forms import Shown
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import in_unit, with_error
from pumaid.robot import Robot
from pumaid.units import number

#: Row of Table I -> (label, label in LaTeX). A row is an effect and its parameter's bare name.
_LABELS = {
    ("gravity", "x"): ("k_x·g", r"$k^*_x\,g$"),
    ("gravity", "y"): ("k_y·g", r"$k^*_y\,g$"),
    ("gravity", "mass"): ("m·g", r"$\hat m^*\,g$"),
    ("gain_ratio", ""): ("ηᵢ/ηᵢ₊₁", r"$\eta_i/\eta_{i+1}$"),
    ("coulomb", "plus"): ("λ₁⁺", r"$\lambda_{1+}$"),
    ("coulomb", "minus"): ("λ₁⁻", r"$\lambda_{1-}$"),
    ("viscous", "plus"): ("λ₂⁺", r"$\lambda_{2+}$"),
    ("viscous", "minus"): ("λ₂⁻", r"$\lambda_{2-}$"),
    ("inertia", "J"): ("J", r"$J$"),
}

#: Order of the rows of Table I; those of other effects follow.
_ORDER = list(_LABELS)

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def parameter_table(estimate: Estimate, robot: Robot, units: str = "rad") -> Shown:
    """The parameter table for the terminal, links as columns like the paper's Table I.

    Parameters
    ----------
    estimate
        The fitted model.
    robot
        Its arm.
    units
        ``"rad"`` or ``"deg"``: unit of angles in the table.

    Returns
    -------
    shown
        A rich renderable; cells that cannot be identified are marked and explained below it.
    """
    return Shown(parameter_grid(estimate, robot, units))


def sums_table(estimate: Estimate, units: str = "rad") -> Shown | None:
    """For the terminal: what is determined only together; the terms are in the model file and in the report.

    Parameters
    ----------
    estimate, units
        As in `parameter_table`.

    Returns
    -------
    shown
        A rich renderable, None where there is no such sum.
    """
    sums = combinations_grid(estimate, units)
    return None if sums is None else Shown(replace(sums.columns([0, 2, 3]), caption=""))


def parameter_grid(estimate: Estimate, robot: Robot, units: str = "rad") -> Grid:
    """The parameter table before it has a form; arguments as in `parameter_table`."""
    known = catalogue()
    rows: dict[tuple[str, str], dict[int, Value]] = {}
    for value in estimate.values:
        if value.joint is not None:
            rows.setdefault(row_of(value), {})[value.joint] = value
    notes = Notes()
    body = []
    for key in sorted(rows, key=place_of):
        label, tex = _label(key)
        weight = float(np.linalg.norm(robot.gravity)) if key[0] == "gravity" else 0.0
        unit = _row_unit(rows[key].values(), units, weight)
        head = Cell(f"{label} ({unit})" if unit else label, latex=f"{tex} ({unit})" if tex and unit else tex)
        cells = [
            value_cell(rows[key].get(joint), units=units, weight=weight, notes=notes)
            for joint in range(1, robot.n_joints + 1)
        ]
        body.append((head, *cells))
    body += _quality_rows(estimate.joints)
    sources = [f"g = {number(float(np.linalg.norm(robot.gravity)), 6)} m/s2"]
    others = dict.fromkeys(effect for effect, _ in rows if (effect, _) not in _ORDER)
    sources += [f"{name}: {known[name].title}" for name in others if name in known]
    return Grid(
        f"{robot.name}: parameters ± standard error",
        (Cell("link"), *(Cell(str(joint.number)) for joint in robot.joints)),
        tuple(body),
        notes.told(),
        f"All as current of the joint's own motor; {'; '.join(sources)}.{_of_arm(estimate, units)}",
    )


def _of_arm(estimate: Estimate, units: str) -> str:
    """Parameters of effects that are the whole arm's, which have no column."""
    told = []
    for value in estimate.values:
        if value.joint is None and not value.name.startswith("gain_ratio"):
            factor, unit = in_unit(value.unit, units)
            size = (
                None
                if value.value is None
                else " ± ".join(
                    text
                    for text in with_error(value.value * factor, value.std_error and value.std_error * factor)
                    if text
                )
            )
            told.append(f"{value.name} n/i ({value.reason})" if size is None else f"{value.name} {size} {unit}")
    return f" Of the whole arm: {'; '.join(told)}." if told else ""


class Notes:
    """The notes below a table: a letter for each reason, given once."""

    def __init__(self) -> None:
        self._letters: dict[str, str] = {}
        self._absent: dict[str, None] = {}

    def letter(self, value: Value) -> str:
        """The letter that stands for why `value` is not determined; ``-`` marks what no motion of the arm shows."""
        reason = value.reason or "these data do not determine it"
        if is_absent(value):
            self._absent[reason] = None
            return ""
        text = reason + (f"; to see it: {value.next_run}" if value.next_run else "")
        if text not in self._letters:
            place = len(self._letters)
            letters = string.ascii_lowercase
            self._letters[text] = letters[place % 26] * (place // 26 + 1)
        return self._letters[text]

    def told(self) -> tuple[tuple[str, str], ...]:
        """(mark, text) pairs."""
        lettered = tuple((letter, text) for text, letter in self._letters.items())
        return lettered + tuple(("-", text) for text in self._absent)


def row_of(value: Value) -> tuple[str, str]:
    """Effect and bare parameter name of a value: the row of the table in which it stands."""
    parts = value.name.split(".")
    if parts[0] != "gain_ratio":
        return parts[0], parts[-1]
    further = int(parts[2]) - int(parts[1])
    return parts[0], "" if further == 1 else str(further)


def place_of(row: tuple[str, str]) -> tuple[int, tuple[str, str]]:
    """By which rows are sorted: those of the paper's table first, in its order."""
    if row[0] == "gain_ratio":
        return (_ORDER.index(("gain_ratio", "")), row)
    return (_ORDER.index(row) if row in _ORDER else len(_ORDER), row)


def row_label(row: tuple[str, str]) -> str:
    """What a row of the table is called, without its unit."""
    return _label(row)[0]


def _label(row: tuple[str, str]) -> tuple[str, str]:
    """As text and in LaTeX; a ratio to a joint further out than the next says how much further."""
    if row[0] == "gain_ratio" and row[1]:
        return f"ηᵢ/ηᵢ₊{row[1].translate(_SUBSCRIPTS)}", rf"$\eta_i/\eta_{{i+{row[1]}}}$"
    return _LABELS.get(row, (" ".join(row), ""))


def is_absent(value: Value) -> bool:
    """Whether no motion of this arm could show it: not identifiable, and no run to propose."""
    return value.state == NOT_IDENTIFIABLE and value.next_run is None


def value_cell(value: Value | None, *, units: str, weight: float = 0.0, notes: Notes | None = None) -> Cell:
    """A value as a cell.

    Parameters
    ----------
    value
        None where the joint has no such parameter.
    units
        ``"rad"`` or ``"deg"``.
    weight
        Multiplies it where not zero (m/s2: the paper prints k g, a current).
    notes
        Collects the reason where it is not identifiable.
    """
    if value is None:
        return Cell("-", tone="absent")
    if value.value is None:
        mark = notes.letter(value) if notes else ""
        return Cell("-", tone="absent") if is_absent(value) else Cell("n/i", mark=mark, tone="unknown")
    times = in_unit(value.unit, units)[0] * (weight or 1.0)
    error = None if value.std_error is None else value.std_error * times
    text, told = with_error(value.value * times, error)
    is_weak = value.state == IDENTIFIED and value.ci95 is not None and value.ci95[0] < 0.0 < value.ci95[1]
    return Cell(text, told, tone="weak" if is_weak else "")


def _row_unit(values: Iterable[Value], units: str, weight: float) -> str:
    shown = dict.fromkeys("A" if weight else in_unit(value.unit, units)[1] for value in values)
    return " | ".join(unit for unit in shown if unit)


def _quality_rows(fits: Sequence[JointFit]) -> list[tuple[Cell, ...]]:
    """The lines below the parameters: what the model leaves, what no model could remove, and how much was seen."""

    def amount(value: float | None) -> Cell:
        return Cell("-", tone="absent") if value is None else Cell(number(value, 3))

    return [
        (Cell("RMSE (A)"), *(amount(fit.rmse) for fit in fits)),
        (Cell("noise floor (A)"), *(amount(fit.noise_floor) for fit in fits)),
        (Cell("runs"), *(Cell(str(fit.runs)) for fit in fits)),
    ]


def joints_grid(estimate: Estimate, robot: Robot) -> Grid:
    """How well each joint is fitted, and on what evidence."""
    rows = []
    for fit in estimate.joints:
        kinds = ", ".join(f"{count} {kind}" for kind, count in fit.kinds.items()) or "none"
        level = "-" if fit.run_level is None else number(fit.run_level, 3)
        floor = "-" if fit.noise_floor is None else number(fit.noise_floor, 3)
        rmse = "-" if fit.rmse is None else number(fit.rmse, 3)
        title = f"{fit.joint} {robot.joint(fit.joint).name}"
        rows.append([title, kinds, str(fit.posture_groups), f"{fit.samples:,}", rmse, floor, level])
    header = ("joint", "runs", "postures", "samples", "RMSE (A)", "noise floor (A)", "run level (A)")
    notes = dict.fromkeys(fit.noise_floor_reason for fit in estimate.joints if fit.noise_floor_reason and fit.runs)
    return grid(
        "Fit by joint",
        header,
        rows,
        notes=tuple(("-", reason) for reason in notes),
        caption="Noise floor: what repeated runs differ by; no model goes below it. Run level: how far whole runs lie"
        " apart for no reason that the model knows.",
        lefts=(0, 1),
    )


def _sum(terms: dict[str, float]) -> str:
    """Weighted terms as a sum; those below a thousandth of the largest weight are left out."""
    largest = max((abs(weight) for weight in terms.values()), default=0.0)
    out = ""
    for name, weight in terms.items():
        if abs(weight) >= 1e-3 * largest > 0.0:
            sign = (" − " if weight < 0 else " + ") if out else ("−" if weight < 0 else "")
            out += f"{sign}{number(abs(weight), 4)}·{name}"
    return out


def combinations_grid(estimate: Estimate, units: str = "rad") -> Grid | None:
    """Sums of parameters that are determined although their terms are not; None where there is none."""
    rows: list[list[str | Cell]] = []
    for found in estimate.combinations:
        text, error = with_error(found.value, found.std_error)
        rows.append([found.text, Cell(_sum(found.terms)), Cell(text, error), found.unit])
    if not rows:
        return None
    caption = "Weights are in SI units (those below a thousandth left out); these data do not tell the terms apart."
    return grid("Determined only together", ("what", "sum", "value", "unit"), rows, caption=caption, lefts=(0, 1, 3))
