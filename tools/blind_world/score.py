"""An experiment from beginning to end: log, program, verdict against the truth; one flat record."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind_world import program
from blind_world.case import Case, Experiment, drawn
from blind_world.hidden import Hidden, Unfit, applied
from blind_world.logs import write_experiment
from blind_world.motion import RATE
from blind_world.world import sensed

Floats = NDArray[np.float64]

#: Share of the truth that an equivalent must reproduce, and the noise at which that is measured.
EQUIVALENT, QUIET = 0.9, 0.1


def judged(case: Case, *, on_command_line: bool = False) -> dict[str, Any]:
    """Run a case and score it: a line of the file of results. On the command line, too, it must say the same."""
    record: dict[str, Any] = {
        "key": case.key,
        "group": case.group,
        "effects": list(case.effects),
        "arm": case.kind,
        "size": case.size,
        "seed": case.seed,
    }
    begun = time.process_time()
    try:
        experiment = drawn(case)
    except Unfit as why:
        return record | {"outcome": "skipped", "reason": str(why)}
    seconds = {"simulate": time.process_time() - begun}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        begun = time.process_time()
        write_experiment(folder, experiment.world, sensed(experiment.world, experiment.state, experiment.noise))
        seconds["write"] = time.process_time() - begun
        begun = time.process_time()
        session = program.opened(folder)
        seconds["identify"] = time.process_time() - begun
        begun = time.process_time()
        diagnosis = program.diagnosed(session)
        seconds["diagnose"] = time.process_time() - begun
        begun = time.process_time()
        record |= _told(experiment) | _said(experiment, diagnosis) | _after(experiment, session, diagnosis)
        if record["outcome"] == "wrong" and case.group != "pair":
            record |= _reproduced(experiment, diagnosis)
        seconds["score"] = time.process_time() - begun
        if on_command_line:
            told = [(one["effect"], one["joint"], one["verdict"]) for one in program.on_the_command_line(folder)]
            record["same_on_command_line"] = told == [(f.effect, f.joint, f.verdict) for f in diagnosis.findings]
    return record | {"seconds": {name: round(value, 2) for name, value in seconds.items()}}


def _told(experiment: Experiment) -> dict[str, Any]:
    """The truth, for the record."""
    truth = [
        {
            "effect": hidden.name,
            "joint": None if hidden.joint is None else hidden.joint + 1,
            "amplitude": amplitude,
            "unit": hidden.unit,
            "share_of_largest": amplitude / hidden.largest,
            "noncentrality": reached,
            "shape": {name: float(value) for name, value in hidden.shape.items()},
        }
        for (hidden, amplitude), reached in zip(experiment.hidden, experiment.noncentrality, strict=True)
    ]
    return {"truth": truth}


def _added(diagnosis: Any) -> list[Any]:
    return [finding for finding in diagnosis.findings if finding.verdict == "add"]


def names(hidden: Hidden, effect: str, joint: int | None) -> bool:
    """Whether an effect's name and joint (from 1) are the hidden one's."""
    return effect == hidden.name and (hidden.joint is None or joint == hidden.joint + 1)


def rank(hidden: Hidden, finding: Any) -> str:
    """``first``, ``set`` (among the rivals, ``name@joint`` elsewhere) or ``no``: how a finding names the effect."""
    if names(hidden, finding.effect, finding.joint):
        return "first"
    for rival in finding.rivals:
        name, at, joint = rival.partition("@")
        if names(hidden, name, int(joint) if at and joint.isdigit() else finding.joint):
            return "set"
    return "no"


def _said(experiment: Experiment, diagnosis: Any) -> dict[str, Any]:
    added = _added(diagnosis)
    findings = [
        {"effect": f.effect, "joint": f.joint, "rivals": list(f.rivals), "p": f.p_value, "verdict": f.verdict}
        for f in diagnosis.findings
    ]
    verdicts = {one.joint: one.verdict for one in diagnosis.joints}
    ranks = [[rank(hidden, finding) for finding in added] for hidden, _ in experiment.hidden]
    felt = {joint + 1 for hidden, _ in experiment.hidden for joint in hidden.felt}
    said = {
        "findings": findings,
        "verdicts": [verdicts.get(joint + 1, "") for joint in range(experiment.world.arm.n)],
        "sets": [1 + len(finding.rivals) for finding in added],
        "unexplained": any(verdicts.get(joint) == "unexplained" for joint in felt),
        "needless": sum(all(row[k] == "no" for row in ranks) for k in range(len(added))),
        "later": bool(ranks) and any(one != "no" for row in ranks for one in row[1:]),
        "named": [("first" if "first" in row else "set" if "set" in row else "no") for row in ranks],
    }
    if not added:
        return said | {"outcome": "missed" if experiment.hidden else "quiet"}
    if len(ranks) == 1:
        return said | {"outcome": {"first": "first", "set": "set", "no": "wrong"}[ranks[0][0]]}
    return said | {"outcome": "spoke"}


def _after(experiment: Experiment, session: program.Session, diagnosis: Any) -> dict[str, Any]:
    """Error on held-out runs before and after adding what was found, over that of the true model, felt joints only."""
    felt = sorted({joint for hidden, _ in experiment.hidden for joint in hidden.felt}) or range(experiment.world.arm.n)
    best = true_rmse(experiment, session)[list(felt)]
    before = program.heldout_rmse(session.estimate)[list(felt)]
    out: dict[str, Any] = {"before": _ratio(before, best)}
    added = _added(diagnosis)
    if not added:
        return out | {"after": out["before"]}
    model = program.with_effects(session, added)
    if isinstance(model, str):
        return out | {"after": None, "refused": model}
    return out | {"after": _ratio(program.heldout_rmse(model)[list(felt)], best)}


def _ratio(error: Floats, best: Floats) -> float:
    """Root mean square over joints of error in units of the best possible."""
    return float(np.sqrt(np.nanmean(np.square(error / best))))


def true_rmse(experiment: Experiment, session: program.Session) -> Floats:
    """(J,) A: RMSE on the program's own held-out runs of the true model, fitted with the true noise and shapes.

    The true model has no inertia either, so what a run kept of a ramp counts against it as against the program.
    """
    world, oracle = experiment.world, experiment.oracle
    measured = sensed(world, experiment.state, experiment.noise).current
    base = world.resting.current
    effects = [applied(world, [pair], world.resting).current - base for pair in experiment.hidden]
    values, amplitudes = oracle.fit(measured, effects, base)
    squares, counts = np.zeros(world.arm.n), np.zeros(world.arm.n)
    for joint, first, last in program.heldout_spans(session):
        rows = _rows(first, last)
        miss = (measured - base)[rows, joint] - oracle.base(joint, rows) @ values
        miss -= sum((a * one[rows, joint] for a, one in zip(amplitudes, effects, strict=True)), np.zeros(len(rows)))
        squares[joint] += miss @ miss
        counts[joint] += len(rows)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares / counts))


def _rows(first: float, last: float) -> NDArray[np.int64]:
    """Rows of the log from one instant (s) to another."""
    return np.arange(round(first * RATE), round(last * RATE) + 1)


def _reproduced(experiment: Experiment, diagnosis: Any) -> dict[str, Any]:
    """Share of what the base model lacks that the findings reproduce, measured on a log with hardly any noise."""
    world = replace(experiment.world, noise=replace(experiment.world.noise, step=1e-6))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_experiment(folder, world, sensed(world, experiment.state, QUIET * experiment.noise))
        session = program.opened(folder)
        model = program.with_effects(session, _added(diagnosis))
        if isinstance(model, str):
            return {"reproduced": None}
        felt = sorted({joint for hidden, _ in experiment.hidden for joint in hidden.felt})
        floor = _quiet(experiment)[felt]
        left = np.square(program.fitted_rmse(model)[felt]) / floor - 1.0
        lacking = np.square(program.fitted_rmse(session.estimate)[felt]) / floor - 1.0
    share = 1.0 - float(np.sum(left) / np.sum(lacking))
    return {"reproduced": round(share, 3), "equivalent": share >= EQUIVALENT}


def _quiet(experiment: Experiment) -> Floats:
    """(J,) A2: mean square of the reduced noise in fitted runs."""
    rows = experiment.oracle.joints
    return np.array([np.mean(np.square(QUIET * experiment.noise[own, joint])) for joint, own in enumerate(rows)])
