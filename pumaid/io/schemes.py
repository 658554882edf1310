"""Guess how a foreign log names its columns, for a `log` block that a user can paste into the recipe."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from pumaid.robot import Robot

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


def paste_block(header: Sequence[str], robot: Robot) -> str | None:
    """A `log` block for the recipe that reads this header, or none if time, positions and currents are not all found.

    Parameters
    ----------
    header
        The file's column names.
    robot
        Tells how many joints there must be.

    Returns
    -------
    block
        YAML, or None.
    """
    time = _time_column(header)
    chosen = {quantity: _template(header, quantity, robot) for quantity in _WORDS}
    if time is None or chosen["position"] is None or chosen["current"] is None:
        return None
    lines = ["log:", f"  time: {_quoted(time)}"]
    lines += [f"  {q}: {_quoted(chosen[q])}" for q in ("position", "velocity", "current", "temperature") if chosen[q]]
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


def _quoted(text: str | None) -> str:
    escaped = str(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
