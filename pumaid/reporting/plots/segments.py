"""The segments picture as a figure of the report; it is drawn elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pumaid.dataset import Dataset
from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.segments import draw
from pumaid.reporting.story import Story

#: Where it stands among the figures of a report.
ORDER = 5

#: Runs shown; more would be a page of its own (``pumaid segment --picture`` draws all).
MOST_RUNS = 72


def drawings(story: Story) -> Iterator[Drawing]:
    """One figure of the logs, or of their beginning."""
    count = len(story.dataset.runs)
    if count:
        which = f"The first {MOST_RUNS} of {count} runs. " if count > MOST_RUNS else ""
        yield Drawing(
            "segments",
            "Runs found in the logs",
            f"{which}Velocity and position against time; runs in their joint's colour, what was left out hatched.",
            lambda: draw(beginning(story.dataset), story.robot, units=story.units),
        )


def beginning(dataset: Dataset) -> Dataset:
    """The evidence up to run number `MOST_RUNS`."""
    if len(dataset.runs) <= MOST_RUNS:
        return dataset
    runs = dataset.runs[:MOST_RUNS]
    last = runs[-1]
    earlier = {run.origin for run in runs} - {last.origin}
    rejects = tuple(
        reject
        for reject in dataset.rejects
        if reject.origin in earlier or (reject.origin == last.origin and reject.start < last.start)
    )
    return replace(dataset, runs=runs, rejects=rejects)
