"""An experiment from beginning to end: log, program, verdict against the truth; one flat record.

The program under test is called here and nowhere else, the way its command line calls it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_world.case import BUSY, Case, Experiment, drawn
from blind_world.hidden import Hidden, Strokes, Unfit, applied, signature
from blind_world.world import LATER, State, noises, sensed, write_experiment
from pumaid.cli.additions import added
from pumaid.dataset import Dataset
from pumaid.diagnosis.diagnose import diagnose
from pumaid.diagnosis.records import ADD, Diagnosis, Finding
from pumaid.effects import Scope, catalogue
from pumaid.estimate import Estimate
from pumaid.estimation.estimate import identify
from pumaid.estimation.evaluate import predictions, rmse
from pumaid.experiment import Experiment as Logs
from pumaid.results.documents import read_model
from pumaid.robot import Robot

Floats = NDArray[np.float64]


#: Seed, beside that of the case, of the noise when a motion is made again.
AGAIN = 7
#: Difference of two predictions, in RMSE, from which the fitted runs do not tell them.
OPEN = 0.3


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
        robot, dataset = read(folder)
        estimate = identify(dataset, robot)
        return cls(robot, dataset, estimate, diagnose(estimate, dataset, robot))

    def applied(self, folder: Path) -> tuple[Session, list[Estimate]]:
        """What stands after ``diagnose --apply``, and the model after each addition; what it refuses leaves none."""
        file, steps = folder / "results" / "model.json", dict[int, Estimate]()

        def note(_: str) -> None:
            model = read_model(file)
            steps[len(model.effects)] = model

        diagnosis, estimate = added(
            self.diagnosis,
            self.estimate,
            self.dataset,
            robot=self.robot,
            model=file,
            again=lambda model: diagnose(model, self.dataset, self.robot),
            tell=note,
        )
        steps.pop(len(self.estimate.effects), None)
        return Session(self.robot, self.dataset, estimate, diagnosis), list(steps.values())

    @property
    def added(self) -> list[Finding]:
        """Findings that the program would add."""
        return [finding for finding in self.diagnosis.findings if finding.verdict == ADD]


def read(folder: Path) -> tuple[Robot, Dataset]:
    """An experiment's arm and runs."""
    held = (str(folder / LATER),) if (folder / LATER).is_file() else ()
    logs = Logs((str(folder / "logs"),), heldout=held)
    return logs.robot, logs.dataset()


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
        last, steps = session.applied(folder)
        if case.group == BUSY:
            return record | busy(experiment, session, last, steps)
        return record | said(experiment, session) | heldout(experiment, session, last)


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
    """What the program said, beside the truth; `told` is with what it names and would not add."""
    added = session.added
    verdicts = {joint.joint: joint.verdict for joint in session.diagnosis.joints}
    outcome, ranks = named(experiment, added)
    return {
        "outcome": outcome,
        "findings": [{"effect": f.effect, "joint": f.joint, "rivals": list(f.rivals)} for f in added],
        "sets": [1 + len(finding.rivals) for finding in added],
        "unexplained": bool(ranks) and any(verdicts.get(j + 1) == "unexplained" for j in felt(experiment)),
        "later": any(word != "no" for row in ranks for word in row[1:]),
        "told": {
            "outcome": named(experiment, session.diagnosis.findings)[0],
            "sets": [1 + len(finding.rivals) for finding in session.diagnosis.findings],
        },
    }


def named(experiment: Experiment, findings: Sequence[Finding]) -> tuple[str, list[list[str]]]:
    """``first``, ``set``, ``wrong``, ``missed`` or ``quiet``, and how each finding names each hidden effect."""
    ranks = [[rank(hidden, finding) for finding in findings] for hidden, _ in experiment.hidden]
    if not findings:
        return "missed" if experiment.hidden else "quiet", ranks
    return {"no": "wrong"}.get(ranks[0][0], ranks[0][0]) if len(ranks) == 1 else "spoke", ranks


