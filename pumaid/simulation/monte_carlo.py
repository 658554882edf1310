"""Runs without logs: many noisy repeats of one experiment, fast enough for statistics over hundreds of them."""

from dataclasses import replace

import numpy as np

from pumaid.dataset import Bins, Run
from pumaid.errors import ModelError, Where
from pumaid.maths import Counts, Floats
from pumaid.simulation.hidden_effects import AMBIENT, RISE, WARMING_TIME, ArmState, delays
from pumaid.simulation.virtual_robot import Truth
from pumaid.trajectory import Plan, Trapezoid, run_times, trapezoids

#: Fewest samples at constant speed that say anything of a run's three regressors and its noise.
_FEWEST = 8


class Bench:
    """One experiment on one virtual robot, prepared once, made as often as wanted.

    Positions are exact and the runs are cut where the speed is constant; only the currents' noise differs between
    experiments. `rate` is in samples a second; a run has at most so many `bins`.

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
        first_run = first_starts(plan, starts, n_joints=truth.robot.n_joints)
        late = delays(truth.hidden, truth.robot.n_joints)
        self._runs: list[Run] = []
        self._currents: list[Floats] = []
        movements = [movement for movement in trapezoids(truth.robot, plan) if movement.motion is not None]
        for movement, start in zip(movements, starts.tolist(), strict=True):
            first, last = movement.cruise
            local = np.arange(np.ceil(first * rate), np.floor(last * rate) + 1) / rate
            if len(local) < _FEWEST:
                joint = movement.motion.joint if movement.motion else None
                what = f"a run of joint {joint} keeps its speed for {len(local)} samples only (at {rate:g} Hz)"
                mend = "widen its span, lower its velocity or raise the rate"
                raise ModelError("run-too-short", what, Where(joint=joint), mend)
            edges = np.linspace(0, len(local), max(1, min(bins, len(local) // 2)) + 1).astype(np.int64)
            run = constant_run(movement, local, np.diff(edges), start=start, first_row=self.samples + 2)
            if truth.hides("thermal_friction"):
                warm = warming(run.bins.time)
                run = replace(run, temperature=float(warm.mean()), bins=replace(run.bins, temperature=warm))
            self._runs.append(run)
            position, velocity = movement.at(local)
            j = run.joint - 1
            position[:, j] -= velocity[:, j] * late[j]
            travel = np.zeros_like(position)
            travel[:, j] = np.abs(position[:, j] - float(movement.start[j]))
            warmed = np.tile(warming(start + local)[:, None], truth.robot.n_joints)
            at = ArmState(start + local, first_run, position, velocity, np.zeros_like(position), travel, warmed)
            self._currents.append(truth.current(run.joint, at))

    @property
    def samples(self) -> int:
        """Samples of one experiment, all runs together."""
        return sum(run.samples for run in self._runs)

    def runs(self, rng: np.random.Generator) -> tuple[Run, ...]:
        """The runs of one more experiment, noise and levels drawn from `rng`."""
        noise = self.truth.noise
        errors = noise.series(rng, (self.samples,), rate=self.rate, start=rng.standard_normal())
        levels = rng.standard_normal(len(self._runs))
        out, first = [], 0
        for run, current, level in zip(self._runs, self._currents, levels, strict=True):
            j, error = run.joint - 1, errors[first : first + run.samples]
            noisy = current + (noise.sample_std[j] * error + noise.level_std[j] * level)
            mean, square = _means(noisy, run.bins.count), _means(noisy**2, run.bins.count)
            out.append(replace(run, bins=replace(run.bins, current=mean, variance=np.maximum(square - mean**2, 0.0))))
            first += run.samples
        return tuple(out)


def constant_run(movement: Trapezoid, local: Floats, count: Counts, *, start: float = 0.0, first_row: int = 2) -> Run:
    """The run that a movement leaves which begins at `start` s, without currents and temperatures.

    It is sampled at `local` (N,) s from its start, `count` (M,) of the samples being in each bin.
    """
    motion, position = movement.motion, movement.at(local)[0]
    assert motion is not None, "a move between postures is no run"
    j, speed = motion.joint - 1, movement.peak * float(np.sign(motion.end - motion.start))
    time, nothing = _means(start + local, count), np.zeros(len(count))
    posture = np.array(motion.hold, dtype=float)
    mean_position = np.tile(posture, (len(count), 1))
    mean_position[:, j] = _means(position[:, j], count)
    posture[j] = np.nan
    speeds, unknown = np.full(len(count), speed), np.full(len(count), np.nan)
    return Run(
        joint=motion.joint,
        kind="constant",
        origin="bench",
        first_row=first_row,
        last_row=first_row + len(local) - 1,
        start=float(time[0]),
        duration=float(time[-1] - time[0]),
        posture=posture,
        span=(float(position[0, j]), float(position[-1, j])),
        speed=speed,
        ripple=0.0,
        temperature=np.nan,
        samples=len(local),
        bins=Bins(count, time, mean_position, speeds, nothing, nothing, nothing, unknown),
        heldout=motion.purpose == "heldout",
    )


def _means(values: Floats, count: Counts) -> Floats:
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
