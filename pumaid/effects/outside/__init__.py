"""Effects from outside the package: a file that a user names, or an entry point of an installed package."""

from __future__ import annotations

import importlib.util
import inspect
import re
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType

from pumaid.effects.base import Effect
from pumaid.effects.outside.contract import breach
from pumaid.effects.outside.failing import refused
from pumaid.effects.outside.guard import guarded
from pumaid.errors import ModelError, Where

#: The group of entry points that is searched.
GROUP = "pumaid.effects"

#: Package under which files are run: their module's last name is the effect's.
PACKAGE = "pumaid_effect_files"

_MEND = "docs/adding_an_effect.md shows such a file"


def effect_in(module: ModuleType) -> Effect:
    """The one effect that a module defines.

    Raises
    ------
    ModelError [effect-file]
        It defines none, several, or one that is made from another effect.
    """
    where = Where(file=getattr(module, "__file__", None) or module.__name__)
    defined = [
        member
        for member in vars(module).values()
        if inspect.isclass(member) and issubclass(member, Effect) and member.__module__ == module.__name__
    ]
    if len(defined) != 1:
        names = ", ".join(member.__name__ for member in defined) or "none"
        raise ModelError("effect-file", f"a file holds one effect, this one holds {names}", where, _MEND)
    if defined[0].__bases__ != (Effect,):
        raise ModelError("effect-file", f"{defined[0].__name__} is made from something else than Effect", where, _MEND)
    if inspect.isabstract(defined[0]):
        lacks = ", ".join(sorted(defined[0].__abstractmethods__))
        raise ModelError("effect-file", f"{defined[0].__name__} does not say its {lacks}", where, _MEND)
    found: Effect = defined[0]()
    return found


def from_file(path: Path, *, taken: Mapping[str, Effect]) -> Effect:
    """The effect in a file, run and checked; `taken` are the effects that there are already."""
    where, name = Where(file=str(path)), path.stem
    if path.suffix != ".py" or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        what = f"{path.name} is no name for an effect's file"
        raise ModelError("effect-file", what, where, "call it as the effect: lower case, digits and _, then .py")
    if not path.is_file():
        raise ModelError("effect-file", "there is no such file", where, "check the name and the folder")
    _refuse_taken(name, where, taken)
    spec = importlib.util.spec_from_file_location(f"{PACKAGE}.{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with ExitStack() as undone:
        sys.modules[spec.name] = module
        undone.callback(sys.modules.pop, spec.name, None)
        with refused(lambda words: ModelError("effect-file", f"it fails when it is run: {words}", where, _MEND)):
            spec.loader.exec_module(module)
            effect = effect_in(module)
            _check(effect, where, taken)
            guarded(effect, where)
        undone.pop_all()
    return effect


def from_entry_points(taken: Mapping[str, Effect]) -> dict[str, Effect]:
    """Effects of installed packages; an entry point names a module that holds one effect.

    Raises
    ------
    ModelError [effect-file, effect-contract, effect-taken]
        One cannot be used; the package that brings it is named.
    """
    found: dict[str, Effect] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        effect = _loaded(point, {**taken, **found})
        found[effect.name] = effect
    return found


def _loaded(point: EntryPoint, taken: Mapping[str, Effect]) -> Effect:
    """An entry point's effect, checked; `taken` are the effects that there are already."""
    where, mend = _place(point), "mend the package that brings it, or remove it"

    def refusal(words: str) -> ModelError:
        return ModelError("effect-file", f"the effect {point.name} cannot be loaded: {words}", where, mend)

    with refused(refusal):
        module = point.load()
        if not isinstance(module, ModuleType):
            what = f"the entry point {point.name} names no module but {point.value}"
            raise ModelError("effect-file", what, where, "name the module that holds the effect")
        effect = effect_in(module)
        _refuse_taken(effect.name, where, taken)
        _check(effect, where, taken)
        return guarded(effect, where)


def _place(point: EntryPoint) -> Where:
    package = point.dist.name if point.dist is not None else "a package"
    return Where(file=f"{package}: {point.value}", field=f"entry point {point.name}")


def _refuse_taken(name: str, where: Where, taken: Mapping[str, Effect]) -> None:
    if name in taken or name == "base":
        what = f"there is an effect {name} already"
        raise ModelError("effect-taken", what, where, "give the file another name")


def _check(effect: Effect, where: Where, taken: Mapping[str, Effect]) -> None:
    found = breach(effect, known={*taken, effect.name})
    if found is not None:
        raise ModelError("effect-contract", f"{effect.name}: {found}", where, _MEND)
