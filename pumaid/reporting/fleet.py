"""A fleet as tables: its robots, and the parameters in which they differ."""

from __future__ import annotations

from collections.abc import Sequence

from pumaid.records import Fleet, Shared
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import in_unit, with_error
from pumaid.units import number

#: Robots that all have a column; of more, those that stand out.
_FEW = 8


def robots_grid(fleet: Fleet) -> Grid:
    """A row a robot: runs, errors of its model by joint, in how many parameters it stands out."""
    most = max(len(one.joints) for one in fleet.robots.values())
    rows: list[list[str | Cell]] = []
    for name, one in fleet.robots.items():
        runs = sum(joint.runs for joint in one.joints)
        apart = sum(member.stands_out for shared in fleet.shared for member in shared.members if member.robot == name)
        errors = [
            Cell("-", tone="absent") if joint.rmse is None else Cell(number(joint.rmse, 3)) for joint in one.joints
        ]
        told = Cell(str(apart), tone="alarm") if apart else Cell("-", tone="absent")
        rows.append([name, str(runs), *errors, *[""] * (most - len(errors)), told])
    header = ["robot", "runs", *(f"RMSE {joint} (A)" for joint in range(1, most + 1)), "stands out in"]
    return grid("Robots", header, rows)


def differences_grid(fleet: Fleet, units: str = "rad") -> Grid:
    """A row a parameter in which robots differ or one stands out; robots as columns.

    Parameters
    ----------
    fleet
        The comparison.
    units
        ``"rad"`` or ``"deg"``.
    """
    shown = [one for one in fleet.shared if one.differs or any(member.stands_out for member in one.members)]
    apart = {member.robot for one in shown for member in one.members if member.stands_out}
    robots = [name for name in fleet.robots if len(fleet.robots) <= _FEW or name in apart]
    rows = [_row(one, robots, units) for one in shown]
    header = ["parameter", "unit", "all robots", "between robots", "chance", *robots]
    alike = len(fleet.shared) - len(shown)
    caption = (
        f"{alike} other parameters agree within their errors. Between robots: standard deviation beyond the errors."
        " Chance: that equal robots differ as much, corrected for all parameters. A star marks a robot that stands out"
        " from the others."
    )
    return grid("Where robots differ", header, rows, caption=caption)


def _row(one: Shared, robots: Sequence[str], units: str) -> list[str | Cell]:
    times, unit = in_unit(one.unit, units)
    members = {member.robot: member for member in one.members}
    cells: list[Cell] = []
    for name in robots:
        member = members.get(name)
        if member is None:
            cells.append(Cell("n/i", tone="unknown"))
            continue
        value, error = with_error(times * member.value, times * member.std_error)
        cells.append(Cell(value, error=error, mark="*" if member.stands_out else "", tone="alarm" * member.stands_out))
    mean, error = with_error(times * one.mean, times * one.std_error)
    chance = "below 1e-6" if one.p_value < 1e-6 else number(one.p_value, 2)
    return [one.name, unit, Cell(mean, error=error), number(times * one.spread, 2), chance, *cells]
