"""JSON documents of runs, comparisons and histories, and the runs as CSV; SI, angles in rad."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Any

from pumaid import __version__
from pumaid.dataset import Dataset, Reject, Run
from pumaid.estimation.comparison import TOGETHER, Budget, BudgetPart, Comparison, RunScore
from pumaid.reporting.run_tables import by_reason, samples_read
from pumaid.reporting.text import BUDGET_LIMITS, part_sentence, part_share
from pumaid.results.history import History, Ladder, Rung
from pumaid.robot import Robot

#: Entries of a joint's fit in a history.
_FIT_ENTRIES = ("joint", "runs", "samples", "rmse", "heldout", "heldout_runs", "noise_floor")

#: Columns of the runs as CSV; for prismatic joints m stands in place of rad.
CSV_HEADER = (
    "run", "file", "last_file", "first_row", "last_row", "start_s", "duration_s", "joint", "name", "kind", "from_rad",
    "to_rad", "speed_rad_s", "ripple_rad_s", "samples", "temperature_degC", "heldout",
)  # fmt: skip


# Runs


def segments_document(dataset: Dataset, robot: Robot) -> dict[str, Any]:
    """Runs, stretches left out and sums for JSON; SI, angles in rad."""
    rejected = by_reason(dataset.rejects)
    return {
        "samples": samples_read(dataset),
        "kept": sum(run.samples for run in dataset.runs),
        "runs": [_run_entry(index, run, robot) for index, run in enumerate(dataset.runs, 1)],
        "left_out": {reason: sum(reject.samples for reject in rejects) for reason, rejects in rejected.items()},
        "rejects": [_reject_entry(reject) for reject in dataset.rejects],
        "notes": [note.as_json() for note in dataset.notes],
    }


def runs_csv(dataset: Dataset, robot: Robot) -> str:
    """The runs as CSV in SI, postures as further columns ``q1`` to ``qJ``, empty at the moving joint."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*CSV_HEADER, *(f"q{joint.number}" for joint in robot.joints)])
    for index, run in enumerate(dataset.runs, 1):
        entry = _run_entry(index, run, robot)
        values = [entry[key] for key in ("run", "file", "last_file", "first_row", "last_row", "start", "duration")]
        values += [entry["joint"], entry["name"], entry["kind"], *entry["span"], entry["speed"], entry["ripple"]]
        values += [entry["samples"], entry["temperature"], entry["heldout"], *entry["posture"]]
        writer.writerow(["" if value is None else value for value in values])
    return out.getvalue()


def _run_entry(index: int, run: Run, robot: Robot) -> dict[str, Any]:
    names = ("clock", "start", "duration", "speed", "ripple", "samples", "heldout", "kind")
    return (
        _place(run)
        | {name: getattr(run, name) for name in names}
        | {
            "run": index,
            "joint": run.joint,
            "name": robot.joint(run.joint).name,
            "posture": [_finite(value) for value in run.posture],
            "span": list(run.span),
            "temperature": _finite(run.temperature),
        }
    )


def _reject_entry(reject: Reject) -> dict[str, Any]:
    names = ("reason", "text", "start", "duration", "samples")
    return {name: getattr(reject, name) for name in names} | {"joints": list(reject.joints)} | _place(reject)


