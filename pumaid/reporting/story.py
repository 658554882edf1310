"""All that a report tells of: the arm, its model, the logs and the comparison of the two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset
from pumaid.records import Comparison, Diagnosis, Estimate, RunScore
from pumaid.reporting.numbers import in_unit
from pumaid.results.history import Ladder
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Held positions closer than this (rad or m) are shown as one posture.
ALIKE = 0.03


@dataclass(frozen=True, eq=False, slots=True)
class Story:
    """What figures and sections are made from.

    Attributes
    ----------
    robot, estimate, dataset, comparison
        The arm, its model, the logs and how the model does on them.
    units
        ``"rad"`` or ``"deg"``: unit of angles in tables and figures.
    diagnosis
        What is missing from the model, where that was asked.
    stale
        Why the diagnosis may not be true of this model and these logs: sentences, none where it is.
    ladder
        The models of the experiment that can be compared with this one, where they were kept.
    """

    robot: Robot
    estimate: Estimate
    dataset: Dataset
    comparison: Comparison
    units: str = "rad"
    diagnosis: Diagnosis | None = None
    stale: tuple[str, ...] = ()
    ladder: Ladder | None = None

    def title(self, joint: int) -> str:
        """Number and name of joint `joint` (from 1)."""
        return joint_title(self.robot, joint)

    def moving(self) -> list[int]:
        """Joints (from 1) that have runs."""
        return sorted({score.run.joint for score in self.comparison.runs})

    def shown(self, joint: int, positions: Floats) -> Floats:
        """Positions or speeds of a joint (SI) in the unit of `position_unit`."""
        return positions * in_unit(self.robot.joint(joint).position_unit, self.units)[0]

    def position_unit(self, joint: int) -> str:
        """``rad``, ``deg`` or ``m``."""
        return self.units if self.robot.joint(joint).is_revolute else "m"

    def postures(self, joint: int) -> list[list[RunScore]]:
        """Runs of a joint by the posture in which it moved; the posture with most runs first."""
        return postures(self.comparison.of_joint(joint))


def joint_title(robot: Robot, joint: int) -> str:
    """Number and name of joint `joint` (from 1)."""
    name = robot.joint(joint).name
    return f"Joint {joint}" if name == f"joint{joint}" else f"Joint {joint} ({name})"


def postures(scores: Sequence[RunScore]) -> list[list[RunScore]]:
    """Runs of one joint in groups of like held positions; the largest group first, else in order of time."""
    groups: list[list[RunScore]] = []
    for score in scores:
        for group in groups:
            if np.all(np.abs(np.nan_to_num(group[0].run.posture - score.run.posture)) < ALIKE):
                group.append(score)
                break
        else:
            groups.append([score])
    return sorted(groups, key=lambda group: -len(group))
