"""A model against measurement: on logs that it was fitted to, or on any others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset
from pumaid.diagnosis.residual_budget import budget
from pumaid.effect_spec import check_known
from pumaid.errors import Note
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import (
    NOTHING,
    TOGETHER,
    UNEXPLAINED,
    Budget,
    Comparison,
    Groups,
    JointScore,
    Judge,
    RunScore,
    Tally,
    rmse,
    together,
)
from pumaid.joint_bins import joint_bins
from pumaid.preprocessing.hold_out import held_out_otherwise
from pumaid.preprocessing.replicates import noise_floor, pairs
from pumaid.results.model_file import check_same_recipe
from pumaid.robot import Robot

Floats = NDArray[np.float64]


def compare(estimate: Estimate, dataset: Dataset, robot: Robot) -> Comparison:
    """Score a model on logs: per joint and per run, and apart from these what lies outside runs.

    A run's RMSE and bias are exact over its samples; predictions and their parts are given at its bins. Runs that the
    plan holds out are scored apart.

    Parameters
    ----------
    estimate
        The model.
    dataset
        Of any logs of the same arm.
    robot
        The arm, by the recipe that the model was made with.

    Returns
    -------
    comparison
        With a flag on each run of which the fitted data could not tell enough to predict it.

    Raises
    ------
    ModelError [model-other-recipe]
        The model was identified with another recipe.
    ModelError [unknown-effect]
        It holds an effect that the catalogue does not have.

    Source
    ------
    S.-K. Lin, section IV: the estimated against the measured current, and the standard deviation in Table I.
    """
    check_same_recipe(estimate, robot)
    check_known(estimate.effects)
    judge = Judge.of(robot, estimate, dataset)
    fitted_files = {facts.name for facts in dataset.files if facts.digest in set(estimate.logs.values())}
    is_fitted = [not run.heldout and run.origin in fitted_files for run in dataset.runs]
    judged: dict[int, tuple[Tally, Floats]] = {}
    for joint in sorted({run.joint for run in dataset.runs}):
        numbers = [n for n, run in enumerate(dataset.runs) if run.joint == joint]
        judged |= dict(zip(numbers, judge.judged([dataset.runs[n] for n in numbers]), strict=True))
    tallies = [judged[n][0] for n in range(len(dataset.runs))]
    means = {joint: _mean([t for t in tallies if t.run.joint == joint]) for joint in {t.run.joint for t in tallies}}
    groups = {joint: judge.groups(_counted(joint, tallies)) for joint in means}
    scores = [
        judge.score(tally, row, mean=means[tally.run.joint], groups=groups[tally.run.joint], is_fitted=is_fitted[n])
        for n, (tally, row) in sorted(judged.items())
    ]
    bare = tuple(_of_joint(joint.number, tallies, scores, groups=groups) for joint in robot.joints)
    joints = tuple(replace(score, budget=_budget(score, scores, robot, is_fitted=is_fitted)) for score in bare)
    counted = [tally for joint in robot.joints for tally in _counted(joint.number, tallies)]
    return Comparison(
        robot=robot.name,
        joints=joints,
        runs=tuple(scores),
        outside=judge.outside(dataset),
        rmse=rmse(counted),
        logs={facts.name: facts.digest for facts in dataset.files},
        notes=tuple(_notes(estimate, dataset, joints)),
        heldout=rmse([tally for tally in tallies if tally.run.heldout]),
        recipe_digest=robot.digest,
        version=estimate.version,
    )


def _mean(tallies: Sequence[Tally]) -> float:
    return sum(t.current_total for t in tallies) / sum(t.samples for t in tallies)


def _counted(joint: int, tallies: Sequence[Tally]) -> list[Tally]:
    """Runs of a joint behind its figures: those that are not held out, or all where all are."""
    moving = [tally for tally in tallies if tally.run.joint == joint]
    return [tally for tally in moving if not tally.run.heldout] or moving


def _of_joint(
    joint: int, tallies: Sequence[Tally], scores: Sequence[RunScore], *, groups: Mapping[int, Groups]
) -> JointScore:
    counted = _counted(joint, tallies)
    heldout = [tally for tally in tallies if tally.run.joint == joint and tally.run.heldout]
    if not counted:
        return JointScore(joint, 0, 0, None, None, None, None, f"joint {joint} never moves alone in these logs")
    samples, squares = sum(t.samples for t in counted), sum(t.squares for t in counted)
    current, mean = sum(t.current_squares for t in counted), _mean(counted)
    about = current - samples * mean**2
    floor, why = noise_floor(pairs([tally.run for tally in counted]))
    draws = current > NOTHING**2 * samples
    shares = {name: sum(t.products[name] for t in counted) / current for name in counted[0].products} if draws else {}
    shares = {name: share for name, share in together(shares, groups[joint]).items() if share != 0.0}
    return JointScore(
        joint=joint,
        runs=len(counted),
        samples=samples,
        rmse=float(np.sqrt(squares / samples)),
        bias=sum(t.total for t in counted) / samples,
        explained=1.0 - squares / about if about > NOTHING**2 * samples else None,
        noise_floor=floor,
        noise_floor_reason=why,
        rms=float(np.sqrt(current / samples)),
        shares=shares | {UNEXPLAINED: 1.0 - sum(shares.values())} if shares else {},
        heldout_runs=len(heldout),
        heldout=rmse(heldout),
        undetermined=sum(score.undetermined for score in scores if score.run.joint == joint),
    )


def _budget(score: JointScore, scores: Sequence[RunScore], robot: Robot, *, is_fitted: Sequence[bool]) -> Budget | None:
    """Where the error of a joint lives."""
    if score.rmse is None:
        return None
    pairs_of_joint = [pair for pair in zip(scores, is_fitted, strict=True) if pair[0].run.joint == score.joint]
    counted = [pair for pair in pairs_of_joint if not pair[0].run.heldout] or pairs_of_joint
    runs = [run_score for run_score, _ in counted]
    has_load = all(name == "gravity" or "gravity" not in name.split(TOGETHER) for run in runs for name in run.parts)
    loads = [run.parts.get("gravity", np.zeros(len(run.predicted))) for run in runs]
    return budget(
        joint_bins(robot, [run.run for run in runs], is_settled=False)[0],
        np.concatenate([run.residual for run in runs]),
        robot.joint(score.joint),
        load=np.concatenate(loads) if has_load else None,
        mean_square=score.rmse**2,
        floor=score.noise_floor,
        is_fitted=all(was_fitted for _, was_fitted in counted),
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
