"""An experiment from beginning to end: log, program, verdict against the truth; one flat record.

The program under test is called here and nowhere else, the way its command line calls it.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_world.case import Case, Experiment, drawn
from blind_world.hidden import Hidden, Unfit, applied
from blind_world.motion import RATE
from blind_world.world import sensed, write_experiment
from pumaid.dataset import Dataset
from pumaid.diagnosis.diagnose import diagnose
from pumaid.diagnosis.records import Diagnosis, Finding
from pumaid.errors import PumaidError
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.experiment import Experiment as Logs
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Session:
    """What the program makes of a folder: its logs read, the paper's model identified, and what it says is missing."""

    robot: Robot
    dataset: Dataset
    estimate: Estimate
    diagnosis: Diagnosis

    @classmethod
    def of_folder(cls, folder: Path) -> Session:
        """Run the program."""
        logs = Logs((str(folder / "logs"),))
        robot, dataset = logs.robot, logs.dataset()
        estimate = identify(dataset, robot)
        return cls(robot, dataset, estimate, diagnose(estimate, dataset, robot))

    @property
    def added(self) -> list[Finding]:
        """Findings that the program would add."""
        return [finding for finding in self.diagnosis.findings if finding.verdict == "add"]


def judged(case: Case) -> dict[str, Any]:
    """Run a case and score it: a line of the file of results."""
    record: dict[str, Any] = {"key": case.key, "group": case.group, "effects": list(case.effects)}
    record |= {"size": case.size, "seed": case.seed}
    try:
        experiment = drawn(case)
    except Unfit as why:
        return record | {"outcome": "skipped", "reason": str(why)}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_experiment(folder, experiment.world, sensed(experiment.world, experiment.state, experiment.noise))
        session = Session.of_folder(folder)
        return record | said(experiment, session) | heldout(experiment, session)


def names(hidden: Hidden, effect: str, joint: int | None) -> bool:
    """Whether an effect's name and joint (from 1) are the hidden one's."""
    return effect == hidden.name and (hidden.joint is None or joint == hidden.joint + 1)


def rank(hidden: Hidden, finding: Finding) -> str:
    """``first``, ``set`` (among the rivals, ``name@joint`` elsewhere) or ``no``: how a finding names the effect."""
    if names(hidden, finding.effect, finding.joint):
        return "first"
    for rival in finding.rivals:
        name, at, joint = rival.partition("@")
        if names(hidden, name, int(joint) if at and joint.isdigit() else finding.joint):
            return "set"
    return "no"


def felt(experiment: Experiment) -> list[int]:
    """Joints (from 0) whose current the hidden effects change; all where nothing is hidden."""
    joints = {joint for hidden, _ in experiment.hidden for joint in hidden.felt}
    return sorted(joints) or list(range(experiment.world.arm.n))


def said(experiment: Experiment, session: Session) -> dict[str, Any]:
    """What the program said, beside the truth."""
    added = session.added
    verdicts = {joint.joint: joint.verdict for joint in session.diagnosis.joints}
    ranks = [[rank(hidden, finding) for finding in added] for hidden, _ in experiment.hidden]
    if not added:
        outcome = "missed" if experiment.hidden else "quiet"
    else:
        outcome = {"no": "wrong"}.get(ranks[0][0], ranks[0][0]) if len(ranks) == 1 else "spoke"
    return {
        "outcome": outcome,
        "findings": [{"effect": f.effect, "joint": f.joint, "rivals": list(f.rivals)} for f in added],
        "sets": [1 + len(finding.rivals) for finding in added],
        "unexplained": bool(ranks) and any(verdicts.get(j + 1) == "unexplained" for j in felt(experiment)),
        "needless": sum(all(row[k] == "no" for row in ranks) for k in range(len(added))),
        "later": any(word != "no" for row in ranks for word in row[1:]),
        "named": sum(any(word != "no" for word in row) for row in ranks),
    }


def heldout(experiment: Experiment, session: Session) -> dict[str, Any]:
    """Error on held-out runs before and after adding what was found, over that of the true model, felt joints only."""
    best = true_rmse(experiment, session)

    def ratio(estimate: Estimate) -> float:
        errors = np.array([np.nan if joint.heldout is None else joint.heldout for joint in estimate.joints])
        return float(np.sqrt(np.nanmean(np.square(errors / best)[felt(experiment)])))

    choices = [EffectChoice(finding.effect, finding.joint, dict(finding.shape)) for finding in session.added]
    try:
        model = identify(session.dataset, session.robot, effects=choices) if choices else session.estimate
    except PumaidError as error:
        return {"before": ratio(session.estimate), "after": None, "refused": error.slug}
    return {"before": ratio(session.estimate), "after": ratio(model)}


def true_rmse(experiment: Experiment, session: Session) -> Floats:
    """(J,) A: RMSE on the program's own held-out runs of the true model, fitted with the true noise and shapes.

    The true model has no inertia either, so what a run kept of a ramp counts against it as against the program.
    """
    world, oracle = experiment.world, experiment.oracle
    measured = sensed(world, experiment.state, experiment.noise).current
    base = world.resting.current
    effects = [applied(world, [pair], world.resting).current - base for pair in experiment.hidden]
    values, amplitudes = oracle.fit(measured, effects, base)
    squares, counts = np.zeros(world.arm.n), np.zeros(world.arm.n)
    for run in session.dataset.runs:
        if not run.heldout:
            continue
        joint = run.joint - 1
        rows = np.arange(round(run.start * RATE), round((run.start + run.duration) * RATE) + 1)
        miss = (measured - base)[rows, joint] - oracle.base(joint, rows) @ values
        for amplitude, effect in zip(amplitudes, effects, strict=True):
            miss -= amplitude * effect[rows, joint]
        squares[joint] += miss @ miss
        counts[joint] += len(rows)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares / counts))
