"""What the statistics of a log say of one joint, and the words for a recipe that mend it."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from pumaid.errors import listed
from pumaid.io.column_names import factor_of, log_block, words_of
from pumaid.io.log_form import preset_formats
from pumaid.maths import Floats
from pumaid.preprocessing.encodings import AN_OCTAVE, MISREAD, OCTAVES, SHARE, lost_sign
from pumaid.preprocessing.log_statistics import WINDOW, LogStatistics
from pumaid.robot import QUANTITIES, Conversion, Joint, LogFormat, Robot
from pumaid.units import UNITS, factor, number

#: Path (rad or m) from which a joint counts as moved: less is drift, or a test of the brakes.
MOVED = 0.2
#: Displacements and a velocity column that belong together agree this well (real logs: 0.99 and more).
AGREES, UNRELATED, ANOTHER = 0.95, 0.5, 0.3
#: Relative error within which a ratio is that of two units, and within which it is one (real logs: within 0.015).
UNIT_MATCH, RATIO_FINE = 0.03, 0.05
#: Windows each way from which a joint's friction can be told from its gravity; share of a current's variance that
#: another joint's direction must explain, and how much more than its own joint's.
FEWEST_WAYS, STRONG, STRONGER = 30, 0.5, 4.0
#: Share of a joint's samples, least number, and multiple of the next level's count, that make a flat top.
FLAT_SHARE, FLAT_COUNT, FLAT_RATIO = 0.01, 50, 5
#: Windows, and share of them, that make a signal that freezes again and again.
FLAT_WINDOWS, FLAT_TIME = 20, 0.05
#: Share of pairs of samples with the same current, and s between two changes, from which on a current is held.
HELD_SHARE, HELD = 0.6, 0.02
#: Samples, and share of them, that are zero, and zeros per current next to zero, that are not measured.
ZEROS, ZERO_SHARE, ZERO_RATIO = 8, 1e-3, 8
#: Jumps, and turns at zero, that tell; and the scatter of their sizes below which they are one size.
JUMPS, ONE_SIZE = 3, 0.02

_PASTE = "{}, put this into the recipe, in place of its log block:\n{}"
#: rad at which no joint without limits is, and widths of its limits by which no joint leaves them. Rounding of counts.
MOST_RADIANS, FARTHEST, WHOLE = 300.0, 3.0, 1e-6
#: Counts of encoders, and the angle (deg) that they are: of small servos 300 degrees, of others a turn; or parts of a
#: degree or radian. Share by which a jump, with motion in it, may miss one; and least steps that are no jump.
TURNS = (4096, 3600, 2000.0 * math.pi, 2**13, 2**14, 36000, *(2**bits for bits in (16, 17, 18)), 360000)
ENCODERS = ((1023, 300.0), *((counts, 360.0) for counts in (*TURNS, *(2**bits for bits in (19, 20, 22, 24)))))
SAME, STEPS = 0.02, 20.0
#: A; no motor of an arm draws more.
MOST_AMPERES = 200.0
#: Windows of 0.1 s that tell as much as one that knows nothing of its neighbours; by how much the logarithm of a
#: likelihood is surely better: five standard deviations; and the logarithm of the share of a joint's mean square error
#: that the right count must take away, since missing physics, too, prefers some count.
ALIKE_WINDOWS, SURELY, HALF = 10, 12.5, math.log(2.0)
#: Jumps (counts) where a sign was lost, and the encoding.
SIGN_JUMPS = {2**15: "sign-bit-15", 2**16: "uint16-two-complement", 2**32: "uint32-two-complement"}


class JointSignals:
    """One joint's statistics (each by its name), and what predicates and messages make of them."""

    def __init__(self, sums: LogStatistics, joint: Joint) -> None:
        k, n = joint.number - 1, sums.robot.n_joints
        self.sums, self.joint, self.k = sums, joint, k
        self.low, self.high = joint.limits or (-math.inf, math.inf)
        self.span = f"{number(self.lowest)} to {number(self.highest)} {joint.position_unit}"
        self.limits = f"{number(self.low)} to {number(self.high)}"
        self.has_moved = bool(self.path > MOVED)
        self.speed = math.sqrt(self.speed_squares / max(self.seconds, 1e-12))
        #: Steps of positions, or such as would have their noise.
        self.step = max(
            math.sqrt(12.0) * self.noise / max(self.rows, 1), 0.0 if self.least_step == math.inf else self.least_step
        )
        products = sums.totals["products"]
        self.integral, displaced = products[n + k, n + k], np.abs(products[k, n:])
        scale = np.sqrt(products[k, k] * np.diag(products)[n:])
        self.match = np.divide(displaced, scale, out=np.zeros(n), where=scale > 0)
        self.agrees = float(self.match[k])  # correlation of displacement and velocity column
        #: Displacement per integrated velocity, NaN where the joint did not move or they do not belong together.
        is_known = self.agrees > AGREES and self.path > 0
        self.ratio = float(products[k, n + k] / self.integral) if is_known else math.nan
        self.is_off = (self.has_moved or self.integral > (MOVED * WINDOW) ** 2) and abs(self.ratio - 1.0) >= RATIO_FINE
        self.is_constant = self.least_current == self.most_current and self.moving >= FLAT_COUNT
        self.is_measured = self.has_moved and self.moving > 0 and not self.is_constant
        self.largest = max(-self.least_current, self.most_current)
        #: Whether the recipe says that currents are currents, and not torques or shares of them.
        self.is_ampere = sums.robot.log.units.get("current", "A") in ("A", "mA")
        #: Whether all currents are whole numbers where A are read, with steps of an ammeter that no arm has.
        ends = np.array([self.least_current, self.most_current, self.least_change])
        is_plain = self.is_ampere and self.is_measured and abs(factor_of(sums.robot, "current", joint)) == 1.0
        self.is_counted = is_plain and bool(np.isfinite(ends).all()) and is_whole(ends) and self.least_change >= 0.5
        beyond = self.sizes[int(AN_OCTAVE * (math.log2(MOST_AMPERES) - OCTAVES[0])) :]
        self.is_large = self.is_ampere and bool(beyond.sum() > SHARE * self.moving)
        #: Another joint (from 1) whose position the velocity column follows, and one whose current this joint's is.
        is_astray = self.has_moved and self.integral > 0 and self.agrees < ANOTHER and self.match.max() > AGREES
        self.follows = int(np.argmax(self.match)) + 1 if is_astray else 0
        is_same = (self.copied > FLAT_WINDOWS) & (self.copied >= (1.0 - FLAT_TIME) * self.compared)
        self.copy_of = int(np.argmax(is_same[:k])) + 1 if is_same[:k].any() else 0

    def __getattr__(self, name: str) -> Any:
        return self.sums.totals[name][self.k]

    @cached_property
    def lost_sign(self) -> tuple[str, str]:
        """What is wrong with a current whose sign was lost where a joint moves both ways; and its encoding."""
        if min(self.ahead, self.windows - self.ahead) < FEWEST_WAYS:
            return "", ""
        if self.least_current < 0.0:
            # What is small and below zero comes out as large as the integer goes, and nothing between.
            meaning = self.sums.robot.log.conversion("current", self.joint.number)
            top = 2.0**15 * meaning.step * abs(factor_of(self.sums.robot, "current", self.joint))
            is_far = 0.9 * top < self.least_negative <= top and self.most_current < 0.1 * top
            looks = MISREAD.get(meaning.encoding, "") if is_far else ""
            return looks and f"is negative only beyond {self.least_negative:.4g} A, and looks like {looks}", looks
        what, encoding = lost_sign(self.sizes, self.least_change)
        apart = self.misfit() - self.misfit(are_sizes=True) if not what and self.has_moved else 0.0
        if apart > 0.5 * HALF and 0.5 / ALIKE_WINDOWS * len(self.sums.alone[self.k]) * apart > SURELY:
            what = "sizes without sign (weight turns round with the direction, friction does not)"
        return what and f"is never negative although it moves both ways, and looks like {what}", encoding

    def misfit(self, scale: float = 1.0, *, are_sizes: bool = False) -> float:
        """Logarithm of the mean square (A2) that gravity and friction leave of currents while it moves alone.

        Positions are multiplied by `scale`; `are_sizes` takes currents as sizes of those in the direction of motion.
        """
        parts = [*self.sums.postures(self.k, scale)]
        tables = [part * (part[:, 3:4] if are_sizes else 1.0) for part, _ in parts]
        drawn = [currents[:, self.k] for _, currents in parts]
        rests = [y - table @ np.linalg.lstsq(table, y)[0] for table, y in zip(tables, drawn, strict=True)]
        free = max(sum(map(len, rests)) - 5 * len(parts), 1)
        return math.log(max(sum(float(rest @ rest) for rest in rests), 1e-12) / free)

    @property
    def jump(self) -> float:
        """Size (rad or m) by which the position jumps again and again while it moves on, 0 if it does not."""
        size = self.jump_sum / max(self.jumps, 1.0)
        scatter = self.jump_squares / max(self.jumps, 1.0) - size**2
        is_jump = scatter < (ONE_SIZE * size) ** 2 and not size < STEPS * self.least_step < math.inf
        return float(size) if self.jumps >= JUMPS and is_jump else 0.0

    @cached_property
    def normalised(self) -> tuple[float, float] | None:
        """Ends of the hundredths of a calibrated range, as LeRobot has them, that the position reaches exactly."""
        low, high = np.round(_raw(self.sums, np.array([self.lowest, self.highest]), self.joint), 6).tolist()
        is_plain = self.joint.is_revolute and "position" not in self.sums.robot.log.conversions
        return (low, high) if is_plain and high == 100.0 and low in (-100.0, 0.0) else None

    @property
    def is_impossible(self) -> bool:
        """Whether a joint that turns cannot have been where it is read to be: far beyond limits, or counted in ticks.

        What would fit in degrees is told with the units.
        """
        ends = np.array([self.lowest, self.highest])
        if not self.joint.is_revolute or not np.isfinite(ends).all():
            return False
        size, has_limits = float(np.abs(ends).max()), self.joint.limits is not None
        beyond = self.outside() if has_limits else size / MOST_RADIANS
        counts, log = _raw(self.sums, ends, self.joint), self.sums.robot.log
        is_plain, unit = "position" not in log.conversions, log.units.get("position", "rad")
        is_counted = is_plain and unit != "tick" and is_whole(counts) and np.abs(counts).max() > 360.0
        is_degrees = is_plain and unit == "rad" and size > math.pi and has_limits and self.outside(factor("deg")) <= 0.1
        return ((is_counted and (beyond > 0.5 or not has_limits)) or beyond > FARTHEST) and not is_degrees

    def outside(self, scale: float = 1.0) -> float:
        """How far positions times `scale` leave the joint's limits, as a share of their width; negative inside."""
        return float(max(self.low - scale * self.lowest, scale * self.highest - self.high)) / (self.high - self.low)

    def unit_changes(self) -> tuple[list[str], list[str]]:
        """Single changes of unit that bring the ratio to one: of position or time, and of the velocity column."""
        prefix, usual = ("", "rad") if self.joint.is_revolute else ("prismatic_", "m")

        def changes(key: str, usual: str, power: int) -> list[str]:
            robot, size = self.sums.robot, abs(self.ratio) if self.is_off else math.nan
            return other_units(robot, key, usual, fits=lambda scale: abs(size * scale**power - 1.0) < UNIT_MATCH)

        first = changes(f"{prefix}position", usual, 1) + changes("time", "s", -1)
        return first, changes(f"{prefix}velocity", f"{usual}/s", -1)

    @cached_property
    def flat_top(self) -> tuple[str, int] | None:
        """Level (A) of a flat top on either side, and how many samples have it; the side with the larger current."""
        both = zip((1, -1), self.sums.levels[self.k], strict=False)
        sides = [(max(counts), sign, counts) for sign, counts in both if counts]
        for level, sign, counts in sorted(sides, key=lambda side: -side[0]):
            below = sum(counts.values()) - counts[level]
            if counts[level] >= max(FLAT_COUNT, FLAT_SHARE * self.moving, FLAT_RATIO * below):
                return number(sign * level), counts[level]
        return None

    @property
    def mark(self) -> tuple[str, int] | None:
        """What no motor draws (A) and currents are exactly now and then, none else so large, and how often."""
        beyond = [
            (sign * level, count)
            for sign, counts in zip((1.0, -1.0), self.sums.levels[self.k], strict=False)
            for level, count in counts.items()
            if level > MOST_AMPERES
        ]
        is_mark = self.is_measured and self.is_ampere and len(beyond) == 1 and beyond[0][1] >= FLAT_COUNT
        return (number(beyond[0][0]), beyond[0][1]) if is_mark else None

    @cached_property
    def frozen(self) -> str:
        """How the current is not measured anew at each sample, if so."""
        interval = self.sums.interval()
        period = interval / max(1.0 - self.same / max(self.pairs, 1), 1e-9)
        if self.same > HELD_SHARE * self.pairs and period > HELD:
            return f"changes only every {1e3 * period:.0f} ms, and there is a sample every {1e3 * interval:.3g} ms"
        if self.flat >= FLAT_WINDOWS and self.flat > FLAT_TIME * self.windows:
            return f"stays the same to the digit in {100 * self.flat / self.windows:.0f} % of the time it moves"
        return ""

    @property
    def has_zeros(self) -> bool:
        """Whether zeros are far more than currents next to zero; one in steps is as often one step away."""
        nearest = self.sums.levels[self.k][2]
        beside = nearest[max(nearest)] if nearest else 0
        return bool(self.zeros >= max(ZEROS, ZERO_SHARE * self.moving, ZERO_RATIO * beside))


