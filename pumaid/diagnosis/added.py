"""An effect that is tried, or was found, beside the model: at a joint or in the whole arm, with its shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.effects import Effect, Scope
from pumaid.model import Model
from pumaid.records import Samples

Floats = NDArray[np.float64]

#: Relative step of a shape's numerical derivative.
NUDGE = 1e-3


@dataclass(frozen=True, slots=True)
class Added:
    """An effect in the model: at a joint (from 1; None: the whole arm), with its shape."""

    effect: Effect
    joint: int | None
    shape: Mapping[str, float]

    @property
    def key(self) -> tuple[str, int | None]:
        """Effect's name and joint."""
        return self.effect.name, self.joint

    def columns(self, model: Model, samples: Samples) -> Floats:
        """(M, p) of its parameters in the joint that `samples` are of; zero where it does not act."""
        if self.effect.scope is Scope.JOINT and self.joint != samples.joint:
            return np.zeros((len(samples), len(self.effect.parameters(model.robot, self.joint or 0))))
        found = self.effect.columns(model.robot, samples, number=self.joint or 0, shape=self.shape)
        return np.nan_to_num(found)

    def tangent(self, model: Model, samples: Samples, values: Floats) -> Floats:
        """(M, s) derivative of its current by each searched shape, its parameters being `values`."""
        out = []
        for shape in self.effect.shapes(model.robot, self.joint or 0):
            if not shape.is_searched or shape.name not in self.shape:
                continue
            at = self.shape[shape.name]
            step = NUDGE * (abs(at) or 1.0)
            ends = [replace(self, shape={**self.shape, shape.name: at + sign * step}) for sign in (1.0, -1.0)]
            rise = ends[0].columns(model, samples) - ends[1].columns(model, samples)
            out.append(rise @ values / (2.0 * step))
        return np.column_stack(out) if out else np.zeros((len(samples), 0))


def columns_each(shapes: Sequence[Added], model: Model, samples: Samples) -> Floats:
    """(M, k p) of one effect with each of k shapes, side by side; what they share is computed once.

    Parameters
    ----------
    shapes
        At least one, all of one effect and joint.
    model, samples
        As for `Added.columns`.
    """
    one = shapes[0]
    if len(shapes) == 1 or (one.effect.scope is Scope.JOINT and one.joint != samples.joint):
        return np.column_stack([each.columns(model, samples) for each in shapes])
    wanted = [each.shape for each in shapes]
    found = one.effect.columns_each(model.robot, samples, number=one.joint or 0, shapes=wanted)
    return np.nan_to_num(np.column_stack(found))
