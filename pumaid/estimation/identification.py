"""The fit that identify and diagnose share: runs, and effects beyond the paper's model, to an estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.choices import expanded
from pumaid.chosen import Chosen, Column
from pumaid.dataset import Dataset, Run
from pumaid.errors import LogError, Note, Where
from pumaid.estimation import notes
from pumaid.estimation.combinations import determined
from pumaid.estimation.delays import of_delays
from pumaid.estimation.drift import of_drift
from pumaid.estimation.enlarged import Enlarged, enlarged
from pumaid.estimation.judge import Judge, rmse
from pumaid.estimation.misfit import of_misfit, of_runs
from pumaid.estimation.profiles import Profile
from pumaid.estimation.reasons import Facts
from pumaid.estimation.rows import Row
from pumaid.estimation.sheet import Sheet
from pumaid.estimation.system import Fitted, Progress
from pumaid.maths.propagation import recursion_covariance
from pumaid.maths.statistics import Clustered, clustered, interval
from pumaid.model import Model
from pumaid.preprocessing.options import STROKE
from pumaid.preprocessing.replicates import Pair, noise_floor, pairs
from pumaid.records import GIVEN, IDENTIFIED, NOT_IDENTIFIABLE, Campaign, Estimate, JointFit, Value
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]


def identified(
    dataset: Dataset,
    robot: Robot,
    *,
    effects: Sequence[EffectChoice] | None = None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Estimate:
    """Fit the arm's base model and chosen effects to all runs that are not held out.

    Parameters
    ----------
    dataset
        Runs of some or all joints.
    robot
        Geometry and gravity.
    effects
        Physics beyond the paper's model; the recipe's where not given. Shapes that a choice leaves open are fitted.
    recursive
        Stop after the recursion.
    progress
        Called with the joint at work (0: all) and a word on what is done.

    Returns
    -------
    estimate
        Every parameter, identified or not; its effects have all their shapes.

    Raises
    ------
    LogError [no-runs]
        There is no run to fit.
    ModelError [unknown-effect], [effect-joint], [effect-shape], [effect-not-here], [effect-twice]
        An effect cannot be in the model.
    """
    choices = expanded(robot.effects if effects is None else effects, robot)
    runs = tuple(run for run in dataset.runs if not run.heldout)
    if not runs:
        raise _no_runs(dataset)
    model, campaign = Model.of_runs(robot, runs), Campaign.of(dataset.runs, dataset.rejects)
    choices = tuple(choice for choice in choices if not _is_there(choice, model))
    found = enlarged(model, runs, choices, campaign=campaign, recursive=recursive, progress=progress)
    fitted = found.fitted
    first = recursion_covariance(fitted.first_system, fitted.first_values, fitted.first_gains, runs=fitted.run_of)
    final = first if recursive else _joint_covariance(fitted)
    of_recursion = Sheet.of_recursion(fitted, runs, first)
    sheet = of_recursion if recursive else Sheet.of(fitted, runs, final, gauge=found.gauge)
    sheet = replace(sheet, profiles=_profiles(found, sheet))
    shown, model = sheet.values(), fitted.model
    values = (*shown, *_held(found, choices, shown))
    p = len(model.names)
    is_shape = np.array([column.shape is not None for column in model.columns], dtype=bool)
    repeated = {joint: pairs([run for run in runs if run.joint == joint]) for joint in range(1, robot.n_joints + 1)}
    joints = tuple(_joint_fit(fitted, runs, joint, repeated=own) for joint, own in repeated.items())
    estimate = Estimate(
        robot=robot.name,
        joints=joints,
        values=values,
        names=model.names,
        solution=np.where(is_shape, 0.0, fitted.solution.values),
        covariance=final.covariance[:p, :p],
        scales=fitted.scales(),
        blind=sheet.blind(),
        effects=_with_shapes(found, choices),
        combinations=determined(sheet, shown),
        stroke_postures=model.stroke_postures,
        recursive=of_recursion.values(),
        method="recursive" if recursive else "joint",
        recipe_digest=robot.digest,
        origin=robot.origin,
        logs={facts.name: facts.digest for facts in dataset.files},
        version=__version__,
    )
    estimate = _with_errors(estimate, robot, dataset)
    told = _notes(found, runs, estimate, robot, repeated=repeated)
    return replace(estimate, notes=(*dataset.notes, *told))


def _notes(
    found: Enlarged, runs: Sequence[Run], estimate: Estimate, robot: Robot, *, repeated: Mapping[int, Sequence[Pair]]
) -> list[Note]:
    """What there is to be said of a fit."""
    fitted, values = found.fitted, estimate.values
    return [
        *of_misfit(fitted, estimate.joints),
        *of_runs(fitted),
        *of_drift(estimate.joints, repeated),
        *([] if estimate.effects else of_delays(fitted.model, runs, values)),
        *notes.of_fit(fitted, robot),
        *notes.of_gears(fitted, robot),
        *notes.odd_friction(values, robot.n_joints),
        *notes.odd_gains(values, robot.n_joints),
        *notes.odd_inertia(values, robot.n_joints),
        *notes.of_effects(found, runs),
    ]


def _is_there(choice: EffectChoice, model: Model) -> bool:
    """Whether runs from rest to rest have brought the joint's inertia into the model already."""
    return choice.effect == "inertia" and any(joint == choice.joint for joint, _ in model.stroke_postures)


