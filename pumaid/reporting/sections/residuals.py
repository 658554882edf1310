"""Residuals: their parts, their dependence on everything that was measured, the runs with the largest errors."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.residuals import budget_figure, budgets, residual_figures
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.tables import outside_table, worst_runs_table
from pumaid.reporting.text import budget_limit_sentences, budget_sentence, is_noise_only, noise_only_sentence

#: Runs in the table of the worst.
WORST = 8


class Residuals(Section):
    """What the model does not explain."""

    order, title = 50, "Residuals"

    def applies(self, context: ReportContext) -> bool:
        return bool(context.comparison.runs)

    def content(self, context: ReportContext) -> Content:
        comparison, robot = context.comparison, context.robot
        loud = [score for score in budgets(context) if score.budget and not is_noise_only(score.budget)]
        worst = worst_runs_table(comparison, robot, count=WORST, units=context.units)
        return {
            "joints": [budget_sentence(score, robot) for score in loud],
            "noise_only": noise_only_sentence(comparison, robot),
            "limits": budget_limit_sentences(comparison, robot),
            "budget": budget_figure(context),
            "figures": residual_figures(context),
            "tables": [table for table in (worst, outside_table(comparison, robot)) if table is not None],
        }
