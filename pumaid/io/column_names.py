"""What the names of a log's columns say, and a recipe's `log` block as text."""

import math
import re
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import product
from typing import Any, cast

from pumaid.errors import listed, nearest
from pumaid.io.forms import yaml_line
from pumaid.robot import QUANTITIES, Conversion, Joint, LogFormat, Robot
from pumaid.units import UNITS, factor

#: Words by which a column's name tells what it holds, strongest first: in English and as ROS and servos say, then in
#: German, French, Spanish, Italian, Chinese, Japanese and Korean. Compared with the name's words in lower case, and
#: with their ends; KUKA's are of its system variables and of its sensor interface.
_WORDS = {
    "velocity": "velocity vel velocities qd dq speed omega qdot dot geschwindigkeit drehzahl vitesse velocidad"
    " velocità 速度 转速 回転数 속도",
    "current": "current cur curr i iq amp amps currents strom courant corriente corrente macur 电流 電流 전류",
    "torque": "effort load tau torque efforts loads torques drehmoment moment couple par coppia 力矩 扭矩 转矩"
    " トルク 토크",
    "temperature": "temperature temp temperatures temperatur température temperatura 温度 온도",
    "position": "position pos q angle theta positions angles winkel stellung posición posicion ángulo angulo"
    " posizione angolo aipos axisact 位置 角度 关节角 위치 각도",
    "time": "t time timestamp seconds sec secs s ts clock stamp millis micros zeit zeitstempel temps tiempo tempo"
    " 时间 時間 时刻 時刻 시간",
    "fraction": "nanosec nsec nsecs nanosecs nanoseconds usec usecs microsec microseconds msec millisec milliseconds",
}
_KNOWN = {what: words.split() for what, words in _WORDS.items()}
#: Units that a name tells, by quantity, CiA 402's of torques too; none of them stands inside a word.
_UNIT_WORDS = {
    "time": {"ms": r"ms|msecs?|milli\w*", "us": r"us|µs|usecs?|micro\w*", "ns": r"ns|nsecs?|nano\w*"},
    "position": {
        "deg": "deg|degrees?|°|度",
        "rev": "turns?|revs?|revolutions?|pos[ _]estimate",  # as ODrive says
        "tick": "ticks?",
        "mrad": "mrad",
    },
    "velocity": {
        "deg/s": "deg|degrees?|°|度",
        "rpm": "rpm|U/min|1/min",
        "rev/s": "turns?|revs?|revolutions?|vel[ _]estimate",
        "tick/s": "ticks?",
    },
    "current": {
        "mA": "mA",
        "Nm": "N[ _·*]?m",
        "mNm": "mN[ _·*]?m",
        "percent": "%|percent",
        "permille": "‰|permille|torque[ _]actual[ _]value",
    },
}
#: Words for a second, and words for what may be a current, a torque or a share of it.
_SECONDS, _SHARES = ("s", "sec", "secs", "seconds"), ("effort", "efforts", "load", "loads")
#: What a torque costs against a current, and a second quantity in a name; how much better than its rivals is sure.
_TORQUE, _ANOTHER, _SURE = 3.0, 5.0, 2.0
#: How like a name must be to be meant (difflib's ratio): actual_q_0 and actual_dq_0 are to actual_current_0 by 0.69.
ALIKE = 0.7
#: Columns that count the recordings that stand in one file, as in LeRobot's data sets.
EPISODE = re.compile("episode([_ ]?(index|id))?", re.IGNORECASE)
#: Wanted, not measured: never proposed while a measured column is there.
_WANTED = {
    *("target", "cmd", "command", "commanded", "cmptd", "computed", "ref", "reference", "desired", "des", "set"),
    "soll",
}
_MEASURED = {"actual", "measured", "meas", "act", "real", "ist"}
#: Spellings without a mark between words, KUKA's name of positions, and names with no word but that of a joint.
_SPELLINGS = (
    (r"\b_?(ist|soll)(?=[a-z]{4})", r"\1 "),
    (r"(?<![a-z]_)axis[ _]act(?![a-z])", "axisact"),
    (r"^\W*(j|a|axis|joint|achse)[\W\d_]*$", "stellung"),
)


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
    out |= {key: part for key, part in {"units": units, "signs": dict(log.signs), "delay": log.delay}.items() if part}
    return "\n".join(["log:", *(f"  {key}: {yaml_line(value)}" for key, value in out.items())])


