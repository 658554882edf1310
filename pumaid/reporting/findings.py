"""A diagnosis in plain sentences: what is missing and where, how sure that is, what would decide, what adds it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pumaid.effects import Scope, catalogue
from pumaid.records import ADD, Candidate, Diagnosis, Estimate, Finding, JointDiagnosis, Limit, Transfer
from pumaid.reporting.numbers import amperes, in_unit, percent, with_error
from pumaid.reporting.story import joint_title
from pumaid.reporting.wording import AT_FLOOR, BELOW_FLOOR, listed, plural
from pumaid.robot import Robot
from pumaid.units import number

#: A chance below this is told as less than one in a million: no experiment is that sure of its noise.
SUREST = 1e-6


#: What a suspected column of the logs is multiplied by, in the order of its shape ``times``.
TIMES = ("as it is", "times the direction", "times the load")

#: How the name of a suspected column begins.
SUSPECT = "suspect:"


def label(effect: str) -> str:
    """An effect's name in a sentence; a suspected column as what it is, a rival at another joint with that."""
    if effect.startswith(SUSPECT):
        return f"what follows column {effect.removeprefix(SUSPECT)}"
    name, at, joint = effect.partition("@")
    return f"{name} at joint {joint}" if at else name


def place(found: Finding | Candidate | Limit, robot: Robot) -> str:
    """Where an effect acts: ``joint 3 (elbow)``, or ``the whole arm``."""
    if found.joint is None:
        return "the whole arm"
    title = joint_title(robot, found.joint)
    return title[0].lower() + title[1:]


def finding_title(found: Finding, robot: Robot) -> str:
    """Where and what, with the names that these data cannot tell from it."""
    where = place(found, robot)
    verb = "is missing" if found.verdict == ADD else "may be missing"
    words = f"{where[0].upper()}{where[1:]}: {label(found.effect)} {verb}"
    if found.rivals:
        names = listed_or([label(name) for name in found.rivals])
        words += f", or {names}, which these data cannot tell from it"
    return words


def added_title(found: Finding, robot: Robot) -> str:
    """Of an effect that an earlier diagnosis found and the model now holds."""
    where = place(found, robot)
    return f"{where[0].upper()}{where[1:]}: {label(found.effect)} was missing, and is in the model now"


