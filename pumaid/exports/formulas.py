"""A fitted model as numbers and formulas of posture and velocity: what every form of export is written from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effect_spec import EffectTerm, terms_of
from pumaid.effects import catalogue
from pumaid.effects.formula import OF_MOTION, at_rest, filled, names_in
from pumaid.estimate import NOT_IDENTIFIABLE, Estimate
from pumaid.gravity_load import felt_ratios, loads
from pumaid.model import Model
from pumaid.robot import Robot
from pumaid.samples import Samples
from pumaid.structure import minimal

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Term:
    """What an effect beyond the paper's model adds to the current of `joint` (from 1).

    `formula` is one of `pumaid.effects.formula`, all constants as numbers;
    `is_friction` says that it is there only in motion.
    """

    joint: int
    effect: str
    formula: str
    is_friction: bool


@dataclass(frozen=True, slots=True)
class Lack:
    """Something that an export does not hold, or holds without the data telling it: its name and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class Formulas:
    """The model as numbers, and the effects beyond the paper's model as terms; what it does not hold or tell."""

    robot: Robot
    estimate: Estimate
    #: (J, 2) of each link, in the gain of its own joint: k_x and k_y (A s2/m), or mass and nothing for a slide.
    moments: Floats
    #: (J, J) eta_i / eta_j by which link j counts in joint i; 0 where it does not or is not known.
    ratios: Floats
    #: (J, J) the same for moments that joint i's axis does not turn about, in the gain of the next joint outward that
    #: has one (see `Loads.tilts`).
    felt: Floats
    #: (J, 2) forward and backward, A and A s/rad or A s/m.
    coulomb: Floats
    viscous: Floats
    #: (J, J) from the joints' velocities to those that drive their friction; the identity for most arms.
    shaft: Floats
    terms: tuple[Term, ...]
    left_out: tuple[Lack, ...]
    undetermined: tuple[Lack, ...]

    @classmethod
    def of(cls, estimate: Estimate, robot: Robot) -> Formulas:
        """The formulas of a model; effects that have none are listed."""
        solution = dict(zip(estimate.names, estimate.solution.tolist(), strict=True))
        moments = np.array([_moment(solution, joint.number, joint.is_revolute) for joint in robot.joints])
        heavy = np.asarray(moments.any(axis=1))
        beyond = np.triu(np.ones_like(estimate.scales, dtype=bool)) & heavy & robot.is_revolute[:, None]
        has_ratios = np.asarray((np.isfinite(estimate.scales) | ~beyond).all(axis=1))
        effects = terms_of(estimate.effects)
        reasons = {spoken(effect): why_left_out(effect, robot) for effect in effects}
        lacks = [Lack(name, reason) for name, reason in reasons.items() if reason is not None]
        if estimate.stroke_postures:
            lacks.append(Lack("inertia", catalogue()["inertia"].left_out))
        return cls(
            robot=robot,
            estimate=estimate,
            moments=moments,
            ratios=np.nan_to_num(estimate.scales),
            felt=np.array([felt_ratios(heavy, estimate.scales, i) for i in range(robot.n_joints)]),
            coulomb=_pairs(solution, "coulomb", robot),
            viscous=_pairs(solution, "viscous", robot),
            shaft=robot.shaft_speeds,
            terms=tuple(term for effect in effects for term in _terms(robot, effect, solution, has_ratios=has_ratios)),
            left_out=tuple(lacks),
            undetermined=tuple(_undetermined(estimate, robot)),
        )

    def uses(self, quantity: str) -> bool:
        """Whether a term is made from `quantity` (``across``, ``slope``, ``tilt``)."""
        return any(re.search(rf"\b{quantity}(_\w+)?\b", term.formula) for term in self.terms)

    def predicted(self, position: Floats, velocity: Floats) -> Floats:
        """(N, J) A by the model itself, not by these formulas, without what is left out; every joint is in motion."""
        model = Model.of_estimate(self.robot, self.estimate)
        lost = {lack.name for lack in self.left_out}
        places = {place for place, effect in enumerate(model.effects) if spoken(effect) in lost}
        gone = np.array([column.place in places for column in model.columns], dtype=bool)
        estimate = replace(self.estimate, solution=np.where(gone, 0.0, self.estimate.solution))
        out = np.empty_like(position)
        driving = velocity @ self.shaft.T
        for number in range(1, self.robot.n_joints + 1):
            samples = _instants(number, position, velocity, driving=driving[:, number - 1])
            at = loads(model, samples, solution=estimate.solution, scales=estimate.scales)
            out[:, number - 1] = model.predict(estimate, replace(samples, loads=at))
        return out

    def weight(self, position: Floats) -> Floats:
        """(N, J) A of gravity by the paper's model, by the model itself."""
        model = Model.of_estimate(self.robot, self.estimate)
        out = np.empty_like(position)
        for number in range(1, self.robot.n_joints + 1):
            samples = _instants(number, position, np.zeros_like(position), driving=np.ones(len(position)))
            at = loads(model, samples, solution=self.estimate.solution, scales=self.estimate.scales)
            out[:, number - 1] = at.moving
        return out


