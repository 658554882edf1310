"""Residuals: their parts, their dependence on everything that was measured, the runs with the largest errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.residuals import budget_figure, budgets, campaign_figure, residual_figures
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Section
from pumaid.reporting.tables import outside_table, worst_runs_table
from pumaid.reporting.text import (
    budget_limit_sentences,
    budget_sentence,
    budget_verdict,
    is_noise_only,
    noise_only_sentence,
)

#: Runs in the table of the worst.
WORST = 8


class Residuals(Section):
    """What the model does not explain."""

    order = 50
    title = "Residuals"

    def applies(self, context: ReportContext) -> bool:
        return bool(context.comparison.runs)

    def figures(self, context: ReportContext) -> Sequence[Drawing]:
        budget = [budget_figure(context)] if budgets(context) else []
        return [*budget, *residual_figures(context), campaign_figure(context)]

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        comparison, robot = context.comparison, context.robot
        loud = [score for score in budgets(context) if score.budget and not is_noise_only(score.budget)]
        tables = [worst_runs_table(comparison, robot, count=WORST, units=context.units)]
        outside = outside_table(comparison, robot)
        return {
            "sentence": budget_verdict(context),
            "joints": [budget_sentence(score, robot) for score in loud],
            "noise_only": noise_only_sentence(comparison, robot),
            "limits": budget_limit_sentences(comparison),
            "budget": figures.get("budget"),
            "figures": [drawing for name, drawing in figures.items() if name not in ("budget", "campaign")],
            "campaign": figures["campaign"],
            "tables": [*tables, *([outside] if outside else [])],
        }
