"""Report contexts for tests of tables, figures and pages: a small arm, its model, and the model's errors."""

import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import worlds
from rich.console import Console

import pumaid
from pumaid.dataset import Dataset, FileFacts, Reject
from pumaid.diagnosis.compare import compare
from pumaid.errors import Note, Where
from pumaid.estimate import Estimate, JointFit, Value
from pumaid.reporting.page import ReportContext
from pumaid.robot import Robot

#: A name that would break a page, a LaTeX file or a Markdown table which did not escape it.
HOSTILE = "<script>alert('1')</script> & 50% \\arm_{x} | \"quoted\""


def printed(*parts: Any, width: int = 100) -> str:
    """What a terminal of that width shows of tables and paragraphs, without colours."""
    out = io.StringIO()
    console = Console(file=out, width=width, color_system=None, highlight=False)
    for part in parts:
        console.print(part)
    return "".join(f"{line.rstrip()}\n" for line in out.getvalue().splitlines())


def small(robot: Robot = worlds.PENDULUM, *, units: str = "rad", seed: int = 5) -> ReportContext:
    """Two repeats of a small experiment, one run held out, one ramp left out, one note."""
    truth = worlds.drawn(robot, seed)
    runs = list(worlds.dataset(truth, worlds.experiment(robot, postures=2, speeds=(0.3, 0.8), repeats=2)).runs)
    runs[-1] = replace(runs[-1], heldout=True)
    ramp = Reject("bench", 2, 9, 0.0, 1.0, (1,), "ramp", "joint 1 speeds up for 1.0 s", 8)
    facts = (FileFacts("logs/a.csv", "ab" * 32, 9999, 0.02, 0.0, 200.0),)
    note = Note("gap", "0.2 s are missing", Where(file="logs/a.csv", row=7))
    dataset = Dataset(tuple(runs), (ramp,), facts, (note,))
    estimate = pumaid.identify(dataset, robot)
    return ReportContext(robot, estimate, dataset, compare(estimate, dataset, robot), units)


def hostile() -> ReportContext:
    """The same with names that would break a careless page."""
    joints = tuple(replace(joint, name=f"{HOSTILE} {joint.number}") for joint in worlds.PENDULUM.joints)
    context = small(replace(worlds.PENDULUM, name=HOSTILE, joints=joints))
    runs = tuple(replace(run, origin=f"{HOSTILE}.csv") for run in context.dataset.runs)
    dataset = replace(context.dataset, runs=runs)
    return replace(context, dataset=dataset, comparison=compare(context.estimate, dataset, context.robot))


@dataclass(frozen=True)
class PaperModel:
    """A model's records as far as tables show them."""

    robot: Robot
    estimate: Estimate


def table_one() -> PaperModel:
    """The paper's PUMA with the paper's values and errors of 1 %, written by hand and so the same on every machine."""
    truth = worlds.puma()
    values = tuple(_value(name, value) for name, value in truth.parameters().items())
    fits = tuple(
        JointFit(joint, 10, 1000, std, 0.9 * std, run_level=0.1 * std, posture_groups=2, kinds={"constant": 10})
        for joint, std in enumerate(truth.noise.std.tolist(), start=1)
    )
    empty = np.zeros((0, 0))
    estimate = Estimate("PUMA 560", fits, values, (), np.zeros(0), empty, np.eye(6), empty)
    return PaperModel(truth.robot, estimate)


def _value(name: str, truth: float) -> Value:
    effect, owner = name.split(".")[:2]
    joint = int(owner.strip("lj"))
    unit = {"gravity": "A s2/m", "coulomb": "A", "viscous": "A s/rad", "gain_ratio": ""}[effect]
    bare = Value(name, "", joint, unit)
    if name in ("gravity.l1.x", "gravity.l1.y", "gain_ratio.1.2"):
        return replace(bare, state="not_identifiable", reason="joint 1 carries no weight")
    if name == "gain_ratio.5.6":
        return replace(bare, state="not_identifiable", reason="link 6 is light", next_run="add a payload")
    error = float(f"{0.01 * abs(truth) + 1e-5:.1e}")
    return replace(bare, value=truth, std_error=error, ci95=(truth - 2.0 * error, truth + 2.0 * error))
