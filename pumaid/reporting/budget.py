"""The residual budget in words, bars and JSON: how much of an error is noise, and where the rest lives."""

from __future__ import annotations

from typing import Any

from pumaid.records import Budget, BudgetPart, Comparison, JointScore
from pumaid.reporting.diagnosis import Told
from pumaid.reporting.findings import listed_or
from pumaid.reporting.numbers import amperes
from pumaid.reporting.story import joint_title
from pumaid.reporting.wording import listed
from pumaid.robot import Robot
from pumaid.units import number

#: What each part is called in figures and beside bars.
LABELS = {
    "noise_shared": "noise, shared by a run",
    "noise_inside": "noise, inside runs",
    "smooth": "within runs, smooth",
    "fast": "within runs, ripple",
    "start": "start of runs",
    "odd": "between runs, opposing",
    "even": "between runs, same way",
    "time": "time and temperature",
    "unassigned": "unassigned",
}

#: What a part does, by part and variable; it follows a share of the error.
SAID = {
    ("smooth", "position"): "is smooth with position and the same both ways, as what a spring or a bent gravity leaves",
    ("smooth", "direction"): "is smooth with position and turns round with the direction, as friction that varies with"
    " position does",
    ("smooth", "posture"): "changes over each run as weight does, and differs between postures, as wrong gravity does",
    ("smooth", "load"): "follows the load and how it changes with position, as a gear or link that yields does",
    ("start", "travel"): "stands where a run begins and fades as it travels, as presliding or inertia does",
    ("odd", "direction"): "opposes motion throughout, as friction does that is not what it was in the fitted logs",
    ("odd", "speed"): "opposes motion and changes with speed, as Stribeck friction or a power law does",
    ("odd", "load"): "opposes motion and grows with the load, as friction in a loaded gear does",
    ("odd", "lag"): "lags behind the position, as where position and current are stamped apart",
    ("odd", "posture"): "opposes motion and differs between postures, as friction under a side load does",
    ("even", "direction"): "pushes one way throughout, as a current sensor's offset or a changed weight does",
    ("even", "posture"): "is the same both ways and differs between postures, as wrong gravity does",
    ("even", "load"): "bends with the load, the same both ways, as a motor that gives less at high current does",
    ("even", "speed"): "is the same both ways and changes with speed",
    ("time", "time"): "opposes motion and changes with time, as a warm-up or a step of friction does",
    ("time", "even"): "pushes the same both ways and changes with time, as a load that was put on does",
    ("time", "load"): "grows with the load and changes with time, as a motor that warms up or a load put on does",
    ("time", "temperature"): "follows the temperature, as warm grease does",
}

#: What these runs cannot split, by slug.
LIMITS = {
    "few-runs": "too few runs to tell anything but a ripple from slow noise",
    "no-replicates": "no run is repeated, so noise that a run has as a whole cannot be told from missing physics",
    "one-direction": "run in one direction only, so what opposes motion cannot be told from what does not",
    "one-posture": "run in one posture only, so load and position cannot be told apart",
    "one-speed": "run at one speed only, so nothing shows against speed, and a ripple may be a hum in time",
    "two-speeds": "run at two speeds only, which any friction fits",
    "strokes": "strokes that never hold a speed, so speed and position change together",
    "several-clocks": "recordings with clocks of their own, so time is looked at within each only",
    "no-load": "weight is not known apart from friction, so nothing is held against the load",
}

#: How to read it.
CAPTION = (
    "Shares are of the error's square, so that they add up. Filled bars are more than noise would give in 19 of 20 data"
    " sets in which nothing is missing; which effect it is: see diagnose."
)

#: Of a sentence: a share below this is told as "less than".
LEAST_TOLD = 0.005
#: Characters of a bar that is the whole error; what fills it with noise and with the rest.
WIDTH, NOISE, CAUSE = 40, "░", "█"
#: Ripples told in a sentence.
MOST_RIPPLES = 3


def part_share(budget: Budget, part: BudgetPart) -> float:
    """A part's share of the error's square, no unit; 0 where there is no error."""
    return part.mean_square / budget.mean_square if budget.mean_square > 0.0 else 0.0


def share_text(share: float) -> str:
    """A share for people, in whole percent.

    Examples
    --------
    >>> share_text(0.928), share_text(0.002), share_text(0.0)
    ('93 %', 'less than 1 %', '0 %')
    """
    return "less than 1 %" if 0.0 < share < LEAST_TOLD else f"{100.0 * share:.0f} %"


def found_parts(budget: Budget) -> list[BudgetPart]:
    """Parts that are more than noise would give, the largest first."""
    return sorted((part for part in budget.parts if part.is_more), key=lambda part: -part.mean_square)


def part_sentence(budget: Budget, part: BudgetPart) -> str:
    """What a part says of the error, without a full stop."""
    share = share_text(part_share(budget, part))
    if part.name == "fast" and part.is_more:
        waves = [_wave(part, k) for k in range(min(len(part.cycles), MOST_RIPPLES))]
        waves += [f"{len(part.cycles) - MOST_RIPPLES} more"] if len(part.cycles) > MOST_RIPPLES else []
        size = " that changes its size along the run" if "size" in part.against else ""
        return f"{share} is ripple with position{size}: {listed(waves)} cycles per {part.per}"
    if part.name == "unassigned":
        return f"{share} {_unassigned(budget, part)}"
    if part.name.startswith("noise"):
        where = "of whole runs" if part.name == "noise_shared" else "inside runs"
        return f"{share} is noise {where}"
    said = [SAID[part.name, against] for against in part.against]
    return f"{share} {said[0]}" + "".join(f"; some of it {other}" for other in said[1:]) if said else f"{share}"