def _instants(joint: int, position: Floats, velocity: Floats, *, driving: Floats) -> Samples:
    """Instants of a warm joint, long in motion."""
    still = np.zeros(len(position))
    return Samples(
        joint,
        position,
        velocity,
        acceleration=still,
        direction=np.sign(driving),
        time=still,
        elapsed=still,
        travel=still,
        temperature=np.full(len(position), np.nan),
        run=still,
    )


def spoken(term: EffectTerm) -> str:
    """``stribeck@3``, with ``_2`` for the second time at a joint."""
    return f"{term.effect.name}{term.mark}" + (f"@{term.number}" if term.number else "")


def why_left_out(term: EffectTerm, robot: Robot) -> str | None:
    """Why an effect is left out, or None where posture and velocities determine it."""
    effect = term.effect
    if effect.left_out or not effect.formula:
        return effect.left_out or "it states no formula"
    constants = {part.name for part in effect.parameters(robot, term.number)} | set(term.shapes(robot))
    more = sorted(names_in(effect.formula) - OF_MOTION - constants)
    return f"it depends on more than posture and velocities: {', '.join(more)}" if more else None


def _moment(solution: Mapping[str, float], link: int, turns: bool) -> tuple[float, float]:
    parts = ("x", "y") if turns else ("mass", "")
    first, second = (solution.get(f"gravity.l{link}.{part}", 0.0) for part in parts)
    return first, second


def _pairs(solution: Mapping[str, float], effect: str, robot: Robot) -> Floats:
    ways = ("plus", "minus")
    return np.array([[solution.get(f"{effect}.j{joint.number}.{way}", 0.0) for way in ways] for joint in robot.joints])


def _terms(
    robot: Robot, term: EffectTerm, solution: Mapping[str, float], *, has_ratios: NDArray[np.bool_]
) -> Iterator[Term]:
    """An effect's terms; the load of another joint with an unknown ratio counts as none, as in the model."""
    if why_left_out(term, robot) is not None:
        return
    effect, owner = term.effect, term.number
    parts = [part for part in term.parts(robot, 0) if part.shape is None]
    names = [parameter.name for parameter in effect.parameters(robot, owner)]
    values: dict[str, float | str] = dict(term.shape)
    values |= {name: solution.get(part.name, 0.0) for name, part in zip(names, parts, strict=True)}
    for joint in filter(term.touches, range(1, robot.n_joints + 1)):
        is_unknown = owner and joint != owner and not has_ratios[owner - 1]
        values["load_owner"] = 0.0 if is_unknown else f"load_{owner}"
        constants = values | {"slope_owner": f"slope_{owner}", "joint": float(joint)}
        hold, friction = at_rest(filled(effect.formula_in(robot, owner, joint) or "0.0", constants))
        for text, is_friction in ((hold, False), (friction, True)):
            if text != "0.0":
                yield Term(joint, spoken(term), text, is_friction)


def _undetermined(estimate: Estimate, robot: Robot) -> Iterator[Lack]:
    """What a posture of this arm may need and the data did not tell; not what no posture can show."""
    structure = minimal(robot)
    idle = {*structure.absent, *(f"gain_ratio.{i}.{j}" for i, j in structure.redundant)}
    for value in estimate.values:
        if value.state == NOT_IDENTIFIABLE and value.name not in idle:
            yield Lack(value.name, value.reason or "these data do not tell it")
