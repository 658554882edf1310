"""Diagnosis: missing effects, their evidence and rivals, and the runs that would decide."""

from __future__ import annotations

from pumaid.diagnosis.records import UNEXPLAINED_JOINT, Finding
from pumaid.reporting import text
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.residuals import finding_figures, shape_figures
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.tables import candidate_table, deciding_runs_table, limit_table


class DiagnosisSection(Section):
    """The diagnosis that was made of the model."""

    order, title = 60, "Missing effects"

    def applies(self, context: ReportContext) -> bool:
        return context.diagnosis is not None

    def content(self, context: ReportContext) -> Content:
        diagnosis, robot, units = context.diagnosis, context.robot, context.units
        assert diagnosis is not None
        unexplained = [
            {
                "title": text.unexplained_title(joint, robot),
                "sentences": text.unexplained_sentences(joint, units),
                "figures": shape_figures(joint, robot, units),
            }
            for joint in diagnosis.joints
            if joint.verdict == UNEXPLAINED_JOINT
        ]
        added = [_block(f"added_{k}", finding, context) for k, finding in enumerate(diagnosis.applied, start=1)]
        headline = text.headline(diagnosis, robot).removeprefix(f"{robot.name}: ")
        tables = [candidate_table(diagnosis, robot), limit_table(diagnosis, robot, units=units)]
        return {
            "stale": context.stale,
            "headline": headline[:1].upper() + headline[1:],
            "findings": [_block(f"finding_{k}", item, context) for k, item in enumerate(diagnosis.findings, start=1)],
            "others": [*unexplained, *added],
            "sentences": text.other_sentences(diagnosis, robot),
            "limits": text.weaknesses(diagnosis, robot),
            "tables": [table for table in tables if table is not None],
        }


def _block(name: str, finding: Finding, context: ReportContext) -> Content:
    """A finding, or an effect that was added after an earlier one; the names of its figures begin with `name`."""
    robot, units = context.robot, context.units
    assert context.diagnosis is not None
    title = text.applied_title if name.startswith("added") else text.finding_title
    return {
        "title": title(finding, robot),
        "sentences": text.finding_sentences(finding, context.diagnosis, robot, units=units),
        "decision": text.decision_sentence(finding),
        "command": finding.command,
        "runs": deciding_runs_table(finding, robot, units),
        "figures": finding_figures(finding, robot, name=name, units=units),
    }