def guessed(header: Sequence[str], robot: Robot) -> tuple[LogFormat | None, bool]:
    """How a log with this header is written, and whether without doubt.

    None if time, positions or currents are not recognised. Units that the recipe states hold.
    """
    names = spelt(robot.log.names or tuple(joint.name for joint in robot.joints), header)
    templates, chosen, is_sure = _templates(header, names), dict[str, str](), True
    for quantity in QUANTITIES:
        scores = {template: _score(template, quantity) - beyond for template, beyond in templates.items()}
        best = max(scores, key=lambda template: scores[template], default="")
        if scores.get(best, -math.inf) == -math.inf:
            continue
        chosen[quantity], by_name = best, "{name}" in best
        rivals = [score for other, score in scores.items() if other != best and ("{name}" in other) == by_name]
        if quantity in ("position", "current"):  # a velocity is checked, and spared
            is_sure &= not templates[best] and max(rivals, default=-math.inf) < scores[best] - _SURE
            is_sure &= not is_wanted(best)
    times, is_one = _times(header, chosen.get("position", ""))
    if not times or "position" not in chosen or "current" not in chosen:
        return None, False
    usual = {"time": "s", "position": "rad", "velocity": "rad/s", "current": "A"}
    units = {key: unit for key, name in {"time": times[0], **chosen}.items() if (unit := unit_in(name, key))}
    if not {*words_of(chosen["current"])} & {*_KNOWN["current"], *_SHARES}:
        units.setdefault("current", "Nm")
    if "position" in units:
        units.setdefault("velocity", f"{units['position']}/s")
    units = {key: word for key, word in units.items() if robot.log.units.get(key, usual[key]) == usual[key]}
    log = LogFormat(times[0], units={**robot.log.units, **units}, names=names, signs=robot.log.signs)
    log = replace(log, conversions=robot.log.conversions, delay=robot.log.delay)
    return replace(log, fraction="".join(times[1:]), **cast(Any, chosen)), is_sure and is_one


def _times(header: Sequence[str], position: str) -> tuple[list[str], bool]:
    """The column of the time, or that of its seconds and that of their fractions; and whether there is no other."""
    words = {name: words_of(name) for name in header}
    pairs = [
        [name, other]
        for name in header
        if words[name] and words[name][-1] in _SECONDS
        for other in header
        if words[other][:-1] == words[name][:-1] and words[other] and words[other][-1] in _KNOWN["fraction"]
    ]
    pairs.sort(key=lambda pair: -sum(a == b for a, b in zip(pair[0], position, strict=False)))
    paired = {name for pair in pairs for name in pair}
    plain = {
        name: [word for word in words[name] if word not in _SECONDS and not unit_in(word, "time")] for name in words
    }
    named = [name for word in _KNOWN["time"] for name in header if (plain[name] or words[name]) == [word]]
    single = [name for name in named if name not in paired]
    more = clocks(header)
    candidates = [*([name] for name in single), *pairs, *([name] for name in more)]
    return (candidates or [[]])[0], bool(single or pairs or len(more) == 1)


def clocks(header: Sequence[str]) -> list[str]:
    """The columns whose names speak of a time, and not of its seconds alone."""
    return [name for name in header if {*words_of(name)} & {*_KNOWN["time"]} - {*_SECONDS}]


def stated_unit(text: str, quantity: str) -> str:
    """The unit that a file states of a column, as in a line of units."""
    word = text.strip("[]() ")
    return word if word in UNITS else unit_in(word, quantity)


def unit_in(name: str, quantity: str) -> str:
    """The unit of a quantity that a name tells, if any."""
    units = _UNIT_WORDS.get(quantity, {}).items()
    return next((unit for unit, words in units if re.search(rf"(?<![^\W\d_])({words})(?![^\W\d_])", _bare(name))), "")


def has_foreign_words(text: str) -> bool:
    """Whether a text holds words for columns in letters that are not ASCII."""
    return any(word in text.lower() for words in _KNOWN.values() for word in words if not word.isascii())


def is_wanted(text: str) -> bool:
    """Whether names speak of what was wanted, not measured."""
    return bool(_WANTED & {*words_of(text)})


def words_of(name: str) -> list[str]:
    """The lower-case words of a name: ``motorPos_rad[3]`` gives motor, pos, rad; ``Iststrom`` gives ist, strom."""
    apart = re.sub(r"([a-z])([A-Z])", r"\1 \2", _bare(name)).lower()
    for pattern, plain in _SPELLINGS:
        apart = re.sub(pattern, plain, apart)
    return [word for word in re.split(r"[\W\d_]+", apart) if word]


def spelt(names: Sequence[str], header: Sequence[str]) -> tuple[str, ...]:
    """Names of joints as a header spells them, in other capitals or with other marks between words, if it has all."""
    patterns = (r"[\W_]?".join(map(re.escape, re.split(r"[\W_]+", name))) for name in names)
    matches = [re.search(pattern, "\n".join(header), re.IGNORECASE) for pattern in patterns]
    is_as_written = all(any(name in column for column in header) for name in names)
    return tuple(match[0] for match in matches if match) if all(matches) and not is_as_written else tuple(names)


def _bare(name: str) -> str:
    """A name without joints, and with spaces between Chinese or Japanese and Latin letters."""
    return re.sub(r"\{\w+(?::\w+)?\}|(?<=[\u3040-\u9fff])(?=[A-Za-z])|(?<=[A-Za-z])(?=[\u3040-\u9fff])", " ", name)


