"""Effects from outside the package: a file that a user names, or an entry point; tried once when they are loaded."""

import importlib.util
import inspect
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import fields, replace
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pumaid.effects.base import Effect, Family, Scope, Trace
from pumaid.effects.formula import columns, filled
from pumaid.errors import ModelError, PumaidError, Where
from pumaid.robot import Joint, Robot
from pumaid.samples import Extent, Loads, Samples

#: The group of entry points that is searched.
GROUP = "pumaid.effects"
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
EXTENT = Extent(1, (0.1, 0.3, 1.0), (-1.5, 1.5), 0.05, 3.0, tuple(10.0 * k for k in range(90)), 900.0, 3.0, 3)


def effect_in(module: ModuleType) -> Effect:
    """The one effect that a module defines, else a ModelError [effect-file]."""
    where = Where(file=getattr(module, "__file__", None) or module.__name__)
    classes = [member for member in vars(module).values() if inspect.isclass(member) and issubclass(member, Effect)]
    defined = [member for member in classes if member.__module__ == module.__name__]
    if len(defined) != 1 or defined[0].__bases__ != (Effect,):
        names = ", ".join(member.__name__ for member in defined) or "none"
        raise ModelError("effect-file", f"a file holds one class made from Effect, not {names}", where, _MEND)
    effect: Effect = defined[0]()
    return effect


def from_file(path: Path, *, taken: Mapping[str, Effect]) -> Effect:
    """The effect in a file, run and tried; `taken` are the effects that there are already."""
    where = Where(file=str(path))
    if path.suffix != ".py" or not re.fullmatch(r"[a-z][a-z0-9_]*", path.stem) or not path.is_file():
        what = "there is no such file" if not path.is_file() else f"{path.name} is no name for an effect's file"
        mend = "check the path; a file is called as its effect: lower case, digits and _, then .py"
        raise ModelError("effect-file", what, where, mend)
    spec = importlib.util.spec_from_file_location(f"pumaid_effect_files.{path.stem}", path)
    assert spec is not None and spec.loader is not None
    loader, module = spec.loader, importlib.util.module_from_spec(spec)

    def run() -> ModuleType:
        sys.modules[module.__name__] = module
        loader.exec_module(module)
        return module

    return _loaded(run, where, taken)


def from_entry_points(taken: Mapping[str, Effect]) -> dict[str, Effect]:
    """Effects of installed packages, else a ModelError that names the package; an entry point names a module."""
    loaded: dict[str, Effect] = {}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        package = point.dist.name if point.dist is not None else "a package"
        where = Where(file=f"{package}: {point.value}", field=f"entry point {point.name}")
        effect = _loaded(point.load, where, {**taken, **loaded})
        loaded[effect.name] = effect
    return loaded


def _loaded(load: Callable[[], Any], where: Where, taken: Mapping[str, Effect]) -> Effect:
    """The effect of the module that `load` gives; whatever code of others raises is a refusal."""
    try:
        module = load()
        if not isinstance(module, ModuleType):
            raise ModelError("effect-file", "it names no module", where, "name the module that holds the effect")
        effect = effect_in(module)
        if effect.name in taken or effect.name == "base":
            what = f"there is an effect {effect.name} already"
            raise ModelError("effect-taken", what, where, "give the file another name")
        fault = breach(effect, names={*taken, effect.name})
        if fault is not None:
            raise ModelError("effect-contract", f"{effect.name}: {fault}", where, _MEND)
        return effect
    except (KeyboardInterrupt, MemoryError, PumaidError):
        raise
    except BaseException as failure:  # be it a wish to leave the program
        raise ModelError("effect-file", f"the effect cannot be loaded: {_words(failure)}", where, _MEND) from failure


def _words(failure: BaseException) -> str:
    """A failure's kind, the first line of what it says, and for bad syntax the line of the file."""
    line = f", line {failure.lineno}" if isinstance(failure, SyntaxError) and failure.lineno else ""
    return ": ".join([type(failure).__name__, *str(failure).strip().splitlines()[:1]]) + line


def breach(effect: Effect, *, names: Collection[str]) -> str | None:
    """The first promise that an effect breaks, in words; None where it keeps all. `names` are those of all effects."""
    try:
        return next(_breaches(effect, names), None)
    except Exception as failure:
        forgot = not effect.needs_loads and isinstance(failure, AssertionError | AttributeError)
        hint = "; if it looks at samples.loads, write needs_loads = True" if forgot else ""
        return f"it fails on made-up motions: {_words(failure)}{hint}"


def _breaches(effect: Effect, names: Collection[str]) -> Iterator[str]:
    """What is wrong with the statements of an effect, then with what it makes of the arm's joints."""
    kinds = {"title": str, "equation": str, "source": str, "family": Family, "scope": Scope, "trace": tuple}
    for word, kind in kinds.items():
        statement = getattr(effect, word, None)
        if not isinstance(statement, kind) or statement in ("", (), Scope.LINK):
            yield f"its {word} is {statement!r}, which is no {word} of an effect"
    if not all(isinstance(trace, Trace) for trace in effect.trace):
        yield "its trace is not a tuple of Trace"
    strange = [name for name in effect.look_alikes if name not in names]
    if strange:
        yield f"its look-alike {strange[0]} is not in the catalogue"
    if effect.base or effect.per_posture:
        yield "base and per_posture are for the paper's own effects"
    joints = range(1, ARM.n_joints + 1)
    for number in [0] if effect.scope is Scope.ARM else joints:
        if effect.applies(ARM, number) is None:
            yield from _entry_breaches(effect, number)
            for joint in joints if effect.scope in (Scope.ARM, Scope.CAUSE) else [number]:
                yield from _column_breaches(effect, number, joint)


