"""Small experiments for tests of the diagnosis: noise known to the bin, and slow dense algebra to check with.

Positions, gravity, friction and hidden physics come from `simulation`; noise is made here, bin by bin, so that a
test knows its correlation, its spread and its runs' levels, and can make it heavy-tailed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from monte_carlo import Bench
from scipy.signal import lfilter
from worlds import PENDULUM, TURN, arm

from pumaid.dataset import Dataset, Run
from pumaid.effect_spec import EffectTerm
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.estimation.fit import Fit, loaded
from pumaid.estimation.gls import fit_bins, refit
from pumaid.estimation.noise import NoiseModel, noise_of
from pumaid.joint_bins import COARSE, JointBins, joint_bins
from pumaid.model import Model
from pumaid.robot import Robot
from pumaid.simulation import Hidden, Truth, draw
from pumaid.trajectory import Motion, Plan

#: One level axis: its diagnosis is plain linear least squares.
LEVER = arm("R", [TURN])
SPEEDS = (0.25, 0.5, 1.0, 1.5)


def design(
    robot: Robot,
    joints: Sequence[int] | None = None,
    *,
    postures: int = 2,
    speeds: Sequence[float] = SPEEDS,
    ways: Sequence[float] = (1.0, -1.0),
    repeats: int = 2,
    reach: float = 1.8,
    seed: int = 0,
) -> Plan:
    """Each joint in random postures at these speeds (rad/s) over -reach..reach (rad), repeats in random order."""
    rng, once = np.random.default_rng(seed), []
    for joint in joints or range(1, robot.n_joints + 1):
        for _ in range(postures):
            hold = tuple(rng.uniform(-1.5, 1.5, robot.n_joints).tolist())
            once += [Motion(joint, hold, -way * reach, way * reach, speed) for speed in speeds for way in ways]
    return Plan(robot.name, tuple(once[k] for _ in range(repeats) for k in rng.permutation(len(once))))


@dataclass(frozen=True)
class Din:
    """Noise of bins: A of a bin, correlation of neighbours, A of a run's level; normal, or Student's t of 3."""

    spread: float = 0.01
    correlation: float = 0.5
    level: float = 0.005
    is_heavy: bool = False

    def draw(self, rng: np.random.Generator, lengths: Sequence[int]) -> np.ndarray:
        """(N,) A over runs of these lengths, bin after bin."""
        parts = []
        for count in lengths:
            shocks = rng.standard_t(3, count + 1) / np.sqrt(3.0) if self.is_heavy else rng.standard_normal(count + 1)
            shocks[1:count] *= np.sqrt(1.0 - self.correlation**2)
            course = lfilter([1.0], [1.0, -self.correlation], shocks[:count])
            parts.append(self.spread * course + self.level * shocks[-1])
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class Lab:
    """One experiment on one virtual arm, made as often as wanted with other noise."""

    truth: Truth
    runs: tuple[Run, ...]
    estimate: Estimate
    model: Model

    @classmethod
    def of(cls, robot: Robot, plan: Plan, *hidden: Hidden, seed: int = 5, bins: int = 64) -> Lab:
        """The arm that `seed` draws, what hides in it, and its fit (of the base model, without noise)."""
        truth = draw(robot, seed).with_noise(0.0)
        truth = truth.hiding(hidden) if hidden else truth
        runs = Bench(truth, plan, rate=100.0, bins=bins).runs(np.random.default_rng(0))
        estimate = identify(Dataset(runs), robot)
        return cls(truth, runs, estimate, Model(robot))

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.truth.robot

    def noisy(self, seed: int, din: Din = Din()) -> tuple[Run, ...]:
        """The runs with one more draw of noise in their bins."""
        rng = np.random.default_rng(seed)
        return tuple(with_current(run, din.draw(rng, [len(run.bins)])) for run in self.runs)

    def bins(self, runs: Sequence[Run] | None = None) -> tuple[JointBins, ...]:
        """The bins of each joint."""
        return joint_bins(self.robot, self.runs if runs is None else runs, most=COARSE)

    def fitted(
        self, runs: Sequence[Run], added: Sequence[EffectTerm] = (), noises: Mapping[int, NoiseModel] | None = None
    ) -> Fit:
        """The base model with `added`, fitted to the bins and weighted by what repeated runs differ by."""
        model = self.model.with_effects([term.searched(self.robot) for term in added])
        first = refit(fit_bins(self.model, self.bins(runs)), model, noise=noises)
        if noises is None:
            noises = {row.bins.joint: noise_of(row.bins, row.misfit) for row in first.joints}
        sized = [replace(t, sizes=tuple(first.sizes(place).tolist())) for place, t in enumerate(model.effects)]
        return loaded(refit(first, model.with_effects(sized), noise=noises))


def with_current(run: Run, more: np.ndarray) -> Run:
    """The run with `more` (M,) A in the bins of its moving joint."""
    return replace(run, bins=replace(run.bins, current=run.bins.current + more))


@cache
def lever() -> Lab:
    """One joint, 32 runs."""
    return Lab.of(LEVER, design(LEVER))


@cache
def pendulum() -> Lab:
    """Two joints, the inner one lifting the outer, 72 runs."""
    return Lab.of(PENDULUM, design(PENDULUM, postures=3, speeds=(0.3, 0.6, 1.2)))


def covariances(bins: JointBins, noise: NoiseModel) -> list[np.ndarray]:
    """Of each run, the covariance (A2) that `noise` states."""
    lags = [np.abs(np.subtract.outer(np.arange(length), np.arange(length))) for length in bins.lengths]
    parts = zip(lags, noise.spread, noise.correlation, noise.level, strict=True)
    return [spread**2 * correlation**lag + level**2 for lag, spread, correlation, level in parts]


def roots(bins: JointBins, noise: NoiseModel) -> list[np.ndarray]:
    """Of each run, the inverse of the Cholesky factor of its covariance."""
    return [np.linalg.inv(np.linalg.cholesky(stated)) for stated in covariances(bins, noise)]


def whitened(bins: JointBins, noise: NoiseModel, values: np.ndarray) -> np.ndarray:
    """Values times these roots, run by run."""
    parts = np.split(values, bins.first[1:])
    return np.concatenate([root @ part for root, part in zip(roots(bins, noise), parts, strict=True)])


def left(columns: np.ndarray, target: np.ndarray) -> float:
    """Square that least squares leaves, by a singular value decomposition of scaled columns."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0] / size[size > 0]
    return float(np.sum((target - unit @ np.linalg.lstsq(unit, target, rcond=1e-11)[0]) ** 2))


def stacked(solved: Fit, added: EffectTerm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every joint's derivatives, a candidate's columns and the residuals, whitened by dense algebra."""
    parts = []
    for row in solved.joints:
        columns = added.linear(solved.model.robot, row.bins.samples)
        plain = np.column_stack([row.bare, columns, row.misfit])
        parts.append(whitened(row.bins, row.noise, plain))
    whole, width = np.vstack(parts), len(solved.inverse)
    return whole[:, :width], whole[:, width:-1], whole[:, -1]
