"""The section of the report on recordings that the method does not read: what is said of them, and nothing false."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from recordings import folder, read

from pumaid.dataset import Dataset
from pumaid.errors import PumaidError
from pumaid.robot import Robot
from pumaid.verbs.identify import identify

#: Motor turns per joint turn of the TX40, as its provenance states them.
REDUCTIONS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)


def tx40(scratch: Path) -> Path:
    """The TX40's recording with joint angles instead of motor angles, in the canonical columns; in `scratch` only."""
    table = pd.read_parquet(folder() / "staubli-tx40" / "tx40_excitation.parquet")
    out = {"t": table["time_s"]}
    for joint, reduction in enumerate(REDUCTIONS, start=1):
        out[f"q{joint}"] = table[f"motor_pos_rad_Joint_{joint}"] / reduction
        out[f"i{joint}"] = table[f"motor_cmd_Joint_{joint}"]
    out["q6"] = out["q6"] - out["q5"]
    path = scratch / "tx40.parquet"
    pd.DataFrame(out).to_parquet(path)
    return path


def lines(scratch: Path) -> Iterable[str]:
    """The section, line by line."""
    yield "OTHERS"
    pendulum = sorted((folder() / "dfki-double-pendulum-a0").glob("*.parquet"))
    yield from _one("DFKI double pendulum", "pendulum2", files=pendulum, scratch=scratch)
    yield from _one("Staubli TX40", "staubli_tx40", files=[tx40(scratch)], scratch=scratch)
    for path in sorted((folder() / "laas-odri-cogging").glob("*.parquet")):
        yield from _one(f"ODRI motor, {path.name}", "motor", files=[path], scratch=scratch)


def _one(title: str, recipe: str, *, files: Sequence[Path], scratch: Path) -> Iterable[str]:
    yield f"  {title}"
    try:
        robot, dataset = read(recipe, files, scratch)
    except PumaidError as error:
        yield f"    refused: {error.slug}: {error.what}"
        return
    rows = sum(facts.rows for facts in dataset.files)
    for kind in sorted({run.kind for run in dataset.runs}):
        own = [run for run in dataset.runs if run.kind == kind]
        speeds = sorted(run.speed for run in own)
        amount = sum(run.samples for run in own)
        yield f"    {len(own)} runs, {kind}, {amount} samples, speeds {speeds[0]:.3g} to {speeds[-1]:.3g} rad/s"
        drawn = max(float(np.abs(run.bins.current).max()) for run in own)
        yield f"    largest current in them: {drawn:.3f}"
    for reason in sorted({reject.reason for reject in dataset.rejects}):
        amount = sum(reject.samples for reject in dataset.rejects if reject.reason == reason)
        yield f"    left out, {reason}: {amount} of {rows} samples ({100.0 * amount / rows:.1f} %)"
    yield from _identified(robot, dataset)


def _identified(robot: Robot, dataset: Dataset) -> Iterable[str]:
    try:
        estimate = identify(dataset, robot)
    except PumaidError as error:
        yield f"    identify: {error.slug}: {error.what}"
        return
    for value in estimate.values:
        if value.value is not None and value.std_error is not None:
            yield f"    {value.name} = {value.value:.4f} +- {value.std_error:.4f} {value.unit}"
    unknown = sum(value.value is None for value in estimate.values)
    yield f"    not identifiable: {unknown} of {len(estimate.values)}"
    for found in estimate.combinations:
        yield f"    {found.text} = {found.value:.4f} +- {found.std_error:.4f} {found.unit}"
