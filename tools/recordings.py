"""Public recordings read as a user reads them: the folder, a recipe for each, and smaller models to compare with."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from published_loads import G

from pumaid.cli.reading import read_dataset
from pumaid.dataset import Dataset
from pumaid.io.recipe import shipped_recipes
from pumaid.model import Model
from pumaid.records import Comparison, Estimate
from pumaid.robot import Robot
from pumaid.verbs.compare import compare
from pumaid.verbs.identify import identify

#: Effects of the smaller models that the full one has to beat.
SMALLER = {
    "friction only": ("coulomb", "viscous"),
    "friction and inertia": ("coulomb", "viscous", "inertia"),
    "gravity only": ("gravity",),
    "gravity and inertia": ("gravity", "inertia"),
}

#: Log blocks that go behind a shipped recipe.
LOG_BLOCKS = {
    "ur3e": """log:
  time: timestamp
  position: "actual_q_{joint0}"
  velocity: "actual_qd_{joint0}"
  current: "actual_current_{joint0}"
""",
    "kinova_gen3": """log:
  time: Time
  position: "Position{joint}"
  velocity: "Velocity{joint}"
  current: "Cur{joint}"
  temperature: "Temp{joint}"
  units: {time: ms}
""",
    "pendulum2": """log: {time: time, position: "pos{joint}", velocity: "vel{joint}", current: "tau{joint}"}
""",
    "staubli_tx40": "",
}

#: The smaller models leave at nothing what moves the regressors by less than this (RMS, share of g, of 1 rad/s or of
#: 1 rad/s2): held positions that creep by a few mrad do not make a second posture.
OPEN = 0.01

#: A recipe of one joint whose axis stands upright: a bare motor on a bench.
MOTOR = """name: motor on a bench
gravity: [0.0, 0.0, -9.80665]
joints:
  - {name: motor, type: revolute, theta: 0, alpha: 0, a: 0.0, d: 0.0}
log: {time: Time, position: Position, velocity: Velocity, current: Iq}
"""


def folder() -> Path:
    """Where the recordings are: ``PUMAID_REAL_DATA``, else ``shared/data`` beside the checkout; it may be absent."""
    return Path(os.environ.get("PUMAID_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data")


def write_recipe(name: str, scratch: Path) -> Path:
    """Write the recipe for an arm's recordings (a shipped recipe's name, or ``motor``) into `scratch`."""
    text = MOTOR if name == "motor" else shipped_recipes()[name].read_text(encoding="utf-8") + LOG_BLOCKS[name]
    path = scratch / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def read(name: str, files: Sequence[Path], scratch: Path) -> tuple[Robot, Dataset]:
    """The recordings `files` in one pass, by the recipe called `name`."""
    return read_dataset([str(file) for file in files], write_recipe(name, scratch))


def held_out(dataset: Dataset, runs: Sequence[int]) -> Dataset:
    """The same evidence with `runs` (numbers from 1, in order of time) kept from the fit."""
    return replace(
        dataset,
        runs=tuple(replace(run, heldout=number in runs) for number, run in enumerate(dataset.runs, start=1)),
    )


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """What the full model and the smaller ones make of the same evidence; comparisons by the model's name."""

    estimate: Estimate
    scores: dict[str, Comparison]


def trial(dataset: Dataset, robot: Robot, joint: int, *, judged: Dataset | None = None) -> Trial:
    """Fit all models to the runs of `dataset` that are not held out; score them on `judged` (default: the same).

    The smaller models are least squares on the full model's own columns of these effects, and right for `joint` only.
    """
    estimate = identify(dataset, robot)
    model = Model.of_estimate(robot, estimate)
    fitted = [run for run in dataset.runs if run.joint == joint and not run.heldout]
    blocks = model.blocks(fitted)
    regressors = np.vstack([block.regressors for block in blocks])
    target = np.concatenate([block.target for block in blocks])
    size = np.array([G if column.effect == "gravity" else 1.0 for column in model.columns])
    samples = sum(run.samples for run in fitted)
    seen = dataset if judged is None else judged
    scores = {"pumaid": compare(estimate, seen, robot)}
    for name, effects in SMALLER.items():
        own = np.array([column.effect in effects for column in model.columns])
        small = _with(estimate, _least_squares(regressors * own, target, size=size, samples=samples))
        scores[name] = compare(small, seen, robot)
    return Trial(estimate, scores)


def _least_squares(
    regressors: NDArray[np.float64], target: NDArray[np.float64], *, size: NDArray[np.float64], samples: int
) -> NDArray[np.float64]:
    """(p,) of least squares on columns divided by their `size`, smallest where the data leave it open."""
    left, singular, right = np.linalg.svd(regressors / size, full_matrices=False)
    kept = singular > OPEN * np.sqrt(samples)
    return np.asarray(right[kept].T @ ((left[:, kept].T @ target) / singular[kept]) / size)


def _with(estimate: Estimate, solution: NDArray[np.float64]) -> Estimate:
    """The estimate with other parameters, in units of the one joint that they are right for."""
    return replace(estimate, solution=solution, scales=np.triu(np.ones_like(estimate.scales)))
