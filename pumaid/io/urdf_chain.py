"""Which of a URDF's joints make the arm: a serial chain from a base link to a tip."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from shlex import quote

from pumaid.errors import RecipeError, Where
from pumaid.io.urdf import FREE, Urdf, UrdfJoint
from pumaid.io.yaml_file import nearest

#: Chains that a message names, at most.
SHOWN = 8
#: Most joints that a recipe can hold.
MOST_JOINTS = 50


@dataclass(frozen=True, slots=True)
class ArmChain:
    """The joints from `base` to `tip`, fixed ones among them, and what was not taken.

    Attributes
    ----------
    before
        Joints from the URDF's root to `base`, outward.
    path
        Joints from `base` to `tip`, outward.
    end
        What was cut off because it is a gripper or hand: its moving joints.
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


class _Tree:
    """A URDF's joints by the link from which they go out, and how far each leads."""

    def __init__(self, urdf: Urdf) -> None:
        self.urdf = urdf
        self.out: dict[str, list[UrdfJoint]] = defaultdict(list)
        for joint in urdf.joints:
            self.out[joint.parent].append(joint)
        self.carrier = {joint.child: joint for joint in urdf.joints}
        #: Link -> the most moving joints in one line outward of it.
        self.reach: dict[str, int] = {}
        for link in reversed(self.below(*urdf.roots)):
            ahead = [self.reach[joint.child] + joint.moves for joint in self.out[link]]
            self.reach[link] = max(ahead, default=0)

    def below(self, *links: str) -> list[str]:
        """These links and all that they carry, carriers first."""
        found = list(links)
        for link in found:
            found += [joint.child for joint in self.out[link]]
        return found

    def moving_below(self, *links: str) -> list[UrdfJoint]:
        return [joint for link in self.below(*links) for joint in self.out[link] if joint.moves]

    def to(self, link: str) -> list[UrdfJoint]:
        """Joints from the root to a link."""
        path = []
        while link in self.carrier:
            path.append(self.carrier[link])
            link = path[-1].parent
        return path[::-1]

    def next(self, link: str) -> list[UrdfJoint]:
        """Moving joints that go out from a link and all that is fixed to it, the farthest-leading first."""
        found, rigid = [], [link]
        for part in rigid:
            found += [joint for joint in self.out[part] if joint.moves]
            rigid += [joint.child for joint in self.out[part] if not joint.moves]
        return sorted(found, key=lambda joint: -self.reach[joint.child])


