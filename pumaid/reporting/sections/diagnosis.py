"""Diagnosis: missing effects, their evidence and rivals, and the runs that would decide."""

from __future__ import annotations

from pumaid.diagnosis.records import UNEXPLAINED_JOINT, Diagnosis, Finding
from pumaid.reporting import diagnosis_text as text
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.diagnosis import finding_figures, shape_figures
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Content, Figures, Section
from pumaid.reporting.tables import candidate_table, deciding_runs_table, limit_table


class DiagnosisSection(Section):
    """The diagnosis that was made of the model."""

    order, title = 60, "Missing effects"

    def applies(self, context: ReportContext) -> bool:
        return context.diagnosis is not None

    def figures(self, context: ReportContext) -> list[Drawing]:
        drawings: list[Drawing] = []
        for name, finding in _named(_diagnosis(context)).items():
            drawings += finding_figures(finding, context.robot, name=name, units=context.units)
        for joint in _diagnosis(context).joints:
            drawings += shape_figures(joint, context.robot, context.units)
        return drawings

    def content(self, context: ReportContext, figures: Figures) -> Content:
        diagnosis, robot = _diagnosis(context), context.robot
        blocks = {name: _block(name, finding, context, figures) for name, finding in _named(diagnosis).items()}
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
            "findings": [block for name, block in blocks.items() if name.startswith("finding")],
            "others": [*unexplained, *(block for name, block in blocks.items() if name.startswith("added"))],
            "sentences": text.other_sentences(diagnosis, robot),
            "limits": text.weaknesses(diagnosis, robot),
            "tables": [table for table in tables if table is not None],
        }


def _diagnosis(context: ReportContext) -> Diagnosis:
    assert context.diagnosis is not None
    return context.diagnosis


def _named(diagnosis: Diagnosis) -> dict[str, Finding]:
    """Findings by the name that their figures begin with."""
    kinds = {"finding": diagnosis.findings, "added": diagnosis.applied}
    return {f"{kind}_{number}": item for kind, items in kinds.items() for number, item in enumerate(items, start=1)}


def _of(figures: Figures, name: str) -> list[Drawing]:
    return [drawing for key, drawing in figures.items() if key == name or key.startswith(f"{name}_")]


def _block(name: str, finding: Finding, context: ReportContext, figures: Figures) -> Content:
    title = text.applied_title if name.startswith("added") else text.finding_title
    return {
        "title": title(finding, context.robot),
        "sentences": text.finding_sentences(finding, _diagnosis(context), context.robot, units=context.units),
        "decision": text.decision_sentence(finding),
        "command": finding.command,
        "runs": deciding_runs_table(finding, context.robot, context.units),
        "figures": _of(figures, name),
    }
