"""URDF files: links and joints as the file states them, and the serial chain in them that is the arm."""

from __future__ import annotations

import hashlib
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shlex import quote
from xml.etree import ElementTree
from xml.parsers import expat

from pumaid.errors import PumaidError, RecipeError, Where
from pumaid.io.forms import raise_together
from pumaid.io.yaml_file import file_name, nearest, read_bytes

#: Types of a URDF's joints: those that a recipe can state, and those that move otherwise or not at all.
SERIAL, FREE = ("revolute", "continuous", "prismatic"), ("floating", "planar")
TYPES = (*SERIAL, "fixed", *FREE)
#: Most bytes of a URDF, and most joints of a recipe.
MAX_BYTES, MOST_JOINTS = 20_000_000, 50
#: A joint farther than this (m) from the one before, or angles beyond this (rad), are in another unit.
FARTHEST, WIDEST_ANGLE = 20.0, 4.0 * math.pi
#: Most chains that a message lists.
LISTED = 8


class Element(ElementTree.Element):
    """An XML element that knows the line on which it starts."""

    line = 0

    def first(self, tag: str) -> Element | None:
        """The first element of that name directly below."""
        return next((child for child in self if child.tag == tag and isinstance(child, Element)), None)

    def text_of(self, tag: str, word: str, default: str = "") -> str:
        """An attribute of the first element of that name below."""
        child = self.first(tag)
        return default if child is None else child.get(word, default).strip()


def refusal(file: str, what: str, mend: str, *, line: int | None = None, slug: str = "urdf-refused") -> RecipeError:
    """The error of a URDF that cannot be used."""
    return RecipeError(slug, what[:200], Where(file=file, line=line), mend)


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint as the file states it; numbers are checked when they are read, since not every joint is the arm's.

    `kind` is one of `TYPES`; `follows` is the joint that it mimics, or empty.
    """

    name: str
    kind: str
    parent: str
    child: str
    follows: str
    element: Element
    file: str

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.kind != "fixed"

    @property
    def origin(self) -> tuple[list[float], list[float]]:
        """xyz (m) and rpy (rad) of the joint's frame in that of the link before.

        Raises
        ------
        RecipeError [urdf-refused]
            They are not numbers, or are in another unit.
        """
        xyz, rpy = self._numbers("origin", "xyz", "0 0 0"), self._numbers("origin", "rpy", "0 0 0")
        if math.hypot(*xyz) > FARTHEST or max(map(abs, rpy)) > WIDEST_ANGLE:
            what = f"an origin {math.hypot(*xyz):g} m away, turned by up to {max(map(abs, rpy)):g} rad"
            raise self._refusal("origin", what, "lengths of a URDF are in m, angles in rad")
        return xyz, rpy

    @property
    def axis(self) -> list[float]:
        """Unit vector of the axis in the joint's frame; x where not given; errors as for `origin`."""
        axis = self._numbers("axis", "xyz", "1 0 0")
        size = math.hypot(*axis)
        if not 1e-9 < size < math.inf:
            raise self._refusal("axis", f"the axis {axis} has no direction", 'write it as xyz="0 0 1"')
        return [value / size for value in axis]

    @property
    def limits(self) -> tuple[float | None, float | None, float | None]:
        """Lower and upper limit (rad or m) and highest speed (a second), None where not given or infinite."""
        texts = [self.element.text_of("limit", word, "inf") for word in ("lower", "upper", "velocity")]
        low, high, speed = (
            None if text.lstrip("+-").lower() in ("inf", "infinity") else self._numbers("limit", word, text, count=1)[0]
            for word, text in zip(("lower", "upper", "velocity"), texts, strict=True)
        )
        return low, high, speed

    def _numbers(self, tag: str, word: str, default: str, *, count: int = 3) -> list[float]:
        text = self.element.text_of(tag, word, default)
        try:
            values = [float(part) for part in text.split() if "_" not in text]  # Python alone reads 1_000
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            wanted = f"{count} finite numbers" if count > 1 else "a finite number"
            raise self._refusal(tag, f'{word}="{text[:60]}" is not {wanted}', "write them with a point, in m and rad")
        return values

    def _refusal(self, tag: str, what: str, mend: str) -> RecipeError:
        line = (self.element.first(tag) or self.element).line
        return RecipeError("urdf-refused", what, Where(self.file, line, field=f"joint {self.name}, {tag}"), mend)


