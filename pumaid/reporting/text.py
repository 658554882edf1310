"""Sentences about a model and its errors on logs: for engineers, with the numbers in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from pumaid.dataset import Dataset
from pumaid.errors import Note
from pumaid.estimate import IDENTIFIED, NOT_IDENTIFIABLE, Estimate, Value
from pumaid.estimation.evaluate import Budget, BudgetPart, Comparison, JointScore
from pumaid.reporting.formatting import amperes, joint_title, joint_titles, listed, percent, plural
from pumaid.results.history import Rung, effect_words
from pumaid.robot import Robot
from pumaid.units import number

#: RMSE over noise floor above which a joint needs attention: a floor from a few dozen replicates is known to a tenth,
#: so a quarter more is beyond chance.
ATTENTION = 1.25
#: RMSE over noise floor up to which a joint is at the floor, and below which the floor holds more than noise.
AT_FLOOR, BELOW_FLOOR = 1.1, 0.8
#: RMSE over noise floor up to which a verdict holds.
FLOOR_VERDICTS = {
    BELOW_FLOOR: "below the floor, so repeated runs differ by something that the model follows (drift, warm-up)",
    AT_FLOOR: "at the floor, nothing missing that repeated runs can show",
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

#: A share below this is written as "less than 1 %"; ripples named in a sentence.
SMALLEST_SHARE, MOST_RIPPLES = 0.005, 3

#: Limits of the method, whatever the data.
METHOD_LIMITS = (
    "Parameters are in units of each joint's own motor current; torque constants and gear ratios are neither known nor"
    " needed.",
    "Lengths a and d of a chain of revolute joints are absorbed in the parameters: a wrong length in the recipe is not"
    " detected here and does not change the predicted current.",
    "At constant speed there is no inertia in the current; only strokes from rest to rest contain it.",
    "Confidence intervals treat a run as one observation, because its samples share their error. With fewer than about"
    " ten runs a joint they are wide.",
    "Predictions are reliable within the postures, speeds and directions of the fitted runs.",
)


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


def data_sentence(dataset: Dataset) -> str:
    """What the logs contain."""
    runs, files = dataset.runs, dataset.files
    strokes, heldout = sum(run.kind == "stroke" for run in runs), sum(run.heldout for run in runs)
    words = plural(len(runs), "run") + (f" in {plural(len(files), 'file')}" if files else "")
    words += f", {number(sum(run.duration for run in runs), 3)} s of motion of a single joint"
    words += f"; {strokes} of them are strokes from rest to rest, with an inertia term" if strokes else ""
    return words + (f"; {plural(heldout, 'run')} held out for validation." if heldout else ".")


def parameters_sentence(estimate: Estimate) -> str:
    """How many parameters are identified."""
    values = [value for value in estimate.values if not is_structural(value)]
    identified = sum(value.state == IDENTIFIED for value in values)
    unknown = sum(value.state == NOT_IDENTIFIABLE for value in values)
    words = f"Identified parameters: {identified} of {len(values)}"
    words += f"; not identifiable: {unknown} (reasons below the table)" if unknown else ""
    sums = len(estimate.combinations)
    return words + (f"; identified combinations of these: {sums}." if sums else ".")


def joint_sentence(score: JointScore, robot: Robot) -> str:
    """How well the model predicts one joint's current, and whether something is missing."""
    title = joint_title(robot, score.joint)
    if score.rmse is None:
        return f"{title} never moves alone in these logs, so its error is unknown."
    words = f"{title}: {_explained(score.explained)}; RMSE {amperes(score.rmse)}, noise floor "
    if score.noise_floor is None:
        words += "unknown (no repeated run)."
    else:
        ratio = (score.rmse - ROUNDING) / max(score.noise_floor, ROUNDING)
        above = f"{number(ratio, 2)} times the floor, so the model lacks something"
        verdict = next((text for limit, text in FLOOR_VERDICTS.items() if ratio <= limit), above)
        words += f"{amperes(score.noise_floor)}: {verdict}."
    if score.heldout is not None and score.heldout_runs < score.runs:
        words += f" Hold-out RMSE ({plural(score.heldout_runs, 'run')}): {amperes(score.heldout)}."
    if score.undetermined:
        words += f" {plural(score.undetermined, 'run')} depend on parameters that are not identified."
    return words


def _explained(share: float | None) -> str:
    if share is None:
        return "the measured current is constant"
    if share < 0.0:
        return "the model is no better than a constant current"
    return f"the model explains {percent(share)} of the current's variance"


# Residual budget


def part_share(budget: Budget, part: BudgetPart) -> float:
    """A part's share of the mean squared residual, no unit; 0 where there is no residual."""
    return part.mean_square / budget.mean_square if budget.mean_square > 0.0 else 0.0


