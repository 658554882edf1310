"""A model against measurement: on logs that it was fitted to, or on any others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import Dataset
from pumaid.diagnosis.residual_budget import budget
from pumaid.effect_spec import check_known
from pumaid.errors import Note
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import (
    TOGETHER,
    Budget,
    Comparison,
    JointScore,
    RunScore,
    predictions,
    rmse,
)
from pumaid.joint_bins import joint_bins
from pumaid.preprocessing.hold_out import held_out_otherwise
from pumaid.results.model_file import check_same_recipe
from pumaid.robot import Robot


def compare(estimate: Estimate, dataset: Dataset, robot: Robot) -> Comparison:
    """Score a model on logs: per joint and per run.

    A run's RMSE and bias are exact over its samples; predictions and their parts are given at its bins. Runs that the
    plan holds out are scored apart; those that the fitted data could not tell enough of are flagged.

    Raises
    ------
    ModelError [model-other-recipe], [unknown-effect]
        The model was identified with another recipe, or holds an effect that the catalogue does not have.

    Source
    ------
    S.-K. Lin, section IV: the estimated against the measured current, and the standard deviation in Table I.
    """
    check_same_recipe(estimate, robot)
    check_known(estimate.effects)
    at_joints = predictions(estimate, dataset, robot)
    digests = set(estimate.logs.values())
    files = {facts.name for facts in dataset.files if facts.digest in digests}
    is_fitted = [not run.heldout and run.origin in files for run in dataset.runs]
    joints, scores = [], dict[int, RunScore]()
    for joint in robot.joints:
        numbers = [n for n, run in enumerate(dataset.runs) if run.joint == joint.number]
        if not numbers:
            why = f"joint {joint.number} never moves alone in these logs"
            joints.append(JointScore(joint.number, 0, 0, None, None, None, None, why))
            continue
        prediction, were_fitted = at_joints[joint.number], [is_fitted[n] for n in numbers]
        of_runs = list(prediction.run_scores(were_fitted))
        scores |= dict(zip(numbers, of_runs, strict=True))
        score = prediction.joint_score(of_runs)
        counted = [n for n, is_counted in enumerate(prediction.counted) if is_counted]
        split = _budget(score, [of_runs[n] for n in counted], robot, is_fitted=all(were_fitted[n] for n in counted))
        joints.append(replace(score, budget=split))
    return Comparison(
        robot=robot.name,
        joints=tuple(joints),
        runs=tuple(scores[n] for n in range(len(dataset.runs))),
        rmse=rmse((prediction, prediction.counted) for prediction in at_joints.values()),
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=tuple(_notes(estimate, dataset, joints)),
        heldout=rmse((prediction, prediction.heldout) for prediction in at_joints.values()),
        recipe_digest=robot.digest,
        version=estimate.version,
    )


def _budget(score: JointScore, runs: Sequence[RunScore], robot: Robot, *, is_fitted: bool) -> Budget:
    """The squared error of a joint in parts; `runs` are those behind its figures."""
    has_load = all(name == "gravity" or "gravity" not in name.split(TOGETHER) for run in runs for name in run.parts)
    loads = [run.parts.get("gravity", np.zeros(len(run.predicted))) for run in runs]
    return budget(
        joint_bins(robot, [run.run for run in runs], is_settled=False)[0],
        np.concatenate([run.residual for run in runs]),
        robot.joint(score.joint),
        load=np.concatenate(loads) if has_load else None,
        mean_square=(score.rmse or 0.0) ** 2,
        floor=score.noise_floor,
        is_fitted=is_fitted,
    )


def _notes(estimate: Estimate, dataset: Dataset, joints: Sequence[JointScore]) -> list[Note]:
    notes = [*dataset.notes, *held_out_otherwise(estimate, dataset)]
    digests = {facts.digest for facts in dataset.files}
    fitted = digests & set(estimate.logs.values())
    if digests and fitted == digests and not any(joint.heldout_runs for joint in joints):
        which = "the log was" if len(fitted) == 1 else f"all {len(fitted)} logs were"
        text = (
            f"{which} fitted, so the error is what is left after fitting;"
            " logs that the model never saw show what it predicts"
        )
        notes.append(Note("compared-with-fitted", text))
    lost = sum(joint.undetermined for joint in joints)
    if lost:
        which = "1 run needs" if lost == 1 else f"{lost} runs need"
        text = f"{which} something that the fitted logs did not determine, so its error says little of the model"
        notes.append(Note("prediction-undetermined", text))
    return notes
