"""The laps from which a plan is made, what each tells of every parameter, and how long it takes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pumaid.design.laps import Course, seconds
from pumaid.robot import Robot
from pumaid.simulation.forecast import gravity_names, run_moments, run_slopes
from pumaid.simulation.truth import Truth
from pumaid.trajectory import cruise

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Runs of a lap at most.
RUNS = 3


@dataclass(frozen=True, eq=False, slots=True)
class Ways:
    """What one joint may do: K postures (K, J), C courses, and which of them can be driven where (K, C)."""

    joint: int
    holds: Floats
    courses: tuple[Course, ...]
    usable: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Menu:
    """L laps, joint by joint.

    Attributes
    ----------
    ways
        Of every joint.
    joint, hold, course
        (L,) which joint (from 1, rising), and which of its postures and courses.
    seconds
        (L,) s, rests included.
    factors
        Joint by joint (G, L_j, 3 R, p_j): square root of a lap's information for each of G robots, R runs at most.
    columns
        Joint by joint (p_j,): which of `names` its laps tell of.
    names
        p: gravity parameters and ratios, then friction.
    """

    ways: tuple[Ways, ...]
    joint: Counts
    hold: Counts
    course: Counts
    seconds: Floats
    factors: tuple[Floats, ...]
    columns: tuple[Counts, ...]
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.joint)

    @cached_property
    def squares(self) -> tuple[Floats, ...]:
        """Joint by joint (G, L_j, p_j p_j): the information of each lap, which is asked for again and again."""
        found = (np.swapaxes(factors, -1, -2) @ factors for factors in self.factors)
        return tuple(each.reshape(*each.shape[:2], each.shape[2] ** 2) for each in found)

    def information(self, weights: Floats) -> Floats:
        """(G, p, p) of all laps, each counted `weights` (L,) times."""
        out = np.zeros((len(self.factors[0]), len(self.names), len(self.names)))
        for own, squares, columns in zip(self._own(weights), self.squares, self.columns, strict=True):
            used = np.flatnonzero(own)
            some = squares if len(used) == len(own) else squares[:, used]
            out[:, columns[:, None], columns] += (own[used] @ some).reshape(-1, len(columns), len(columns))
        return out

    def worth(self, pull: Floats) -> Floats:
        """(L,) of each lap by the pull (G, p, p) of its information."""
        out = []
        for squares, columns in zip(self.squares, self.columns, strict=True):
            drawn = pull[:, columns[:, None], columns].reshape(len(pull), -1, 1)
            out.append((squares @ drawn).sum(axis=0)[:, 0])
        return np.concatenate(out)

    def each(self, laps: Sequence[int]) -> Floats:
        """(N, G, p, p) information of N laps, one by one."""
        starts = np.searchsorted(self.joint, np.arange(1, len(self.ways) + 1))
        out = np.zeros((len(laps), len(self.factors[0]), len(self.names), len(self.names)))
        for k, lap in enumerate(laps):
            j = int(self.joint[lap]) - 1
            one, columns = self.squares[j][:, lap - starts[j]], self.columns[j]
            out[k][:, columns[:, None], columns] = one.reshape(-1, len(columns), len(columns))
        return out

    def only(self, laps: Counts) -> Menu:
        """Some of the laps, rising."""
        keep = np.zeros(len(self))
        keep[laps] = 1.0
        return replace(
            self,
            joint=self.joint[laps],
            hold=self.hold[laps],
            course=self.course[laps],
            seconds=self.seconds[laps],
            factors=tuple(
                np.ascontiguousarray(factors[:, own > 0])
                for own, factors in zip(self._own(keep), self.factors, strict=True)
            ),
        )

    def _own(self, values: Floats) -> list[Floats]:
        """Values (L,) joint by joint."""
        starts = np.searchsorted(self.joint, np.arange(1, len(self.ways) + 2))
        return [values[a:b] for a, b in itertools.pairwise(starts)]

    def of(self, joint: int) -> Ways:
        """What joint `joint` (from 1) may do."""
        return self.ways[joint - 1]

    def find(self, joint: int, hold: int, course: int) -> int | None:
        """The lap of a joint (from 1) in one of its postures on one of its courses; None where it cannot be driven."""
        found = np.flatnonzero((self.joint == joint) & (self.hold == hold) & (self.course == course))
        return int(found[0]) if len(found) else None

    def course_of(self, lap: int) -> Course:
        """The course of a lap."""
        return self.of(int(self.joint[lap])).courses[self.course[lap]]

    def block_of(self, lap: int) -> tuple[int, int]:
        """Joint (from 1) and posture of a lap: what is run without moving the held joints."""
        return int(self.joint[lap]), int(self.hold[lap])


def parameters(robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
    """Names of a plan's forecast: gravity and ratios as given, then every joint's friction."""
    known = gravity_names(robot)
    terms = ("coulomb", "plus"), ("viscous", "plus"), ("coulomb", "minus"), ("viscous", "minus")
    friction = [f"{effect}.j{joint.number}.{sign}" for joint in robot.joints for effect, sign in terms]
    return (*(name for name in known if name in names), *friction)


def menu(truths: Sequence[Truth], ways: Sequence[Ways], *, names: Sequence[str], rate: float) -> Menu:
    """All laps that can be driven, and what they tell.

    Parameters
    ----------
    truths
        Assumed robots.
    ways
        Of every joint, in order.
    names
        Gravity parameters and ratios that the arm has.
    rate
        Samples a second.
    """
    robot = truths[0].robot
    columns = parameters(robot, names)
    index, times, factors, kept = [], [], [], []
    for way in ways:
        where = np.argwhere(way.usable)
        index.append(np.column_stack([np.full(len(where), way.joint), where]))
        each = np.array([seconds(robot, course) for course in way.courses])
        times.append(each[where[:, 1]])
        found, own = _factors(truths, way, columns=columns, rate=rate)
        factors.append(np.ascontiguousarray(found[:, where[:, 0], where[:, 1]]))
        kept.append(own)
    joint, hold, course = np.concatenate(index).T
    times_all = np.concatenate(times)
    return Menu(tuple(ways), joint, hold, course, times_all, tuple(factors), tuple(kept), columns)


def _factors(truths: Sequence[Truth], way: Ways, *, columns: Sequence[str], rate: float) -> tuple[Floats, Counts]:
    """(G, K, C, 3 R, p_j) root of the information of every lap of a joint, R runs at most; and (p_j,) its columns."""
    robot = truths[0].robot
    known = gravity_names(robot)
    keep = [known.index(name) for name in columns if name in known]
    gravity, first = len(keep), len(keep) + 4 * (way.joint - 1)
    own = np.concatenate([np.arange(gravity), np.arange(first, first + 4)])
    out = np.zeros((len(truths), len(way.holds), len(way.courses), RUNS, 3, len(own)))
    slopes = [run_slopes(robot, truth.constants, joint=way.joint, holds=way.holds)[:, :, keep] for truth in truths]
    for c, course in enumerate(way.courses):
        for run, motion in enumerate(course.motions(tuple(way.holds[0].tolist()))):
            ends, lasting = cruise(robot, motion)
            back = int(motion.end < motion.start)
            speed = -course.speed if back else course.speed
            for g, truth in enumerate(truths):
                root = _root(run_moments(ends, lasting, truth.noise, joint=way.joint, rate=rate))
                wide = np.zeros((len(way.holds), 3, len(own)))
                wide[:, :, :gravity] = slopes[g]
                wide[:, 2, gravity + 2 * back : gravity + 2 * back + 2] = 1.0, speed
                out[g, :, c, run] = root @ wide
    return out.reshape(*out.shape[:3], 3 * RUNS, len(own)), own


def _root(moments: Floats) -> Floats:
    """(3, 3) R with R' R the moments; they may be singular to rounding where a run is short."""
    values, vectors = np.linalg.eigh(moments)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
