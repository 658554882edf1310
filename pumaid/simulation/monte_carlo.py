"""Runs without logs: many noisy repeats of one experiment, fast enough for statistics over hundreds of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Bins, Run
from pumaid.errors import ModelError, Where
from pumaid.simulation.hidden_effects import AMBIENT, RISE, WARMING_TIME, ArmState, delays
from pumaid.simulation.virtual_robot import Truth
from pumaid.trajectory import Motion, Plan, Trapezoid, run_times, trapezoids

Floats = NDArray[np.float64]

#: Fewest samples at constant speed that say anything of a run's three regressors and its noise.
_FEWEST = 8


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
        self._runs: list[Run] = []
        self._currents: list[Floats] = []
        movements = [movement for movement in trapezoids(truth.robot, plan) if movement.motion is not None]
        for movement, start in zip(movements, starts, strict=True):
            self._prepare(movement, start=float(start), bins=bins)

    @property
    def samples(self) -> int:
        """Samples of one experiment, all runs together."""
        return sum(run.samples for run in self._runs)

    def runs(self, rng: np.random.Generator) -> tuple[Run, ...]:
        """The runs of one more experiment, noise and levels drawn from `rng`."""
        noise = self.truth.noise
        if np.any(noise.std > 0):
            errors = noise.series(rng, (self.samples,), rate=self.rate, start=rng.standard_normal())
            levels = rng.standard_normal(len(self._runs))
        else:
            errors, levels = np.zeros(self.samples), np.zeros(len(self._runs))
        out, first = [], 0
        for run, current, level in zip(self._runs, self._currents, levels, strict=True):
            j, error = run.joint - 1, errors[first : first + run.samples]
            noisy = current + (noise.sample_std[j] * error + noise.level_std[j] * level)
            mean, square = _means(noisy, run.bins.count), _means(noisy**2, run.bins.count)
            out.append(replace(run, bins=replace(run.bins, current=mean, variance=np.maximum(square - mean**2, 0.0))))
            first += run.samples
        return tuple(out)

    def _prepare(self, movement: Trapezoid, *, start: float, bins: int) -> None:
        """Take up one run and its current without noise."""
        motion, row = movement.motion, self.samples + 2
        assert motion is not None
        j, speed = motion.joint - 1, movement.peak * float(np.sign(motion.end - motion.start))
        first, last = movement.cruise
        local = np.arange(np.ceil(first * self.rate), np.floor(last * self.rate) + 1) / self.rate
        if len(local) < _FEWEST:
            raise ModelError(
                "run-too-short",
                f"a run of joint {motion.joint} keeps its speed for {len(local)} samples only (at {self.rate:g} Hz)",
                Where(joint=motion.joint),
                "widen its span, lower its velocity or raise the rate",
            )
        position = movement.at(local)[0]
        edges = np.linspace(0, len(local), max(1, min(bins, len(local) // 2)) + 1).astype(np.int64)
        count = np.diff(edges)
        time = _means(start + local, count)
        posture = np.array(motion.hold, dtype=float)
        mean_position = np.tile(posture, (len(count), 1))
        mean_position[:, j] = _means(position[:, j], count)
        posture[j] = np.nan
        is_warm = self.truth.hides("thermal_friction")
        temperature = warming(time) if is_warm else np.full(len(count), np.nan)
        run = Run(
            joint=motion.joint,
            kind="constant",
            origin="bench",
            first_row=row,
            last_row=row + len(local) - 1,
            start=float(time[0]),
            duration=float(time[-1] - time[0]),
            posture=posture,
            span=(float(position[0, j]), float(position[-1, j])),
            speed=speed,
            ripple=0.0,
            temperature=float(np.mean(temperature)),
            samples=len(local),
            bins=Bins(
                count=count,
                time=time,
                position=mean_position,
                velocity=np.full(len(count), speed),
                acceleration=np.zeros(len(count)),
                current=np.zeros(len(count)),
                variance=np.zeros(len(count)),
                temperature=temperature,
            ),
            heldout=motion.purpose == "heldout",
        )
        self._runs.append(run)
        self._currents.append(self._current(motion, position, speed=speed, time=start + local))

    def _current(self, motion: Motion, position: Floats, *, speed: float, time: Floats) -> Floats:
        truth, j = self.truth, motion.joint - 1
        late = position.copy()
        late[:, j] -= speed * delays(truth.hidden, truth.robot.n_joints)[j]
        velocity, travel = np.zeros_like(position), np.zeros_like(position)
        velocity[:, j], travel[:, j] = speed, np.abs(late[:, j] - motion.start)
        warm = np.tile(warming(time)[:, None], truth.robot.n_joints)
        return truth.current(
            motion.joint, ArmState(time, self._first, late, velocity, np.zeros_like(late), travel, warm)
        )


def _means(values: Floats, count: NDArray[np.int64]) -> Floats:
    """Means over stretches of `count` values, one after the other."""
    return np.asarray(np.add.reduceat(values, np.cumsum(count) - count) / count)


def warming(time: Floats) -> Floats:
    """(N,) degC of a motor that draws a third of its usual current from 0 s on."""
    return np.asarray(AMBIENT - RISE / 3.0 * np.expm1(-time / WARMING_TIME))


def first_starts(plan: Plan, starts: Floats, *, n_joints: int) -> Floats:
    """(J,) s at which each joint's first run begins, of runs that begin at `starts`; the first of all if none."""
    out = np.full(n_joints, starts[0] if len(starts) else 0.0)
    for motion, start in zip(reversed(plan.motions), starts[::-1], strict=True):
        out[motion.joint - 1] = start
    return out
