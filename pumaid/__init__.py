"""pumaid: learn from logged motions what a robot arm's motor currents are spent on.

The verbs, the records and the errors are here; each is imported when it is first used, so that ``import pumaid``
costs nothing.

Examples
--------
>>> import pumaid
>>> robot = pumaid.Robot("pendulum", (pumaid.Joint(1, "hinge", "revolute", alpha=1.5708),))
>>> robot.n_joints
1
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

#: Public name -> module that defines it.
_HOMES = {
    **dict.fromkeys(("Faults", "LogError", "ModelError", "Note", "PumaidError"), "pumaid.errors"),
    **dict.fromkeys(("RecipeError", "ResultError", "Where"), "pumaid.errors"),
    **dict.fromkeys(("Bins", "Dataset", "FileFacts", "Means", "Reject", "Run"), "pumaid.dataset"),
    **dict.fromkeys(("Combination", "Comparison", "Estimate"), "pumaid.records"),
    **dict.fromkeys(("JointFit", "JointScore", "Log"), "pumaid.records"),
    **dict.fromkeys(("Motion", "Plan", "Posture"), "pumaid.trajectory"),
    "OutsideScore": "pumaid.records",
    **dict.fromkeys(("RunScore", "Samples", "Value"), "pumaid.records"),
    **dict.fromkeys(("Budget", "BudgetPart", "Candidate", "Curve", "Diagnosis", "Finding"), "pumaid.records"),
    **dict.fromkeys(("JointDiagnosis", "Limit", "NextRun", "Size", "Unexplained"), "pumaid.records"),
    **dict.fromkeys(("Errors", "History", "Ladder", "Rung"), "pumaid.results.history"),
    **dict.fromkeys(("EffectChoice", "Joint", "LogFormat", "Robot"), "pumaid.robot"),
    **{verb: f"pumaid.verbs.{verb}" for verb in ("compare", "diagnose", "identify", "segment", "simulate")},
    "plan": "pumaid.design.plan",
    "Exported": "pumaid.exports",
    "export": "pumaid.exports",
    "catalogue": "pumaid.effects",
    "read_recipe": "pumaid.io.recipe",
    "LogReader": "pumaid.io.log_reader",
    "read_model": "pumaid.results.model_file",
    "write_model": "pumaid.results.model_file",
    "read_diagnosis": "pumaid.diagnosis.document",
    "write_diagnosis": "pumaid.diagnosis.document",
    "read_history": "pumaid.results.history",
}

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pumaid' has no attribute {name!r}")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
