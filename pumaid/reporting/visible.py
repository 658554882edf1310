"""Names and sentences of others on a terminal: what would steer it is shown instead of obeyed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions
    from rich.segment import Segment

#: Control characters but for tab and line end, and letters that turn the direction of writing or end a line unseen.
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    """The text with what steers a terminal written as Python would write it (``\\x1b``).

    Parameters
    ----------
    text
        With names of files, joints and parameters in it, which may hold anything.
    """
    return _STEERING.sub(lambda found: ascii(found[0])[1:-1], text)


class Visible:
    """A table or text for the terminal in which nothing but its own style steers the terminal."""

    def __init__(self, renderable: Any) -> None:
        self.renderable = renderable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        from rich.segment import Segment

        for part in console.render(self.renderable, options):
            yield part if part.control else Segment(visible(part.text), part.style)
