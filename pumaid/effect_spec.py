"""Effects beyond the paper's model: as users name them (EFFECT@JOINT:SHAPE=VALUE) and as terms of a model."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pumaid.effects import Effect, Parameter, Samples, Scope, Shape, catalogue
from pumaid.effects.formula import GAMMAS, names_in
from pumaid.errors import ModelError, Where, meant
from pumaid.estimate import GIVEN, Estimate
from pumaid.maths import Floats
from pumaid.robot import SHAPE_WORDS, EffectChoice, Robot, of_point, read_choice, worded

#: What to do where an effect is not known that may be a user's own.
OWN = "an effect from a file of your own needs that file each time: --effects FILE.py"
#: Step of a numerical derivative, as a share of what counts as the scale there: its square is far below any interval.
STEP = 1e-4


@dataclass(frozen=True, slots=True)
class Column:
    """One parameter of a model: its name, symbol and unit, the joint or link that owns it (from 1; 0: the arm), its
    effect.

    `place` is the number (from 0) of the effect term that it belongs to, None in the paper's model; `shape` the
    nonlinear parameter of which the column is the derivative, None for linear ones. A link's `scope` acts on inner
    joints through the ratio of gains, all others as they are; `span` goes from the lowest to the highest value that is
    physical, `deviation` is what a parameter is uncertain by before any data, where the effect says so.
    """

    name: str
    symbol: str
    unit: str
    owner: int
    effect: str
    place: int | None = None
    shape: str | None = None
    scope: Scope = Scope.JOINT
    span: float = math.inf
    deviation: float | None = None


@dataclass(frozen=True, slots=True)
class EffectTerm:
    """One effect in a model, or tried beside it: at a joint (from 1; None: the whole arm), with its shape.

    `mark` ends its parameters' names: ``_2`` for the second time at one joint. The derivative by each `fitted` shape,
    at the linear parameters `sizes`, is a column, so that errors include it; those of `held` are best at a bound and
    stay there, and errors include them all the same.
    """

    effect: Effect
    joint: int | None
    shape: Mapping[str, float] = field(default_factory=dict)
    mark: str = ""
    fitted: tuple[str, ...] = ()
    sizes: tuple[float, ...] = ()
    held: tuple[str, ...] = ()

    @property
    def key(self) -> tuple[str, int | None]:
        """Effect's name and joint."""
        return self.effect.name, self.joint

    @property
    def needs_loads(self) -> bool:
        """Whether its columns wait for the loads of a fit."""
        return self.effect.needs_loads and self.shape.get("of") in (None, SHAPE_WORDS["of"].index("load"))

    @property
    def is_carried(self) -> bool:
        """Whether the last link carries it: its columns are in that joint's gain, as a link's are."""
        return not names_in(self.effect.formula).isdisjoint(GAMMAS)

    @property
    def number(self) -> int:
        """Owner: joint or link from 1, 0 for the whole arm."""
        return self.joint or 0

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Linear parameters, in units of the joint that the shape `on` names, where there is one."""
        return self.effect.parameters(robot, int(self.shape.get("on", self.number)))

    def shapes(self, robot: Robot) -> dict[str, Shape]:
        """Nonlinear parameters by name."""
        return {shape.name: shape for shape in self.effect.shapes(robot, self.number)}

    def searched(self, robot: Robot) -> "EffectTerm":
        """The same with all shapes that it has fitted, as far as these have derivatives."""
        shapes = self.shapes(robot)
        return replace(self, fitted=tuple(name for name in shapes if shapes[name].is_searched and name in self.shape))

    def touches(self, joint: int) -> bool:
        """Whether it may act on the current of `joint` (from 1)."""
        if self.effect.scope is Scope.JOINT:
            return joint == self.joint
        return self.effect.scope is not Scope.LINK or joint <= self.number

    def parts(self, robot: Robot, place: int | None) -> Iterator[Column]:
        """Its parameters, then the shapes that are fitted; `place` is its number in the model."""
        effect, number = self.effect, self.number
        letter = {Scope.ARM: "", Scope.LINK: f"l{number}."}.get(effect.scope, f"j{number}.")
        items: list[Parameter | Shape] = [
            *self.parameters(robot),
            *(shape for shape in effect.shapes(robot, number) if shape.name in self.fitted),
        ]
        for item in items:
            is_shape = isinstance(item, Shape)
            yield Column(
                name=f"{effect.name}.{letter}{item.name}{self.mark}",
                symbol=(item.symbol.format(n=number) if isinstance(item, Parameter) else item.name) + self.mark,
                unit=item.unit,
                owner=robot.n_joints if self.is_carried else number,
                effect=effect.name,
                place=place,
                shape=item.name if is_shape else None,
                scope=Scope.LINK if self.is_carried else effect.scope,
                span=math.inf if is_shape else item.high - item.low,
                deviation=self.shape.get("spread") if item.name.startswith("bend") else None,
            )

    def linear(self, robot: Robot, samples: Samples, shape: Mapping[str, float] | None = None) -> Floats:
        """(M, p) A per unit of each linear parameter; zero where it does not act, and where a load is not known."""
        if not self.touches(samples.joint):
            return np.zeros((len(samples), len(self.effect.parameters(robot, self.number))))
        shape = self.shape if shape is None else shape
        if self.is_carried and self.sizes:
            bodies = samples.bodies @ of_point(robot, self.sizes[0], np.array(self.sizes[1:]))
            samples = replace(samples, bodies=bodies)
        columns = self.effect.columns(robot, samples, number=self.number, shape=shape)
        return columns if np.isfinite(columns.sum()) else np.nan_to_num(columns)

    def columns(self, robot: Robot, samples: Samples) -> Floats:
        """(M, p) A per unit of each of `parts`."""
        linear = self.linear(robot, samples)
        size = np.abs(linear).max(axis=0, initial=0.0)
        columns = [np.where(size > 1e-11 * size.max(initial=0.0), linear, 0.0)]  # else rounding
        for name, facts in self.shapes(robot).items() if self.fitted else ():
            if name in self.fitted:
                step = STEP * scale_of(facts, self.shape[name])
                low, high = max(self.shape[name] - step, facts.low), min(self.shape[name] + step, facts.high)
                ends = [self.linear(robot, samples, {**self.shape, name: end}) for end in (low, high)]
                rise = (ends[1] - ends[0]) @ (np.array(self.sizes) if self.sizes else np.zeros(linear.shape[1]))
                columns.append((rise / (high - low))[:, None])
        return np.hstack(columns)

    def at(self, shape: Mapping[str, float], sizes: Sequence[float] = ()) -> "EffectTerm":
        """The same with other shapes, and derivatives at other sizes."""
        return replace(self, shape={**self.shape, **shape}, sizes=tuple(float(size) for size in sizes))


def scale_of(shape: Shape, value: float) -> float:
    """What counts as not knowing a shape: a quarter of its range, or the value itself where it cannot be negative."""
    spread = min(0.25 * (shape.high - shape.low), value if shape.low >= 0.0 and value > 0.0 else np.inf)
    return float(spread) if np.isfinite(spread) else max(abs(value), 1.0)


def marked(terms: Iterable[EffectTerm]) -> tuple[EffectTerm, ...]:
    """Terms with the marks that tell those of one effect at one joint apart."""
    terms = tuple(terms)
    times = [sum(other.key == term.key for other in terms[: n + 1]) for n, term in enumerate(terms)]
    return tuple(replace(term, mark=f"_{k}" if k > 1 else "") for term, k in zip(terms, times, strict=True))


def terms_of(choices: Sequence[EffectChoice]) -> tuple[EffectTerm, ...]:
    """Choices as a model has them: the second time at a joint is marked ``_2``.

    Refuses one that the catalogue does not have (unknown-effect): a file has to be named again.
    """
    return marked(
        EffectTerm(
            known_effect(choice.effect, Where(joint=choice.joint, field=f"effects[{n}]")),
            choice.joint,
            dict(choice.shape),
        )
        for n, choice in enumerate(choices, start=1)
    )


def check_parameters(estimate: Estimate, robot: Robot) -> None:
    """Refuse a model whose effects had other parameters when it was made (effect-changed): a file has changed since."""
    terms = terms_of(estimate.effects)
    for number, term in enumerate(terms, start=1):
        (name, joint), shapes = term.key, set(term.shapes(robot))
        alike = [replace(other, fitted=tuple(shapes)) for other in terms if other.key == term.key]
        parts = [part for other in alike for part in other.parts(robot, 0)]
        linear = {part.name for part in parts if part.shape is None}
        prefix = f"{name}.j{joint}." if joint else f"{name}."
        listed = {parameter for parameter in estimate.names if parameter.startswith(prefix)}
        differ = (linear - listed) | (listed - {part.name for part in parts}) | shapes.symmetric_difference(term.shape)
        if differ:
            what = f"{name} is not what it was when the model was made: {', '.join(sorted(differ))}"
            mend = "give the file as it was then, or identify again with this one"
            raise ModelError("effect-changed", what, Where(joint=joint, field=f"effects[{number}]"), mend)


def option_text(name: str, joint: int | None, shape: Mapping[str, float], *, fixed: Collection[str] = ()) -> str:
    """An effect as ``--add`` reads it, ``ripple@2:frequency=58.2``; empty where the catalogue does not have it.

    Shapes that are not in `fixed` are left to the fit, except those of an effect that may stand at a joint several
    times.
    """
    if name not in catalogue():
        return ""
    whole, words = catalogue()[name].chosen(shape), worded(shape)
    values = ",".join(
        f"{key}={str(words[key]).lower() if isinstance(words[key], str | bool) else format(value, '.8g')}"
        for key, value in shape.items()
        if (key in whole or key in fixed) and words[key] != "nothing"
    )
    return name + ("" if joint is None else f"@{joint}") + (f":{values}" if values else "")


def chosen_by(robot: Robot, add: Iterable[str] = ()) -> tuple[EffectChoice, ...]:
    """The recipe's effects and those that `add` names, as `read_choice` reads it, one joint each.

    Raises ModelError (as `expanded`) where a choice is wrong, cannot act there, or is in the model already.
    """
    return expanded([*robot.effects, *(read_choice(text, robot, "--add") for text in add)], robot, option="--add")


def expanded(choices: Sequence[EffectChoice], robot: Robot, *, option: str = "effect") -> tuple[EffectChoice, ...]:
    """Each choice at one joint or of the whole arm; a choice for all joints becomes one a joint where it can act.

    Raises ModelError (unknown-effect, effect-joint, effect-shape, effect-twice) where one is wrong or cannot act there;
    `option` says where it was typed if not in the recipe.
    """
    out: list[EffectChoice] = []
    for choice in choices:
        where = Where(joint=choice.joint, field=f"{option} {choice.effect}")
        for index in (n for n, listed in enumerate(robot.effects) if listed is choice):
            line = robot.effect_lines[index] if robot.effect_lines else None
            where = Where(file=robot.origin or None, line=line, field=f"effects[{index + 1}]")
        for single in _at_joints(choice, robot, where):
            twins = [other for other in out if (other.effect, other.joint) == (single.effect, single.joint)]
            is_same = any(single.shape and dict(other.shape) == dict(single.shape) for other in twins)
            # Twice a ripple at a joint is two harmonics, unless they are one.
            if is_same or (twins and not catalogue()[single.effect].is_repeatable):
                what = f"{option_text(single.effect, single.joint, {})} is in the model already"
                raise ModelError(
                    "effect-twice", what, where, "give each its own shape" if is_same else "take one of them out"
                )
            out.append(single)
    return tuple(out)


def known_effect(name: str, where: Where) -> Effect:
    """The effect of the catalogue called `name`; refused where there is none, or where every model has it."""
    effects = catalogue()
    if name not in effects:
        what = f"there is no effect {name} in the catalogue" if name else "no effect is named"
        raise ModelError("unknown-effect", what, where, f"{meant(name, list(effects))}; {OWN}")
    if effects[name].base:
        raise ModelError("effect-twice", f"{name} is in every model already", where, "leave it out")
    return effects[name]


def _at_joints(choice: EffectChoice, robot: Robot, where: Where) -> list[EffectChoice]:
    effect, joints = known_effect(choice.effect, where), range(1, robot.n_joints + 1)
    if effect.scope is Scope.ARM and choice.joint is not None:
        what = f"{effect.name} is of the whole arm, not of joint {choice.joint}"
        raise ModelError("effect-joint", what, where, "leave the joint out")
    if choice.joint is not None and choice.joint not in joints:
        what, mend = f"{robot.name} has no joint {choice.joint}", f"joints count from 1 to {robot.n_joints}"
        raise ModelError("effect-joint", what, where, mend)
    numbers = (0,) if effect.scope is Scope.ARM else joints if choice.joint is None else (choice.joint,)
    # A joint that is named is one that any motion may load; that constant speed does not, the fit says.
    refusals = {number: effect.applies(robot, number, in_motion=choice.joint is not None) for number in numbers}
    if None not in refusals.values():
        what = f"{effect.name} cannot act there: {next(iter(refusals.values()))}"
        raise ModelError("effect-joint", what, where, "leave it out")
    out = []
    for number in (number for number, refusal in refusals.items() if refusal is None):
        shapes = {shape.name: shape for shape in effect.shapes(robot, number)}
        for name, value in choice.shape.items():
            if name not in shapes:
                mend = meant(name, list(shapes)) if shapes else "leave it out"
                raise ModelError("effect-shape", f"{effect.name} has no shape called {name}", where, mend)
            if not shapes[name].low <= value <= shapes[name].high:
                what = f"{name} of {effect.name} is {value:g}"
                mend = f"write a number from {shapes[name].low:g} to {shapes[name].high:g}"
                raise ModelError("effect-shape", what, where, mend)
        out.append(replace(choice, joint=number or None))
    return out


def reopened(estimate: Estimate) -> tuple[EffectChoice, ...]:
    """The effects of a model as they were chosen: shapes that were fitted are open again."""
    given = {value.name for value in estimate.values if value.state == GIVEN}
    out = []
    for choice in estimate.effects:
        prefix = f"{choice.effect}." if choice.joint is None else f"{choice.effect}.j{choice.joint}."
        whole = catalogue()[choice.effect].chosen(choice.shape)
        shape = {name: value for name, value in choice.shape.items() if name in whole or prefix + name in given}
        out.append(replace(choice, shape=shape))
    return tuple(out)
