"""The sections of every report, in the order of the page."""

import numpy as np

from pumaid.diagnosis.records import Finding, JointDiagnosis
from pumaid.effects import catalogue
from pumaid.reporting import tables, text
from pumaid.reporting.figures import model
from pumaid.reporting.figures.experiment import MOST_RUNS, run_figure, skeleton_figure
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.page import Content, ReportContext, Section
from pumaid.reporting.run_tables import axes_table, rejection_table, runs_by_joint_table
from pumaid.reporting.table import Table

#: Limits of the method, whatever the data.
METHOD_LIMITS = (
    "Parameters are in units of each joint's own motor current; torque constants and gear ratios are neither known nor"
    " needed.",
    "Lengths a and d of a chain of revolute joints are absorbed in the parameters: a wrong length in the recipe is not"
    " detected here and does not change the predicted current.",
    "At constant speed there is no inertia in the current; only strokes and blocks of any motion contain it.",
    "Confidence intervals treat a run as one observation, because its samples share their error. With fewer than about"
    " ten runs a joint they are wide.",
    "Predictions are reliable within the postures, speeds and directions of the fitted runs.",
)

#: Runs in the table of those with the largest errors.
WORST = 8


def summary(context: ReportContext) -> Content:
    """The page's first screen."""
    scores = context.comparison.joints
    return {
        "sentences": [
            *([text.headline(context.diagnosis, context.robot)] if context.diagnosis else []),
            *text.summary_sentences(context.dataset, context.estimate),
        ],
        "joints": [text.joint_sentence(score, context.robot) for score in scores],
        "shares": model.share_figure(context) if any(score.shares for score in scores) else None,
    }


def arm(context: ReportContext) -> Content:
    """The DH table and the skeleton."""
    robot, runs = context.robot, context.dataset.runs
    return {
        "robot": robot,
        "gravity": ", ".join(f"{component:.6g}" for component in robot.gravity),
        "table": axes_table(robot, context.units),
        "skeleton": skeleton_figure(robot, np.nan_to_num(runs[0].posture) if runs else np.zeros(robot.n_joints)),
    }


def data(context: ReportContext) -> Content:
    """What the logs contain."""
    dataset, robot, units = context.dataset, context.robot, context.units
    return {
        "joints": runs_by_joint_table(dataset, robot, units=units),
        "picture": run_figure(dataset, robot, units, limit=MOST_RUNS) if dataset.runs else None,
        "rejects": rejection_table(dataset) if dataset.rejects else None,
    }


def parameters(context: ReportContext) -> Content:
    """The paper's Table I for this arm."""
    return {
        "table": tables.parameter_table(context.estimate, context.robot, context.units),
        "sums": tables.combination_table(context.estimate),
    }


def prediction(context: ReportContext) -> Content:
    """The paper's Fig. 4 for each joint."""
    ways = {(score.run.joint, score.run.direction) for score in context.comparison.runs}
    return {
        "both_ways": any((joint, -1) in ways and (joint, 1) in ways for joint in context.moving()),
        "table": tables.comparison_table(context.comparison, context.robot),
        "figures": [model.current_figure(context, joint) for joint in context.moving()],
    }


def residuals(context: ReportContext) -> Content | None:
    """What the model does not explain."""
    if not context.comparison.runs:
        return None
    return {
        "parts": tables.budget_table(context.comparison, context.robot),
        "figures": [model.residual_figure(context, [joint]) for joint in context.moving()],
        "worst": tables.worst_runs_table(context.comparison, context.robot, count=WORST, units=context.units),
    }


def missing(context: ReportContext) -> Content | None:
    """The diagnosis that was made of the model, as `pumaid diagnose` prints it, with a figure of each finding."""
    if context.diagnosis is None:
        return None

    def figures(number: int, item: Finding | JointDiagnosis | None) -> list[Drawing]:
        if isinstance(item, JointDiagnosis):
            shape = item.unexplained
            return [model.shape_figure(item.joint, shape, context.robot, units=context.units)] if shape else []
        return [
            model.finding_figure(*pair, context.robot, name=f"finding_{number}", units=context.units)
            for pair in ([(item, curve) for curve in item.curves] if item else [])
        ]

    blocks = tables.diagnosis_blocks(context.diagnosis, context.robot, units=context.units)
    return {
        "stale": context.stale,
        "blocks": [{"parts": parts, "figures": figures(number, item)} for number, (item, parts) in enumerate(blocks)],
    }


def history(context: ReportContext) -> Content | None:
    """The models of the experiment, if there are several."""
    ladder = context.ladder
    if ladder is None or len(ladder.rungs) < 2:
        return None
    return {
        "steps": model.history_figure(ladder, width=model.PAGE_WIDTH) if len(ladder.path) > 1 else None,
        "tables": [tables.history_table(ladder), tables.history_joint_table(ladder)],
    }


def limits(context: ReportContext) -> Content:
    """What the numbers do not say."""
    return {
        "notes": text.merge_notes((*context.dataset.notes, *context.estimate.notes, *context.comparison.notes)),
        "limits": METHOD_LIMITS,
    }


def sources(context: ReportContext) -> Content:
    """What is needed to repeat the identification."""
    effects = [
        catalogue()[name]
        for name in dict.fromkeys(name.split(".")[0] for name in context.estimate.names)
        if name in catalogue()
    ]
    titles = {x.source: [effect.title for effect in effects if effect.source == x.source] for x in effects}
    fitted, compared = context.estimate.logs, context.comparison.logs
    rows = [
        ["recipe", context.robot.origin or "in memory", context.robot.digest or "-"],
        *(["fitted log", name, digest] for name, digest in fitted.items()),
        *(["compared log", name, digest] for name, digest in compared.items() if digest not in fitted.values()),
    ]
    return {
        "sources": titles,
        "inputs": Table("Inputs", ("kind", "file", "SHA-256"), rows, words=(0, 1, 2)),
        "model_version": context.estimate.version,
    }


SECTIONS = (
    Section("summary", "Summary", 0, summary),
    Section("arm", "Arm", 10, arm),
    Section("data", "Data", 20, data),
    Section("parameters", "Parameters", 30, parameters),
    Section("prediction", "Model against measurement", 40, prediction),
    Section("residuals", "Residuals", 50, residuals),
    Section("diagnosis", "Missing effects", 60, missing),
    Section("history", "History", 70, history),
    Section("limits", "Notes and limits", 80, limits),
    Section("sources", "Sources and versions", 90, sources),
)
