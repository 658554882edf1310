"""URDF, xacro and MJCF files: the serial chain in one that is an arm, and the recipe that states it as it is."""

import hashlib
import math
import shlex
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pumaid.errors import Note, RecipeError, Where, listed, meant
from pumaid.io.forms import file_name, read_bytes, yaml_number, yaml_text, yaml_vector
from pumaid.io.link_shapes import safety_lines
from pumaid.io.mjcf import GRAVITY, urdf_of_mjcf
from pumaid.io.recipe import (
    SIZES,
    WIDEST_UNSTATED,
    is_joint_name,
    parsed_recipe,
    read_recipe,
    recipe_text,
)
from pumaid.maths import Floats, by_key
from pumaid.robot import Robot, placement, roll_pitch_yaw

TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
#: Endings of files that are no recipes but describe a robot.
DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf")
#: Most bytes of a URDF, and most joints of a recipe.
MAX_BYTES, MAX_JOINTS = 20_000_000, 50
#: A joint farther than this (m) from the one before, or angles beyond this (rad), are in another unit.
FARTHEST, WIDEST_ANGLE = 20.0, 4.0 * math.pi
FREE_FALL = 9.80665
#: rad and rad/s: limits and speeds of a turning joint beyond these are in degrees; no arm's turn 2000 deg/s.
WIDEST = (WIDEST_UNSTATED, 36.0)
_XACRO = "; the name of a xacro file must end in .xacro"


class UrdfJoint:
    """A joint as the file states it, of `kind`, between the links `parent` and `child`; `moves` where it is not fixed.

    `follows` is the joint that it mimics, or empty. Its numbers are checked when they are read, since not every joint
    is the arm's.
    """

    def __init__(self, element: ElementTree.Element, file: str) -> None:
        self.element, self.file = element, file
        self.name, self.kind = (element.get(word, "").strip() for word in ("name", "type"))
        self.parent, self.child = (_attribute(element, tag, "link") for tag in ("parent", "child"))
        self.follows, self.moves = _attribute(element, "mimic", "joint"), self.kind != "fixed"

    def frame(self) -> Floats:
        """(4, 4) the joint's frame at zero in that of the link before, m; [urdf-refused] in another unit."""
        xyz, rpy = self.numbers("origin", "xyz", "0 0 0"), self.numbers("origin", "rpy", "0 0 0")
        if math.hypot(*xyz) > FARTHEST or max(map(abs, rpy)) > WIDEST_ANGLE:
            raise self.refusal(
                f"an origin {math.hypot(*xyz):g} m away, turned by up to {max(map(abs, rpy)):g} rad",
                "lengths of a URDF are in m, angles in rad",
            )
        return placement(xyz, rpy)

    def numbers(self, tag: str, word: str, default: str, *, count: int = 3) -> list[float]:
        """Finite numbers of an attribute (a limit may be infinite); RecipeError [urdf-refused] where they are none."""
        text = _attribute(self.element, tag, word, default)
        try:
            values = [float(part) for part in text.split() if "_" not in text]  # Python alone reads 1_000
        except ValueError:
            values = []
        is_good = all(map(math.isfinite, values)) or (tag == "limit" and not math.isnan(values[0]))
        if len(values) != count or not is_good:
            raise self.refusal(
                f'{word}="{text[:60]}" of <{tag}> is not {count} finite number{"s" * (count > 1)}',
                f"write them with a point, in m and rad{_XACRO}",
            )
        return values

    def refusal(self, what: str, mend: str) -> RecipeError:
        """The error of a joint that cannot be used."""
        return RecipeError("urdf-refused", what[:200], Where(self.file, field=f"joint {self.name[:60]}"), mend)


def read_robot(path: Path, tell: Callable[[str], None]) -> Robot:
    """A robot from its recipe, or from a URDF, xacro or MJCF file of one arm, of which `tell` hears what it lacks.

    Raises as `read_recipe` and `UrdfRecipe` do.
    """
    if path.suffix not in DESCRIPTIONS:
        return read_recipe(path)
    made = UrdfRecipe(path)
    for note in made.notes:
        tell(str(note))
    # The text that the joints stand in is another in another version, what it says of the arm is not.
    return replace(made.robot, digest=made.robot.geometry)


