"""The model of the currents: the arm and its effects as names and columns; the one place that builds regressors."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import Chosen, Column, in_order
from pumaid.dataset import Run
from pumaid.effects import Effect, Scope, catalogue
from pumaid.equations import Block, of_bins, of_triangles, padded
from pumaid.kinematics import apart
from pumaid.knots import swept
from pumaid.records import Campaign, Estimate, Samples
from pumaid.robot import Robot
from pumaid.sight import Sight, samples_of
from pumaid.structure import Structure, minimal

Floats = NDArray[np.float64]

#: Held positions closer than this (rad or m) are one posture: far above encoder noise and creep, far below what a
#: planner would call another posture.
SAME_POSTURE = 0.03


class Model:
    """The arm's base model (gravity, Coulomb, viscous) with an inertia a posture group where strokes are, and more.

    Parameters
    ----------
    robot
        The arm.
    stroke_postures
        (joint, held positions (J,)) of each group of strokes, in order; those of a joint are numbered in this order.
    effects
        Physics beyond the paper's model, shapes filled in; their columns come last.
    """

    def __init__(
        self,
        robot: Robot,
        stroke_postures: Sequence[tuple[int, Sequence[float]]] = (),
        effects: Sequence[Chosen] = (),
    ) -> None:
        self.robot = robot
        self.structure: Structure = minimal(robot)
        self.stroke_postures = tuple((joint, tuple(float(p) for p in held)) for joint, held in stroke_postures)
        self._base = tuple(self._columns())
        self._choose(effects)

    def _choose(self, effects: Sequence[Chosen]) -> None:
        parts = [one.parts(self.robot, place) for place, one in enumerate(effects)]
        self.effects = tuple(effects)
        self.columns: tuple[Column, ...] = (*self._base, *itertools.chain.from_iterable(parts))
        self.names = tuple(column.name for column in self.columns)
        self.owners = np.array([column.owner for column in self.columns], dtype=int)
        self.is_scaled = np.array([column.scope is Scope.LINK for column in self.columns], dtype=bool)

    def with_effects(self, effects: Sequence[Chosen]) -> Model:
        """The same arm and strokes with these effects instead of its own."""
        other = copy.copy(self)
        other._choose(effects)
        return other

    @classmethod
    def of_runs(cls, robot: Robot, runs: Iterable[Run], effects: Sequence[Chosen] = ()) -> Model:
        """The model that `runs` ask for: an inertia for each joint and set of outer positions with strokes."""
        groups: list[tuple[int, Floats]] = []
        for run in runs:
            if run.kind == "stroke" and _group(groups, run.joint, run.posture) is None:
                groups.append((run.joint, np.nan_to_num(run.posture)))
        groups.sort(key=lambda item: item[0])
        return cls(robot, [(joint, tuple(held)) for joint, held in groups], effects)

    @classmethod
    def of_estimate(cls, robot: Robot, estimate: Estimate) -> Model:
        """The model that `estimate` is a fit of, with the derivatives by shapes that it fitted."""
        known = dict(zip(estimate.names, estimate.solution, strict=True))
        effects = []
        for one in in_order(estimate.effects):
            parts = list(replace(one, fitted=tuple(one.choice.shape)).parts(robot, 0))
            fitted = tuple(part.shape for part in parts if part.shape is not None and part.name in known)
            sizes = tuple(float(known[part.name]) for part in parts if part.shape is None)
            effects.append(replace(one, fitted=fitted, sizes=sizes))
        return cls(robot, estimate.stroke_postures, effects)

    def _columns(self) -> Iterable[Column]:
        """Every parameter of the paper's model that exists for this arm, effect by effect."""
        for effect, number in itertools.product(self._effects(), range(1, self.robot.n_joints + 1)):
            letter = "l" if effect.scope is Scope.LINK else "j"
            parameters = effect.parameters(self.robot, number)
            for (group, mark), parameter in itertools.product(self._marks(effect, number), parameters):
                name = f"{effect.name}.{letter}{number}.{parameter.name}{mark}"
                facts = (parameter.symbol.format(n=number) + mark, parameter.unit, parameter.meaning, number)
                if name not in self.structure.absent:
                    yield Column(name, *facts, effect.name, group, scope=effect.scope)

    def _marks(self, effect: Effect, number: int) -> list[tuple[int | None, str]]:
        """Posture groups of an effect's parameters at joint `number` and what marks them in names."""
        if not effect.per_posture:
            return [(None, "")]
        held = sum(joint == number for joint, _ in self.stroke_postures)
        return [(group, str(group + 1) if held > 1 else "") for group in range(held)]

    def _effects(self) -> list[Effect]:
        everything = catalogue()
        chosen = [effect for effect in everything.values() if effect.base]
        if self.stroke_postures:
            chosen.append(everything["inertia"])
        return sorted(chosen, key=lambda effect: (effect.scope is not Scope.LINK, not effect.base, effect.name))

    def regressor(self, samples: Samples, groups: NDArray[np.int64] | None = None) -> Floats:
        """Current in joint `samples.joint` per unit of every parameter, ratios of gains left out.

        Parameters
        ----------
        samples
            M instants of one moving joint, with loads where an effect needs them.
        groups
            (M,) posture group of each instant (from 0), -1 where it is in none; the nearest where not given.

        Returns
        -------
        regressor
            (M, p); columns of link j are in units of joint j's own gain.
        """
        return np.hstack([self._of_base(samples, groups), self.beyond(samples)])

    def along(self, samples: Samples, sizes: NDArray[np.int64]) -> Floats:
        """(M, p) of the paper's model along runs of `sizes` instants each; all joints but the moving one stand."""
        links = np.array([column.scope is Scope.LINK for column in self._base])
        turns = self.robot.joint(samples.joint).is_revolute
        weights = swept(samples, sizes, lambda knots: self._of_base(knots)[:, links], turns=turns)
        out = self._of_base(samples, links=False)
        out[:, links] = weights
        return out

    def base(self, samples: Samples) -> Floats:
        """(M, p) the same with nothing in the columns of chosen effects, which ask for no loads then."""
        return np.pad(self._of_base(samples), ((0, 0), (0, len(self.columns) - len(self._base))))

    def _of_base(self, samples: Samples, groups: NDArray[np.int64] | None = None, *, links: bool = True) -> Floats:
        moving, out = samples.joint, np.zeros((len(samples), len(self._base)))
        if groups is None:
            groups = self.groups(moving, samples.position)
        owners: dict[str, set[int]] = {}
        for column in self._base:
            is_link = column.scope is Scope.LINK
            if (links or not is_link) and (column.owner == moving or (is_link and column.owner > moving)):
                owners.setdefault(column.effect, set()).add(column.owner)
        found = {name: catalogue()[name].columns_of(self.robot, samples, sorted(own)) for name, own in owners.items()}
        for index, column in enumerate(self._base):
            if column.owner not in owners.get(column.effect, ()):
                continue
            parameters = catalogue()[column.effect].parameters(self.robot, column.owner)
            names = [parameter.name for parameter in parameters]
            position = 0 if column.group is not None else names.index(column.name.rsplit(".", 1)[1])
            values = found[column.effect][column.owner][:, position]
            out[:, index] = values if column.group is None else np.where(groups == column.group, values, 0.0)
        return out

    def beyond(self, samples: Samples) -> Floats:
        """(M, e) the columns of chosen effects, in the order in which they come after the paper's model."""
        parts = [np.zeros((len(samples), 0))]
        for place, one in enumerate(self.effects):
            if one.touches(samples.joint):
                parts.append(one.columns(self.robot, samples))
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
        return run.kind == "stroke" and _group(held, run.joint, run.posture) is None

    def touched(self, joint: int) -> bool:
        """Whether a chosen effect may act on `joint`."""
        return any(one.touches(joint) for one in self.effects)

    def needs_loads(self) -> bool:
        """Whether a chosen effect is made from the fitted loads."""
        return any(one.effect.needs_loads for one in self.effects)

    def has_slope(self, joint: int) -> bool:
        """Whether runs of `joint` at constant speed are looked at for what their speed changes all the same."""
        return any(one.effect.name == "inertia" and one.number == joint for one in self.effects)

    def is_fine(self, joint: int) -> bool:
        """Whether an effect may change within a bin of `joint`; what follows the load does not."""
        return any(one.touches(joint) and not one.effect.needs_loads for one in self.effects)

    def blocks(
        self,
        runs: Sequence[Run],
        sights: Mapping[int, Sight] | None = None,
        *,
        noise: Mapping[int, float] | None = None,
    ) -> list[Block]:
        """Each run's equations, from its triangle; from its bins as well where a chosen effect acts.

        Within a run every column of the paper's model is a combination of the triangle's regressors; the combination is
        found by looking at the model at a few instants that the run could contain. A chosen effect's column is such a
        combination and a rest, which adds equations of its own.

        Parameters
        ----------
        runs
            In any order.
        sights
            By joint (from 1), of all of `runs` in which it moves, in their order; with loads where an effect needs
            them. Made here where it is not given.
        noise
            By joint (A): strokes are weighed by what an unknown delay does to them (`equations.of_triangles`). The
            sights must be, too.
        """
        out: dict[int, Block] = {}
        for joint, kind in sorted({(run.joint, run.kind) for run in runs}):
            numbers = [n for n, run in enumerate(runs) if (run.joint, run.kind) == (joint, kind)]
            alike = of_triangles(
                self.robot, joint, [runs[n] for n in numbers], design=self._of_base, noise=(noise or {}).get(joint)
            )
            out.update(zip(numbers, alike, strict=True))
        return self.widened([out[n] for n in range(len(runs))], sights)

    def widened(self, blocks: Sequence[Block], sights: Mapping[int, Sight] | None = None) -> list[Block]:
        """The equations of runs by the paper's model, or by another choice of effects, with this model's effects.

        Parameters
        ----------
        blocks
            Of runs in any order, without equations that only effects touch.
        sights
            As for `blocks`.
        """
        if not self.effects:
            return list(blocks)
        runs, known, out = [block.run for block in blocks], len(self._base), list(blocks)
        more = len(self.columns) - known
        for joint in sorted({run.joint for run in runs}):
            numbers = [n for n, run in enumerate(runs) if run.joint == joint]
            own = [blocks[n] for n in numbers]
            if self.touched(joint):
                sight = (sights or {}).get(joint) or self.sight(joint, runs)
                wider = of_bins(own, sight, columns=self.beyond(sight.samples), known=known)
            else:
                wider = padded(own, known=known, more=more)
            for n, block in zip(numbers, wider, strict=True):
                out[n] = block
        return out

    def sight(
        self, joint: int, runs: Sequence[Run], campaign: Campaign | None = None, *, noise: float | None = None
    ) -> Sight:
        """The runs of `joint` as the chosen effects see them, without loads."""
        campaign = campaign or Campaign.of(runs)
        fine, slope = self.is_fine(joint), self.has_slope(joint)
        return Sight.of(self.robot, joint, runs, campaign=campaign, has_slope=slope, is_fine=fine, noise=noise)

    def predict(self, estimate: Estimate, samples: Samples) -> Floats:
        """(M,) current (A) of joint `samples.joint` by the fitted model; unknown ratios count as zero."""
        return self.regressor(samples) @ (
            np.nan_to_num(self.factors(estimate.scales, samples.joint)) * estimate.solution
        )

    def samples_of(self, run: Run, campaign: Campaign | None = None) -> Samples:
        """A run's bins as what effects see; at constant speed the velocity is the run's own mean."""
        return samples_of(run, campaign or Campaign.of([run]), has_slope=self.has_slope(run.joint))


def _group(groups: Sequence[tuple[int, Floats]], joint: int, posture: Floats) -> int | None:
    """Index of the group that `posture` belongs to; only joints outward of the moving one matter to inertia."""
    for number, (member, held) in enumerate(groups):
        if member == joint and np.all(apart(posture[joint:], held[joint:]) < SAME_POSTURE):
            return number
    return None
