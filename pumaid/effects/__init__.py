"""The catalogue of physical effects: every module of this folder is one, and so are files that a user names."""

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path

from pumaid.effects.base import NO_SHAPE, Effect, Extent, Family, Parameter, Scope, Shape, Trace, load_refusal
from pumaid.effects.formula import Loads, Samples
from pumaid.effects.plugins import effect_in, from_file

__all__ = [
    "NO_SHAPE",
    "Effect",
    "Extent",
    "Family",
    "Loads",
    "Parameter",
    "Samples",
    "Scope",
    "Shape",
    "Trace",
    "catalogue",
    "include",
    "load_refusal",
]

#: Modules of this folder that hold no effect.
SHARED = ("base", "formula", "plugins")
#: Files that a user named in this process -> their effects.
_INCLUDED: dict[Path, Effect] = {}


@functools.cache
def catalogue() -> Mapping[str, Effect]:
    """Every effect by its name: this folder's, and those of files that were included."""
    return _built_in() | {effect.name: effect for effect in _INCLUDED.values()}


def include(path: Path) -> Effect:
    """Add the effect in a ``.py`` file to the catalogue of this process; its name is the file's.

    The file holds one class made from `Effect`. It is run, so only one that the user names may come here, never one
    that a recipe or a model names; a file that was included before is not run again. Raises ModelError: effect-file
    where it cannot be run, or holds no effect or several; effect-taken; effect-contract where the effect does not keep
    what every effect promises, tried on a small arm and made-up motions.
    """
    place = path.resolve()
    if place not in _INCLUDED:
        _INCLUDED[place] = from_file(path, taken=catalogue())
        catalogue.cache_clear()
    return _INCLUDED[place]


@functools.cache
def _built_in() -> dict[str, Effect]:
    names = sorted(info.name for info in pkgutil.iter_modules(__path__) if not info.ispkg and info.name not in SHARED)
    return {name: effect_in(importlib.import_module(f"{__name__}.{name}")) for name in names}
