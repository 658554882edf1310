"""Control characters in names of files and joints, made visible."""

import re

#: Control characters but for tab and line end, and letters that turn the direction of writing or end a line unseen.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    """The text with control characters as Python writes them (``\\x1b``), so that they do not steer a terminal."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)
