"""Runs of a plan grouped by the posture in which the other joints are held."""

from __future__ import annotations

import string
from collections import Counter
from dataclasses import dataclass

from pumaid.trajectory import Motion, Plan

#: Positions (rad, m) that are told apart.
_DIGITS = 6


@dataclass(frozen=True, slots=True)
class Held:
    """One posture of the others of one joint.

    Attributes
    ----------
    joint, label
        The moving joint from 1, and a letter: 3A is joint 3's first posture in the plan.
    motions
        Its runs, in order.
    serves
        Parameters that it makes visible.
    """

    joint: int
    label: str
    motions: tuple[Motion, ...]
    serves: tuple[str, ...]

    @property
    def name(self) -> str:
        """``3A``."""
        return f"{self.joint}{self.label}"

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest position of the moving joint, rad or m."""
        ends = [end for motion in self.motions for end in (motion.start, motion.end)]
        return min(ends), max(ends)

    @property
    def fitted(self) -> int:
        """Runs for fitting; the others are for judging."""
        return sum(motion.purpose == "fit" for motion in self.motions)

    @property
    def replicates(self) -> int:
        """How often the run that is made most often is made."""
        return max(Counter(self.motions).values())


def held(plan: Plan) -> list[Held]:
    """The postures of a plan, joint by joint, in the order in which the plan first takes them."""
    groups: dict[tuple[int, tuple[float, ...]], list[Motion]] = {}
    for motion in plan.motions:
        groups.setdefault(key(motion), []).append(motion)
    serves = {key(Motion(one.joint, one.hold, 0.0, 0.0, 1.0)): one.serves for one in plan.postures}
    counts: Counter[int] = Counter()
    found = []
    for (joint, others), motions in groups.items():
        found.append(Held(joint, letter(counts[joint]), tuple(motions), serves.get((joint, others), ())))
        counts[joint] += 1
    return sorted(found, key=lambda one: one.joint)


def key(motion: Motion) -> tuple[int, tuple[float, ...]]:
    """The moving joint and the positions of the others, by which runs belong to one posture."""
    return motion.joint, tuple(
        round(value, _DIGITS) + 0.0 for number, value in enumerate(motion.hold, start=1) if number != motion.joint
    )


def letter(index: int) -> str:
    """A, B, ... Z, AA, AB, ... as columns of a sheet are named, from 0."""
    letters = string.ascii_uppercase
    return letters[index] if index < 26 else letter(index // 26 - 1) + letters[index % 26]
