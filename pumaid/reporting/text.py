"""Sentences about a model and its errors on logs: for engineers, with the numbers in them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from pumaid.errors import Note
from pumaid.estimate import IDENTIFIED, NOT_IDENTIFIABLE, Value
from pumaid.estimation.comparison import Budget, BudgetPart, Comparison, JointScore
from pumaid.reporting.context import ReportContext
from pumaid.reporting.formatting import amperes, joint_title, joint_titles, listed, percent, plural
from pumaid.results.history import Ladder, Rung
from pumaid.robot import EffectChoice, Robot
from pumaid.units import number

#: RMSE over noise floor above which a joint needs attention: a floor from a few dozen replicates is known to a tenth,
#: so a quarter more is beyond chance.
ATTENTION = 1.25
#: RMSE over noise floor up to which a joint is at the floor, and below which the floor holds more than noise.
AT_FLOOR, BELOW_FLOOR = 1.1, 0.8
#: A: errors below this are round-off.
ROUNDING = 1e-7
#: Predictions that vary by less than this share of the RMSE are one current.
CONSTANT = 0.2

EFFECT_NAMES = {"gravity": "gravity", "coulomb": "Coulomb friction", "viscous": "viscous friction"}

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
    """Notes, each once; the same note of several joints becomes one.

    Notes are the same when slug and place (but for the joint) agree, and the text behind ``joint N`` at its beginning.

    Examples
    --------
    >>> from pumaid.errors import Where
    >>> two = [Note("few-runs", f"joint {n} has 1 run: its errors are too small", Where(joint=n)) for n in (2, 3)]
    >>> print(*merge_notes(two))
    note[few-runs]: each of joints 2 and 3 has 1 run: its errors are too small
    """
    groups: dict[tuple[object, ...], list[Note]] = {}
    for note in dict.fromkeys(notes):
        rest = re.sub(rf"^joint {note.where.joint}(?=[ :])", "", note.text, flags=re.IGNORECASE)
        is_of_joint = note.where.joint is not None and rest != note.text
        key: tuple[object, ...] = (note.slug, replace(note.where, joint=None), rest) if is_of_joint else (note,)
        groups.setdefault(key, []).append(note)
    merged = []
    for key, group in groups.items():
        note = group[0]
        if len(group) > 1:
            joints, rest = listed([str(other.where.joint) for other in group]), str(key[-1])
            text = f"joints {joints}{rest}" if rest.startswith(":") else f"each of joints {joints}{rest}"
            note = Note(note.slug, text, replace(note.where, joint=None))
        merged.append(note)
    return merged


# Model and comparison


def data_sentence(context: ReportContext) -> str:
    """What the logs contain."""
    runs, files = context.dataset.runs, context.dataset.files
    strokes, heldout = sum(run.kind == "stroke" for run in runs), sum(run.heldout for run in runs)
    words = plural(len(runs), "run") + (f" in {plural(len(files), 'file')}" if files else "")
    words += f", {number(sum(run.duration for run in runs), 3)} s of motion of a single joint"
    words += f"; {strokes} of them are strokes from rest to rest, with an inertia term" if strokes else ""
    return words + (f"; {plural(heldout, 'run')} held out for validation." if heldout else ".")


def parameters_sentence(context: ReportContext) -> str:
    """How many parameters are identified."""
    values = [value for value in context.estimate.values if not is_structural(value)]
    identified = sum(value.state == IDENTIFIED for value in values)
    unknown = sum(value.state == NOT_IDENTIFIABLE for value in values)
    words = f"{identified} of {len(values)} parameters are identified"
    if unknown:
        words += f"; {unknown} {'is' if unknown == 1 else 'are'} not identifiable (reasons below the table)"
    sums = len(context.estimate.combinations)
    if sums:
        words += f", but {plural(sums, 'combination')} of parameters {'is' if sums == 1 else 'are'}"
    return words + "."


def joint_sentence(context: ReportContext, score: JointScore) -> str:
    """How well the model predicts one joint's current, and whether something is missing."""
    title = context.title(score.joint)
    if score.rmse is None:
        return f"{title} never moves alone in these logs, so its error is unknown."
    words = f"{title}: {_explained(context, score)}; RMSE {amperes(score.rmse)}"
    if score.noise_floor is not None:
        ratio = (score.rmse - ROUNDING) / max(score.noise_floor, ROUNDING)
        words += f", noise floor {amperes(score.noise_floor)}: {_floor_verdict(ratio)}"
    words += "."
    if score.heldout is not None and score.heldout_runs < score.runs:
        words += f" Hold-out RMSE ({plural(score.heldout_runs, 'run')}): {amperes(score.heldout)}."
    if score.undetermined:
        words += f" {plural(score.undetermined, 'run')} depend on parameters that are not identified."
    return words


