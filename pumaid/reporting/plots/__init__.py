"""Figures: every module of this folder that has ``drawings`` and ``ORDER`` is one kind, found by looking here."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

from pumaid.reporting.plots.style import Drawing
from pumaid.reporting.story import Story


def drawings(story: Story) -> Iterator[Drawing]:
    """Every figure of a story, in the order of the report."""
    modules = [importlib.import_module(f"{__name__}.{info.name}") for info in pkgutil.iter_modules(__path__)]
    kinds = [module for module in modules if hasattr(module, "drawings")]
    for kind in sorted(kinds, key=lambda module: module.ORDER):
        yield from kind.drawings(story)
