"""The Kinova Gen3's section of the report on real recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from published_loads import GEN3, GEN3_NO_CAMERA, first_harmonic
from recordings import folder, read, trial

from pumaid.dataset import Dataset
from pumaid.records import Combination, Estimate
from pumaid.robot import Robot
from pumaid.verbs.identify import identify

HOME = (0.0,) * 7
#: Joints whose axes lie level with the arm straight up, so that they carry weight.
LOADED = (2, 4, 6)
#: Joints 1 to 4 have Kinova's large actuator, 5 to 7 its small one; N m/A by the recordings' own torque columns.
FILE_CONSTANT = {2: 9.13, 4: 9.13, 6: 5.85}
#: s between two rows.
INTERVAL = 1e-3
#: Largest number that a bin of a healthy recording holds.
SANE = 1e6


def one_joint_files() -> list[Path]:
    """The recordings in which one joint moves."""
    return [folder() / "kinova-gen3-jointwise" / f"joint_{joint}_trapez.parquet" for joint in range(1, 8)]


def several_joint_files() -> list[Path]:
    """The recordings in which all joints move at once."""
    home = folder() / "kinova-gen3-jointwise"
    return [*sorted(home.glob("identification_*.parquet")), *sorted(home.glob("validation_*.parquet"))]


def lines(scratch: Path) -> Iterable[str]:
    """The section, line by line."""
    robot, dataset = read("kinova_gen3", one_joint_files(), scratch)
    estimate = identify(dataset, robot)
    yield "KINOVA GEN3"
    yield from _found(dataset)
    yield from _states(estimate)
    for joint in range(1, 8):
        order, amplitude, slow = ripple(dataset, joint)
        told = f"{amplitude:.3f} A at {order:.0f} cycles a turn is the strongest part above 20 Hz"
        yield f"  joint {joint}, what is left: {told}; {slow:.3f} A RMS below 10 Hz"
    yield from _independent(estimate)
    yield from _moving_together(dataset, robot, scratch)
    yield from _garbage()


def _found(dataset: Dataset) -> Iterable[str]:
    for run in dataset.runs:
        span = f"{run.span[0]:.3f} to {run.span[1]:.3f} rad"
        yield f"  run: joint {run.joint}, {span} at {run.speed:.4f} rad/s, {run.duration:.2f} s, {run.kind}"
    for joint in range(1, 8):
        slow, fast = paces(joint)
        yield f"  joint {joint}, means over 0.05 s within its motion: {slow:.3f} to {fast:.3f} rad/s"
    left = sum(reject.samples for reject in dataset.rejects)
    why = ", ".join(sorted({reject.reason for reject in dataset.rejects}))
    yield f"  left out: {left} of {sum(facts.rows for facts in dataset.files)} samples ({why})"


def paces(joint: int) -> tuple[float, float]:
    """Lowest and highest speed (rad/s) over 50 samples in the middle 80 % of a joint's motion."""
    position = np.unwrap(pd.read_parquet(one_joint_files()[joint - 1])[f"Position{joint}"].to_numpy(dtype=float))
    inner = position[len(position) // 10 : -len(position) // 10]
    speed = (inner[50:] - inner[:-50]) / (50 * INTERVAL)
    return float(speed.min()), float(speed.max())


def _states(estimate: Estimate) -> Iterable[str]:
    for value in estimate.values:
        what = (
            value.reason if value.value is None else f"{value.value:.4f} +- {value.std_error or 0.0:.4f} {value.unit}"
        )
        yield f"  {value.name}: {value.state}, {what}"
    for found in estimate.combinations:
        yield f"  {found.text} = {found.value:.4f} +- {found.std_error:.4f} {found.unit}"
    for fit in estimate.joints:
        yield f"  joint {fit.joint}: RMSE {fit.rmse:.4f} A over {fit.samples} samples"


def ripple(dataset: Dataset, joint: int) -> tuple[float, float, float]:
    """Order (cycles a turn) and amplitude (A) of a joint's strongest fast ripple, and RMS (A) left below 10 Hz.

    Read from the residual of the joint's longest run against its own first harmonic; the speed turns Hz into cycles.
    """
    run = max(dataset.of_joint(joint), key=lambda run: run.samples)
    path = one_joint_files()[joint - 1]
    table = pd.read_parquet(path, columns=[f"Position{joint}", f"Cur{joint}"]).iloc[
        run.first_row - 2 : run.last_row - 1
    ]
    position, current = table.to_numpy().T
    basis = np.column_stack([np.cos(position), np.sin(position), np.ones(len(position))])
    left = current - basis @ np.linalg.lstsq(basis, current, rcond=None)[0]
    window = np.hanning(len(left))
    size = 2.0 * np.abs(np.fft.rfft(left * window)) / window.sum()
    hertz = np.fft.rfftfreq(len(left), INTERVAL)
    fast = int(np.argmax(size * (hertz > 20.0)))
    power = np.abs(np.fft.rfft(left)) ** 2
    slow = math.sqrt(2.0 * float(power[(hertz > 0.0) & (hertz < 10.0)].sum())) / len(left)
    return float(hertz[fast] * 2.0 * math.pi / abs(run.speed)), float(size[fast]), slow


def weight(estimate: Estimate, joint: int, where: str) -> Combination | None:
    """The load of a joint at ``position 0`` or ``a quarter turn on``, None where the data do not tell it."""
    return next(
        (c for c in estimate.combinations if f"weight felt by joint {joint}" in c.text and where in c.text), None
    )


def _independent(estimate: Estimate) -> Iterable[str]:
    for joint in LOADED:
        camera, bare = (first_harmonic(links, HOME, joint)[1] for links in (GEN3, GEN3_NO_CAMERA))
        yield f"  joint {joint}, published masses: {camera:.3f} N m with camera, {bare:.3f} without, a quarter turn on"
        quarter, zero = weight(estimate, joint, "quarter"), weight(estimate, joint, "position 0")
        if quarter is None:
            continue
        implied, told = camera / quarter.value, FILE_CONSTANT[joint]
        yield f"  joint {joint}, torque constant that this implies: {implied:.2f} N m/A; the file's is {told}"
        yield f"  joint {joint}, load by the file's constant: {quarter.value * told:.2f} N m"
        if zero is not None:
            turned = math.degrees(math.atan2(-zero.value, abs(quarter.value)))
            error = math.degrees(zero.std_error / abs(quarter.value))
            yield f"  joint {joint}, direction of the load against the published one: {turned:+.2f} +- {error:.2f} deg"
    second, fourth = weight(estimate, 2, "quarter"), weight(estimate, 4, "quarter")
    if second is not None and fourth is not None:
        ratio = second.value / fourth.value
        error = ratio * math.hypot(second.std_error / second.value, fourth.std_error / fourth.value)
        camera, bare = (first_harmonic(o, HOME, 2)[1] / first_harmonic(o, HOME, 4)[1] for o in (GEN3, GEN3_NO_CAMERA))
        yield f"  load of joint 2 over load of joint 4: {ratio:.3f} +- {error:.3f}; published {camera:.3f}, {bare:.3f}"


def _moving_together(dataset: Dataset, robot: Robot, scratch: Path) -> Iterable[str]:
    yield "  all joints moving at once, RMSE (A) of recordings that the fit never saw:"
    _, judged = read("kinova_gen3", several_joint_files(), scratch)
    yield f"    runs found there: {len(judged.runs)}"
    for joint in range(1, 8):
        told = []
        for name, score in trial(dataset, robot, joint, judged=judged).scores.items():
            own = [part for part in score.outside if part.joint == joint]
            counts = np.array([part.samples for part in own], dtype=float)
            squares = np.array([part.rmse**2 for part in own])
            told.append(f"{name} {math.sqrt(float(np.average(squares, weights=counts))):.3f}")
        yield f"    joint {joint}: {', '.join(told)}; current itself {current_size(joint):.3f}"


def current_size(joint: int) -> float:
    """RMS current (A) of a joint in the recordings of all joints."""
    currents = [pd.read_parquet(path, columns=[f"Cur{joint}"]) for path in several_joint_files()]
    return float(np.sqrt(np.mean(np.concatenate([part.to_numpy().ravel() for part in currents]) ** 2)))


def _garbage() -> Iterable[str]:
    for path in (*one_joint_files(), *several_joint_files()):
        table = pd.read_parquet(path)
        wild = (table.abs() > SANE).sum().sum()
        lost = table.isna().sum().sum()
        if wild or lost:
            yield f"  {path.name}: {wild} cells above {SANE:.0e}, {lost} empty, none in a column that the recipe names"