@dataclass(frozen=True)
class UrdfFile:
    """A robot: its links by name, its joints in the file's order, the file and the SHA-256 of its bytes."""

    name: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    file: str
    digest: str

    @cached_property
    def carrier(self) -> dict[str, UrdfJoint]:
        """Link -> the joint that carries it."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def carried(self) -> dict[str, list[UrdfJoint]]:
        """Link -> the joints that it carries."""
        out: dict[str, list[UrdfJoint]] = defaultdict(list)
        for joint in self.joints:
            out[joint.parent].append(joint)
        return out

    @cached_property
    def reach(self) -> dict[str, int]:
        """Link -> the most moving joints in one line outward of it."""
        reach: dict[str, int] = {}
        for link in reversed(self.below(*self.roots)):
            reach[link] = max((reach[joint.child] + joint.moves for joint in self.carried[link]), default=0)
        return reach

    @property
    def roots(self) -> list[str]:
        """Links that no joint carries."""
        return [link for link in self.links if link not in self.carrier]

    def below(self, *links: str) -> list[str]:
        """These links and all that they carry, carriers first."""
        below = list(links)
        for link in below:
            below += [joint.child for joint in self.carried[link]]
        return below

    def moving_below(self, link: str) -> list[UrdfJoint]:
        """Moving joints outward of a link."""
        return [joint for part in self.below(link) for joint in self.carried[part] if joint.moves]

    def path_to(self, link: str) -> list[UrdfJoint]:
        """Joints from the root to a link."""
        path: list[UrdfJoint] = []
        while link in self.carrier:
            path.insert(0, self.carrier[link])
            link = path[0].parent
        return path

    def next(self, link: str) -> list[UrdfJoint]:
        """Moving joints that go out from a link and all that is fixed to it, the farthest-reaching first."""
        moving: list[UrdfJoint] = []
        rigid = [link]
        for part in rigid:
            moving += [joint for joint in self.carried[part] if joint.moves]
            rigid += [joint.child for joint in self.carried[part] if not joint.moves]
        return sorted(moving, key=lambda joint: -self.reach[joint.child])


def read_urdf(path: Path) -> UrdfFile:
    """Read a URDF; ``-`` is standard input.

    Raises
    ------
    RecipeError [file-not-readable]
        It cannot be read.
    RecipeError [urdf-refused], or Faults of several
        It is not XML, not a URDF, or its links and joints are no trees.
    """
    content, file = read_bytes(path, kind=RecipeError, most=MAX_BYTES), file_name(path)
    robot = _parsed(content, file)
    if robot.tag != "robot":
        raise refusal(file, f"the file holds <{robot.tag[:40]}>, not <robot>", "give the arm's URDF", line=robot.line)
    _refuse_xacro(robot, file)
    links = [element.get("name", "").strip() for element in robot.findall("link")]
    joints = [_joint(element, file) for element in robot.iterfind("joint") if isinstance(element, Element)]
    faults = [*_unnamed(robot, file), *_structure(links, joints)]
    urdf = UrdfFile(
        robot.get("name", ""), tuple(links), tuple(joints), file, digest=hashlib.sha256(content).hexdigest()
    )
    faults = faults or list(_circle(urdf))
    if faults:
        raise_together(sorted(faults, key=lambda fault: fault.where.line or 0))
    return urdf


def _parsed(content: bytes, file: str) -> Element:
    """The outermost element; document types, and with them entities, are refused."""
    parser, builder = expat.ParserCreate(), ElementTree.TreeBuilder(element_factory=Element)

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = builder.start(tag, attributes)
        assert isinstance(element, Element)
        element.line = parser.CurrentLineNumber

    def refuse_document_type(*_: object) -> None:
        mend = "take the line <!DOCTYPE ...> away, and write entities out"
        raise refusal(file, "the file has a document type", mend, line=parser.CurrentLineNumber)

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.StartDoctypeDeclHandler = refuse_document_type
    try:
        parser.Parse(content, True)
        root = builder.close()
    except expat.ExpatError as error:
        what = f"this is not XML: {expat.ErrorString(error.code)}"
        raise refusal(file, what, "every tag must be closed and quoted", line=error.lineno) from error
    except (LookupError, ValueError) as error:  # an encoding that Python lacks, or that does not fit the bytes
        raise refusal(file, f"the text cannot be read: {error}", "save the file as UTF-8", line=1) from error
    assert isinstance(root, Element)
    return root


def _refuse_xacro(robot: Element, file: str) -> None:
    for element in robot.iter():
        macro = next((text for text in element.attrib.values() if "${" in text or "$(" in text), None)
        if element.tag.startswith("xacro:") or macro is not None:
            what = f"this is a xacro file, not a URDF: {macro or '<' + element.tag + '>'}"
            mend = "run: xacro FILE > arm.urdf   (with ROS 2: ros2 run xacro xacro FILE), then give arm.urdf"
            raise refusal(file, what, mend, line=getattr(element, "line", None))


def _joint(element: Element, file: str) -> UrdfJoint:
    name, kind = element.get("name", "").strip(), element.get("type", "").strip()
    parent, child = element.text_of("parent", "link"), element.text_of("child", "link")
    return UrdfJoint(name, kind, parent, child, element.text_of("mimic", "joint"), element, file)


def _unnamed(robot: Element, file: str) -> Iterator[PumaidError]:
    """Links and joints without a name, or with one that stands twice."""
    for tag in ("link", "joint"):
        first: dict[str, int] = {}
        for element in robot:
            name, line = element.get("name", "").strip(), getattr(element, "line", 0)
            if element.tag == tag and not name:
                yield refusal(file, f"a {tag} has no name", f'write <{tag} name="...">', line=line)
            elif element.tag == tag and first.setdefault(name, line) != line:
                what = f"the {tag} {name} stands on line {first[name]} too"
                yield refusal(file, what, f"give each {tag} its own name", line=line)


def _structure(links: Sequence[str], joints: Sequence[UrdfJoint]) -> Iterator[PumaidError]:
    """Joints of unknown types, between links that are not there, and links that two joints carry."""
    known, carriers = set(links), Counter(joint.child for joint in joints)
    if not links and joints:
        yield refusal(joints[0].file, "there is no link", "give the arm's URDF")
    for joint in joints:
        line = joint.element.line
        if joint.kind not in TYPES:
            near = nearest(joint.kind, TYPES)
            mend = f"did you mean {near}?" if near else f"one of {', '.join(TYPES)}"
            yield refusal(joint.file, f"joint {joint.name} has type '{joint.kind[:40]}'", mend, line=line)
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                near = nearest(link, known) if len(known) < 10_000 else None
                mend = f"did you mean {near}?" if near else f'write <{tag} link="..."/> with the name of a link'
                what = f"joint {joint.name} has the {tag} '{link[:40]}', which is no link"
                yield refusal(joint.file, what, mend, line=line)
        if carriers[joint.child] > 1 and joint.child in known:
            what = f"joint {joint.name} carries link {joint.child}, as another joint does"
            yield refusal(joint.file, what, "a link hangs on one joint; a URDF holds no closed loops", line=line)


def _circle(urdf: UrdfFile) -> Iterator[PumaidError]:
    """A joint of which going outward never ends: its link hangs on no root."""
    if not urdf.links:
        yield refusal(urdf.file, "there is no link", "give the arm's URDF")
    grounded = set(urdf.below(*urdf.roots))
    for joint in urdf.joints:
        if joint.child not in grounded:
            what = f"joint {joint.name} closes a circle of links at {joint.child}"
            yield refusal(urdf.file, what, "one of its joints must hang on the base", line=joint.element.line)
            return


@dataclass(frozen=True, slots=True)
class ArmChain:
    """The joints from link `base` to link `tip`, fixed ones among them, and what was not taken.

    Attributes
    ----------
    before
        Joints from the URDF's root to `base`, outward.
    path
        Joints from `base` to `tip`, outward.
    end
        Moving joints that the last joint carries: a gripper or hand.
    beside
        Other moving joints that the arm carries.
    elsewhere
        Moving joints that it does not carry.
    """

    base: str
    tip: str
    before: tuple[UrdfJoint, ...]
    path: tuple[UrdfJoint, ...]
    end: tuple[UrdfJoint, ...]
    beside: tuple[UrdfJoint, ...]
    elsewhere: tuple[UrdfJoint, ...]

    @property
    def moving(self) -> tuple[UrdfJoint, ...]:
        """The arm's joints."""
        return tuple(joint for joint in self.path if joint.moves)