def signals_of(sums: LogStatistics) -> list[JointSignals]:
    """The signals of all joints."""
    return [JointSignals(sums, joint) for joint in sums.robot.joints]


def is_whole(numbers: Floats) -> bool:
    """Whether (N,) numbers of a log are whole, as counts are."""
    return bool(np.all(np.abs(numbers - np.round(numbers)) <= WHOLE * np.maximum(np.abs(numbers), 1.0)))


def _raw(sums: LogStatistics, ends: Floats, joint: Joint) -> Floats:
    """(2,) least and largest number in the log for positions between `ends`."""
    zero = sums.robot.log.conversion("position", joint.number).zero
    return np.sort(ends / factor_of(sums.robot, "position", joint) + zero)


def position_counts(signals: Sequence[JointSignals]) -> str:
    """What to put into the recipe where positions are counts of an encoder, or lost their sign."""
    sums, log = signals[0].sums, signals[0].sums.robot.log
    turning = [(j, factor_of(sums.robot, "position", j.joint)) for j in signals_of(sums) if j.joint.is_revolute]
    ends = [_raw(sums, np.array([j.lowest, j.highest]), j.joint) for j, _ in turning]
    jump = max(j.jump / abs(size) for j, size in turning)
    follows = log.units.get("velocity") == f"{log.units.get('position')}/s"
    units = {
        "position": "rad",
        **({"velocity": "rad/s"} if follows else {}),
        **({"current": "raw"} if any(j.is_counted for j in signals_of(sums)) else {}),
    }
    plain = replace(log, units={**log.units, **units})
    for place, encoding in SIGN_JUMPS.items():
        # A range of whole turns is taken out of jumps: then only the beginning is off.
        spans = [(j.joint, np.array([j.lowest, j.highest]), place * size) for j, size in turning]
        is_off = all(_fits(joint, span) or _fits(joint, span - turns) for joint, span, turns in spans)
        if "position" in log.conversions and (is_off or abs(jump / place - 1.0) < SAME):
            return paste("if this is how they show their sign", log, "position", encoding=encoding)
        if abs(jump / place - 1.0) < SAME:
            condition = f"if a turn is 4096 counts and {place:.0f} and more are below zero"
            return paste(condition, plain, "position", encoding=encoding, scale=math.tau / 4096)
    fitting = [*_encoders(turning, ends, jump)]
    if not fitting:
        return (
            f"say what they are in the recipe: log: {{position: {{column: {json.dumps(log.position)}, scale: rad a"
            " count (of motors 1 over the gear ratio), zero: count where the joint is at zero}}"
        )
    scales = {item: item[1] * factor("deg") / item[0] for item in fitting}
    weights = 0.5 / ALIKE_WINDOWS * np.array([len(j.sums.alone[j.k]) for j, _ in turning])
    errors = {item: np.array([j.misfit(scale / abs(size)) for j, size in turning]) for item, scale in scales.items()}
    best, *rivals = sorted(fitting, key=lambda item: float(weights @ errors[item]))
    apart = errors[(rivals or [best])[0]] - errors[best]
    is_sure = weights @ apart > SURELY and apart.max() > HALF
    counts, angle, zero = item = best if is_sure else fitting[0]
    if counts == angle:
        words = {"position": "deg", **({"velocity": "deg/s"} if follows else {})}
        block = log_block(replace(log, units={**log.units, **words}))
        return f"if they are degrees from 0 to 360, put this into the recipe:\n{block}"
    rest = listed([f"{other[1]:.0f} degrees in {other[0]:.0f}" for other in fitting if other != item], 3)
    how = "gravity fits so, and not" if is_sure else "friction, weights and ratios are others with what fits too:"
    is_unlike = any(abs(j.ratio * scales[item] / abs(size) - 1.0) > RATIO_FINE for j, size in turning if j.integral)
    plain = replace(plain, velocity=None) if is_unlike else plain
    condition = (
        f"if {angle:.0f} degrees are {counts:.0f} counts and {zero:.0f} is zero{f' ({how} {rest})' * bool(rest)}"
    )
    mend = _preset(signals_of(sums), scales[item], zero)
    return mend or paste(condition, plain, "position", scale=scales[item], zero=float(zero))


