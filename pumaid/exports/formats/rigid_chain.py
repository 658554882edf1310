"""Chains of bodies that have the model's loads, with symmetric friction: URDF, and MJCF with motors in ampere.

And friction and rotors' inertia written into a URDF or MJCF that is there.
"""

import html
import re
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from pumaid.errors import ModelError, RecipeError, Where, listed
from pumaid.exports import Exported, Form, Subject, head, rendered
from pumaid.exports.equivalent_bodies import friction_torques, known_constants
from pumaid.exports.formulas import Formulas, Lack, base_places
from pumaid.maths import Floats
from pumaid.rigid_body import PARAMETERS, regrouping
from pumaid.robot import Robot, roll_pitch_yaw, steiner
from pumaid.trajectory import highest_speeds

#: What stands for a limit that the recipe does not give: URDF asks for a number.
NO_LIMIT = 1e6

_PHYSICS = (
    "masses, Coulomb and viscous friction have no place for it; c, python, json and matlab have where it can be written"
)
_BESIDE = "URDF has no place for it; set {} kg m2 (kg of a slide) where it is read (pinocchio's armature)"


def numbers(values: ArrayLike) -> str:
    """Numbers of an attribute, none rounded; zero has no sign."""
    return " ".join(repr(value + 0.0) for value in np.ravel(values).tolist())


def not_of_bodies(formulas: Formulas) -> tuple[Lack, ...]:
    """What a chain of bodies with friction leaves out of a model."""
    terms = {term.effect: Lack(term.effect, _PHYSICS) for term in formulas.terms}
    gears = Lack("coupled gears", "friction follows each joint's own velocity, not its motor shaft's")
    made_up = "moments of inertia are made up (balls of aluminium), no current showed them; rotors have none"
    return (
        *(terms | {lack.name: lack for lack in formulas.left_out}).values(),
        Lack("direction of friction", "the mean of forward and backward is written"),
        *([gears] if formulas.robot.coupling else []),
        *([] if formulas.is_dynamic else [Lack("inertia", made_up)]),
    )