def _no_runs(dataset: Dataset) -> LogError:
    number = len(dataset.runs) or len(dataset.rejects)
    what = ("run{}, all held out" if dataset.runs else "stretch{} left out").format
    kept = f"{number} {what('' if number == 1 else 's' if dataset.runs else 'es')}"
    return LogError(
        "no-runs",
        f"there is no run to fit ({kept})",
        Where(file=dataset.files[0].name if dataset.files else None),
        "see why with: pumaid segment LOGS --rejects",
    )


def _joint_covariance(fitted: Fitted) -> Clustered:
    """Clustered by run; jacobian rows of one run together."""
    order = [np.flatnonzero(fitted.run_of == number) for number in range(int(fitted.run_of.max()) + 1)]
    solution, inverse = fitted.solution, fitted.solution.linear.inverse
    kin = np.repeat([row.joint for row in fitted.rows], [len(row.runs) for row in fitted.rows])
    jacobians, residuals = ([values[rows] for rows in order] for values in (solution.jacobian, solution.residual))
    found = clustered(jacobians, residuals, inverse, kin=kin)
    # What rests on the prior of a ratio or shape is as uncertain as the prior says: no run's residual shows that.
    p = len(solution.values)
    ratios, shapes = inverse[:, p:], inverse[:, :p] @ fitted.held.T
    added = (ratios * fitted.pull) @ ratios.T + shapes @ shapes.T
    return Clustered(found.covariance + added, found.freedoms)


def _with_shapes(found: Enlarged, choices: Sequence[EffectChoice]) -> tuple[EffectChoice, ...]:
    return tuple(replace(choice, shape=shape) for choice, shape in zip(choices, found.shapes, strict=True))


def _held(found: Enlarged, choices: Sequence[EffectChoice], values: Sequence[Value]) -> list[Value]:
    """Shapes without a derivative: given ones, and instants and whole numbers that were looked for."""
    model, out = found.fitted.model, []
    known = {value.name for value in values if value.state == IDENTIFIED}
    for place, (choice, one) in enumerate(zip(choices, model.effects, strict=True)):
        shows = any(column.name in known for column in model.columns if column.place == place)
        for column in _every_shape(one, model, place):
            name = column.shape or ""
            bare = Value(column.name, column.symbol, column.owner or None, column.unit)
            if name in choice.shape:
                out.append(replace(bare, value=choice.shape[name], state=GIVEN))
            elif name not in one.fitted and shows:
                ends = found.ranges.get((place, name))
                out.append(replace(bare, value=one.choice.shape[name], ci95=ends, state=IDENTIFIED))
            elif name not in one.fitted:
                why = f"no size of {one.effect.name} shows in these data"
                out.append(replace(bare, state=NOT_IDENTIFIABLE, reason=why))
    return out


