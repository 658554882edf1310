"""The controller of the paper's experiment: (34)-(36), in closed loop at a fixed rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.virtual_robot import Truth
from pumaid.trajectory import MOVE_SHARE, Trapezoid, highest_speeds

Floats = NDArray[np.float64]

#: Gains of (34): 1/s2 and 1/s, K_D = 2 sqrt(K_P). Within a `NEAR`th of a second's way of its target a joint leaves its
#: speed and creeps in.
K_P, K_D = 400.0, 40.0
NEAR = K_P / K_D
#: J of (35) as a share of the inertia; A that the encoder's steps may leave in the current (the paper, too, tunes J for
#: a calm current); s over which the compensator averages the load for it at most, and periods at least.
SHARE, CALM, LONGEST, FEWEST = 0.7, 0.01, 0.02, 2.0
#: rad and m: a joint that rests so near its target is in position, and its drive asks for no more.
TURN_WINDOW, SLIDE_WINDOW = 1e-3, 2.5e-4


class Controller:
    """Load compensators with acceleration feedback, one for each of J joints.

    Wanted acceleration (34) K_D (-v + V (K_P/K_D) (target - q)), V (36) such that the part in brackets stays within a
    speed limit. Current (35) J (wanted) + load. The paper's load is i(t-dt) - J (v(t) - v(t-dt)) / dt with
    v(t) = (q(t) - q(t-dt)) / dt of encoder readings; here it is that, averaged by a filter of the second order that
    follows a steady change without lag, over as short a time as leaves the current calm. Its `position` (J,) is that of
    the encoders, rad or m, its `velocity` (J,) as the drives know it, its `current` (J,) in A.
    """

    def __init__(self, truth: Truth, *, period: float) -> None:
        n, counts = truth.robot.n_joints, truth.noise.counts
        counts = np.zeros(n) if counts is None else counts
        self._counts = np.where(counts > 0, counts, 1e12)
        self._window = np.where(truth.robot.is_revolute, TURN_WINDOW, SLIDE_WINDOW)
        self._holding = MOVE_SHARE * highest_speeds(truth.robot)
        self._period, self._rate = period, 1.0 / period
        self.position = self.velocity = self.current = self._load = self._rise = np.zeros(n)
        self.tune(np.zeros(n))

    def tune(self, inertia: Floats) -> None:
        """Take J from the inertia (J,) A s2/rad or A s2/m that the motors move, as they count."""
        self._inertia, self._wanting = SHARE * inertia * self._rate, SHARE * inertia * K_D
        share = np.minimum(1.0, self._period / _averaging_time(SHARE * inertia, self._counts, self._period))
        self._level, self._trend = 1.0 - (1.0 - share) ** 2, share**2

    def start(self, position: Floats, current: Floats) -> None:
        """An arm at rest at `position` (J,), its motors drawing `current` (J,)."""
        self.position, self.velocity = self.read(position), np.zeros_like(position)
        self._load, self._rise, self.current = current.copy(), np.zeros_like(current), current.copy()

    def read(self, position: Floats) -> Floats:
        """What the encoders tell of `position` (..., J)."""
        return np.rint(position * self._counts) / self._counts

    def limits(self, trapezoid: Trapezoid, count: int) -> tuple[Floats, Floats]:
        """(count, J) targets and speed limits, period by period, of a movement with the rests before and after it.

        The limit is the trapezoid's speed until it has fallen to where a joint creeps in by itself.
        """
        since = (np.arange(count) * self._period - trapezoid.lead)[:, None]
        falling = np.maximum(trapezoid.duration - since, 2.0 / NEAR)
        moves = (since >= 0.0) & (trapezoid.start != trapezoid.end)
        share = np.abs(trapezoid.end - trapezoid.start) / (trapezoid.way or 1.0)
        allowed = share * np.minimum(trapezoid.speed, trapezoid.acceleration * np.minimum(since, falling))
        return np.where(since >= 0.0, trapezoid.end, trapezoid.start), np.where(moves, allowed, self._holding)

    def command(self, position: Floats, target: Floats, limit: Floats) -> Floats:
        """(J,) A for the next period of motors that stand at `position` (J,) and shall go to `target` (J,).

        `limit` (J,) is the highest speed now, V_max.
        """
        q = self.read(position)
        v = (q - self.position) * self._rate
        load, rise = self._load, self._rise
        load += rise
        miss = self.current - self._inertia * (v - self.velocity) - load
        load += self._level * miss
        rise += self._trend * miss
        error = target - q
        reach = np.minimum(np.maximum(NEAR * error, -limit), limit)
        inside = np.abs(error) <= self._window
        if inside.any():
            reach[inside] = 0.0
            rise[inside & (v == 0.0)] = 0.0
        self.position, self.velocity = q, v
        self.current = self._wanting * (reach - v) + load
        return self.current


def _averaging_time(inertia: Floats, counts: Floats, period: float) -> Floats:
    """(J,) s over which the measured load is averaged.

    Two readings, each wrong by a uniform part of a count, put J (K_D + 2/T) times their speed into the current.
    """
    shortest = FEWEST * period
    unrest = np.abs(inertia) * np.sqrt(1.0 / 6.0) / (counts * period)
    left_over = np.maximum(CALM / np.maximum(unrest, 1e-12) - K_D, 1e-6)
    return np.clip(2.0 / left_over, shortest, max(LONGEST, shortest))