class UrdfFile:
    """A robot's `name`, its `links`, carriers first, and joints, which are trees; `digest` is the file's SHA-256.

    `gravity` (m/s2) is in the root's axes, zero where the file says so. `arguments` are those of a xacro file, by name.

    By link, `carrier` is the joint that carries it, in the file's order, `carried` are those that it carries, and
    `reach` is how many moving joints there are at most in one line outward of it.

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused]
        The file at `path` cannot be read, or describes no robot.
    """

    def __init__(self, path: Path, arguments: Mapping[str, str] | None = None) -> None:
        content, self.file = read_bytes(path, kind=RecipeError, most=MAX_BYTES), file_name(path)
        robot = _parsed(content, path, arguments or {})
        self.gravity = np.array(robot.get(GRAVITY, f"0 0 {-FREE_FALL}").split(), dtype=float)
        self.name, self.digest = robot.get("name", ""), hashlib.sha256(content).hexdigest()
        names = {tag: [element.get("name", "").strip() for element in robot.findall(tag)] for tag in ("link", "joint")}
        for tag in names:
            repeated = [name for name, count in Counter(names[tag]).items() if count > 1 or not name]
            if repeated or not names["link"]:
                raise RecipeError(
                    "urdf-refused",
                    f"a {tag} has no name, or that of another one: {listed(repeated, 1)}"[:200]
                    if repeated
                    else "the file has no links",
                    Where(self.file),
                    f"give each {tag} its own name" if repeated else "is it a part, such as macros, of another file?",
                )
        joints = [UrdfJoint(element, self.file) for element in robot.findall("joint")]
        self.carrier = {joint.child: joint for joint in joints}
        self.carried: dict[str, list[UrdfJoint]] = {link: [] for link in names["link"]}
        self.carried |= by_key(joints, lambda joint: joint.parent)
        self.shapes = {
            link.get("name", "").strip(): link.findall("collision") or link.findall("visual")
            for link in robot.findall("link")
        }
        self.links = [link for link in names["link"] if link not in self.carrier]
        for link in self.links:
            self.links += [joint.child for joint in self.carried.get(link, []) if self.carrier[joint.child] is joint]
        stated = set(names["link"])
        for joint in joints:  # none of no type, at no link, or that closes a loop
            lost = "".join([link for link in (joint.parent, joint.child) if link not in stated][:1])
            for is_wrong, what, mend in (
                (joint.kind not in TYPES, f"has type '{joint.kind[:40]}'", meant(joint.kind, TYPES)),
                (
                    not stated >= {joint.parent, joint.child},
                    f"is at link '{lost[:40]}', which is not there",
                    meant(lost, names["link"]),
                ),
                (
                    self.carrier[joint.child] is not joint or joint.child not in self.links,
                    f"closes a loop at link {joint.child}",
                    "the links of a URDF are a tree: take it away",
                ),
            ):
                if is_wrong:
                    raise joint.refusal(f"joint {joint.name} {what}", mend)
        self.reach: dict[str, int] = {}
        for link in reversed(self.links):
            self.reach[link] = max((self.reach[j.child] + j.moves for j in self.carried[link]), default=0)

    def branches(self, link: str) -> list[UrdfJoint]:
        """Moving joints that go out from a link and all that is fixed to it."""
        rigid, moving = [link], []
        for part in rigid:
            moving += [joint for joint in self.carried[part] if joint.moves]
            rigid += [joint.child for joint in self.carried[part] if not joint.moves]
        return moving

    def rigid(self, link: str) -> list[tuple[str, Floats]]:
        """A link and all that is fixed to it, with their frames (4, 4) in its own."""
        out = [(link, np.eye(4))]
        for part, frame in out:
            out += [(joint.child, frame @ joint.frame()) for joint in self.carried[part] if not joint.moves]
        return out

    def path(self, base: str | None, tip: str) -> list[UrdfJoint]:
        """Joints outward from link `base` (the root where not given) to `tip`; [urdf-which-chain] where none lead."""
        path: list[UrdfJoint] = []
        link = tip
        while link != base and link in self.carrier:
            path.insert(0, self.carrier[link])
            link = path[0].parent
        if link != base is not None:
            raise self.unclear(
                f"no joints lead outward from {base} to {tip}",
                f"--base must lie on the way to it: {' > '.join(joint.parent for joint in path)}",
            )
        return path

    def unclear(self, what: str, mend: str) -> RecipeError:
        """The error of a robot of which it is not clear which joints are the arm; `mend` by options of pumaid init."""
        return RecipeError("urdf-which-chain", what, Where(file=self.file), f"with pumaid init, {mend}")


