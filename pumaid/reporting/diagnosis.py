"""A diagnosis in sentences, tables and both."""

import math

import numpy as np

from pumaid.diagnosis.records import (
    ABSENT,
    ADD,
    ADEQUATE,
    STAND_IN,
    UNEXPLAINED_JOINT,
    UNSEEN,
    Candidate,
    Diagnosis,
    Finding,
    JointDiagnosis,
    Unexplained,
    causes_in,
)
from pumaid.effects import Scope, catalogue
from pumaid.effects.curve import spoken_form
from pumaid.estimate import Estimate
from pumaid.reporting.table import Cell, Paragraph, Row, Table
from pumaid.reporting.tables import amount, marked, notes_of
from pumaid.reporting.text import (
    AT_FLOOR,
    BELOW_FLOOR,
    amperes,
    by_joint,
    floor_words,
    in_unit,
    joint_label,
    joint_title,
    listed,
    percent,
    plural,
    with_error,
)
from pumaid.robot import Robot
from pumaid.units import number

#: Phase (rad per rad or m) of the fastest ripple that runs should show: two waves a turn of a motor at 1:160.
FASTEST = 320.0

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

#: Verdict -> its words and tone; others are said as they are.
VERDICTS = {
    ADD: ("add", "alarm"),
    ABSENT: ("absent", "absent"),
    UNSEEN: ("not testable", "unknown"),
    STAND_IN: ("stands in", "weak"),
}

#: Findings from which on a table tells them first.
MANY = 4

EMPTY = Paragraph("")


# Sentences


def label(effect: str) -> str:
    """An effect's name in a sentence: ``ripple at joint 3`` for ``ripple@3``, a suspected column as that."""
    if effect.startswith(SUSPECT):
        return f"an effect of column {effect.removeprefix(SUSPECT)}"
    name, at, joint = effect.partition("@")
    return f"{name} at joint {joint}" if at else name


def place(finding: Finding | Candidate, robot: Robot) -> str:
    """Where an effect acts: ``joint 3 (elbow)``, ``joints 2, 3 and 5 together``, or ``the whole arm``."""
    if finding.joints:
        return f"joints {listed([str(joint) for joint in finding.joints])} together"
    return "the whole arm" if finding.joint is None else joint_title(robot, finding.joint).replace("Joint", "joint", 1)


def _at(finding: Finding, robot: Robot) -> str:
    return f"{'of' if finding.joint is None else 'at'} {place(finding, robot)}"


def bare(unit: str) -> str:
    """A unit word; empty for a number without unit."""
    return "" if unit == "1" else unit


def finding_title(finding: Finding, diagnosis: Diagnosis, robot: Robot) -> str:
    """Where and what, with the effects that these data do not separate from it; of what was added, that it is there."""
    where = place(finding, robot)
    head = f"{where[0].upper()}{where[1:]}: {label(finding.effect)}"
    if any(finding is item for item in diagnosis.applied):
        return f"{head} was missing and is now in the model"
    state = "explains what no effect of the catalogue does" if "of" in finding.shape else "is missing"
    return f"{head} {state if finding.verdict == ADD else 'may be missing'}{_rivals(finding)}"


def _rivals(finding: Finding) -> str:
    names = listed([label(name) for name in finding.rivals], "or")
    return f" (these data do not separate it from {names})" if names else ""


