"""The error ladder of an experiment: every model that was kept, what was added to it, and the error after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pumaid.errors import Note
from pumaid.records.estimate import JointFit
from pumaid.robot import EffectChoice


@dataclass(frozen=True, slots=True)
class Errors:
    """RMSE (A) of the runs that were fitted and of those held out, and the noise floor (A); None where not known."""

    fitted: float | None
    heldout: float | None
    noise_floor: float | None


@dataclass(frozen=True, slots=True)
class Rung:
    """One model.

    Attributes
    ----------
    number
        From 1, in the order in which models were kept.
    file, digest
        Its file's name, and the SHA-256 of what it says.
    parent
        Number of the model that it was made from; None for the first, or where that one is gone.
    effects
        All physics beyond the paper's model in it.
    added, removed
        What it has more and less than its parent; of the first, all that is in it.
    joints
        How well each joint is fitted.
    whole
        The same for the whole arm, joints weighed by their fitted samples; known where it is of every fitted joint.
    is_current
        Whether it is the model that other commands use now.
    """

    number: int
    file: str
    digest: str
    parent: int | None
    effects: tuple[EffectChoice, ...]
    added: tuple[EffectChoice, ...]
    removed: tuple[EffectChoice, ...]
    joints: tuple[JointFit, ...]
    whole: Errors
    is_current: bool = False


@dataclass(frozen=True, slots=True)
class Ladder:
    """Models whose errors can be compared: of one arm, one set of logs and the same fitted runs of them.

    Attributes
    ----------
    robot
        The arm's name.
    recipe
        SHA-256 of the recipe with which its last model was made.
    logs
        Name -> SHA-256 of the logs that were fitted.
    rungs
        In the order of their numbers.
    apart
        Why it is no part of the ladder that holds the current model, in words; empty for that one.
    """

    robot: str
    recipe: str
    logs: Mapping[str, str]
    rungs: tuple[Rung, ...]
    apart: str = ""

    @property
    def path(self) -> tuple[Rung, ...]:
        """From the first model to the current one (to the last, where none is current), each from the one before."""
        known = {rung.number: rung for rung in self.rungs}
        at: Rung | None = next((rung for rung in self.rungs if rung.is_current), self.rungs[-1])
        found: list[Rung] = []
        while at is not None and at not in found:
            found.append(at)
            at = known.get(at.parent or 0)
        return tuple(reversed(found))


@dataclass(frozen=True, slots=True)
class History:
    """All models that an experiment's folder keeps.

    Attributes
    ----------
    folder
        Where they are.
    ladders
        At least one; the one that holds the current model first.
    current
        Number of the current model; None where it is not among them.
    notes
        Files that could not be used, and what is odd.
    """

    folder: str
    ladders: tuple[Ladder, ...]
    current: int | None = None
    notes: tuple[Note, ...] = ()