def _wave(part: BudgetPart, k: int) -> str:
    cycles = number(part.cycles[k], 4)
    return f"{cycles} ({number(part.gearing[k], 3)} a motor turn)" if part.gearing else cycles


def _unassigned(budget: Budget, part: BudgetPart) -> str:
    if part.is_more:
        return "repeats from run to run and follows none of these"
    if "few-runs" in budget.limits:
        return "is slow within runs: noise or missing physics, which so few runs cannot tell"
    return "differs from run to run: noise or missing physics, which only repeated runs would tell"


def budget_sentence(score: JointScore, robot: Robot) -> str:
    """Where a joint's error lives, the largest part first, and how much of it no model removes."""
    budget = score.budget
    if budget is None:
        return f"{joint_title(robot, score.joint)} never moves alone in these logs."
    told = [part_sentence(budget, part) for part in found_parts(budget)]
    unassigned = budget.part("unassigned")
    told += [part_sentence(budget, unassigned)] if unassigned.mean_square > 0.0 and not unassigned.is_more else []
    noise = share_text(budget.noise / budget.mean_square if budget.mean_square > 0.0 else 1.0)
    noise += " is noise" + (" that no model removes" if _is_judged(budget) else ", as far as these runs can tell")
    lead = f"{joint_title(robot, score.joint)}, {amperes(score.rmse)} left: "
    effects = list(dict.fromkeys(effect for part in found_parts(budget) for effect in part.points_to))
    alike = f" Effects that look like it: {listed_or(effects)}." if effects else ""
    return lead + "; ".join([*told, noise]) + "." + alike


def _is_judged(budget: Budget) -> bool:
    return budget.replicates > 0 and "few-runs" not in budget.limits


def is_plain(budget: Budget) -> bool:
    """Whether a joint's error is noise and nothing else, as far as the runs can tell."""
    return not found_parts(budget) and budget.part("unassigned").mean_square == 0.0


def bars(budget: Budget) -> str:
    """Every part that is not nothing, with its share and a bar; lines."""
    shown = [part for part in budget.parts if part.mean_square > 0.0]
    wide = max((len(LABELS[part.name]) for part in shown), default=0)
    return "\n".join(_bar(budget, part, wide) for part in shown)


def _bar(budget: Budget, part: BudgetPart, wide: int) -> str:
    share = part_share(budget, part)
    mark = NOISE if part.name.startswith("noise") or not part.is_more else CAUSE
    bar = mark * max(round(WIDTH * share), 1)
    return f"{LABELS[part.name]:<{wide}}  {100.0 * share:5.1f} %  {bar}"


def noise_only_sentence(comparison: Comparison, robot: Robot) -> str | None:
    """Which joints' errors are noise alone; None where none is."""
    plain = [score for score in comparison.joints if score.budget is not None and is_plain(score.budget)]
    if not plain:
        return None
    moving = sum(score.budget is not None for score in comparison.joints)
    names = listed([joint_title(robot, score.joint) for score in plain])
    who = "All joints" if len(plain) == moving > 1 else names
    return f"{who}: all that is left is noise, as far as these runs can tell."


def limit_sentences(comparison: Comparison) -> list[str]:
    """What the runs cannot split, without a full stop; one sentence for joints that lack the same."""
    joints: dict[str, list[str]] = {}
    for score in comparison.joints:
        for slug in score.budget.limits if score.budget is not None else ():
            joints.setdefault(slug, []).append(str(score.joint))
    moving = sum(score.budget is not None for score in comparison.joints)
    out = []
    for slug, text in LIMITS.items():
        own = joints.get(slug, [])
        if own:
            who = "every joint" if len(own) == moving > 1 else f"joint{'s' * (len(own) > 1)} {listed(own)}"
            out.append(f"{who}: {text}")
    return out


def budget_shown(comparison: Comparison, robot: Robot) -> list[Told]:
    """For the terminal: a sentence and bars for each joint whose error is more than noise, then the others.

    Parameters
    ----------
    comparison
        With budgets.
    robot
        Names of joints.
    """
    parts = [Told(""), Told("Where the error lives", style="bold")]
    for score in comparison.joints:
        if score.budget is not None and not is_plain(score.budget):
            parts += [Told(budget_sentence(score, robot)), Told(bars(score.budget), 2), Told("")]
    plain, limits = noise_only_sentence(comparison, robot), limit_sentences(comparison)
    parts += [Told(plain)] if plain else []
    parts += [Told("What these runs cannot split:"), *(Told(f"- {text}", 2) for text in limits)] if limits else []
    return [*parts, Told(CAPTION, style="dim")] if len(parts) > 2 else []


def budget_document(budget: Budget | None) -> dict[str, Any] | None:
    """A joint's budget in the comparison's JSON document; SI. None where the joint has no runs."""
    if budget is None:
        return None
    return {
        "mean_square": budget.mean_square,
        "noise": budget.noise,
        "floor": budget.floor,
        "runs": budget.runs,
        "replicates": budget.replicates,
        "parts": [_part_document(budget, part) for part in budget.parts],
        "limits": {slug: LIMITS[slug] for slug in budget.limits},
    }


def _part_document(budget: Budget, part: BudgetPart) -> dict[str, Any]:
    return {
        "name": part.name,
        "mean_square": part.mean_square,
        "share": part_share(budget, part),
        "p_value": part.p_value,
        "more_than_noise": part.is_more,
        "against": part.against,
        "cycles": part.cycles,
        "cycles_per": part.per or None,
        "cycles_per_motor_turn": part.gearing,
        "points_to": part.points_to,
        "text": part_sentence(budget, part) if part.is_more else None,
    }
