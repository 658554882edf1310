"""Runs of one joint that leave what a test says, noise like that of real motors on top."""

from collections.abc import Callable, Sequence

import numpy as np
import worlds
from scipy.signal import lfilter

from pumaid.dataset import Run
from pumaid.diagnosis.compare import budget
from pumaid.estimation.evaluate import Budget
from pumaid.joint_bins import joint_bins

#: A: noise of a sample, correlated by `PHI` from one to the next, and level of a run.
NOISE, LEVEL, PHI = 0.02, 0.01, 0.8

#: What is left (A) at position, velocity, time since the run began, s on the clock, position of the other joint.
Left = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]


def nothing(q, qd, since, clock, other):
    """Noise alone."""
    return np.zeros(len(q))


def campaign(
    left: Left = nothing,
    *,
    seed: int = 0,
    others: Sequence[float] = (0.0, 1.0),
    speeds: Sequence[float] = (0.2, 0.4, 0.8, 1.2),
    ways: Sequence[int] = (1, -1),
    repeats: int = 2,
    kind: str = "constant",
    noise: float = 1.0,
    samples: int = 300,
) -> tuple[Run, ...]:
    """Runs of joint 2 of the pendulum over 4 rad, in random order, one a minute."""
    rng = np.random.default_rng(seed)
    plan = [(other, speed, way) for _ in range(repeats) for other in others for speed in speeds for way in ways]
    out = []
    for number, place in enumerate(rng.permutation(len(plan))):
        other, speed, way = plan[place]
        since, q, qd, qdd = worlds.course(kind, -2.0 * way, 2.0 * way, duration=4.0 / speed, samples=samples)
        clock = 60.0 * number + since
        white = rng.standard_normal(samples) * np.sqrt(1.0 - PHI**2)
        error = noise * (NOISE * lfilter([1.0], [1.0, -PHI], white) + LEVEL * rng.standard_normal())
        current = left(q, qd, since, clock, other) + error
        course = (clock, q, qd, qdd)
        out.append(worlds.run_of(worlds.PENDULUM, 2, [other, 0.0], course=course, current=current, bins=150))
    return tuple(out)


def split(runs: Sequence[Run], **more) -> Budget:
    """The budget of what these runs hold, nothing being predicted."""
    laid = joint_bins(worlds.PENDULUM, runs, is_settled=False)[0]
    return budget(laid, laid.current, worlds.PENDULUM.joint(2), **{"is_fitted": False, **more})


def shares(budget: Budget) -> dict[str, float]:
    """Part -> share of the mean square."""
    return {part.name: part.mean_square / budget.mean_square for part in budget.parts}


def found(budget: Budget) -> dict[str, tuple[str, ...]]:
    """Part -> what it depends on, of what is more than noise."""
    return {part.name: part.against for part in budget.parts if part.is_more}
