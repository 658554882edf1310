"""Missing physics in real recordings: what diagnosis finds, and the error on strokes and files that no fit saw."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from real_data_gen3 import one_joint_files, several_joint_files
from real_data_others import tx40
from real_data_ur3e import JOINT, SPLITS, residuals, ripple, wave
from recordings import folder, held_out, read

from pumaid.cli.additions import MOST_ADDED, choice_of, reopened, spelled
from pumaid.dataset import Dataset
from pumaid.errors import PumaidError
from pumaid.records import ADD, Diagnosis, Estimate, Finding, JointDiagnosis
from pumaid.robot import Robot
from pumaid.verbs.compare import compare
from pumaid.verbs.diagnose import diagnose
from pumaid.verbs.identify import identify

#: The bare motor's recordings by what was done: driven by one voltage, or held near one speed by a controller. The
#: current of a ripple differs between the two, so they are not fitted together.
ROLLING: tuple[str, ...] = ("rolling_data", "rolling_data1", "rolling_data2")
SPEED = ("speed_test", "speed_test1", "speed_test_old")
#: What the motor was judged on: each recording by the other two of its kind.
MOTOR = {f"judge {name}": (kind, name) for kind in (ROLLING, SPEED) for name in kind}
#: Runs (from 1) that are the later half of a recording, and are judged: 104 strokes to and fro, 24 slices of a map.
LATER = {"acc_current": range(53, 105), "stopped_data": range(13, 25)}
#: Waves a turn of the UR3e's joint 2 that are near two a motor turn.
NEAR_TWO = (190.0, 212.0)
#: Waves of a turn up to which a spectrum is told.
HIGHEST_WAVE = 130


@dataclass(frozen=True, eq=False, slots=True)
class Step:
    """A model of the ladder: what was added last, RMSE (A) of its joint's fitted and held-out runs, noise floor (A)."""

    added: str
    estimate: Estimate
    fitted: float
    heldout: float
    floor: float


@dataclass(frozen=True, eq=False, slots=True)
class Climb:
    """A ladder of one joint: the first diagnosis, the models, and the last diagnosis."""

    first: Diagnosis
    steps: tuple[Step, ...]
    last: Diagnosis


def climb(dataset: Dataset, robot: Robot, joint: int) -> Climb:
    """Diagnose, add what is found, and so on, as ``diagnose --apply`` does; held-out runs judge each model only."""
    estimate = identify(dataset, robot)
    first = found = diagnose(estimate, dataset, robot)
    steps = [_step("base model", estimate, joint)]
    while len(steps) <= MOST_ADDED:
        new = [one for one in found.findings if one.verdict == ADD and one.joint in (None, joint)]
        if not new:
            break
        for one in new[: MOST_ADDED + 1 - len(steps)]:
            estimate = identify(dataset, robot, effects=(*reopened(estimate), choice_of(one)))
            steps.append(_step(spelled(one.choice), estimate, joint))
        found = diagnose(estimate, dataset, robot)
    return Climb(first, tuple(steps), found)


def _step(added: str, estimate: Estimate, joint: int) -> Step:
    fit = estimate.joint(joint)
    known = [math.nan if value is None else value for value in (fit.rmse, fit.heldout, fit.noise_floor)]
    return Step(added, estimate, *known)


def lines(scratch: Path) -> Iterable[str]:
    """The section, line by line."""
    yield "MISSING PHYSICS"
    robot, dataset = read("ur3e", [wave()], scratch)
    for name, runs in SPLITS.items():
        yield from _climbed(f"UR3e, {name}", climb(held_out(dataset, runs), robot, JOINT), JOINT)
    yield from _climbed("UR3e, all strokes fitted", climb(dataset, robot, JOINT), JOINT)
    frame = residuals(dataset, robot, identify(dataset, robot))
    for what, by in (("stroke", "run"), ("half stroke, by direction and gain of speed", ["direction", "speeds_up"])):
        best = [ripple(own, NEAR_TWO, step=0.05)[0] for _, own in frame.groupby(by)]
        yield f"  UR3e, waves a turn, each {what}: {min(best):.2f} to {max(best):.2f}"
    yield from _gen3(scratch)
    for name, (kind, judged) in MOTOR.items():
        yield from _climbed(f"bare motor, {name}", climb(*motor(kind, (judged,), scratch), 1), 1)
    for kind in (ROLLING, SPEED, *((name,) for name in LATER)):
        yield from _climbed(f"bare motor, {', '.join(kind)}, all fitted", climb(*motor(kind, (), scratch), 1), 1)
    for name in LATER:
        yield from _climbed(f"bare motor, {name}, judge the later half", climb(*halved(name, scratch), 1), 1)
    yield from _nothing(scratch)
    yield "  bare motor, waves a turn, their size (A) and phase (deg) in the raw recordings, strongest first:"
    for name in ("stopped_data", *ROLLING, *SPEED):
        told = ", ".join(f"{order}: {size:.3f} at {phase:.0f}" for order, size, phase in waves(name)[:12])
        yield f"    {name}: {told}"


