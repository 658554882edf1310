"""From a file's columns to the robot's quantities in SI, by the recipe's `log` block; a guess of that block."""

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pumaid.errors import LogError, Note, PumaidError, Where, listed, meant, nearest, refuse
from pumaid.io.formats import LogColumn
from pumaid.maths import Counts, Floats
from pumaid.robot import Joint, LogFormat, Robot
from pumaid.units import UNITS

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
#: Units that words of a name tell.
_UNIT_WORDS = {
    "time": {"ms": "ms", "msec": "ms", "us": "us", "ns": "ns", "millis": "ms", "nanosec": "ns"},
    "position": {"deg": "deg", "degree": "deg", "degrees": "deg"},
    "velocity": {"deg": "deg/s", "degree": "deg/s", "degrees": "deg/s"},
    "current": {"mA": "mA"},
}
#: What the absence of a quantity's column means.
_ABSENCE = {
    "current": "the runs of these joints show no current and are not identified",
    "velocity": "all velocities are derived from position",
    "temperature": "these temperatures are not known",
}

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
    places: dict[str, Counts]
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


def resolve(schema: Sequence[LogColumn], robot: Robot, name: str, *, extra: Sequence[str] = ()) -> Columns:
    """Find the robot's columns in a file (`name` for messages), and those of `extra`, read without a factor.

    Raises
    ------
    LogError [column-missing]
        Time, a position or a column of `extra` is absent, no current is there at all, or a needed name stands twice;
        with what the file has, the nearest name, or a `log` block to paste. Several are told together (`Faults`).
    """
    header = [column.name for column in schema]
    wanted = {q: [robot.log.column(q, joint.number) for joint in robot.joints] for q in QUANTITIES}
    wanted["extra"] = list(extra)
    refuse(_faults(header, robot, wanted, name))
    unit = schema[header.index(robot.log.time)].unit
    names, factors = [robot.log.time], [UNITS[unit][1] if unit else time_factor(robot)]
    places: dict[str, Counts] = {}
    notes: list[Note] = []
    for quantity, asked in wanted.items():
        present = {k: column for k, column in enumerate(asked) if column in header}
        lacking = [column for column in asked if column is not None and column not in header]
        # A velocity or temperature that nobody named is passed over in silence.
        usual = getattr(LogFormat(), quantity, None)
        is_asked = quantity == "current" or present or getattr(robot.log, quantity, None) != usual
        if lacking and is_asked and quantity in _ABSENCE:
            text = f"no column {listed(lacking)}: {_ABSENCE[quantity]}"
            notes.append(Note("column-absent", text, Where(file=name)))
        if quantity == "velocity" and lacking:
            present = {}
        indices = [(k, len(names) + count) for count, k in enumerate(present)]
        places[quantity] = np.array(indices, dtype=np.int64).reshape(-1, 2)
        names += map(str, present.values())
        factors += [1.0 if quantity == "extra" else factor_of(robot, quantity, robot.joints[k]) for k in present]
    templates = [template for template in (robot.log.position, robot.log.current) if "{joint" in template]
    beyond = [template.format(joint=robot.n_joints + 1, joint0=robot.n_joints, name="") for template in templates]
    more = [column for column in beyond if column in header]
    if more:
        text = f"the log also has {listed(more)}, but {robot.name} has {robot.n_joints} joints: is it this robot's log?"
        notes.append(Note("more-joints", text, Where(file=name)))
    return Columns(tuple(names), np.array(factors), places, tuple(notes))


def _faults(
    header: Sequence[str], robot: Robot, wanted: Mapping[str, list[str | None]], name: str
) -> list[PumaidError]:
    faults: list[PumaidError] = []
    currents = list(map(str, wanted["current"]))
    missing = [str(column) for column in [robot.log.time, *wanted["position"]] if column not in header]
    missing = missing or ([] if any(column in header for column in currents) else currents)
    where = Where(file=name, row=1)
    if missing:
        what = f"{name} has no column {listed(missing)}; it has {listed(header, 12)}"
        faults.append(LogError("column-missing", what, where, _mend(header, robot, missing)))
    used = {robot.log.time, *(column for columns in wanted.values() for column in columns)}
    doubled = [column for column, times in Counter(header).items() if times > 1 and column in used]
    if doubled:
        what = f"{name} has column {listed(doubled)} more than once"
        faults.append(LogError("column-missing", what, where, "rename or remove all but one"))
    for column in wanted["extra"]:
        if column not in header:
            mend = meant(column, header)
            faults.append(LogError("column-missing", f"{name} has no column {column}", where, mend))
    return faults


