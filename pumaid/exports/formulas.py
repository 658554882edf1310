"""A fitted model as numbers and formulas of posture and motion: what every form of export is written from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pumaid.effect_spec import EffectTerm, terms_of
from pumaid.effects import Samples
from pumaid.effects.curve import law, table
from pumaid.effects.formula import OF_MOTION, at_rest, filled, loads_of, names_in
from pumaid.estimate import NOT_IDENTIFIABLE, Estimate
from pumaid.maths import Counts, Flags, Floats
from pumaid.model import Model, felt_ratios, loads
from pumaid.rigid_body import PARAMETERS, base_parameters
from pumaid.robot import Robot
from pumaid.trajectory import highest_speeds

#: Random states in which sizes are looked for, with this seed; the slowest speed, beside the highest.
STATES, SEED, SLOWEST = 1000, 0, 1e-3


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
    #: (J, 11) of each link, in the gain of its own joint, by `rigid_body.PARAMETERS`; 0 where no motion was fitted.
    bodies: Floats
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
    #: (C, S + 5) learned curves, as `effects.curve.table` has them.
    curves: Floats
    terms: tuple[Term, ...]
    left_out: tuple[Lack, ...]
    undetermined: tuple[Lack, ...]

    @classmethod
    def of(cls, estimate: Estimate, robot: Robot) -> Formulas:
        """The formulas of a model; effects that have none are listed."""
        solution = dict(zip(estimate.names, estimate.solution.tolist(), strict=True))
        model = Model.of_estimate(robot, estimate)
        coulomb, viscous = rubs = model.rubs(estimate.solution)
        moments, bodies = model.moments(estimate.solution), np.zeros((robot.n_joints, len(PARAMETERS)))
        if model.is_dynamic:
            links, parts = base_places(robot)
            bodies[links, parts] = _mixed(robot, estimate) @ estimate.solution[model.inertial]
        heavy = np.asarray(moments.any(axis=1))
        beyond = np.triu(np.ones_like(estimate.scales, dtype=bool)) & heavy & robot.is_revolute[:, None]
        has_ratios = np.asarray((np.isfinite(estimate.scales) | ~beyond).all(axis=1))
        effects = terms_of(estimate.effects)
        learned = [effect for effect in effects if effect.effect.is_free]
        reasons = {spoken(effect): why_left_out(effect, robot) for effect in effects}
        # What a posture of this arm may need and the data did not tell; not what no posture can show.
        idle = {*model.structure.absent, *(f"gain_ratio.{i}.{j}" for i, j in model.structure.redundant)}
        return cls(
            robot=robot,
            estimate=estimate,
            moments=moments,
            bodies=bodies,
            ratios=np.nan_to_num(estimate.scales),
            felt=np.array([felt_ratios(heavy, estimate.scales, i) for i in range(robot.n_joints)]),
            coulomb=coulomb,
            viscous=viscous,
            shaft=robot.shaft_speeds,
            curves=np.array(
                [
                    table(effect.shape, np.array([solution[part.name] for part in effect.parts(robot, 0)]))
                    for effect in learned
                ]
            ),
            terms=tuple(
                term
                for effect in effects
                if reasons[spoken(effect)] is None
                for row in ([learned.index(effect)] if effect in learned else [0])
                for term in _terms(robot, effect, solution, has_ratios=has_ratios, rubs=rubs, row=row)
            ),
            left_out=tuple(Lack(name, reason) for name, reason in reasons.items() if reason is not None),
            undetermined=tuple(
                Lack(value.name, value.reason or "these data do not tell it")
                for value in estimate.values
                if value.state == NOT_IDENTIFIABLE and value.name not in idle
            ),
        )

    def arrays(self) -> dict[str, Floats]:
        """The base model by the names that exports give its tables."""
        names = ("moments", "ratios", "felt", "coulomb", "viscous", "shaft", "bodies", "curves")
        absent = {"bodies": not self.is_dynamic, "curves": not len(self.curves)}
        return {name: getattr(self, name) for name in names if not absent.get(name)}

    @property
    def is_dynamic(self) -> bool:
        """Whether the model has inertia."""
        return bool(self.bodies.any())

    def inertia(self, position: Floats, velocity: Floats, acceleration: Floats) -> Floats:
        """(N, J) A of the rigid body beside its weight, by the model's own regressor."""
        body = replace(base_parameters(self.robot), mixed=None, constants=None)
        (links, parts), moved = base_places(self.robot), np.empty_like(position)
        moving, still = (body.rows(position.T, k * velocity.T, k * acceleration.T) for k in (1.0, 0.0))
        values = self.bodies[links, parts]
        for joint, (rows, rest) in enumerate(zip(moving, still, strict=True)):
            moved[:, joint] = (values * self.ratios[joint, links])[-len(rows) :] @ (rows - rest)
        return moved

    def covariance(self) -> tuple[Floats, Floats]:
        """(P, P) of `bodies` where base parameters are, and (P, b) as far as the data do not tell them (`blind`)."""
        estimate, numbers = self.estimate, Model.of_estimate(self.robot, self.estimate).inertial
        mixed = _mixed(self.robot, estimate)
        return mixed @ estimate.covariance[np.ix_(numbers, numbers)] @ mixed.T, mixed @ estimate.blind[numbers]

    def predicted(self, position: Floats, velocity: Floats, *, without: str = "") -> Floats:
        """(N, J) A by the model itself, not by these formulas, without what is left out and one effect more.

        Every joint is in motion.
        """
        model = Model.of_estimate(self.robot, self.estimate)
        lost = {lack.name for lack in self.left_out} | {without}
        places = {place for place, effect in enumerate(model.effects) if spoken(effect) in lost}
        gone = np.array([column.place in places for column in model.columns], dtype=bool)
        bare = replace(self.estimate, solution=np.where(gone, 0.0, self.estimate.solution))
        return np.column_stack([model.predict(bare, samples) for samples in _instants(model, bare, position, velocity)])

    def states(self) -> tuple[Floats, Floats]:
        """(N, J) random positions within the limits, and velocities of all sizes, either way."""
        robot, rng = self.robot, np.random.default_rng(SEED)
        whole = [(-np.pi, np.pi) if joint.is_revolute else (-1.0, 1.0) for joint in robot.joints]
        low, high = np.transpose([joint.limits or span for joint, span in zip(robot.joints, whole, strict=True)])
        position = rng.uniform(low, high, (STATES, robot.n_joints))
        speed = highest_speeds(robot) * SLOWEST ** rng.uniform(0.0, 1.0, position.shape)
        return position, speed * rng.choice([-1.0, 1.0], position.shape)

    def weight(self, position: Floats) -> Floats:
        """(N, J) A of gravity by the paper's model, by the model itself."""
        instants = _instants(
            Model.of_estimate(self.robot, self.estimate), self.estimate, position, np.ones_like(position)
        )
        return np.column_stack([loads_of(samples).moving for samples in instants])