def _nothing(scratch: Path) -> Iterable[str]:
    pendulum = sorted((folder() / "dfki-double-pendulum-a0").glob("*.parquet"))
    for title, recipe, files in (("double pendulum", "pendulum2", pendulum), ("TX40", "staubli_tx40", [tx40(scratch)])):
        robot, dataset = read(recipe, files, scratch)
        try:
            identify(dataset, robot)
        except PumaidError as error:
            yield f"  {title}: nothing to diagnose, {error.slug}: {error.what}"


def recording(name: str) -> Path:
    """A recording of the bare motor."""
    return folder() / "laas-odri-cogging" / f"{name}.parquet"


def motor(names: Sequence[str], judged: Sequence[str], scratch: Path) -> tuple[Dataset, Robot]:
    """Recordings of the bare motor, all runs of those `judged` held out."""
    robot, dataset = read("motor", [recording(name) for name in names], scratch)
    kept = {str(recording(name)) for name in judged}
    return held_out(dataset, [n for n, run in enumerate(dataset.runs, start=1) if run.origin in kept]), robot


def halved(name: str, scratch: Path) -> tuple[Dataset, Robot]:
    """A recording of the bare motor, its later half held out."""
    robot, dataset = read("motor", [recording(name)], scratch)
    return held_out(dataset, LATER[name]), robot


def waves(name: str) -> list[tuple[int, float, float]]:
    """Whole waves a turn, their size (A) and phase (deg) in raw samples, strongest first; pumaid has no part in it."""
    table = pd.read_parquet(recording(name))
    position, current = table["Position"].to_numpy(dtype=float), table["Iq"].to_numpy(dtype=float)
    angles = np.outer(np.arange(1, HIGHEST_WAVE + 1), position)
    left = current - current.mean()
    found = 2.0 * (np.cos(angles) @ left + 1j * (np.sin(angles) @ left)) / len(left)
    return [(int(at) + 1, abs(found[at]), math.degrees(np.angle(found[at]))) for at in np.argsort(-np.abs(found))]


def _climbed(title: str, found: Climb, joint: int) -> Iterable[str]:
    yield f"  {title}"
    for step in found.steps:
        told = f"fitted {step.fitted:.4f}, held out {step.heldout:.4f}, noise floor {step.floor:.4f} A"
        yield f"    {step.added}: {told}"
    for when, diagnosis in (("first", found.first), ("last", found.last)):
        yield from _told(when, diagnosis, diagnosis.joints[joint - 1])


def _told(when: str, diagnosis: Diagnosis, joint: JointDiagnosis) -> Iterable[str]:
    yield f"    {when} diagnosis: {joint.verdict}"
    for found in diagnosis.findings:
        if found.joint in (None, joint.joint):
            yield f"      {_found(found)}"
    for one in joint.candidates:
        shape = ", ".join(f"{name} {value:.4g}" for name, value in one.shape.items())
        yield f"      tried: {one.effect}{shape and ' ' + shape}, {one.verdict}: {one.reason}; p {one.p_value:.3f}"
    if joint.unexplained is not None:
        yield f"      unexplained: {joint.unexplained.text}"


def _found(found: Finding) -> str:
    sizes = ", ".join(f"{size.name} {size.value:.4g} +- {size.std_error:.2g} {size.unit}" for size in found.sizes)
    rivals = f", or {', '.join(found.rivals)}" if found.rivals else ""
    return f"{found.verdict}: {spelled(found.choice)}{rivals}; p {found.p_value:.3f}; {sizes}"


def _gen3(scratch: Path) -> Iterable[str]:
    robot, dataset = read("kinova_gen3", one_joint_files(), scratch)
    estimate = identify(dataset, robot)
    found = diagnose(estimate, dataset, robot)
    yield f"  Gen3, all joints alone: {len(found.findings)} findings"
    for joint in found.joints:
        yield from _told(f"joint {joint.joint},", found, joint)
        limits = [one for one in joint.limits if one.effect == "flexibility" and one.size is not None]
        yield from (f"      flexibility of {one.size:.1e} {one.unit} would have been found" for one in limits)
    _, judged = read("kinova_gen3", several_joint_files(), scratch)
    yield f"    base model, all joints at once, A: {_outside(estimate, judged, robot)}"
    if found.findings:
        estimate = identify(dataset, robot, effects=[choice_of(one) for one in found.findings])
        yield f"    with what was found, A: {_outside(estimate, judged, robot)}"


def _outside(estimate: Estimate, judged: Dataset, robot: Robot) -> str:
    """RMSE (A) of each joint outside runs."""
    outside, told = compare(estimate, judged, robot).outside, []
    for joint in range(1, robot.n_joints + 1):
        own = [part for part in outside if part.joint == joint]
        left = np.average([part.rmse**2 for part in own], weights=[part.samples for part in own])
        told.append(f"joint {joint} {math.sqrt(float(left)):.3f}")
    return ", ".join(told)
