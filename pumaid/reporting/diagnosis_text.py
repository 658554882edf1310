"""Sentences of a diagnosis: what is missing and where, how sure that is, what would decide, how to add it."""

from __future__ import annotations

from dataclasses import replace

from pumaid.diagnosis.records import (
    ADD,
    ADEQUATE,
    UNEXPLAINED_JOINT,
    Candidate,
    Diagnosis,
    Finding,
    JointDiagnosis,
    Limit,
    Transfer,
    Unexplained,
)
from pumaid.effects import Scope, catalogue
from pumaid.estimate import Estimate
from pumaid.reporting.formatting import (
    amperes,
    in_unit,
    joint_title,
    joint_titles,
    listed,
    percent,
    plural,
    with_error,
)
from pumaid.reporting.text import AT_FLOOR, BELOW_FLOOR
from pumaid.robot import Robot
from pumaid.units import number

#: Prefix of the name of a column of the logs that the user suspects (``--suspect``), and what its shape ``times`` says.
SUSPECT = "suspect:"
SUSPECT_FORMS = ("as it is", "times the direction", "times the load")

#: Variables of free forms in words; others have their own name.
VARIABLES = {
    "q": "position",
    "v": "speed",
    "load": "gravity load",
    "t": "time",
    "travel": "travel since the motion began",
}

#: Kind of current by the factor in front of a free form: the sign of motion, the velocity, nothing.
FORMS = {"s": "a friction that depends on", "v": "a viscous friction that depends on", "": "a current that depends on"}


def label(effect: str) -> str:
    """An effect's name in a sentence: ``ripple at joint 3`` for ``ripple@3``, a suspected column as that."""
    if effect.startswith(SUSPECT):
        return f"an effect of column {effect.removeprefix(SUSPECT)}"
    name, at, joint = effect.partition("@")
    return f"{name} at joint {joint}" if at else name


def place(finding: Finding | Candidate | Limit, robot: Robot) -> str:
    """Where an effect acts: ``joint 3 (elbow)``, or ``the whole arm``."""
    if finding.joint is None:
        return "the whole arm"
    title = joint_title(robot, finding.joint)
    return title[0].lower() + title[1:]


def _at(finding: Finding, robot: Robot) -> str:
    return f"{'of' if finding.joint is None else 'at'} {place(finding, robot)}"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def bare(unit: str) -> str:
    """A unit word; empty for a number without unit."""
    return "" if unit == "1" else unit


# Findings


def finding_title(finding: Finding, robot: Robot) -> str:
    """Where and what, with the effects that these data do not separate from it."""
    verb = "is missing" if finding.verdict == ADD else "may be missing"
    return f"{_capital(place(finding, robot))}: {label(finding.effect)} {verb}{_rivals(finding)}"


def _rivals(finding: Finding) -> str:
    """What these data do not separate from a finding, in parentheses; empty without rivals."""
    names = listed([label(name) for name in finding.rivals], "or")
    return f" (these data do not separate it from {names})" if names else ""


def applied_title(finding: Finding, robot: Robot) -> str:
    """Title of an effect that an earlier diagnosis found and the model now has."""
    return f"{_capital(place(finding, robot))}: {label(finding.effect)} was missing and is now in the model"


