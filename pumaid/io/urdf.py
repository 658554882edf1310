"""URDF files: links and joints of a robot as the file states them, checked to be one forest of trees."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pumaid.errors import Faults, PumaidError, RecipeError, Where
from pumaid.io.xml_lines import Element, read_bytes, read_xml
from pumaid.io.yaml_file import nearest

#: Types of a URDF's joints: those that a recipe can hold, and those that move otherwise or not at all.
SERIAL = ("revolute", "continuous", "prismatic")
FREE = ("floating", "planar")
TYPES = (*SERIAL, "fixed", *FREE)
#: A joint farther than this (m) from the one before, or angles beyond this (rad), are in another unit.
FARTHEST, WIDEST_ANGLE = 20.0, 4.0 * math.pi
#: Faults that are told at once, at most.
SHOWN = 20
#: How limits are written that are none.
_ENDLESS = ("inf", "infinity")
#: What marks a file that xacro has yet to turn into a URDF.
_MACROS = ("${", "$(")


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint as the file states it; its numbers are read when they are asked for, since most files hold more joints
    than an arm has.

    `kind` is one of `TYPES`; `follows` is the joint that it mimics, or none.
    """

    name: str
    kind: str
    parent: str
    child: str
    follows: str | None
    element: Element
    file: str

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.kind != "fixed"

    @property
    def origin(self) -> tuple[list[float], list[float]]:
        """xyz (m) and rpy (rad) of the joint's frame in that of the link before; zero where not given.

        Raises
        ------
        RecipeError [urdf-bad-value]
            They are no numbers, or in another unit.
        """
        xyz, rpy = self._numbers("origin", "xyz", "0 0 0"), self._numbers("origin", "rpy", "0 0 0")
        if math.hypot(*xyz) > FARTHEST:
            what = f"{math.hypot(*xyz):g} m from one joint to the next"
            raise self._refusal("origin", what, "lengths of a URDF are in metres; divide by 1000")
        if max(map(abs, rpy)) > WIDEST_ANGLE:
            raise self._refusal("origin", f"rpy of {max(map(abs, rpy)):g} rad", "angles of a URDF are in rad")
        return xyz, rpy

    @property
    def axis(self) -> list[float]:
        """Unit vector of the axis in the joint's frame; x where not given.

        Raises
        ------
        RecipeError [urdf-bad-value]
            It has no direction.
        """
        axis = self._numbers("axis", "xyz", "1 0 0")
        size = math.hypot(*axis)
        if not 1e-9 < size < math.inf:
            raise self._refusal("axis", f"the axis {_shown(axis)} has no direction", 'write it as xyz="0 0 1"')
        return [value / size for value in axis]

    @property
    def limits(self) -> tuple[float | None, float | None, float | None]:
        """Lower and upper limit (rad or m) and highest speed (a second), none where not given or infinite.

        Raises
        ------
        RecipeError [urdf-bad-value]
            They are no numbers.
        """
        limit = self.element.first("limit")
        given = {} if limit is None else limit.attributes
        low, high, speed = (
            self._numbers("limit", word, given[word], count=1)[0]
            if word in given and given[word].strip().lstrip("+-").lower() not in _ENDLESS
            else None
            for word in ("lower", "upper", "velocity")
        )
        return low, high, speed

    def _numbers(self, tag: str, word: str, default: str, *, count: int = 3) -> list[float]:
        element = self.element.first(tag)
        text = default if element is None else element.attributes.get(word, default)
        try:
            if "_" in text:  # Python reads 1_000; no other program does
                raise ValueError(text)
            values = [float(part) for part in text.split()]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            raise self._refusal(
                tag, f'{word}="{text[:60]}" is not {wanted}', "write numbers with a point, in m and rad"
            )
        return values

    def _refusal(self, tag: str, what: str, mend: str) -> RecipeError:
        element = self.element.first(tag) or self.element
        where = Where(file=self.file, line=element.line, field=f"joint {self.name}, {tag}")
        return RecipeError("urdf-bad-value", what, where, mend)


@dataclass(frozen=True, slots=True)
class Urdf:
    """A robot: its links by name, its joints in the file's order, the file and the SHA-256 of its bytes."""

    name: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    file: str
    digest: str

    @property
    def roots(self) -> list[str]:
        """Links that no joint carries."""
        carried = {joint.child for joint in self.joints}
        return [link for link in self.links if link not in carried]