def finding_sentences(found: Finding, diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> list[str]:
    """What a finding is, what it explains, how sure it is, and how large the effect is.

    Parameters
    ----------
    found
        One of the diagnosis' findings.
    diagnosis
        All of it, for the joint's error and the candidate's reason.
    robot
        Names of joints.
    units
        ``"rad"`` or ``"deg"``.
    """
    own = next((one for one in diagnosis.joints if one.joint == found.joint), None)
    out = [*effect_sentences(found.effect)]
    is_added = any(found is one for one in diagnosis.applied)
    if own is not None and not is_added and _of_scope(found.effect) in (Scope.JOINT, None):
        out.append(floor_sentence(own))
    if found.rmse_heldout_before is not None and found.rmse_heldout_after is not None:
        out.append(heldout_sentence(found.rmse_heldout_before, found.rmse_heldout_after))
    if found.transfer is not None and found.transfer.is_clear:
        out.append(transfer_sentence(found.transfer))
    out.append(chance_sentence(found.p_value))
    reason = next((one.reason for one in _candidates(diagnosis, found) if one.reason), "")
    if found.verdict != ADD and reason:
        out.append(f"Why it is doubtful: {reason}{'' if reason.endswith('.') else '.'}")
    size = size_sentence(found, robot, units)
    return [*out, *([size] if size else [])]


def _candidates(diagnosis: Diagnosis, found: Finding) -> Iterable[Candidate]:
    for joint in diagnosis.joints:
        yield from (one for one in joint.candidates if (one.effect, one.joint) == (found.effect, found.joint))


def _of_scope(effect: str) -> Scope | None:
    return catalogue()[effect].scope if effect in catalogue() else None


def effect_sentences(effect: str) -> list[str]:
    """What an effect is; nothing where the catalogue does not have it."""
    if effect not in catalogue():
        return []
    known = catalogue()[effect]
    return [f"{known.title}." + (f" It adds the current {known.equation}." if known.equation else "")]


def transfer_sentence(found: Transfer) -> str:
    """How much of an effect the runs held out show."""
    share = f"{number(100.0 * found.share, 2)} ± {number(100.0 * found.std_error, 1)} %"
    if found.is_denied:
        what = "so it is not this effect, or not in this form, although it fits the other runs"
    elif found.is_partial:
        what = "not all of it, so something else is there as well, or instead"
    else:
        what = "all of it, within that error"
    return f"Of what it adds there, these runs show {share}: {what}."


def is_at_floor(found: JointDiagnosis) -> bool:
    """Whether a joint's error is no more than what repeated runs differ by, as far as that is known."""
    known = found.rmse is not None and found.noise_floor is not None
    return known and (found.rmse or 0.0) <= AT_FLOOR * (found.noise_floor or 0.0)


def floor_sentence(found: JointDiagnosis) -> str:
    """A joint's error against what repeated runs differ by."""
    if found.rmse is None:
        return f"Joint {found.joint} never moves alone in these logs, so nothing is known of its error."
    if found.noise_floor is None:
        return (
            f"The model misses by {amperes(found.rmse)}; no run is repeated, so how much of it is noise is not known."
        )
    if is_at_floor(found):
        return f"The model misses by {amperes(found.rmse)}, and repeated runs differ by {amperes(found.noise_floor)}."
    times = number(found.rmse / found.noise_floor, 2)
    return (
        f"The model misses by {amperes(found.rmse)} where repeated runs differ by {amperes(found.noise_floor)}:"
        f" {times} times as much."
    )


def heldout_sentence(before: float, after: float) -> str:
    """What becomes of the error on runs that no fit saw."""
    fall = f", {percent(1.0 - after / before)} less" if 0.0 < after < before else ""
    return f"With it, the error on runs that the fit did not see goes from {amperes(before)} to {amperes(after)}{fall}."


def chance_sentence(p: float) -> str:
    """How sure a finding is."""
    return (
        f"How sure: if nothing were missing, {chance(p)} such experiments would show something as strong by chance"
        f" (p = {number(p, 2)}, all effects and joints counted)."
    )


def chance(p: float) -> str:
    """A probability in words.

    Examples
    --------
    >>> chance(0.0033), chance(0.04), chance(0.3), chance(1e-9)
    ('one in 300', 'one in 25', 'three in ten', 'less than one in a million')
    """
    if p < SUREST:
        return "less than one in a million"
    if p >= 0.15:
        tenths = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
        return f"{tenths[min(max(round(10 * p), 1), 10) - 1]} in ten"
    times = 1.0 / p
    digits = 1 if times >= 100 else 2
    return f"one in {int(float(f'{times:.{digits - 1}e}')):,}"


def step_sentence(found: Finding, before: Estimate, after: Estimate, *, robot: Robot, number: int) -> str:
    """What an addition did to the joint that it changed most.

    Parameters
    ----------
    found
        What was added.
    before, after
        The model without and with it.
    robot
        Names of joints.
    number
        Of the step, from 1.
    """
    both = [(old, new) for old, new in zip(before.joints, after.joints, strict=True) if old.rmse and new.rmse]
    head = f"{number}. {label(found.effect)} {'of' if found.joint is None else 'at'} {place(found, robot)} added"
    if not both:
        return f"{head}."
    old, new = min(both, key=lambda pair: (pair[1].rmse or 0.0) / (pair[0].rmse or 1.0))
    words = f"{head}: joint {new.joint} is missed by {amperes(new.rmse)} instead of {amperes(old.rmse)}"
    rest = []
    if old.heldout is not None and new.heldout is not None:
        rest.append(f"runs that were not fitted by {amperes(new.heldout)} instead of {amperes(old.heldout)}")
    if new.noise_floor is not None and (new.rmse or 0.0) >= BELOW_FLOOR * new.noise_floor:
        rest.append(f"the noise floor is {amperes(new.noise_floor)}")
    return f"{words}{'; ' + '; '.join(rest) if rest else ''}."


def left_out_sentence(found: Finding, before: float, after: float, *, robot: Robot) -> str:
    """That an addition was not kept, since the error (A) of the fitted runs rose."""
    where = "of" if found.joint is None else "at"
    return (
        f"{label(found.effect)} {where} {place(found, robot)} left out: with it the fitted runs are missed by"
        f" {amperes(after)} instead of {amperes(before)}, for these runs cannot tell it from what the model has."
    )


def bare(unit: str) -> str:
    """A unit for people: none where a number has none."""
    return "" if unit == "1" else unit


def size_sentence(found: Finding | Candidate, robot: Robot, units: str = "rad") -> str:
    """How large an effect is, with its shape; empty where neither is told."""
    sizes = []
    for size in found.sizes:
        times, unit = in_unit(bare(size.unit), units)
        value, error = with_error(times * size.value, times * size.std_error)
        sizes.append(f"{size.name.rsplit('.', 1)[-1]} = {value} ± {error} {unit}".rstrip())
    shape = shape_text(found, robot, units)
    if not sizes:
        return f"Its shape: {shape}." if shape else ""
    joint = ", " if found.effect.startswith(SUSPECT) else ", with "
    return f"Its size: {listed(sizes)}" + (f"{joint}{shape}." if shape else ".")


def shape_text(found: Finding | Candidate, robot: Robot, units: str = "rad") -> str:
    """The nonlinear parameters of an effect with their units."""
    if found.effect.startswith(SUSPECT):
        return TIMES[int(found.shape.get("times", 0.0))]
    known = catalogue()[found.effect].shapes(robot, found.joint or 0) if found.effect in catalogue() else ()
    unit_of = {shape.name: bare(shape.unit) for shape in known}
    words = []
    for name, value in found.shape.items():
        times, unit = in_unit(unit_of.get(name, ""), units)
        words.append(f"{name} {times * value:.4g} {unit}".rstrip())
    return listed(words)


def decision_sentence(found: Finding) -> str:
    """The run that would decide between an effect and its rivals, or why none would; empty where nothing is open."""
    run = found.next_run
    if run is None:
        return ""
    text = run.text.rstrip(".")
    if not run.motions:
        return f"{text[0].upper()}{text[1:]}."
    often = f", all of them {number_of_times(run.repeats)}" if run.repeats and run.repeats > 1 else ""
    runs = plural(len(run.motions), "run")
    return f"To decide: {text} ({runs}{often}; pumaid diagnose --plan FILE writes them)."


def number_of_times(count: int) -> str:
    """``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def limit_sentence(limit: Limit, robot: Robot, units: str = "rad") -> str:
    """What would have been found: ``stribeck at joint 3 (elbow) with a larger than 0.03 A would have been found``."""
    times, unit = in_unit(bare(limit.unit), units)
    size = f"{number(times * (limit.size or 0.0), 2)} {unit}".rstrip()
    at = "of the whole arm" if limit.joint is None else f"at {place(limit, robot)}"
    return f"{limit.effect} {at} with {limit.parameter} larger than {size} would have been found"


def listed_or(words: Sequence[str]) -> str:
    """``a, b or c``."""
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
