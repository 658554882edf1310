"""Adding what a diagnosis found: the command that does it, and ``--apply``, which does it step by step."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pumaid.cli.progress import progress

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.diagnosis.records import Diagnosis, Finding
    from pumaid.estimate import Estimate
    from pumaid.robot import EffectChoice, Robot

#: Share by which an addition may raise the error of the fitted runs: by rounding, not more.
MAY_RISE = 0.01
#: Effects that one call adds at most: beyond that the catalogue is stretched over something that it does not have.
MOST_ADDED = 4


@dataclass(frozen=True, slots=True)
class Typed:
    """What the user typed that a command must repeat: logs, recipe, held-out runs, files of own effects."""

    logs: tuple[str, ...]
    recipe: Path | None = None
    heldout: tuple[str, ...] = ()
    effects: tuple[Path, ...] = ()

    def words(self) -> list[str]:
        """``pumaid identify`` with all of it, as a shell reads it."""
        words = ["pumaid", "identify", *self.logs]
        words += [] if self.recipe is None else ["--recipe", str(self.recipe)]
        for option, values in (("--heldout", self.heldout), ("--effects", self.effects)):
            words += [word for value in values for word in (option, str(value))]
        return [shlex.quote(word) for word in words]


def named(diagnosis: Diagnosis, estimate: Estimate, robot: Robot, *, typed: Typed) -> Diagnosis:
    """The diagnosis with commands that can be pasted.

    Parameters
    ----------
    diagnosis
        Of `estimate`.
    estimate, robot
        The model, whose effects a command must repeat where the recipe does not switch them on.
    typed
        What the user typed.
    """
    given = {(one.effect, one.joint) for one in robot.effects} | {(one.effect, None) for one in robot.effects}
    kept = [one for one in reopened(estimate) if not {(one.effect, one.joint), (one.effect, None)} & given]
    head = typed.words() + [word for one in kept for word in ("--add", spelled(one))]

    def command(found: Finding) -> str:
        return " ".join([*head, "--add", spelled(choice_of(found))]) if can_be_added(found) else ""

    joints = tuple(
        replace(joint, candidates=tuple(replace(one, command=command(one)) for one in joint.candidates))  # type: ignore[arg-type]
        for joint in diagnosis.joints
    )
    findings = tuple(replace(found, command=command(found)) for found in diagnosis.findings)
    return replace(diagnosis, joints=joints, findings=findings)


def spelled(choice: EffectChoice) -> str:
    """A choice as ``--add`` reads it: ``ripple@2:frequency=58.2``."""
    shape = ",".join(f"{name}={value:.8g}" for name, value in choice.shape.items())
    where = "" if choice.joint is None else f"@{choice.joint}"
    return choice.effect + where + (f":{shape}" if shape else "")


def can_be_added(found: Finding) -> bool:
    """Whether a model can hold it: a suspected column is no effect of the catalogue."""
    from pumaid.effects import catalogue

    return found.effect in catalogue()


def choice_of(found: Finding) -> EffectChoice:
    """A finding as an effect to be fitted: its shape is left open, but where the same effect may stand there twice."""
    from pumaid.effects import catalogue
    from pumaid.robot import EffectChoice

    shape = dict(found.shape) if catalogue()[found.effect].is_repeatable else {}
    return EffectChoice(found.effect, found.joint, shape)


def reopened(estimate: Estimate) -> tuple[EffectChoice, ...]:
    """The effects of a model as they were chosen: shapes that were fitted are open again."""
    from pumaid.effects import catalogue
    from pumaid.estimate import GIVEN

    given = {value.name for value in estimate.values if value.state == GIVEN}

    def is_kept(one: EffectChoice, shape: str) -> bool:
        where = "" if one.joint is None else f"j{one.joint}."
        return catalogue()[one.effect].is_repeatable or f"{one.effect}.{where}{shape}" in given

    return tuple(
        replace(one, shape={name: value for name, value in one.shape.items() if is_kept(one, name)})
        for one in estimate.effects
    )


def diagnosed(
    estimate: Estimate, dataset: Dataset, robot: Robot, *, suspects: Sequence[str], typed: Typed
) -> Diagnosis:
    """A diagnosis, with progress and commands."""
    from pumaid.diagnosis.diagnose import diagnose

    with progress("diagnosing") as step:
        found = diagnose(estimate, dataset, robot, suspects=suspects, progress=lambda text: step(0.0, text))
    return named(found, estimate, robot, typed=typed)


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
    robot
        The arm.
    model
        The current model's file; every step is written there and kept beside it.
    again
        Diagnoses a model.
    tell
        Called with a sentence after each step.

    Returns
    -------
    diagnosis, estimate
        The last ones; what was added stands in the diagnosis' `applied`.
    """
    from pumaid.diagnosis.records import ADD
    from pumaid.estimation.estimate import identify
    from pumaid.reporting.diagnosis_text import left_out_sentence, step_sentence
    from pumaid.results.history import keep

    keep(model, estimate, robot)
    done: list[Finding] = []
    while new := [found for found in diagnosis.findings if found.verdict == ADD and _is_new(found, estimate)]:
        for found in new[: MOST_ADDED - len(done)]:
            with progress("identifying", total=robot.n_joints) as step:
                fresh = identify(
                    dataset,
                    robot,
                    effects=(*reopened(estimate), choice_of(found)),
                    progress=lambda joint, text, step=step: step(robot.n_joints - joint, text),  # type: ignore[misc]
                )
            if _error(fresh) > (1.0 + MAY_RISE) * _error(estimate):
                tell(left_out_sentence(found, _error(estimate), _error(fresh), robot=robot))
                current = diagnosis if found is new[0] else again(estimate)
                return replace(current, applied=tuple(done)), estimate
            keep(model, fresh, robot)
            done.append(found)
            tell(step_sentence(found, estimate, fresh, robot=robot, number=len(done)))
            estimate = fresh
        diagnosis = again(estimate)
        if len(done) >= MOST_ADDED:
            break
    return replace(diagnosis, applied=tuple(done)), estimate


def _error(estimate: Estimate) -> float:
    """RMSE (A) of all fitted samples of the arm."""
    parts = [(one.samples, one.rmse) for one in estimate.joints if one.rmse is not None]
    total = sum(samples for samples, _ in parts)
    return (sum(samples * rmse**2 for samples, rmse in parts) / total) ** 0.5 if total else 0.0


def _is_new(found: Finding, estimate: Estimate) -> bool:
    """Whether the model can hold it besides what it holds."""
    from pumaid.effects import catalogue

    there = {(one.effect, one.joint) for one in estimate.effects}
    return can_be_added(found) and ((found.effect, found.joint) not in there or catalogue()[found.effect].is_repeatable)


def with_earlier(diagnosis: Diagnosis, estimate: Estimate, earlier: Path) -> Diagnosis:
    """The diagnosis with what earlier ones found and the model holds by now.

    Parameters
    ----------
    diagnosis, estimate
        Now.
    earlier
        The file of the last diagnosis, if there is one.
    """
    from pumaid.diagnosis.document import read_diagnosis
    from pumaid.errors import ResultError

    try:
        old = read_diagnosis(earlier)
    except ResultError:
        return diagnosis
    there = {(one.effect, one.joint) for one in estimate.effects}
    found = {
        (one.effect, one.joint, tuple(one.shape.items())): one
        for one in (*old.applied, *old.findings, *diagnosis.applied)
        if (one.effect, one.joint) in there
    }
    return replace(diagnosis, applied=tuple(found.values()))
