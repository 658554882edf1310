"""URDF files: the serial chain in one that is an arm, and the recipe that states it as it is."""

from __future__ import annotations

import hashlib
import math
import re
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, PumaidError, RecipeError, Where
from pumaid.io.forms import file_name, nearest, raise_together, read_bytes, yaml_text
from pumaid.io.recipe import parsed_recipe, recipe_text
from pumaid.io.recipe_schema import FASTEST, FASTEST_RAIL, LONGEST_RAIL, SLOWEST, WIDEST, is_joint_name
from pumaid.kinematics import placement, roll_pitch_yaw
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Types of a URDF's joints.
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
#: Most bytes of a URDF, and most joints of a recipe.
MAX_BYTES, MAX_JOINTS = 20_000_000, 50
#: A joint farther than this (m) from the one before, or angles beyond this (rad), are in another unit.
FARTHEST, WIDEST_ANGLE = 20.0, 4.0 * math.pi
#: Most chains and names that a message lists.
LISTED = 8
FREE_FALL = 9.80665
#: Decimals of lengths and angles; an angle this near to a multiple of 15 deg (rad), as the rounding of a URDF with
#: nine decimals is, is written as that.
DECIMALS, SNAP = 12, 2.5e-9
_GRIPPER = re.compile(r"grip|finger|jaw|claw|thumb", re.IGNORECASE)


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
    element: ElementTree.Element
    file: str

    @property
    def moves(self) -> bool:
        """Whether it is not fixed."""
        return self.kind != "fixed"

    @property
    def frame(self) -> Floats:
        """(4, 4) the joint's frame at zero in that of the link before, m.

        Raises
        ------
        RecipeError [urdf-refused]
            Its origin is not of numbers, or in another unit.
        """
        xyz, rpy = self._numbers("origin", "xyz", "0 0 0"), self._numbers("origin", "rpy", "0 0 0")
        if math.hypot(*xyz) > FARTHEST or max(map(abs, rpy)) > WIDEST_ANGLE:
            what = f"an origin {math.hypot(*xyz):g} m away, turned by up to {max(map(abs, rpy)):g} rad"
            raise self.refusal(what, "lengths of a URDF are in m, angles in rad")
        return placement(xyz, rpy)

    @property
    def axis(self) -> list[float]:
        """Unit vector of the axis in the joint's frame; x where not given; errors as for `frame`."""
        axis = self._numbers("axis", "xyz", "1 0 0")
        size = math.hypot(*axis)
        if not 1e-9 < size < math.inf:
            raise self.refusal(f"the axis {axis} has no direction", 'write it as xyz="0 0 1"')
        return [value / size for value in axis]

    def limit(self, word: str) -> float:
        """The limit lower, upper or velocity (rad or m, a second); infinite where not given."""
        text = _attribute(self.element, "limit", word) or "inf"
        if text.lstrip("+-").lower() in ("inf", "infinity"):
            return math.inf
        return self._numbers("limit", word, text, count=1)[0]

    def _numbers(self, tag: str, word: str, default: str, *, count: int = 3) -> list[float]:
        text = default if self.element.find(tag) is None else _attribute(self.element, tag, word, default)
        try:
            values = [float(part) for part in text.split() if "_" not in text]  # Python alone reads 1_000
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            wanted = f"{count} finite numbers" if count > 1 else "a finite number"
            what = f'{word}="{text[:60]}" of <{tag}> is not {wanted}'
            raise self.refusal(what, "write them with a point, in m and rad")
        return values

    def refusal(self, what: str, mend: str) -> RecipeError:
        """The error of a joint that cannot be used."""
        return RecipeError("urdf-refused", what[:200], Where(self.file, field=f"joint {self.name}"), mend)


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


@dataclass(frozen=True, slots=True)
class ArmChain:
    """The joints from link `base` to link `tip`, fixed ones among them, and what was not taken.

    `before` are the joints from the URDF's root to `base`, `path` those from `base` to `tip`, outward; of the other
    moving joints the arm carries those of `carried` (a gripper, a camera), and not those `elsewhere`.
    """

    base: str
    tip: str
    before: tuple[UrdfJoint, ...]
    path: tuple[UrdfJoint, ...]
    carried: tuple[UrdfJoint, ...]
    elsewhere: tuple[UrdfJoint, ...]

    @property
    def moving(self) -> tuple[UrdfJoint, ...]:
        """The arm's joints."""
        return tuple(joint for joint in self.path if joint.moves)


