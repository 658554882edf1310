"""From runs to parameters: the n-to-1 identification, refined over all joints, with honest uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

from pumaid.dataset import Dataset
from pumaid.estimation.identification import identified
from pumaid.estimation.system import Progress
from pumaid.records import Estimate
from pumaid.robot import EffectChoice, Robot


def identify(
    dataset: Dataset,
    robot: Robot,
    *,
    effects: Sequence[EffectChoice] | None = None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Estimate:
    """Identify the arm's parameters from runs.

    Rows are solved from the last joint to the first; then all rows are refined together. Held-out runs are left out.

    Parameters
    ----------
    dataset
        Runs of some or all joints.
    robot
        Geometry and gravity.
    effects
        Physics beyond the paper's model; the recipe's where not given. Shapes that a choice leaves open are fitted.
    recursive
        Stop after the recursion.
    progress
        Called with the joint at work (0: all) and a word on what is done.

    Returns
    -------
    estimate
        Every parameter of the minimal model and of the effects, identified or not, with standard errors clustered by
        run.

    Raises
    ------
    LogError [no-runs]
        There is no run to fit.
    ModelError [unknown-effect], [effect-joint], [effect-shape], [effect-not-here], [effect-twice]
        An effect cannot be in the model.

    Source
    ------
    S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators".
    """
    return identified(dataset, robot, effects=effects, recursive=recursive, progress=progress)