def _explained(context: ReportContext, score: JointScore) -> str:
    if (score.rms or 0.0) <= ROUNDING:
        return "no current was measured"
    if score.explained is None:
        return "the measured current is constant"
    predicted = np.concatenate([run.predicted for run in context.comparison.of_joint(score.joint)])
    if float(np.ptp(predicted)) <= CONSTANT * (score.rmse or 0.0):
        return "the predicted current is the same in all runs, so there is no variation to explain"
    if score.explained < 0.0:
        return "the model is worse than a constant current"
    return f"the model explains {percent(score.explained)} of the current's variance"


def _floor_verdict(ratio: float) -> str:
    if ratio < BELOW_FLOOR:
        return "below the floor, so repeated runs differ by something that the model follows (drift, warm-up)"
    if ratio <= AT_FLOOR:
        return "at the floor, nothing missing that repeated runs can show"
    if ratio <= ATTENTION:
        return "little above the floor"
    return f"{number(ratio, 2)} times the floor, so the model lacks something"


def still_sentence(context: ReportContext) -> str | None:
    """Which joints never move alone; None where all do."""
    still = [str(score.joint) for score in context.comparison.joints if score.rmse is None]
    if not still:
        return None
    return f"Joint{'s' * (len(still) > 1)} {listed(still)} never move{'s' * (len(still) == 1)} alone in these logs."


def noise_sentence(context: ReportContext) -> str | None:
    """Which joints have no noise floor; None where all have one."""
    scores = [score for score in context.comparison.joints if score.rmse is not None]
    blind = [str(score.joint) for score in scores if score.noise_floor is None]
    if not blind:
        return None
    which = "any joint" if len(blind) == len(scores) else f"joint{'s' * (len(blind) > 1)} {listed(blind, 'or')}"
    return (
        f"No run of {which} is repeated, so the noise floor is unknown:"
        " repeat a few runs (same posture, speed and direction)."
    )


# Residual budget


def part_share(budget: Budget, part: BudgetPart) -> float:
    """A part's share of the mean squared residual, no unit; 0 where there is no residual."""
    return part.mean_square / budget.mean_square if budget.mean_square > 0.0 else 0.0


def share_text(share: float) -> str:
    """A share in whole percent.

    Examples
    --------
    >>> share_text(0.928), share_text(0.002), share_text(0.0)
    ('93 %', 'less than 1 %', '0 %')
    """
    return "less than 1 %" if 0.0 < share < SMALLEST_SHARE else f"{100.0 * share:.0f} %"


def significant_parts(budget: Budget) -> list[BudgetPart]:
    """Parts that are more than noise would give, the largest first."""
    return sorted((part for part in budget.parts if part.is_more), key=lambda part: -part.mean_square)


def is_noise_only(budget: Budget) -> bool:
    """Whether a joint's residual is noise, as far as the runs can show."""
    return not significant_parts(budget) and budget.part("unassigned").mean_square == 0.0


def part_sentence(budget: Budget, part: BudgetPart) -> str:
    """What a part says of the residual, without a full stop."""
    share = share_text(part_share(budget, part))
    if part.name == "fast" and part.is_more:
        waves = [_wave(part, index) for index in range(min(len(part.cycles), MOST_RIPPLES))]
        waves += [f"{len(part.cycles) - MOST_RIPPLES} more"] if len(part.cycles) > MOST_RIPPLES else []
        size = " whose amplitude changes along the run" if "size" in part.against else ""
        return f"{share} is ripple over position{size}: {listed(waves)} cycles per {part.per}"
    if part.name == "unassigned":
        return f"{share} {_unassigned(budget, part)}"
    if part.name.startswith("noise"):
        return f"{share} is {PART_NAMES[part.name]}"
    patterns = [PATTERNS[part.name, variable] for variable in part.against]
    return f"{share} {'; part of it '.join(patterns)}" if patterns else share


def _wave(part: BudgetPart, index: int) -> str:
    cycles = number(part.cycles[index], 4)
    return f"{cycles} ({number(part.gearing[index], 3)} a motor turn)" if part.gearing else cycles


def _unassigned(budget: Budget, part: BudgetPart) -> str:
    if part.is_more:
        return "repeats from run to run but matches no known pattern"
    if "few-runs" in budget.limits:
        return "is slow within runs: noise or missing physics (too few runs to separate them)"
    return "differs from run to run: noise or missing physics (repeated runs would separate them)"


