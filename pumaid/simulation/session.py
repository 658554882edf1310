"""A session: a virtual robot executes a plan in closed loop, and its log is written sample by sample."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Log
from pumaid.simulation.heat import STEP, Heat
from pumaid.simulation.hidden import Instants, State, bent, delays
from pumaid.simulation.noise import coloured, correlation
from pumaid.simulation.physics.bodies import Bodies
from pumaid.simulation.physics.march import Course, March
from pumaid.simulation.seams import Rehearsal, groups, led
from pumaid.simulation.timing import Stretch, first_starts, stretches
from pumaid.simulation.truth import Truth
from pumaid.trajectory import Plan

Floats = NDArray[np.float64]

#: What moves the robot.
BUILTIN, MUJOCO = "builtin", "mujoco"
#: Most samples of a batch.
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
        Source of noise and of where stiction leaves the joints before the first run.
    rate
        Samples a second.
    runs_per_file
        Planned motions in one file.
    has_velocity
        Whether the log has velocities.
    has_temperature
        Whether the log has the motors' temperatures.
    physics
        ``"builtin"``, or ``"mujoco"``: rigid-body dynamics.
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
        physics: str = BUILTIN,
    ) -> None:
        self.truth, self.plan, self.rng, self.rate = truth, plan, rng, rate
        self.runs_per_file, self.has_velocity = runs_per_file, has_velocity
        n = truth.robot.n_joints
        self._first = first_starts(truth.robot, plan, rate=rate)
        self._delays = delays(truth.hidden, n)
        self._heat = _heat(truth, plan) if has_temperature or truth.has_warmth else None
        self._phi = correlation(truth.noise, rate)
        self._noise = rng.standard_normal(n)
        self._settled = rng.uniform(-1.0, 1.0, n)
        self._march = March(truth, self._first, rate=rate)
        self._bodies = self._rigid() if physics == MUJOCO else None
        self._read = self._march.drive(truth.inertia).read
        self._sample = 0
        self._late = np.zeros((0, n))

    def logs(self) -> Iterator[Log]:
        """Batches of at most `CHUNK` samples, none across two stretches; `origin` names the file.

        A stretch is a run with its rests, or a move between postures.
        """
        row, file_number = 2, -1
        for stretch, course in self._courses():
            number = stretch.index // self.runs_per_file
            if number != file_number:
                row, file_number = 2, number
            for log in self._logged(course, origin=f"session_{number + 1:02d}", row=row):
                row += len(log)
                yield log

    def _rigid(self) -> Bodies:
        postures = np.unique([motion.hold for motion in self.plan.motions], axis=0)
        return Bodies(self.truth, self._first, rate=self.rate, postures=postures)

    def _courses(self) -> Iterator[tuple[Stretch, Course]]:
        every = list(stretches(self.truth.robot, self.plan))
        warm = self._heat if self.truth.has_warmth else None
        if self._bodies is not None:
            yield from zip(every, self._bodies.courses(every, self._settled, warm), strict=True)
            return
        counts = np.array([stretch.samples(self.rate) for stretch in every])
        begin = (np.cumsum(counts) - counts) / self.rate
        rehearsal = Rehearsal(self.truth, every, begin, self._march, rate=self.rate)
        seams = rehearsal.seams(self._settled, warm)
        rising = rehearsal.rising(seams)
        for part in groups(every, self.rate):
            warmth = seams.warmth[part], rising[part]
            courses, _ = self._march.run(every[part], begin[part], rest=seams.rest(part), warmth=warmth)
            for k, course in enumerate(courses, start=part.start):
                yield every[k], led(course, seams.position[k + 1], seams.current[k + 1], rate=self.rate)

    def _logged(self, course: Course, *, origin: str, row: int) -> Iterator[Log]:
        """What the log has of a stretch: through encoders and sensors, with noise."""
        count = len(course.position)
        time = np.round((self._sample + np.arange(count)) / self.rate, 9)
        temperature = None if self._heat is None else self._heat.warmed(course.current, 1.0 / self.rate)
        current = self._delayed(self._bent(course, time)) + self._noise_of(count)
        step = self.truth.noise.current_step
        for first in range(0, count, CHUNK):
            part = slice(first, min(first + CHUNK, count))
            yield Log(
                origin=origin,
                rows=np.arange(row + part.start, row + part.stop, dtype=np.int64),
                time=time[part],
                position=self._read(course.position[part]),
                # Rounded so that the bytes of a log do not depend on how a machine orders its additions.
                velocity=np.round(course.velocity[part], 9) if self.has_velocity else None,
                current=np.round(current[part] / step) * step if step > 0 else current[part],
                temperature=None if temperature is None else np.round(np.round(temperature[part] / STEP) * STEP, 6),
                starts_clock=self._sample == 0 and first == 0,
            )
        self._sample += count

    def _bent(self, course: Course, time: Floats) -> Floats:
        """(N, J) A after the laws of the whole current."""
        if not self.truth.hidden:
            return course.current
        nothing = np.zeros_like(course.current)
        arm = Instants(time, self._first, course.position, course.velocity, nothing, nothing, nothing)
        out, truth = course.current.copy(), self.truth
        for j in range(out.shape[1]):
            state = State(j + 1, arm, nothing, truth.weight, truth.friction.current, np.ones(out.shape[1]))
            out[:, j] = bent(truth.hidden, state, out[:, j])
        return out

    def _delayed(self, current: Floats) -> Floats:
        """(N, J) A as they are stamped, late; the session's first sample stands for all before it."""
        if not np.any(self._delays):
            return current
        longest = int(np.ceil(np.max(self._delays) * self.rate)) + 1
        before = self._late if len(self._late) else np.tile(current[:1], (longest, 1))
        whole, out = np.concatenate([before, current]), current.copy()
        places = len(before) + np.arange(len(current))
        for j in np.flatnonzero(self._delays):
            out[:, j] = np.interp(places - self._delays[j] * self.rate, np.arange(len(whole)), whole[:, j])
        self._late = whole[-longest:]
        return out

    def _noise_of(self, count: int) -> Floats:
        noise = self.truth.noise
        levels = noise.level_std * self.rng.standard_normal(len(noise.std))
        if not np.any(noise.std > 0):
            return np.zeros((count, len(levels)))
        found = coloured(self.rng, (count, len(levels)), phi=self._phi, start=self._noise)
        self._noise = found[-1]
        return noise.sample_std * found + levels


def _heat(truth: Truth, plan: Plan) -> Heat:
    """Cold motors, each of a size for its Coulomb friction and for the weight that it carries in the plan."""
    weight = truth.gravity_current(np.array([motion.hold for motion in plan.motions], dtype=float))
    return Heat.cold(np.sqrt(np.mean(weight**2, axis=0)) + truth.coulomb)
