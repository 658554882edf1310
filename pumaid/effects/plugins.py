"""Effects from outside the package: a file that a user names, or an entry point; tried once when they are loaded."""

from __future__ import annotations

import importlib.util
import inspect
import math
import re
import sys
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import numpy as np

from pumaid.effects.base import Effect, Family, Scope, Trace
from pumaid.effects.formula import FUNCTIONS, QUANTITIES, columns, filled, names_in
from pumaid.errors import ModelError, PumaidError, Where
from pumaid.robot import Joint, Robot
from pumaid.samples import Extent, Loads, Samples

#: The group of entry points that is searched.
GROUP = "pumaid.effects"
#: Instants of the made-up motion on which effects are tried.
INSTANTS = 24

_MEND = "docs/contributing.md shows such a file"
_KINDS = [("revolute", 0.3), ("revolute", -1.2), ("prismatic", 0.7), ("revolute", 1.1)]

#: Turning joints and a slide, with gears and limits, none of them special to gravity.
ARM = Robot(
    "an arm to try effects on",
    tuple(
        Joint(k, f"joint {k}", kind, 0.1, alpha, 0.3, 0.1, limits=(-2.0, 2.0), max_velocity=2.0, gear_ratio=60.0)
        for k, (kind, alpha) in enumerate(_KINDS, start=1)
    ),
)


def effect_in(module: ModuleType) -> Effect:
    """The one effect that a module defines.

    Raises
    ------
    ModelError [effect-file]
        It defines none, several, or one that is made from another effect.
    """
    where = Where(file=getattr(module, "__file__", None) or module.__name__)
    classes = [member for member in vars(module).values() if inspect.isclass(member) and issubclass(member, Effect)]
    defined = [member for member in classes if member.__module__ == module.__name__]
    if len(defined) != 1 or defined[0].__bases__ != (Effect,):
        names = ", ".join(member.__name__ for member in defined) or "none"
        raise ModelError("effect-file", f"a file holds one class made from Effect, not {names}", where, _MEND)
    if inspect.isabstract(defined[0]):
        lacks = ", ".join(sorted(defined[0].__abstractmethods__))
        raise ModelError("effect-file", f"{defined[0].__name__} does not say its {lacks}", where, _MEND)
    effect: Effect = defined[0]()
    return effect


