"""The model of the currents: the arm and its effects as names and columns; the one place that builds regressors."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import BLOCK, Run
from pumaid.effect_spec import Column, EffectTerm, terms_of
from pumaid.effects import Scope, catalogue
from pumaid.estimate import Estimate
from pumaid.joint_bins import SAME_POSTURE, JointBins, swept
from pumaid.kinematics import apart
from pumaid.preprocessing.options import STROKE
from pumaid.rigid_body import base_parameters
from pumaid.robot import Robot
from pumaid.samples import Loads, Samples
from pumaid.structure import Structure, in_motion, minimal

Floats = NDArray[np.float64]

#: Name of a column that stands for an unknown delay of a joint's current in its strokes.
DELAY = "delay"
#: Name of the columns of what a rigid body has beside weight.
INERTIA = "inertia"


class Model:
    """The arm's base model (gravity, Coulomb, viscous) with an inertia a posture group where strokes are, and more.

    Where all joints may move (`is_dynamic`) it has the rigid body's base parameters instead, weight among them.
    `stroke_postures` are (joint, held positions (J,)) of each group of strokes, numbered in this order at each joint;
    the columns of `effects`, shapes filled in, come last. The current of the joints `delays` may come late in strokes,
    by a time that is known to be short before any data.
    """

    def __init__(
        self,
        robot: Robot,
        stroke_postures: Sequence[tuple[int, Sequence[float]]] = (),
        effects: Sequence[EffectTerm] = (),
        *,
        delays: Sequence[int] = (),
        is_dynamic: bool = False,
    ) -> None:
        self.robot, self.is_dynamic = robot, is_dynamic
        self.structure: Structure = in_motion(robot) if is_dynamic else minimal(robot)
        self.stroke_postures = tuple((joint, tuple(float(p) for p in held)) for joint, held in stroke_postures)
        late = [Column(f"{DELAY}.j{n}", f"dt{n}", "s", "how late the current is", n, DELAY) for n in delays]
        self._base = (*self._base_columns(), *late)
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
        """The same arm and strokes with these effects instead of its own."""
        other = copy.copy(self)
        other._choose(effects)
        return other

    @classmethod
    def of_runs(
        cls, robot: Robot, runs: Iterable[Run], effects: Sequence[EffectTerm] = (), *, all_delays: bool = False
    ) -> Model:
        """The model that `runs` ask for: an inertia for each joint and set of outer positions with strokes.

        Where runs at constant speed tell friction and weight apart from it, strokes may be late; `all_delays` says so
        of joints that have nothing but strokes, too, in which all else that the model lacks would pass for a delay.
        """
        groups: list[tuple[int, Floats]] = []
        kinds: dict[int, set[str]] = {}
        for run in runs:
            kinds.setdefault(run.joint, set()).add(run.kind)
            if run.kind == STROKE and _group(groups, run.joint, run.posture) is None:
                groups.append((run.joint, np.nan_to_num(run.posture)))
        if any(BLOCK in of_joint for of_joint in kinds.values()):
            return cls(robot, (), effects, is_dynamic=True)
        groups.sort(key=lambda item: item[0])
        late = [joint for joint in sorted(kinds) if STROKE in kinds[joint] and (all_delays or len(kinds[joint]) > 1)]
        return cls(robot, [(joint, tuple(held)) for joint, held in groups], effects, delays=late)

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
        return cls(robot, estimate.stroke_postures, effects, is_dynamic=is_dynamic)

    def _base_columns(self) -> Iterable[Column]:
        """Every parameter of the paper's model that exists for this arm, effect by effect."""
        chosen = [effect for effect in catalogue().values() if effect.base or effect.per_posture]
        chosen.sort(key=lambda effect: (effect.scope is not Scope.LINK, not effect.base, effect.name))
        yield from self._inertial_columns()
        for effect, number in itertools.product(chosen, range(1, self.robot.n_joints + 1)):
            held = sum(joint == number for joint, _ in self.stroke_postures)
            for group in range(held) if effect.per_posture else (None,):
                mark = "" if group is None or held == 1 else str(group + 1)
                parts = EffectTerm(effect, number, mark=mark).parts(self.robot, None)
                exist = (part for part in parts if part.name not in self.structure.absent)
                yield from (replace(part, group=group, span=math.inf) for part in exist)

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

        Samples have loads where an effect needs them; strokes are in the posture group that is nearest.
        """
        return np.hstack([self.base(samples), self.beyond(samples)])

    def along(self, samples: Samples, sizes: NDArray[np.int64]) -> Floats:
        """(M, b) of the paper's model along runs of `sizes` instants each; all joints but the moving one stand."""
        links = np.array([column.scope is Scope.LINK for column in self._base])
        turns = self.robot.joint(samples.joint).is_revolute
        still = replace(samples, acceleration=np.zeros(len(samples)))
        weights = swept(still, sizes, lambda knots: self.base(knots)[:, links], turns=turns)
        out = self.base(samples, links=False)
        out[:, links] = weights
        return self._accelerated(samples, out)

    def design(self, bins: JointBins, gravity: Loads | None = None) -> Floats:
        """(N, p) means of the regressor over the bins of one joint; 0 for unknown delays, which wait for a fit.

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
        nodes, moves = bins.nodes[0], np.repeat(bins.is_stroke[bins.run], 3)
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
        """(M, b) of the paper's model; the columns of links are left zero unless `links`, those of delays always."""
        moving, groups = samples.joint, self.groups(samples.joint, samples.position)
        out = np.zeros((len(samples), len(self._base)))
        acting: dict[str, list[tuple[int, Column]]] = {}
        for index, column in enumerate(self._base):
            is_link = column.scope is Scope.LINK
            is_felt = links and column.owner >= moving if is_link else column.owner == moving
            if column.effect != DELAY and is_felt:
                acting.setdefault(column.effect, []).append((index, column))
        if self.is_dynamic:
            acting.pop(INERTIA, None)
            out = self._accelerated(samples, out) if links else out
        for name, columns in acting.items():
            effect, owners = catalogue()[name], sorted({column.owner for _, column in columns})
            values = effect.columns_of(self.robot, samples, owners)
            for index, column in columns:
                names = [parameter.name for parameter in effect.parameters(self.robot, column.owner)]
                position = 0 if column.group is not None else names.index(column.name.rsplit(".", 1)[1])
                part = values[column.owner][:, position]
                out[:, index] = part if column.group is None else np.where(groups == column.group, part, 0.0)
        return out

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

    def groups(self, joint: int, position: Floats) -> NDArray[np.int64]:
        """(M,) group of strokes whose held outer positions are nearest to (M, J) positions; -1 where there is none."""
        held = np.array([held for number, held in self.stroke_postures if number == joint])
        if held.size == 0:
            return np.full(len(position), -1)
        distance = apart(position[:, None, joint:], held[None, :, joint:]).max(axis=2, initial=0.0)
        return distance.argmin(axis=1)

    def is_foreign(self, run: Run) -> bool:
        """Whether `run` is a stroke in a posture whose inertia was not identified."""
        held = [(joint, np.array(posture)) for joint, posture in self.stroke_postures]
        return run.kind == STROKE and _group(held, run.joint, run.posture) is None

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


def _group(groups: Sequence[tuple[int, Floats]], joint: int, posture: Floats) -> int | None:
    """Index of the group that `posture` belongs to; only joints outward of the moving one matter to inertia."""
    for number, (member, held) in enumerate(groups):
        if member == joint and np.all(apart(posture[joint:], held[joint:]) < SAME_POSTURE):
            return number
    return None
