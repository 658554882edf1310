"""The UR3e's section of the report on real recordings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from published_loads import UR3E, first_harmonic, loads
from recordings import folder, held_out, read, trial
from scipy.optimize import least_squares

from pumaid.dataset import Dataset
from pumaid.model import Model
from pumaid.records import Estimate, Samples
from pumaid.robot import Robot
from pumaid.verbs.compare import compare
from pumaid.verbs.identify import identify

Floats = NDArray[np.float64]

JOINT = 2
#: Strokes (from 1, in order of time) that are kept from the fit, by what the split tests.
SPLITS: dict[str, tuple[int, ...]] = {
    "fit 1-6, judge 7-11": (7, 8, 9, 10, 11),
    "fit 7-11, judge 1-6": (1, 2, 3, 4, 5, 6),
    "fit 1 2 5 6 9 10, judge 3 4 7 8 11": (3, 4, 7, 8, 11),
    "fit 1 2, judge 3-11": (3, 4, 5, 6, 7, 8, 9, 10, 11),
    "fit forward, judge backward": (1, 3, 5, 7, 9, 11),
}
#: How the other joints were held (rad).
HELD = (0.0, 0.0, 0.0, -math.pi / 2, 0.0, 0.0)
#: rad; two samples of repeated strokes this near see the same place of a ripple of 199 cycles a turn.
SAME_PLACE = 0.0005
#: rad/s; edges of the speeds by which the residual is listed.
SPEEDS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.5)


def wave() -> Path:
    """The one recording with measured currents."""
    return folder() / "ur3e-aurt" / "wave_currentData_100v_40a.parquet"


def lines(scratch: Path) -> Iterable[str]:
    """The section, line by line."""
    robot, dataset = read("ur3e", [wave()], scratch)
    estimate = identify(dataset, robot)
    yield "UR3E, joint 2"
    yield from _found(dataset, estimate)
    yield from _judged(dataset, robot)
    frame = residuals(dataset, robot, estimate)
    yield from _misfit(frame)
    yield from _independent(dataset, estimate)
    yield from _controller()


def _found(dataset: Dataset, estimate: Estimate) -> Iterable[str]:
    kept = sum(run.samples for run in dataset.runs)
    yield f"  strokes: {len(dataset.runs)}, samples kept {kept} of {dataset.files[0].rows}"
    for reason in dict.fromkeys(reject.reason for reject in dataset.rejects):
        own = [reject for reject in dataset.rejects if reject.reason == reason]
        yield f"  left out, {reason}: {len(own)} stretches, {sum(r.samples for r in own)} samples"
    for value in estimate.values:
        if value.value is not None and value.std_error is not None:
            yield f"  {value.name} = {value.value:.4f} +- {value.std_error:.4f} {value.unit}"
    for found in estimate.combinations:
        yield f"  {found.text} = {found.value:.4f} +- {found.std_error:.4f} {found.unit}"
    fit = estimate.joint(JOINT)
    yield f"  RMSE {fit.rmse:.4f} A, noise floor {fit.noise_floor:.4f} A"


def _judged(dataset: Dataset, robot: Robot) -> Iterable[str]:
    yield "  held-out RMSE (A) by split and model:"
    for name, runs in SPLITS.items():
        scores = trial(held_out(dataset, runs), robot, JOINT).scores
        told = ", ".join(f"{model} {score.joints[JOINT - 1].heldout:.4f}" for model, score in scores.items())
        yield f"    {name}: {told}"
    each = []
    for number in range(1, len(dataset.runs) + 1):
        kept = held_out(dataset, (number,))
        each.append(compare(identify(kept, robot), kept, robot).heldout or math.nan)
    yield f"    each stroke by the other ten: {min(each):.4f} to {max(each):.4f}"


def residuals(dataset: Dataset, robot: Robot, estimate: Estimate) -> pd.DataFrame:
    """Measured minus predicted current (A) of every sample in a stroke: run, direction, position, speed, residual.

    Velocity and acceleration are the controller's targets here, so that no smoothing of ours is judged.
    """
    table = pd.read_parquet(wave())
    model = Model.of_estimate(robot, estimate)
    position = table[[f"actual_q_{joint}" for joint in range(6)]].to_numpy()
    velocity = table[[f"target_qd_{joint}" for joint in range(6)]].to_numpy()
    parts = []
    for number, run in enumerate(dataset.runs, start=1):
        rows = slice(run.first_row - 2, run.last_row - 1)
        own, acceleration = position[rows], table["target_qdd_1"].to_numpy()[rows]
        direction = np.full(len(own), float(run.direction))
        samples = Samples(JOINT, own, velocity[rows], acceleration=acceleration, direction=direction)
        residual = table["actual_current_1"].to_numpy()[rows] - model.predict(estimate, samples)
        part = {"run": number, "direction": run.direction, "position": own[:, JOINT - 1], "residual": residual}
        speed, gains = np.abs(velocity[rows, JOINT - 1]), acceleration * run.direction > 0
        parts.append(pd.DataFrame(part | {"speed": speed, "speeds_up": gains}))
    return pd.concat(parts, ignore_index=True)


def _misfit(frame: pd.DataFrame) -> Iterable[str]:
    yield f"  residual with the commanded acceleration: {_rms(frame.residual):.4f} A over {len(frame)} samples"
    order, amplitude = ripple(frame)
    yield f"  ripple: {amplitude:.4f} A at {order:.2f} cycles a turn, RMS {amplitude / math.sqrt(2.0):.4f} A"
    pure = pure_error(frame)
    yield f"  what repeated strokes differ by at the same place: {pure:.4f} A"
    yield "  mean residual against the motion (A; below zero: less friction than the model says) by speed:"
    for low, high in pairwise(SPEEDS):
        own = frame[(frame.speed >= low) & (frame.speed < high)]
        yield f"    {low} to {high} rad/s: {float(np.mean(own.residual * own.direction)):+.4f}"
    for _, own in frame.groupby(["direction", "speeds_up"]):
        way = "forward" if own.direction.iloc[0] > 0 else "backward"
        what = "speeding up" if own.speeds_up.iloc[0] else "slowing down"
        yield f"  residual {way}, {what}: RMS {_rms(own.residual):.4f} A"


def ripple(
    frame: pd.DataFrame, orders: tuple[float, float] = (20.0, 260.0), *, step: float = 0.25
) -> tuple[float, float]:
    """Order (cycles a turn) between two that explains most of the residual, and its amplitude (A)."""
    found = []
    for order in np.arange(*orders, step):
        basis = np.column_stack([np.cos(order * frame.position), np.sin(order * frame.position)])
        part = np.linalg.lstsq(basis, frame.residual.to_numpy(), rcond=None)[0]
        found.append((float(np.hypot(*part)), float(order)))
    amplitude, order = max(found)
    return order, amplitude


def pure_error(frame: pd.DataFrame) -> float:
    """RMS (A) by which a sample differs from what repeated strokes agree on, from pairs at the same place."""
    squares: list[float] = []
    for _, own in frame.groupby("direction"):
        ordered = own.sort_values("position")
        near = np.diff(ordered.position) < SAME_PLACE
        other = np.diff(ordered.run) != 0
        squares += (np.diff(ordered.residual)[near & other] ** 2).tolist()
    return math.sqrt(0.5 * float(np.mean(squares)))


def half_sums(dataset: Dataset) -> tuple[Floats, Floats]:
    """Mean and standard error (A) of cos, sin and constant in half sums of neighbouring strokes, free of any friction.

    The inertia's share, which is alike both ways, is fitted beside them.
    """
    fits = []
    grid = np.linspace(-3.0, -0.15, 400)
    for first, second in zip(dataset.runs[:-1:2], dataset.runs[1::2], strict=False):
        half = 0.5 * sum(_at(run.bins.position[:, 1], run.bins.current, grid) for run in (first, second))
        pull = 0.5 * sum(_at(run.bins.position[:, 1], run.bins.acceleration, grid) for run in (first, second))
        basis = np.column_stack([np.cos(grid), np.sin(grid), np.ones(len(grid)), pull])
        fits.append(np.linalg.lstsq(basis, half, rcond=None)[0][:3])
    return np.mean(fits, axis=0), np.std(fits, axis=0, ddof=1) / math.sqrt(len(fits))


def _at(position: Floats, values: Floats, grid: Floats) -> Floats:
    order = np.argsort(position)
    return np.interp(grid, position[order], values[order])


def _independent(dataset: Dataset, estimate: Estimate) -> Iterable[str]:
    level, upright = first_harmonic(UR3E, HELD, JOINT)
    yield f"  published masses: {level:.3f} N m at position 0, {upright:.3f} N m a quarter turn on"
    weight = {found.text: found for found in estimate.combinations}
    zero, quarter = (weight[f"weight felt by joint 2 {where}"] for where in ("at position 0", "a quarter turn on"))
    turned = math.degrees(math.atan2(quarter.value, -zero.value))
    error = math.degrees(quarter.std_error / abs(zero.value))
    yield f"  direction of the load against the published one: {turned:+.2f} +- {error:.2f} deg"
    means, errors = half_sums(dataset)
    for name, mean, spread in zip(("cos", "sin", "constant"), means, errors, strict=True):
        yield f"  half sums of forward and backward strokes, {name}: {mean:.4f} +- {spread:.4f} A"
    ratio = level / zero.value
    yield f"  torque constant that this implies: {ratio:.2f} N m/A at the joint, {ratio / 101:.4f} at the motor (101:1)"
    table = pd.read_parquet(wave())
    rest = table[table.timestamp < dataset.runs[0].start - 0.5]
    for joint in (2, 3, 4, 5):
        held = rest[f"actual_current_{joint - 1}"]
        aimed = rest[f"target_current_{joint - 1}"].mean()
        bare = loads(UR3E, HELD)[joint - 1]
        yield f"  at rest at 0, joint {joint}: {held.mean():.3f} A, target {aimed:.3f} A, published {bare:.2f} N m"


def _controller() -> Iterable[str]:
    known = controller_model()
    constants = ", ".join(f"{known[name]:.2f} at {name}" for name in ("joint 2", "joint 3", "wrist"))
    yield f"  controller's own model, N m/A: {constants}"
    mass, moment = known["tool kg"], known["tool kg m"]
    yield f"  controller's own model: a tool of {mass:.2f} kg, {moment:.3f} kg m beyond the flange"


def controller_model() -> dict[str, float]:
    """The controller's own torque constants (N m/A) and tool (kg, kg m), from its target currents in many postures.

    The published masses give the arm's own load; the tool that the controller reckons with is fitted beside.
    """
    table = pd.read_parquet(folder() / "ur3e-aurt" / "currentData_100v_40a.parquet").iloc[::20]

    def of(name: str) -> Floats:
        return table[[f"{name}_{joint}" for joint in range(6)]].to_numpy()

    speed, pull, current = of("target_qd"), of("target_qdd"), of("target_current")
    bare, tool = zip(*(_with_tool(position) for position in of("target_q")), strict=True)

    def misfit(guess: Floats) -> Floats:
        constants = np.array([guess[0], guess[1], guess[2], guess[2]])
        load = (np.array(bare) + np.einsum("n,tnj->tj", guess[3:], np.array(tool)))[:, 1:5] / constants
        left = []
        for joint in range(1, 5):
            way = np.sign(speed[:, joint]) * (np.abs(speed[:, joint]) > 1e-4)
            basis = np.column_stack([way, speed[:, joint], pull])
            wanted = current[:, joint] - load[:, joint - 1]
            left.append(wanted - basis @ np.linalg.lstsq(basis, wanted, rcond=None)[0])
        return np.concatenate(left)

    found = least_squares(misfit, [8.0, 6.0, 2.0, 0.3, 0.0]).x
    return dict(zip(("joint 2", "joint 3", "wrist", "tool kg", "tool kg m"), found.tolist(), strict=True))


def _with_tool(position: Floats) -> tuple[Floats, Floats]:
    """Loads (J,) of the bare arm, and (2, J) per kg and per kg m of a tool on the flange's axis."""
    bare = loads(UR3E, position)
    last = UR3E[-1]
    at = [_added(position, last.mass + 1.0, (0.0, 0.0, -0.02 * last.mass / (last.mass + 1.0)))]
    at.append(_added(position, last.mass + 1.0, (0.0, 0.0, (1.0 - 0.02 * last.mass) / (last.mass + 1.0))))
    return bare, np.array([at[0] - bare, at[1] - at[0]])


def _added(position: Floats, mass: float, centre: tuple[float, float, float]) -> Floats:
    last = UR3E[-1]
    return loads((*UR3E[:-1], type(last)(last.before, last.after, mass, centre)), position)


def _rms(values: Iterable[float]) -> float:
    return math.sqrt(float(np.mean(np.square(list(values)))))
