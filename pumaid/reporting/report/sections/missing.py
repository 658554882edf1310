"""What is missing: the effects that the residual asks for, the evidence, the rivals, the run that would decide."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.records import UNEXPLAINED_JOINT, Finding
from pumaid.reporting import findings, verdicts
from pumaid.reporting.evidence import evidence_grid, limits_grid, runs_grid
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story


class Missing(Section):
    """A diagnosis, where one was made."""

    order = 60
    title = "What is missing"

    def applies(self, story: Story) -> bool:
        return story.diagnosis is not None

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        told, robot = story.diagnosis, story.robot
        assert told is not None
        figures = {name: drawing for name, drawing in drawings.items() if name.startswith("finding_")}
        added = {name: drawing for name, drawing in drawings.items() if name.startswith("added_")}
        return {
            "stale": story.stale,
            "headline": verdicts.headline(told, robot).partition(": ")[2],
            "findings": [
                _finding(one, story, _own(figures, f"finding_{number}_"))
                for number, one in enumerate(told.findings, start=1)
            ],
            "unexplained": [
                {
                    "title": verdicts.unexplained_title(one, robot),
                    "sentences": verdicts.unexplained_sentences(one, story.units),
                    "figures": _own(drawings, f"unexplained_j{one.joint}"),
                }
                for one in told.joints
                if one.verdict == UNEXPLAINED_JOINT
            ],
            "others": [*verdicts.other_sentences(told, robot), *verdicts.adequate_sentences(told, robot)],
            "weak": verdicts.weaknesses(told, robot),
            "evidence": evidence_grid(told, robot),
            "limits": limits_grid(told, robot, units=story.units),
            "added": [
                _finding(one, story, _own(added, f"added_{number}_"))
                for number, one in enumerate(told.applied, start=1)
            ],
        }


def _own(drawings: Mapping[str, Drawing], start: str) -> list[Drawing]:
    return [drawing for name, drawing in drawings.items() if name.startswith(start)]


def _finding(found: Finding, story: Story, figures: list[Drawing]) -> dict[str, object]:
    told = story.diagnosis
    assert told is not None
    return {
        "title": findings.finding_title(found, story.robot),
        "added_title": findings.added_title(found, story.robot),
        "sentences": findings.finding_sentences(found, told, story.robot, units=story.units),
        "decision": findings.decision_sentence(found),
        "command": found.command,
        "runs": runs_grid(found, story.robot, story.units),
        "figures": figures,
    }