def _templates(header: Sequence[str], names: Sequence[str]) -> dict[str, int]:
    """Templates that name a column for every joint, and whether there is a column for one joint more.

    It counts twice before the first joint, since a gripper's stands behind the last.
    """
    templates, columns = {}, {*header}
    numbers = range(len(names) + 1)
    for name in header:
        places = [(name[: match.start()], match[0], name[match.end() :]) for match in re.finditer(r"\d+", name)]
        for (before, digits, after), (key, first) in product(places, (("joint", 1), ("joint0", 0))):
            width = f":0{len(digits)}d" if digits[0] == "0" and len(digits) > 1 else ""
            *joints, beyond = [f"{before}{first + k:{width[1:]}}{after}" in columns for k in numbers]
            if all(joints):
                ahead = f"{before}{first - 1:{width[1:]}}{after}" in columns
                templates[f"{before}{{{key}{width}}}{after}"] = beyond + 2 * ahead
        if names[0] in name and all(name.replace(names[0], other, 1) in columns for other in names):
            templates[name.replace(names[0], "{name}", 1)] = 0
    return templates


def _score(template: str, quantity: str) -> float:
    """How well the words of a template speak of a quantity; a torque stands for a current where there is none."""
    words = words_of(template)
    # What they speak of, and the place of the strongest among the words for it: one of these, one that ends with a long
    # one, or one that holds a Chinese or Japanese one.
    meaning = {
        what: place
        for what, signs in _KNOWN.items()
        for place, sign in reversed([*enumerate(signs)])
        for word in words
        if word == sign or (len(sign) > 3 and word.endswith(sign)) or (not sign.isascii() and sign in word)
    }
    asked = {quantity, "torque"} & {*meaning} if quantity == "current" else {quantity} & {*meaning}
    if not asked:
        return -math.inf
    # "TorqueCur" and "PositionCmptd" speak of two things: what other words say counts against.
    score = 10.0 - 0.1 * min(meaning[what] for what in asked) - len(words) - _TORQUE * (quantity not in asked)
    score += 2.0 * bool(_MEASURED & set(words)) - 5.0 * bool(_WANTED & set(words)) + 1.5 * ("{name}" in template)
    return score - _ANOTHER * bool({*meaning} - {*asked, "time", "fraction"})


def factor_of(robot: Robot, quantity: str, joint: Joint, *, unit: str = "") -> float:
    """What a log's number is multiplied by to be SI in the recipe's direction; velocity turns with position.

    ``units.prismatic_position`` speaks for prismatic joints, ``units.position`` for the joints whose kind it fits (deg
    for revolute, mm for prismatic ones); without a word it is SI. A `unit` that the file states goes before them.
    """
    position = joint.position_unit
    si = {"position": position, "velocity": f"{position}/s", "current": "A", "temperature": "degC"}[quantity]
    words = (robot.log.units.get(key, "") for key in (f"{joint.kind}_{quantity}", quantity))
    unit = next((word for word in (unit, *words) if word in UNITS and UNITS[word][0] == UNITS[si][0]), si)
    signs = robot.log.signs.get("position" if quantity == "velocity" else quantity, (1,) * robot.n_joints)
    return float(signs[joint.number - 1] * factor(unit) * robot.log.conversion(quantity, joint.number).scale)


def offered(header: Sequence[str], robot: Robot, missing: Sequence[str]) -> str:
    """The mend where columns are `missing`: the `log` block that the header's names mean, or the nearest of them."""
    naming, _ = guessed(header, robot)
    topics = dict.fromkeys(
        column.rsplit("/", 2)[0] for column in header if column[:1] == "/" and column.endswith("/position")
    )
    if naming:
        block = log_block(naming)
        more = f" (joint states are there of {listed([*topics])}; log: {{topic: NAME}} says which)"
        more *= len(topics) > 1
        more += " (some hold what was wanted: of these the model is the controller's, not the arm's)" * is_wanted(block)
        return f"if these are the columns meant{more}, put this into the recipe:\n{block}"
    if timed := guessed(["t", *header], robot)[0]:
        seconds = (
            "none of them is a time: put the seconds of each row in front, as column t (0, 0.01, 0.02 ... at 100 Hz)"
        )
        return f"{seconds}, and this into the recipe:\n{log_block(timed)}"
    # What the recipe names already is no other quantity.
    named = {robot.log.time, *(robot.log.column(q, joint.number) for q in QUANTITIES for joint in robot.joints)}
    free = [column for column in header if column not in named]
    near = {column: nearest(column, free, cutoff=ALIKE) for column in missing[:3]}
    hints = [f"the nearest to {column} is {name}" for column, name in near.items() if name]
    text = "name this file's columns in the recipe's log block (pumaid init shows one)"
    return "; ".join([*hints, f"{text}; write {{name}} for a joint's name, which log_name states if it is another"])
