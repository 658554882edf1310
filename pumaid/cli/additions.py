"""Fits and diagnoses of the command line, and adding what was found: the command for it, and ``--apply``."""

import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pumaid.cli.output import effect_files, notes, progress, remark, show
from pumaid.dataset import Dataset
from pumaid.diagnosis.records import ADD, DIAGNOSIS_NAME, Diagnosis, Finding, read_diagnosis
from pumaid.effect_spec import option_text, reopened
from pumaid.effects import catalogue
from pumaid.errors import ResultError
from pumaid.estimate import Estimate
from pumaid.experiment import Experiment, check_logs
from pumaid.reporting.diagnosis import left_out_sentence, step_sentence
from pumaid.reporting.table import Paragraph
from pumaid.results.history import keep
from pumaid.robot import Robot

#: Share by which an addition may raise the error of the fitted runs: by rounding; that of held-out runs not at all.
MAY_RISE = {"fitted": 0.01, "held-out": 0.0}
#: Effects that one call adds at most: more than arms have, so that it ends.
MOST_ADDED = 60


def identified(dataset: Dataset, robot: Robot, **choices: Any) -> Estimate:
    """A model of the runs, as `pumaid.identify` makes it, with progress."""
    from pumaid.estimation.estimate import identify

    with progress("identifying", total=robot.n_joints) as step:
        return identify(dataset, robot, progress=lambda joint, text: step(robot.n_joints - joint, text), **choices)


def diagnosed(
    model: Path, experiment: Experiment, suspects: Sequence[str], *, current: Path | None, is_quiet: bool
) -> Diagnosis:
    """The diagnosis of a model file, with what it finds added to the file `current` if there is one, and earlier ones.

    `suspects` are columns of the logs; the steps of the adding go to standard error where it `is_quiet`.
    """
    from pumaid.diagnosis.diagnose import diagnose

    estimate, robot = experiment.model(model), experiment.robot
    dataset = experiment.dataset(extra=suspects)
    check_logs(estimate, dataset, trust=experiment.trust)

    def again(model: Estimate) -> Diagnosis:
        with progress("diagnosing") as step:
            diagnosis = diagnose(model, dataset, robot, suspects=suspects, progress=lambda text: step(0.0, text))
        return with_commands(diagnosis, model, robot, experiment=experiment, effects=effect_files())

    diagnosis = again(estimate)
    if current is not None:
        diagnosis, estimate = added(
            diagnosis,
            estimate,
            dataset,
            robot=robot,
            model=current,
            again=again,
            tell=remark if is_quiet else lambda text: show(Paragraph(text)),
        )
    notes(dict.fromkeys((*dataset.notes, *diagnosis.notes)))
    return with_earlier(diagnosis, estimate, experiment.results_folder)


def with_commands(
    diagnosis: Diagnosis, estimate: Estimate, robot: Robot, *, experiment: Experiment, effects: Sequence[Path] = ()
) -> Diagnosis:
    """The diagnosis of `estimate` with commands that can be pasted.

    They repeat the words of `experiment` and the files of own `effects` that the user typed, and what the model has
    beyond the recipe.
    """
    from pumaid.diagnosis.diagnose import IDENTIFY

    words = ["pumaid", "identify", *typed_words(experiment, effects)]
    in_recipe = {(choice.effect, joint) for choice in robot.effects for joint in (choice.joint, None)}
    beyond = [x for x in reopened(estimate) if not {(x.effect, x.joint), (x.effect, None)} & in_recipe]
    words += [word for x in beyond for word in ("--add", option_text(x.effect, x.joint, x.shape, fixed=x.shape))]
    head = shlex.join(words)

    def pasted(items: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(item, command=item.command.replace(IDENTIFY, head, 1)) for item in items)

    return replace(
        diagnosis,
        joints=tuple(replace(joint, candidates=pasted(joint.candidates)) for joint in diagnosis.joints),
        findings=pasted(diagnosis.findings),
    )