def arm_chain(urdf: UrdfFile, *, base: str | None = None, tip: str | None = None) -> ArmChain:
    """The arm in a URDF.

    With `tip`, all that lies between it and `base`. Without, the line of most moving joints from `base`, cut where it
    splits into a gripper or hand (branches shorter than the line so far, and as long as one another or more than two)
    and before joints that mimic others.

    Parameters
    ----------
    urdf
        The robot.
    base
        The link to start at; the root where not given.
    tip
        The link to end at.

    Raises
    ------
    RecipeError [urdf-which-chain]
        A link is not there, several chains are as long as one another, or none can be stated by a recipe.
    """
    for word, link in (("--base", base), ("--tip", tip)):
        if link is not None and link not in urdf.links:
            near = nearest(link, urdf.links) if len(urdf.links) < 10_000 else None
            more = " ..." if len(urdf.links) > LISTED else ""
            mend = f"did you mean {near}?" if near else f"links are {', '.join(urdf.links[:LISTED])}{more}"
            raise _which(urdf, f"{word} {link}: there is no such link", mend)
    if base is None:
        base = _root(urdf, tip)
    end = _longest(urdf, base) if tip is None else tip
    before, whole = urdf.path_to(base), urdf.path_to(end)
    if whole[: len(before)] != before:
        mend = f"--base must lie on the way to it: {' > '.join(joint.parent for joint in whole)}"
        raise _which(urdf, f"no joints lead outward from {base} to {end}", mend)
    path = whole[len(before) :]
    _refuse_unusable(urdf, base, path)
    moving = [joint for joint in path if joint.moves]
    taken = {joint.name for joint in path}
    carried = [joint for joint in urdf.moving_below(moving[0].child) if joint.name not in taken]
    beyond = {joint.name for joint in urdf.moving_below(moving[-1].child)}
    known = taken | {joint.name for joint in carried}
    return ArmChain(
        base,
        end,
        before=tuple(before),
        path=tuple(path),
        end=tuple(joint for joint in carried if joint.name in beyond),
        beside=tuple(joint for joint in carried if joint.name not in beyond),
        elsewhere=tuple(joint for joint in urdf.joints if joint.moves and joint.name not in known),
    )


