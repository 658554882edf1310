"""Does an effect keep what every effect promises? Tried on a small arm and made-up motions."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from pumaid.effects.base import Effect, Family, Parameter, Scope, Shape, Trace
from pumaid.effects.outside.failing import refused
from pumaid.errors import ModelError
from pumaid.records import Extent, Loads, Samples
from pumaid.robot import Joint, Robot

#: Turning joints and a slide, with gears and limits, none of them special to gravity.
ARM = Robot(
    "an arm to try effects on",
    tuple(
        Joint(
            number,
            f"joint {number}",
            kind,
            theta=0.1,
            alpha=alpha,
            a=0.3,
            d=0.1,
            limits=(-2.0, 2.0),
            max_velocity=2.0,
            gear_ratio=60.0,
        )
        for number, (kind, alpha) in enumerate(
            [("revolute", 0.3), ("revolute", -1.2), ("prismatic", 0.7), ("revolute", 1.1)], start=1
        )
    ),
)

#: Instants of one joint that are shown.
INSTANTS = 24

#: Rows shown alone may differ from rows shown among others by this share: sums in another order.
SAME = 1e-9

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def example(joint: int, *, with_loads: bool) -> Samples:
    """Made-up instants of joint `joint` of `ARM`, every field filled; some other joints' loads are not known."""
    rng, n = np.random.default_rng(joint), ARM.n_joints
    position = rng.uniform(-1.5, 1.5, (INSTANTS, n))
    direction = np.where(np.arange(INSTANTS) < INSTANTS // 2, 1.0, -1.0)
    velocity = np.zeros_like(position)
    velocity[:, joint - 1] = direction * rng.uniform(0.1, 1.0, INSTANTS)
    others, slopes = rng.normal(size=(2, INSTANTS, n))
    others[:, -1], gains = np.nan, np.append(rng.uniform(0.5, 2.0, n - 1), np.nan)
    own, across, drawn = rng.normal(size=(3, INSTANTS))
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
        loads=Loads(own, others, slopes, tilts, np.abs(across), drawn, gains) if with_loads else None,
    )


def extent(joint: int | None) -> Extent:
    """What made-up runs of a joint (None: of all) cover."""
    starts = tuple(10.0 * k for k in range(90))
    return Extent(joint, (0.1, 0.3, 1.0), (-1.5, 1.5), 0.05, 3.0, starts, 900.0, 3.0, 3)


def breach(effect: Effect, *, known: Collection[str]) -> str | None:
    """The first promise that an effect breaks, in words; None where it keeps all.

    Parameters
    ----------
    effect
        What is tried.
    known
        Names of all effects, its own among them.
    """
    untold = _untold(effect, known)
    if untold is not None:
        return untold
    numbers = [0] if effect.scope is Scope.ARM else range(1, ARM.n_joints + 1)
    try:
        with refused(lambda words: ModelError("effect-contract", words)):
            acting = [number for number in numbers if effect.applies(ARM, number) is None]
            return next((fault for number in acting for fault in _of_owner(effect, number)), None)
    except ModelError as failure:
        return f"it fails on made-up motions: {failure.what}{_hint(effect, failure.__cause__)}"


def _hint(effect: Effect, failure: BaseException | None) -> str:
    """For an effect that looks at loads without having asked for them."""
    forgot = not effect.needs_loads and isinstance(failure, AssertionError | AttributeError)
    return "; if it looks at samples.loads, write needs_loads = True" if forgot else ""


def _untold(effect: Effect, known: Collection[str]) -> str | None:
    """What an effect should say of itself and does not."""
    for word in ("title", "equation", "source"):
        if not isinstance(getattr(effect, word, None), str) or not getattr(effect, word).strip():
            return f"it says no {word}"
    if not isinstance(getattr(effect, "family", None), Family):
        return "family is none of " + ", ".join(f"Family.{one.name}" for one in Family)
    if not isinstance(effect.scope, Scope):
        return f"scope is {effect.scope!r}, not one of Scope"
    if not effect.trace or not all(isinstance(one, Trace) for one in effect.trace):
        return "trace is not a tuple of Trace with something in it"
    strange = [name for name in effect.look_alikes if name not in known]
    if strange:
        return f"its look-alike {strange[0]} is not in the catalogue"
    for mark in ("base", "in_triangle", "per_posture"):
        if getattr(effect, mark):
            return f"{mark} is for the paper's own effects"
    if effect.scope is Scope.LINK:
        return "scope LINK is for gravity alone"
    return None