def heldout(experiment: Experiment, session: Session, last: Session) -> dict[str, Any]:
    """Error on held-out runs before and after adding what was found, over that of the true model, felt joints only."""
    ratios = np.array([joint["ratios"] for joint in joints(experiment, session, last)], dtype=float)
    before, after = np.sqrt(np.nanmean(np.square(ratios)[felt(experiment)], axis=0))
    return {"before": before, "after": after}


def joints(experiment: Experiment, session: Session, last: Session) -> list[dict[str, Any]]:
    """Each joint's verdicts before and after adding, and errors on held-out runs over the true model's."""
    out = []
    for first, ended, best in zip(
        session.diagnosis.joints, last.diagnosis.joints, true_rmse(experiment).tolist(), strict=True
    ):
        errors = [model.joint(ended.joint).heldout for model in (session.estimate, last.estimate)]
        ratios = [None if error is None or np.isnan(best) else error / best for error in errors]
        out.append({"joint": ended.joint, "first": first.verdict, "last": ended.verdict, "ratios": ratios})
    return out


def true_rmse(experiment: Experiment) -> Floats:
    """(J,) A: RMSE on the program's own held-out runs of the true model, fitted with the true noise and shapes.

    The program reads a log of what the true model leaves, so that its bins are the same; at constant speed the true
    model has no inertia either, so what a run kept of a ramp counts against it as against the program. NaN where
    held-out runs ask for what no fitted run tells: fits that start from the truth and from nothing differ there.
    """
    world, oracle = experiment.world, experiment.oracle
    measured = sensed(world, experiment.state, experiment.noise)
    base = world.resting.current
    effects = [applied(world, [pair], world.resting).current - base for pair in experiment.hidden]
    left, ignorant = (
        measured.current - modelled(experiment, effects, oracle.fit(measured.current, effects, start, about), start)
        for start, about in ((base, 1.0), (np.zeros_like(base), 0.0))
    )
    with tempfile.TemporaryDirectory() as scratch:
        write_experiment(Path(scratch), world, State(left, measured.position))
        dataset = read(Path(scratch))[1]
    squares, counts = np.zeros(world.arm.n), np.zeros(world.arm.n)
    for run in dataset.runs:
        if run.heldout:
            squares[run.joint - 1] += run.bins.count @ (run.bins.current**2 + run.bins.variance)
            counts[run.joint - 1] += run.bins.count.sum()
    with np.errstate(invalid="ignore"):
        best = np.asarray(np.sqrt(squares / counts))
    for joint in range(world.arm.n):
        rows = oracle.moving(joint)
        late = rows[~oracle.fitted[rows]]
        best[joint] *= 1.0 if np.std((left - ignorant)[late, joint]) < OPEN * best[joint] else np.nan
    return best


def modelled(experiment: Experiment, effects: list[Floats], fit: tuple[Floats, Floats], start: Floats) -> Floats:
    """(N, J) A of the true model, fitted, at the rows in which each joint moves."""
    out = start + sum((size * effect for size, effect in zip(fit[1], effects, strict=True)), np.zeros_like(start))
    for joint in range(experiment.world.arm.n):
        rows = experiment.world.rows(joint)
        out[rows, joint] += experiment.oracle.base(joint, rows) @ fit[0]
    return np.asarray(out)


def busy(experiment: Experiment, session: Session, last: Session, steps: list[Estimate]) -> dict[str, Any]:
    """Of an arm with several effects at a joint: what became of each effect, joint, finding and forecast.

    `session` is before, `last` after what was found is added, in `steps`.
    """
    findings = [*last.diagnosis.applied, *last.added]
    return {
        "outcome": "done",
        "design": experiment.case.design,
        "rate": experiment.world.campaign.rate,
        "effects": answers(experiment, findings, last.diagnosis),
        "joints": joints(experiment, session, last),
        "findings": [
            {"effect": item.effect, "joint": felt_at(item), "rivals": list(item.rivals), "shape": dict(item.shape)}
            | {"right": is_right(experiment, item)}
            for item in findings
        ],
        "forecasts": forecasts(experiment, last, steps),
    }


