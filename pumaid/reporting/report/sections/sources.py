"""Sources: the literature behind what was used, digests of the inputs, versions."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.effects import catalogue
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.story import Story


class Sources(Section):
    """What is needed to do it again."""

    order = 90
    title = "Sources and versions"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        return {"sources": _sources(story), "inputs": _inputs(story), "model_version": story.estimate.version}


def _sources(story: Story) -> list[tuple[str, list[str]]]:
    """Each source once, with the effects that rest on it."""
    used = dict.fromkeys(name.split(".")[0] for name in story.estimate.names)
    found: dict[str, list[str]] = {}
    for effect in (catalogue()[name] for name in used if name in catalogue()):
        found.setdefault(effect.source, []).append(effect.title)
    return list(found.items())


def _inputs(story: Story) -> Grid:
    rows: list[list[str | Cell]] = [["recipe", story.robot.origin or "in memory", story.robot.digest or "-"]]
    rows += [["fitted log", name, digest] for name, digest in story.estimate.logs.items()]
    others = {name: digest for name, digest in story.comparison.logs.items() if digest not in _fitted(story)}
    rows += [["compared log", name, digest] for name, digest in others.items()]
    return grid("Inputs", ("what", "file", "SHA-256"), rows, lefts=(0, 1, 2))


def _fitted(story: Story) -> set[str]:
    return set(story.estimate.logs.values())
