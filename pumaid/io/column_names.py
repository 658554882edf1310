"""What the names of a log's columns say, and a recipe's `log` block as text."""

import json
import math
import re
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import product
from typing import Any, cast

from pumaid.robot import QUANTITIES, Conversion, LogFormat, Robot
from pumaid.units import UNITS

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
#: s, by how words for thousandths and millionths of one begin.
_FRACTIONS = {"mse": 1e-3, "mil": 1e-3, "use": 1e-6, "mic": 1e-6}
#: Wanted, not measured: never proposed while a measured column is there.
_WANTED = {"target", "cmd", "command", "commanded", "cmptd", "computed", "ref", "reference", "desired", "des", "set"}
_MEASURED = {"actual", "measured", "meas", "act", "real"}


def log_block(log: LogFormat) -> str:
    """A recipe's `log` block that says this; what it says by being left out is left out."""
    usual, out = LogFormat(), dict[str, object]()
    times = [log.time, log.fraction] if log.fraction else log.time
    if times != usual.time:
        out["time"] = times
    for quantity in QUANTITIES:
        template, conversions = getattr(log, quantity), log.conversions.get(quantity, ())
        meaning: dict[str, object] = {}
        for part in fields(Conversion):
            values = [getattr(item, part.name) for item in conversions]
            if {*values} - {part.default}:
                meaning[part.name] = values[0] if len({*values}) == 1 else values
        if meaning or template != getattr(usual, quantity):
            out[quantity] = {"column": template, **meaning} if meaning else template
    turning, sliding = log.units.get("position", "rad"), log.units.get("prismatic_position", "m")
    plain = {"time": "s", "position": "rad", "velocity": f"{turning}/s", "current": "A", "temperature": "degC"}
    plain |= {"prismatic_position": turning if turning in ("m", "mm") else "m", "prismatic_velocity": f"{sliding}/s"}
    units = {key: word for key, word in log.units.items() if word != plain[key]}
    out |= {key: part for key, part in {"units": units, "signs": dict(log.signs)}.items() if part}
    return "\n".join(["log:", *(f"  {key}: {_yaml(value)}" for key, value in out.items())])


def paste_block(header: Sequence[str], robot: Robot) -> str | None:
    """A recipe's `log` block that reads this header, or none if time, positions or currents are not recognised."""
    log = guessed(header, robot)
    return log_block(log) if log else None


def guessed(header: Sequence[str], robot: Robot) -> LogFormat | None:
    """How a log with this header is written, or none if time, positions or currents are not recognised."""
    exact = [name for word in _TIME for name in header if name.lower() == word]
    times = exact + [name for name in header if set(_words(name)) & set(_TIME)]
    templates = _templates(header, robot)
    chosen = {}
    for quantity in QUANTITIES:
        scores = {template: _score(template, quantity) - beyond for template, beyond in templates.items()}
        if max(scores.values(), default=-math.inf) > -math.inf:
            chosen[quantity] = max(scores, key=lambda template: scores[template])
    if not times or "position" not in chosen or "current" not in chosen:
        return None
    units = {
        quantity: unit
        for quantity, template in {"time": times[0], **chosen}.items()
        for word, unit in _UNIT_WORDS.get(quantity, {}).items()
        if word in {*_words(template), *re.findall(r"(?<![A-Za-z])mA(?![A-Za-z])", template)}
    }
    names = robot.log.names or tuple(joint.name for joint in robot.joints)
    return replace(LogFormat(times[0], units=units, names=names), **cast(Any, chosen))


def fraction_of_second(name: str) -> float:
    """Unit (s) of the column with fractions of seconds that has this name: nanoseconds where it says no other."""
    return next((_FRACTIONS[word[:3]] for word in _words(name) if word[:3] in _FRACTIONS), 1e-9)


def _yaml(value: object) -> str:
    """A value in a line of YAML, mappings of words to it in braces; numbers to ten digits."""
    if isinstance(value, dict):
        is_bare = {key: key == "encoding" or str(part) in UNITS for key, part in value.items()}
        return f"{{{', '.join(f'{key}: {part if is_bare[key] else _yaml(part)}' for key, part in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    return f"{value:.10g}" if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


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
    score = 10.0 - 0.1 * min(hits) - len(words) - 5.0 * bool(_WANTED & set(words)) + 2.0 * bool(_MEASURED & set(words))
    return score - 5.0 * any(word in _WORDS[other] for other in _WORDS if other != quantity for word in words)