@dataclass(frozen=True, slots=True)
class UrdfRecipe:
    """A recipe made from a URDF, as text and as the robot that is read back from it; frame 0 is link `chain.base`.

    `notes` tell what the URDF lacks, and what was left out.
    """

    text: str
    robot: Robot
    urdf: UrdfFile
    chain: ArmChain
    notes: tuple[Note, ...]


def read_urdf(path: Path) -> UrdfFile:
    """Read a URDF; ``-`` is standard input.

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused], or Faults of several
        It cannot be read, is not XML, not a URDF, or its links and joints are no trees.
    """
    content, file = read_bytes(path, kind=RecipeError, most=MAX_BYTES), file_name(path)
    robot = _parsed(content, file)
    links = tuple(element.get("name", "").strip() for element in robot.findall("link"))
    joints = tuple(
        UrdfJoint(
            element.get("name", "").strip(),
            element.get("type", "").strip(),
            _attribute(element, "parent", "link"),
            _attribute(element, "child", "link"),
            _attribute(element, "mimic", "joint"),
            element,
            file,
        )
        for element in robot.findall("joint")
    )
    urdf = UrdfFile(robot.get("name", ""), links, joints, file, hashlib.sha256(content).hexdigest())
    faults = list(_faults(urdf))
    if faults:
        raise_together(faults)
    grounded = set(urdf.below(*urdf.roots))
    circle = next((joint for joint in urdf.joints if joint.child not in grounded), None)
    if circle is not None:
        what = f"joint {circle.name} closes a circle of links at {circle.child}"
        raise circle.refusal(what, "one of its joints must hang on the base")
    return urdf


class _Builder(ElementTree.TreeBuilder):
    """Refuses document types, and with them entities."""

    def doctype(self, name: str, *_: object) -> None:
        raise ValueError(f"the file has a document type: take the line <!DOCTYPE {name[:40]} ...> away")


def _parsed(content: bytes, file: str) -> ElementTree.Element:
    """The element <robot>, tags without namespaces."""

    def refusal(what: str, mend: str, line: int | None = None) -> RecipeError:
        return RecipeError("urdf-refused", what[:200], Where(file=file, line=line), mend)

    try:
        robot = ElementTree.fromstring(content, ElementTree.XMLParser(target=_Builder()))
    except ElementTree.ParseError as error:
        raise refusal(f"this is not XML: {error}", "every tag must be closed and quoted", error.position[0]) from error
    except (LookupError, ValueError) as error:  # an encoding that Python lacks, or that does not fit the bytes
        raise refusal(f"the text cannot be read: {error}", "save the file as plain UTF-8") from error
    for element in robot.iter():
        space, _, tag = element.tag.rpartition("}")
        macro = next((text for text in element.attrib.values() if "${" in text or "$(" in text), None)
        if space.endswith("xacro") or macro is not None:
            mend = "run: xacro FILE > arm.urdf   (with ROS 2: ros2 run xacro xacro FILE), then give arm.urdf"
            raise refusal(f"this is a xacro file, not a URDF: {macro or f'<{tag}>'}", mend)
        element.tag = tag
    if robot.tag != "robot":
        raise refusal(f"the file holds <{robot.tag[:40]}>, not <robot>", "give the arm's URDF")
    return robot


def _attribute(element: ElementTree.Element, tag: str, word: str, default: str = "") -> str:
    """An attribute of the first element of that name below."""
    child = element.find(tag)
    return default if child is None else child.get(word, default).strip()


def _faults(urdf: UrdfFile) -> Iterator[PumaidError]:
    """Links and joints without a name of their own, of unknown types, and ends of joints that are no links."""
    if not urdf.links:
        yield RecipeError("urdf-refused", "there is no link", Where(urdf.file), "give the arm's URDF")
    for tag, names in (("link", urdf.links), ("joint", [joint.name for joint in urdf.joints])):
        for name, count in Counter(names).items():
            if not name or count > 1:
                what = f"the name {name} is of {count} {tag}s" if name else f"a {tag} has no name"
                yield RecipeError("urdf-refused", what[:200], Where(urdf.file), f"give each {tag} its own name")
    links, carriers = set(urdf.links), Counter(joint.child for joint in urdf.joints)
    for joint in urdf.joints:
        if joint.kind not in TYPES:
            yield joint.refusal(f"joint {joint.name} has type '{joint.kind[:40]}'", _meant(joint.kind, TYPES))
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                what = f"joint {joint.name} has the {tag} '{link[:40]}', which is no link"
                yield joint.refusal(what, _meant(link, urdf.links))
        if carriers[joint.child] > 1 and joint.child in links:
            what = f"joint {joint.name} carries link {joint.child}, as another joint does"
            yield joint.refusal(what, "a link hangs on one joint; a URDF holds no closed loops")


