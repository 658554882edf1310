"""Stories for tests of tables, figures and pages: a small arm, its model, and how the model does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import worlds

import pumaid
from pumaid.errors import Note, Where
from pumaid.records import Evidence, FileFacts, Reject, Robot, Value
from pumaid.show.story import Story
from pumaid.verbs.compare import compare

#: A name that would break a page, a LaTeX file or a Markdown table which did not escape it.
HOSTILE = "<script>alert('1')</script> & 50% \\arm_{x} | \"quoted\""


def story(robot: Robot = worlds.PENDULUM, *, units: str = "rad", seed: int = 5) -> Story:
    """Two repeats of a small experiment, one run held out, one ramp left out, one note."""
    truth = worlds.drawn(robot, seed)
    runs = list(worlds.evidence(truth, worlds.experiment(robot, postures=2, speeds=(0.3, 0.8), repeats=2)).runs)
    runs[-1] = replace(runs[-1], heldout=True)
    ramp = Reject("bench", 2, 9, 0.0, 1.0, (1,), "ramp", "joint 1 speeds up for 1.0 s", 8, runs[0].cells)
    facts = (FileFacts("logs/a.csv", "ab" * 32, 9999, 0.02, 0.0, 200.0),)
    note = Note("gap", "0.2 s are missing", Where(file="logs/a.csv", row=7))
    evidence = Evidence(tuple(runs), (ramp,), facts, (note,))
    estimate = pumaid.identify(evidence, robot)
    return Story(robot, estimate, evidence, compare(estimate, evidence, robot), units)


def hostile() -> Story:
    """The same with names that would break a careless page."""
    joints = tuple(replace(joint, name=f"{HOSTILE} {joint.number}") for joint in worlds.PENDULUM.joints)
    told = story(replace(worlds.PENDULUM, name=HOSTILE, joints=joints))
    runs = tuple(replace(run, origin=f"{HOSTILE}.csv") for run in told.evidence.runs)
    evidence = replace(told.evidence, runs=runs)
    return replace(told, evidence=evidence, comparison=compare(told.estimate, evidence, told.robot))


def table_one() -> Story:
    """The paper's PUMA with rounded values in place of fitted ones, so that its table is the same on every machine."""
    robot = worlds.puma().robot
    truth = worlds.puma().parameters()
    runs = worlds.evidence(worlds.puma(), worlds.only(worlds.table1.experiment(), lambda motion: True)).runs
    estimate = pumaid.identify(Evidence(runs), robot)
    values = tuple(_rounded(value, truth.get(value.name, 0.0)) for value in estimate.values)
    fits = tuple(replace(fit, rmse=0.02, noise_floor=0.019, runs=10) for fit in estimate.joints)
    estimate = replace(estimate, values=values, joints=fits)
    return Story(robot, estimate, Evidence(runs), compare(estimate, Evidence(runs), robot), "deg")


def _rounded(value: Value, truth: float) -> Value:
    if value.name == "gain_ratio.5.6":
        return replace(value, value=None, state="not_identifiable", reason="link 6 is light", next_run="add a payload")
    if value.value is None:
        return value
    error = float(f"{0.01 * abs(truth) + 1e-5:.1e}")
    interval = (truth - 2.0 * error, truth + 2.0 * error)
    return replace(value, value=float(np.round(truth, 6)), std_error=error, ci95=interval, state="identified")
