"""An experiment's folder as a user has it: recipe.yaml, plan.yaml and logs, written as plain text and Parquet."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from blind_world.arms import GRAVITY, Arm
from blind_world.campaign import Campaign
from blind_world.world import State, World

Floats = NDArray[np.float64]


def write_experiment(folder: Path, world: World, sensed: State) -> None:
    """Write the whole folder."""
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    (folder / "recipe.yaml").write_text(recipe(world.arm), encoding="utf-8")
    (folder / "plan.yaml").write_text(plan(world.arm, world.campaign), encoding="utf-8")
    pq.write_table(table(world, sensed), folder / "logs" / "campaign.parquet", compression="snappy")


def table(world: World, sensed: State) -> pa.Table:
    """The log's columns: t, q, qd (some arms), i, temp (some arms)."""
    columns = {"t": np.round(world.motion.time, 6)}
    groups = {"q": sensed.position, "i": sensed.current}
    if world.has_velocity:
        groups["qd"] = np.round(world.motion.velocity, 4)
    if world.has_temperature:
        groups["temp"] = np.round(world.temperature * 4.0) / 4.0
    for name, values in groups.items():
        columns |= {f"{name}{k + 1}": np.ascontiguousarray(values[:, k]) for k in range(world.arm.n)}
    return pa.table(columns)


def recipe(arm: Arm) -> str:
    """The recipe's text: geometry and gravity, and the gear ratios of some arms."""
    lines = [f"name: {arm.name}", f"gravity: [0.0, 0.0, {-GRAVITY}]", "joints:"]
    for k in range(arm.n):
        kind = "prismatic" if arm.slides[k] else "revolute"
        gear = f", gear_ratio: {arm.gear[k]:g}" if arm.is_geared and not arm.slides[k] else ""
        lines.append(
            f"  - {{name: axis{k + 1}, type: {kind}, theta: {arm.theta[k]:.12g}, alpha: {arm.alpha[k]:.12g}, "
            f"a: {arm.a[k]:.9g}, d: {arm.d[k]:.9g}, limits: [{arm.low[k]:g}, {arm.high[k]:g}], "
            f"max_velocity: {arm.speed[k] * 1.05:.4f}{gear}}}"
        )
    return "\n".join(lines) + "\n"


def plan(arm: Arm, campaign: Campaign) -> str:
    """The plan's text: a row a stroke, in the order of execution."""
    lines = ["kind: plan", "format: 1", f"robot: {arm.name}", "units: {angle: rad}", "runs:"]
    for stroke in campaign.strokes:
        hold = ", ".join(f"{value:g}" for value in stroke.hold)
        purpose = "heldout" if stroke.is_heldout else "fit"
        lines.append(
            f"  - {{joint: {stroke.joint + 1}, hold: [{hold}], from: {stroke.start:g}, to: {stroke.end:g}, "
            f"velocity: {stroke.speed:g}, purpose: {purpose}}}"
        )
    return "\n".join(lines) + "\n"
