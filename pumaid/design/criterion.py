"""What makes one experiment better than another: the standard errors that it promises, as one number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Names that a user gives, and the power with which large errors count: none is the geometric mean.
POWERS = {"geometric": 0.0, "worst": 12.0}
#: Scaled information below this is rounding.
RIDGE = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Criterion:
    """Smaller is better: the logarithm of a mean of standard errors, itself a mean over assumed robots.

    Attributes
    ----------
    power
        0: the geometric mean of the errors; large: nearly the worst of them, each as a share of its `size`.
    size
        (p,) what is usual of each parameter, in the unit of the information's.
    counted
        (p,) which parameters count; all where not given.

    Notes
    -----
    Both are convex in the information, so that an optimum is one and can be told by its slopes: J. Kiefer and
    J. Wolfowitz, Canadian J. Mathematics 12 (1960) 363-366, in the general form of F. Pukelsheim, Optimal Design of
    Experiments, ch. 7.
    """

    power: float
    size: Floats
    counted: NDArray[np.bool_] | None = None

    def value(self, information: Floats) -> Floats:
        """(...) for information (..., G, p, p) on G robots."""
        logs = self._counted(self._logs(self._inverse(information)))
        if self.power == 0.0:
            return np.asarray(logs.mean(axis=(-1, -2)))
        top = logs.max(axis=-1)
        spread = np.mean(np.exp(self.power * (logs - top[..., None])), axis=-1)
        return np.asarray((top + np.log(spread) / self.power).mean(axis=-1))

    def pull(self, information: Floats) -> Floats:
        """(G, p, p) by which information is worth having: the value falls by half of the sum of its product with more.

        Averaged over robots, so that the pull on what there is sums to one.
        """
        inverse = self._inverse(information)
        logs = self._logs(inverse)
        # What does not count may be dark without end: it is kept from overflowing before it is left out.
        share = np.exp(self.power * np.minimum(logs - self._counted(logs).max(axis=-1, keepdims=True), 0.0))
        share *= 1.0 if self.counted is None else self.counted
        share /= share.sum(axis=-1, keepdims=True)
        weight = share / np.einsum("gpp->gp", inverse)
        return np.asarray(inverse @ (weight[..., None] * inverse)) / len(information)

    def errors(self, information: Floats) -> Floats:
        """(G, p) standard errors."""
        return np.asarray(np.exp(self._logs(self._inverse(information))) * self.size)

    def _counted(self, logs: Floats) -> Floats:
        return logs if self.counted is None else logs[..., self.counted]

    def _logs(self, inverse: Floats) -> Floats:
        return np.asarray(0.5 * np.log(np.einsum("...pp->...p", inverse)) - np.log(self.size))

    @staticmethod
    def _inverse(information: Floats) -> Floats:
        width = information.shape[-1]
        scale = np.sqrt(np.einsum("...pp->...p", information))
        scale = np.where(scale > 0, scale, 1.0)
        scaled = information / (scale[..., :, None] * scale[..., None, :]) + RIDGE * np.eye(width)
        return np.asarray(np.linalg.inv(scaled) / (scale[..., :, None] * scale[..., None, :]))