def _mend(header: Sequence[str], robot: Robot, missing: Sequence[str]) -> str:
    block = paste_block(header, robot)
    if block:
        return f"if these are the columns meant, put this into the recipe:\n{block}"
    # What the recipe names already is no other quantity.
    named = {robot.log.time, *(robot.log.column(q, joint.number) for q in QUANTITIES for joint in robot.joints)}
    free = [column for column in header if column not in named]
    near = {column: nearest(column, free, cutoff=ALIKE) for column in missing[:3]}
    hints = [f"the nearest to {column} is {name}" for column, name in near.items() if name]
    return "; ".join([*hints, "name this file's columns in the recipe's log block (pumaid init shows one)"])


def paste_block(header: Sequence[str], robot: Robot) -> str | None:
    """A recipe's `log` block that reads this header, or none if time, positions or currents are not recognised."""
    exact = [name for word in _TIME for name in header if name.lower() == word]
    times = exact + [name for name in header if set(_words(name)) & set(_TIME)]
    templates = _templates(header, robot)
    chosen = {}
    for quantity in QUANTITIES:
        scores = {template: _score(template, quantity) - beyond for template, beyond in templates.items()}
        best = max(scores, key=lambda template: scores[template], default="")
        if scores.get(best, -math.inf) > -math.inf:
            chosen[quantity] = best
    if not times or "position" not in chosen or "current" not in chosen:
        return None
    lines = [f"  {key}: {json.dumps(name, ensure_ascii=False)}" for key, name in {"time": times[0], **chosen}.items()]
    units = [
        f"{quantity}: {unit}"
        for quantity, template in {"time": times[0], **chosen}.items()
        for word, unit in _UNIT_WORDS.get(quantity, {}).items()
        if word in {*_words(template), *re.findall(r"(?<![A-Za-z])mA(?![A-Za-z])", template)}
    ]
    lines += [f"  units: {{{', '.join(units)}}}"] if units else []
    return "\n".join(["log:", *lines])


def _words(name: str) -> list[str]:
    """The lower-case words of a name: ``motorPos_rad[3]`` gives motor, pos, rad."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", re.sub(r"\{\w+\}", " ", name))
    return [word for word in re.split(r"[^a-z]+", apart.lower()) if word]


def _templates(header: Sequence[str], robot: Robot) -> dict[str, bool]:
    """Templates that name a column for every joint, and whether there is a column for one joint more."""
    templates = {}
    numbers = range(robot.n_joints + 1)
    first_name = robot.joints[0].name
    for name in header:
        places = [(name[: match.start()], name[match.end() :]) for match in re.finditer(r"\d+", name)]
        for (before, after), (key, first) in product(places, (("{joint}", 1), ("{joint0}", 0))):
            *columns, beyond = [f"{before}{first + k}{after}" in header for k in numbers]
            if all(columns):
                templates[f"{before}{key}{after}"] = beyond
        if first_name in name and all(name.replace(first_name, joint.name, 1) in header for joint in robot.joints):
            templates[name.replace(first_name, "{name}", 1)] = False
    return templates


def _score(template: str, quantity: str) -> float:
    """How well the words of a template speak of a quantity."""
    words = _words(template)
    hits = [_WORDS[quantity].index(word) for word in words if word in _WORDS[quantity]]
    if not hits:
        return -math.inf
    # "TorqueCur" and "PositionCmptd" speak of two things: what other words say counts against.
    score = 10.0 - 0.1 * min(hits) - len(words)
    score -= 5.0 * bool(_WANTED & set(words)) - 2.0 * bool(_MEASURED & set(words))
    return score - 5.0 * any(word in _WORDS[other] for other in _WORDS if other != quantity for word in words)