def budget_sentence(score: JointScore, robot: Robot) -> str:
    """The parts of a joint's residual, the largest first, then its noise."""
    budget = score.budget
    if budget is None:
        return f"{joint_title(robot, score.joint)} never moves alone in these logs."
    words = [part_sentence(budget, part) for part in significant_parts(budget)]
    unassigned = budget.part("unassigned")
    words += [part_sentence(budget, unassigned)] if unassigned.mean_square > 0.0 and not unassigned.is_more else []
    noise = share_text(budget.noise / budget.mean_square if budget.mean_square > 0.0 else 1.0)
    is_judged = budget.replicates > 0 and "few-runs" not in budget.limits
    words += [f"{noise} is noise" + ("" if is_judged else ", as far as these runs can show")]
    effects = list(dict.fromkeys(effect for part in significant_parts(budget) for effect in part.points_to))
    similar = f" Effects with this pattern: {listed(effects, 'or')}." if effects else ""
    return f"{joint_title(robot, score.joint)}, RMSE {amperes(score.rmse)}: {'; '.join(words)}.{similar}"


def noise_only_sentence(comparison: Comparison, robot: Robot) -> str | None:
    """Which joints' residuals are noise alone; None where none is."""
    joints = [s.joint for s in comparison.joints if s.budget is not None and is_noise_only(s.budget)]
    if not joints:
        return None
    moving = sum(score.budget is not None for score in comparison.joints)
    who = "All joints" if len(joints) == moving > 1 else joint_titles(robot, joints)
    return f"{who}: the residual is noise, as far as these runs can show."


def budget_limit_sentences(comparison: Comparison) -> list[str]:
    """What the runs cannot separate, without a full stop; one sentence for all joints that lack the same."""
    joints: dict[str, list[str]] = {}
    for score in comparison.joints:
        for slug in score.budget.limits if score.budget is not None else ():
            joints.setdefault(slug, []).append(str(score.joint))
    moving = sum(score.budget is not None for score in comparison.joints)
    out = []
    for slug, text in BUDGET_LIMITS.items():
        names = joints.get(slug, [])
        who = "all joints" if len(names) == moving > 1 else f"joint{'s' * (len(names) > 1)} {listed(names)}"
        out += [f"{who}: {text}"] if names else []
    return out


def budget_verdict(context: ReportContext) -> str:
    """Whether any joint's residual is more than noise."""
    scores = [score for score in context.comparison.joints if score.budget is not None]
    joints = [score.joint for score in scores if score.budget and significant_parts(score.budget)]
    if joints:
        return f"{joint_titles(context.robot, joints)}: the residual is more than noise, so some physics is missing."
    return noise_sentence(context) or "No joint's residual is more than noise."


# History of models


def effect_list(effects: Sequence[EffectChoice], n_joints: int) -> list[str]:
    """Effects as on the command line, each kind once: ``stribeck@1,3``, ``spring@all``, ``tilt``."""
    joints: dict[str, list[int]] = {}
    for choice in effects:
        joints.setdefault(choice.effect, []).extend([] if choice.joint is None else [choice.joint])
    words = []
    for effect, numbers in joints.items():
        is_everywhere = n_joints > 1 and sorted(numbers) == list(range(1, n_joints + 1))
        where = "all" if is_everywhere else ",".join(map(str, sorted(numbers)))
        words.append(f"{effect}@{where}" if where else effect)
    return words


def changes(rung: Rung) -> list[str]:
    """What a model adds to the one it was made from (``+ stribeck@3``) and what it removes."""
    if rung.parent is None:
        return ["base model", *(f"+ {name}" for name in effect_list(rung.effects, len(rung.joints)))]
    words = [f"+ {name}" for name in effect_list(rung.added, len(rung.joints))]
    words += [f"− {name}" for name in effect_list(rung.removed, len(rung.joints))]
    return words or ["fitted again"]


def history_sentence(ladder: Ladder) -> str:
    """How the error changed from the first model to the current one."""
    path = ladder.path
    first, last = path[0].whole, path[-1].whole
    if len(path) == 1:
        words = f"The current model is the first one; {plural(len(ladder.rungs) - 1, 'other model')} were tried."
    else:
        steps = plural(len(path) - 1, "step")
        words = f"In {steps} the RMSE of fitted runs went from {amperes(first.fitted)} to {amperes(last.fitted)}"
        if first.heldout is not None and last.heldout is not None:
            words += f", the hold-out RMSE from {amperes(first.heldout)} to {amperes(last.heldout)}"
        words += "."
    return words + (f" Noise floor: {amperes(last.noise_floor)}." if last.noise_floor is not None else "")
