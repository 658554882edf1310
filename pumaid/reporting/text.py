"""Numbers, units and names as people read them, and sentences about a model, its errors on logs and a diagnosis."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import PurePath

import numpy as np

from pumaid.dataset import BLOCK, CONSTANT, STROKE, Dataset, Run
from pumaid.diagnosis.records import (
    JointDiagnosis,
)
from pumaid.errors import Note
from pumaid.estimate import IDENTIFIED, NOT_IDENTIFIABLE, Estimate, JointResult, Value
from pumaid.estimation.evaluate import Budget, BudgetPart, JointScore
from pumaid.maths import by_key
from pumaid.results.history import Rung, effect_words
from pumaid.robot import Robot
from pumaid.units import CURRENTS_IN, factor, number

#: Decimals beyond which a power of ten is easier to read.
MOST_DECIMALS = 7

_ANGLE = re.compile(r"\brad(\d?)\b")

#: RMSE over noise floor above which a joint needs attention: a floor from a few dozen replicates is known to a tenth,
#: so a quarter more is beyond chance.
ATTENTION = 1.25
#: RMSE over noise floor up to which a joint is at the floor, and below which the floor holds more than noise.
AT_FLOOR, BELOW_FLOOR = 1.1, 0.8
#: RMSE over noise floor up to which a verdict holds.
FLOOR_VERDICTS = {
    BELOW_FLOOR: "below the floor, so repeated runs differ by something that the model follows (drift, warm-up)",
    AT_FLOOR: "at the floor",
    ATTENTION: "little above the floor",
}
#: A: errors below this are round-off.
ROUNDING = 1e-7

#: Parts of the residual budget, as in legends.
PART_NAMES = {
    "noise_shared": "noise common to a run",
    "noise_inside": "noise within runs",
    "smooth": "within runs, smooth",
    "fast": "within runs, ripple",
    "start": "start of runs",
    "odd": "between runs, reverses with direction",
    "even": "between runs, same in both directions",
    "time": "time and temperature",
    "unassigned": "unassigned",
}

#: Part and variable -> pattern in the residual, with causes.
PATTERNS = {
    ("smooth", "position"): "varies smoothly with position, the same in both directions (spring, wrong gravity)",
    ("smooth", "direction"): "varies smoothly with position and reverses with direction (friction over position)",
    ("smooth", "posture"): "varies within runs as weight does and differs between postures (wrong gravity)",
    ("smooth", "load"): "follows the load and its change with position (gear or link flexibility)",
    ("start", "travel"): "appears at the start of runs and decays with travel (presliding, inertia)",
    ("odd", "direction"): "opposes motion by a constant (friction differs from that in the fitted logs)",
    ("odd", "speed"): "opposes motion and varies with speed (Stribeck friction, power law)",
    ("odd", "load"): "opposes motion and grows with load (load-dependent gear friction)",
    ("odd", "lag"): "lags behind position (delay between position and current)",
    ("odd", "posture"): "opposes motion and differs between postures (friction under side load)",
    ("even", "direction"): "is a constant offset (current sensor, changed load)",
    ("even", "posture"): "is the same in both directions and differs between postures (wrong gravity)",
    ("even", "load"): "is nonlinear in the load, the same in both directions (torque falling off at high current)",
    ("even", "speed"): "is the same in both directions and varies with speed",
    ("time", "time"): "opposes motion and varies with time (warm-up, step of friction)",
    ("time", "even"): "is the same in both directions and varies with time (changed load)",
    ("time", "load"): "grows with load and varies with time (motor warming up, changed load)",
    ("time", "temperature"): "follows the temperature (lubricant)",
}

#: What a set of runs cannot separate, by slug.
BUDGET_LIMITS = {
    "few-runs": "too few runs to separate anything but ripple from slow noise",
    "no-replicates": "no repeated runs, so noise common to a run cannot be separated from missing physics",
    "one-direction": "one direction only, so what reverses with direction cannot be separated from what does not",
    "one-posture": "one posture only, so load and position are confounded",
    "one-speed": "one speed only, so dependence on speed is not visible, and position and time are confounded",
    "two-speeds": "two speeds only, which any friction law fits",
    "strokes": "strokes among the runs, in which speed and position are confounded",
    "several-clocks": "recordings with separate clocks, so time is compared within each only",
    "no-load": "gravity cannot be separated from friction, so no dependence on load is tested",
}

BUDGET_CAPTION = (
    "Shares of the mean squared residual, so they add up. Solid: significant (p below 0.05 for the joint)."
    " To name the effect behind a part: pumaid diagnose."
)


#: Ripples named in a sentence.
MOST_RIPPLES = 3


# Numbers, units and names


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """A value and its standard error as text, both to the error's second significant digit."""
    if error is None or not math.isfinite(error) or error <= 0.0:
        return number(value, 5), "" if error is None else number(error, 2)
    decimals = 1 - math.floor(math.log10(error))
    if decimals <= MOST_DECIMALS:
        return f"{value:.{max(decimals, 0)}f}", f"{error:.{max(decimals, 0)}f}"
    largest = max(abs(value), error)
    if largest >= 1e-4:
        return number(value, 7), f"{error:.1e}"
    power = math.floor(math.log10(largest))
    texts = [f"{item / 10.0**power:.{max(decimals + power, 0)}f}e{power}" for item in (value, error)]
    return texts[0], texts[1]