def calibrated_range(signals: Sequence[JointSignals]) -> str:
    """What to put into the recipe where positions are hundredths of the range that each joint was calibrated over."""
    log, meanings = signals[0].sums.robot.log, []
    for j in signals_of(signals[0].sums):
        low, high = j.normalised or (-100.0, 100.0)
        scale = (j.high - j.low) / (high - low) if j.joint.limits else math.pi / 100.0
        meanings.append(Conversion(round(scale, 9), round(low - j.low / scale, 6) if j.joint.limits else 0.0))
    log = replace(
        log, units={**log.units, "position": "rad"}, conversions={**log.conversions, "position": tuple(meanings)}
    )
    condition = (
        "if each joint was calibrated from limit to limit (a turn where the recipe has none; else write its range"
    )
    return _PASTE.format(f"{condition} over 200 as scale)", log_block(log))


def _encoders(
    turning: Sequence[tuple[JointSignals, float]], ends: Sequence[Floats], jump: float
) -> Iterator[tuple[float, float, float]]:
    """Encoders by which positions fit: counts and the angle (deg) that they are, and the count at zero."""
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    wrapping = [
        pair
        for pair in (*ENCODERS, (360, 360.0))
        if abs(jump / pair[0] - 1.0) < SAME or low == 0.0 == high + 1.0 - pair[0]
    ]
    for counts, angle in wrapping or (ENCODERS if low >= 0.0 or all(map(is_whole, ends)) else ()):
        half, scale = (counts + 1) // 2, angle * factor("deg") / counts
        zeros = [half] if low >= 0.0 and high < counts else []
        # Servos count turns on.
        for zero in (*zeros, 0, *([half * round((low + high) / (2 * half))] if counts == 4096 else [])):
            parts = [(end - zero) * math.copysign(scale, size) for end, (_, size) in zip(ends, turning, strict=True)]
            if (wrapping and not zero) or all(
                _fits(j.joint, part) for (j, _), part in zip(turning, parts, strict=True)
            ):
                yield counts, angle, zero
                break


