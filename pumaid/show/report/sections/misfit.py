"""Where it fails: the shape of what is left, the worst runs, what lies outside runs."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.show.plots.style import Drawing
from pumaid.show.report.base import Section
from pumaid.show.scores import is_above_floor, outside_grid, worst_grid
from pumaid.show.story import Story
from pumaid.show.wording import listed, noise_sentence

#: Runs listed on the page.
WORST = 8


class Misfit(Section):
    """Residuals by everything that could cause them."""

    order = 50
    title = "Where it fails"

    def applies(self, story: Story) -> bool:
        return bool(story.comparison.runs)

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        return {
            "sentence": _verdict(story),
            "figures": [drawing for name, drawing in drawings.items() if name.startswith("residual_")],
            "campaign": drawings.get("campaign"),
            "worst": worst_grid(story.comparison, story.robot, count=WORST, units=story.units),
            "outside": outside_grid(story.comparison, story.robot),
        }


def _verdict(story: Story) -> str:
    scores = story.comparison.joints
    above = [score.joint for score in scores if is_above_floor(score.rmse, score.noise_floor)]
    words = []
    if above:
        titles = listed([story.title(joint) for joint in above])
        words.append(f"{titles}: more is left than repeated runs differ by, so some physics is missing.")
    unsure = noise_sentence(story)
    if unsure:
        words.append(unsure)
    if not words:
        words.append("No joint's error is above what repeated runs differ by.")
    return " ".join(words)
