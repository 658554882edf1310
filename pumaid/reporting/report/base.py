"""The contract of a report's section: what one file under ``sections/`` states."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.story import Story


class Section(ABC):
    """One part of the page: a file with one class, and a template of the same name.

    Sections are found by looking into the folder and stand in the order of `order`; gaps between the numbers are room
    for what comes. The template is ``templates/<name>.html``; it sees `content` and the macros of ``parts.html``.

    Attributes
    ----------
    order
        Place on the page, the smallest first.
    title
        Its heading.

    Examples
    --------
    >>> class Greeting(Section):
    ...     order = 5
    ...     title = "Good morning"
    ...
    ...     def content(self, story, drawings):
    ...         return {"words": f"This is {story.robot.name}."}
    """

    order: ClassVar[int]
    title: ClassVar[str]

    @property
    def name(self) -> str:
        """The file's name; also the anchor on the page."""
        return type(self).__module__.rsplit(".", 1)[-1]

    def applies(self, story: Story) -> bool:
        """Whether `story` has anything to tell here."""
        return True

    @abstractmethod
    def content(self, story: Story, drawings: Mapping[str, Drawing]) -> dict[str, object]:
        """What the template sees.

        Parameters
        ----------
        story
            All that is known.
        drawings
            Every figure by its name.

        Returns
        -------
        content
            Names for the template; words are escaped there.
        """
