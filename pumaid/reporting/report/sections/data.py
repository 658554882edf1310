"""The data: files, runs found, what was left out and why."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.report.base import Section
from pumaid.reporting.runs import by_reason, joint_grid, samples_read
from pumaid.reporting.story import Story
from pumaid.reporting.wording import data_sentence
from pumaid.units import number


class Data(Section):
    """What the one pass over the logs found."""

    order = 20
    title = "The data"

    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        dataset = story.dataset
        return {
            "sentence": data_sentence(story),
            "files": _files(story) if dataset.files else None,
            "joints": joint_grid(dataset, story.robot, units=story.units),
            "left": _left(story) if dataset.rejects else None,
            "picture": drawings.get("segments"),
        }


def _files(story: Story) -> Grid:
    rows: list[list[str | Cell]] = [
        [
            facts.name,
            f"{facts.rows:,}",
            f"{number(1e3 * facts.interval, 3)} ms",
            f"{number(facts.last_time - facts.first_time, 4)} s",
            facts.digest[:12],
        ]
        for facts in story.dataset.files
    ]
    header = ("file", "rows", "interval", "lasts", "SHA-256")
    return grid("Logs", header, rows, lefts=(0, 4))


def _left(story: Story) -> Grid:
    read = samples_read(story.dataset)
    rows: list[list[str | Cell]] = []
    for reason, rejects in by_reason(story.dataset.rejects).items():
        samples = sum(reject.samples for reject in rejects)
        longest = max(rejects, key=lambda reject: reject.samples)
        rows.append([reason, str(len(rejects)), f"{100.0 * samples / max(read, 1):.1f} %", longest.text])
    header = ("reason", "stretches", "of all samples", "the longest of them")
    return grid("Left out, and why", header, rows, lefts=(0, 3))
