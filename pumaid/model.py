"""The model of the currents: the arm and its effects as names and columns; the one place that builds regressors."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from pumaid.dataset import Run
from pumaid.effect_spec import Column, EffectTerm, terms_of
from pumaid.effects import Scope, catalogue
from pumaid.estimate import Estimate
from pumaid.joint_bins import JointBins, swept
from pumaid.maths import Counts, Floats
from pumaid.rigid_body import base_parameters
from pumaid.robot import Robot
from pumaid.samples import Loads, Samples
from pumaid.structure import Structure, in_motion, minimal

#: Name of the columns of what a rigid body has beside weight.
INERTIA = "inertia"


class Model:
    """The arm's base model (gravity, Coulomb, viscous), and the columns of `effects`, shapes filled in, last.

    Where joints accelerate (`is_dynamic`) it has the rigid body's base parameters, weight among them.
    """

    def __init__(self, robot: Robot, effects: Sequence[EffectTerm] = (), *, is_dynamic: bool = False) -> None:
        self.robot, self.is_dynamic = robot, is_dynamic
        self.structure: Structure = in_motion(robot) if is_dynamic else minimal(robot)
        self._base = tuple(self._base_columns())
        names = [column.name for column in self._base]
        #: Columns of the rigid body's base parameters, in their order.
        inertial = rigid_body_names(robot) if is_dynamic else []
        self.inertial = np.array([names.index(name) for name in inertial], dtype=np.int64)
        self._base_designs = WeakKeyDictionary[JointBins, Floats]()  # shared by models with other effects
        self._choose(effects)

    def _choose(self, effects: Sequence[EffectTerm]) -> None:
        parts = [term.parts(self.robot, place) for place, term in enumerate(effects)]
        self.effects = tuple(effects)
        self.columns: tuple[Column, ...] = (*self._base, *itertools.chain.from_iterable(parts))
        self.names = tuple(column.name for column in self.columns)
        self.owners = np.array([column.owner for column in self.columns], dtype=int)
        self.is_scaled = np.array([column.scope is Scope.LINK for column in self.columns], dtype=bool)

    def with_effects(self, effects: Sequence[EffectTerm]) -> Model:
        """The same arm with these effects instead of its own."""
        other = copy.copy(self)
        other._choose(effects)
        return other

    @classmethod
    def of_runs(cls, robot: Robot, runs: Iterable[Run], effects: Sequence[EffectTerm] = ()) -> Model:
        """The model that `runs` ask for: with inertia where a run accelerates."""
        return cls(robot, effects, is_dynamic=any(run.accelerates for run in runs))

    @classmethod
    def of_estimate(cls, robot: Robot, estimate: Estimate) -> Model:
        """The model that `estimate` is a fit of, with the derivatives by shapes that it fitted."""
        values = dict(zip(estimate.names, estimate.solution, strict=True))
        effects = []
        for term in terms_of(estimate.effects):
            parts = list(term.whole.parts(robot, 0))
            fitted = tuple(part.shape for part in parts if part.shape is not None and part.name in values)
            sizes = tuple(float(values[part.name]) for part in parts if part.shape is None)
            effects.append(replace(term, fitted=fitted, sizes=sizes))
        is_dynamic = any(name.startswith((f"{INERTIA}.l", "rotor.")) for name in estimate.names)
        return cls(robot, effects, is_dynamic=is_dynamic)

    def _base_columns(self) -> Iterable[Column]:
        """Every parameter of the paper's model that exists for this arm, effect by effect."""
        chosen = sorted(
            (effect for effect in catalogue().values() if effect.base),
            key=lambda effect: (effect.scope is not Scope.LINK, effect.name),
        )
        yield from self._inertial_columns()
        for effect, number in itertools.product(chosen, range(1, self.robot.n_joints + 1)):
            parts = EffectTerm(effect, number).parts(self.robot, None)
            yield from (replace(part, span=math.inf) for part in parts if part.name not in self.structure.absent)

    def _inertial_columns(self) -> Iterable[Column]:
        """Base parameters of the rigid body that no weight shows."""
        for name in rigid_body_names(self.robot) if self.is_dynamic else ():
            kind, owner, *part = name.split(".")
            link, symbol = int(owner[1:]), f"I{owner[1:]}{part[0] if part else ''}"
            if kind != "gravity":
                unit = "A s2/m" if name.endswith((".m", ".mx", ".my", ".mz")) else "A s2/rad"
                yield Column(name, symbol, unit, "inertia", link, INERTIA, scope=Scope.LINK)

    def regressor(self, samples: Samples) -> Floats:
        """(M, p) A in joint `samples.joint` per unit of every parameter, those of links in units of their own gain.

        Samples have loads where an effect needs them.
        """
        return np.hstack([self.base(samples), self.beyond(samples)])

    def along(self, samples: Samples, sizes: Counts) -> Floats:
        """(M, b) of the paper's model along runs of `sizes` instants each; all joints but the moving one stand."""
        links = np.array([column.scope is Scope.LINK for column in self._base])
        turns = self.robot.joint(samples.joint).is_revolute
        still = replace(samples, acceleration=np.zeros(len(samples)))
        weights = swept(still, sizes, lambda knots: self.base(knots)[:, links], turns=turns)
        out = self.base(samples, links=False)
        out[:, links] = weights
        return self._accelerated(samples, out)

    def design(self, bins: JointBins, gravity: Loads | None = None) -> Floats:
        """(N, p) means of the regressor over the bins of one joint.

        `gravity` is what a fitted model says of gravity at the bins' nodes, where an effect needs it.
        """
        if bins not in self._base_designs:
            self._base_designs[bins] = self._of_blocks(bins, bins.averaged(self._base_at_nodes(bins)))
        beyond = self.beyond(replace(bins.nodes[0], loads=gravity))
        return np.hstack([self._base_designs[bins], bins.averaged(beyond)])

    def at_nodes(self, bins: JointBins, gravity: Loads | None = None) -> Floats:
        """(3 N, p) the same at the nodes of bins; in the paper's model nothing accelerates at constant speed."""
        base = self._of_blocks(bins, self._base_at_nodes(bins), times=3)
        return np.hstack([base, self.beyond(replace(bins.nodes[0], loads=gravity))])

    def _base_at_nodes(self, bins: JointBins) -> Floats:
        nodes, moves = bins.nodes[0], np.repeat(bins.accelerates[bins.run], 3)
        steady = replace(nodes, acceleration=np.where(moves, nodes.acceleration, 0.0))
        return self.along(steady, 3 * bins.lengths)

    def _of_blocks(self, bins: JointBins, base: Floats, *, times: int = 1) -> Floats:
        """(times N, b) with what the rigid body asks in blocks of any motion, which was averaged with the current."""
        if bins.rigid_body is None or not self.is_dynamic:
            return base
        rows = np.flatnonzero(np.repeat(np.isfinite(bins.rigid_body[:, 0]), times))
        base[np.ix_(rows, self.inertial)] = bins.rigid_body[rows // times]
        return base

    def base(self, samples: Samples, *, links: bool = True) -> Floats:
        """(M, b) of the paper's model; the columns of links are left zero unless `links`."""
        moving = samples.joint
        out = np.zeros((len(samples), len(self._base)))
        acting: dict[str, list[tuple[int, Column]]] = {}
        for index, column in enumerate(self._base):
            is_link = column.scope is Scope.LINK
            is_felt = links and column.owner >= moving if is_link else column.owner == moving
            if is_felt:
                acting.setdefault(column.effect, []).append((index, column))
        acting.pop(INERTIA, None)
        for name, columns in acting.items():
            effect, owners = catalogue()[name], sorted({column.owner for _, column in columns})
            values = effect.columns_of(self.robot, samples, owners)
            for index, column in columns:
                names = [parameter.name for parameter in effect.parameters(self.robot, column.owner)]
                out[:, index] = values[column.owner][:, names.index(column.name.rsplit(".", 1)[1])]
        return self._accelerated(samples, out) if links else out

    def _accelerated(self, samples: Samples, out: Floats) -> Floats:
        """(M, b) with what the rigid body asks where the moving joint accelerates alone."""
        if not self.is_dynamic or not samples.acceleration.any():
            return out
        pull = np.zeros((self.robot.n_joints, len(samples)))
        pull[samples.joint - 1] = samples.acceleration
        body = replace(base_parameters(self.robot), robot=replace(self.robot, gravity=(0.0, 0.0, 0.0)))
        rows = body.rows(samples.position.T, np.zeros_like(pull), pull)[samples.joint - 1]
        out[:, self.inertial[-len(rows) :]] += rows.T
        return out

    def beyond(self, samples: Samples) -> Floats:
        """(M, e) the columns of chosen effects, in the order in which they come after the paper's model."""
        parts = [np.zeros((len(samples), 0))]
        for place, term in enumerate(self.effects):
            if term.touches(samples.joint):
                parts.append(term.columns(self.robot, samples))
            else:
                parts.append(np.zeros((len(samples), sum(column.place == place for column in self.columns))))
        return np.hstack(parts)

    def factors(self, scales: Floats, joint: int) -> Floats:
        """(p,) what multiplies each parameter in joint `joint`: ratios (J, J) for links, NaN where unknown; else 1."""
        return np.where(self.is_scaled, scales[joint - 1][self.owners - 1], 1.0)

    def needs_loads(self) -> bool:
        """Whether a chosen effect is made from the fitted loads."""
        return any(term.effect.needs_loads for term in self.effects)

    def predict(self, estimate: Estimate, samples: Samples) -> Floats:
        """(M,) current (A) of joint `samples.joint` by the fitted model; unknown ratios count as zero."""
        factors = np.nan_to_num(self.factors(estimate.scales, samples.joint))
        return np.asarray(self.regressor(samples) @ (factors * estimate.solution))


def rigid_body_names(robot: Robot) -> list[str]:
    """The names that the base parameters of the rigid body have as parameters of a model."""
    names = []
    for link, part in base_parameters(robot).names:
        weights = {"mx": "x", "my": "y"} if robot.joint(link).is_revolute else {"m": "mass"}
        inertia = f"rotor.j{link}" if part == "rotor" else f"{INERTIA}.l{link}.{part}"
        names.append(f"gravity.l{link}.{weights[part]}" if part in weights else inertia)
    return names