def _meant(word: str, names: Sequence[str]) -> str:
    near = nearest(word, names) if len(names) < 10_000 else None
    return f"did you mean {near}?" if near else f"there are {_listed(names)}"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def arm_chain(urdf: UrdfFile, *, base: str | None = None, tip: str | None = None) -> ArmChain:
    """The arm in a URDF, from link `base` (the root where not given) to link `tip`.

    Without `tip`, the line of most moving joints from `base`, cut where it splits into a gripper or hand (branches
    shorter than the line so far, and as long as one another or more than two) and before joints that mimic others.

    Raises
    ------
    RecipeError [urdf-which-chain]
        A link is not there, several chains are as long as one another, or none can be stated by a recipe.
    """
    for word, link in (("--base", base), ("--tip", tip)):
        if link is not None and link not in urdf.links:
            raise _which(urdf, f"{word} {link}: there is no such link", _meant(link, urdf.links))
    if base is None:
        roots = [next((joint.parent for joint in urdf.path_to(tip)), tip)] if tip is not None else urdf.roots
        if len(roots) > 1:
            what = f"{len(roots)} links hang on no joint: {_listed(roots)}"
            raise _which(urdf, what, "say where the arm starts, with --base LINK")
        base = roots[0]
    tip = _longest(urdf, base) if tip is None else tip
    before, whole = urdf.path_to(base), urdf.path_to(tip)
    if whole[: len(before)] != before:
        mend = f"--base must lie on the way to it: {' > '.join(joint.parent for joint in whole)}"
        raise _which(urdf, f"no joints lead outward from {base} to {tip}", mend)
    path = whole[len(before) :]
    _refuse_unusable(urdf, base, path)
    taken = {joint.name for joint in path}
    outward = set(urdf.below(next(joint.child for joint in path if joint.moves)))
    rest = [joint for joint in urdf.joints if joint.moves and joint.name not in taken]
    carried = tuple(joint for joint in rest if joint.parent in outward)
    elsewhere = tuple(joint for joint in rest if joint.parent not in outward)
    return ArmChain(base, tip, tuple(before), tuple(path), carried, elsewhere)


def _which(urdf: UrdfFile, what: str, mend: str) -> RecipeError:
    return RecipeError("urdf-which-chain", what, Where(file=urdf.file), mend)


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
    listed = [
        f"--base {shlex.quote(start)} --tip {shlex.quote(end)} ({count} joint{'s' * (count > 1)})"
        for start, end, count in chains
    ]
    more = f"; {len(chains) - LISTED} more" if len(chains) > LISTED else ""
    what = f"below {base} several chains of joints are as long as one another"
    raise _which(urdf, what, f"say which one: {'; '.join(listed[:LISTED])}{more}")


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
        if joint.kind in ("floating", "planar"):
            what = f"joint {joint.name} is {joint.kind}; a recipe's joints turn or slide"
            raise _which(urdf, what, f"start behind it: --base {shlex.quote(joint.child)}")
        if joint.follows:
            what = f"joint {joint.name} follows joint {joint.follows} (mimic); a recipe's joints move by themselves"
            raise _which(urdf, what, f"end before it: --tip {shlex.quote(joint.parent)}")
    count = sum(joint.moves for joint in path)
    if not 0 < count <= MAX_JOINTS:
        what = f"{count or 'no'} joints move between {base} and the tip; a recipe holds 1 to {MAX_JOINTS}"
        raise _which(urdf, what, "name links that moving joints connect, with --base and --tip")


def recipe_from_urdf(path: Path, *, base: str | None = None, tip: str | None = None) -> UrdfRecipe:
    """Make a recipe from a URDF (``-`` is standard input) of the arm between two links (found where not given).

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused, urdf-which-chain]
        The file cannot be used, or it is not clear which joints are the arm.
    """
    urdf = read_urdf(path)
    chain = arm_chain(urdf, base=base, tip=tip)
    root = np.eye(4)
    for joint in chain.before:
        root = root @ joint.frame
    printable = ["".join(c if c.isprintable() else "?" for c in text) for text in (path.name, chain.base, chain.tip)]
    file, *ends = printable
    joints, notes = _joints(chain)
    text = recipe_text(
        shlex.join(["pumaid", "init", "--urdf", file, "--base", ends[0], "--tip", ends[1]]),
        name=yaml_text(urdf.name[:200] if urdf.name.strip() and urdf.name.isprintable() else "arm"),
        base=ends[0],
        source=yaml_text(f"URDF {file}, links {ends[0]} to {ends[1]}; SHA-256 {urdf.digest}"),
        gravity=_vector(-FREE_FALL * root[2, :3]),
        joints=joints,
    )
    robot = parsed_recipe(text.encode(), file_name(path))
    return UrdfRecipe(text, robot, urdf, chain, (*_notes_on_chain(chain), *notes))


