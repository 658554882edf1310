"""The sections of every report, in the order of the page."""

from functools import partial

import numpy as np

from pumaid.diagnosis.records import UNEXPLAINED_JOINT, Finding
from pumaid.effects import catalogue
from pumaid.reporting import tables, text
from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures import model, residuals
from pumaid.reporting.figures.arm import skeleton_figure
from pumaid.reporting.figures.runs import MOST_RUNS, run_figure
from pumaid.reporting.run_tables import axes_table, file_table, rejection_table, runs_by_joint_table
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.table import Table

#: Runs in the table of those with the largest errors.
WORST = 8


class Summary(Section):
    """The page's first screen."""

    order, title = 0, "Summary"

    def content(self, context: ReportContext) -> Content:
        scores = context.comparison.joints
        return {
            "sentences": text.summary_sentences(context.dataset, context.estimate),
            "joints": [text.joint_sentence(score, context.robot) for score in scores],
            "shares": model.share_figure(context) if any(score.shares for score in scores) else None,
        }


class ArmSection(Section):
    """The DH table and the skeleton."""

    order, title = 10, "Arm"

    def content(self, context: ReportContext) -> Content:
        robot, runs = context.robot, context.dataset.runs
        position = np.nan_to_num(runs[0].posture) if runs else np.zeros(robot.n_joints)
        gravity = ", ".join(f"{component:.6g}" for component in robot.gravity)
        table, skeleton = axes_table(robot, context.units), skeleton_figure(robot, position)
        return {"robot": robot, "gravity": gravity, "table": table, "skeleton": skeleton}


class Data(Section):
    """What the logs contain."""

    order, title = 20, "Data"

    def content(self, context: ReportContext) -> Content:
        dataset, robot, units = context.dataset, context.robot, context.units
        return {
            "joints": runs_by_joint_table(dataset, robot, units=units),
            "picture": run_figure(dataset, robot, units, limit=MOST_RUNS) if dataset.runs else None,
            "tables": [table for table in (rejection_table(dataset), file_table(dataset)) if table.rows],
        }


class Parameters(Section):
    """The paper's Table I for this arm."""

    order, title = 30, "Parameters"

    def content(self, context: ReportContext) -> Content:
        has_values = any(value.ci95 is not None for value in context.estimate.values)
        return {
            "table": tables.parameter_table(context.estimate, context.robot, context.units),
            "sums": tables.combination_table(context.estimate),
            "figure_of_values": model.parameter_figure(context) if has_values else None,
        }


class Prediction(Section):
    """The paper's Fig. 4 for each joint."""

    order, title = 40, "Model against measurement"

    def content(self, context: ReportContext) -> Content:
        ways = {(score.run.joint, score.run.direction) for score in context.comparison.runs}
        return {
            "both_ways": any((joint, -1) in ways and (joint, 1) in ways for joint in context.moving()),
            "table": tables.comparison_table(context.comparison, context.robot),
            "figures": [residuals.current_figure(context, joint) for joint in context.moving()],
        }


class Residuals(Section):
    """What the model does not explain."""

    order, title = 50, "Residuals"

    def content(self, context: ReportContext) -> Content | None:
        comparison, robot = context.comparison, context.robot
        if not comparison.runs:
            return None
        loud = [score for score in comparison.joints if score.budget and not text.is_noise_only(score.budget)]
        worst = tables.worst_runs_table(comparison, robot, count=WORST, units=context.units)
        return {
            "joints": [text.budget_sentence(score, robot) for score in loud],
            "limits": text.budget_limit_sentences(comparison, robot),
            "budget": residuals.budget_figure(context),
            "figures": [residuals.residual_figure(context, joint) for joint in context.moving()],
            "tables": [worst],
        }


class DiagnosisSection(Section):
    """The diagnosis that was made of the model."""

    order, title = 60, "Missing effects"

    def content(self, context: ReportContext) -> Content | None:
        diagnosis, robot, units = context.diagnosis, context.robot, context.units
        if diagnosis is None:
            return None
        unexplained = [
            {
                "title": text.unexplained_title(joint, robot),
                "sentences": text.unexplained_sentences(joint, units),
                "figures": [residuals.shape_figure(joint, robot, units)] if joint.unexplained else [],
            }
            for joint in diagnosis.joints
            if joint.verdict == UNEXPLAINED_JOINT
        ]
        added = [_block(f"added_{k}", finding, context) for k, finding in enumerate(diagnosis.applied, start=1)]
        headline = text.headline(diagnosis, robot).removeprefix(f"{robot.name}: ")
        return {
            "stale": context.stale,
            "headline": headline[:1].upper() + headline[1:],
            "findings": [_block(f"finding_{k}", item, context) for k, item in enumerate(diagnosis.findings, start=1)],
            "others": [*unexplained, *added],
            "sentences": text.other_sentences(diagnosis, robot),
            "limits": text.weaknesses(diagnosis, robot),
            "tables": [tables.candidate_table(diagnosis, robot), tables.limit_table(diagnosis, robot, units=units)],
        }


def _block(name: str, finding: Finding, context: ReportContext) -> Content:
    """A finding, or an effect that was added after an earlier one; the names of its figures begin with `name`."""
    robot, units = context.robot, context.units
    assert context.diagnosis is not None
    draw = partial(residuals.finding_figure, robot=robot, name=name, units=units)
    return {
        "title": text.finding_title(finding, robot, is_applied=name.startswith("added")),
        "sentences": text.finding_sentences(finding, context.diagnosis, robot, units=units),
        "decision": text.decision_sentence(finding),
        "command": finding.command,
        "runs": tables.deciding_runs_table(finding, robot, units),
        "figures": [draw(finding, curve) for curve in finding.curves],
    }


class HistorySection(Section):
    """The models of the experiment, if there are several."""

    order, title = 70, "History"

    def content(self, context: ReportContext) -> Content | None:
        ladder = context.ladder
        if ladder is None or len(ladder.rungs) < 2:
            return None
        steps = model.history_figure(ladder, width=model.PAGE_WIDTH) if len(ladder.path) > 1 else None
        return {"steps": steps, "tables": [tables.history_table(ladder), tables.history_joint_table(ladder)]}


class Limits(Section):
    """What the numbers do not say."""

    order, title = 80, "Notes and limits"

    def content(self, context: ReportContext) -> Content:
        notes = (*context.dataset.notes, *context.estimate.notes, *context.comparison.notes)
        return {"notes": text.merge_notes(notes), "limits": text.METHOD_LIMITS}


class Sources(Section):
    """What is needed to repeat the identification."""

    order, title = 90, "Sources and versions"

    def content(self, context: ReportContext) -> Content:
        titles: dict[str, list[str]] = {}
        for name in dict.fromkeys(name.split(".")[0] for name in context.estimate.names):
            if name in catalogue():
                titles.setdefault(catalogue()[name].source, []).append(catalogue()[name].title)
        fitted, compared = context.estimate.logs, context.comparison.logs
        rows = [["recipe", context.robot.origin or "in memory", context.robot.digest or "-"]]
        rows += [["fitted log", name, digest] for name, digest in fitted.items()]
        rows += [["compared log", name, digest] for name, digest in compared.items() if digest not in fitted.values()]
        inputs = Table("Inputs", ("kind", "file", "SHA-256"), rows, words=(0, 1, 2))
        return {"sources": titles, "inputs": inputs, "model_version": context.estimate.version}
