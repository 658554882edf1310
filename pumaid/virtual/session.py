"""A session: a virtual robot executes a plan, and its log is written sample by sample."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Log, Plan
from pumaid.virtual.noise import coloured, correlation
from pumaid.virtual.timing import Stretch, stretches
from pumaid.virtual.truth import Truth

Floats = NDArray[np.float64]

#: A joint at rest is carried by stiction with anything up to this share of its Coulomb friction, either way.
STICTION_SHARE = 0.8


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
    ) -> None:
        self.truth, self.plan, self.rng, self.rate = truth, plan, rng, rate
        self.runs_per_file, self.has_velocity = runs_per_file, has_velocity
        n = truth.robot.n_joints
        self._phi = correlation(truth.noise, rate)
        self._noise = rng.standard_normal(n)
        self._stiction = self._settle()
        self._encoder_error = np.zeros(n)
        self._sample = 0

    def logs(self) -> Iterator[Log]:
        """One batch a stretch (a run with its rests, or a move between postures); `origin` names the file."""
        row, file_number = 2, -1
        for stretch in stretches(self.truth.robot, self.plan):
            number = stretch.index // self.runs_per_file
            if number != file_number:
                row, file_number = 2, number
            log = self._batch(stretch, origin=f"session_{number + 1:02d}", row=row)
            row += len(log)
            yield log

    def _batch(self, stretch: Stretch, *, origin: str, row: int) -> Log:
        count = max(1, int(np.ceil(stretch.duration * self.rate)))
        local = np.arange(count) / self.rate
        position, velocity, acceleration = stretch.at(local)
        first = self._sample
        self._sample += count
        time = np.round((first + np.arange(count)) / self.rate, 9)
        current = self._current(time, position, velocity=velocity, acceleration=acceleration)
        measured, speed = self._encoder(position, velocity)
        step = self.truth.noise.current_step
        return Log(
            origin=origin,
            rows=np.arange(row, row + count, dtype=np.int64),
            time=time,
            position=measured,
            velocity=speed if self.has_velocity else None,
            current=np.round(current / step) * step if step > 0 else current,
            starts_clock=first == 0,
        )

    def _current(self, time: Floats, position: Floats, *, velocity: Floats, acceleration: Floats) -> Floats:
        truth, noise = self.truth, self.truth.noise
        gravity = truth.gravity_current(position)
        current = gravity + truth.inertia * acceleration
        before, self._stiction = self._stiction, np.where(np.any(velocity != 0, axis=0), self._settle(), self._stiction)
        has_moved = np.cumsum(velocity != 0, axis=0) > 0
        for j in range(truth.robot.n_joints):
            resting = np.where(has_moved[:, j], self._stiction[j], before[j])
            friction = truth.friction.current(j + 1, velocity[:, j])
            current[:, j] += np.where(velocity[:, j] == 0, resting, friction)
            q, v, load = position[:, j], velocity[:, j], gravity[:, j]
            current[:, j] += truth.hidden_current(j + 1, time, position=q, velocity=v, load=load)
        if not np.any(noise.std > 0):
            return current
        coloured_noise = coloured(self.rng, current.shape, phi=self._phi, start=self._noise)
        self._noise = coloured_noise[-1]
        levels = noise.level_std * self.rng.standard_normal(truth.robot.n_joints)
        return current + noise.sample_std * coloured_noise + levels

    def _settle(self) -> Floats:
        """(J,) A that stiction takes of each resting joint: undetermined by anything that a log shows."""
        friction = self.truth.friction
        size = 0.5 * (np.abs(friction.coulomb_plus) + np.abs(friction.coulomb_minus))
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