class UrdfRecipe:
    """A recipe made from the joints between two links of a URDF (``-`` is standard input).

    `text` is the recipe, and `robot` what is read back from it. Frame 0 is link `base`; `path` are the joints from
    there to link `tip`, fixed ones among them; `left_out` are the other moving joints. `notes` tell what the URDF
    lacks, and what was left out.

    Where `base` is not given the arm starts at the root. Where `tip` is not, it ends where it splits into a gripper or
    hand, whose branches are shorter than the line so far, and before joints that mimic others.

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused]
        It cannot be read, is no URDF, its links and joints are no trees, or a joint of the arm has impossible numbers.
    RecipeError [urdf-which-chain]
        A link is not there, there are several chains, or none can be stated by a recipe.
    """

    def __init__(
        self, path: Path, *, base: str | None = None, tip: str | None = None, arguments: Mapping[str, str] | None = None
    ) -> None:
        self.urdf = urdf = UrdfFile(path, arguments)
        self.base, self.tip = _ends(urdf, base, tip)
        before, self.path = urdf.path(None, self.base), urdf.path(self.base, self.tip)
        _refuse_unusable(urdf, self.base, self.path)
        gravity = urdf.gravity if urdf.gravity.any() else np.array([0.0, 0.0, -FREE_FALL])
        for joint in before:
            gravity = gravity @ joint.frame()[:3, :3]
        self.left_out = [joint for joint in urdf.carrier.values() if joint.moves and joint not in before + self.path]
        lines, self.notes = _joint_lines(self.path)
        file, *ends = [
            "".join(c if c.isprintable() else "?" for c in text) for text in (path.name, self.base, self.tip)
        ]
        given = [word for pair in (arguments or {}).items() for word in ("--arg", *pair) if word.isprintable()]
        moving = [joint for joint in self.path if joint.moves]
        solids = [
            [(shape, frame) for part, frame in urdf.rigid(link) for shape in urdf.shapes[part]]
            for link in (self.base, *(joint.child for joint in moving))
        ]
        length, place, heights = 0.0, np.eye(4), list[float]()
        for joint in self.path:
            length, place = length + float(np.linalg.norm(joint.frame()[:3, 3])), place @ joint.frame()
            heights += [-float(gravity @ place[:3, 3])] * joint.moves
        self.text = recipe_text(
            shlex.join(["pumaid", "init", "--urdf", file, "--base", ends[0], "--tip", ends[1], *given]),
            name=yaml_text(urdf.name[:200] if urdf.name.strip() and urdf.name.isprintable() else "arm"),
            base=ends[0],
            source=yaml_text(f"{file}, links {ends[0]} to {ends[1]}; SHA-256 {urdf.digest}"),
            gravity=yaml_vector(gravity),
            joints=lines,
            safety=safety_lines(solids, path.resolve().parent, length),
            floor="0.0" if max(heights[1:2], default=0.0) > 0.0 else "null",  # the second joint stands above the base
        )
        text = f"the file states no gravity (0 0 0); {FREE_FALL} m/s2 along -z is taken: write the arm's own"
        self.notes += [Note("urdf-incomplete", text)] * (not urdf.gravity.any())
        for joints, about in (
            (self.left_out, "left out: {}; hold still those that the arm carries, they weigh on it"),
            ([joint for joint in before if joint.moves], "gravity is given for {} before the base at 0"),
        ):
            names = f"{len(joints)} moving joint{'s' * (len(joints) > 1)} ({listed([joint.name for joint in joints])})"
            self.notes += [Note("urdf-left-out", about.format(names))] if joints else []
        self.robot = parsed_recipe(self.text.encode(), file_name(path))


