"""A recipe for the same arm on a tilted base: the file as it is, with another gravity."""

from __future__ import annotations

import io
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq


def with_gravity(path: Path, gravity: tuple[float, float, float]) -> str:
    """A recipe's text with its gravity replaced; comments and order stay.

    Parameters
    ----------
    path
        The recipe, which can be read.
    gravity
        m/s2, in base axes.
    """
    yaml = YAML(typ="rt")
    yaml.preserve_quotes = True
    yaml.width = 4096
    content = yaml.load(path.read_text(encoding="utf-8"))
    values = CommentedSeq(gravity)
    values.fa.set_flow_style()
    content["gravity"] = values
    out = io.StringIO()
    yaml.dump(content, out)
    return out.getvalue()
