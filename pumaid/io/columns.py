"""From a file's columns to the robot's quantities in SI, by the recipe's `log` block; a guess of that block."""

from __future__ import annotations

import difflib
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Faults, LogError, Note, PumaidError, Where
from pumaid.robot import Joint, LogFormat, Robot
from pumaid.units import UNITS

Floats = NDArray[np.float64]

#: Quantities of a joint in the order in which a table's columns are kept.
QUANTITIES = ("position", "velocity", "current", "temperature")

#: How like a name must be to be meant (difflib's ratio): actual_q_0 and actual_dq_0 are to actual_current_0 by 0.69.
ALIKE = 0.7

#: Words by which a column's name tells what it holds, strongest first. Compared with the name's words in lower case.
_WORDS = {
    "velocity": ("velocity", "vel", "qd", "dq", "speed", "omega", "qdot"),
    "current": ("current", "cur", "curr", "i", "iq", "amp", "amps"),
    "temperature": ("temperature", "temp", "temperatures"),
    "position": ("position", "pos", "q", "angle", "theta", "positions"),
}
_TIME = ("t", "time", "timestamp", "time_s", "seconds", "sec", "clock", "stamp")
_TIME_UNITS = {"ms": "ms", "msec": "ms", "us": "us", "ns": "ns", "millis": "ms", "nanosec": "ns"}

#: Wanted, not measured: never proposed while a measured column is there.
_WANTED = {"target", "cmd", "command", "commanded", "cmptd", "computed", "ref", "reference", "desired", "des", "set"}
_MEASURED = {"actual", "measured", "meas", "act", "real"}


@dataclass(frozen=True, eq=False, slots=True)
class Columns:
    """Which columns of one file are read and what each means.

    Attributes
    ----------
    names, factors
        (C,) column names in the file, time first, and what a number is multiplied by to be SI with the recipe's sign.
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
    position = joint.position_unit
    si = {"position": position, "velocity": f"{position}/s", "current": "A", "temperature": "degC"}[quantity]
    words = (robot.log.units.get(key, "") for key in (f"{joint.kind}_{quantity}", quantity))
    return next((word for word in words if word in UNITS and UNITS[word][0] == UNITS[si][0]), si)


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
    """Find the robot's columns in the header of a file (`name` for messages), and those of `extra`, read without a
    factor.

    Raises
    ------
    LogError [column-missing, column-doubled, no-current]
        Time or a position is absent, no current is there at all, or a needed name stands twice; with what the file has,
        the nearest name, or a `log` block to paste. Several faults are told together (`Faults`).
    """
    wanted = {q: [robot.log.column(q, joint.number) for joint in robot.joints] for q in QUANTITIES}
    wanted["extra"] = list(extra)
    faults = _faults(header, robot, wanted, name)
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)
    names, factors = [robot.log.time], [time_factor(robot)]
    places: dict[str, NDArray[np.int64]] = {}
    notes: list[Note] = []
    for quantity, asked in wanted.items():
        present = {k: column for k, column in enumerate(asked) if column in header}
        lacking = [column for column in asked if column is not None and column not in header]
        notes += _absence(quantity, lacking, bool(present), form=robot.log, name=name)
        if quantity == "velocity" and lacking:
            present = {}
        indices = [(k, len(names) + count) for count, k in enumerate(present)]
        places[quantity] = np.array(indices, dtype=np.int64).reshape(-1, 2)
        names += map(str, present.values())
        factors += [1.0 if quantity == "extra" else factor_of(robot, quantity, robot.joints[k]) for k in present]
    templates = [template for template in (robot.log.position, robot.log.current) if "{name" not in template]
    beyond = [template.format(joint=robot.n_joints + 1, joint0=robot.n_joints) for template in templates]
    more = [column for column, template in zip(beyond, templates, strict=True) if column in header and "{" in template]
    if more:
        text = (
            f"the log also has {_listed(more)}, but {robot.name} has {robot.n_joints} joints: is it this robot's log?"
        )
        notes.append(Note("more-joints", text, Where(file=name)))
    return Columns(tuple(names), np.array(factors), places, tuple(notes))


def _faults(
    header: Sequence[str], robot: Robot, wanted: Mapping[str, list[str | None]], name: str
) -> list[PumaidError]:
    faults: list[PumaidError] = []
    missing = [str(column) for column in [robot.log.time, *wanted["position"]] if column not in header]
    currents = list(map(str, wanted["current"]))
    where = Where(file=name, row=1)
    if missing:
        what = f"{name} has no column {_listed(missing)}; it has {_listed(header)}"
        faults.append(LogError("column-missing", what, where, _mend(header, robot, missing)))
    elif not any(column in header for column in currents):
        what = f"{name} has no current of any joint ({_listed(currents)}); it has {_listed(header)}"
        faults.append(LogError("no-current", what, where, _mend(header, robot, currents)))
    used = {robot.log.time, *(column for columns in wanted.values() for column in columns)}
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


def _absence(quantity: str, lacking: list[str], has_other: bool, *, form: LogFormat, name: str) -> list[Note]:
    """Notes on what may be absent; a velocity or temperature that nobody named is passed over in silence."""
    meanings = {
        "current": ("current-absent", "the runs of these joints show no current and are not identified"),
        "velocity": ("velocity-absent", "all velocities are derived from position"),
        "temperature": ("temperature-absent", "these temperatures are not known"),
        "extra": ("extra-absent", "it counts as unknown here"),
    }
    is_asked = (
        quantity in ("current", "extra") or has_other or getattr(form, quantity) != getattr(LogFormat(), quantity)
    )
    if not lacking or quantity not in meanings or not is_asked:
        return []
    slug, meaning = meanings[quantity]
    return [Note(slug, f"no column {_listed(lacking)}: {meaning}", Where(file=name))]


def check_extra(headers: Mapping[str, Sequence[str]], extra: Sequence[str]) -> None:
    """Refuse columns that the user asks for and no file (name -> its column names) has.

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


