"""Frozen records that flow through the program; they hold, and compute nothing but their own names."""

from pumaid.records.comparison import TOGETHER, UNEXPLAINED, Comparison, JointScore, OutsideScore, RunScore
from pumaid.records.estimate import (
    GIVEN,
    IDENTIFIED,
    NOT_IDENTIFIABLE,
    Combination,
    Estimate,
    JointFit,
    Value,
)
from pumaid.records.log import Log
from pumaid.records.plan import Motion, Plan, Posture
from pumaid.records.robot import EffectChoice, Joint, LogFormat, Robot
from pumaid.records.run import (
    CONSTANT_COLUMNS,
    STROKE_COLUMNS,
    Cells,
    Evidence,
    FileFacts,
    Reject,
    Run,
)
from pumaid.records.samples import Samples

__all__ = [
    "CONSTANT_COLUMNS",
    "GIVEN",
    "IDENTIFIED",
    "NOT_IDENTIFIABLE",
    "STROKE_COLUMNS",
    "TOGETHER",
    "UNEXPLAINED",
    "Cells",
    "Combination",
    "Comparison",
    "EffectChoice",
    "Estimate",
    "Evidence",
    "FileFacts",
    "Joint",
    "JointFit",
    "JointScore",
    "Log",
    "LogFormat",
    "Motion",
    "OutsideScore",
    "Plan",
    "Posture",
    "Reject",
    "Robot",
    "Run",
    "RunScore",
    "Samples",
    "Value",
]
