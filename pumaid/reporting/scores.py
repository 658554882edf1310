"""Tables of a comparison: by joint, the worst runs, what lies outside runs, and all of it as one document."""

from __future__ import annotations

import numpy as np

from pumaid.dataset import Run
from pumaid.records import Comparison
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import in_unit, percent
from pumaid.robot import Robot
from pumaid.units import number

#: An error this many times the noise floor asks for attention: with a few dozen replicates the floor itself is known to
#: a tenth, so a quarter above it is more than chance.
ATTENTION = 1.25

#: A: errors below this are rounding, that of squares of a few A; far finer than any sensor.
ROUNDING = 1e-7

#: A mean error below this share of the RMSE is shown as none.
NO_BIAS = 1e-4


def comparison_grid(comparison: Comparison, robot: Robot) -> Grid:
    """The model's error by joint, against the noise floor."""
    rows: list[list[str | Cell]] = []
    has_heldout = any(score.heldout is not None for score in comparison.joints)
    reasons: dict[str, None] = {}
    for score in comparison.joints:
        name = f"{score.joint} {robot.joint(score.joint).name}"
        tone = "alarm" if is_above_floor(score.rmse, score.noise_floor) else ""
        row: list[str | Cell] = [
            name,
            str(score.runs),
            amount(score.rmse, tone),
            amount(score.noise_floor),
            _bias(score.bias, score.rmse),
        ]
        row += [Cell("-", tone="absent") if score.explained is None else Cell(percent(score.explained))]
        row += [amount(score.heldout)] if has_heldout else []
        rows.append(row)
        if score.noise_floor_reason and score.runs:
            reasons[score.noise_floor_reason] = None
    header = ["joint", "runs", "RMSE (A)", "noise floor (A)", "bias (A)", "explained"]
    still = [str(score.joint) for score in comparison.joints if not score.runs]
    if still:
        which = f"joint {still[0]} never moves" if len(still) == 1 else f"joints {', '.join(still)} never move"
        reasons[f"{which} alone in these logs"] = None
    if comparison.rmse is not None:
        total: list[str | Cell] = ["all", str(sum(score.runs for score in comparison.joints)), amount(comparison.rmse)]
        rows.append([*total, *([""] * 3), *([amount(comparison.heldout)] if has_heldout else [])])
    return grid(
        "Model against measurement",
        header + (["held out (A)"] if has_heldout else []),
        rows,
        notes=tuple(("-", reason) for reason in reasons),
        caption="Explained: share of the current's variance that the model accounts for. RMSE at the noise floor:"
        " repeated runs differ as much, so they show nothing that the model lacks."
        + (" Held out: RMSE of runs that were not fitted." if has_heldout else ""),
    )


def worst_grid(comparison: Comparison, robot: Robot, *, count: int = 5, units: str = "rad") -> Grid:
    """The runs that the model misses most, with file and seconds.

    Parameters
    ----------
    comparison
        All runs' scores.
    robot
        Names of joints.
    count
        How many runs.
    units
        ``"rad"`` or ``"deg"``.
    """
    rows: list[list[str | Cell]] = []
    reasons: dict[str, str] = {}
    for rank, score in enumerate(comparison.worst(count), start=1):
        run = score.run
        mark = reasons.setdefault(score.reason, "abcdefghijklmnopqrstuvwxyz"[len(reasons) % 26]) if score.reason else ""
        rows.append(
            [
                str(rank),
                f"{run.joint} {robot.joint(run.joint).name}",
                run.origin,
                f"{run.start:.2f} – {run.start + run.duration:.2f}",
                speed_text(run, robot, units),
                Cell(number(score.rmse, 3), mark=mark, tone="unknown" if mark else ""),
                _bias(score.bias, score.rmse),
                posture_text(run, robot, units),
            ]
        )
    header = ("", "joint", "file", "seconds", "speed", "RMSE (A)", "bias (A)", "others held at")
    return grid(
        "Worst runs",
        header,
        rows,
        notes=tuple((mark, reason) for reason, mark in reasons.items()),
        caption="Ordered by error against the joint's noise floor.",
        lefts=(0, 1, 2, 3, 7),
    )


def outside_grid(comparison: Comparison, robot: Robot) -> Grid | None:
    """What lies outside runs; None where nothing does."""
    if not comparison.outside:
        return None
    found = {(score.joint, score.reason): score for score in comparison.outside}
    reasons = sorted(
        {reason for _, reason in found}, key=lambda r: -sum(s.samples for s in found.values() if s.reason == r)
    )
    rows: list[list[str | Cell]] = []
    for joint in sorted({joint for joint, _ in found}):
        scores = [found.get((joint, reason)) for reason in reasons]
        samples = sum(score.samples for score in scores if score is not None)
        cells = [amount(None if score is None else score.rmse) for score in scores]
        rows.append([f"{joint} {robot.joint(joint).name}", f"{samples:,}", *cells])
    return grid(
        "Outside runs: RMSE (A) by what keeps a stretch from being a run",
        ("joint", "samples", *reasons),
        rows,
        caption="Inertia is missing there by design: the model holds what a joint draws at constant speed.",
    )


def is_above_floor(rmse: float | None, floor: float | None) -> bool:
    """Whether an error (A) is more than noise explains (A)."""
    return rmse is not None and floor is not None and rmse > ATTENTION * floor + ROUNDING


def amount(value: float | None, tone: str = "") -> Cell:
    """A current (A) as a cell."""
    return Cell("-", tone="absent") if value is None else Cell(number(value, 3), tone=tone)


def _bias(bias: float | None, rmse: float | None) -> Cell:
    """A mean error (A); 0 where it is nothing beside the RMSE, as it is of runs that were fitted."""
    return Cell("0") if bias is not None and abs(bias) < NO_BIAS * (rmse or 0.0) else amount(bias)


def speed_text(run: Run, robot: Robot, units: str = "rad") -> str:
    """A run's signed speed with its unit."""
    times, unit = in_unit(f"{robot.joint(run.joint).position_unit}/s", units)
    return f"{number(run.speed * times, 3)} {unit}"


def posture_text(run: Run, robot: Robot, units: str = "rad") -> str:
    """The positions at which the other joints are held; a dash at the moving one."""
    words = []
    for joint, held in zip(robot.joints, run.posture, strict=True):
        if np.isnan(held):
            words.append("–")
            continue
        shown = held * in_unit(joint.position_unit, units)[0]
        text = f"{shown:.{0 if units == 'deg' and joint.is_revolute else 2}f}"
        words.append(text.lstrip("-") if float(text) == 0.0 else text)
    return "[" + " ".join(words) + "]"