def urdf(subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
    """A URDF; gravity has no place there, so that a fixed joint turns the base until it is along -z of the world."""
    robot, held = subject.formulas.robot, subject.bodies
    assert held is not None
    gravity, parameters = float(np.linalg.norm(robot.gravity)), held.parameters.copy()
    has_limits = all(joint.limits is not None and joint.max_velocity is not None for joint in robot.joints)
    limits = f"limits that the recipe does not give are written as {NO_LIMIT:g}; a joint that turns is continuous"
    rotors = parameters[:, -1]
    if robot.joint(1).is_revolute:  # the first rotor becomes a disc of its link
        parameters[0, [4, 7, 9]] += np.array([0.5, 0.5, 1.0]) * rotors[0]
        rotors[0] = 0.0
    beside = _BESIDE.format(numbers(rotors).replace(" ", ", "))
    lacks = (
        *not_of_bodies(subject.formulas),
        Lack("size of gravity", f"set {gravity:.6g} m/s2 along -z in the program that reads it"),
        *([Lack("limits", limits)] if not has_limits else []),
        *([Lack("inertia of rotors", beside)] if held.parameters[:, -1].any() else []),
        Lack("effort", f"no current limit is known, so effort is written as {NO_LIMIT:g}"),
    )
    return _chain(
        "model.urdf", subject, lacks, parameters=parameters, remark=f"Gravity: 0 0 -{gravity!r} m/s2 in the world."
    )


def mjcf(subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
    """A chain for MuJoCo; a motor's control is its current: its gear is the torque constant."""
    return _chain(
        "model.xml",
        subject,
        (*not_of_bodies(subject.formulas), Lack("speed limits", "MJCF has no place for them")),
        remark="Motors take A; gears are torque constants in N m/A (N/A).",
    )


def _chain(
    template: str, subject: Subject, left_out: tuple[Lack, ...], *, remark: str, parameters: Floats | None = None
) -> tuple[dict[str, str], tuple[Lack, ...]]:
    robot, held = subject.formulas.robot, subject.bodies
    assert held is not None
    parameters = held.parameters if parameters is None else parameters
    centres = parameters[:, 1:4] / parameters[:, :1]
    values = {
        "head": head(subject, left_out, (*held.remarks, remark)),
        "robot": robot,
        "held": held,
        "masses": parameters[:, 0],
        "centres": centres,
        "tensors": parameters[:, 4:10] - steiner(parameters[:, 0], centres),
        "rotors": parameters[:, -1],
        "gravity": float(np.linalg.norm(robot.gravity)),
        "no_limit": NO_LIMIT,
    }
    filters = {
        # XML cannot hold control characters.
        "xml": lambda text: "".join(letter if letter.isprintable() else "_" for letter in text),
        "numbers": numbers,
        "xyz": lambda frame: numbers(frame[:3, 3]),
        "rpy": lambda frame: numbers(roll_pitch_yaw(frame[:3, :3])),
        "axes": lambda frame: numbers(frame[:3, :2].T),
        "diagonal_first": lambda tensor: numbers(tensor[[0, 3, 5, 1, 2, 4]]),
    }
    return rendered((template,), values, filters=filters, is_xml=True), left_out


# Into a file that is there

_ATTRIBUTE = re.compile(r"""([^\s=<]+)\s*=\s*("[^"]*"|'[^']*')""")


def write_into(formulas: Formulas, text: str, name: str, *, given: Mapping[int, float] | None) -> Exported:
    """The `text` of a URDF or MJCF with the model's friction, damping and rotors' inertia in its joints.

    What the data do not tell stays as it was. Torque constants get the sign by which friction opposes motion.
    ModelError [torque-constants]: a joint's current is no torque.
    RecipeError [into-refused]: the text does not have the recipe's joints.
    """
    torques, _, remarks = known_constants(formulas, given)
    if np.isnan(torques).any():
        raise ModelError(
            "torque-constants",
            "the model is in A, and torque constants are not known of joints "
            + ", ".join(str(place + 1) for place in np.flatnonzero(np.isnan(torques))),
            Where(field="--torque-constants"),
            "give JOINT=K,... (N m/A or N/A), one of each group that gain ratios tie, or identify with known loads",
        )
    is_urdf = any(_tags(text, "robot"))
    names = ("friction", "damping") if is_urdf else ("frictionloss", "damping", "armature")
    torques = torques * np.where(torques * np.subtract(*formulas.coulomb.T) < 0.0, -1.0, 1.0)
    dry, damping, cut = friction_torques(formulas, torques)
    # Rotors that motion tells apart from links.
    links, parts = base_places(formulas.robot)
    is_alone = np.count_nonzero(regrouping(formulas.robot)[0], axis=1) == 1
    apart = links[is_alone & (parts == PARAMETERS.index("rotor"))]
    rotors = np.isin(np.arange(len(torques)), apart) * formulas.bodies[:, -1] * torques
    values = np.column_stack([dry, damping, np.where(rotors > 0.0, rotors, np.nan)])
    for lack in formulas.undetermined:
        if match := re.match(r"(coulomb|viscous|rotor)\.j(\d+)", lack.name):
            values[int(match[2]) - 1, 2 if match[1] == "rotor" else slice(2)] = np.nan
    beside = ", ".join(f"{value:.6g} (joint {k})" for k, value in enumerate(values[:, 2], start=1) if value > 0.0)
    # MuJoCo's damping may have higher powers of the speed, which a default would leave in place.
    powers = " 0 0" if re.search(r"""damping\s*=\s*["']\s*[^\s"']+\s+[^\s"']""", text) else ""
    for tag, number in sorted(_joints(formulas.robot, text, is_urdf), key=lambda pair: -pair[0].start()):
        texts = {
            name: f"{value:.6g}{powers * (name == 'damping')}"
            for name, value in zip(names, values[number - 1], strict=False)
            if np.isfinite(value)
        }
        text = _edited(text, tag, texts, is_inside=is_urdf)
        words = listed([f"{name} {value}" for name, value in texts.items()]) or "nothing told"
        remarks.insert(0, f"joint {number} ({formulas.robot.joint(number).name}): {words}")
    return Exported(
        form="urdf" if is_urdf else "mjcf",
        name=name,
        files={".urdf" if is_urdf else ".xml": text},
        left_out=(
            *_without_place(formulas, torques),
            *([Lack("inertia of rotors", _BESIDE.format(beside))] if is_urdf and beside else []),
        ),
        undetermined=formulas.undetermined,
        remarks=(*remarks, *cut),
    )


def _tags(text: str, tag: str, *span: int) -> Iterator[re.Match[str]]:
    pattern = re.compile(rf"""<!--.*?-->|<!\[CDATA\[.*?\]\]>|(<{tag}\b(?:[^>"']|"[^"]*"|'[^']*')*>)""", re.DOTALL)
    return (match for match in pattern.finditer(text, *span) if match[1])


def _joints(robot: Robot, text: str, is_urdf: bool) -> list[tuple[re.Match[str], int]]:
    """Tags of the recipe's joints, with their numbers.

    A joint has its name, or else is the only one that has it between other words: shoulder_pan_joint for shoulder_pan.
    """
    there, out = dict[str, re.Match[str]](), list[tuple[re.Match[str], int]]()
    for match in _tags(text, "joint"):
        words = {word: html.unescape(quoted[1:-1]) for word, quoted in _ATTRIBUTE.findall(match[1])}
        # Motors, controllers, tendons, classes and equalities have joints too.
        if "name" in words and (words.get("type", "fixed") != "fixed" if is_urdf else "joint1" not in words):
            there[words["name"]] = match
    for number, joint in enumerate(robot.joints, start=1):
        exact = {joint.name, *robot.log.names[number - 1 : number]} & there.keys()
        names = exact or {x for x in there if re.search(rf"(?<![^\W_]){re.escape(joint.name)}(?![^\W_])", x)}
        out += [(there.pop(name), number) for name in names if len(names) == 1]
    if len(out) < robot.n_joints or "\ufffd" in text:
        lost = [joint.name for joint in robot.joints if joint.number not in dict(pair[::-1] for pair in out)]
        raise RecipeError(
            "into-refused",
            f"no joint is clearly {listed(lost) or 'UTF-8'} of the recipe; left are {listed([*there]) or 'none'}"[:400],
            Where(field="--into"),
            "write the file's names into the recipe (name or log_name) and identify again; what MJCF"
            " includes must lie where it says; expand a xacro file",
        )
    return out


def _edited(text: str, tag: re.Match[str], texts: Mapping[str, str], *, is_inside: bool) -> str:
    """A file with these attributes in a tag, or in the <dynamics> inside that of a joint; new ones stand at its end."""
    if is_inside:
        body = text[tag.end() : next(_tags(text, "/joint", tag.end())).start()]
        if not any(_tags(body, "dynamics")):
            place, indent = tag.end() + len(body.rstrip()), body[: len(body) - len(body.lstrip())]
            text = f"{text[:place]}{indent}<dynamics/>{text[place:]}"
        tag = next(_tags(text, "dynamics", tag.end()))
    there = dict(_ATTRIBUTE.findall(tag[1]))
    added = "".join(f' {name}="{value}"' for name, value in texts.items() if name not in there)
    start = _ATTRIBUTE.sub(lambda match: f'{match[1]}="{texts[match[1]]}"' if match[1] in texts else match[0], tag[1])
    start = re.sub(r"\s*/?>$", lambda end: added + end[0], start)
    return text[: tag.start()] + start + text[tag.end() :]


def _without_place(formulas: Formulas, torques: Floats) -> Iterator[Lack]:
    states, speeds = formulas.states(), highest_speeds(formulas.robot)
    whole = formulas.predicted(*states)
    uneven = np.abs(formulas.coulomb.mean(axis=1)) + 0.5 * np.abs(np.diff(formulas.viscous)[:, 0]) * speeds
    for lack in not_of_bodies(formulas):
        off = whole - formulas.predicted(*states, without=lack.name)
        sizes = np.abs(torques * (uneven[None] if lack.name == "direction of friction" else off)).max(axis=0)
        size = ", ".join(f"{size:.3g} at joint {place}" for place, size in enumerate(sizes, start=1) if size > 0.0)
        if lack.name != "inertia":  # bodies are the file's own
            yield Lack(lack.name, lack.reason + (f"; up to (N m, of a slide N) {size}" if size else ""))


FORMS = {form: Form(write, True, write_into) for form, write in (("urdf", urdf), ("mjcf", mjcf))}
