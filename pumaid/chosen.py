"""Effects beyond the paper's model: where they act, what their parameters are called, and their columns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Effect, Scope, catalogue
from pumaid.effects.base import Shape
from pumaid.errors import ModelError, Where
from pumaid.records import Estimate, Samples
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]

#: Step of a numerical derivative by a shape, as a share of the shape's own scale: its square is far below any interval.
STEP = 1e-4

#: Columns of an effect below this share of its largest are rounding.
ROUNDING = 1e-11


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
    span
        From the lowest to the highest value of it that is physical.
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
    span: float = math.inf


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
    held
        Those of `fitted` that are best at a bound: they stay there, and errors know of them all the same.
    """

    choice: EffectChoice
    mark: str = ""
    fitted: tuple[str, ...] = ()
    sizes: tuple[float, ...] = ()
    held: tuple[str, ...] = ()

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
                span=parameter.high - parameter.low,
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
        size = np.abs(linear).max(axis=0, initial=0.0)
        found = [np.where(size > ROUNDING * size.max(initial=0.0), linear, 0.0)]
        for name, facts in self.shapes(robot).items() if self.fitted else ():
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


def in_order(choices: Sequence[EffectChoice]) -> tuple[Chosen, ...]:
    """Choices as a model has them: the second time at a joint is marked ``_2``."""
    seen: dict[tuple[str, int | None], int] = {}
    out = []
    for choice in choices:
        key = (choice.effect, choice.joint)
        seen[key] = seen.get(key, 0) + 1
        out.append(Chosen(choice, f"_{seen[key]}" if seen[key] > 1 else ""))
    return tuple(out)


def check_parameters(estimate: Estimate, robot: Robot) -> None:
    """Refuse a model whose effects had other parameters when it was made: a user's file has changed since.

    Raises
    ------
    ModelError [effect-changed]
        One of its effects lacks, or has, a parameter or shape that the model knows otherwise.
    """
    every = in_order(estimate.effects)
    for number, one in enumerate(every, start=1):
        name, joint, shapes = one.choice.effect, one.choice.joint, set(one.shapes(robot))
        prefix = f"{name}.j{joint}." if joint else f"{name}."
        alike = [replace(other, fitted=tuple(shapes)) for other in every if other.choice.effect == name]
        parts = [part for other in alike if other.choice.joint == joint for part in other.parts(robot, 0)]
        own = {known for known in estimate.names if known.startswith(prefix)}
        differ = {part.name for part in parts if part.shape is None} - own
        differ |= own - {part.name for part in parts}
        differ |= shapes.symmetric_difference(one.choice.shape)
        if differ:
            what = f"{name} is not what it was when the model was made: {', '.join(sorted(differ))}"
            mend = "give the file as it was then, or identify again with this one"
            raise ModelError("effect-changed", what, Where(joint=joint, field=f"effects[{number}]"), mend)