def in_unit(unit: str, angle: str) -> tuple[float, str]:
    """Factor and unit word that show a number of `unit` with angles in `angle` (``rad`` or ``deg``)."""
    if angle == "rad" or not _ANGLE.search(unit):
        return 1.0, unit
    above, below = (sum(int(power or 1) for power in _ANGLE.findall(part)) for part in unit.partition("/")[::2])
    return factor("deg") ** (below - above), _ANGLE.sub(r"deg\1", unit)


def current_unit(notes: Iterable[Note]) -> str:
    """The unit of currents by the notes on their logs."""
    words = (note.text.removeprefix(CURRENTS_IN) for note in notes if note.text.startswith(CURRENTS_IN))
    return next((word.partition(";")[0] for word in words), "A")


def percent(share: float | None) -> str:
    """A share as a percentage with as many digits as distinguish it from 100 %."""
    if share is None or not math.isfinite(share):
        return "unknown"
    gap = abs(1.0 - share)
    decimals = 0 if gap >= 0.05 else min(4, max(1, -math.floor(math.log10(max(gap, 1e-6))) - 2))
    return f"{round(100.0 * share, decimals) + 0.0:.{decimals}f} %"


def amperes(value: float | None) -> str:
    """A current with three significant digits; a dash where there is none."""
    return "-" if value is None else f"{number(value, 3)} A"


def shortened(name: str, limit: int = 52) -> str:
    """A name cut to at most `limit` letters."""
    return name if len(name) <= limit else name[: limit - 1] + "…"


