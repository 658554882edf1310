"""URDF files: the serial chain in one that is an arm, and the recipe that states it as it is."""

from __future__ import annotations

import hashlib
import math
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, RecipeError, Where, listed
from pumaid.io.forms import file_name, meant, read_bytes, yaml_text
from pumaid.io.recipe import parsed_recipe, recipe_text
from pumaid.io.recipe_schema import FASTEST, FASTEST_RAIL, LONGEST_RAIL, SLOWEST, WIDEST, is_joint_name
from pumaid.kinematics import placement, roll_pitch_yaw
from pumaid.robot import Robot

Floats = NDArray[np.float64]

TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
#: Most bytes of a URDF, and most joints of a recipe.
MAX_BYTES, MAX_JOINTS = 20_000_000, 50
#: A joint farther than this (m) from the one before, or angles beyond this (rad), are in another unit.
FARTHEST, WIDEST_ANGLE = 20.0, 4.0 * math.pi
FREE_FALL = 9.80665
#: Decimals of lengths and angles; an angle this near to a multiple of 15 deg (rad), as the rounding of a URDF with
#: nine decimals is, is written as that.
DECIMALS, SNAP = 12, 2.5e-9
_GRIPPER = re.compile(r"grip|finger|jaw|claw|thumb", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint as the file states it, of one of `TYPES`; `follows` is the joint that it mimics, or empty.

    Its numbers are checked when they are read, since not every joint is the arm's.
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

    def frame(self) -> Floats:
        """(4, 4) the joint's frame at zero in that of the link before, m; [urdf-refused] in another unit."""
        xyz, rpy = self.numbers("origin", "xyz", "0 0 0"), self.numbers("origin", "rpy", "0 0 0")
        if math.hypot(*xyz) > FARTHEST or max(map(abs, rpy)) > WIDEST_ANGLE:
            what = f"an origin {math.hypot(*xyz):g} m away, turned by up to {max(map(abs, rpy)):g} rad"
            raise self.refusal(what, "lengths of a URDF are in m, angles in rad")
        return placement(xyz, rpy)

    def axis(self) -> list[float]:
        """Unit vector in the joint's frame; RecipeError [urdf-refused] where it has no direction."""
        axis = self.numbers("axis", "xyz", "1 0 0")
        size = math.hypot(*axis)
        if not 1e-9 < size < math.inf:
            raise self.refusal(f"the axis {axis} has no direction", 'write it as xyz="0 0 1"')
        return [value / size for value in axis]

    def numbers(self, tag: str, word: str, default: str, *, count: int = 3) -> list[float]:
        """Finite numbers of an attribute (a limit may be infinite); RecipeError [urdf-refused] where they are none."""
        text = _attribute(self.element, tag, word, default)
        try:
            values = [float(part) for part in text.split() if "_" not in text]  # Python alone reads 1_000
        except ValueError:
            values = []
        is_good = all(map(math.isfinite, values)) or (tag == "limit" and not math.isnan(values[0]))
        if len(values) != count or not is_good:
            wanted = f"{count} finite numbers" if count > 1 else "a number"
            what = f'{word}="{text[:60]}" of <{tag}> is not {wanted}'
            raise self.refusal(what, "write them with a point, in m and rad")
        return values

    def refusal(self, what: str, mend: str) -> RecipeError:
        """The error of a joint that cannot be used."""
        return RecipeError("urdf-refused", what[:200], Where(self.file, field=f"joint {self.name[:60]}"), mend)


@dataclass(frozen=True)
class UrdfFile:
    """A robot: its links by name, its joints in the file's order, the file and the SHA-256 of its bytes."""

    name: str
    links: tuple[str, ...]
    joints: tuple[UrdfJoint, ...]
    file: str
    digest: str

    @cached_property
    def carried(self) -> dict[str, list[UrdfJoint]]:
        """Link -> the joints that it carries."""
        carried: dict[str, list[UrdfJoint]] = {link: [] for link in self.links}
        for joint in self.joints:
            carried[joint.parent].append(joint)
        return carried

    @cached_property
    def reach(self) -> dict[str, int]:
        """Link -> the most moving joints in one line outward of it."""
        reach: dict[str, int] = {}
        for link in reversed(self.below(self.roots())):
            reach[link] = max((reach[joint.child] + joint.moves for joint in self.carried[link]), default=0)
        return reach

    def roots(self) -> list[str]:
        """Links that no joint carries."""
        children = {joint.child for joint in self.joints}
        return [link for link in self.links if link not in children]

    def below(self, links: Iterable[str]) -> list[str]:
        """These links and all that they carry, carriers first."""
        below = list(links)
        for link in below:
            below += [joint.child for joint in self.carried[link]]
        return below

    def branches(self, link: str) -> list[UrdfJoint]:
        """Moving joints that go out from a link and all that is fixed to it, the farthest-reaching first."""
        moving: list[UrdfJoint] = []
        rigid = [link]
        for part in rigid:
            moving += [joint for joint in self.carried[part] if joint.moves]
            rigid += [joint.child for joint in self.carried[part] if not joint.moves]
        return sorted(moving, key=lambda joint: -self.reach[joint.child])

    def path(self, base: str | None, tip: str) -> list[UrdfJoint]:
        """Joints outward from link `base` (the root where not given) to `tip`; [urdf-which-chain] where none lead."""
        carrier = {joint.child: joint for joint in self.joints}
        path: list[UrdfJoint] = []
        link = tip
        while link != base and link in carrier:
            path.insert(0, carrier[link])
            link = path[0].parent
        if link != base is not None:
            mend = f"--base must lie on the way to it: {' > '.join(joint.parent for joint in path)}"
            raise self.unclear(f"no joints lead outward from {base} to {tip}", mend)
        return path

    def unclear(self, what: str, mend: str) -> RecipeError:
        """The error of a robot of which it is not clear which joints are the arm."""
        return RecipeError("urdf-which-chain", what, Where(file=self.file), mend)


@dataclass(frozen=True, slots=True)
class UrdfRecipe:
    """A recipe made from the joints between two links of a URDF, as text and as the robot that is read back from it.

    Frame 0 is link `base`; `path` are the joints from there to link `tip`, fixed ones among them. Of the other moving
    joints the arm carries those of `carried` (a gripper, a camera), and not those `elsewhere`. `notes` tell what the
    URDF lacks, and what was left out.
    """

    text: str
    robot: Robot
    urdf: UrdfFile
    base: str
    tip: str
    path: tuple[UrdfJoint, ...]
    carried: tuple[UrdfJoint, ...]
    elsewhere: tuple[UrdfJoint, ...]
    notes: tuple[Note, ...]


def recipe_from_urdf(path: Path, *, base: str | None = None, tip: str | None = None) -> UrdfRecipe:
    """Make a recipe from a URDF (``-`` is standard input) of the arm between two links.

    Without `base` the arm starts at the root. Without `tip` it is the line of most moving joints, cut where it splits
    into a gripper or hand (branches shorter than the line so far, and as long as one another or more than two) and
    before joints that mimic others.

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused]
        It cannot be read, is no URDF, its links and joints are no trees, or a joint of the arm has impossible numbers.
    RecipeError [urdf-which-chain]
        A link is not there, several chains are as long as one another, or none can be stated by a recipe.
    """
    urdf = _read(path)
    base, tip = _ends(urdf, base, tip)
    before, arm = urdf.path(None, base), urdf.path(base, tip)
    _refuse_unusable(urdf, base, arm)
    gravity = np.array([0.0, 0.0, -FREE_FALL])
    for joint in before:
        gravity = gravity @ joint.frame()[:3, :3]
    outward = set(urdf.below([next(joint.child for joint in arm if joint.moves)]))
    taken = {joint.name for joint in arm}
    rest = [joint for joint in urdf.joints if joint.moves and joint.name not in taken]
    carried = tuple(joint for joint in rest if joint.parent in outward)
    elsewhere = tuple(joint for joint in rest if joint.parent not in outward)
    lines, notes = _joint_lines(arm)
    file, *ends = ["".join(c if c.isprintable() else "?" for c in text) for text in (path.name, base, tip)]
    text = recipe_text(
        shlex.join(["pumaid", "init", "--urdf", file, "--base", ends[0], "--tip", ends[1]]),
        name=yaml_text(urdf.name[:200] if urdf.name.strip() and urdf.name.isprintable() else "arm"),
        base=ends[0],
        source=yaml_text(f"URDF {file}, links {ends[0]} to {ends[1]}; SHA-256 {urdf.digest}"),
        gravity=_vector(gravity),
        joints=lines,
    )
    robot = parsed_recipe(text.encode(), file_name(path))
    moving = [joint for joint in before if joint.moves]
    for joints, slug, about in (
        (carried, "urdf-left-out", "left out, and carried by the arm: {}; hold them still, they weigh on the arm"),
        (elsewhere, "urdf-left-out", "left out, and not carried by the arm: {}"),
        (moving, "urdf-base-moves", "gravity is given for {} before the base at zero"),
    ):
        names = f"{len(joints)} moving joint{'s' * (len(joints) > 1)} ({listed([joint.name for joint in joints])})"
        notes += [Note(slug, about.format(names))] if joints else []
    last = [joint for joint in arm if joint.moves][-1]
    if robot.n_joints > 1 and _GRIPPER.search(f"{last.name} {last.child}"):
        about = f"the last joint, {last.name}, may be a gripper's: leave it out with --tip {shlex.quote(last.parent)}"
        notes.append(Note("urdf-left-out", about))
    return UrdfRecipe(text, robot, urdf, base, tip, tuple(arm), carried, elsewhere, tuple(notes))


class _Builder(ElementTree.TreeBuilder):
    """Refuses document types, and with them entities."""

    def doctype(self, name: str, *_: object) -> None:
        raise ValueError(f"the file has a document type: take the line <!DOCTYPE {name[:40]} ...> away")


def _read(path: Path) -> UrdfFile:
    """A URDF with its links and joints, which are trees."""
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
    for tag, names in (("link", links), ("joint", [joint.name for joint in joints])):
        name, count = Counter(names).most_common(1)[0] if names else ("", 1)
        if count > 1 or "" in names or not links:
            what = f"the name {name} is of {count} {tag}s" if name else f"a {tag} or its name is missing"
            raise RecipeError("urdf-refused", what[:200], Where(file), f"give each {tag} its own name")
    carriers = Counter(joint.child for joint in joints)
    for joint in joints:
        if joint.kind not in TYPES:
            raise joint.refusal(f"joint {joint.name} has type '{joint.kind[:40]}'", meant(joint.kind, TYPES))
        for tag, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                what = f"joint {joint.name} has the {tag} '{link[:40]}', which is no link"
                raise joint.refusal(what, meant(link, links))
        if carriers[joint.child] > 1:
            what = f"joint {joint.name} carries link {joint.child}, as another joint does"
            raise joint.refusal(what, "a link hangs on one joint; a URDF holds no closed loops")
    urdf = UrdfFile(robot.get("name", ""), links, joints, file, hashlib.sha256(content).hexdigest())
    grounded = set(urdf.below(urdf.roots()))
    for joint in joints:
        if joint.child not in grounded:
            what = f"joint {joint.name} closes a circle of links at {joint.child}"
            raise joint.refusal(what, "one of its joints must hang on the base")
    return urdf


def _parsed(content: bytes, file: str) -> ElementTree.Element:
    """The element <robot>, tags without namespaces."""
    line, what, mend = None, "", ""
    try:
        robot = ElementTree.fromstring(content, ElementTree.XMLParser(target=_Builder()))
    except ElementTree.ParseError as error:
        line, what, mend = error.position[0], f"this is not XML: {error}", "every tag must be closed and quoted"
    except (LookupError, ValueError) as error:  # an encoding that Python lacks, or that does not fit the bytes
        what, mend = f"the text cannot be read: {error}", "save the file as plain UTF-8"
    else:
        for element in robot.iter():
            space, _, tag = element.tag.rpartition("}")
            macro = next((text for text in element.attrib.values() if "${" in text or "$(" in text), None)
            if space.endswith("xacro") or macro is not None:
                what = f"this is a xacro file, not a URDF: {macro or f'<{tag}>'}"
                mend = "run: xacro FILE > arm.urdf   (with ROS 2: ros2 run xacro xacro FILE), then give arm.urdf"
            element.tag = tag
        if robot.tag != "robot":
            what, mend = f"the file holds <{robot.tag[:40]}>, not <robot>", "give the arm's URDF"
    if what:
        raise RecipeError("urdf-refused", what[:200], Where(file=file, line=line), mend)
    return robot


def _attribute(element: ElementTree.Element, tag: str, word: str, default: str = "") -> str:
    """An attribute of the first element of that name below."""
    child = element.find(tag)
    return default if child is None else child.get(word, default).strip()


def _ends(urdf: UrdfFile, base: str | None, tip: str | None) -> tuple[str, str]:
    """The first and last link of the arm, guessed where they are not given."""
    for word, link in (("--base", base), ("--tip", tip)):
        if link is not None and link not in urdf.links:
            raise urdf.unclear(f"{word} {link}: there is no such link", meant(link, urdf.links))
    if base is None:
        roots = urdf.roots() if tip is None else [*(joint.parent for joint in urdf.path(None, tip)), tip][:1]
        if len(roots) > 1:
            what = f"{len(roots)} links hang on no joint: {listed(roots)}"
            raise urdf.unclear(what, "say where the arm starts, with --base LINK")
        base = roots[0]
    if tip is not None:
        return base, tip
    tip, count, ties = _longest(urdf, base)
    if ties:
        chains = [(tip, *_longest(urdf, joint.child)) for joint in ties]
        options = [
            f"--base {shlex.quote(start)} --tip {shlex.quote(end)} ({1 + n} joint{'s' * (n > 0)})"
            for start, end, n, _ in chains
        ]
        if count:
            options.append(f"--base {shlex.quote(base)} --tip {shlex.quote(tip)} ({count} joint{'s' * (count > 1)})")
        what = f"below {base} several chains of joints are as long as one another"
        raise urdf.unclear(what, f"say which one: {listed(options, separator='; ')}")
    return base, tip


def _longest(urdf: UrdfFile, start: str) -> tuple[str, int, list[UrdfJoint]]:
    """Where the line of most joints ends, its number of joints, and its branches where several are as long there."""
    link, count = start, 0
    while branches := urdf.branches(link):
        lengths = [1 + urdf.reach[joint.child] for joint in branches]
        is_tie = len(branches) > 1 and lengths[0] == lengths[1]
        is_hand = len(branches) > 1 and lengths[0] < count and (is_tie or len(branches) > 2)
        if is_hand or (count and not is_tie and branches[0].follows):
            break
        if is_tie:
            return link, count, branches
        link, count = branches[0].child, count + 1
    return link, count, []


def _refuse_unusable(urdf: UrdfFile, base: str, path: Sequence[UrdfJoint]) -> None:
    """Refuse joints that no recipe can state."""
    for joint in path:
        if joint.kind in ("floating", "planar"):
            what = f"joint {joint.name} is {joint.kind}; a recipe's joints turn or slide"
            raise urdf.unclear(what, f"start behind it: --base {shlex.quote(joint.child)}")
        if joint.follows:
            what = f"joint {joint.name} follows joint {joint.follows} (mimic); a recipe's joints move by themselves"
            raise urdf.unclear(what, f"end before it: --tip {shlex.quote(joint.parent)}")
    count = sum(joint.moves for joint in path)
    if not 0 < count <= MAX_JOINTS:
        what = f"{count or 'no'} joints move between {base} and the tip; a recipe holds 1 to {MAX_JOINTS}"
        raise urdf.unclear(what, "name links that moving joints connect, with --base and --tip")


def _joint_lines(path: Sequence[UrdfJoint]) -> tuple[list[str], list[Note]]:
    """The joints' lines of the recipe, and notes on names, limits and speeds that are missing or unusable."""
    lines, notes, frame = [], [], np.eye(4)
    names: list[str] = []
    without: dict[str, list[str]] = {"limits": [], "highest speed": []}
    for joint in path:
        frame = frame @ joint.frame()
        if not joint.moves:
            continue
        name = joint.name if is_joint_name(joint.name) else f"joint{len(names) + 1}"
        while name.lower() in (other.lower() for other in names):
            name += "_"
        names.append(name)
        if name != joint.name:
            text = f"no recipe can name a joint {joint.name!r}; it is called {name}"
            notes.append(Note("urdf-incomplete", text, Where(joint=len(names))))
        kind = "prismatic" if joint.kind == "prismatic" else "revolute"
        rpy = ", ".join(map(_angle, roll_pitch_yaw(frame[:3, :3])))
        place = f"{{xyz: {_vector(frame[:3, 3])}, rpy: [{rpy}], axis: {_vector(joint.axis())}}}"
        line = f"{{name: {yaml_text(name)}, type: {kind}, placement: {place}"
        low, high, speed = (joint.numbers("limit", key, "inf", count=1)[0] for key in ("lower", "upper", "velocity"))
        rail = (LONGEST_RAIL, 1e-9, FASTEST_RAIL)
        farthest, slowest, fastest = rail if kind == "prismatic" else (WIDEST, SLOWEST, FASTEST)
        if joint.kind != "continuous":
            has_limits = -farthest <= low < high <= farthest
            line += f", limits: {_vector((low, high))}" if has_limits else ""
            without["limits"] += [] if has_limits else [name]
        has_speed = slowest <= speed <= fastest
        line += f", max_velocity: {_decimal(speed)}" if has_speed else ""
        without["highest speed"] += [] if has_speed else [name]
        lines.append(line + "}")
        frame = np.eye(4)
    for what, lacking in without.items():
        if lacking:
            text = f"the URDF states no usable {what} of {listed(lacking)}: put the arm's own into the recipe"
            notes.append(Note("urdf-incomplete", text))
    return lines, notes


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