def _profiles(found: Enlarged, sheet: Sheet) -> dict[int, tuple[float, float]]:
    """By column (from 0): intervals of effects whose shapes were fitted, along the likelihood, and of what moves along.

    Where the model's own likelihood is all that is known of a parameter's spread, clustered errors are; an interval
    reaches as much further.
    """
    model, out = found.fitted.model, {}
    inverse = np.diag(found.fitted.solution.linear.inverse)
    wide = np.array([interval(0.0, 1.0, freedom)[1] for freedom in sheet.freedoms])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(inverse > 0, wide * np.sqrt(np.diag(sheet.covariance) / inverse), 0.0)
    for place, one in enumerate(model.effects):
        columns = {n: column for n, column in enumerate(model.columns) if column.place == place}
        lost = found.gauge is not None and any(n in found.gauge.partners for n in columns)
        if found.without is None or lost or not one.fitted or one.held or not all(reach[n] > 0 for n in columns):
            continue
        linear = [n for n, column in columns.items() if column.shape is None]
        best = one.at(found.shapes[place])
        profile = Profile(found.without(place), best, model.robot, found.fitted.limit[linear])
        for n, column in columns.items():
            if column.shape is not None:
                error = float(np.sqrt(sheet.covariance[n, n]))
                out[n] = profile.shape(column.shape, error=error, reach=float(reach[n]))
        out |= _ends(linear, profile.linear(reach[linear]))
        names = profile.ground.fitted.model.names
        same = {model.names.index(name): n for n, name in enumerate(names) if name in model.names}
        before = profile.others(reach[[*same, *range(len(model.names), len(reach))]])
        moved = {n: tuple(before[k]) for n, k in same.items() if model.columns[n].owner == one.number}
        out |= {n: ends for n, ends in moved.items() if n not in out}
    return out


def _ends(columns: Sequence[int], ends: Floats) -> dict[int, tuple[float, float]]:
    return {n: (float(low), float(high)) for n, (low, high) in zip(columns, ends, strict=True)}


def _every_shape(one: Chosen, model: Model, place: int) -> list[Column]:
    every = replace(one, fitted=tuple(one.shapes(model.robot)))
    return [column for column in every.parts(model.robot, place) if column.shape is not None]


def _row_of(fitted: Fitted, joint: int) -> Row | None:
    return next((row for row in fitted.rows if row.joint == joint), None)


def _joint_fit(fitted: Fitted, runs: Sequence[Run], joint: int, *, repeated: Sequence[Pair]) -> JointFit:
    row = _row_of(fitted, joint)
    if row is None:
        return JointFit(joint, 0, 0, None, None, f"joint {joint} never moves alone in these logs")
    values = fitted.system.factors(fitted.gains)[joint - 1] * fitted.solution.values
    own = [run for run in runs if run.joint == joint]
    floor, why = noise_floor(repeated)
    kinds = {kind: sum(run.kind == kind for run in own) for kind in sorted({run.kind for run in own})}
    return JointFit(
        joint=joint,
        runs=len(own),
        samples=row.samples,
        rmse=float(np.sqrt(row.squares(values) / row.samples)),
        noise_floor=floor,
        noise_floor_reason=why,
        run_level=None if joint in fitted.weak else float(np.sqrt(fitted.levels[joint].level)),
        posture_groups=Facts.of(joint, runs).postures,
        kinds=kinds,
    )


def _with_errors(estimate: Estimate, robot: Robot, dataset: Dataset) -> Estimate:
    """With the error on runs that the plan keeps for judging, and on all runs of joints that have strokes.

    A fit's equations do not tell the latter: in them strokes are weighed by what a delay does to them.
    """
    weighed = {run.joint for run in dataset.runs if run.kind == STROKE and not run.heldout}
    runs = [run for run in dataset.runs if run.heldout or run.joint in weighed]
    if not runs:
        return estimate
    judge = Judge.of(robot, estimate, dataset)
    tallies = [judge.tally(block) for block in judge.blocks(runs)]
    kept = [tally for tally in tallies if tally.run.heldout]
    joints = []
    for fit in estimate.joints:
        own = [tally for tally in kept if tally.run.joint == fit.joint]
        fits = [tally for tally in tallies if tally.run.joint == fit.joint and not tally.run.heldout]
        of_fit = rmse(fits) if fit.joint in weighed else fit.rmse
        joints.append(replace(fit, rmse=of_fit, heldout_runs=len(own), heldout=rmse(own)))
    return replace(estimate, joints=tuple(joints), heldout=rmse(kept))
