"""Notes of this experiment and limits of the method."""

from __future__ import annotations

from collections.abc import Mapping

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import Drawing
from pumaid.reporting.sections import Section
from pumaid.reporting.text import METHOD_LIMITS, merge_notes


class Limits(Section):
    """What the numbers do not say."""

    order = 80
    title = "Notes and limits"

    def content(self, context: ReportContext, figures: Mapping[str, Drawing]) -> dict[str, object]:
        notes = (*context.dataset.notes, *context.estimate.notes, *context.comparison.notes)
        return {"notes": merge_notes(notes), "limits": METHOD_LIMITS}