def arm_chain(urdf: Urdf, *, base: str | None = None, tip: str | None = None) -> ArmChain:
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
    RecipeError [urdf-no-link, urdf-which-chain, urdf-no-chain]
        A link is not there; several chains are as long as one another; there is none that a recipe can state.
    """
    tree = _Tree(urdf)
    for word, link in (("--base", base), ("--tip", tip)):
        if link is not None and link not in urdf.links:
            near = nearest(link, urdf.links) if len(urdf.links) < 10_000 else None
            more = " ..." if len(urdf.links) > SHOWN else ""
            mend = f"did you mean {near}?" if near else f"links are {', '.join(urdf.links[:SHOWN])}{more}"
            raise _refusal(urdf, "urdf-no-link", f"{word} {link}: there is no such link", mend)
    if base is None:
        base = _root(tree, tip)
    end = _farthest(tree, base) if tip is None else tip
    whole = tree.to(end)
    before = tree.to(base)
    if whole[: len(before)] != before:
        mend = f"--base must lie on the way to it: {' > '.join(joint.parent for joint in whole)}"
        raise _refusal(urdf, "urdf-no-chain", f"no joints lead outward from {base} to {end}", mend)
    path = whole[len(before) :]
    _refuse_unusable(tree, base, path)
    return _sorted(tree, (base, end), before, path)


def _refusal(urdf: Urdf, slug: str, what: str, mend: str) -> RecipeError:
    return RecipeError(slug, what, Where(file=urdf.file), mend)


def _root(tree: _Tree, tip: str | None) -> str:
    if tip is not None:
        path = tree.to(tip)
        return path[0].parent if path else tip
    roots = tree.urdf.roots
    if len(roots) > 1:
        what = f"{len(roots)} links hang on no joint: {', '.join(roots[:SHOWN])}"
        raise _refusal(tree.urdf, "urdf-which-chain", what, "say where the arm starts, with --base LINK")
    return roots[0]


def _farthest(tree: _Tree, base: str) -> str:
    """The tip of the one longest chain from `base`."""
    tip, is_clear, _ = _walk(tree, base)
    if is_clear:
        return tip
    limbs = _limbs(tree, base)
    told = "; ".join(
        f"--base {quote(start)} --tip {quote(end)} ({count} joint{'s' * (count > 1)})"
        for start, end, count in limbs[:SHOWN]
    )
    more = f"; {len(limbs) - SHOWN} more" if len(limbs) > SHOWN else ""
    what = f"below {base} several chains of joints are as long as one another"
    raise _refusal(tree.urdf, "urdf-which-chain", what, f"say which one: {told}{more}")


def _walk(tree: _Tree, start: str) -> tuple[str, bool, int]:
    """Where the longest chain ends, or splits; whether it is clear which that is; how many joints it has."""
    link, taken = start, 0
    while ahead := tree.next(link):
        lengths = [1 + tree.reach[joint.child] for joint in ahead]
        if len(ahead) > 1:
            is_tie = lengths[0] == lengths[1]
            if lengths[0] < taken and (is_tie or len(ahead) > 2):
                return link, True, taken
            if is_tie:
                return link, False, taken
        if taken and ahead[0].follows is not None:
            return link, True, taken
        link, taken = ahead[0].child, taken + 1
    return link, True, taken


def _limbs(tree: _Tree, base: str) -> list[tuple[str, str, int]]:
    """Chains between the splits: base, tip, joints; the longest first."""
    found, starts = [], [base]
    for start in starts:
        for joint in tree.next(start):
            end, is_clear, count = _walk(tree, joint.child)
            found.append((start, end, count + 1))
            if not is_clear:
                starts.append(end)
    return sorted(found, key=lambda limb: -limb[2])


def _refuse_unusable(tree: _Tree, base: str, path: list[UrdfJoint]) -> None:
    urdf = tree.urdf
    for joint in path:
        if joint.kind in FREE:
            mend = f"start behind it: --base {quote(joint.child)}"
            what = f"joint {joint.name} is {joint.kind}; a recipe's joints turn or slide"
            raise _refusal(urdf, "urdf-no-chain", what, mend)
        if joint.follows is not None:
            mend = f"end before it: --tip {quote(joint.parent)}"
            what = f"joint {joint.name} follows joint {joint.follows} (mimic); a recipe's joints move by themselves"
            raise _refusal(urdf, "urdf-no-chain", what, mend)
    count = sum(joint.moves for joint in path)
    if count == 0:
        mend = "name links that moving joints connect, with --base and --tip"
        raise _refusal(urdf, "urdf-no-chain", f"no joint moves outward of {base}", mend)
    if count > MOST_JOINTS:
        mend = "take a part of it, with --base and --tip"
        raise _refusal(urdf, "urdf-no-chain", f"{count} joints in a line; a recipe holds {MOST_JOINTS}", mend)


def _sorted(tree: _Tree, ends: tuple[str, str], before: list[UrdfJoint], path: list[UrdfJoint]) -> ArmChain:
    """The chain, with every other moving joint where it belongs."""
    first = next(joint for joint in path if joint.moves)
    taken = {joint.name for joint in path}
    carried = [joint for joint in tree.moving_below(first.child) if joint.name not in taken]
    last = [joint for joint in path if joint.moves][-1]
    beyond = {joint.name for joint in tree.moving_below(last.child)}
    known = taken | {joint.name for joint in carried}
    elsewhere = tuple(joint for joint in tree.urdf.joints if joint.moves and joint.name not in known)
    return ArmChain(
        *ends,
        before=tuple(before),
        path=tuple(path),
        end=tuple(joint for joint in carried if joint.name in beyond),
        beside=tuple(joint for joint in carried if joint.name not in beyond),
        elsewhere=elsewhere,
    )