def read_urdf(path: Path) -> Urdf:
    """Read a URDF.

    Parameters
    ----------
    path
        The file; ``-`` is standard input.

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused, urdf-xacro]
        It cannot be read, is no URDF, or is one that xacro has yet to expand.
    RecipeError [urdf-structure]
        Its links and joints make no trees: names twice or missing, links that are not there, cycles.
    Faults
        Several of the last kind.
    """
    content = read_bytes(path)
    file = "standard input" if str(path) == "-" else str(path)
    robot = read_xml(content, file)
    if robot.tag != "robot":
        what = f"the file holds <{robot.tag[:40]}>, not <robot>"
        raise RecipeError("urdf-refused", what, Where(file=file, line=robot.line), "give the arm's URDF")
    _refuse_xacro(robot, file)
    faults: list[PumaidError] = []
    links = [name for link in robot.all("link") if (name := _name(link, file, faults))]
    joints = [joint for element in robot.all("joint") if (joint := _joint(element, file, faults))]
    faults += _doubled(robot, file)
    faults += _loose(links, joints)
    if not faults:
        faults += _circles(links, joints)
    if faults:
        faults.sort(key=lambda fault: fault.where.line or 0)
        raise faults[0] if len(faults) == 1 else Faults(faults[:SHOWN])
    if not links:
        raise RecipeError("urdf-structure", "there is no link", Where(file=file), "give the arm's URDF")
    digest = hashlib.sha256(content).hexdigest()
    return Urdf(robot.attributes.get("name", ""), tuple(links), tuple(joints), file, digest)


def _refuse_xacro(robot: Element, file: str) -> None:
    for element in robot.everything():
        macro = next((text for text in element.attributes.values() if any(mark in text for mark in _MACROS)), None)
        if element.tag.startswith("xacro:") or macro is not None:
            what = f"this is a xacro file, not a URDF: {macro or '<' + element.tag + '>'}"
            mend = "run: xacro FILE > arm.urdf   (with ROS 2: ros2 run xacro xacro FILE), then give arm.urdf"
            raise RecipeError("urdf-xacro", what[:160], Where(file=file, line=element.line), mend)


def _fault(element: Element, file: str, what: str, mend: str) -> RecipeError:
    return RecipeError("urdf-structure", what, Where(file=file, line=element.line), mend)


def _name(element: Element, file: str, faults: list[PumaidError]) -> str:
    name = element.attributes.get("name", "").strip()
    if not name:
        faults.append(_fault(element, file, f"a {element.tag} has no name", f'write <{element.tag} name="...">'))
    return name


def _joint(element: Element, file: str, faults: list[PumaidError]) -> UrdfJoint | None:
    name = _name(element, file, faults)
    kind = element.attributes.get("type", "").strip()
    if kind not in TYPES:
        near = nearest(kind, TYPES)
        mend = f"did you mean {near}?" if near else f"one of {', '.join(TYPES)}"
        faults.append(_fault(element, file, f"joint {name} has type '{kind[:40]}'", mend))
    ends = [_attribute(element, tag, "link") for tag in ("parent", "child")]
    for tag, end in zip(("parent", "child"), ends, strict=True):
        if not end:
            faults.append(_fault(element, file, f"joint {name} has no {tag}", f'write <{tag} link="..."/> in it'))
    if not name or kind not in TYPES or not all(ends):
        return None
    follows = _attribute(element, "mimic", "joint") if element.first("mimic") else None
    return UrdfJoint(name, kind, ends[0], ends[1], follows, element, file)


def _attribute(element: Element, tag: str, word: str) -> str:
    child = element.first(tag)
    return "" if child is None else child.attributes.get(word, "").strip()


def _doubled(robot: Element, file: str) -> Iterator[PumaidError]:
    for tag in ("link", "joint"):
        seen: dict[str, int] = {}
        for element in robot.all(tag):
            name = element.attributes.get("name", "").strip()
            first = seen.setdefault(name, element.line)
            if name and first != element.line:
                what = f"the {tag} {name} stands on line {first} too"
                yield _fault(element, file, what, f"give each {tag} its own name")


def _loose(links: Sequence[str], joints: Sequence[UrdfJoint]) -> Iterator[PumaidError]:
    """Joints between links that are not there, and links that two joints carry."""
    known = set(links)
    carriers = Counter(joint.child for joint in joints)
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in known:
                near = nearest(end, known) if len(known) < 10_000 else None
                mend = f"did you mean {near}?" if near else f'add <link name="{end}"/>'
                yield _fault(
                    joint.element, joint.file, f"joint {joint.name} names a link {end}, which is not there", mend
                )
        if carriers[joint.child] > 1:
            what = f"joint {joint.name} carries link {joint.child}, as another joint does"
            yield _fault(joint.element, joint.file, what, "a link hangs on one joint; a URDF holds no closed loops")


def _circles(links: Sequence[str], joints: Sequence[UrdfJoint]) -> Iterator[PumaidError]:
    """The first joint of which going outward never ends."""
    carrier = {joint.child: joint for joint in joints}
    grounded: set[str] = set()
    for start in links:
        path: dict[str, UrdfJoint] = {}
        link = start
        while link in carrier and link not in grounded:
            if link in path:
                joint, mend = path[link], "one of its joints must hang on the base instead"
                yield _fault(joint.element, joint.file, f"joint {joint.name} closes a circle of links at {link}", mend)
                return
            path[link] = carrier[link]
            link = carrier[link].parent
        grounded.update(path)


def _shown(values: Sequence[float]) -> str:
    return "[" + ", ".join(f"{value:g}" for value in values) + "]"
