"""The least that an experiment must hold whatever it tells: postures, speeds, whole spans, for every joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.design.compose import Draft, settled
from pumaid.design.laps import Course
from pumaid.design.menu import Ways

Floats = NDArray[np.float64]

#: Different speeds of a joint at least: three tell a straight line from a bend, the fourth which bend.
SPEEDS = 4
#: Postures of a joint where time is not short: what depends on load or place shows between them.
POSTURES = 4


@dataclass(frozen=True, slots=True)
class Extent:
    """How much every joint gets at least.

    Attributes
    ----------
    postures, whole, again
        Postures; in how many of them it runs over the whole span at the highest speed; how many come in every pass, the
        others in every other one.
    part
        s of a run over part of the span.
    passes
        How often the arm is gone through.
    judged
        Courses a joint that are kept for judging.
    middle
        Whether the first posture has a speed in the middle, too: what bends between slow and fast shows there, in every
        pass.
    """

    postures: int
    whole: int
    again: int
    part: float
    passes: int
    judged: int
    middle: bool = True

    @property
    def times(self) -> tuple[int, ...]:
        """How often each kind of pass is made."""
        return (1,) if self.passes == 1 else ((self.passes + 1) // 2, self.passes // 2)


def cover(draft: Draft, extent: Extent, ground: Floats, *, haste: float, all_speeds: bool = False) -> None:
    """Put into a draft, for every joint, what it must have.

    In the first `whole` postures of a joint a lap over the whole span at the highest speed, in each slower ones: over
    its postures at least four speeds come, the slowest among them. Postures are those that tell most.

    Parameters
    ----------
    draft
        Gets laps that stay.
    extent
        How much.
    ground
        (G, p, p) information on top of which postures are compared.
    haste
        What a second of a pass is worth, by the criterion.
    all_speeds
        Whether every speed of the menu must come.
    """
    for way in draft.menu.ways:
        need = len({course.speed for course in way.courses}) if all_speeds else SPEEDS
        slower = _slower(way)
        each = max(1, math.ceil((need - 1) / extent.postures))
        taken: set[int] = set()
        for place in range(extent.postures):
            more = int(extent.middle)
            turns = range(place * each + min(place, more), (place + 1) * each + more)
            some = [slower[turn % len(slower)] for turn in turns] if slower else []
            courses = [_part(way, speed, extent.part, place=place) for speed in dict.fromkeys(some)]
            if place < extent.whole or not courses:
                courses.append(_tour(way, place))
            hold = _best_hold(draft, way, courses, taken=taken, ground=ground, haste=haste)
            if hold is None:
                break
            taken.add(hold)
            laps = [lap for course in courses if (lap := draft.menu.find(way.joint, hold, course)) is not None]
            kinds = range(len(draft.times) if place < extent.again else 1)
            for kind in kinds:
                draft.put(laps, kind)
            often = sum(draft.times[kind] for kind in kinds)
            ground = ground + often * draft.menu.each(laps).sum(axis=0)


def _best_hold(
    draft: Draft, way: Ways, courses: Sequence[int], *, taken: set[int], ground: Floats, haste: float
) -> int | None:
    """The posture, not taken yet, in which these courses tell most; those in which all can be driven come first."""
    menu = draft.menu
    options = [k for k in range(len(way.holds)) if k not in taken and any(way.usable[k, course] for course in courses)]
    if not options:
        return None
    whole = [k for k in options if all(way.usable[k, course] for course in courses)] or options
    laps = [[menu.find(way.joint, k, course) for course in courses] for k in whole]
    driven = [[lap for lap in one if lap is not None] for one in laps]
    more = np.array([menu.each(some).sum(axis=0) for some in driven])
    values = draft.criterion.value(ground + sum(draft.times) * more)
    values += haste * np.array([draft.opening[some[0]] for some in driven])
    return whole[int(np.argmin(settled(values)))]


def _tour(way: Ways, place: int) -> int:
    """The widest course at the highest speed, up first and down first in turns."""
    order = sorted(range(len(way.courses)), key=lambda c: (-way.courses[c].speed, -_width(way.courses[c]), c))
    first = way.courses[order[0]]
    alike = [c for c in order if way.courses[c].speed == first.speed and _width(way.courses[c]) == _width(first)]
    return alike[place % len(alike)]


def _slower(way: Ways) -> list[float]:
    """Speeds below the highest, slowest first, then from the middle, so that a few of them lie far apart."""
    rising = sorted({course.speed for course in way.courses})[:-1]
    half = (len(rising) + 1) // 2
    return [speed for pair in zip(rising[:half], [*rising[half:], None], strict=False) for speed in pair if speed]


def _part(way: Ways, speed: float, part: float, *, place: int) -> int:
    """The course at this speed that lasts nearest to `part` s; parts above and below where it is held take turns."""
    own = [c for c, course in enumerate(way.courses) if course.speed == speed]
    lasting = {c: _width(way.courses[c]) / speed for c in own}
    near = min(abs(math.log(lasting[c] / part)) for c in own)
    alike = [c for c in own if abs(math.log(lasting[c] / part)) <= near + 1e-9]
    return alike[place % len(alike)]


def _width(course: Course) -> float:
    return course.high - course.low