def finding_sentences(finding: Finding, diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> list[str]:
    """What the effect is, what it explains, how sure that is, and how large it is (empty where that is not known)."""
    effect, out = catalogue().get(finding.effect), []
    if effect is not None:
        out.append(f"{effect.title}." + (f" Current: {effect.equation}." if effect.equation else ""))
    joint = next((item for item in diagnosis.joints if item.joint == finding.joint), None)
    is_applied = any(finding is item for item in diagnosis.applied)
    if joint is not None and not is_applied and (effect is None or effect.scope is Scope.JOINT):
        out.append(f"{floor_words(joint)}.")
    before, after = finding.rmse_heldout_before, finding.rmse_heldout_after
    if before is not None and after is not None:
        less = f" ({percent(1.0 - after / before)} less)" if 0.0 < after < before else ""
        runs = "Cross-validated RMSE" if finding.forecast is None else "RMSE of runs that were not fitted"
        with_it = (
            " ± ".join(with_error(after, finding.forecast_error)) + " A" if finding.forecast_error else amperes(after)
        )
        out.append(f"{runs}: {amperes(before)} without it, {with_it} with it{less}.")
    transfer = finding.transfer
    if transfer is not None and transfer.is_clear:
        share = f"{number(100.0 * transfer.share, 2)} ± {number(100.0 * transfer.std_error, 1)} %"
        verdict = ": another effect acts as well, or instead" if transfer.is_partial else ""
        if transfer.is_denied:
            verdict = ": it is another effect, or of another form, although it fits the other runs"
        out.append(f"The held-out runs confirm {share} of the predicted effect{verdict}.")
    out.append(f"p = {number(finding.p_value, 2)} over all effects and joints (family-wise).")
    if finding.verdict != ADD:
        out.append(f"Doubtful: {finding.reason.rstrip('.')}.")
    return [*out, size_sentence(finding, robot, units)]


def size_sentence(finding: Finding | Candidate, robot: Robot, units: str = "rad") -> str:
    """How large an effect is, with its nonlinear parameters; empty where neither is known."""
    is_column, sizes, shape = finding.effect.startswith(SUSPECT), [], []
    for size in finding.sizes:
        scale, unit = in_unit(bare(size.unit), units)
        value, error = with_error(scale * size.value, None if size.std_error is None else scale * size.std_error)
        sizes.append(f"{size.name.rsplit('.', 1)[-1]} = {value}{f' ± {error}' if error else ''} {unit}".rstrip())
    effect = catalogue().get(finding.effect)
    unit_of = {item.name: bare(item.unit) for item in effect.shapes(robot, finding.joint or 0)} if effect else {}
    shape += [f"the form {spoken_form(finding.shape)}"] if "of" in finding.shape else []
    for name, extent in () if shape else finding.shape.items():
        scale, unit = in_unit(unit_of.get(name.partition("@")[0], ""), units)
        shape.append(f"{name} {scale * extent:.4g} {unit}".rstrip())
    words = SUSPECT_FORMS[int(finding.shape.get("times", 0.0))] if is_column else listed(shape)
    if not sizes:
        return f"Shape: {words}." if words else ""
    joiner = ", not told apart from " if None in [size.std_error for size in finding.sizes] else ", with "
    is_first = effect is not None and effect.needs_loads and effect.scope is Scope.JOINT and not effect.is_free
    first = "; a first estimate, since the load was fitted without it" if is_first else ""
    if finding.effect == "payload" and finding.sizes[0].value:
        place = ", ".join(f"{size.value / finding.sizes[0].value:.3f}" for size in finding.sizes[1:])
        first = f"; its place is {place} m in the last link's frame"
    return f"Size: {listed(sizes)}{(', ' if is_column else joiner) + words if words else ''}{first}."


def decision_sentence(finding: Finding) -> str:
    """The runs that would decide between an effect and its rivals, or why none would; empty where nothing is open."""
    run = finding.next_run
    if run is None:
        return ""
    text = run.text.rstrip(".")
    if not run.motions:
        return f"{text[:1].upper()}{text[1:]}."
    times = f", each {plural(run.repeats, 'time')}" if run.repeats and run.repeats > 1 else ""
    return f"To decide: {text} ({plural(len(run.motions), 'run')}{times}; written by pumaid diagnose --plan FILE)."


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


def left_out_sentence(finding: Finding, *, runs: str, before: float, after: float, robot: Robot) -> str:
    """That an effect was not added, because the RMSE (A) of the ``fitted`` or ``held-out`` runs rose."""
    return (
        f"Not added: {label(finding.effect)} {_at(finding, robot)}. It raises the RMSE of the {runs} runs from"
        f" {amperes(before)} to {amperes(after)}, so the fitted runs do not separate it from the model's other terms."
    )


def headline(diagnosis: Diagnosis, robot: Robot) -> str:
    """The diagnosis in one sentence."""
    named = [item for item in diagnosis.findings if item.verdict == ADD and "of" not in item.shape]
    missing = [_named(item, robot) for item in named]
    if len(named) >= MANY:
        acting = {single.joint for item in named for single in item.each()}
        joints = [str(joint) for joint in sorted(joint for joint in acting if joint)]
        where = [f"joint{'s' * (len(joints) > 1)} {listed(joints)}"] * bool(joints) + ["the arm"] * (None in acting)
        missing = [f"{len(named)} effects at {listed(where)}"]
    doubtful = [_named(finding, robot) for finding in diagnosis.findings if finding.verdict != ADD]
    strange = [str(joint.joint) for joint in diagnosis.joints if joint.verdict == UNEXPLAINED_JOINT]
    parts = [f"{listed(missing)} {'is' if len(named) == 1 else 'are'} missing"] if missing else []
    if strange:
        curves = listed([f"joint {item.joint}" for item in diagnosis.findings if "of" in item.shape])
        does = f" (a learned curve does at {curves})" if curves else ""
        parts.append(
            f"at joint{'s' * (len(strange) > 1)} {listed(strange)} no known effect explains the residual{does}"
        )
    parts += [f"{listed(doubtful)} may be missing"] if doubtful else []
    other = [joint.joint for joint in diagnosis.joints if joint.verdict not in (ADEQUATE, UNEXPLAINED_JOINT)]
    if not parts and other:
        parts.append(f"something is missing at {listed([f'joint {joint}' for joint in other])}")
    verdict = "; ".join(parts) or "nothing is missing that these data can show"
    causes = causes_in(diagnosis.notes)
    first = f"before any physics, {causes[0].text}. As logs and recipe stand, " if causes else ""
    return f"{robot.name}: {first}{verdict}."


def _named(finding: Finding, robot: Robot) -> str:
    local = [name for name in dict.fromkeys((finding.effect, *finding.rivals)) if "@" not in name]
    distant = "".join(f", or {label(name)}" for name in finding.rivals if "@" in name)
    return f"{listed([label(name) for name in local], 'or')} {_at(finding, robot)}{distant}"


def form_sentence(shape: Unexplained, units: str = "rad") -> str:
    """The free form that describes the residual best, and where it is largest."""
    scale, unit = in_unit(shape.unit, units)
    kind = FORMS.get(shape.form.split("f(")[0].strip(), FORMS[""])
    form = f"{kind} {VARIABLES.get(shape.variable, shape.variable)} ({shape.form})"
    if not shape.is_clear:
        return f"No function of position, speed, load, time or travel alone describes it; the closest is {form}."
    peak = f"{number(scale * shape.peak, 3)} {unit}".rstrip()
    return (
        f"Best described by {form}, largest at {peak}; it explains {100 * shape.share:.0f} % of the excess over noise."
    )


def other_sentences(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """Joints without a finding or a shape of their own, and suspected columns."""
    joints = {finding.joint for finding in diagnosis.findings}
    is_clean = all(joint.verdict == ADEQUATE and joint.rmse is not None for joint in diagnosis.joints)
    texts = []
    for joint in diagnosis.joints:
        if joint.rmse is None:
            text = "never moved alone in these logs, so not diagnosed."
        elif joint.verdict == ADEQUATE:
            is_coarse = any(limit.up_to and limit.up_to < FASTEST for limit in joint.limits)
            faster = "; of ripples only those up to the limit below" if is_coarse else ""
            text = f"nothing is missing that these data can show{faster}."
        elif diagnosis.findings and joint.noise_floor is not None and joint.rmse <= AT_FLOOR * joint.noise_floor:
            text = "RMSE at the noise floor, but the findings above act there too."
        else:
            pointer = " The findings above act there too." if diagnosis.findings else ""
            text = f"something is missing. {floor_words(joint)}.{pointer}"
        if joint.verdict != UNEXPLAINED_JOINT and joint.joint not in joints and not is_clean:
            texts.append((joint.joint, text))
    out = by_joint(texts, robot)
    # Suspected columns that no finding names: whether any current depends on them.
    named = {name for finding in diagnosis.findings for name in (finding.effect, *finding.rivals)}
    limits = [limit for joint in diagnosis.joints for limit in joint.limits if limit.effect.startswith(SUSPECT)]
    testable = {limit.effect for limit in limits if limit.size is not None}
    for name in dict.fromkeys(limit.effect for limit in limits if limit.effect not in named):
        verdict = "not testable, because it hardly varies in these runs or is not a number."
        clear = "no joint's current depends on it, as far as these runs can show."
        out.append(f"Column {name.removeprefix(SUSPECT)}: {clear if name in testable else verdict}")
    return out


def weaknesses(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """What limits the diagnosis, each sentence once with its joints."""
    joints = diagnosis.joints
    texts = [(item.joint, f"{text.rstrip('.')}.") for item in joints for text in item.weakened]
    return by_joint(texts, robot, count=len(joints))


# Tables


def finding_table(diagnosis: Diagnosis, robot: Robot) -> Table:
    """All findings, a row each."""
    rows: list[Row] = []
    for count, item in enumerate(diagnosis.findings, start=1):
        names = listed([label(name) for name in (item.effect, *item.rivals)], "or")
        words, tone = VERDICTS[ADD] if item.verdict == ADD else ("may be missing", "weak")
        errors = [item.rmse_heldout_before, item.rmse_heldout_after]
        rmse = " → ".join(amount(error).text for error in errors if error is not None)
        where = (
            f"joints {listed([str(joint) for joint in item.joints])}" if item.joints else joint_label(robot, item.joint)
        )
        rows.append([str(count), where, names, Cell(words, tone=tone), rmse or "-"])
    forecast = all(item.forecast is not None for item in diagnosis.findings)
    runs = "runs that were not fitted" if forecast else "runs left out of the fit"
    beside = "those of the rows above being in the model" if forecast else "beside what had been found before it"
    caption = f"RMSE: of {runs}, without → with the effect, {beside}."
    return Table(
        "What is missing",
        ("", "joint", "effect", "verdict", "RMSE (A)"),
        rows,
        caption=caption,
        words=(1, 2, 3),
    )


def candidate_table(diagnosis: Diagnosis, robot: Robot) -> Table | None:
    """Candidates that explain more than their parameters cost; None where none does."""
    marks: dict[str, str] = {}
    rows: list[Row] = []
    candidates = [item for joint in diagnosis.joints for item in joint.candidates]
    unique: dict[tuple[str, int | None], Candidate] = {}
    for item in (item for item in candidates if item.verdict == ADD or item.evidence > 0.0):
        unique.setdefault((item.effect, item.joint), item)
    for item in sorted(unique.values(), key=lambda item: (item.joint is None, item.joint or 0)):
        mark = marked(marks, item.reason) if item.verdict != ADD else ""
        joint, (words, tone) = joint_label(robot, item.joint), VERDICTS.get(item.verdict, (item.verdict, "weak"))
        verdict = Cell(words, mark=mark, tone=tone)
        scores = [number(x, digits) if np.isfinite(x) else "-" for x, digits in ((item.p_value, 2), (item.evidence, 3))]
        folds = [amount(rmse).text for rmse in (item.rmse_heldout_before, item.rmse_heldout_after) if rmse is not None]
        rivals = ", ".join(label(name) for name in item.rivals) or "-"
        rows.append(
            [joint, label(item.effect), verdict, *scores, amount(item.rmse_after), " → ".join(folds) or "-", rivals]
        )
    header = ["joint", "effect", "verdict", "p", "dBIC", "RMSE (A)", "cross-validated (A)", "not separated from"]
    caption = (
        "p: over all effects and joints (family-wise). dBIC: evidence for the effect; above 10 is decisive. RMSE: of"
        " fitted runs, with the effect. Cross-validated: RMSE of runs left out of the fit, without → with the effect."
    )
    if all(row[-1] == "-" for row in rows):
        header, rows = header[:-1], [row[:-1] for row in rows]
    return Table("Candidates", header, rows, notes_of(marks), caption, (0, 1, 2, 7)) if rows else None


def limit_table(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> Table | None:
    """Detection limit of each effect at each joint; None where none is known."""
    limits = [limit for joint in diagnosis.joints for limit in joint.limits]
    marks, rows, order = dict[str, str](), list[Row](), list(catalogue())
    columns = sorted({limit.joint or 0 for limit in limits}, key=lambda joint: (joint == 0, joint))
    effects = {limit.effect for limit in limits}
    for effect in sorted(effects, key=lambda name: (order.index(name) if name in order else len(order), name)):
        group = sorted((limit for limit in limits if limit.effect == effect), key=lambda limit: limit.size is not None)
        sized = dict.fromkeys((limit.parameter, limit.unit) for limit in group if limit.size is not None)
        for key in sized or [(group[0].parameter, group[0].unit)]:
            scale, unit = in_unit(bare(key[1]), units)
            at = {item.joint or 0: item for item in group if item.size is None or (item.parameter, item.unit) == key}
            cells = {
                joint: Cell("-", mark=marked(marks, limit.reason), tone="unknown")
                if limit.size is None
                else number(scale * limit.size, 2)
                for joint, limit in at.items()
            }
            rows.append(
                [effect, f"{key[0]} ({unit})" if unit else key[0], *(cells.get(joint, "") for joint in columns)]
            )
        fastest = {
            item.joint: (number(item.up_to, 2), "waves a turn")  # rad per rad, or per m
            if robot.joint(item.joint).is_revolute
            else (number(item.up_to / math.tau, 2), "waves a m")
            for item in group
            if item.joint and item.up_to is not None
        }
        for of in dict.fromkeys(unit for _, unit in fastest.values()):
            ends = {joint: count for joint, (count, unit) in fastest.items() if unit == of}
            rows.append([effect, f"up to ({of})", *(ends.get(joint, "") for joint in columns)])
    names = [joint_label(robot, joint) for joint in columns]
    caption = "Smallest size that is detected with a probability of 80 %."
    return (
        Table("Detection limits", ("effect", "size of", *names), rows, notes_of(marks), caption, (0, 1))
        if rows
        else None
    )


# Both


def diagnosis_blocks(
    diagnosis: Diagnosis, robot: Robot, *, units: str = "rad"
) -> list[tuple[Finding | JointDiagnosis | None, list[Paragraph | Table]]]:
    """What a diagnosis says: the headline, each finding, joint without explanation and effect added before, the rest.

    Angles are in `units` (``rad`` or ``deg``).
    """
    blocks: list[tuple[Finding | JointDiagnosis | None, list[Paragraph | Table]]] = [
        (None, [Paragraph(headline(diagnosis, robot), style="bold")]),
        (None, [finding_table(diagnosis, robot)] if len(diagnosis.findings) >= MANY else []),  # few are read at once
    ]
    for count, finding in enumerate((*diagnosis.findings, *diagnosis.applied), start=1):
        rank = f"{count}. " if count <= len(diagnosis.findings) else ""
        title = rank + finding_title(finding, diagnosis, robot)
        texts = finding_sentences(finding, diagnosis, robot, units=units)
        parts: list[Paragraph | Table] = [
            Paragraph(title, style="bold"),
            *(Paragraph(text, 3) for text in [*texts, decision_sentence(finding)] if text),
        ]
        if finding.command and rank:
            parts += [Paragraph("Add it with:", 3), Paragraph(finding.command, 5, is_command=True)]
        blocks.append((finding, parts))
    for joint in diagnosis.joints:
        if joint.verdict == UNEXPLAINED_JOINT:
            title = f"{joint_title(robot, joint.joint)}: something is missing that no effect of the catalogue explains"
            texts = [f"{floor_words(joint)}."]
            if joint.repeats is not None:
                share, chance = percent(joint.repeats.share), number(joint.repeats.p_value, 2)
                texts.append(f"{share} of the residual repeats in repeated runs (p = {chance}).")
            texts += [] if joint.unexplained is None else [form_sentence(joint.unexplained, units)]
            blocks.append((joint, [Paragraph(title, style="bold"), *(Paragraph(text, 3) for text in texts)]))
    blocks.append((None, [Paragraph(text) for text in other_sentences(diagnosis, robot)]))
    limits = [Paragraph(f"- {text}", 2) for text in weaknesses(diagnosis, robot)]
    blocks.append((None, [Paragraph("Limits of this diagnosis:"), *limits] if limits else []))
    made = candidate_table(diagnosis, robot), limit_table(diagnosis, robot, units=units)
    blocks += [(None, [table]) for table in made if table is not None]
    return [block for block in blocks if block[1]]


def diagnosis_parts(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> list[Paragraph | Table]:
    """The same for the terminal, with an empty line between."""
    return [part for _, parts in diagnosis_blocks(diagnosis, robot, units=units) for part in (*parts, EMPTY)][:-1]