def forecasts(experiment: Experiment, last: Session, steps: list[Estimate]) -> list[dict[str, Any]]:
    """What was told (A, with its standard error) of each addition at one joint, and what came.

    That is in the runs that were held out, and in the same motion made again: `fresh`, with other noise.
    """
    case, world = experiment.case, experiment.world
    noise = noises(world, np.random.default_rng([case.seed, AGAIN]))
    with tempfile.TemporaryDirectory() as scratch:
        write_experiment(Path(scratch), world, sensed(world, experiment.state, noise))
        robot, again = read(Path(scratch))
    out = []
    for item, step in zip(last.diagnosis.applied, steps, strict=True):
        if item.joint and item.forecast and catalogue()[item.effect].scope is Scope.JOINT:
            prediction = predictions(step, again, robot)[item.joint]
            facts = {"effect": item.effect, "joint": item.joint, "told": item.forecast, "error": item.forecast_error}
            fresh = rmse([(prediction, prediction.heldout)])
            out.append(facts | {"came": step.joint(item.joint).heldout, "fresh": fresh})
    return out


def answer(experiment: Experiment, hidden: Hidden, finding: Finding) -> str:
    """As `rank`; ripples are the same within 2 % or 0.4 of what the joint's span resolves."""
    word, waves = rank(hidden, finding), hidden.shape.get("frequency")
    if word == "first" and waves is not None and hidden.joint is not None:
        span = float(np.ptp(Strokes(experiment.world, hidden.joint).q))
        near = max(0.02 * waves, 0.8 * np.pi / span)
        return "first" if abs(finding.shape["frequency"] - waves) < near else "no"
    return word


def felt_at(finding: Finding) -> int | None:
    """Joint whose current the effect changes, None for the whole arm."""
    return int(finding.shape["on"]) if "on" in finding.shape else finding.joint


def is_right(experiment: Experiment, finding: Finding) -> bool:
    """Whether it, or a rival of it, is hidden there."""
    return any(answer(experiment, hidden, finding) != "no" for hidden, _ in experiment.hidden)


def answers(experiment: Experiment, findings: list[Finding], last: Diagnosis) -> list[dict[str, Any]]:
    """Of each hidden effect: joint (from 1) where it is felt, size over its limit, how it was named.

    ``right``, ``pair`` (in a set of two), ``set``, ``wrong`` (another effect is named there alone) or ``missed``; and
    whether it is above its limit: the stated one, and at least twice our own where none is stated in its unit.
    """
    world, oracle = experiment.world, experiment.oracle
    shares = [signature(world, oracle, *pair) for pair in experiment.hidden]
    multiples = oracle.multiples(shares, [hidden.freedoms for hidden, _ in experiment.hidden])
    alone = [item for item in findings if not item.rivals and item.effect != "curve"]  # which names no effect
    false = {felt_at(item) for item in alone if not is_right(experiment, item)}
    out = []
    for (hidden, amplitude), multiple in zip(experiment.hidden, multiples, strict=True):
        felt = hidden.felt[0] + 1
        words = [(answer(experiment, hidden, item), len(item.rivals)) for item in findings]
        sets = [rivals for word, rivals in words if word != "no"]
        if sets:
            how = "right" if ("first", 0) in words else "pair" if min(sets) <= 1 else "set"
        else:
            how = "wrong" if felt in false else "missed"
        limits = {limit.unit: limit.size for limit in last.joints[felt - 1].limits if limit.effect == hidden.name}
        stated = limits.get(hidden.unit)
        above = amplitude > stated if stated else multiple >= 2.0
        out.append(
            {"effect": hidden.name, "joint": felt, "multiple": multiple, "amplitude": amplitude, "answer": how}
            | {"inside": hidden.name in catalogue(), "above": bool(above), "shape": dict(hidden.shape)}
        )
    return out
