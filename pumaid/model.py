"""The model of the currents: the arm and its effects as names and columns; the one place that builds regressors."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Effect, Scope, catalogue
from pumaid.errors import ModelError, Where
from pumaid.maths.frames import apart
from pumaid.records import CONSTANT_COLUMNS, Estimate, Robot, Run, Samples
from pumaid.structure import Structure, minimal

Floats = NDArray[np.float64]

#: Held positions closer than this (rad or m) are one posture: far above encoder noise and creep, far below what a
#: planner would call another posture.
SAME_POSTURE = 0.03

#: Singular values of a run's basis below this share of its largest are rounding.
FLAT = 1e-10


@dataclass(frozen=True, slots=True)
class Column:
    """One linear parameter: its name, symbol and unit, the joint or link (from 1) that owns it, its effect.

    `group` is the posture group (from 0) of a parameter that each set of held positions has for itself, else None.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    owner: int
    effect: str
    group: int | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """A run reduced to as many equations as it can inform: (k, p) regressors, (k,) target, (k,) of the constant.

    `rest` is the sum of squares (A2) that no model of these columns can touch, `samples` the samples behind.
    """

    run: Run
    regressors: Floats
    target: Floats
    ones: Floats
    rest: float
    samples: int


class Model:
    """The arm's base model (gravity, Coulomb, viscous) with an inertia a posture group where strokes are.

    Parameters
    ----------
    robot
        The arm.
    stroke_postures
        (joint, held positions (J,)) of each group of strokes, in order; those of a joint are numbered in this order.

    Raises
    ------
    ModelError [unknown-effect]
        The recipe switches on an effect that the catalogue does not have.
    """

    def __init__(self, robot: Robot, stroke_postures: Sequence[tuple[int, Sequence[float]]] = ()) -> None:
        _check_effects(robot)
        self.robot = robot
        self.structure: Structure = minimal(robot)
        self.stroke_postures = tuple((joint, tuple(float(p) for p in held)) for joint, held in stroke_postures)
        self.columns = tuple(self._columns())
        self.names = tuple(column.name for column in self.columns)
        self.owners = np.array([column.owner for column in self.columns], dtype=int)

    @classmethod
    def of_runs(cls, robot: Robot, runs: Iterable[Run]) -> Model:
        """The model that `runs` ask for: an inertia for each joint and set of outer positions with strokes."""
        groups: list[tuple[int, Floats]] = []
        for run in runs:
            if run.kind == "stroke" and _group(groups, run.joint, run.posture) is None:
                groups.append((run.joint, np.nan_to_num(run.posture)))
        groups.sort(key=lambda item: item[0])
        return cls(robot, [(joint, tuple(held)) for joint, held in groups])

    @classmethod
    def of_estimate(cls, robot: Robot, estimate: Estimate) -> Model:
        """The model that `estimate` is a fit of."""
        return cls(robot, estimate.stroke_postures)

    def _columns(self) -> Iterable[Column]:
        """Every parameter that exists for this arm, effect by effect."""
        for effect, number in itertools.product(self._effects(), range(1, self.robot.n_joints + 1)):
            letter = "l" if effect.scope is Scope.LINK else "j"
            parameters = effect.parameters(self.robot, number)
            for (group, mark), parameter in itertools.product(self._marks(effect, number), parameters):
                name = f"{effect.name}.{letter}{number}.{parameter.name}{mark}"
                symbol = parameter.symbol.format(n=number) + mark
                if name not in self.structure.absent:
                    yield Column(name, symbol, parameter.unit, parameter.meaning, number, effect.name, group)

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
            M instants of one moving joint.
        groups
            (M,) posture group of each instant (from 0), -1 where it is in none; the nearest where not given.

        Returns
        -------
        regressor
            (M, p); columns of link j are in units of joint j's own gain.
        """
        moving, out = samples.joint, np.zeros((len(samples), len(self.columns)))
        computed: dict[tuple[str, int], Floats] = {}
        if groups is None:
            groups = self.groups(moving, samples.position)
        for index, column in enumerate(self.columns):
            effect = catalogue()[column.effect]
            outward = effect.scope is Scope.LINK and column.owner >= moving
            if not (outward or column.owner == moving):
                continue
            key = (column.effect, column.owner)
            if key not in computed:
                computed[key] = effect.columns(self.robot, samples, number=column.owner)
            names = [parameter.name for parameter in effect.parameters(self.robot, column.owner)]
            bare = column.name.rsplit(".", 1)[1]
            position = 0 if column.group is not None else names.index(bare)
            values = computed[key][:, position]
            out[:, index] = values if column.group is None else np.where(groups == column.group, values, 0.0)
        return out

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

    def blocks(self, runs: Sequence[Run]) -> list[Block]:
        """Each run's equations, from its triangle alone.

        Within a run every column is a combination of the triangle's regressors; the combination is found by looking at
        the model at a few instants that the run could contain.
        """
        out: dict[int, Block] = {}
        for joint, kind in sorted({(run.joint, run.kind) for run in runs}):
            numbers = [n for n, run in enumerate(runs) if (run.joint, run.kind) == (joint, kind)]
            alike = self._blocks_alike(joint, [runs[n] for n in numbers])
            out.update(zip(numbers, alike, strict=True))
        return [out[n] for n in range(len(runs))]

    def _blocks_alike(self, joint: int, runs: Sequence[Run]) -> Iterable[Block]:
        probes, basis = _probes(self.robot, joint, runs)
        design = self.regressor(probes).reshape(len(runs), -1, len(self.columns))
        inverse = np.linalg.pinv(basis, rcond=FLAT)
        one = CONSTANT_COLUMNS.index("one")
        for run, rows, back in zip(runs, design, inverse, strict=True):
            regressors, current = run.triangle.rows()
            left, singular, right = np.linalg.svd(regressors)
            kept = singular > FLAT * max(float(singular[0]), 1e-300)
            base = (singular[kept, None] * right[: len(singular)][kept]) if kept.any() else right[:0]
            target = left[:, : len(singular)][:, kept].T @ current
            rest = max(float(current @ current - target @ target), 0.0)
            yield Block(run, base @ (back @ rows), target, base[:, one], rest, run.samples)

    def predict(self, estimate: Estimate, samples: Samples) -> Floats:
        """(M,) current (A) of joint `samples.joint` by the fitted model; unknown ratios count as zero."""
        scales = np.nan_to_num(estimate.scales[samples.joint - 1])[self.owners - 1]
        return self.regressor(samples) @ (scales * estimate.solution)

    def samples_of(self, run: Run) -> Samples:
        """A run's cells as what effects see; at constant speed the velocity is the run's own mean."""
        cells, own = run.cells, run.joint - 1
        velocity = cells.velocity.copy()
        if run.kind == "constant":
            velocity[:, own] = run.speed
        return Samples(
            run.joint,
            cells.position,
            velocity,
            acceleration=cells.acceleration,
            direction=np.full(len(cells), float(run.direction)),
            time=cells.time - run.start,
            travel=np.abs(cells.position[:, own] - run.span[0]),
            temperature=cells.temperature,
            extra=cells.extra,
        )


def _check_effects(robot: Robot) -> None:
    known = catalogue()
    for number, choice in enumerate(robot.effects, start=1):
        if choice.effect not in known:
            near = difflib.get_close_matches(choice.effect, known, n=1)
            raise ModelError(
                "unknown-effect",
                f"there is no effect {choice.effect} in the catalogue: {', '.join(known)}",
                Where(file=robot.origin or None, field=f"effects[{number}]"),
                f"did you mean {near[0]}?" if near else "take it out of the recipe's effects",
            )


def _group(groups: Sequence[tuple[int, Floats]], joint: int, posture: Floats) -> int | None:
    """Index of the group that `posture` belongs to; only joints outward of the moving one matter to inertia."""
    for number, (member, held) in enumerate(groups):
        if member == joint and np.all(apart(posture[joint:], held[joint:]) < SAME_POSTURE):
            return number
    return None


def _probes(robot: Robot, joint: int, runs: Sequence[Run]) -> tuple[Samples, Floats]:
    """Instants that determine a column's combination of the triangle's regressors, and those regressors there.

    Returns samples of all runs one after another (R * K) and the basis (R, K, columns).
    """
    own, kind = joint - 1, runs[0].kind
    angle = np.array([0.3, 1.6, 2.9, 4.1, 5.2, 5.9])
    share = np.array([0.4, 1.3, 0.7, 1.7, 1.1, 0.2]) if kind == "stroke" else np.ones(6)
    pull = np.array([0.5, -0.8, 0.9, -0.1, 0.2, -0.6]) if kind == "stroke" else np.zeros(6)
    k = len(angle)
    posture = np.nan_to_num(np.array([run.posture for run in runs]))
    position = np.repeat(posture, k, axis=0)
    position[:, own] = np.tile(angle, len(runs))
    speed = np.array([run.speed for run in runs])
    velocity = np.zeros_like(position)
    velocity[:, own] = (speed[:, None] * share).ravel()
    acceleration = np.tile(pull, len(runs))
    direction = np.repeat(np.sign(speed), k)
    samples = Samples(joint, position, velocity, acceleration=acceleration, direction=direction)
    turns = 1.0 if robot.joint(joint).is_revolute else 0.0
    regressors = [turns * np.cos(position[:, own]), turns * np.sin(position[:, own]), np.ones(len(position))]
    if kind == "stroke":
        regressors += [velocity[:, own], acceleration]
    return samples, np.stack(regressors, axis=-1).reshape(len(runs), k, -1)