def share_text(share: float) -> str:
    """A share in whole percent."""
    return "less than 1 %" if 0.0 < share < SMALLEST_SHARE else f"{100.0 * share:.0f} %"


def significant_parts(budget: Budget) -> list[BudgetPart]:
    """Parts that are more than noise would give, the largest first."""
    return sorted((part for part in budget.parts if part.is_more), key=lambda part: -part.mean_square)


def is_noise_only(budget: Budget) -> bool:
    """Whether a joint's residual is noise, as far as the runs can show."""
    return not significant_parts(budget) and budget.part("unassigned").mean_square == 0.0


def part_sentence(budget: Budget, part: BudgetPart) -> str:
    """What a part says of the residual, without a full stop."""
    if part.name == "fast" and part.is_more:
        motor = [f" ({number(turns, 3)} a motor turn)" for turns in part.gearing] or [""] * len(part.cycles)
        waves = [number(cycles, 4) + turns for cycles, turns in zip(part.cycles, motor, strict=True)]
        more = [f"{len(waves) - MOST_RIPPLES} more"] if len(waves) > MOST_RIPPLES else []
        size = " whose amplitude changes along the run" if "size" in part.against else ""
        words = f"is ripple over position{size}: {listed(waves[:MOST_RIPPLES] + more)} cycles per {part.per}"
    elif part.name == "unassigned" and part.is_more:
        words = "repeats from run to run but matches no known pattern"
    elif part.name == "unassigned" and "few-runs" in budget.limits:
        words = "is slow within runs: noise or missing physics (too few runs to separate them)"
    elif part.name == "unassigned":
        words = "differs from run to run: noise or missing physics (repeated runs would separate them)"
    elif part.name.startswith("noise"):
        words = f"is {PART_NAMES[part.name]}"
    else:
        words = "; part of it ".join(PATTERNS[part.name, variable] for variable in part.against)
    return f"{share_text(part_share(budget, part))} {words}".rstrip()


def budget_sentence(score: JointScore, robot: Robot) -> str:
    """The parts of a joint's residual, the largest first, then its noise."""
    budget = score.budget
    if budget is None:
        return f"{joint_title(robot, score.joint)} never moves alone in these logs."
    parts, unassigned = significant_parts(budget), budget.part("unassigned")
    if unassigned.mean_square > 0.0 and not unassigned.is_more:
        parts.append(unassigned)
    words = [part_sentence(budget, part) for part in parts]
    noise = share_text(budget.noise / budget.mean_square if budget.mean_square > 0.0 else 1.0)
    is_judged = budget.replicates > 0 and "few-runs" not in budget.limits
    words += [f"{noise} is noise" + ("" if is_judged else ", as far as these runs can show")]
    effects = list(dict.fromkeys(effect for part in parts if part.is_more for effect in part.points_to))
    similar = f" Effects with this pattern: {listed(effects, 'or')}." if effects else ""
    return f"{joint_title(robot, score.joint)}, RMSE {amperes(score.rmse)}: {'; '.join(words)}.{similar}"


def noise_only_sentence(comparison: Comparison, robot: Robot) -> str:
    """Which joints' residuals are noise alone; empty where none is."""
    joints = [joint for joint, budget in _budgets(comparison).items() if is_noise_only(budget)]
    who = _who(joints, comparison, robot)
    return f"{who}: the residual is noise, as far as these runs can show." if joints else ""


def budget_limit_sentences(comparison: Comparison, robot: Robot) -> list[str]:
    """What the runs cannot separate, without a full stop; one sentence for all joints that lack the same."""
    out = []
    for slug, text in BUDGET_LIMITS.items():
        joints = [joint for joint, budget in _budgets(comparison).items() if slug in budget.limits]
        out += [f"{_who(joints, comparison, robot)}: {text}"] if joints else []
    return out


def _budgets(comparison: Comparison) -> dict[int, Budget]:
    return {score.joint: score.budget for score in comparison.joints if score.budget is not None}


def _who(joints: Sequence[int], comparison: Comparison, robot: Robot) -> str:
    return "All joints" if len(joints) == len(_budgets(comparison)) > 1 else joint_titles(robot, joints)


# History of models


def changes(rung: Rung) -> list[str]:
    """What a model adds to the one it was made from (``+ stribeck@3``) and what it removes."""
    is_first = rung.parent is None
    words = ["base model"] if is_first else []
    words += [f"+ {name}" for name in effect_words(rung.effects if is_first else rung.added, len(rung.joints))]
    words += [f"− {name}" for name in effect_words(rung.removed, len(rung.joints)) if not is_first]
    return words or ["fitted again"]
