"""Repeated experiments on a virtual robot without logs, for statistics of many of them; and a fit of its runs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import Run
from pumaid.estimation.fit import Fit
from pumaid.estimation.gls import fit_bins, refit
from pumaid.estimation.noise import noise_of
from pumaid.joint_bins import JointBins
from pumaid.maths import Counts, Floats
from pumaid.model import Model
from pumaid.simulation import Truth, constant_run
from pumaid.simulation.hidden_effects import AMBIENT, RISE, WARMING_TIME, ArmState, delays
from pumaid.simulation.session import first_starts
from pumaid.trajectory import Plan, trapezoids

#: Fewest samples at constant speed that say anything of a run's three regressors and its noise.
FEWEST = 8


class Bench:
    """One experiment on one virtual robot, prepared once, made as often as wanted.

    Positions are exact and the runs are cut where the speed is constant; only the currents' noise differs between
    experiments. `rate` is in samples a second; a run has at most so many `bins`.

    """

    def __init__(self, truth: Truth, plan: Plan, *, rate: float = 100.0, bins: int = 60) -> None:
        self.truth, self.plan, self.rate = truth, plan, rate
        steps = list(trapezoids(truth.robot, plan))
        movements = [step for step in steps if step.motion is not None]
        begins = np.cumsum([0.0, *(step.seconds for step in steps)])[:-1] + [step.lead for step in steps]
        starts = begins[[step.motion is not None for step in steps]]
        first_run = first_starts(plan, starts, n_joints=truth.robot.n_joints)
        late = delays(truth.hidden, truth.robot.n_joints)
        self._runs: list[Run] = []
        self._currents: list[Floats] = []
        for movement, start in zip(movements, starts.tolist(), strict=True):
            first, last = movement.cruise
            local = np.arange(np.ceil(first * rate), np.floor(last * rate) + 1) / rate
            assert len(local) >= FEWEST, "a run is too short to say anything of its regressors and its noise"
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
            mean, square = means(noisy, run.bins.count), means(noisy**2, run.bins.count)
            out.append(replace(run, bins=replace(run.bins, current=mean, variance=np.maximum(square - mean**2, 0.0))))
            first += run.samples
        return tuple(out)


def means(values: Floats, count: Counts) -> Floats:
    """Means over stretches of `count` values, one after the other."""
    return np.asarray(np.add.reduceat(values, np.cumsum(count) - count) / count)


def warming(time: Floats) -> Floats:
    """(N,) degC of a motor that draws a third of its usual current from 0 s on."""
    return np.asarray(AMBIENT - RISE / 3.0 * np.expm1(-time / WARMING_TIME))


def fit_with_replicates(model: Model, bins: Sequence[JointBins]) -> Fit:
    """A fit weighted by what repeated runs differ by, where there are enough of them, as tests of effects need it."""
    first = fit_bins(model, bins)
    return refit(first, model, noise={row.bins.joint: noise_of(row.bins, row.misfit) for row in first.joints})
