"""Where it fails: where the error lives, the shape of what is left, the worst runs, what lies outside runs."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.budget import budget_sentence, found_parts, is_plain, limit_sentences, noise_only_sentence
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.scores import outside_grid, worst_grid
from pumaid.reporting.story import Story
from pumaid.reporting.wording import listed, noise_sentence

#: Runs listed on the page.
WORST = 8


class Misfit(Section):
    """Residuals by everything that could cause them."""

    order = 50
    title = "Where it fails"

    def applies(self, story: Story) -> bool:
        return bool(story.comparison.runs)

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        split = [score for score in story.comparison.joints if score.budget is not None and not is_plain(score.budget)]
        return {
            "sentence": _verdict(story),
            "told": [budget_sentence(score, story.robot) for score in split],
            "plain": noise_only_sentence(story.comparison, story.robot),
            "limits": limit_sentences(story.comparison),
            "budget": drawings.get("budget"),
            "figures": [drawing for name, drawing in drawings.items() if name.startswith("residual_")],
            "campaign": drawings.get("campaign"),
            "worst": worst_grid(story.comparison, story.robot, count=WORST, units=story.units),
            "outside": outside_grid(story.comparison, story.robot),
        }


def _verdict(story: Story) -> str:
    """Whether any joint's error is more than noise."""
    scores = [score for score in story.comparison.joints if score.budget is not None]
    found = [story.title(score.joint) for score in scores if score.budget and found_parts(score.budget)]
    if found:
        return f"Some physics is missing: more is left than noise explains of {listed(found)}."
    return noise_sentence(story) or "Of no joint more is left than noise explains."
