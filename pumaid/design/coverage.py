"""What every joint gets whatever it tells, since diagnosis needs it: postures, speeds, whole ranges, replicates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.design.candidate_runs import JointCandidates, Sweep
from pumaid.design.exchange import Criterion, rounded
from pumaid.design.information import CandidateInformation

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Different speeds of a joint at least: three tell a straight line from a bend, the fourth which bend.
SPEEDS = 4
#: Postures of a joint where time is not short: what depends on load or place shows between them.
POSTURES = 4


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much every joint gets at least.

    Attributes
    ----------
    postures, whole
        Postures; in how many of them it runs over the whole range at top speed. These come in every pass, the others in
        every other one.
    part
        s of a run over part of the range.
    judged
        Sweeps a joint that are kept for judging.
    middle
        Whether the first posture gets a middle speed beside the slow one.
    passes
        How often the arm is gone through.
    """

    postures: int
    whole: int
    part: float
    judged: int
    middle: bool = True
    passes: int = 2

    @property
    def times(self) -> tuple[int, ...]:
        """How often each of the two alternating kinds of pass is made."""
        return (1,) if self.passes == 1 else ((self.passes + 1) // 2, self.passes // 2)


#: Coverages, the most first, and the share of the time that each may take.
COVERAGES = (
    (Coverage(4, 4, 2.0, 2), 0.4),
    (Coverage(4, 2, 0.8, 2), 0.45),
    (Coverage(4, 1, 0.8, 1), 0.6),
    (Coverage(4, 1, 0.8, 1, middle=False), 0.9),
    (Coverage(3, 1, 0.8, 1, middle=False), 0.9),
    (Coverage(2, 1, 0.8, 1, middle=False), 0.9),
)


def cover(
    candidates: CandidateInformation,
    criterion: Criterion,
    coverage: Coverage,
    *,
    background: Floats,
    opening: Floats,
    all_speeds: bool,
) -> Counts:
    """The candidates of a coverage, in the postures that tell most.

    Over the postures of a joint come at least four speeds, the slowest and one in the middle among them.

    Parameters
    ----------
    candidates, criterion
        What there is to choose from, and what for.
    coverage
        How much.
    background
        (G, p, p) information on top of which postures are compared.
    opening
        (L,) by how much the criterion could fall in the time that it takes to go to each candidate's posture.
    all_speeds
        Whether every speed of the candidates must come.

    Returns
    -------
    counts
        (K L,) for each kind of pass.
    """
    counts = np.zeros((len(coverage.times), len(candidates)), dtype=np.int64)
    for joint in candidates.joints:
        taken: set[int] = set()
        for place, ways in enumerate(_sweeps(joint, coverage, all_speeds=all_speeds)):
            options = [k for k in range(len(joint.holds)) if k not in taken and joint.usable[k, ways].any()]
            options = [k for k in options if joint.usable[k, ways].all()] or options
            if not options:
                break
            made = [[c for w in ways if (c := candidates.find(joint.joint, k, w)) is not None] for k in options]
            gathered = np.array([candidates.each(sets).sum(axis=0) for sets in made])
            values = criterion.value(background + sum(coverage.times) * gathered)
            values = values + opening[[sets[0] for sets in made]]
            best = int(np.argmin(rounded(values)))
            taken.add(options[best])
            kinds = len(coverage.times) if place < coverage.whole else 1
            counts[:kinds, made[best]] += 1
            background = background + sum(coverage.times[:kinds]) * gathered[best]
    return counts.ravel()


def _sweeps(joint: JointCandidates, coverage: Coverage, *, all_speeds: bool) -> list[list[int]]:
    """The sweeps (numbers) of each posture of a joint."""
    at = sorted({sweep.speed for sweep in joint.sweeps})
    slower = _spread(at[:-1])
    count = max(1, math.ceil(((len(at) if all_speeds else SPEEDS) - 1) / coverage.postures))
    out = []
    for place in range(coverage.postures):
        # The first posture gets one speed more, so that slow and middle come in every pass.
        more = int(coverage.middle)
        turns = range(place * count + min(place, more), (place + 1) * count + more)
        chosen = dict.fromkeys(slower[turn % len(slower)] for turn in turns) if slower else {}
        ways = [_part(joint.sweeps, speed, coverage.part, place=place) for speed in chosen]
        if place < coverage.whole or not ways:
            ways.append(_tour(joint.sweeps, place))
        out.append(ways)
    return out


def _spread(rising: Sequence[float]) -> list[float]:
    """Slowest first, then from the middle, so that a few of them lie far apart."""
    half = (len(rising) + 1) // 2
    pairs = zip(rising[:half], [*rising[half:], None], strict=False)
    return [speed for pair in pairs for speed in pair if speed is not None]


def _tour(ways: Sequence[Sweep], place: int) -> int:
    """The widest sweep at the highest speed, up first and down first in turns."""
    order = sorted(range(len(ways)), key=lambda c: (-ways[c].speed, ways[c].low - ways[c].high, c))
    first = ways[order[0]]
    alike = [c for c in order if (ways[c].speed, ways[c].low, ways[c].high) == (first.speed, first.low, first.high)]
    return alike[place % len(alike)]


def _part(ways: Sequence[Sweep], speed: float, seconds: float, *, place: int) -> int:
    """The sweep at this speed that lasts nearest to `seconds`; parts above and below home take turns."""
    off = {c: abs(math.log((way.high - way.low) / speed / seconds)) for c, way in enumerate(ways) if way.speed == speed}
    alike = [c for c, distance in off.items() if distance <= min(off.values()) + 1e-9]
    return alike[place % len(alike)]