def _joints(chain: ArmChain) -> tuple[list[str], list[Note]]:
    """The joints' lines of the recipe, and notes on names, limits and speeds that are missing or unusable."""
    lines: list[str] = []
    names: list[str] = []
    notes: list[Note] = []
    without: dict[str, list[str]] = {"limits": [], "highest speed": []}
    frame = np.eye(4)
    for joint in chain.path:
        frame = frame @ joint.frame
        if not joint.moves:
            continue
        name = joint.name if is_joint_name(joint.name) else f"joint{len(names) + 1}"
        while name.lower() in (other.lower() for other in names):
            name += "_"
        names.append(name)
        if name != joint.name:
            text = f"no recipe can name a joint {joint.name!r}; it is called {name}"
            notes.append(Note("urdf-incomplete", text, Where(joint=len(names))))
        slides = joint.kind == "prismatic"
        rpy = ", ".join(map(_angle, roll_pitch_yaw(frame[:3, :3])))
        place = f"{{xyz: {_vector(frame[:3, 3])}, rpy: [{rpy}], axis: {_vector(joint.axis)}}}"
        words = [f"name: {yaml_text(name)}", f"type: {'prismatic' if slides else 'revolute'}", f"placement: {place}"]
        low, high, speed = (joint.limit(word) for word in ("lower", "upper", "velocity"))
        farthest, slowest, fastest = (LONGEST_RAIL, 1e-9, FASTEST_RAIL) if slides else (WIDEST, SLOWEST, FASTEST)
        if joint.kind != "continuous" and -farthest <= low < high <= farthest:
            words.append(f"limits: {_vector((low, high))}")
        elif joint.kind != "continuous":
            without["limits"].append(name)
        if slowest <= speed <= fastest:
            words.append(f"max_velocity: {_decimal(speed)}")
        else:
            without["highest speed"].append(name)
        lines.append(f"{{{', '.join(words)}}}")
        frame = np.eye(4)
    for what, lacking in without.items():
        if lacking:
            text = f"the URDF states no usable {what} of {_listed(lacking)}: put the arm's own into the recipe"
            notes.append(Note("urdf-incomplete", text))
    return lines, notes


def _notes_on_chain(chain: ArmChain) -> list[Note]:
    """Which joints were not taken, and whether the last one should have been."""
    notes = []
    if chain.carried:
        text = f"left out, and carried by the arm: {_counted(chain.carried)}; hold them still, they weigh on the arm"
        notes.append(Note("urdf-left-out", text))
    if chain.elsewhere:
        notes.append(Note("urdf-left-out", f"left out, and not carried by the arm: {_counted(chain.elsewhere)}"))
    last = chain.moving[-1]
    if len(chain.moving) > 1 and _GRIPPER.search(f"{last.name} {last.child}"):
        text = f"the last joint, {last.name}, may be a gripper's: leave it out with --tip {shlex.quote(last.parent)}"
        notes.append(Note("urdf-left-out", text))
    moving = [joint for joint in chain.before if joint.moves]
    if moving:
        notes.append(Note("urdf-base-moves", f"gravity is given for {_counted(moving)} before the base at zero"))
    return notes


def _counted(joints: Sequence[UrdfJoint]) -> str:
    return f"{len(joints)} moving joint{'s' * (len(joints) > 1)} ({_listed([joint.name for joint in joints])})"


def _vector(values: Sequence[float] | Floats) -> str:
    return f"[{', '.join(map(_decimal, values))}]"


def _decimal(value: float) -> str:
    """A bare number without exponent and trailing zeros."""
    return np.format_float_positional(round(value, DECIMALS) + 0.0, trim="0")


def _angle(value: float) -> str:
    """Radians: ``-pi/2`` and the like where they are near, else a bare number."""
    part = Fraction(round(value / math.pi * 12), 12)
    if abs(value - part * math.pi) > SNAP:
        return _decimal(value)
    times = {1: "", -1: "-"}.get(part.numerator, f"{part.numerator}*")
    return "0" if not part else f"{times}pi" + (f"/{part.denominator}" if part.denominator > 1 else "")
