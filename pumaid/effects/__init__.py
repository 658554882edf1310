"""The catalogue of physical effects: every module of this folder is one."""

from __future__ import annotations

import functools
import importlib
import inspect
import pkgutil
from types import MappingProxyType

from pumaid.effects.base import Effect, Parameter, Scope, Shape, Trace

__all__ = ["Effect", "Parameter", "Scope", "Shape", "Trace", "catalogue"]


@functools.cache
def catalogue() -> MappingProxyType[str, Effect]:
    """Every effect by its name, found by looking into this folder."""
    found: dict[str, Effect] = {}
    for module_info in sorted(pkgutil.iter_modules(__path__), key=lambda info: info.name):
        if module_info.name == "base":
            continue
        module = importlib.import_module(f"{__name__}.{module_info.name}")
        for member in vars(module).values():
            if inspect.isclass(member) and issubclass(member, Effect) and member.__module__ == module.__name__:
                found[module_info.name] = member()
    return MappingProxyType(found)