def _parsed(content: bytes, path: Path, arguments: Mapping[str, str] | None) -> ElementTree.Element:
    """The element <robot> of a file, tags without namespaces; `arguments` None where a xacro file is expanded."""
    file = file_name(path)
    try:
        robot = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # also an encoding that Python lacks
        line, mend = getattr(error, "position", (None,))[0], "every tag must be closed and quoted, the text UTF-8"
        what = f"this is not XML that can be read: {error}"
        raise RecipeError("urdf-refused", what[:200], Where(file=file, line=line), mend + _XACRO) from error
    is_xacro = path.suffix == ".xacro" or any("xacro}" in element.tag for element in robot.iter())
    if is_xacro and arguments is not None:
        return _parsed(_expanded(path, file, arguments), path, None)
    for element in robot.iter():
        element.tag = element.tag.rpartition("}")[2]
    if robot.tag == "mujoco":
        return urdf_of_mjcf(path, content, file)
    if robot.tag != "robot":
        raise RecipeError(
            "urdf-refused",
            f"the file holds <{robot.tag[:40]}>, not <robot> or <mujoco>",
            Where(file=file),
            "give the arm's URDF, xacro or MJCF file",
        )
    return robot


def _expanded(path: Path, file: str, arguments: Mapping[str, str]) -> bytes:
    """The URDF of a xacro file, by xacrodoc; ROS packages are looked for above the file, too, and beside those."""
    try:
        from xacrodoc import XacroDoc, packages

        above = [folder for folder in path.resolve().parents if (folder / "package.xml").is_file()]
        stated = [file for package in above for place in package.parents[:2] for file in place.glob("*/package.xml")]
        packages.update_package_cache({file.parent.name: file.parent for file in stated})
        document = XacroDoc.from_file(path, subargs=dict(arguments), resolve_packages=False)
        return str(document.to_urdf_string()).encode()
    except Exception as error:  # whatever the file's expressions raise
        raise RecipeError(
            "urdf-refused",
            f"xacro cannot expand it: {str(error).strip().partition(chr(10))[0].rpartition('>: ')[2]}"[:300],
            Where(file=file),
            "pip install 'pumaid[xacro]', or where ROS is: xacro FILE > arm.urdf"
            if isinstance(error, ImportError)
            else "give its arguments by --arg NAME VALUE; a package that it needs must lie, with its package.xml, above"
            " or beside the file's, or where ROS_PACKAGE_PATH or a sourced ROS says",
        ) from error


def _attribute(element: ElementTree.Element, tag: str, word: str, default: str = "") -> str:
    child = element.find(tag)
    return default if child is None else child.get(word, default).strip()


def _ends(urdf: UrdfFile, base: str | None, tip: str | None) -> tuple[str, str]:
    for word, link in (("--base", base), ("--tip", tip)):
        if link is not None and link not in urdf.links:
            raise urdf.unclear(f"{word} {link}: there is no such link", meant(link, urdf.links))
    roots = [link for link in urdf.links if link not in urdf.carrier]
    if tip is not None:
        return base or next((joint.parent for joint in urdf.path(None, tip)), tip), tip
    if base is None and len(roots) > 1:
        raise urdf.unclear(
            f"{len(roots)} links hang on no joint: {listed(roots)}", "say where the arm starts, with --base LINK"
        )
    base = tip = base or roots[0]
    count = 0
    while len(branches := urdf.branches(tip)) == 1 and not (count and branches[0].follows):
        tip, count = branches[0].child, count + 1
    if not any(urdf.reach[joint.child] + 1 >= count for joint in branches if not joint.follows):
        return base, tip
    ends = [
        joint.child for joint in urdf.carrier.values() if joint.moves and not (joint.follows or urdf.reach[joint.child])
    ]
    raise urdf.unclear(f"the joints split at {tip}", f"say where the arm ends: --tip LINK, of {listed(ends)}")


