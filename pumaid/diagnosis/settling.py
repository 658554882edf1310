"""What every arm draws while its speed settles after a ramp: left free, so that it is mistaken for nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from pumaid.effect_spec import EffectTerm
from pumaid.effects.base import NO_SHAPE, Effect, Family, Floats, Parameter
from pumaid.joint_bins import JointBins
from pumaid.preprocessing.options import CONSTANT
from pumaid.records import Samples
from pumaid.robot import Robot

#: s in which the transient of a position controller dies down; two of them span what servo drives do (bandwidths of 3
#: to 10 Hz).
TIMES = (0.025,)
#: Speeds beyond which the transients of single speeds are not told apart but scaled with speed.
MOST_SPEEDS = 6


class Settling(Effect):
    """s b exp(-t/T), t the time since the run began: one for each speed and each T of `TIMES`.

    Inertia makes it: at the end of a ramp the speed is off by a few tenths of a per cent, and to mend that in some tens
    of milliseconds draws more than friction does. It is no finding, since every arm has it.
    """

    title = "The current in which the speed settles"
    source = "S.-K. Lin, eq. (35): acceleration feedback within the load compensator"
    family = Family.START
    opposes_motion: ClassVar[bool] = False

    def __init__(self, speeds: Sequence[float]) -> None:
        self.speeds = np.asarray(speeds, dtype=float)

    @property
    def name(self) -> str:
        """No name of the catalogue."""
        return "settling"

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        groups = 2 if len(self.speeds) > MOST_SPEEDS else len(self.speeds)
        return tuple(Parameter(f"b{k}", "A", "at the start of a run", f"b{k}") for k in range(groups * len(TIMES)))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        v = np.abs(samples.velocity[:, samples.joint - 1])
        since = samples.travel / np.maximum(v, 1e-9)
        if len(self.speeds) > MOST_SPEEDS:
            groups = [np.ones(len(v)), v]
        else:
            nearest = np.abs(v[:, None] - self.speeds[None, :]).argmin(axis=1)
            groups = [(nearest == k).astype(float) for k in range(len(self.speeds))]
        return np.column_stack([samples.direction * group * np.exp(-since / T) for T in TIMES for group in groups])


def settling(every: Sequence[JointBins]) -> tuple[EffectTerm, ...]:
    """One for each joint that has runs at constant speed."""
    out = []
    for bins in every:
        steady = [abs(run.speed) for run in bins.runs if run.kind == CONSTANT]
        if len(steady) == len(bins.runs):
            out.append(EffectTerm(Settling(bins.speeds), bins.joint, NO_SHAPE))
    return tuple(out)
