"""An experiment rehearsed on a virtual robot: what diagnosis would have to go by before anything was run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import Dataset, Run
from pumaid.errors import ModelError
from pumaid.estimation.fit import Fit, loaded
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import COARSE, joint_bins
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot
from pumaid.simulation import Bench
from pumaid.simulation.hidden import LAWS, Hidden, sized
from pumaid.simulation.truth import Truth
from pumaid.trajectory import Plan

#: Samples a second and bins a run of the rehearsal.
_RATE, _CELLS = 50.0, 60


def rehearsed(truth: Truth, plan: Plan, *, seed: int) -> Dataset:
    """Runs of a plan as a virtual robot would make them, those for judging left out.

    Parameters
    ----------
    truth
        The robot.
    plan
        Its motions.
    seed
        Of the noise.
    """
    fitted = replace(plan, motions=tuple(motion for motion in plan.motions if motion.purpose == "fit"))
    return Dataset(Bench(truth, fitted, rate=_RATE, bins=_CELLS).runs(np.random.default_rng([seed, 5])))


def solved(robot: Robot, runs: Sequence[Run]) -> Fit:
    """The base model on runs, as diagnosis starts from it.

    Parameters
    ----------
    robot
        The arm.
    runs
        All that may be fitted.
    """
    model = Model.of_runs(robot, runs)
    return loaded(fit_with_replicates(model, joint_bins(robot, runs, most=COARSE)))


def usual(truth: Truth, wanted: EffectChoice) -> Hidden | None:
    """An effect with sizes that show at a robot and do not rule it.

    None where the virtual robot has no such effect, or nothing of the kind at that joint: no weight, unknown masses.

    Parameters
    ----------
    truth
        The robot.
    wanted
        Effect, joint, and shapes that are given.
    """
    if wanted.effect not in LAWS:
        return None
    try:
        found = sized([Hidden(wanted.effect, wanted.joint, dict(wanted.shape))], truth)
    except ModelError:
        return None
    return found[0]
