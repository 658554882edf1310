"""Notes of this experiment and limits of the method."""

from __future__ import annotations

from pumaid.reporting.context import ReportContext
from pumaid.reporting.sections import Content, Section
from pumaid.reporting.text import METHOD_LIMITS, merge_notes


class Limits(Section):
    """What the numbers do not say."""

    order, title = 80, "Notes and limits"

    def content(self, context: ReportContext) -> Content:
        notes = (*context.dataset.notes, *context.estimate.notes, *context.comparison.notes)
        return {"notes": merge_notes(notes), "limits": METHOD_LIMITS}