def _of_owner(effect: Effect, number: int) -> Iterator[str]:
    """What is wrong with the parameters, shapes, grid and columns of owner `number`."""
    who = f"joint {number}" if number else "the whole arm"
    parameters, shapes = effect.parameters(ARM, number), effect.shapes(ARM, number)
    if not parameters:
        yield f"it has no parameters for {who}"
    everything: tuple[Parameter | Shape, ...] = (*parameters, *shapes)
    names = [one.name for one in everything]
    for one in everything:
        if not _WORD.fullmatch(one.name) or names.count(one.name) > 1:
            yield f"{one.name!r} is no name for a parameter, or is there twice"
        if not (one.unit and one.meaning):
            yield f"{one.name} has no unit or no meaning"
        if not one.low <= one.example <= one.high:
            yield f"the example of {one.name}, {one.example:g}, is not between {one.low:g} and {one.high:g}"
    unbounded = [one.name for one in shapes if not math.isfinite(one.low) or not math.isfinite(one.high)]
    if unbounded:
        yield f"the shape {unbounded[0]} has no finite bounds"
    bounds = {one.name: (one.low, one.high) for one in shapes}
    starts = effect.grid(ARM, extent(number or None))
    if not starts:
        yield f"its grid is empty for {who}"
    for start in starts:
        if set(start) != set(bounds):
            yield f"its grid names {sorted(start)} where its shapes are {sorted(bounds)}"
        elif any(not bounds[name][0] <= value <= bounds[name][1] for name, value in start.items()):
            yield f"its grid leaves the bounds: {dict(start)}"
    at = {one.name: one.example for one in shapes}
    everywhere = effect.scope in (Scope.ARM, Scope.CAUSE)
    for joint in range(1, ARM.n_joints + 1) if everywhere else [number]:
        yield from _columns(effect, number, joint, at)


def _columns(effect: Effect, number: int, joint: int, at: Mapping[str, float]) -> Iterator[str]:
    """What is wrong with the columns in joint `joint` that owner `number` causes."""
    samples = _locked(example(joint, with_loads=effect.needs_loads))
    found = effect.columns(ARM, samples, number=number, shape=at)
    wanted = (INSTANTS, len(effect.parameters(ARM, number)))
    if not isinstance(found, np.ndarray) or found.shape != wanted:
        yield f"columns are {getattr(found, 'shape', type(found).__name__)} where {wanted} is one a parameter"
        return
    if not np.isfinite(found).all():
        yield "columns are not all finite; where temperature or another joint's load is NaN they must be zero"
        return
    chosen = np.arange(INSTANTS)[::-3]
    some = effect.columns(ARM, part(samples, chosen), number=number, shape=at)
    if not np.allclose(some, found[chosen], rtol=SAME, atol=SAME * float(np.abs(found).max(initial=0.0))):
        yield "an instant's row depends on which other instants are shown"


def part(samples: Samples, chosen: np.ndarray) -> Samples:
    """Some of the instants, in the order of `chosen` (indices)."""
    some = {name: getattr(samples, name)[chosen] for name in _fields(samples)}
    loads = samples.loads
    if loads is not None:
        loads = replace(loads, **{name: getattr(loads, name)[chosen] for name in _fields(loads) if name != "gains"})
    return replace(samples, **some, loads=loads)


def _locked(samples: Samples) -> Samples:
    """The same, so that whoever writes into it fails."""
    arrays = [getattr(samples, name) for name in _fields(samples)]
    if samples.loads is not None:
        arrays += [getattr(samples.loads, name) for name in _fields(samples.loads)]
    for array in arrays:
        array.flags.writeable = False
    return samples


def _fields(record: Samples | Loads) -> list[str]:
    """Names of the fields that are arrays."""
    return [name for name in record.__dataclass_fields__ if isinstance(getattr(record, name), np.ndarray)]