def _preset(signals: Sequence[JointSignals], scale: float, zero: float) -> str:
    """A mend by the presets with such columns, if any, whose positions count so (rad a count, count at zero).

    And whose currents have their sign where these show it.
    """
    robot, signs = signals[0].sums.robot, {j.lost_sign[1].replace("uint16-two-complement", "int16") for j in signals}
    log, formats = robot.log, preset_formats(robot)
    firsts = {repr(other): name for name, other in reversed(formats.items())}  # of one with several names the first
    names = [
        name
        for name, other in formats.items()
        if firsts[repr(other)] == name
        and {*words_of(other.position)} <= {*words_of(log.position)}
        and {*words_of(other.current)} <= {*words_of(log.current)}
        and abs(factor_of(replace(robot, log=other), "position", signals[0].joint) / scale - 1.0) < 1e-3
        and other.conversion("position", 1).zero == zero
        and signs <= {"", other.conversion("current", 1).encoding}
    ]
    sizes = [formats[name].conversion("current", 1).scale * factor(formats[name].units["current"]) for name in names]
    beside = [f"{name} has {size / sizes[0]:.3g} times its currents" for name, size in zip(names, sizes, strict=True)]
    lines = [f"  preset: {' '.join(names[:1])}{f'  # {listed(beside[1:])}' * (len(names) > 1)}"]
    lines += [
        f"  {key}: {json.dumps(getattr(log, key), ensure_ascii=False)}"
        for key in ("time", *QUANTITIES[:3])
        if names and getattr(log, key) not in (getattr(formats[names[0]], key), getattr(LogFormat(), key, ""))
    ]
    condition = f"if your servos are {listed(names, separator=' or ')}"
    return _PASTE.format(condition, "\n".join(["log:", *lines])) if names else ""