def from_file(path: Path, *, taken: Mapping[str, Effect]) -> Effect:
    """The effect in a file, run and tried; `taken` are the effects that there are already."""
    where, name = Where(file=str(path)), path.stem
    if path.suffix != ".py" or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        what = f"{path.name} is no name for an effect's file"
        raise ModelError("effect-file", what, where, "call it as the effect: lower case, digits and _, then .py")
    if not path.is_file():
        raise ModelError("effect-file", "there is no such file", where, "check the name and the folder")
    _refuse_taken(name, where, taken)
    spec = importlib.util.spec_from_file_location(f"pumaid_effect_files.{name}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
        return _tried(effect_in(module), where, taken)
    except BaseException as failure:
        del sys.modules[spec.name]
        raise _load_failure(failure, "it fails when it is run", where) from failure


def from_entry_points(taken: Mapping[str, Effect]) -> dict[str, Effect]:
    """Effects of installed packages; an entry point names a module that holds one effect.

    Raises
    ------
    ModelError [effect-file, effect-contract, effect-taken]
        One cannot be used; the package that brings it is named.
    """
    loaded: dict[str, Effect] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        package = point.dist.name if point.dist is not None else "a package"
        where = Where(file=f"{package}: {point.value}", field=f"entry point {point.name}")
        try:
            module = point.load()
            if not isinstance(module, ModuleType):
                what = f"the entry point {point.name} names no module but {point.value}"
                raise ModelError("effect-file", what, where, "name the module that holds the effect")
            effect = effect_in(module)
            _refuse_taken(effect.name, where, {**taken, **loaded})
            loaded[effect.name] = _tried(effect, where, {**taken, **loaded})
        except BaseException as failure:
            raise _load_failure(failure, f"the effect {point.name} cannot be loaded", where) from failure
    return loaded


def _load_failure(failure: BaseException, what: str, where: Where) -> BaseException:
    """What is raised in place of whatever code of others raised, be it a wish to leave the program."""
    if isinstance(failure, KeyboardInterrupt | MemoryError | PumaidError):
        return failure
    return ModelError("effect-file", f"{what}: {_words(failure)}", where, _MEND)


def _words(failure: BaseException) -> str:
    """A failure's kind, the first line of what it says, and for bad syntax the line of the file."""
    line = f", line {failure.lineno}" if isinstance(failure, SyntaxError) and failure.lineno else ""
    return ": ".join([type(failure).__name__, *str(failure).strip().splitlines()[:1]]) + line


def _refuse_taken(name: str, where: Where, taken: Mapping[str, Effect]) -> None:
    if name in taken or name == "base":
        what = f"there is an effect {name} already"
        raise ModelError("effect-taken", what, where, "give the file another name")


def _tried(effect: Effect, where: Where, taken: Mapping[str, Effect]) -> Effect:
    fault = breach(effect, names={*taken, effect.name})
    if fault is not None:
        raise ModelError("effect-contract", f"{effect.name}: {fault}", where, _MEND)
    return effect


def breach(effect: Effect, *, names: Collection[str]) -> str | None:
    """The first promise that an effect breaks, in words; None where it keeps all. `names` are those of all effects."""
    unstated = _unstated(effect, names)
    if unstated is not None:
        return unstated
    try:
        numbers = [0] if effect.scope is Scope.ARM else range(1, ARM.n_joints + 1)
        acting = [number for number in numbers if effect.applies(ARM, number) is None]
        return next((fault for number in acting for fault in _of_owner(effect, number)), None)
    except Exception as failure:
        forgot = not effect.needs_loads and isinstance(failure, AssertionError | AttributeError)
        hint = "; if it looks at samples.loads, write needs_loads = True" if forgot else ""
        return f"it fails on made-up motions: {_words(failure)}{hint}"


def _unstated(effect: Effect, names: Collection[str]) -> str | None:
    """What an effect should say of itself and does not."""
    for word in ("title", "equation", "source"):
        if not isinstance(getattr(effect, word, None), str) or not getattr(effect, word).strip():
            return f"it says no {word}"
    if not isinstance(getattr(effect, "family", None), Family):
        return "family is none of " + ", ".join(f"Family.{member.name}" for member in Family)
    if not isinstance(effect.scope, Scope) or effect.scope is Scope.LINK:
        return f"scope is {effect.scope!r}, not one of Scope.JOINT, CAUSE, ARM"
    if not effect.trace or not all(isinstance(trace, Trace) for trace in effect.trace):
        return "trace is not a tuple of Trace with something in it"
    strange = [name for name in effect.look_alikes if name not in names]
    if strange:
        return f"its look-alike {strange[0]} is not in the catalogue"
    marks = [mark for mark in ("base", "per_posture") if getattr(effect, mark, False)]
    return f"{marks[0]} is for the paper's own effects" if marks else None


def _of_owner(effect: Effect, number: int) -> Iterator[str]:
    """What is wrong with the parameters, shapes, grid and columns of owner `number`."""
    who = f"joint {number}" if number else "the whole arm"
    parameters, shapes = effect.parameters(ARM, number), effect.shapes(ARM, number)
    if not parameters:
        yield f"it has no parameters for {who}"
    entries: list[Any] = [*parameters, *shapes]
    names = [entry.name for entry in entries]
    for entry in entries:
        if not re.fullmatch(r"[A-Za-z]\w*", entry.name) or names.count(entry.name) > 1:
            yield f"{entry.name!r} is no name for a parameter, or is there twice"
        if not (entry.unit and entry.meaning):
            yield f"{entry.name} has no unit or no meaning"
        if not entry.low <= entry.example <= entry.high:
            yield f"the example of {entry.name}, {entry.example:g}, is not between {entry.low:g} and {entry.high:g}"
    strange = names_in(effect.formula or "0") - {*names, *QUANTITIES, *FUNCTIONS}
    if strange:
        yield f"its formula has {', '.join(sorted(strange))}, neither a parameter, a shape nor a quantity"
    for shape in shapes:
        if not math.isfinite(shape.high - shape.low):
            yield f"the shape {shape.name} has no finite bounds"
    bounds = {shape.name: (shape.low, shape.high) for shape in shapes}
    starts = effect.grid(ARM, extent(number or None))
    if not starts:
        yield f"its grid is empty for {who}"
    for start in starts:
        if set(start) != set(bounds):
            yield f"its grid names {sorted(start)} where its shapes are {sorted(bounds)}"
        elif any(not bounds[name][0] <= value <= bounds[name][1] for name, value in start.items()):
            yield f"its grid leaves the bounds: {dict(start)}"
    everywhere = effect.scope in (Scope.ARM, Scope.CAUSE)
    for joint in range(1, ARM.n_joints + 1) if everywhere else [number]:
        yield from _columns(effect, number, joint)


def _columns(effect: Effect, number: int, joint: int) -> Iterator[str]:
    """What is wrong with the columns in joint `joint` that owner `number` causes."""
    samples, parameters = example(joint, with_loads=effect.needs_loads), effect.parameters(ARM, number)
    for array in _arrays(samples):
        array.flags.writeable = False
    shape = {entry.name: entry.example for entry in effect.shapes(ARM, number)}
    made = effect.columns(ARM, samples, number=number, shape=shape)
    wanted = (INSTANTS, len(parameters))
    if not isinstance(made, np.ndarray) or made.shape != wanted or made.dtype.kind not in "fiub":
        yield f"columns are {getattr(made, 'shape', type(made).__name__)} where {wanted} is one a parameter"
        return
    if not np.isfinite(made).all():
        yield "columns are not all finite; where temperature or another joint's load is NaN they must be zero"
        return
    rows = np.arange(INSTANTS)[::-3]
    again = effect.columns(ARM, part(samples, rows), number=number, shape=shape)
    if not np.allclose(again, made[rows], rtol=1e-9, atol=1e-9 * float(np.abs(made).max(initial=0.0))):
        yield "an instant's row depends on which other instants are shown"
    formula = effect.formula_in(ARM, number, joint)
    if formula:
        sizes = {entry.name: entry.example for entry in parameters}
        motion = (ARM, samples, number or samples.joint)
        whole = columns(f"whole * ({filled(formula, sizes)})", ("whole",), shape, motion=motion)[:, 0]
        if not np.allclose(
            made @ list(sizes.values()), whole, rtol=1e-9, atol=1e-9 * float(np.abs(whole).max(initial=0.0))
        ):
            yield "its formula is not linear in its parameters, or is not what its columns say"


def example(joint: int, *, with_loads: bool) -> Samples:
    """Made-up instants of joint `joint` of `ARM`, every field filled; some other joints' loads are not known."""
    rng, n = np.random.default_rng(joint), ARM.n_joints
    position = rng.uniform(-1.5, 1.5, (INSTANTS, n))
    direction = np.where(np.arange(INSTANTS) < INSTANTS // 2, 1.0, -1.0)
    velocity = np.zeros_like(position)
    velocity[:, joint - 1] = direction * rng.uniform(0.1, 1.0, INSTANTS)
    loads, slopes = rng.normal(size=(2, INSTANTS, n))
    loads[:, -1], gains = np.nan, np.append(rng.uniform(0.5, 2.0, n - 1), np.nan)
    load, across, drawn = rng.normal(size=(3, INSTANTS))
    tilts = rng.normal(size=(INSTANTS, 2))
    temperature = np.where(np.arange(INSTANTS) % 5 == 0, np.nan, rng.uniform(20.0, 40.0, INSTANTS))
    return Samples(
        joint,
        position,
        velocity,
        acceleration=rng.normal(size=INSTANTS),
        direction=direction,
        time=np.sort(rng.uniform(0.0, 900.0, INSTANTS)),
        elapsed=np.sort(rng.uniform(0.0, 900.0, INSTANTS)),
        travel=rng.uniform(0.0, 2.0, INSTANTS),
        temperature=temperature,
        run=np.repeat(np.arange(4), INSTANTS // 4),
        loads=Loads(load, loads, slopes, tilts, np.abs(across), drawn, gains) if with_loads else None,
    )


def extent(joint: int | None) -> Extent:
    """What made-up runs of a joint (None: of all) cover."""
    starts = tuple(10.0 * k for k in range(90))
    return Extent(joint, (0.1, 0.3, 1.0), (-1.5, 1.5), 0.05, 3.0, starts, 900.0, 3.0, 3)


def part(samples: Samples, chosen: np.ndarray) -> Samples:
    """Some of the instants, in the order of `chosen` (indices)."""

    def cut(record: Any) -> Any:
        arrays = {name: getattr(record, name) for name in record.__dataclass_fields__ if name != "gains"}
        return replace(record, **{k: v[chosen] for k, v in arrays.items() if isinstance(v, np.ndarray)})

    loads = None if samples.loads is None else cut(samples.loads)
    return cast(Samples, replace(cut(samples), loads=loads))


def _arrays(samples: Samples) -> Iterator[np.ndarray]:
    records: list[Any] = [samples] if samples.loads is None else [samples, samples.loads]
    for record in records:
        values = (getattr(record, name) for name in record.__dataclass_fields__)
        yield from (value for value in values if isinstance(value, np.ndarray))
