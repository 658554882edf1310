"""The catalogue of physical effects: every module of this folder is one, and so are files that a user names.

A user's file is run, then tried once on made-up motions.
"""

import functools
import importlib.util
import inspect
import pkgutil
import re
import sys
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pumaid.effects.base import (
    NO_SHAPE,
    RARE,
    USUAL,
    Effect,
    Extent,
    Family,
    Parameter,
    Scope,
    Shape,
    Trace,
    load_refusal,
)
from pumaid.effects.formula import Loads, Samples, columns, filled
from pumaid.errors import ModelError, PumaidError, Where
from pumaid.robot import Joint, Robot

__all__ = [
    "NO_SHAPE",
    "RARE",
    "USUAL",
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
SHARED = ("base", "formula")
#: Files that a user named in this process -> their effects.
_INCLUDED: dict[Path, Effect] = {}


@functools.cache
def catalogue() -> dict[str, Effect]:
    """Every effect by its name: this folder's, and those of files that were included."""
    names = sorted(info.name for info in pkgutil.iter_modules(__path__) if not info.ispkg and info.name not in SHARED)
    return {name: effect_in(importlib.import_module(f"{__name__}.{name}")) for name in names}


def include(path: Path) -> Effect:
    """Add the effect in a ``.py`` file to the catalogue of this process; its name is the file's.

    The file holds one class made from `Effect`. It is run, so only one that the user names may come here, never one
    that a recipe or a model names; a file that was included before is not run again. Raises ModelError: effect-file
    where it cannot be run, or holds no effect or several; effect-taken; effect-contract where the effect does not keep
    what every effect promises, tried on a small arm and made-up motions.
    """
    place = path.resolve()
    if place not in _INCLUDED:
        effect = from_file(path, taken=catalogue())
        _INCLUDED[place] = catalogue()[effect.name] = effect
    return _INCLUDED[place]


# Files of a user

#: Instants of the made-up motion on which effects are tried.
INSTANTS = 24

_MEND = "docs/contributing.md shows such a file"
#: Three turning joints, a slide, two turning joints: any arm's kinds of joints, none of them special to gravity.
ARM = Robot(
    "an arm to try effects on",
    tuple(
        Joint(k, kind, kind, alpha=0.3 * k, a=0.3, d=0.1, limits=(-2.0, 2.0), max_velocity=2.0, gear_ratio=60.0)
        for k, kind in enumerate(["revolute"] * 3 + ["prismatic"] + ["revolute"] * 2, start=1)
    ),
)

#: What made-up runs of a joint cover.
EXTENT = Extent(1, (0.1, 0.3, 1.0), (-1.5, 1.5), 0.05, 3.0, tuple(10.0 * k for k in range(90)), 900.0, 3.0)


def effect_in(module: ModuleType) -> Effect:
    """The one effect that a module defines, else a ModelError [effect-file]."""
    defined: list[type[Effect]] = [
        member
        for member in vars(module).values()
        if inspect.isclass(member) and issubclass(member, Effect) and member.__module__ == module.__name__
    ]
    if len(defined) != 1 or defined[0].__bases__ != (Effect,):
        names = ", ".join(member.__name__ for member in defined) or "none"
        raise ModelError(
            "effect-file", f"a file holds one class made from Effect, not {names}", Where(file=module.__file__), _MEND
        )
    return defined[0]()


def from_file(path: Path, *, taken: Mapping[str, Effect]) -> Effect:
    """The effect in a file, run and tried; whatever its code raises is a refusal. `taken` are the effects there are."""
    where = Where(file=str(path))
    if path.suffix != ".py" or not re.fullmatch(r"[a-z][a-z0-9_]*", path.stem) or not path.is_file():
        what = "there is no such file" if not path.is_file() else f"{path.name} is no name for an effect's file"
        raise ModelError(
            "effect-file",
            what,
            where,
            "check the path; a file is called as its effect: lower case, digits and _, then .py",
        )
    if path.stem in taken or path.stem == "base":
        raise ModelError("effect-taken", f"there is an effect {path.stem} already", where, "give the file another name")
    spec = importlib.util.spec_from_file_location(f"pumaid_effect_files.{path.stem}", path)
    assert spec is not None and spec.loader is not None
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        effect = effect_in(module)
        fault = breach(effect, names={*taken, effect.name})
    except (KeyboardInterrupt, MemoryError, PumaidError):
        raise
    except BaseException as failure:  # be it a wish to leave the program
        raise ModelError("effect-file", f"the effect cannot be loaded: {_words(failure)}", where, _MEND) from failure
    if fault is not None:
        raise ModelError("effect-contract", f"{effect.name}: {fault}", where, _MEND)
    return effect


def _words(failure: BaseException) -> str:
    """A failure's kind, the first line of what it says, and for bad syntax the line of the file."""
    line = f", line {failure.lineno}" if isinstance(failure, SyntaxError) and failure.lineno else ""
    return ": ".join([type(failure).__name__, *str(failure).strip().splitlines()[:1]]) + line


def breach(effect: Effect, *, names: Collection[str]) -> str | None:
    """The first promise that an effect breaks, in words; None where it keeps all. `names` are those of all effects."""
    try:
        return next(
            (fault for checks in _checks(effect, names) for fault, is_broken in checks.items() if is_broken), None
        )
    except Exception as failure:
        forgot = not effect.needs_loads and isinstance(failure, AssertionError | AttributeError)
        hint = "; if it looks at samples.loads, write needs_loads = True" if forgot else ""
        return f"it fails on made-up motions: {_words(failure)}{hint}"


def _checks(effect: Effect, names: Collection[str]) -> Iterator[dict[str, bool]]:
    """What may be wrong with an effect's statements, then with what it makes of the arm's joints -> whether it is."""
    kinds = {"title": str, "equation": str, "source": str, "family": Family, "scope": Scope, "trace": tuple}
    stated = {word: getattr(effect, word, None) for word in kinds}
    yield {
        f"its {word} is {stated[word]!r}, which is no {word} of an effect": (
            not isinstance(stated[word], kind) or stated[word] in ("", (), Scope.LINK)
        )
        for word, kind in kinds.items()
    }
    yield {
        "its trace is not a tuple of Trace": not all(isinstance(trace, Trace) for trace in effect.trace),
        "base is for the paper's own effects": effect.base,
        **{f"its look-alike {name} is not in the catalogue": name not in names for name in effect.look_alikes},
    }
    joints = range(1, ARM.n_joints + 1)
    for number in [0] if effect.scope is Scope.ARM else joints:
        if effect.applies(ARM, number) is None:
            yield from _entry_checks(effect, number)
            for joint in joints if effect.scope in (Scope.ARM, Scope.CAUSE) else [number]:
                yield from column_checks(effect, number, joint)


def _entry_checks(effect: Effect, number: int) -> Iterator[dict[str, bool]]:
    """Of the parameters, shapes and grid of owner `number`."""
    parameters, shapes = effect.parameters(ARM, number), effect.shapes(ARM, number)
    entries: list[Any] = [*parameters, *shapes]
    listed, grid = [entry.name for entry in entries], effect.grid(ARM, replace(EXTENT, joint=number or None))
    yield {
        f"it has no parameters for {f'joint {number}' if number else 'the whole arm'}": not parameters,
        "its grid is empty": not grid,
    }
    for entry in entries:
        yield {
            f"{entry.name!r} is no name for a parameter, or is there twice": (
                not re.fullmatch(r"[A-Za-z]\w*", entry.name) or listed.count(entry.name) > 1
            ),
            f"{entry.name} has no unit or no meaning": not (entry.unit and entry.meaning),
            f"the example of {entry.name}, {entry.example:g}, is not between {entry.low:g} and {entry.high:g}": (
                not entry.low <= entry.example <= entry.high
            ),
        }
    bounds = {shape.name: (shape.low, shape.high) for shape in shapes}
    yield {
        f"its grid names other shapes than it has, or leaves their bounds: {dict(start)}": (
            set(start) != set(bounds) or any(not bounds[x][0] <= value <= bounds[x][1] for x, value in start.items())
        )
        for start in grid
    }


def column_checks(effect: Effect, number: int, joint: int) -> Iterator[dict[str, bool]]:
    """Of the columns in joint `joint` that owner `number` causes."""
    samples, parameters = example(joint, with_loads=effect.needs_loads), effect.parameters(ARM, number)
    shape = {entry.name: entry.example for entry in effect.shapes(ARM, number)}
    made, wanted = effect.columns(ARM, samples, number=number, shape=shape), (INSTANTS, len(parameters))
    yield {
        f"columns are {getattr(made, 'shape', type(made).__name__)} where {wanted} is one a parameter": (
            not isinstance(made, np.ndarray) or made.shape != wanted or made.dtype.kind not in "fiub"
        )
    }
    rows, formula = np.arange(INSTANTS)[::-3], effect.formula_in(ARM, number, joint)
    part = effect.columns(ARM, example(joint, with_loads=effect.needs_loads, rows=rows), number=number, shape=shape)
    yield {
        "columns are not all finite; where temperature or another joint's load is NaN they must be zero": (
            not np.isfinite(made).all()
        )
    }
    yield {"an instant's row depends on which other instants are shown": not _is_same(part, made[rows])}
    if formula:
        sizes = {entry.name: entry.example for entry in parameters}
        text, motion = f"whole * ({filled(formula, sizes)})", (ARM, samples, number or samples.joint)
        whole = columns(text, ("whole",), shape, motion=motion)[:, 0]
        yield {
            "its formula is not linear in its parameters, or is not what its columns say": not _is_same(
                made @ list(sizes.values()), whole
            )
        }


def _is_same(numbers: np.ndarray, others: np.ndarray) -> bool:
    return np.allclose(numbers, others, rtol=1e-9, atol=1e-9 * float(np.abs(others).max(initial=0.0)))


def example(joint: int, *, with_loads: bool, rows: Any = slice(None)) -> Samples:
    """Made-up instants (or `rows` of them) of joint `joint` of `ARM`, read-only; some other joints' loads are NaN."""
    rng, n = np.random.default_rng(joint), ARM.n_joints
    direction = np.where(np.arange(INSTANTS) < INSTANTS // 2, 1.0, -1.0)
    speed = direction * rng.uniform(0.1, 1.0, INSTANTS)
    loads = {
        "moving": rng.normal(size=INSTANTS),
        "by_joint": np.where(np.arange(n) == n - 1, np.nan, rng.normal(size=(INSTANTS, n))),
        "slopes": rng.normal(size=(INSTANTS, n)),
        "tilts": rng.normal(size=(INSTANTS, 2)),
        "across": np.abs(rng.normal(size=INSTANTS)),
        "drawn": rng.normal(size=INSTANTS),
        "rate": rng.normal(size=INSTANTS),
    }
    series = {
        "position": rng.uniform(-1.5, 1.5, (INSTANTS, n)),
        "velocity": np.where(np.arange(n) == joint - 1, speed[:, None], 0.0),
        "acceleration": rng.normal(size=INSTANTS),
        "direction": direction,
        "time": np.sort(rng.uniform(0.0, 900.0, INSTANTS)),
        "elapsed": np.sort(rng.uniform(0.0, 900.0, INSTANTS)),
        "travel": rng.uniform(0.0, 2.0, INSTANTS),
        "temperature": np.where(np.arange(INSTANTS) % 5 == 0, np.nan, rng.uniform(20.0, 40.0, INSTANTS)),
        "run": np.repeat(np.arange(4), INSTANTS // 4),
        "bodies": rng.normal(size=(INSTANTS, 10)),
    }
    for array in (*series.values(), *loads.values()):
        array.flags.writeable = False
    at = Loads(rubs=np.ones((2, n, 2)), **{name: values[rows] for name, values in loads.items()})
    return Samples(joint, loads=at if with_loads else None, **{name: values[rows] for name, values in series.items()})
