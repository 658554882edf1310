"""Many stretches of a session at once: each begins and ends at rest, so they march side by side in local time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.physics.drive import Drive, control_rate
from pumaid.simulation.physics.forces import Forces
from pumaid.simulation.physics.joints import Joints
from pumaid.simulation.timing import Stretch
from pumaid.simulation.truth import Truth
from pumaid.trajectory import MOVE_SHARE, highest_speeds

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Course:
    """What one stretch did at its N samples, (N, J) each.

    Attributes
    ----------
    position
        rad or m, exact.
    velocity
        rad/s or m/s, as the drives have it.
    current
        A, mean of what flowed before and after the sample's instant: what a sensor that averages over a period says.
    """

    position: Floats
    velocity: Floats
    current: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Rest:
    """S arms at rest between two stretches, (S, J) each: position, motor current, and the load that it carries."""

    position: Floats
    current: Floats
    load: Floats


@dataclass(frozen=True, eq=False, slots=True)
class Orders:
    """What S stretches tell the controllers, (S, J) each but the leads (S,): see `Path`."""

    start: Floats
    end: Floats
    speed: Floats
    acceleration: Floats
    lead: Floats

    @classmethod
    def of(cls, group: Sequence[Stretch]) -> Orders:
        """Those of `group`."""
        parts = ("start", "end", "speed", "acceleration")
        a, b, c, d = (np.array([[getattr(path, part) for path in one.paths] for one in group]) for part in parts)
        return cls(a, b, c, d, np.array([one.lead for one in group]))

    def at(self, local: float, holding: Floats, m: int) -> tuple[Floats, Floats]:
        """(m, J) targets and speed limits of the first m, `local` s after they began; `holding` (J,) limits at rest."""
        since = (local - self.lead[:m])[:, None]
        begun = (since >= 0.0) & (self.start[:m] != self.end[:m])
        target = np.where(begun, self.end[:m], self.start[:m])
        rising = np.minimum(self.speed[:m], self.acceleration[:m] * since)
        return target, np.where(begun, rising, holding)


class March:
    """A robot that executes stretches of a session, many at once.

    Parameters
    ----------
    truth
        The robot.
    first
        (J,) s at which each joint's first run begins.
    rate
        Samples a second.
    """

    def __init__(self, truth: Truth, first: Floats, *, rate: float) -> None:
        self._truth, self._first, self._rate = truth, first, rate
        self._ticks, self._parts = control_rate(rate)
        self._tick = 1.0 / (rate * self._ticks)
        self._holding = MOVE_SHARE * highest_speeds(truth.robot)

    def drive(self, inertia: Floats) -> Drive:
        """Controllers for joints of this inertia."""
        robot = self._truth.robot
        return Drive(inertia, self._truth.noise.counts, robot.is_revolute, step=self._parts * self._tick)

    def run(
        self, group: Sequence[Stretch], begin: Floats, *, rest: Rest, warmth: tuple[Floats, Floats]
    ) -> tuple[list[Course], Rest]:
        """Execute stretches that begin at `begin` (S,) s of the session from rest; what they did and where they ended.

        Parameters
        ----------
        group
            S stretches.
        begin
            (S,) s.
        rest
            Where they begin.
        warmth
            (S, J) degC of the motors at the beginning and its change, degC/s.
        """
        counts = np.array([one.samples(self._rate) for one in group])
        order = np.argsort(-counts, kind="stable")
        sorted_group = [group[k] for k in order]
        alone = np.array([0 if one.motion is None else one.motion.joint for one in sorted_group])
        step = self._parts * self._tick
        forces = Forces(self._truth, self._first, begin=begin[order], alone=alone, step=step)
        forces.start(rest.position[order], (warmth[0][order], warmth[1][order]))
        plant = Joints(self._truth, step=self._tick)
        plant.start(rest.position[order])
        drive = self.drive(plant.inertia)
        drive.start(rest.position[order], rest.current[order])
        columns, load = self._march(Orders.of(sorted_group), counts[order], (forces, plant, drive))
        back = np.argsort(order)
        ends = np.cumsum(counts[order])
        courses = [Course(*(column[ends[k] - counts[order[k]] : ends[k]] for column in columns)) for k in back]
        return courses, Rest(plant.position[back], drive.current[back], load[back])

    def _march(
        self, orders: Orders, counts: Ints, arms: tuple[Forces, Joints, Drive]
    ) -> tuple[tuple[Floats, Floats, Floats], Floats]:
        """(all samples, J) of position, velocity and current, stretch by stretch; (S, J) loads at the end."""
        forces, plant, drive = arms
        joints, ahead = plant.position.shape[1], 0.5 * self._parts * self._tick
        columns = tuple(np.empty((int(counts.sum()), joints)) for _ in range(3))
        places, last = np.cumsum(counts) - counts, np.zeros_like(plant.position)
        before = current = load = against = None
        for tick, m in _active(counts * self._ticks):
            q, v = plant.position[:m], plant.velocity[:m]
            if tick % self._parts == 0:
                target, limit = orders.at(tick * self._tick, self._holding, m)
                before = drive.current[:m].copy()
                current = drive.command(q, target, limit)
                load, against = forces.at(tick // self._parts, q + ahead * v, v, push=plant.push[:m])
                last[:m] = load
            assert before is not None and current is not None and load is not None
            if tick % self._ticks == 0:
                rows = places[:m] + tick // self._ticks
                columns[0][rows], columns[1][rows] = q, drive.velocity[:m]
                columns[2][rows] = 0.5 * (before[:m] + current[:m])
            plant.advance(current[:m], load[:m], None if against is None else against[:m])
        return (columns[0], columns[1], columns[2]), last


def _active(ticks: Ints) -> Iterator[tuple[int, int]]:
    """Every tick with the number of stretches that still run; `ticks` (S,) of each, falling."""
    m = len(ticks)
    for tick in range(int(ticks[0])):
        while ticks[m - 1] <= tick:
            m -= 1
        yield tick, m
