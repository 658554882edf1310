"""From a file's columns to the robot's quantities in SI, by the recipe's `log` block."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Faults, LogError, Note, PumaidError, Where
from pumaid.io.schemes import paste_block
from pumaid.robot import Joint, LogFormat, Robot
from pumaid.units import UNITS

Floats = NDArray[np.float64]

#: Quantities of a joint in the order in which a table's columns are kept.
QUANTITIES = ("position", "velocity", "current", "temperature")

#: How like a name must be to be meant (difflib's ratio): actual_q_0 and actual_dq_0 are to actual_current_0 by 0.69.
ALIKE = 0.7

_SI = {
    ("position", True): "rad",
    ("position", False): "m",
    ("velocity", True): "rad/s",
    ("velocity", False): "m/s",
    ("current", True): "A",
    ("current", False): "A",
    ("temperature", True): "degC",
    ("temperature", False): "degC",
}


@dataclass(frozen=True, eq=False, slots=True)
class Columns:
    """Which columns of one file are read and what each means.

    Attributes
    ----------
    names
        (C,) column names in the file; the first is time.
    factors
        (C,) what a file's number is multiplied by to be SI with the recipe's sign.
    places
        Quantity -> (k, 2) rows of (index of the joint from 0, index into `names`); ``extra`` the same with the index of
        the column asked for instead of the joint's. These stand last in `names`.
    notes
        What is absent and may be.
    """

    names: tuple[str, ...]
    factors: Floats
    places: dict[str, NDArray[np.int64]]
    notes: tuple[Note, ...]


def unit_of(robot: Robot, quantity: str, joint: Joint) -> str:
    """Unit word of a joint's quantity in this robot's logs.

    ``units.prismatic_position`` speaks for prismatic joints, ``units.position`` for the joints whose kind it fits (deg
    for revolute, mm for prismatic ones); without a word it is SI.
    """
    si = _SI[quantity, joint.is_revolute]
    for key in (f"{joint.kind}_{quantity}", quantity):
        unit = robot.log.units.get(key)
        if unit in UNITS and UNITS[unit][0] == UNITS[si][0]:
            return unit
    return si


def factor_of(robot: Robot, quantity: str, joint: Joint) -> float:
    """What a log's number is multiplied by to be SI in the recipe's direction; velocity turns with position."""
    signs = robot.log.signs.get(quantity)
    if signs is None and quantity == "velocity":
        signs = robot.log.signs.get("position")
    sign = 1 if signs is None or quantity == "temperature" else signs[joint.number - 1]
    return float(sign * UNITS[unit_of(robot, quantity, joint)][1])


def time_factor(robot: Robot) -> float:
    """Seconds in one unit of the log's time."""
    return UNITS[robot.log.units.get("time", "s")][1]


def resolve(header: Sequence[str], robot: Robot, name: str, *, extra: Sequence[str] = ()) -> Columns:
    """Find the robot's columns in a file's header.

    Parameters
    ----------
    header
        The file's column names in order.
    robot
        Names its columns in `robot.log`.
    name
        The file's name for messages.
    extra
        Columns to read besides, each once and without a factor; one that this file lacks is noted.

    Raises
    ------
    LogError [column-missing, column-doubled, no-current]
        Time or a position is absent, no current is there at all, or a needed name stands twice; with what the file has,
        the nearest name, or a `log` block to paste. Several faults are told together (`Faults`).
    """
    wanted = {q: [robot.log.column(q, joint.number) for joint in robot.joints] for q in QUANTITIES}
    have = set(header)
    faults = _faults(header, robot, {**wanted, "extra": list(extra)}, name)
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    names, factors = [robot.log.time], [time_factor(robot)]
    places: dict[str, NDArray[np.int64]] = {}
    notes: list[Note] = []
    for quantity in QUANTITIES:
        found = [
            (joint, column) for joint, column in zip(robot.joints, wanted[quantity], strict=True) if column in have
        ]
        lacking = [column for column in wanted[quantity] if column is not None and column not in have]
        notes += _absence(quantity, lacking, len(found), form=robot.log, name=name)
        if quantity == "velocity" and len(found) < robot.n_joints:
            found = []
        places[quantity] = np.array(
            [(joint.number - 1, len(names) + k) for k, (joint, _) in enumerate(found)], dtype=np.int64
        ).reshape(-1, 2)
        names += [str(column) for _, column in found]
        factors += [factor_of(robot, quantity, joint) for joint, _ in found]
    there = [(k, column) for k, column in enumerate(extra) if column in have]
    places["extra"] = np.array([(k, len(names) + n) for n, (k, _) in enumerate(there)], dtype=np.int64).reshape(-1, 2)
    names += [column for _, column in there]
    factors += [1.0] * len(there)
    notes += [_no_extra(column, name) for column in extra if column not in have]
    notes += _more_joints(have, robot, name)
    return Columns(tuple(names), np.array(factors), places, tuple(notes))