def plural(count: int, word: str) -> str:
    """A count with its noun: ``1 run``, ``2 runs``."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def listed(words: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def joint_title(robot: Robot, *joints: int) -> str:
    """Numbers and names of joints (from 1): ``Joint 3 (elbow)``, ``Joints 1 (waist) and 3 (elbow)``."""
    names = {joint: robot.joint(joint).name for joint in joints}
    words = [f"{joint}" if name == f"joint{joint}" else f"{joint} ({name})" for joint, name in names.items()]
    return f"Joint{'s' * (len(joints) > 1)} {listed(words)}"


def joint_label(robot: Robot, joint: int | None) -> str:
    """Number and name of joint `joint` (from 1) in a table: ``3 elbow``; ``arm`` for none."""
    return f"{joint} {robot.joint(joint).name}" if joint else "arm"


def posture_text(robot: Robot, positions: Sequence[float], angle: str = "rad", *, moving: int = 0) -> str:
    """Positions (J,) of all joints: ``[0 – 90]``, a dash for joint `moving` (from 1) and for NaN."""
    scaled = [
        (joint, position * in_unit(joint.position_unit, angle)[0], 0 if angle == "deg" and joint.is_revolute else 2)
        for joint, position in zip(robot.joints, positions, strict=True)
    ]
    words = [
        f"{round(value, decimals) + 0.0:.{decimals}f}" if joint.number != moving and np.isfinite(value) else "–"
        for joint, value, decimals in scaled
    ]
    return "[" + " ".join(words) + "]"


def relative_names(names: Iterable[str]) -> dict[str, str]:
    """File names without the folders that all of them share."""
    paths = {name: PurePath(name) for name in names}
    levels = zip(*(path.parent.parts for path in paths.values()), strict=False)
    shared = len(list(takewhile(lambda folders: len(set(folders)) == 1, levels)))
    return {name: str(PurePath(*path.parts[shared:])) for name, path in paths.items()}


def run_time(run: Run) -> str:
    """Start and end of a run (s)."""
    return f"{run.start:.2f} – {run.start + run.duration:.2f}"


def counted_runs(runs: Sequence[Run]) -> str:
    """``12 runs at constant speed, 3 strokes from rest to rest and 10 blocks of any motion``."""
    counts = count_kinds(runs)
    shown = [
        f"{plural(counts[kind], noun)} {how}"
        for kind, (noun, how) in {
            CONSTANT: ("run", "at constant speed"),
            STROKE: ("stroke", "from rest to rest"),
            BLOCK: ("block", "of any motion"),
        }.items()
        if kind in counts
    ]
    return listed(shown or ["0 runs at constant speed"])


def count_kinds(runs: Sequence[Run]) -> dict[str, int]:
    """Kind -> number of runs, a block counted once for all its joints."""
    stretches = {(run.kind, run.origin, run.first_row, run.joint * (run.kind != BLOCK)) for run in runs}
    return dict(Counter(kind for kind, *_ in stretches))


def is_above_floor(rmse: float | None, floor: float | None) -> bool:
    """Whether an RMSE (A) is clearly above the noise floor (A)."""
    return rmse is not None and floor is not None and rmse > ATTENTION * floor + ROUNDING


def is_structural(value: Value) -> bool:
    """Whether no motion of the arm shows a parameter: not identifiable, and no run to propose."""
    return value.state == NOT_IDENTIFIABLE and value.next_run is None


def merge_notes(notes: Iterable[Note]) -> list[Note]:
    """Notes, each once; those of several joints that differ only in ``joint N`` at their beginning become one."""
    groups: dict[tuple[Note, str], list[Note]] = {}
    for note in dict.fromkeys(notes):
        rest = re.sub(rf"^joint {note.where.joint}(?=[ :])", "", note.text, flags=re.IGNORECASE)
        is_of_joint = note.where.joint is not None and rest != note.text
        shared = replace(note, text="", where=replace(note.where, joint=None)) if is_of_joint else note
        groups.setdefault((shared, rest), []).append(note)
    merged = []
    for (shared, rest), group in groups.items():
        joints = listed([str(note.where.joint) for note in group])
        text = f"joints {joints}{rest}" if rest.startswith(":") else f"each of joints {joints}{rest}"
        merged.append(replace(shared, text=text) if len(group) > 1 else group[0])
    return merged


# Model and comparison


def summary_sentences(dataset: Dataset, estimate: Estimate) -> list[str]:
    """What the logs contain, and how many parameters are identified."""
    runs, files = dataset.runs, dataset.files
    heldout = sum(run.heldout for run in runs)
    words = (
        counted_runs(runs)
        + (f" in {plural(len(files), 'file')}" if files else "")
        + (f"; {plural(heldout, 'run')} held out for validation." if heldout else ".")
    )
    values = [value for value in estimate.values if not is_structural(value)]
    states = [value.state for value in values]
    unknown, sums = states.count(NOT_IDENTIFIABLE), len(estimate.combinations)
    parameters = (
        f"Identified parameters: {states.count(IDENTIFIED)} of {len(values)}"
        + (f"; not identifiable: {unknown} (reasons below the table)" if unknown else "")
        + (f"; identified combinations of these: {sums}." if sums else ".")
    )
    return [words, parameters]


def joint_sentence(score: JointScore, robot: Robot) -> str:
    """How well the model predicts one joint's current, and whether something is missing."""
    title, share = joint_title(robot, score.joint), score.explained
    if score.rmse is None:
        return f"{title} never moves alone in these logs, so its error is unknown."
    explained = f"the model explains {percent(share)} of the current's variance"
    if share is None:
        explained = "the measured current is constant"
    elif share < 0.0:
        explained = "the model is no better than a constant current"
    words = f"{title}: {explained}; {floor_words(score)}"
    if words.endswith(FLOOR_VERDICTS[AT_FLOOR]):
        is_noise = score.budget is None or is_noise_only(score.budget)
        noise = "nothing missing that repeated runs can show"
        words += f", {noise if is_noise else 'yet part of it is more than noise'}"
    return f"{words}."


