"""Temperatures of a virtual robot's motors: of the first order, heated by the square of the current."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Floats = NDArray[np.float64]

#: degC of the room, in which every motor begins.
AMBIENT = 25.0
#: s in which a motor comes within 1/e of its last temperature.
TIME_CONSTANT = 600.0
#: degC above the room of a motor that draws its usual current for good.
RISE = 30.0
#: degC: resolution of the sensor.
STEP = 0.1


@dataclass(slots=True)
class Heat:
    """Motors at work: T' = (room + gain i^2 - T) / time constant.

    Attributes
    ----------
    usual
        (J,) A: current that warms the motor by `RISE`.
    temperature
        (J,) degC now.
    """

    usual: Floats
    temperature: Floats

    @classmethod
    def cold(cls, usual: Floats) -> Heat:
        """Motors as warm as the room."""
        return cls(usual, np.full(len(usual), AMBIENT))

    def warmed(self, current: Floats, step: float) -> Floats:
        """(N, J) degC while `current` (N, J) A flows, `step` s a sample; the motors stay as warm as at the end."""
        wanted = AMBIENT + RISE * (current / self.usual) ** 2
        share = -np.expm1(-step / TIME_CONSTANT)
        found, _ = lfilter([share], [1.0, share - 1.0], wanted, axis=0, zi=(1.0 - share) * self.temperature[None])
        self.temperature = found[-1]
        return np.asarray(found)


def curve(time: Floats) -> Floats:
    """(N,) degC of a motor that draws a third of its usual current all the time, where nobody keeps account."""
    return np.asarray(AMBIENT - RISE / 3.0 * np.expm1(-time / TIME_CONSTANT))
