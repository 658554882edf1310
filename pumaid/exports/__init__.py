"""The model for other programs; every module of ``forms`` is one form, found by looking."""

from __future__ import annotations

import functools
import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType

from pumaid.exports.base import Exported, Form, Subject

__all__ = ["Exported", "Form", "Subject", "every_form"]


@functools.cache
def every_form() -> Mapping[str, Form]:
    """Every form by its name."""
    folder = importlib.import_module(f"{__name__}.forms")
    found: dict[str, Form] = {}
    for info in pkgutil.iter_modules(folder.__path__):
        module = importlib.import_module(f"{folder.__name__}.{info.name}")
        for member in vars(module).values():
            if inspect.isclass(member) and issubclass(member, Form) and member.__module__ == module.__name__:
                found[info.name] = member()
    return MappingProxyType(found)
