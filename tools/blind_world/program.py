"""The program under test, called the way its command line calls it; nothing else here imports it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset
from pumaid.diagnosis.records import Diagnosis, Finding
from pumaid.errors import PumaidError
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.experiment import Experiment
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Session:
    """One folder, read and identified."""

    folder: Path
    robot: Robot
    dataset: Dataset
    estimate: Estimate


def opened(folder: Path) -> Session:
    """Read the folder's logs and identify the paper's model."""
    experiment = Experiment((str(folder / "logs"),))
    robot, dataset = experiment.robot, experiment.dataset()
    return Session(folder, robot, dataset, identify(dataset, robot))


def diagnosed(session: Session) -> Diagnosis:
    """What the program says is missing."""
    from pumaid.diagnosis.diagnose import diagnose

    return diagnose(session.estimate, session.dataset, session.robot)


def with_effects(session: Session, findings: Sequence[Finding]) -> Estimate | str:
    """The model with what was found added, in its shapes, and all refitted, or why the program refuses."""
    choices = [EffectChoice(finding.effect, finding.joint, dict(finding.shape)) for finding in findings]
    try:
        return identify(session.dataset, session.robot, effects=choices)
    except PumaidError as error:
        return error.slug


def heldout_rmse(estimate: Estimate) -> Floats:
    """(J,) A: RMSE of every joint's held-out runs; NaN without any."""
    return np.array([np.nan if joint.heldout is None else joint.heldout for joint in estimate.joints])


def heldout_spans(session: Session) -> list[tuple[int, float, float]]:
    """Joint (from 0), first and last time (s) of every held-out run that the program found."""
    return [(run.joint - 1, run.start, run.start + run.duration) for run in session.dataset.runs if run.heldout]


def fitted_rmse(estimate: Estimate) -> Floats:
    """(J,) A: RMSE of every joint's fitted runs."""
    return np.array([np.nan if joint.rmse is None else joint.rmse for joint in estimate.joints])


def on_the_command_line(folder: Path) -> list[dict[str, Any]]:
    """Findings as the two commands tell them that a user types in the experiment's folder."""
    program = [sys.executable, "-m", "pumaid"]
    subprocess.run([*program, "identify", "logs"], cwd=folder, check=True, capture_output=True)
    done = subprocess.run(
        [*program, "diagnose", "results/model.json", "logs", "--json"], cwd=folder, check=True, capture_output=True
    )
    return list(json.loads(done.stdout)["findings"])
