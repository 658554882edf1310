"""The sections of the report: one file each with one class, and a template of the same name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import Drawing

#: Figures of a section by name; what its template sees by name.
Figures = Mapping[str, Drawing]
Content = dict[str, object]


class Section(ABC):
    """One section of the page, with its place on it and its heading.

    Sections are found by looking into this folder and sorted by `order`, with gaps for new ones. The template is
    ``templates/<file name>.html``; it sees `content`. Tables stand in it as ``{{ table }}``, figures as
    ``{{ figure(drawing) }}``.
    """

    order: ClassVar[int]
    title: ClassVar[str]

    @property
    def name(self) -> str:
        """The file's name; also the anchor on the page."""
        return type(self).__module__.rsplit(".", 1)[-1]

    def applies(self, context: ReportContext) -> bool:
        """Whether there is anything to show in this section."""
        return True

    def figures(self, context: ReportContext) -> list[Drawing]:
        """The figures of this section."""
        return []

    @abstractmethod
    def content(self, context: ReportContext, figures: Figures) -> Content:
        """What the template sees, with the section's `figures`; text is escaped there."""