def base_places(robot: Robot) -> tuple[Counts, Counts]:
    """(P,) link and (P,) parameter, both from 0, of each base parameter."""
    links, parts = zip(*base_parameters(robot).names, strict=True)
    return np.array(links) - 1, np.array([PARAMETERS.index(part) for part in parts])


def _mixed(robot: Robot, estimate: Estimate) -> Floats:
    """(P, P) parameters of links, each in its own gain, of which combinations are the base parameters."""
    body, (links, _) = base_parameters(robot), base_places(robot)
    mixed = np.eye(len(links)) if body.mixed is None else body.mixed
    return np.asarray(mixed * np.nan_to_num(estimate.scales)[np.ix_(links, links)])


def _instants(model: Model, estimate: Estimate, position: Floats, velocity: Floats) -> Iterator[Samples]:
    still = np.zeros(len(position))
    names = ("acceleration", "time", "elapsed", "travel", "run")
    for joint, driving in enumerate(model.robot.shaft_speeds @ velocity.T, start=1):
        rest = dict.fromkeys(names, still) | {"temperature": np.full(len(position), np.nan)}
        samples = Samples(joint, position, velocity, direction=np.sign(driving), **rest)
        yield replace(samples, loads=loads(model, samples, solution=estimate.solution, scales=estimate.scales))


def spoken(term: EffectTerm) -> str:
    """``stribeck@3``, with ``_2`` for the second time at a joint."""
    return f"{term.effect.name}{term.mark}" + (f"@{term.number}" if term.number else "")


def why_left_out(term: EffectTerm, robot: Robot) -> str | None:
    """Why an effect is left out, or None where posture and velocities determine it."""
    effect, formula = term.effect, law(term.shape, 0) if term.effect.is_free else term.effect.formula
    if effect.left_out or not formula:
        return effect.left_out or "it states no formula"
    constants = {part.name for part in effect.parameters(robot, term.number)} | set(term.shapes(robot))
    more = sorted(names_in(formula) - OF_MOTION - constants)
    return f"it depends on more than posture and velocities: {', '.join(more)}" if more else None


def _terms(
    robot: Robot, term: EffectTerm, solution: Mapping[str, float], *, has_ratios: Flags, rubs: Floats, row: int
) -> Iterator[Term]:
    """An effect's terms; the load of another joint with an unknown ratio counts as none, as in the model."""
    effect, owner = term.effect, term.number
    parts = [part for part in term.parts(robot, 0) if part.shape is None]
    names = [parameter.name for parameter in effect.parameters(robot, owner)]
    values: dict[str, float | str] = dict(term.shape)
    shaft, sizes = f"shaft_{owner}", rubs[:, owner - 1].tolist()
    dry, drag = (f"({ahead!r} * ({shaft} > 0) + {back!r} * ({shaft} < 0))" for ahead, back in sizes)
    values |= {"friction_owner": f"({dry} + {drag} * {shaft})", "owner": float(owner)}
    values["shaft_on"] = f"shaft_{int(term.shape.get('on', 0))}"
    values |= {name: solution.get(part.name, 0.0) for name, part in zip(names, parts, strict=True)}
    for joint in filter(term.touches, range(1, robot.n_joints + 1)):
        is_unknown = owner and joint != owner and not has_ratios[owner - 1]
        values["load_owner"] = 0.0 if is_unknown else f"load_{owner}"
        constants = values | {"slope_owner": f"slope_{owner}", "joint": float(joint)}
        text = law(term.shape, row) if effect.is_free else effect.formula_in(robot, owner, joint) or "0.0"
        hold, friction = at_rest(filled(text, constants))
        texts = (hold, False), (friction, True)
        yield from (Term(joint, spoken(term), *pair) for pair in texts if pair[0] != "0.0")


# Bodies
