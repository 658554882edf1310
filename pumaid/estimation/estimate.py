"""Identification: runs, and effects beyond the paper's model, to every parameter with its honest uncertainty."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pumaid import __version__
from pumaid.dataset import Dataset, Run, first_motions
from pumaid.effect_spec import expanded
from pumaid.errors import LogError, Where
from pumaid.estimate import GIVEN, IDENTIFIED, NOT_IDENTIFIABLE, Estimate, JointFit, Value
from pumaid.estimation import warnings
from pumaid.estimation.evaluate import JointPrediction, predictions, rmse
from pumaid.estimation.gls import Progress, interval
from pumaid.estimation.identifiability import Coverage, FittedParameters, outer_postures, reason
from pumaid.estimation.nonlinear import EffectFit, Ends, ShapeLikelihood, fit_effects
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot


def identify(
    dataset: Dataset,
    robot: Robot,
    *,
    effects: Sequence[EffectChoice] | None = None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Estimate:
    """Every parameter of the minimal model and of the effects, identified or not, with errors clustered by run.

    Rows are solved from the last joint to the first; then, unless `recursive`, all rows are refined together. Held-out
    runs are left out. `effects` are physics beyond the paper's model, the recipe's where not given; shapes that a
    choice leaves open are fitted. `progress` is called with the joint at work (0: all) and a word on what is done.

    Raises LogError (no-runs) where there is no run to fit, and ModelError (unknown-effect, effect-joint, effect-shape,
    effect-twice) where an effect cannot be in the model.

    Source: S.-K. Lin, "Identification of a Class of Nonlinear Deterministic Systems with Application to Manipulators".
    """
    choices = expanded(robot.effects if effects is None else effects, robot)
    runs = tuple(run for run in dataset.runs if not run.heldout)
    if not runs:
        number = len(dataset.runs) or len(dataset.rejects)
        what = f"{number} runs, all held out" if dataset.runs else f"{number} stretches left out"
        where = Where(file=dataset.files[0].name if dataset.files else None)
        mend = "see why with: pumaid segment LOGS --rejects"
        raise LogError("no-runs", f"there is no run to fit ({what})", where, mend)
    model, begun = Model.of_runs(robot, runs), first_motions(dataset.runs)
    # The rigid body has an inertia of each joint already.
    choices = tuple(choice for choice in choices if not (model.is_dynamic and choice.effect == "inertia"))
    result = fit_effects(model, runs, choices, begun=begun, recursive=recursive, progress=progress)
    coverage = {joint.number: [run for run in runs if run.joint == joint.number] for joint in robot.joints}
    estimate = _estimate(result, choices, coverage, recursive=recursive)
    at_joints = predictions(estimate, dataset, robot)
    joints = [_joint_fit(result, joint, covered, at_joints.get(joint)) for joint, covered in coverage.items()]
    estimate = replace(
        estimate,
        joints=tuple(joints),
        logs={facts.name: facts.digest for facts in dataset.files},
        heldout=rmse((prediction, prediction.heldout) for prediction in at_joints.values()),
    )
    repeated = {joint: prediction.repeated for joint, prediction in at_joints.items()}
    notes = warnings.notes_on(result, estimate, robot=robot, repeated=repeated)
    return replace(estimate, notes=(*dataset.notes, *notes))


def _estimate(result: EffectFit, choices: Sequence[EffectChoice], coverage: Coverage, *, recursive: bool) -> Estimate:
    """What a fit says of the arm's parameters; joints' figures are left out."""
    fitted, model = result.fit, result.fit.model
    assert fitted.first is not None
    of_recursion = FittedParameters.of(fitted.first, coverage)
    parameters = of_recursion if recursive else FittedParameters.of(fitted, coverage)
    parameters = replace(parameters, profiles=_profiles(result, parameters))
    values = parameters.values()
    is_shape = np.array([column.shape is not None for column in model.columns], dtype=bool)
    return Estimate(
        robot=model.robot.name,
        joints=(),
        values=(*values, *_shapes(result, choices, values)),
        names=model.names,
        solution=np.where(is_shape, 0.0, fitted.values),
        covariance=parameters.covariance[: len(is_shape), : len(is_shape)],
        scales=fitted.scales(),
        blind=parameters.reach()[: len(is_shape)],
        effects=tuple(replace(choice, shape=shape) for choice, shape in zip(choices, result.shapes, strict=True)),
        combinations=parameters.combinations(values),
        recursive=of_recursion.values(),
        method="recursive" if recursive else "joint",
        recipe_digest=model.robot.digest,
        geometry=model.robot.geometry,
        origin=model.robot.origin,
        version=__version__,
    )


def _shapes(result: EffectFit, choices: Sequence[EffectChoice], values: Sequence[Value]) -> list[Value]:
    """Shapes without a derivative: given ones, and instants and whole numbers that were searched for."""
    model, out = result.fit.model, []
    identified = {value.name for value in values if value.state == IDENTIFIED}
    for place, (choice, term) in enumerate(zip(choices, model.effects, strict=True)):
        shows = any(column.name in identified for column in model.columns if column.place == place)
        for column in replace(term, fitted=tuple(term.shape)).parts(model.robot, place):
            name = column.shape
            bare = Value(column.name, column.symbol, column.owner or None, column.unit)
            if name is None or (name in term.fitted and name not in choice.shape):
                continue
            if name in choice.shape:
                out.append(replace(bare, value=choice.shape[name], state=GIVEN))
            elif shows:
                out.append(replace(bare, value=term.shape[name], ci95=result.ranges.get((place, name))))
            else:
                why = reason("no size", effect=term.effect.name)
                out.append(replace(bare, state=NOT_IDENTIFIABLE, **why))
    return out


def _profiles(result: EffectFit, parameters: FittedParameters) -> dict[int, Ends]:
    """By column (from 0): profile-likelihood intervals of effects whose shapes were fitted, and of what moves along.

    Where the model's own likelihood is all that is known of a parameter's spread, clustered errors are; an interval
    reaches as much further.
    """
    model, out = result.fit.model, dict[int, Ends]()
    inverse = np.diag(result.fit.inverse)
    wide = np.array([interval(0.0, 1.0, dof)[1] for dof in parameters.freedoms])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(inverse > 0, wide * np.sqrt(np.diag(parameters.covariance) / inverse), 0.0)
    for place, term in enumerate(model.effects):
        columns = {n: column for n, column in enumerate(model.columns) if column.place == place}
        lost = any(n in parameters.confounded for n in columns)
        if lost or not term.fitted or term.held or not all(reach[n] > 0 for n in columns):
            continue
        linear = [n for n, column in columns.items() if column.shape is None]
        best = term.at(result.shapes[place])
        profile = ShapeLikelihood(result.without(place), best, result.fit.limit[linear])
        for n, column in columns.items():
            if column.shape is not None:
                error = float(np.sqrt(parameters.covariance[n, n]))
                out[n] = profile.interval(column.shape, error=error, reach=float(reach[n]))
        out |= dict(zip(linear, map(tuple, profile.linear(reach[linear]).tolist()), strict=True))
        names = profile.projector.solved.model.names
        same = {model.names.index(name): n for n, name in enumerate(names) if name in model.names}
        before = profile.others(reach[[*same, *range(len(model.names), len(reach))]])
        moved = {n: tuple(before[k]) for n, k in same.items() if model.columns[n].owner == term.number}
        out = moved | out
    return out


def _joint_fit(result: EffectFit, joint: int, covered: Sequence[Run], prediction: JointPrediction | None) -> JointFit:
    """How well one joint is fitted; `prediction` is the model at all of its runs, None where there are none."""
    why = f"joint {joint} never moves alone in these logs"
    nothing = {"joint": joint, "runs": 0, "samples": 0, "rmse": None, "noise_floor": None, "noise_floor_reason": why}
    figures, fitted = {} if prediction is None else prediction.figures(), result.fit
    if prediction is None or not covered:
        return JointFit(**figures | nothing)
    return JointFit(
        **figures,
        run_level=None if joint in fitted.weak else float(fitted.noises[joint].level[0]),
        posture_groups=outer_postures(covered),
        kinds=dict(sorted(Counter(run.kind for run in prediction.bins.runs if not run.heldout).items())),
    )
