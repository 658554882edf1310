"""Diagnosis: missing effects, their evidence and rivals, and the runs that would decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.diagnosis.records import UNEXPLAINED_JOINT, Diagnosis, Finding
from pumaid.reporting import diagnosis_text as text
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.diagnosis import finding_figures, shape_figures
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Section
from pumaid.reporting.tables import candidate_table, deciding_runs_table, limit_table


class DiagnosisSection(Section):
    """The diagnosis that was made of the model."""

    order = 60
    title = "Missing effects"

    def applies(self, context: ReportContext) -> bool:
        return context.diagnosis is not None

    def figures(self, context: ReportContext) -> Sequence[Drawing]:
        diagnosis = _diagnosis(context)
        drawings: list[Drawing] = []
        for kind, findings in (("finding", diagnosis.findings), ("added", diagnosis.applied)):
            for number, finding in enumerate(findings, start=1):
                name = f"{kind}_{number}"
                drawings += finding_figures(finding, context.robot, name=name, units=context.units)
        for joint in diagnosis.joints:
            drawings += shape_figures(joint, context.robot, context.units)
        return drawings

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        diagnosis, robot = _diagnosis(context), context.robot
        added = [
            _finding(finding, context, figures, name=f"added_{number}") | {"title": text.applied_title(finding, robot)}
            for number, finding in enumerate(diagnosis.applied, start=1)
        ]
        unexplained = [
            {
                "title": text.unexplained_title(joint, robot),
                "sentences": text.unexplained_sentences(joint, context.units),
                "figures": _of(figures, f"unexplained_j{joint.joint}"),
            }
            for joint in diagnosis.joints
            if joint.verdict == UNEXPLAINED_JOINT
        ]
        headline = text.headline(diagnosis, robot).removeprefix(f"{robot.name}: ")
        tables = [candidate_table(diagnosis, robot), limit_table(diagnosis, robot, units=context.units)]
        return {
            "stale": context.stale,
            "headline": headline[:1].upper() + headline[1:],
            "findings": [
                _finding(finding, context, figures, name=f"finding_{number}")
                for number, finding in enumerate(diagnosis.findings, start=1)
            ],
            "others": [*unexplained, *added],
            "sentences": [*text.other_sentences(diagnosis, robot), *text.adequate_sentences(diagnosis, robot)],
            "limits": text.weaknesses(diagnosis, robot),
            "tables": [table for table in tables if table is not None],
        }


def _diagnosis(context: ReportContext) -> Diagnosis:
    assert context.diagnosis is not None
    return context.diagnosis


def _of(figures: Mapping[str, Drawing], name: str) -> list[Drawing]:
    return [drawing for key, drawing in figures.items() if key == name or key.startswith(f"{name}_")]


def _finding(
    finding: Finding, context: ReportContext, figures: Mapping[str, Drawing], *, name: str
) -> dict[str, object]:
    sentences = text.finding_sentences(finding, _diagnosis(context), context.robot, units=context.units)
    return {
        "title": text.finding_title(finding, context.robot),
        "sentences": sentences,
        "decision": text.decision_sentence(finding),
        "command": finding.command,
        "runs": deciding_runs_table(finding, context.robot, context.units),
        "figures": _of(figures, name),
    }