def _faults(header: Sequence[str], robot: Robot, wanted: dict[str, list[str | None]], name: str) -> list[PumaidError]:
    have = set(header)
    faults: list[PumaidError] = []
    needed = [robot.log.time, *(str(column) for column in wanted["position"])]
    missing = [column for column in needed if column not in have]
    currents = [str(column) for column in wanted["current"]]
    where = Where(file=name, row=1)
    if missing:
        what = f"{name} has no column {_listed(missing)}; it has {_listed(header)}"
        faults.append(LogError("column-missing", what, where, _mend(header, robot, missing)))
    if not any(column in have for column in currents):
        what = f"{name} has no current of any joint ({_listed(currents)}); it has {_listed(header)}"
        if not missing:
            faults.append(LogError("no-current", what, where, _mend(header, robot, currents)))
    used = {robot.log.time, *(str(c) for columns in wanted.values() for c in columns if c is not None)}
    doubled = [column for column, times in Counter(header).items() if times > 1 and column in used]
    if doubled:
        what = f"{name} has column {_listed(doubled)} more than once"
        faults.append(LogError("column-doubled", what, where, "rename or remove all but one"))
    return faults


def _mend(header: Sequence[str], robot: Robot, missing: Sequence[str]) -> str:
    block = paste_block(header, robot)
    if block:
        return f"if these are the columns meant, put this into the recipe:\n{block}"
    hints = []
    have, drawn = (
        [joint.number for joint in robot.joints if robot.log.column(quantity, joint.number) in header]
        for quantity in ("position", "current")
    )
    if have and robot.log.time in header and have == drawn and max(have) == len(have) < robot.n_joints:
        hints.append(f"it holds {len(have)} joints, {robot.name} has {robot.n_joints}: is it this robot's log?")
        missing = ()
    # What the recipe names already is no other quantity.
    named = {robot.log.column(quantity, joint.number) for quantity in QUANTITIES for joint in robot.joints}
    free = [column for column in header if column not in named | {robot.log.time}]
    for column in missing[:3]:
        real = _nearest(column, free)
        if real is not None:
            hints.append(f"the nearest to {column} is {real}")
    hints.append("name this file's columns in the recipe's log block (pumaid init shows one)")
    return "; ".join(hints)


def _absence(quantity: str, lacking: list[str], found: int, *, form: LogFormat, name: str) -> list[Note]:
    """Notes on what may be absent; a velocity or temperature that nobody named is passed over in silence."""
    where = Where(file=name)
    if not lacking or quantity == "position":
        return []
    if quantity == "current":
        text = f"no column {_listed(lacking)}: the runs of these joints show no current and are not identified"
        return [Note("current-absent", text, where)]
    asked = getattr(form, quantity) != getattr(LogFormat(), quantity)
    if quantity == "velocity" and (found or asked):
        text = f"no column {_listed(lacking)}: all velocities are derived from position"
        return [Note("velocity-absent", text, where)]
    if quantity == "temperature" and (found or asked):
        return [Note("temperature-absent", f"no column {_listed(lacking)}: these temperatures are not known", where)]
    return []


def check_extra(headers: Mapping[str, Sequence[str]], extra: Sequence[str]) -> None:
    """Refuse columns that no file has.

    Parameters
    ----------
    headers
        File's name -> its column names.
    extra
        Columns that the user asks for.

    Raises
    ------
    LogError [column-missing]
        With the nearest names.
    """
    have = list(dict.fromkeys(name for header in headers.values() for name in header))
    missing = [column for column in extra if column not in have]
    if not missing or not headers:
        return
    hints = [f"did you mean {near} for {column}?" for column in missing if (near := _nearest(column, have))]
    first = next(iter(headers))
    nowhere = f"{first} has no" if len(headers) == 1 else "no log has a"
    what = f"{nowhere} column {_listed(missing)}; there are {_listed(have)}"
    where = Where(file=first, row=1, column=missing[0])
    raise LogError("column-missing", what, where, "; ".join(hints) or "name a column as the logs' header does")


def _nearest(column: str, header: Sequence[str]) -> str | None:
    """The name in a header that is most like `column`, or goes on where that ends, capitals apart."""
    names, meant = {item.lower(): item for item in reversed(header)}, column.lower()
    longer = [name for name in names if len(meant) > 2 and name.startswith(meant)]
    near = difflib.get_close_matches(meant, names, n=1, cutoff=ALIKE) or longer
    return names[near[0]] if near else None


def _no_extra(column: str, name: str) -> Note:
    return Note("extra-absent", f"no column {_listed([column])}: it counts as unknown here", Where(file=name))


def _more_joints(have: set[str], robot: Robot, name: str) -> list[Note]:
    beyond = [
        template.format(joint=robot.n_joints + 1, joint0=robot.n_joints)
        for template in (robot.log.position, robot.log.current)
        if "{joint" in template and "{name" not in template
    ]
    beyond = [column for column in beyond if column in have]
    if not beyond:
        return []
    text = f"the log also has {_listed(beyond)}, but {robot.name} has {robot.n_joints} joints: is it this robot's log?"
    return [Note("more-joints", text, Where(file=name))]


def _listed(names: Sequence[str], most: int = 12) -> str:
    """Names for a message; the first few of many."""
    clean = ["".join(letter if letter.isprintable() else "?" for letter in item) for item in names[:most]]
    shown = ", ".join(item if len(item) <= 40 else item[:37] + "..." for item in clean)
    return f"{shown} ... ({len(names)} in all)" if len(names) > most else shown
