"""Tables of a diagnosis: what was tried, what could not have been seen, the runs that would decide; shapes as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pumaid.effects import catalogue
from pumaid.records import ABSENT, ADD, UNSEEN, Candidate, Diagnosis, Finding, Limit, Unexplained
from pumaid.reporting.findings import bare, label, limit_sentence, listed_or, number_of_times
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import in_unit
from pumaid.reporting.scores import amount
from pumaid.reporting.verdicts import variable_word
from pumaid.robot import Robot
from pumaid.units import deviations, number

#: Verdicts of candidates as people read them.
VERDICTS = {ADD: "add", "doubtful": "doubtful", ABSENT: "absent", UNSEEN: "cannot be seen"}

#: Rows of a shape drawn as text, and characters: of its longest bar, of one where words leave little, of a line.
ROWS, BAR, LEAST_BAR, LINE = 20, 24, 6, 74


def evidence_grid(diagnosis: Diagnosis, robot: Robot) -> Grid | None:
    """What was tried and explains more than its parameters cost, each once; None where nothing does."""
    rows: list[list[str | Cell]] = []
    marks: dict[str, str] = {}
    for one in _tried(diagnosis):
        mark = _mark(marks, one.reason) if one.reason and one.verdict != ADD else ""
        rows.append(
            [
                f"{one.joint} {robot.joint(one.joint).name}" if one.joint else "arm",
                label(one.effect),
                Cell(VERDICTS.get(one.verdict, one.verdict), mark=mark, tone=_tone(one)),
                _figure(one.p_value, 2),
                _figure(one.evidence, 3),
                amount(one.rmse_after),
                amount(one.rmse_heldout_before),
                amount(one.rmse_heldout_after),
                ", ".join(label(name) for name in one.rivals) or "-",
            ]
        )
    if not rows:
        return None
    header = ("joint", "effect", "verdict", "chance", "evidence", "left (A)", "left out (A)", "with it (A)", "or")
    return grid(
        "What was tried",
        header,
        rows,
        notes=tuple((mark, text) for text, mark in marks.items()),
        caption="Chance: that something as strong shows up anywhere although nothing is missing. Evidence: what it"
        " explains, less what its parameters cost; differences of 10 are decisive. Left: RMSE of fitted runs with it."
        " Left out: RMSE of fitted runs as fits to the other runs predict them, without it and with it (runs that are"
        " held out for judging are told above). Or: what these data cannot tell from it.",
        lefts=(0, 1, 2, 8),
    )


def _tried(diagnosis: Diagnosis) -> list[Candidate]:
    """Candidates in order of joints, those of the whole arm last; what shows up at several joints stands once."""
    found: dict[tuple[str, int | None], Candidate] = {}
    for joint in diagnosis.joints:
        for one in joint.candidates:
            if one.verdict == ADD or one.evidence > 0.0:
                found.setdefault((one.effect, one.joint), one)
    return sorted(found.values(), key=lambda one: (one.joint is None, one.joint or 0))


def _figure(value: float, digits: int) -> str:
    return number(value, digits) if np.isfinite(value) else "-"


def _tone(one: Candidate) -> str:
    return {ADD: "alarm", ABSENT: "absent", UNSEEN: "unknown"}.get(one.verdict, "weak")


def _mark(marks: dict[str, str], text: str) -> str:
    """The letter of a note: a to z, then aa, ab ..."""
    letters, count = "abcdefghijklmnopqrstuvwxyz", len(marks)
    first = letters[count // 26 - 1] if count >= 26 else ""
    return marks.setdefault(text, first + letters[count % 26])


def limits_grid(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad", joints: Sequence[int] = ()) -> Grid | None:
    """The smallest size of each effect that these data would have shown; None where that is not known.

    Parameters
    ----------
    diagnosis
        Its joints' limits.
    robot
        Names of joints.
    units
        ``"rad"`` or ``"deg"``.
    joints
        Those whose limits are told (from 1); all where empty.
    """
    chosen = [one for one in diagnosis.joints if one.limits and (not joints or one.joint in joints)]
    limits = [limit for one in chosen for limit in one.limits]
    if not limits:
        return None
    rows_of = _rows_of(limits)
    columns = sorted({limit.joint or 0 for limit in limits}, key=lambda number: (number == 0, number))
    sized = {(limit.joint or 0, limit.effect, limit.parameter, limit.unit): limit for limit in limits}
    unseen = {(limit.joint or 0, limit.effect): limit for limit in limits if limit.size is None}
    marks: dict[str, str] = {}
    rows: list[list[str | Cell]] = []
    for effect, (parameter, unit) in rows_of:
        times, shown = in_unit(bare(unit), units)
        cells: list[str | Cell] = [Cell(effect), Cell(f"{parameter} ({shown})" if shown else parameter)]
        own = [sized.get((n, effect, parameter, unit), unseen.get((n, effect))) for n in columns]
        rows.append(cells + [_limit_cell(limit, times, marks) for limit in own])
    names = [f"{number} {robot.joint(number).name}" if number else "arm" for number in columns]
    first = next((limit for limit in limits if limit.size is not None), None)
    caption = "The smallest size that is found eight times in ten"
    caption += f": {limit_sentence(first, robot, units)}." if first else "."
    notes = tuple((mark, text) for text, mark in marks.items())
    head = ("effect", "size of", *names)
    return grid("What these data would have shown", head, rows, notes=notes, caption=caption, lefts=(0, 1))


def _rows_of(limits: Iterable[Limit]) -> list[tuple[str, tuple[str, str]]]:
    """Effect, parameter and unit of each row; an effect of which no size is known has one row all the same."""
    kinds: dict[str, dict[tuple[str, str], bool]] = {}
    for limit in limits:
        own = kinds.setdefault(limit.effect, {})
        own[limit.parameter, limit.unit] = own.get((limit.parameter, limit.unit), False) or limit.size is not None
    order = {name: place for place, name in enumerate(catalogue())}
    names = sorted(kinds, key=lambda name: (order.get(name, len(order)), name))
    return [(name, kind) for name in names for kind in _with_size(kinds[name])]


def _with_size(kinds: dict[tuple[str, str], bool]) -> list[tuple[str, str]]:
    return [kind for kind, has_size in kinds.items() if has_size] or list(kinds)[:1]


def _limit_cell(limit: Limit | None, times: float, marks: dict[str, str]) -> Cell:
    if limit is None:
        return Cell("")
    if limit.size is None:
        return Cell("-", mark=_mark(marks, limit.reason) if limit.reason else "", tone="unknown")
    return Cell(number(times * limit.size, 2))


def runs_grid(found: Finding, robot: Robot, units: str = "rad") -> Grid | None:
    """The runs that would decide between a finding and its rivals; None where no run would."""
    run = found.next_run
    if run is None or not run.motions:
        return None
    rows: list[list[str | Cell]] = []
    for count, motion in enumerate(run.motions, start=1):
        joint = robot.joint(motion.joint)
        times, unit = in_unit(joint.position_unit, units)
        held = [
            "–" if other.number == motion.joint else number(in_unit(other.position_unit, units)[0] * position + 0.0, 3)
            for other, position in zip(robot.joints, motion.hold, strict=True)
        ]
        rows.append(
            [
                str(count),
                f"{motion.joint} {joint.name}",
                f"{number(times * motion.start, 3)} {unit}",
                f"{number(times * motion.end, 3)} {unit}",
                f"{number(times * motion.velocity, 3)} {unit}/s",
                "[" + " ".join(held) + "]",
            ]
        )
    caption = ""
    if run.separation is not None:
        caption = f"Run once, they set the rivals {deviations(run.separation)} standard deviations apart"
        caption += f"; run {number_of_times(run.repeats)}, they decide nine times in ten." if run.repeats else "."
    header = ("run", "joint", "from", "to", "speed", "others held at")
    title = f"Runs that would tell {listed_or([label(name) for name in (found.effect, *found.rivals)])}"
    return grid(title, header, rows, caption=caption, lefts=(0, 1, 5))


def shape_lines(shape: Unexplained, units: str = "rad") -> list[str]:
    """Free-form means as lines of text: place, mean with its error, and a bar from a line in the middle."""
    times, unit = in_unit(shape.unit, units)
    centres, means, errors = _thinned(shape)
    top = float(np.nanmax(np.abs(means), initial=0.0)) or 1.0
    word = variable_word(shape)
    head = f"{word} ({unit})" if unit else word
    what = f"viscous (A s/{shape.unit})" if shape.form.startswith("v ") else "left (A)"
    has_negative, has_positive = bool((means < 0.0).any()), bool((means > 0.0).any())
    places = [number(times * float(centre) + 0.0, 3) for centre in centres]
    told = [
        f"{mean:+.4f}" + (f" ± {abs(error):.4f}" if np.isfinite(error) else "")
        for mean, error in zip(means, errors, strict=True)
    ]
    wide, broad = max(map(len, [head, *places])), max(map(len, [what, *told]))
    bar = min(BAR, max((LINE - wide - broad - 5) // (has_negative + has_positive or 1), LEAST_BAR))
    lines = [f"{head:>{wide}}  {what:>{broad}}"]
    for place, text, mean in zip(places, told, means, strict=True):
        drawn = "#" * round(bar * abs(float(mean)) / top)
        left = (drawn if mean < 0 else "").rjust(bar) if has_negative else ""
        lines.append(f"{place:>{wide}}  {text:>{broad}}  {left}|{drawn if mean > 0 else ''}")
    return lines


def _thinned(shape: Unexplained) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At most `ROWS` bins: neighbours become one, weighted by what is known of them."""
    step = -(-len(shape.centres) // ROWS)
    if step <= 1:
        return shape.centres, shape.means, shape.errors
    known = np.where(np.isfinite(shape.errors) & (shape.errors > 0.0), shape.errors, np.nan)
    weight = np.nan_to_num(1.0 / known**2, nan=0.0)
    weight = weight if weight.any() else np.ones(len(weight))
    starts = np.arange(0, len(weight), step)
    sums = np.add.reduceat(weight, starts)
    safe = np.where(sums > 0.0, sums, np.nan)
    centres, means = (np.add.reduceat(weight * values, starts) / safe for values in (shape.centres, shape.means))
    return centres, means, 1.0 / np.sqrt(safe)
