"""A session: a virtual robot executes a plan, and its log is written sample by sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Log, Plan
from pumaid.virtual.heat import STEP, Heat
from pumaid.virtual.hidden import Instants, delays
from pumaid.virtual.noise import coloured, correlation
from pumaid.virtual.timing import Stretch, first_starts, stretches
from pumaid.virtual.truth import Truth

Floats = NDArray[np.float64]

#: A joint at rest is carried by stiction with anything up to this share of its Coulomb friction, either way.
STICTION_SHARE = 0.8


#: Most samples of a batch: what keeps memory flat however long a run is.
CHUNK = 16384


class Session:
    """A virtual robot at work; `logs` yields its samples in batches, in order of time.

    Parameters
    ----------
    truth
        The robot.
    plan
        What it executes.
    rng
        Source of noise and of where stiction leaves the held joints.
    rate
        Samples a second.
    runs_per_file
        Planned motions in one file.
    has_velocity
        Whether the log has velocities.
    has_temperature
        Whether the log has the motors' temperatures.
    """

    def __init__(
        self,
        truth: Truth,
        plan: Plan,
        rng: np.random.Generator,
        *,
        rate: float = 250.0,
        runs_per_file: int = 40,
        has_velocity: bool = True,
        has_temperature: bool = False,
    ) -> None:
        self.truth, self.plan, self.rng, self.rate = truth, plan, rng, rate
        self.runs_per_file, self.has_velocity = runs_per_file, has_velocity
        n = truth.robot.n_joints
        self._first = first_starts(truth.robot, plan, rate=rate)
        self._delays = delays(truth.hidden, n)
        self._heat = _heat(truth, plan) if has_temperature or truth.has_warmth else None
        self._phi = correlation(truth.noise, rate)
        self._noise = rng.standard_normal(n)
        self._stiction = self._settle()
        self._encoder_error = np.zeros(n)
        self._sample = 0

    def logs(self) -> Iterator[Log]:
        """Batches of at most `CHUNK` samples, none across two stretches; `origin` names the file.

        A stretch is a run with its rests, or a move between postures.
        """
        row, file_number = 2, -1
        for stretch in stretches(self.truth.robot, self.plan):
            number = stretch.index // self.runs_per_file
            if number != file_number:
                row, file_number = 2, number
            for log in self._stretch(stretch, origin=f"session_{number + 1:02d}", row=row):
                row += len(log)
                yield log

    def _stretch(self, stretch: Stretch, *, origin: str, row: int) -> Iterator[Log]:
        count = max(1, int(np.ceil(stretch.duration * self.rate)))
        moving = np.array([path.start != path.end for path in stretch.paths])
        before, self._stiction = self._stiction, np.where(moving, self._settle(), self._stiction)
        levels = self.truth.noise.level_std * self.rng.standard_normal(len(moving))
        for first in range(0, count, CHUNK):
            local = np.arange(first, min(first + CHUNK, count)) / self.rate
            time = np.round((self._sample + np.arange(len(local))) / self.rate, 9)
            resting = np.where((local > stretch.lead)[:, None], self._stiction, before)
            at = self._warmed(self._instants(stretch, local, time), resting)
            current = self.truth.current(at, resting)
            for late in set(self._delays.tolist()) - {0.0}:
                then = replace(self._instants(stretch, local - late, time), temperature=at.temperature)
                earlier = np.where((local - late > stretch.lead)[:, None], self._stiction, before)
                current[:, self._delays == late] = self.truth.current(then, earlier)[:, self._delays == late]
            current += self._noise_of(len(local), levels)
            measured, speed = self._encoder(at.position, at.velocity)
            step = self.truth.noise.current_step
            yield Log(
                origin=origin,
                rows=np.arange(row + first, row + first + len(local), dtype=np.int64),
                time=time,
                position=measured,
                velocity=speed if self.has_velocity else None,
                current=np.round(current / step) * step if step > 0 else current,
                temperature=None if self._heat is None else np.round(np.round(at.temperature / STEP) * STEP, 6),
                starts_clock=self._sample == 0,
            )
            self._sample += len(local)

    def _instants(self, stretch: Stretch, local: Floats, time: Floats) -> Instants:
        """The arm `local` (N,) s after the stretch began; its motors as warm as they are now."""
        position, velocity, acceleration = stretch.at(local)
        begin = np.array([path.start for path in stretch.paths])
        unknown = np.full(position.shape, np.nan)
        return Instants(time, self._first, position, velocity, acceleration, np.abs(position - begin), unknown)

    def _warmed(self, at: Instants, resting: Floats) -> Instants:
        """With the temperatures that the currents lead to, those of hidden effects apart."""
        if self._heat is None:
            return at
        plain = replace(self.truth, hidden=()).current(at, resting)
        return replace(at, temperature=self._heat.warmed(plain, 1.0 / self.rate))

    def _noise_of(self, count: int, levels: Floats) -> Floats:
        noise = self.truth.noise
        if not np.any(noise.std > 0):
            return np.zeros((count, len(levels)))
        found = coloured(self.rng, (count, len(levels)), phi=self._phi, start=self._noise)
        self._noise = found[-1]
        return noise.sample_std * found + levels

    def _settle(self) -> Floats:
        """(J,) A that stiction takes of each resting joint: undetermined by anything that a log shows."""
        size = self.truth.coulomb
        return STICTION_SHARE * size * self.rng.uniform(-1.0, 1.0, len(size))

    def _encoder(self, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        counts = self.truth.noise.counts
        if counts is None:
            return position, velocity
        measured = np.where(counts > 0, np.round(position * counts) / np.where(counts > 0, counts, 1.0), position)
        error = measured - position
        steps = np.diff(error, axis=0, prepend=self._encoder_error[None])
        self._encoder_error = error[-1]
        # Rounded so that the bytes of a log do not depend on how a machine orders its additions.
        return measured, np.round(velocity + steps * self.rate, 9)


def _heat(truth: Truth, plan: Plan) -> Heat:
    """Cold motors, each of a size for its Coulomb friction and for the weight that it carries in the plan."""
    weight = truth.gravity_current(np.array([motion.hold for motion in plan.motions], dtype=float))
    return Heat.cold(np.sqrt(np.mean(weight**2, axis=0)) + truth.coulomb)
