"""What a report is made from: the arm, its model, the logs, the comparison of the two, diagnosis and history."""

from dataclasses import dataclass

import numpy as np

from pumaid.dataset import BLOCK, Dataset
from pumaid.diagnosis.records import Diagnosis
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import Comparison, RunScore
from pumaid.reporting.formatting import in_unit
from pumaid.results.history import Ladder
from pumaid.robot import Robot

#: Held positions closer than this (rad or m) count as the same posture.
SAME_POSTURE = 0.03


@dataclass(frozen=True, eq=False, slots=True)
class ReportContext:
    """Inputs of figures and sections; `ladder`: the models of the experiment that can be compared with this one.

    `units` is ``"rad"`` or ``"deg"``, the unit of angles; `stale` are sentences on why the diagnosis may not apply to
    this model and these logs.
    """

    robot: Robot
    estimate: Estimate
    dataset: Dataset
    comparison: Comparison
    units: str = "rad"
    diagnosis: Diagnosis | None = None
    stale: tuple[str, ...] = ()
    ladder: Ladder | None = None

    def moving(self) -> list[int]:
        """Joints (from 1) that have runs."""
        return sorted({score.run.joint for score in self.comparison.runs})

    def unit(self, joint: int) -> tuple[float, str]:
        """Factor and name of the unit in which positions of a joint (SI) are shown: ``rad``, ``deg`` or ``m``."""
        return in_unit(self.robot.joint(joint).position_unit, self.units)

    def postures(self, joint: int) -> list[list[RunScore]]:
        """Runs of a joint by the positions of the other joints, the largest group first; blocks are one group."""
        groups: list[list[RunScore]] = []
        for score in self.comparison.of_joint(joint):
            posture = np.nan_to_num(score.run.posture)
            for group in groups:
                first = group[0].run
                near = np.all(np.abs(np.nan_to_num(first.posture) - posture) < SAME_POSTURE)
                if (score.run.kind == BLOCK) == (first.kind == BLOCK) and (near or first.kind == BLOCK):
                    group.append(score)
                    break
            else:
                groups.append([score])
        return sorted(groups, key=lambda group: -len(group))
