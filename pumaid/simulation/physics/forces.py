"""What pushes the joints of a virtual robot besides its motors: weight, and hidden physics that acts on a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.simulation.hidden import LAWS, Hidden, Instants, State, felt
from pumaid.simulation.truth import Truth
from pumaid.simulation.weight import Recalled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Periods of the controller between two looks at what is slow; between them it changes steadily.
EVERY = 8
#: rad/s or m/s: the speed with which a joint at rest would begin to move.
CREEP = 1e-9


class Forces:
    """What acts on S arms with J joints each, in amperes, while each executes its own stretch of a session.

    While one joint moves, the weight in every joint is a + b cos q + c sin q of its position (a + d q of a sliding
    one), exactly; where several move it is looked at every `EVERY` periods where the arm stands and where it will.

    Parameters
    ----------
    truth
        The robot.
    first
        (J,) s at which each joint's first run begins.
    begin
        (S,) s of the session at which the stretches begin.
    alone
        (S,) the joint (from 1) that moves alone in each stretch, 0 where several do.
    step
        s of a period of the controller.
    with_weight
        Whether weight is among them; else hidden physics alone.
    """

    def __init__(
        self,
        truth: Truth,
        first: Floats,
        *,
        begin: Floats,
        alone: Ints,
        step: float,
        with_weight: bool = True,
    ) -> None:
        self._truth, self._first, self._begin, self._alone = truth, first, begin, alone
        self._step, self._with_weight = step, with_weight
        self._sides = np.where(truth.friction.coulomb_plus < 0, -1.0, 1.0)
        acting = [one for one in truth.hidden if LAWS[one.effect].adds is not None and one.effect != "inertia"]
        self._slow = [one for one in acting if LAWS[one.effect].is_slow]
        self._fast = [one for one in acting if not LAWS[one.effect].is_slow]
        self._recalled = Recalled.of(truth.weight)
        self._waves = self._weight = self._extra = self._against = self._left = self._warmth = np.zeros(0)

    def start(self, position: Floats, warmth: tuple[Floats, Floats]) -> None:
        """Arms at rest at `position` (S, J); `warmth`: (S, J) degC of their motors and its change, degC/s."""
        self._left = position.copy()
        self._weight, self._extra, self._against = np.zeros((3, 2, *position.shape))
        self._waves = self._fitted(position)
        self._warmth = np.stack(warmth)

    def at(self, period: int, position: Floats, velocity: Floats, *, push: Floats) -> tuple[Floats, Floats | None]:
        """(m, J) A that loads take of the motors in this period, and (m, J) A of friction, or none.

        Parameters
        ----------
        period
            Periods since the stretches began.
        position, velocity
            (m, J) of the first m arms, in the middle of the period.
        push
            (m, J) of either sign: where a joint at rest is pushed.
        """
        m = len(position)
        if not (self._with_weight or self._slow or self._fast):
            return np.zeros_like(position), None
        if period % EVERY == 0:
            self._look(period, position, velocity, push)
        phase = period % EVERY
        own = np.take_along_axis(position, np.maximum(self._alone[:m] - 1, 0)[:, None], axis=1)
        a, b, c, d = self._waves[:, :m]
        weight = self._weight[0, :m] + phase * self._weight[1, :m] + a + b * np.cos(own) + c * np.sin(own) + d * own
        load = weight if self._with_weight else np.zeros_like(weight)
        if not (self._slow or self._fast):
            return load, None
        self._left[:m][velocity == 0.0] = position[velocity == 0.0]
        arm = self._arm(np.arange(m), period, position, velocity)
        more, against = self._hidden(self._fast, arm, weight, push)
        load = load + more + self._extra[0, :m] + phase * self._extra[1, :m]
        return load, against + self._against[0, :m] + phase * self._against[1, :m]

    def _fitted(self, position: Floats) -> Floats:
        """(4, S, J): a, b, c, d of the weight where one joint moves alone; all zero elsewhere."""
        out = np.zeros((4, *position.shape))
        alone = np.flatnonzero(self._alone)
        if not len(alone):
            return out
        own = self._alone[alone] - 1
        turns = self._truth.robot.is_revolute[own][:, None]
        places = np.tile(position[alone], (3, 1, 1))
        for k, (turning, sliding) in enumerate(((0.0, 0.0), (0.5 * np.pi, 1.0), (np.pi, 0.0))):
            places[k, np.arange(len(alone)), own] = np.where(turns[:, 0], turning, sliding)
        zero, quarter, half = self._truth.gravity_current(places.reshape(-1, places.shape[2])).reshape(places.shape)
        middle = 0.5 * (zero + half)
        out[0, alone] = np.where(turns, middle, zero)
        out[1, alone] = np.where(turns, 0.5 * (zero - half), 0.0)
        out[2, alone] = np.where(turns, quarter - middle, 0.0)
        out[3, alone] = np.where(turns, 0.0, quarter - zero)
        return out

    def _look(self, period: int, position: Floats, velocity: Floats, push: Floats) -> None:
        """What is slow, now and in `EVERY` periods."""
        m = len(position)
        needed = np.arange(m) if self._slow else np.flatnonzero(self._alone[:m] == 0)
        if not len(needed):
            return
        here, speed, count = position[needed], velocity[needed], len(needed)
        both = np.concatenate([here, here + EVERY * self._step * speed])
        weight = self._truth.gravity_current(both)
        found = [(self._weight, weight * (np.tile(self._alone[needed], 2) == 0)[:, None])]
        if self._slow:
            arm = self._arm(np.tile(needed, 2), period, both, np.tile(speed, (2, 1)))
            more, against = self._hidden(self._slow, arm, weight, np.tile(push[needed], (2, 1)))
            found += [(self._extra, more), (self._against, against)]
        for kept, values in found:
            kept[0, needed] = values[:count]
            kept[1, needed] = (values[count:] - values[:count]) / EVERY

    def _arm(self, rows: Ints, period: int, position: Floats, velocity: Floats) -> Instants:
        elapsed = period * self._step
        return Instants(
            time=self._begin[rows] + elapsed,
            first=self._first,
            position=position,
            velocity=self._truth.robot.shaft_velocity(velocity),
            acceleration=np.zeros_like(position),
            travel=np.abs(position - self._left[rows]),
            temperature=self._warmth[0, rows] + elapsed * self._warmth[1, rows],
        )

    def _hidden(self, hidden: Sequence[Hidden], arm: Instants, load: Floats, push: Floats) -> tuple[Floats, Floats]:
        """(N, J) A of hidden loads, and of hidden friction in the direction of motion or, at rest, of `push` (N, J)."""
        out, truth = np.zeros((2, *load.shape)), self._truth
        creeping = replace(arm, velocity=np.where(arm.velocity == 0.0, CREEP * push, arm.velocity))
        for j in range(load.shape[1]):
            for one in felt(hidden, j + 1):
                law = LAWS[one.effect]
                assert law.adds is not None
                seen = creeping if law.opposes else arm
                state = State(j + 1, seen, load, self._recalled, truth.friction.current, self._sides)
                out[int(law.opposes), :, j] += law.adds(state, one)
        return out[0], out[1]