def _refuse_unusable(urdf: UrdfFile, base: str, path: Sequence[UrdfJoint]) -> None:
    for joint in path:
        if joint.kind in TYPES[4:] or joint.follows:
            kind = f"follows joint {joint.follows} (mimic)" if joint.follows else f"is {joint.kind}"
            raise urdf.unclear(
                f"joint {joint.name} {kind}; a recipe's joints turn or slide by themselves",
                f"end before it: --tip {shlex.quote(joint.parent)}, or start behind: --base {shlex.quote(joint.child)}",
            )
    count = sum(joint.moves for joint in path)
    if not 0 < count <= MAX_JOINTS:
        raise urdf.unclear(
            f"{count or 'no'} joints move between {base} and the tip; a recipe holds 1 to {MAX_JOINTS}",
            "name links that moving joints connect, with --base and --tip",
        )


def _joint_lines(path: Sequence[UrdfJoint]) -> tuple[list[str], list[Note]]:
    """The joints' lines of the recipe, and notes on names, limits and speeds that are missing or unusable."""
    lines, names, frame = [], list[str](), np.eye(4)
    lacking = defaultdict[str, list[str]](list)
    for joint in path:
        frame = frame @ joint.frame()
        if not joint.moves:
            continue
        is_rail = joint.kind == "prismatic"
        is_name = is_joint_name(joint.name) and joint.name.lower() not in names
        name = joint.name if is_name else f"axis{len(names) + 1}"
        names.append(name.lower())
        axis = joint.numbers("axis", "xyz", "1 0 0")
        if not 1e-9 < math.hypot(*axis) < math.inf:
            raise joint.refusal(f"the axis {axis} has no direction", 'write it as xyz="0 0 1"')
        rpy, unit = yaml_vector(roll_pitch_yaw(frame[:3, :3])), yaml_vector(np.array(axis) / math.hypot(*axis))
        line = (
            f"name: {yaml_text(name)}, type: {'prismatic' if is_rail else 'revolute'}, "
            f"placement: {{xyz: {yaml_vector(frame[:3, 3])}, rpy: {rpy}, axis: {unit}}}"
        )
        low, high, speed = (joint.numbers("limit", key, "inf", count=1)[0] for key in ("lower", "upper", "velocity"))
        farthest, fastest = (SIZES[key, True][1] for key in ("limits", "max_velocity")) if is_rail else WIDEST
        has_limits, has_speed = (
            -farthest <= low < high <= farthest,
            SIZES["max_velocity", is_rail][0] <= speed <= fastest,
        )
        line += f", limits: {yaml_vector((low, high))}" if has_limits and joint.kind != "continuous" else ""
        line += f", max_velocity: {yaml_number(speed)}" if has_speed else ""
        lines.append(f"{{{line}}}")
        unit, gear = "mm" if is_rail else "degrees", joint.element.get("gear", "1")
        if not has_limits and joint.kind != "continuous":
            lacking["limits"].append(name + _as_stated((low, high), farthest, unit))
        lacking["speed"] += [] if has_speed else [name + _as_stated((speed,), fastest, f"{unit}/s")]
        lacking["gear_ratio"] += [] if gear == "1" else [f"{name} (its actuator's gear is {gear})"]
        lacking["name"] += [] if is_name else [f"{name} ({joint.name!r})"]
        lacking["effort (without use here)"] += [name] * (
            not _attribute(joint.element, "limit", "effort", "1").strip("0.")
        )
        frame = np.eye(4)
    text = "; ".join(f"{what} of {listed(several)}" for what, several in lacking.items() if several)
    text = f"the file lacks, or has impossible, {text}. Put the arm's own into the recipe, or plans take usual ones"
    return lines, [Note("urdf-incomplete", text)] * any(lacking.values())


def _as_stated(values: Sequence[float], most: float, unit: str) -> str:
    """What a file states that cannot be, in brackets, and the unit that it may be in; nothing where it states none."""
    doubt = f", in {unit}?" * (max(map(abs, values)) > most)
    return f" ({' to '.join(f'{value:g}' for value in values)}{doubt})" if all(map(math.isfinite, values)) else ""
