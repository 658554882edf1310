"""The sections of the report: a class each, and a template of the same name; those of every report are `standard`."""

from abc import ABC, abstractmethod
from typing import ClassVar

from pumaid.reporting.context import ReportContext

#: What a section's template sees by name.
Content = dict[str, object]


class Section(ABC):
    """One section of the page, with its place on it and its heading.

    Sections are found by looking into this folder and sorted by `order`, with gaps for new ones. The template is
    ``templates/NAME.html``; it sees `content`. Tables stand in it as ``{{ table }}``, figures as
    ``{{ figure(drawing) }}``.
    """

    order: ClassVar[int]
    title: ClassVar[str]

    @property
    def name(self) -> str:
        """The class's name in lower case, without ``Section``; also the anchor on the page."""
        return type(self).__name__.removesuffix("Section").lower()

    @abstractmethod
    def content(self, context: ReportContext) -> Content | None:
        """What the template sees, where it is escaped; None where there is nothing to show.

        Drawings in it, also in lists, become files of the report.
        """
