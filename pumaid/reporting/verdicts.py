"""The verdict of each joint in plain sentences: what lacks a name, what is whole, what weakens the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pumaid.records import ADD, ADEQUATE, UNEXPLAINED_JOINT, Diagnosis, Finding, JointDiagnosis, Unexplained
from pumaid.reporting.findings import SUSPECT, chance, floor_sentence, is_at_floor, label, listed_or, place
from pumaid.reporting.numbers import in_unit, percent
from pumaid.reporting.story import joint_title
from pumaid.reporting.wording import listed
from pumaid.robot import Robot
from pumaid.units import number

#: Variables of free forms in words; others are told by the name that they have.
VARIABLES = {
    "q": "position",
    "v": "speed",
    "load": "gravity load",
    "t": "time",
    "travel": "the way since the motion began",
}

#: What a letter before a free form says of it: the sign of motion, the velocity, nothing.
_KINDS = {"s": "a friction that depends on", "v": "a viscous friction that depends on", "": "a current that depends on"}


def headline(diagnosis: Diagnosis, robot: Robot) -> str:
    """The diagnosis in one sentence."""
    lacking = [_named(found, robot) for found in diagnosis.findings if found.verdict == ADD]
    strange = [f"joint {one.joint}" for one in diagnosis.joints if one.verdict == UNEXPLAINED_JOINT]
    parts = [f"missing are {listed(lacking)}" if len(lacking) > 1 else f"{lacking[0]} is missing"] if lacking else []
    if strange:
        parts.append(f"something that no known effect explains is missing at {listed(strange)}")
    doubtful = [_named(found, robot) for found in diagnosis.findings if found.verdict != ADD]
    if doubtful:
        parts.append(f"{listed(doubtful)} may be missing")
    unnamed = [one for one in diagnosis.joints if one.verdict not in (ADEQUATE, UNEXPLAINED_JOINT)]
    if not parts and unnamed:
        parts.append(f"something is missing at {listed([f'joint {one.joint}' for one in unnamed])}")
    return f"{robot.name}: " + ("; ".join(parts) if parts else "nothing is missing that these data can show") + "."


def _named(found: Finding, robot: Robot) -> str:
    here = [name for name in dict.fromkeys((found.effect, *found.rivals)) if "@" not in name]
    far = "".join(f", or {label(name)}" for name in found.rivals if "@" in name)
    names = listed_or([label(name) for name in here])
    return f"{names} {'of' if found.joint is None else 'at'} {place(found, robot)}{far}"


def unexplained_title(found: JointDiagnosis, robot: Robot) -> str:
    """That something is missing at a joint which no effect explains."""
    return f"{joint_title(robot, found.joint)}: something is missing that no effect of the catalogue explains"


def unexplained_sentences(found: JointDiagnosis, units: str = "rad") -> list[str]:
    """What is known of physics that has no name."""
    out = [floor_sentence(found)]
    if found.repeats is not None:
        share, p = found.repeats
        out.append(f"{percent(share)} of what is left repeats when a run is repeated (by chance: {chance(p)}).")
    if found.unexplained is not None:
        out.append(form_sentence(found.unexplained, units))
    return out


def form_sentence(shape: Unexplained, units: str = "rad") -> str:
    """Which free form describes best what is left, and where it is largest."""
    times, unit = in_unit(shape.unit, units)
    letter = shape.form.split("f(")[0].strip()
    kind = _KINDS.get(letter, _KINDS[""])
    at = f"{number(times * shape.peak, 3)} {unit}".rstrip()
    if not shape.is_clear:
        return (
            "It follows neither position nor speed, load, time or travel alone;"
            f" the nearest is {kind} {variable_word(shape)} ({shape.form})."
        )
    return (
        f"It looks most like {kind} {variable_word(shape)} ({shape.form}), strongest at {at};"
        f" that shape explains {percent(shape.share)} of what exceeds the noise."
    )


def variable_word(shape: Unexplained) -> str:
    """The variable of a free form in a word or two."""
    return VARIABLES.get(shape.variable, shape.variable)


def other_sentences(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """Joints that lack something of which no finding of their own and no shape tells."""
    rest = [one for one in diagnosis.joints if one.verdict not in (ADEQUATE, UNEXPLAINED_JOINT)]
    own = [one for one in rest if all(found.joint != one.joint for found in diagnosis.findings)]
    quiet = [one.joint for one in own if diagnosis.findings and is_at_floor(one)]
    told = " What it lacks is among the findings." if diagnosis.findings else ""
    loud = [one for one in own if one.joint not in quiet]
    out = [f"{joint_title(robot, one.joint)}: something is missing. {floor_sentence(one)}{told}" for one in loud]
    if quiet:
        out.append(
            f"{joints_named(quiet, robot)}: not missed by more than noise; what is among the findings acts there."
        )
    return out


def adequate_sentences(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """Of which joints nothing is missing, where something is at others; of which nothing is known."""
    fine = [one.joint for one in diagnosis.joints if one.verdict == ADEQUATE and one.rmse is not None]
    still = [one.joint for one in diagnosis.joints if one.rmse is None]
    out = []
    if fine and len(fine) < len(diagnosis.joints):
        out.append(f"{joints_named(fine, robot)}: nothing is missing that these data can show.")
    if still:
        out.append(f"{joints_named(still, robot)}: never moved alone in these logs, so nothing is known.")
    return out


def suspect_sentences(diagnosis: Diagnosis) -> list[str]:
    """Of the columns that the user suspected and that no finding names: whether anything follows them."""
    named = {name for found in diagnosis.findings for name in (found.effect, *found.rivals)}
    out: dict[str, bool] = {}
    for limit in (limit for joint in diagnosis.joints for limit in joint.limits):
        if limit.effect.startswith(SUSPECT) and limit.effect not in named:
            out[limit.effect] = out.get(limit.effect, False) or limit.size is not None
    return [
        f"Column {name.removeprefix(SUSPECT)}: "
        + (
            "no joint's current is shown to follow it."
            if could
            else "these runs show nothing of it: it hardly changes there, or has no numbers."
        )
        for name, could in out.items()
    ]


def applied_sentences(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """What earlier diagnoses found and the model now holds."""
    if not diagnosis.applied:
        return []
    names = listed([_named(replace(found, rivals=()), robot) for found in diagnosis.applied])
    return [f"In the model since an earlier diagnosis: {names}."]


def joints_named(joints: Sequence[int], robot: Robot) -> str:
    """``Joint 3 (elbow)``, ``Joints 1 (waist) and 3 (elbow)``."""
    names = [joint_title(robot, joint).removeprefix("Joint ") for joint in joints]
    return f"Joint{'s' * (len(joints) > 1)} {listed(names)}"


def weaknesses(diagnosis: Diagnosis, robot: Robot) -> list[str]:
    """What weakens the diagnosis, each sentence once with its joints."""
    said: dict[str, list[int]] = {}
    for one in diagnosis.joints:
        for sentence in one.weakened:
            said.setdefault(sentence.rstrip("."), []).append(one.joint)
    everywhere = len(diagnosis.joints)
    return [
        f"{text[0].upper()}{text[1:]}."
        if len(joints) == everywhere or _says_joint(text, joints)
        else f"{joints_named(joints, robot)}: {text}."
        for text, joints in said.items()
    ]


def _says_joint(text: str, joints: Sequence[int]) -> bool:
    return len(joints) == 1 and text.lower().startswith(f"joint {joints[0]} ")