def _listed(names: Sequence[str], most: int = 12) -> str:
    """Names for a message; the first few of many."""
    clean = ["".join(letter if letter.isprintable() else "?" for letter in item) for item in names[:most]]
    shown = ", ".join(item if len(item) <= 40 else item[:37] + "..." for item in clean)
    return f"{shown} ... ({len(names)} in all)" if len(names) > most else shown


def paste_block(header: Sequence[str], robot: Robot) -> str | None:
    """A recipe's `log` block that reads this header, or none if time, positions or currents are not recognised."""
    time = _time_column(header)
    chosen = {quantity: _template(header, quantity, robot) for quantity in _WORDS}
    if time is None or chosen["position"] is None or chosen["current"] is None:
        return None
    lines = ["log:", f"  time: {json.dumps(time, ensure_ascii=False)}"]
    lines += [f"  {q}: {json.dumps(chosen[q], ensure_ascii=False)}" for q in QUANTITIES if chosen[q]]
    units = _units(time, {quantity: template for quantity, template in chosen.items() if template})
    if units:
        lines.append("  units: {" + ", ".join(f"{key}: {unit}" for key, unit in units.items()) + "}")
    return "\n".join(lines)


def _words(name: str) -> list[str]:
    """The lower-case words of a name: ``motorPos_rad[3]`` gives motor, pos, rad."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word for word in re.split(r"[^a-z]+", apart.lower()) if word]


def _time_column(header: Sequence[str]) -> str | None:
    exact = [name for word in _TIME for name in header if name.lower() == word]
    loose = [name for name in header if set(_words(name)) & set(_TIME)]
    return next(iter(exact + loose), None)


def _template(header: Sequence[str], quantity: str, robot: Robot) -> str | None:
    """The best template that names a column for every joint, counting from 1 or from 0, or by the joints' names."""
    have = set(header)
    best: tuple[float, str] | None = None
    for name in header:
        score = _score(name, quantity)
        if score is None or (best is not None and score <= best[0]):
            continue
        for template, columns, beyond in _readings(name, robot):
            rating = score - (beyond in have)
            if all(column in have for column in columns) and (best is None or rating > best[0]):
                best = (rating, template)
    return None if best is None else best[1]


def _readings(name: str, robot: Robot) -> Iterator[tuple[str, list[str], str]]:
    """Ways to read a name as a template: the template, its columns for this robot, the column after the last."""
    for match in re.finditer(r"\d+", name):
        before, after = name[: match.start()], name[match.end() :]
        for key, first in (("{joint}", 1), ("{joint0}", 0)):
            columns = [f"{before}{first + k}{after}" for k in range(robot.n_joints)]
            yield f"{before}{key}{after}", columns, f"{before}{first + robot.n_joints}{after}"
    first_name = robot.joints[0].name
    if first_name in name:
        template = name.replace(first_name, "{name}", 1)
        yield template, [template.replace("{name}", joint.name) for joint in robot.joints], ""


def _score(name: str, quantity: str) -> float | None:
    words = _words(name)
    hits = [_WORDS[quantity].index(word) for word in words if word in _WORDS[quantity]]
    # "TorqueCur" and "PositionCmptd" speak of two things: what other words say counts against.
    if not hits:
        return None
    score = 10.0 - 0.1 * min(hits) - len(words)
    score -= 5.0 * bool(_WANTED & set(words)) - 2.0 * bool(_MEASURED & set(words))
    return score - 5.0 * any(word in _WORDS[other] for other in _WORDS if other != quantity for word in words)


def _units(time: str, chosen: dict[str, str]) -> dict[str, str]:
    """Unit words that the names themselves tell."""
    units = {}
    for word in _words(time):
        if word in _TIME_UNITS:
            units["time"] = _TIME_UNITS[word]
    for quantity, in_degrees in (("position", "deg"), ("velocity", "deg/s")):
        if {"deg", "degree", "degrees"} & set(_words(chosen.get(quantity, ""))):
            units[quantity] = in_degrees
    if re.search(r"(?<![A-Za-z])mA(?![A-Za-z])", chosen.get("current", "")):
        units["current"] = "mA"
    return units
