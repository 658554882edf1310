"""pumaid: learn from logged motions what a robot arm's motor currents are spent on.

What a notebook needs, the records and the errors are here; each is imported when it is first used, so that
``import pumaid`` costs nothing.

Examples
--------
>>> import pumaid
>>> robot = pumaid.Robot("pendulum", (pumaid.Joint(1, "hinge", "revolute", alpha=1.5708),))
>>> robot.n_joints
1
"""

import importlib
from typing import Any

__version__ = "0.1.0"

#: Module -> public names that it defines.
_NAMES = {
    "pumaid.api": "Answer Arm Identified identify load read_recipe segment",
    "pumaid.dataset": "Bins Dataset FileFacts Log Reject Run",
    "pumaid.design.plan": "plan",
    "pumaid.effects": "catalogue",
    "pumaid.errors": "Faults LogError ModelError Note PumaidError RecipeError ResultError Where",
    "pumaid.exports": "Exported export",
    "pumaid.io.log_reader": "LogReader",
    "pumaid.diagnosis.records": "Candidate Curve Diagnosis Finding JointDiagnosis Limit Size Unexplained"
    " read_diagnosis write_diagnosis",
    "pumaid.estimate": "Combination Estimate JointFit Value",
    "pumaid.estimation.evaluate": "Budget BudgetPart Comparison JointScore RunScore",
    "pumaid.effects.formula": "Samples",
    "pumaid.results.history": "History Ladder Rung read_history",
    "pumaid.results.documents": "read_model write_model",
    "pumaid.reporting.figures.style": "Drawing",
    "pumaid.robot": "EffectChoice Joint LogFormat Robot",
    "pumaid.trajectory": "Motion NextRun Plan Posture Trajectory",
    "pumaid.diagnosis.compare": "compare",
    "pumaid.diagnosis.diagnose": "diagnose",
    "pumaid.simulation.session": "simulate",
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pumaid' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
