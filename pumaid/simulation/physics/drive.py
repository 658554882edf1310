"""The controller of the experiment: (34)-(36) of the paper, for many arms at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.timing import K_D, NEAR

Floats = NDArray[np.float64]

#: J of (35) as a share of the motor's inertia; A that the encoder's steps may leave in the current (the paper, too,
#: tunes J for a calm current); s over which the compensator averages the load for it at most, and periods at least.
SHARE, CALM, LONGEST, FEWEST = 0.7, 0.01, 0.02, 2.0
#: rad and m: a joint that rests so near its target is in position, and its drive asks for no more.
TURN_WINDOW, SLIDE_WINDOW = 1e-3, 2.5e-4
#: Hz: controllers work at the log's rate, but not slower or faster than this: slower ones let the speed waver.
SLOWEST, FASTEST = 250.0, 1000.0


def control_rate(rate: float) -> tuple[int, int]:
    """Where a log has `rate` Hz: ticks of the simulation a sample, and ticks a period of the controller; one is 1."""
    if rate < SLOWEST:
        return int(np.ceil(SLOWEST / rate - 1e-9)), 1
    return 1, int(np.ceil(rate / FASTEST - 1e-9))


class Drive:
    """Load compensators with acceleration feedback, of S arms with J joints each.

    Wanted acceleration (34) K_D (-v + V (K_P/K_D) (target - q)), V (36) such that the part in brackets stays within a
    speed limit. Current (35) J (wanted) + load. The paper's load is i(t-dt) - J (v(t) - v(t-dt)) / dt with
    v(t) = (q(t) - q(t-dt)) / dt of encoder readings; here it is that, averaged by a filter of the second order that
    follows a steady change without lag, over as short a time as leaves the current calm.

    Parameters
    ----------
    inertia
        (J,) A s2/rad or A s2/m that the motors move, as they count.
    counts
        (J,) encoder counts a rad or m, or none.
    is_revolute
        (J,) whether each joint turns.
    step
        s of a period.

    Attributes
    ----------
    velocity
        (S, J) rad/s or m/s, as the drives know it.
    current
        (S, J) A.
    """

    def __init__(self, inertia: Floats, counts: Floats | None, is_revolute: NDArray[np.bool_], *, step: float) -> None:
        self._inertia, self._step = SHARE * inertia, step
        self._window = np.where(is_revolute, TURN_WINDOW, SLIDE_WINDOW)
        self._counts = None if counts is None or not np.any(counts > 0) else np.where(counts > 0, counts, np.nan)
        share = np.minimum(1.0, step / self._averaged())
        self._level, self._trend = 1.0 - (1.0 - share) ** 2, share**2
        self._before = self._load = self._rise = self.velocity = self.current = np.zeros((0, len(inertia)))

    def _averaged(self) -> Floats:
        """(J,) s over which the measured load is averaged.

        Two readings, each wrong by a uniform part of a count, put J (K_D + 2/T) times their speed into the current.
        """
        shortest = FEWEST * self._step
        if self._counts is None:
            return np.full(len(self._inertia), shortest)
        unrest = np.abs(self._inertia) * np.sqrt(1.0 / 6.0) / (np.nan_to_num(self._counts, nan=np.inf) * self._step)
        left = np.maximum(CALM / np.maximum(unrest, 1e-12) - K_D, 1e-6)
        return np.clip(2.0 / left, shortest, max(LONGEST, shortest))

    def start(self, position: Floats, current: Floats) -> None:
        """Arms at rest at `position` (S, J), their motors drawing `current` (S, J)."""
        self._before, self.velocity = self.read(position), np.zeros_like(position)
        self._load, self._rise, self.current = current.copy(), np.zeros_like(current), current.copy()

    def read(self, position: Floats) -> Floats:
        """What the encoders say of `position` (S, J)."""
        if self._counts is None:
            return position.copy()
        return np.where(np.isnan(self._counts), position, np.round(position * self._counts) / self._counts)

    def command(self, position: Floats, target: Floats, limit: Floats) -> Floats:
        """(m, J) A of the first m arms, which stand at `position` (m, J) now and shall go to `target` (m, J).

        `limit` (m, J) is the highest speed now, V_max.
        """
        m = len(position)
        q = self.read(position)
        v = (q - self._before[:m]) / self._step
        load, rise = self._load[:m], self._rise[:m]
        felt = self.current[:m] - self._inertia * ((v - self.velocity[:m]) / self._step)
        load += rise
        miss = felt - load
        load += self._level * miss
        rise += self._trend * miss
        error = target - q
        reach = np.clip(NEAR * error, -limit, limit)
        inside = np.abs(error) <= self._window
        reach[inside] = 0.0
        rise[inside & (v == 0.0)] = 0.0
        self._before[:m], self.velocity[:m] = q, v
        self.current[:m] = self._inertia * (K_D * (reach - v)) + load
        return self.current[:m]