def _which(urdf: UrdfFile, what: str, mend: str) -> RecipeError:
    return RecipeError("urdf-which-chain", what, Where(file=urdf.file), mend)


def _root(urdf: UrdfFile, tip: str | None) -> str:
    if tip is not None:
        path = urdf.path_to(tip)
        return path[0].parent if path else tip
    roots = urdf.roots
    if len(roots) > 1:
        what = f"{len(roots)} links hang on no joint: {', '.join(roots[:LISTED])}"
        raise _which(urdf, what, "say where the arm starts, with --base LINK")
    return roots[0]


def _longest(urdf: UrdfFile, base: str) -> str:
    """The tip of the one longest chain from `base`."""
    tip, is_clear, _ = _walk(urdf, base)
    if is_clear:
        return tip
    chains, starts = [], [base]
    for start in starts:
        for joint in urdf.next(start):
            end, is_clear, count = _walk(urdf, joint.child)
            chains.append((start, end, count + 1))
            starts += [] if is_clear else [end]
    chains.sort(key=lambda chain: -chain[2])
    told = "; ".join(
        f"--base {quote(start)} --tip {quote(end)} ({count} joint{'s' * (count > 1)})"
        for start, end, count in chains[:LISTED]
    )
    more = f"; {len(chains) - LISTED} more" if len(chains) > LISTED else ""
    what = f"below {base} several chains of joints are as long as one another"
    raise _which(urdf, what, f"say which one: {told}{more}")


def _walk(urdf: UrdfFile, start: str) -> tuple[str, bool, int]:
    """Where the longest chain ends or splits, whether it is clear which chain that is, and its number of joints."""
    link, count = start, 0
    while ahead := urdf.next(link):
        lengths = [1 + urdf.reach[joint.child] for joint in ahead]
        is_tie = len(ahead) > 1 and lengths[0] == lengths[1]
        is_hand = len(ahead) > 1 and lengths[0] < count and (is_tie or len(ahead) > 2)
        if is_hand or (count and not is_tie and ahead[0].follows):
            return link, True, count
        if is_tie:
            return link, False, count
        link, count = ahead[0].child, count + 1
    return link, True, count


def _refuse_unusable(urdf: UrdfFile, base: str, path: Sequence[UrdfJoint]) -> None:
    for joint in path:
        if joint.kind in FREE:
            what = f"joint {joint.name} is {joint.kind}; a recipe's joints turn or slide"
            raise _which(urdf, what, f"start behind it: --base {quote(joint.child)}")
        if joint.follows:
            what = f"joint {joint.name} follows joint {joint.follows} (mimic); a recipe's joints move by themselves"
            raise _which(urdf, what, f"end before it: --tip {quote(joint.parent)}")
    count = sum(joint.moves for joint in path)
    if count == 0:
        mend = "name links that moving joints connect, with --base and --tip"
        raise _which(urdf, f"no joint moves outward of {base}", mend)
    if count > MOST_JOINTS:
        mend = "take a part of it, with --base and --tip"
        raise _which(urdf, f"{count} joints in a line; a recipe holds {MOST_JOINTS}", mend)
