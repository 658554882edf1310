"""Adding what a diagnosis found: the command that does it, and ``--apply``, which does it step by step."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from pumaid.cli.output import progress
from pumaid.dataset import Dataset
from pumaid.diagnosis.records import ADD, Diagnosis, Finding, read_diagnosis
from pumaid.effect_spec import option_text
from pumaid.effects import catalogue
from pumaid.errors import ResultError
from pumaid.estimate import GIVEN, Estimate
from pumaid.estimation.estimate import identify
from pumaid.reporting.text import left_out_sentence, step_sentence
from pumaid.results.history import keep
from pumaid.robot import EffectChoice, Robot

#: Share by which an addition may raise the error of the fitted runs: by rounding, not more.
MAY_RISE = 0.01
#: Effects that one call adds at most: beyond that the catalogue is stretched over something that it does not have.
MOST_ADDED = 4


def identify_command(
    logs: Sequence[str], *, recipe: Path | None, heldout: Sequence[str], effects: Sequence[Path]
) -> str:
    """``pumaid identify`` with what the user typed: logs, recipe, held-out runs and files of own effects."""
    words = ["pumaid", "identify", *logs]
    words += [] if recipe is None else ["--recipe", str(recipe)]
    for option, values in (("--heldout", heldout), ("--effects", effects)):
        words += [word for value in values for word in (option, str(value))]
    return shlex.join(words)


def with_commands(diagnosis: Diagnosis, estimate: Estimate, robot: Robot, *, identify_again: str) -> Diagnosis:
    """The diagnosis with commands that can be pasted.

    Parameters
    ----------
    diagnosis
        Of `estimate`.
    estimate, robot
        The model, whose effects a command must repeat where the recipe does not switch them on.
    identify_again
        As `identify_command` gives it.
    """
    from pumaid.diagnosis.diagnose import IDENTIFY

    in_recipe = {(choice.effect, choice.joint) for choice in robot.effects}
    in_recipe |= {(name, None) for name, _ in in_recipe}
    head = identify_again
    for choice in reopened(estimate):
        if not {(choice.effect, choice.joint), (choice.effect, None)} & in_recipe:
            head += f" --add {option_text(choice.effect, choice.joint, choice.shape, fixed=choice.shape)}"
    joints = []
    for joint in diagnosis.joints:
        candidates = [replace(item, command=item.command.replace(IDENTIFY, head, 1)) for item in joint.candidates]
        joints.append(replace(joint, candidates=tuple(candidates)))
    findings = [replace(item, command=item.command.replace(IDENTIFY, head, 1)) for item in diagnosis.findings]
    return replace(diagnosis, joints=tuple(joints), findings=tuple(findings))


def choice_of(finding: Finding) -> EffectChoice:
    """A finding as an effect to be fitted: its shape is left open, but where the same effect may stand there twice."""
    shape = dict(finding.shape) if catalogue()[finding.effect].is_repeatable else {}
    return EffectChoice(finding.effect, finding.joint, shape)


def reopened(estimate: Estimate) -> tuple[EffectChoice, ...]:
    """The effects of a model as they were chosen: shapes that were fitted are open again."""
    given = {value.name for value in estimate.values if value.state == GIVEN}
    out = []
    for choice in estimate.effects:
        prefix = f"{choice.effect}." if choice.joint is None else f"{choice.effect}.j{choice.joint}."
        is_whole = catalogue()[choice.effect].is_repeatable
        shape = {name: value for name, value in choice.shape.items() if is_whole or prefix + name in given}
        out.append(replace(choice, shape=shape))
    return tuple(out)


def diagnosed(
    estimate: Estimate, dataset: Dataset, robot: Robot, *, suspects: Sequence[str], identify_again: str
) -> Diagnosis:
    """A diagnosis, with progress and commands."""
    from pumaid.diagnosis.diagnose import diagnose

    with progress("diagnosing") as step:
        diagnosis = diagnose(estimate, dataset, robot, suspects=suspects, progress=lambda text: step(0.0, text))
    return with_commands(diagnosis, estimate, robot, identify_again=identify_again)


def added(
    diagnosis: Diagnosis,
    estimate: Estimate,
    dataset: Dataset,
    *,
    robot: Robot,
    model: Path,
    again: Callable[[Estimate], Diagnosis],
    tell: Callable[[str], None],
) -> tuple[Diagnosis, Estimate]:
    """Add what was found, one effect at a time, and diagnose anew, until nothing is left that can be added.

    An effect with which the refit misses the fitted runs by more than before is left out, and the adding ends.

    Parameters
    ----------
    diagnosis, estimate, dataset
        What was found, on which model, in which runs.
    robot, model
        The arm, and the current model's file; every step is written there and kept beside it.
    again, tell
        Diagnoses a model; called with a sentence after each step.

    Returns
    -------
    diagnosis, estimate
        The last ones; what was added stands in the diagnosis' `applied`.
    """
    keep(model, estimate, robot)
    done: list[Finding] = []
    while new := [item for item in diagnosis.findings if item.verdict == ADD and _is_new(item, estimate)]:
        for finding in new[: MOST_ADDED - len(done)]:
            fresh = _refitted(dataset, robot, (*reopened(estimate), choice_of(finding)))
            if _error(fresh) > (1.0 + MAY_RISE) * _error(estimate):
                tell(left_out_sentence(finding, _error(estimate), _error(fresh), robot=robot))
                current = diagnosis if finding is new[0] else again(estimate)
                return replace(current, applied=tuple(done)), estimate
            keep(model, fresh, robot)
            done.append(finding)
            tell(step_sentence(finding, estimate, fresh, robot=robot, number=len(done)))
            estimate = fresh
        diagnosis = again(estimate)
        if len(done) >= MOST_ADDED:
            break
    return replace(diagnosis, applied=tuple(done)), estimate


def _refitted(dataset: Dataset, robot: Robot, effects: Sequence[EffectChoice]) -> Estimate:
    """A fit with these effects, with progress."""
    with progress("identifying", total=robot.n_joints) as step:
        return identify(
            dataset, robot, effects=effects, progress=lambda joint, text: step(robot.n_joints - joint, text)
        )


def _error(estimate: Estimate) -> float:
    """RMSE (A) of all fitted samples of the arm."""
    parts = [(joint.samples, joint.rmse) for joint in estimate.joints if joint.rmse is not None]
    total = sum(samples for samples, _ in parts)
    return (sum(samples * rmse**2 for samples, rmse in parts) / total) ** 0.5 if total else 0.0


def _is_new(finding: Finding, estimate: Estimate) -> bool:
    """Whether the model can hold it besides what it holds; a suspected column is no effect of the catalogue."""
    effect = catalogue().get(finding.effect)
    there = {(choice.effect, choice.joint) for choice in estimate.effects}
    return effect is not None and (effect.is_repeatable or (finding.effect, finding.joint) not in there)


def with_earlier(diagnosis: Diagnosis, estimate: Estimate, earlier: Path) -> Diagnosis:
    """The diagnosis with what earlier ones (the last in the file `earlier`) found and the model holds by now."""
    try:
        old = read_diagnosis(earlier)
    except ResultError:
        return diagnosis
    there = {(choice.effect, choice.joint) for choice in estimate.effects}
    applied = {
        (item.effect, item.joint, tuple(item.shape.items())): item
        for item in (*old.applied, *old.findings, *diagnosis.applied)
        if (item.effect, item.joint) in there
    }
    return replace(diagnosis, applied=tuple(applied.values()))
