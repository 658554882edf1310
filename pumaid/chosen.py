"""Effects beyond the paper's model: where they act, what their parameters are called, and their columns."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Effect, Scope, catalogue
from pumaid.effects.base import Shape
from pumaid.errors import ModelError, Where
from pumaid.records import EffectChoice, Robot, Samples

Floats = NDArray[np.float64]

#: Step of a numerical derivative by a shape, as a share of the shape's own scale: its square is far below any interval.
STEP = 1e-4


@dataclass(frozen=True, slots=True)
class Column:
    """One parameter of a model: its name, symbol and unit, the joint or link (from 1) that owns it, its effect.

    Attributes
    ----------
    owner
        From 1; 0 for the whole arm.
    group
        Posture group (from 0) of a parameter that each set of held positions has for itself, else None.
    place
        Number (from 0) of the chosen effect that it belongs to; None in the paper's model.
    shape
        Name of the nonlinear parameter of which the column is the derivative; None for linear parameters.
    scope
        Whose it is: a link's acts on inner joints through the ratio of gains, all others as they are.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    owner: int
    effect: str
    group: int | None = None
    place: int | None = None
    shape: str | None = None
    scope: Scope = Scope.JOINT


@dataclass(frozen=True, eq=False, slots=True)
class Chosen:
    """One effect in a model.

    Attributes
    ----------
    choice
        Effect, joint (None: the whole arm) and shape, all of it.
    mark
        What ends its parameters' names: ``_2`` for the second time at one joint.
    fitted
        Shapes that were looked for: the derivative by each is a column, so that errors know of them.
    sizes
        Linear parameters at which these derivatives are taken.
    """

    choice: EffectChoice
    mark: str = ""
    fitted: tuple[str, ...] = ()
    sizes: tuple[float, ...] = ()

    @property
    def effect(self) -> Effect:
        """From the catalogue."""
        return catalogue()[self.choice.effect]

    @property
    def number(self) -> int:
        """Owner: joint or link from 1, 0 for the whole arm."""
        return self.choice.joint or 0

    def shapes(self, robot: Robot) -> dict[str, Shape]:
        """Nonlinear parameters by name."""
        return {shape.name: shape for shape in self.effect.shapes(robot, self.number)}

    def touches(self, joint: int) -> bool:
        """Whether it may act on the current of `joint` (from 1)."""
        scope = self.effect.scope
        if scope is Scope.JOINT:
            return joint == self.number
        return scope is not Scope.LINK or joint <= self.number

    def parts(self, robot: Robot, place: int) -> Iterator[Column]:
        """Its parameters, then the shapes that were looked for; `place` is its number in the model."""
        effect, number = self.effect, self.number
        letter = {Scope.ARM: ""}.get(effect.scope, f"{'l' if effect.scope is Scope.LINK else 'j'}{number}.")
        unit = robot.joint(number).position_unit if number else "rad"
        for parameter in effect.parameters(robot, number):
            yield Column(
                name=f"{effect.name}.{letter}{parameter.name}{self.mark}",
                symbol=parameter.symbol.format(n=number) + self.mark,
                unit=parameter.unit.format(unit=unit),
                meaning=parameter.meaning,
                owner=number,
                effect=effect.name,
                place=place,
                scope=effect.scope,
            )
        for shape in (one for one in effect.shapes(robot, number) if one.name in self.fitted):
            yield Column(
                name=f"{effect.name}.{letter}{shape.name}{self.mark}",
                symbol=shape.name + self.mark,
                unit=shape.unit.format(unit=unit),
                meaning=shape.meaning,
                owner=number,
                effect=effect.name,
                place=place,
                shape=shape.name,
                scope=effect.scope,
            )

    def columns(self, robot: Robot, samples: Samples) -> Floats:
        """(M, p) A per unit of each of `parts`."""
        effect, shape = self.effect, dict(self.choice.shape)

        def at(values: Mapping[str, float]) -> Floats:
            return effect.columns(robot, samples, number=self.number, shape=values)

        linear = at(shape)
        found = [linear]
        for name, facts in self.shapes(robot).items():
            if name in self.fitted:
                low, high = step_of(facts, shape[name])
                rise = at(shape | {name: high}) - at(shape | {name: low})
                found.append((rise @ np.array(self.sizes) / (high - low))[:, None])
        return np.hstack(found)

    def at(self, shape: Mapping[str, float], sizes: Sequence[float] = ()) -> Chosen:
        """The same with other shapes, and derivatives at other sizes."""
        choice = replace(self.choice, shape=dict(self.choice.shape) | dict(shape))
        return replace(self, choice=choice, sizes=tuple(float(size) for size in sizes))


def scale_of(shape: Shape, value: float) -> float:
    """What counts as not knowing a shape: a quarter of its range, or the value itself where it cannot be negative."""
    spread = 0.25 * (shape.high - shape.low) if np.isfinite(shape.high - shape.low) else np.inf
    if shape.low >= 0.0 and value > 0.0:
        spread = min(spread, value)
    return float(spread) if np.isfinite(spread) else max(abs(value), 1.0)