def typed_words(experiment: Experiment, effects: Sequence[Path] = ()) -> list[str]:
    """The logs, and the options of the experiment and of own `effects`, as the user typed them."""
    recipes = [] if experiment.recipe is None else [experiment.recipe]
    named = {"--recipe": recipes, "--heldout": experiment.heldout, "--effects": effects}
    options = [word for option, values in named.items() for value in values for word in (option, str(value))]
    return [*experiment.logs, *options]


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

    Curves come last. An effect with which the refit misses the fitted runs, or those held out, by more than before is
    left out. Returned are the last diagnosis, in whose `applied` stands what was added, and the last estimate.

    Parameters
    ----------
    diagnosis, estimate, dataset
        What was found, on which model, in which runs.
    robot, model
        The arm, and the current model's file; every step is written there and kept beside it.
    again, tell
        Diagnoses a model; called with a sentence after each step.
    """
    keep(model, estimate)
    done, refused = list[Finding](), list[Finding]()

    def addable() -> list[Finding]:
        there = {(choice.effect, choice.joint) for choice in estimate.effects}
        new = [  # a suspected column is no effect of the catalogue
            item
            for item in diagnosis.findings
            if item.verdict == ADD
            and item.effect in catalogue()
            and (catalogue()[item.effect].is_repeatable or not {(x.effect, x.joint) for x in item.each()} & there)
            and not any(_is_same(item, other) for other in refused)
        ]
        # With what has a name in the model, a curve may have one, too.
        return ([item for item in new if not catalogue()[item.effect].is_free] or new)[: MOST_ADDED - len(done)]

    while new := addable():
        count = len(done)
        for finding in new:
            fresh = identified(dataset, robot, trust=True, effects=(*reopened(estimate), *finding.choices()))
            before, after = _errors(estimate, finding.joint), _errors(fresh, finding.joint)
            runs = next((runs for runs in before if after[runs] > (1.0 + MAY_RISE[runs]) * before[runs]), None)
            if runs is not None:
                tell(left_out_sentence(finding, runs=runs, before=before[runs], after=after[runs], robot=robot))
                refused.append(finding)
                continue
            keep(model, fresh)
            done.append(finding)
            tell(step_sentence(finding, estimate, fresh, robot=robot, number=len(done)))
            estimate = fresh
        if len(done) > count:
            diagnosis = again(estimate)
    return replace(diagnosis, applied=tuple(done)), estimate


def _errors(estimate: Estimate, joint: int | None) -> dict[str, float]:
    """RMSE (A) of the fitted runs of a joint, or of all, and of those held out.

    Another joint may be missed by more: what it lacks bends the links' weights, which this joint holds better now.
    """
    fitted, heldout = estimate.pooled("rmse"), estimate.heldout
    if joint is not None:
        fitted, heldout = estimate.joint(joint).rmse, estimate.joint(joint).heldout
    return {"fitted": fitted or 0.0} | ({} if heldout is None else {"held-out": heldout})


def _is_same(finding: Finding, other: Finding) -> bool:
    is_one = (finding.effect, finding.joint) == (other.effect, other.joint)
    shapes = catalogue()[other.effect].chosen(other.shape)
    return is_one and all(math.isclose(finding.shape[name], size, rel_tol=0.01) for name, size in shapes.items())


def with_earlier(diagnosis: Diagnosis, estimate: Estimate, results: Path) -> Diagnosis:
    """The diagnosis with what earlier ones (the last in the folder `results`) found and the model holds by now."""
    try:
        old = read_diagnosis(results / DIAGNOSIS_NAME)
    except ResultError:
        return diagnosis
    there = {(choice.effect, choice.joint) for choice in estimate.effects}
    applied = {
        (item.effect, item.joint, tuple(item.shape.items())): item
        for item in (*old.applied, *old.findings, *diagnosis.applied)
        if all((part.effect, part.joint) in there for part in item.each())
    }
    return replace(diagnosis, applied=tuple(applied.values()))
