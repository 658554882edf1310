"""Runs without logs: many noisy repeats of one experiment, fast enough for statistics over hundreds of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Run
from pumaid.errors import ModelError, Where
from pumaid.simulation.hidden_effects import AMBIENT, RISE, WARMING_TIME, ArmState, delays
from pumaid.simulation.virtual_robot import Truth
from pumaid.trajectory import Motion, Plan, Trapezoid, run_times, trapezoids

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Fewest samples at constant speed that say anything of a run's three regressors and its noise.
_FEWEST = 8


@dataclass(frozen=True, eq=False, slots=True)
class _Prepared:
    """What does not change between experiments: a run's noise-free current, its bins."""

    motion: Motion
    speed: float
    position: Floats
    current: Floats
    edges: Counts
    bins: Bins


class Bench:
    """One experiment on one virtual robot, prepared once, made as often as wanted.

    Positions are exact and the runs are cut where the speed is constant; only the currents' noise differs between
    experiments.

    Parameters
    ----------
    truth
        The robot.
    plan
        The motions; held-out ones are marked in the runs.
    rate
        Samples a second.
    bins
        Bins a run (fewer where a run has too few samples).

    Examples
    --------
    >>> from pumaid.simulation import Bench, table1
    >>> bench = Bench(table1.puma560(), table1.experiment(), rate=50.0)
    >>> runs = bench.runs(np.random.default_rng(1))
    >>> len(runs), runs[0].joint
    (100, 1)
    """

    def __init__(self, truth: Truth, plan: Plan, *, rate: float = 100.0, bins: int = 60) -> None:
        self.truth, self.plan, self.rate = truth, plan, rate
        starts = run_times(truth.robot, plan)[:, 0]
        self._first = first_starts(plan, starts, n_joints=truth.robot.n_joints)
        runs = [trapezoid for trapezoid in trapezoids(truth.robot, plan) if trapezoid.motion is not None]
        self._runs = [self._prepare(run, start=float(at), bins=bins) for run, at in zip(runs, starts, strict=True)]

    @property
    def samples(self) -> int:
        """Samples of one experiment, all runs together."""
        return sum(len(run.position) for run in self._runs)

    def runs(self, rng: np.random.Generator) -> tuple[Run, ...]:
        """The runs of one more experiment, noise and levels drawn from `rng`."""
        noise = self.truth.noise
        quiet = not np.any(noise.std > 0)
        if quiet:
            errors, levels = np.zeros(self.samples), np.zeros(len(self._runs))
        else:
            errors = noise.series(rng, (self.samples,), rate=self.rate, start=rng.standard_normal())
            levels = rng.standard_normal(len(self._runs))
        out, first = [], 0
        for prepared, level in zip(self._runs, levels, strict=True):
            last, j = first + len(prepared.position), prepared.motion.joint - 1
            error = noise.sample_std[j] * errors[first:last] + noise.level_std[j] * level
            out.append(self._run(prepared, prepared.current + error, first))
            first = last
        return tuple(out)

    def _prepare(self, run: Trapezoid, *, start: float, bins: int) -> _Prepared:
        motion = run.motion
        assert motion is not None
        j = motion.joint - 1
        first, last = run.cruise
        local = np.arange(np.ceil(first * self.rate), np.floor(last * self.rate) + 1) / self.rate
        if len(local) < _FEWEST:
            raise ModelError(
                "run-too-short",
                f"a run of joint {motion.joint} keeps its speed for {len(local)} samples only (at {self.rate:g} Hz)",
                Where(joint=motion.joint),
                "widen its span, lower its velocity or raise the rate",
            )
        own = run.at(local)[0][:, j]
        speed = run.peak * float(np.sign(motion.end - motion.start))
        edges = np.linspace(0, len(own), max(1, min(bins, len(own) // 2)) + 1).astype(np.int64)
        return _Prepared(
            motion=motion,
            speed=speed,
            position=own,
            current=self._current(motion, own, speed=speed, time=start + local),
            edges=edges[:-1],
            bins=self._empty_bins(motion, own, speed=speed, time=start + local, edges=edges),
        )

    def _current(self, motion: Motion, own: Floats, *, speed: float, time: Floats) -> Floats:
        truth, j = self.truth, motion.joint - 1
        if not truth.hidden:
            return self._gravity(motion, own) + truth.friction.current(motion.joint, np.full(len(own), speed))
        position = np.tile(np.array(motion.hold, dtype=float), (len(own), 1))
        position[:, j] = own - speed * delays(truth.hidden, truth.robot.n_joints)[j]
        velocity, travel = np.zeros_like(position), np.zeros_like(position)
        velocity[:, j], travel[:, j] = speed, np.abs(position[:, j] - motion.start)
        warm = np.tile(warming(time)[:, None], truth.robot.n_joints)
        at = ArmState(time, self._first, position, velocity, np.zeros_like(position), travel, warm)
        return truth.current(motion.joint, at)

    def _gravity(self, motion: Motion, own: Floats) -> Floats:
        """While one joint moves its gravity is ``C cos q + S sin q`` (turning) or constant (sliding)."""
        j = motion.joint - 1
        ends = np.tile(np.array(motion.hold, dtype=float), (2, 1))
        ends[:, j] = [0.0, 0.5 * np.pi]
        at_zero, at_quarter = self.truth.gravity_current(ends)[:, j]
        if self.truth.robot.joints[j].is_revolute:
            return np.asarray(at_zero * np.cos(own) + at_quarter * np.sin(own))
        return np.full(len(own), at_zero)

    def _empty_bins(self, motion: Motion, own: Floats, *, speed: float, time: Floats, edges: Counts) -> Bins:
        j, count = motion.joint - 1, np.diff(edges)
        position = np.tile(np.array(motion.hold, dtype=float), (len(count), 1))
        position[:, j] = np.add.reduceat(own, edges[:-1]) / count
        mean_time = np.add.reduceat(time, edges[:-1]) / count
        return Bins(
            count=count,
            time=mean_time,
            position=position,
            velocity=np.full(len(count), speed),
            acceleration=np.zeros(len(count)),
            current=np.zeros(len(count)),
            variance=np.zeros(len(count)),
            temperature=warming(mean_time) if self.truth.hides("thermal_friction") else np.full(len(count), np.nan),
        )

    @staticmethod
    def _run(prepared: _Prepared, current: Floats, first: int) -> Run:
        """The run whose moving joint draws `current` (N,); what it leaves of its samples is what a log would leave."""
        motion, bins, j = prepared.motion, prepared.bins, prepared.motion.joint - 1
        mean = np.add.reduceat(current, prepared.edges) / bins.count
        square = np.add.reduceat(current**2, prepared.edges) / bins.count
        posture = np.array(motion.hold, dtype=float)
        posture[j] = np.nan
        return Run(
            joint=motion.joint,
            kind="constant",
            origin="bench",
            first_row=first + 2,
            last_row=first + len(current) + 1,
            start=float(bins.time[0]),
            duration=float(bins.time[-1] - bins.time[0]),
            posture=posture,
            span=(float(prepared.position[0]), float(prepared.position[-1])),
            speed=prepared.speed,
            ripple=0.0,
            temperature=float(np.mean(bins.temperature)),
            samples=len(current),
            bins=replace(bins, current=mean, variance=np.maximum(square - mean**2, 0.0)),
            heldout=motion.purpose == "heldout",
        )


def warming(time: Floats) -> Floats:
    """(N,) degC of a motor that draws a third of its usual current from 0 s on."""
    return np.asarray(AMBIENT - RISE / 3.0 * np.expm1(-time / WARMING_TIME))


def first_starts(plan: Plan, starts: Floats, *, n_joints: int) -> Floats:
    """(J,) s at which each joint's first run begins; that of the arm's first where a joint has none.

    Parameters
    ----------
    plan
        M runs.
    starts
        (M,) s at which they begin.
    n_joints
        Of the arm.
    """
    out = np.full(n_joints, starts[0] if len(starts) else 0.0)
    for motion, start in zip(reversed(plan.motions), starts[::-1], strict=True):
        out[motion.joint - 1] = start
    return out


def runs(truth: Truth, plan: Plan, rng: np.random.Generator, *, rate: float = 100.0) -> tuple[Run, ...]:
    """The runs of one experiment; for many experiments keep a `Bench`.

    Parameters
    ----------
    truth, plan
        The robot, and what it executes.
    rng
        Source of the noise.
    rate
        Samples a second.
    """
    return Bench(truth, plan, rate=rate).runs(rng)