def finding_sentences(finding: Finding, diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> list[str]:
    """What the effect is, what it explains, how sure that is, and how large it is."""
    effect, out = catalogue().get(finding.effect), []
    if effect is not None:
        out.append(f"{effect.title}." + (f" Current: {effect.equation}." if effect.equation else ""))
    joint = next((item for item in diagnosis.joints if item.joint == finding.joint), None)
    is_applied = any(finding is item for item in diagnosis.applied)
    if joint is not None and not is_applied and (effect is None or effect.scope is Scope.JOINT):
        out.append(floor_sentence(joint))
    before, after = finding.rmse_heldout_before, finding.rmse_heldout_after
    if before is not None and after is not None:
        less = f" ({percent(1.0 - after / before)} less)" if 0.0 < after < before else ""
        out.append(f"RMSE of runs that were not fitted: {amperes(before)} without it, {amperes(after)} with it{less}.")
    if finding.transfer is not None and finding.transfer.is_clear:
        out.append(transfer_sentence(finding.transfer))
    out.append(f"p = {number(finding.p_value, 2)} over all effects and joints (family-wise).")
    reasons = [
        candidate.reason
        for item in diagnosis.joints
        for candidate in item.candidates
        if (candidate.effect, candidate.joint) == (finding.effect, finding.joint) and candidate.reason
    ]
    if finding.verdict != ADD and reasons:
        out.append(f"Doubtful: {reasons[0].rstrip('.')}.")
    size = size_sentence(finding, robot, units)
    return [*out, size] if size else out


def is_at_floor(joint: JointDiagnosis) -> bool:
    """Whether a joint's RMSE is no larger than its noise floor."""
    return joint.rmse is not None and joint.noise_floor is not None and joint.rmse <= AT_FLOOR * joint.noise_floor


def floor_sentence(joint: JointDiagnosis) -> str:
    """The RMSE of a joint that has runs against its noise floor."""
    words = f"RMSE of the model: {amperes(joint.rmse)}"
    if joint.rmse is None or joint.noise_floor is None:
        return f"{words}; no run is repeated, so the noise floor is unknown."
    words += f", noise floor: {amperes(joint.noise_floor)}"
    return words + ("." if is_at_floor(joint) else f" (ratio {number(joint.rmse / joint.noise_floor, 2)}).")


def transfer_sentence(transfer: Transfer) -> str:
    """How much of the effect the held-out runs confirm."""
    share = f"{number(100.0 * transfer.share, 2)} ± {number(100.0 * transfer.std_error, 1)} %"
    words = f"The held-out runs confirm {share} of the predicted effect"
    if transfer.is_denied:
        return f"{words}: it is another effect, or of another form, although it fits the other runs."
    return f"{words}: another effect acts as well, or instead." if transfer.is_partial else f"{words}."


def size_sentence(finding: Finding | Candidate, robot: Robot, units: str = "rad") -> str:
    """How large an effect is, with its shape; empty where neither is known."""
    sizes = []
    for size in finding.sizes:
        scale, unit = in_unit(bare(size.unit), units)
        value, error = with_error(scale * size.value, scale * size.std_error)
        sizes.append(f"{size.name.rsplit('.', 1)[-1]} = {value} ± {error} {unit}".rstrip())
    shape = shape_text(finding, robot, units)
    if not sizes:
        return f"Shape: {shape}." if shape else ""
    joiner = ", " if finding.effect.startswith(SUSPECT) else ", with "
    return f"Size: {listed(sizes)}{joiner + shape if shape else ''}."


def shape_text(finding: Finding | Candidate, robot: Robot, units: str = "rad") -> str:
    """The nonlinear parameters of an effect with their units."""
    if finding.effect.startswith(SUSPECT):
        return SUSPECT_FORMS[int(finding.shape.get("times", 0.0))]
    effect = catalogue().get(finding.effect)
    unit_of = {shape.name: bare(shape.unit) for shape in effect.shapes(robot, finding.joint or 0)} if effect else {}
    words = []
    for name, value in finding.shape.items():
        scale, unit = in_unit(unit_of.get(name, ""), units)
        words.append(f"{name} {scale * value:.4g} {unit}".rstrip())
    return listed(words)


def decision_sentence(finding: Finding) -> str:
    """The runs that would decide between an effect and its rivals, or why none would; empty where nothing is open."""
    run = finding.next_run
    if run is None:
        return ""
    text = run.text.rstrip(".")
    if not run.motions:
        return f"{_capital(text)}."
    times = f", each {times_text(run.repeats)}" if run.repeats and run.repeats > 1 else ""
    return f"To decide: {text} ({plural(len(run.motions), 'run')}{times}; written by pumaid diagnose --plan FILE)."


def times_text(count: int) -> str:
    """``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


# Adding effects


def step_sentence(finding: Finding, before: Estimate, after: Estimate, *, robot: Robot, number: int) -> str:
    """What adding an effect did to the joint that it changed most; `number` of the step from 1."""
    both = [(old, new) for old, new in zip(before.joints, after.joints, strict=True) if old.rmse and new.rmse]
    words = f"{number}. Added {label(finding.effect)} {_at(finding, robot)}{_rivals(finding)}."
    if not both:
        return words
    old, new = min(both, key=lambda pair: (pair[1].rmse or 0.0) / (pair[0].rmse or 1.0))
    words += f" Joint {new.joint}: RMSE {amperes(old.rmse)} -> {amperes(new.rmse)}"
    if old.heldout is not None and new.heldout is not None:
        words += f", hold-out {amperes(old.heldout)} -> {amperes(new.heldout)}"
    if new.noise_floor is not None and (new.rmse or 0.0) >= BELOW_FLOOR * new.noise_floor:
        words += f", noise floor {amperes(new.noise_floor)}"
    return f"{words}."


def left_out_sentence(finding: Finding, before: float, after: float, *, robot: Robot) -> str:
    """That an effect was not added, because the RMSE (A) of the fitted runs rose."""
    return (
        f"Not added: {label(finding.effect)} {_at(finding, robot)}. It raises the RMSE of the fitted runs from"
        f" {amperes(before)} to {amperes(after)}, so these runs do not separate it from the model's other terms."
    )


# Verdicts


def headline(diagnosis: Diagnosis, robot: Robot) -> str:
    """The diagnosis in one sentence."""
    missing = [_named(finding, robot) for finding in diagnosis.findings if finding.verdict == ADD]
    doubtful = [_named(finding, robot) for finding in diagnosis.findings if finding.verdict != ADD]
    strange = [str(joint.joint) for joint in diagnosis.joints if joint.verdict == UNEXPLAINED_JOINT]
    parts = [f"{listed(missing)} {'is' if len(missing) == 1 else 'are'} missing"] if missing else []
    if strange:
        parts.append(f"at joint{'s' * (len(strange) > 1)} {listed(strange)} no known effect explains the residual")
    parts += [f"{listed(doubtful)} may be missing"] if doubtful else []
    other = [joint.joint for joint in diagnosis.joints if joint.verdict not in (ADEQUATE, UNEXPLAINED_JOINT)]
    if not parts and other:
        parts.append(f"something is missing at {listed([f'joint {joint}' for joint in other])}")
    return f"{robot.name}: {'; '.join(parts) or 'nothing is missing that these data can show'}."


def _named(finding: Finding, robot: Robot) -> str:
    local = [name for name in dict.fromkeys((finding.effect, *finding.rivals)) if "@" not in name]
    distant = "".join(f", or {label(name)}" for name in finding.rivals if "@" in name)
    return f"{listed([label(name) for name in local], 'or')} {_at(finding, robot)}{distant}"


def unexplained_title(joint: JointDiagnosis, robot: Robot) -> str:
    """That a joint's residual has no explanation in the catalogue."""
    return f"{joint_title(robot, joint.joint)}: something is missing that no effect of the catalogue explains"


def unexplained_sentences(joint: JointDiagnosis, units: str = "rad") -> list[str]:
    """What is known of a residual without a name."""
    out = [floor_sentence(joint)]
    if joint.repeats is not None:
        share, p = percent(joint.repeats.share), number(joint.repeats.p_value, 2)
        out.append(f"{share} of the residual repeats in repeated runs (p = {p}).")
    return [*out, *([form_sentence(joint.unexplained, units)] if joint.unexplained is not None else [])]


def form_sentence(shape: Unexplained, units: str = "rad") -> str:
    """The free form that describes the residual best, and where it is largest."""
    scale, unit = in_unit(shape.unit, units)
    kind = FORMS.get(shape.form.split("f(")[0].strip(), FORMS[""])
    form = f"{kind} {variable_name(shape)} ({shape.form})"
    if not shape.is_clear:
        return f"No function of position, speed, load, time or travel alone describes it; the closest is {form}."
    peak = f"{number(scale * shape.peak, 3)} {unit}".rstrip()
    return f"Best described by {form}, largest at {peak}; it explains {percent(shape.share)} of the excess over noise."


def variable_name(shape: Unexplained) -> str:
    """The variable of a free form in words."""
    return VARIABLES.get(shape.variable, shape.variable)


def other_sentences(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """Joints without a finding or a shape of their own, suspected columns, and effects that were added before."""
    named = {finding.joint for finding in diagnosis.findings}
    pointer = " The findings above act there too." if diagnosis.findings else ""
    is_clean = all(joint.verdict == ADEQUATE and joint.rmse is not None for joint in diagnosis.joints)
    groups: dict[str, list[int]] = {}
    for joint in diagnosis.joints:
        if joint.rmse is None:
            text = "never moved alone in these logs, so not diagnosed."
        elif joint.verdict == ADEQUATE:
            text = "nothing is missing that these data can show."
        elif diagnosis.findings and is_at_floor(joint):
            text = "RMSE at the noise floor, but the findings above act there too."
        else:
            text = f"something is missing. {floor_sentence(joint)}{pointer}"
        if joint.verdict != UNEXPLAINED_JOINT and joint.joint not in named and not is_clean:
            groups.setdefault(text, []).append(joint.joint)
    out = [f"{joint_titles(robot, joints)}: {text}" for text, joints in groups.items()]
    applied = [_named(replace(finding, rivals=()), robot) for finding in diagnosis.applied]
    out += _suspect_sentences(diagnosis)
    return [*out, *([f"Added after an earlier diagnosis: {listed(applied)}."] if applied else [])]


def _suspect_sentences(diagnosis: Diagnosis) -> list[str]:
    """Of suspected columns that no finding names: whether any current depends on them."""
    named = {name for finding in diagnosis.findings for name in (finding.effect, *finding.rivals)}
    limits = [limit for joint in diagnosis.joints for limit in joint.limits if limit.effect.startswith(SUSPECT)]
    testable = {limit.effect for limit in limits if limit.size is not None}
    verdicts = {
        True: "no joint's current depends on it, as far as these runs can show.",
        False: "not testable, because it hardly varies in these runs or is not a number.",
    }
    columns = dict.fromkeys(limit.effect for limit in limits if limit.effect not in named)
    return [f"Column {name.removeprefix(SUSPECT)}: {verdicts[name in testable]}" for name in columns]


def weaknesses(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """What limits the diagnosis, each sentence once with its joints."""
    joints: dict[str, list[int]] = {}
    for joint in diagnosis.joints:
        for sentence in joint.weakened:
            joints.setdefault(sentence.rstrip("."), []).append(joint.joint)
    out = []
    for text, numbers in joints.items():
        names_joint = len(numbers) == 1 and text.lower().startswith(f"joint {numbers[0]} ")
        is_plain = len(numbers) == len(diagnosis.joints) or names_joint
        out.append(f"{_capital(text)}." if is_plain else f"{joint_titles(robot, numbers)}: {text}.")
    return out