def floor_words(joint: JointResult | JointDiagnosis) -> str:
    """A joint's RMSE against its noise floor, with what that means."""
    rmse, floor = joint.rmse, joint.noise_floor
    if rmse is None or floor is None:
        fast = joint.noise_inside
        noise = "noise floor unknown" if fast is None else f"fast noise {amperes(fast)}"
        return f"RMSE {amperes(rmse)}, {noise} (no repeated run)"
    ratio = (rmse - ROUNDING) / max(floor, ROUNDING)
    above = f"{number(ratio, 2)} times the floor, so the model lacks something"
    verdict = next((text for limit, text in FLOOR_VERDICTS.items() if ratio <= limit), above)
    return f"RMSE {amperes(rmse)}, noise floor {amperes(floor)}: {verdict}"


# Residual budget


def part_share(budget: Budget, part: BudgetPart) -> float:
    """A part's share of the mean squared residual, no unit; 0 where there is no residual."""
    return part.mean_square / budget.mean_square if budget.mean_square > 0.0 else 0.0


def is_noise_only(budget: Budget) -> bool:
    """Whether a joint's residual is noise, as far as the runs can show."""
    return not any(part.is_more for part in budget.parts) and budget.part("unassigned").mean_square == 0.0


def part_text(budget: Budget, part: BudgetPart) -> str:
    """What a part says of the residual."""
    if part.name == "fast" and part.is_more:
        motor = [f" ({number(turns, 3)} a motor turn)" for turns in part.gearing] or [""] * len(part.cycles)
        waves = [number(cycles, 4) + turns for cycles, turns in zip(part.cycles, motor, strict=True)]
        more = [f"{len(waves) - MOST_RIPPLES} more"] if len(waves) > MOST_RIPPLES else []
        size = " whose amplitude changes along the run" if "size" in part.against else ""
        return f"is ripple over position{size}: {listed(waves[:MOST_RIPPLES] + more)} cycles per {part.per}"
    if part.name == "unassigned":
        slow = "is slow within runs: noise or missing physics (too few runs to separate them)"
        odd = "differs from run to run: noise or missing physics (repeated runs would separate them)"
        noise = slow if "few-runs" in budget.limits else odd
        return "repeats from run to run but matches no known pattern" if part.is_more else noise
    patterns = (PATTERNS[part.name, variable] for variable in part.against)
    return "; part of it ".join(patterns) if part.is_more else PART_NAMES[part.name]


def by_joint(texts: Iterable[tuple[int, str]], robot: Robot, *, count: int = 0) -> list[str]:
    """Each text once, after the joints of which it is said; `count` is the number that are all joints."""
    joints_of = {text: [joint for joint, _ in group] for text, group in by_key(texts, lambda pair: pair[1]).items()}
    return [
        f"{'All joints' if len(joints) == count > 1 else joint_title(robot, *joints)}: {text}"
        for text, joints in joints_of.items()
    ]


# History of models


def changes(rung: Rung) -> list[str]:
    """What a model adds to the one it was made from (``+ stribeck@3``) and what it removes."""
    joints = len(rung.estimate.joints)
    words = [
        *(["base model"] if rung.parent is None else []),
        *(f"+ {name}" for name in effect_words(rung.added, joints)),
        *(f"− {name}" for name in effect_words(rung.removed, joints)),
    ]
    return words or ["fitted again"]