def _place(record: Run | Reject) -> dict[str, Any]:
    return {
        "file": record.origin,
        "last_file": record.origin,
        "first_row": record.first_row,
        "last_row": record.last_row,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


# Comparison


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """The entries of a comparison's JSON document after its heading; SI."""
    joints = []
    for score in comparison.joints:
        joints.append(
            {
                "joint": score.joint,
                "samples": score.samples,
                "rmse": score.rmse,
                "bias": score.bias,
                "explained": score.explained,
                "noise_floor": score.noise_floor,
                "noise_floor_reason": score.noise_floor_reason,
                "current_rms": score.rms,
                "shares": {**score.shares},
                "not_told_apart": [name.split(TOGETHER) for name in score.shares if TOGETHER in name],
                "heldout": None if score.heldout is None else {"rmse": score.heldout, "runs": score.heldout_runs},
                "undetermined_runs": score.undetermined,
                "budget": budget_document(score.budget),
                "runs": [_run_document(item) for item in comparison.of_joint(score.joint)],
            }
        )
    heldout = None if comparison.heldout is None else {"rmse": comparison.heldout}
    return {
        "joints": joints,
        "rmse": comparison.rmse,
        "heldout": heldout,
        "outside": [
            {"joint": o.joint, "reason": o.reason, "samples": o.samples, "rmse": o.rmse, "bias": o.bias}
            for o in comparison.outside
        ],
        "notes": comparison.notes,
    }


def _run_document(score: RunScore) -> dict[str, Any]:
    run = score.run
    names = ("rmse", "bias", "largest", "explained", "undetermined", "reason")
    return {name: getattr(score, name) for name in names} | {
        "file": run.origin,
        "start": run.start,
        "duration": run.duration,
        "rows": [run.first_row, run.last_row],
        "kind": run.kind,
        "velocity": run.speed,
        "posture": run.posture,
        "samples": run.samples,
        "heldout": run.heldout,
    }


def budget_document(budget: Budget | None) -> dict[str, Any] | None:
    """A joint's budget in the comparison's JSON document; SI. None where the joint has no runs."""
    if budget is None:
        return None
    return {
        "mean_square": budget.mean_square,
        "noise": budget.noise,
        "floor": budget.floor,
        "runs": budget.runs,
        "replicates": budget.replicates,
        "parts": [_part_document(budget, part) for part in budget.parts],
        "limits": {slug: BUDGET_LIMITS[slug] for slug in budget.limits},
    }


def _part_document(budget: Budget, part: BudgetPart) -> dict[str, Any]:
    return {
        "name": part.name,
        "mean_square": part.mean_square,
        "share": part_share(budget, part),
        "p_value": part.p_value,
        "more_than_noise": part.is_more,
        "against": part.against,
        "cycles": part.cycles,
        "cycles_per": part.per or None,
        "cycles_per_motor_turn": part.gearing,
        "points_to": part.points_to,
        "text": part_sentence(budget, part) if part.is_more else None,
    }


# History and simulation


def history_document(history: History) -> dict[str, Any]:
    """The entries of a history's JSON document after its heading; SI."""
    return {
        "folder": history.folder,
        "current": history.current,
        "ladders": [_ladder_document(ladder) for ladder in history.ladders],
        "notes": history.notes,
    }


def _ladder_document(ladder: Ladder) -> dict[str, Any]:
    return {
        "robot": ladder.robot,
        "recipe": ladder.recipe,
        "logs": ladder.logs,
        "apart": ladder.apart or None,
        "path": [rung.number for rung in ladder.path],
        "models": [_rung_document(rung) for rung in ladder.rungs],
    }


def _rung_document(rung: Rung) -> dict[str, Any]:
    return {
        "model": rung.number,
        "file": rung.file,
        "sha256": rung.digest,
        "from": rung.parent,
        "current": rung.is_current,
        "effects": rung.effects,
        "added": rung.added,
        "removed": rung.removed,
        "rmse": rung.whole.fitted,
        "heldout": rung.whole.heldout,
        "noise_floor": rung.whole.noise_floor,
        "joints": [{name: getattr(fit, name) for name in _FIT_ENTRIES} for fit in rung.joints],
    }


def session_document(robot: str, seed: int, files: Sequence[tuple[str, int, float, float]]) -> dict[str, object]:
    """What ``simulate --json`` prints; `files` as in `session_table`."""
    entries = [dict(zip(("file", "samples", "start", "end"), entry, strict=True)) for entry in files]
    return {"kind": "simulation", "format": 1, "pumaid": __version__, "robot": robot, "seed": seed, "files": entries}