def _entry_breaches(effect: Effect, number: int) -> Iterator[str]:
    """What is wrong with the parameters, shapes and grid of owner `number`."""
    parameters, shapes = effect.parameters(ARM, number), effect.shapes(ARM, number)
    if not parameters:
        yield f"it has no parameters for {f'joint {number}' if number else 'the whole arm'}"
    entries: list[Any] = [*parameters, *shapes]
    names = [entry.name for entry in entries]
    for entry in entries:
        if not re.fullmatch(r"[A-Za-z]\w*", entry.name) or names.count(entry.name) > 1:
            yield f"{entry.name!r} is no name for a parameter, or is there twice"
        if not (entry.unit and entry.meaning):
            yield f"{entry.name} has no unit or no meaning"
        if not entry.low <= entry.example <= entry.high:
            yield f"the example of {entry.name}, {entry.example:g}, is not between {entry.low:g} and {entry.high:g}"
    bounds = {shape.name: (shape.low, shape.high) for shape in shapes}
    starts = effect.grid(ARM, replace(EXTENT, joint=number or None))
    if not starts:
        yield "its grid is empty"
    for start in starts:
        if set(start) != set(bounds) or any(not bounds[x][0] <= value <= bounds[x][1] for x, value in start.items()):
            yield f"its grid names other shapes than it has, or leaves their bounds: {dict(start)}"


def _column_breaches(effect: Effect, number: int, joint: int) -> Iterator[str]:
    """What is wrong with the columns in joint `joint` that owner `number` causes."""
    samples, parameters = example(joint, with_loads=effect.needs_loads), effect.parameters(ARM, number)
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
    again = effect.columns(ARM, _at(samples, rows), number=number, shape=shape)
    if not _is_same(again, made[rows]):
        yield "an instant's row depends on which other instants are shown"
    formula = effect.formula_in(ARM, number, joint)
    if formula:
        sizes = {entry.name: entry.example for entry in parameters}
        motion = (ARM, samples, number or samples.joint)
        whole = columns(f"whole * ({filled(formula, sizes)})", ("whole",), shape, motion=motion)[:, 0]
        if not _is_same(made @ list(sizes.values()), whole):
            yield "its formula is not linear in its parameters, or is not what its columns say"


def _is_same(numbers: np.ndarray, others: np.ndarray) -> bool:
    return np.allclose(numbers, others, rtol=1e-9, atol=1e-9 * float(np.abs(others).max(initial=0.0)))


def example(joint: int, *, with_loads: bool) -> Samples:
    """Made-up instants of joint `joint` of `ARM`, all read-only; some other joints' loads are not known."""
    rng, n = np.random.default_rng(joint), ARM.n_joints
    direction = np.where(np.arange(INSTANTS) < INSTANTS // 2, 1.0, -1.0)
    velocity = np.zeros((INSTANTS, n))
    velocity[:, joint - 1] = direction * rng.uniform(0.1, 1.0, INSTANTS)
    by_joint, slopes = rng.normal(size=(2, INSTANTS, n))
    by_joint[:, -1] = np.nan
    moving, across, drawn = rng.normal(size=(3, INSTANTS))
    loads = Loads(moving, by_joint, slopes, rng.normal(size=(INSTANTS, 2)), np.abs(across), drawn, np.ones(n))
    samples = Samples(
        joint,
        position=rng.uniform(-1.5, 1.5, (INSTANTS, n)),
        velocity=velocity,
        acceleration=rng.normal(size=INSTANTS),
        direction=direction,
        time=np.sort(rng.uniform(0.0, 900.0, INSTANTS)),
        elapsed=np.sort(rng.uniform(0.0, 900.0, INSTANTS)),
        travel=rng.uniform(0.0, 2.0, INSTANTS),
        temperature=np.where(np.arange(INSTANTS) % 5 == 0, np.nan, rng.uniform(20.0, 40.0, INSTANTS)),
        run=np.repeat(np.arange(4), INSTANTS // 4),
        loads=loads if with_loads else None,
    )
    return _at(samples, np.arange(INSTANTS))


def _at(record: Any, rows: np.ndarray) -> Any:
    """Samples or loads at some of their instants (indices), as read-only arrays."""
    changes = {}
    for item in fields(record):
        value = getattr(record, item.name)
        if isinstance(value, Loads):
            changes[item.name] = _at(value, rows)
        elif isinstance(value, np.ndarray) and item.name != "gains":
            changes[item.name] = value[rows]
            changes[item.name].flags.writeable = False
    return replace(record, **changes)
