"""A comparison as the one JSON document of ``pumaid compare --json``."""

from __future__ import annotations

from typing import Any

from pumaid.records import TOGETHER, Comparison, RunScore
from pumaid.reporting.budget import budget_document


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """The entries of a comparison's JSON document after its heading; SI."""
    joints = []
    for score in comparison.joints:
        own = [_run_document(item) for item in comparison.of_joint(score.joint)]
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
                "runs": own,
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
    return {
        "file": run.origin,
        "start": run.start,
        "duration": run.duration,
        "rows": [run.first_row, run.last_row],
        "kind": run.kind,
        "velocity": run.speed,
        "posture": run.posture,
        "samples": run.samples,
        "rmse": score.rmse,
        "bias": score.bias,
        "largest": score.largest,
        "explained": score.explained,
        "heldout": run.heldout,
        "undetermined": score.undetermined,
        "reason": score.reason,
    }