def _fits(joint: Joint, ends: Floats) -> bool:
    low, high = joint.limits or (-1.05 * math.pi, 1.05 * math.pi)
    return bool(min(ends.min() - low, high - ends.max()) > -0.005 * (high - low))


def current_encoding(signals: Sequence[JointSignals]) -> str:
    """What to put into the recipe where currents lost their sign, if that can be undone."""
    # Of a joint that hardly draws a current the sign may be less plain.
    sums, encodings = signals[0].sums, {j.lost_sign[1]: j for j in signals if j.lost_sign[1]}
    if len(encodings) != 1:
        return "write it with its sign"
    encoding, j = encodings.popitem()
    step = float(f"{j.least_change / abs(factor_of(sums.robot, 'current', j.joint)):.6g}")
    log, scale = sums.robot.log, factor_of(sums.robot, "position", sums.robot.joints[0])
    if step == 1.0 and log.units.get("current", "A") == "A":  # as servos tell their load in bit 10, and else counts
        log = replace(log, units={**log.units, "current": "permille" if encoding == "sign-bit-10" else "raw"})
    return _preset(signals_of(sums), scale, log.conversion("position", 1).zero) or paste(
        "if so", log, "current", encoding=encoding, step=step
    )


def paste(condition: str, log: LogFormat, quantity: str, **more: Any) -> str:
    """A mend: the recipe's `log` block with other conversions of a quantity."""
    conversions = [replace(log.conversion(quantity, k + 1), **more) for k in range(len(log.names) or 1)]
    log = replace(log, conversions={**log.conversions, quantity: tuple(conversions)})
    return f"{condition}, put this into the recipe:\n{log_block(log)}"


def other_units(robot: Robot, key: str, usual: str, *, fits: Callable[[float], bool]) -> list[str]:
    """Words for the recipe by which a quantity's unit changes to one whose ratio to that of the recipe `fits`."""
    now = robot.log.units.get(key, usual)
    return [
        f"units: {{{key}: {word}}}"
        for word, (dimension, size) in UNITS.items()
        if dimension == UNITS[now][0] and word != now and fits(size / factor(now))
    ]