def step_of(shape: Shape, value: float) -> tuple[float, float]:
    """Two values about `value`, within bounds, between which a derivative is taken."""
    step = STEP * scale_of(shape, value)
    return max(value - step, shape.low), min(value + step, shape.high)


def expanded(choices: Sequence[EffectChoice], robot: Robot) -> tuple[EffectChoice, ...]:
    """Each choice at one joint or of the whole arm; a choice for all joints becomes one a joint where it can act.

    Raises
    ------
    ModelError [unknown-effect], [effect-joint], [effect-shape], [effect-not-here], [effect-twice]
        An effect, joint or shape is wrong, cannot act there, or is in the model already.
    """
    out: list[EffectChoice] = []
    for number, choice in enumerate(choices, start=1):
        where = _where(choice, robot, number)
        for one in _expanded(choice, robot, where):
            _refuse_twice(one, out, where)
            out.append(one)
    return tuple(out)


def in_order(choices: Sequence[EffectChoice]) -> tuple[Chosen, ...]:
    """Choices as a model has them: the second time at a joint is marked ``_2``."""
    seen: dict[tuple[str, int | None], int] = {}
    out = []
    for choice in choices:
        key = (choice.effect, choice.joint)
        seen[key] = seen.get(key, 0) + 1
        out.append(Chosen(choice, f"_{seen[key]}" if seen[key] > 1 else ""))
    return tuple(out)


def _where(choice: EffectChoice, robot: Robot, number: int) -> Where:
    if choice in robot.effects:
        index = robot.effects.index(choice)
        return Where(file=robot.origin or None, field=f"effects[{index + 1}]", joint=choice.joint)
    return Where(joint=choice.joint, field=f"effect {number}: {choice.effect}")


def _expanded(choice: EffectChoice, robot: Robot, where: Where) -> list[EffectChoice]:
    effect = known_effect(choice.effect, where)
    if effect.scope is Scope.ARM:
        if choice.joint is not None:
            what = f"{effect.name} is of the whole arm, not of joint {choice.joint}"
            raise ModelError("effect-joint", what, where, "leave the joint out")
        _check_shape(effect, robot, 0, shape=choice.shape, where=where)
        return [choice]
    if choice.joint is not None and not 1 <= choice.joint <= robot.n_joints:
        what = f"{robot.name} has no joint {choice.joint}"
        raise ModelError("effect-joint", what, where, f"joints count from 1 to {robot.n_joints}")
    joints = range(1, robot.n_joints + 1) if choice.joint is None else (choice.joint,)
    refusals = {joint: effect.applies(robot, joint) for joint in joints}
    free = [joint for joint, why in refusals.items() if why is None]
    if not free:
        why = next(reason for reason in refusals.values() if reason is not None)
        raise ModelError("effect-not-here", f"{effect.name} cannot act there: {why}", where, "leave it out")
    for joint in free:
        _check_shape(effect, robot, joint, shape=choice.shape, where=where)
    return [replace(choice, joint=joint) for joint in free]


def known_effect(name: str, where: Where) -> Effect:
    """The effect of the catalogue called `name`, if it can be added to a model.

    Raises
    ------
    ModelError [unknown-effect], [effect-twice]
        There is none, or every model has it.
    """
    known = catalogue()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        raise ModelError(
            "unknown-effect",
            f"there is no effect {name} in the catalogue: {', '.join(known)}",
            where,
            f"did you mean {near[0]}?" if near else "pumaid effects lists the names",
        )
    if known[name].base:
        raise ModelError("effect-twice", f"{name} is in every model already", where, "leave it out")
    return known[name]


def _check_shape(effect: Effect, robot: Robot, number: int, *, shape: Mapping[str, float], where: Where) -> None:
    known = {one.name: one for one in effect.shapes(robot, number)}
    for name, value in shape.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            listed = f"known: {', '.join(known)}" if known else f"{effect.name} has no shape: leave it out"
            mend = f"did you mean {near[0]}?" if near else listed
            raise ModelError("effect-shape", f"{effect.name} has no shape called {name}", where, mend)
        low, high = known[name].low, known[name].high
        if not low <= value <= high:
            what = f"{name} of {effect.name} is {value:g}"
            raise ModelError("effect-shape", what, where, f"write a number from {low:g} to {high:g}")


def _refuse_twice(choice: EffectChoice, before: Sequence[EffectChoice], where: Where) -> None:
    """The same effect twice is two harmonics at best, and then both say their shape."""
    for other in before:
        if (other.effect, other.joint) != (choice.effect, choice.joint):
            continue
        place = f" at joint {choice.joint}" if choice.joint else ""
        differs = choice.shape and other.shape and dict(choice.shape) != dict(other.shape)
        if not differs or not catalogue()[choice.effect].is_repeatable:
            mend = "take one of them out"
            if catalogue()[choice.effect].is_repeatable:
                mend = "give each its own shape, such as EFFECT@JOINT:frequency=30"
            raise ModelError("effect-twice", f"{choice.effect}{place} is in the model already", where, mend)
