"""A candidate looked at closely: its best shape, its chance, and what it does for runs that were left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pumaid.diagnosis.familywise import Familywise
from pumaid.diagnosis.folds import Falls, falls, groups_of
from pumaid.diagnosis.refine import at
from pumaid.diagnosis.scan import Projector, Trial, surprise
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, at_bins
from pumaid.records import Transfer

Floats = NDArray[np.float64]
Key = tuple[str, int | None]

#: Family-wise chance of a finding where nothing is missing: with the chance of a shape without a name, at most one
#: experiment in twenty is told that something is missing when nothing is.
LEVEL = 0.03
#: Chance beyond which a candidate is not worth leaving runs out for.
NEAR = 0.2
#: Standard errors by which held-out error must fall.
STEADY = 1.0
#: Share by which an effect must lower the RMSE of some joint to be worth a parameter: far below what a user would mind,
#: since fast waves well beyond chance may hide deep in slow noise.
WORTH = 0.0005
#: Difference of evidence beyond which one effect is decidedly better (odds of 150).
DECISIVE = 10.0
#: Share of the whitened square that no effect takes away but by rounding.
EXACT = 1e-9
#: Share of a rival's statistic that may be left once the chosen effect is in: above, it explains something else.
SAME = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Contender:
    """A candidate looked at closely.

    Attributes
    ----------
    trial
        At its best shape.
    shapes
        All that were tried.
    on
        The system that it was tried on.
    p_value
        Family-wise.
    evidence
        Twice the gain in log likelihood, less what its parameters would gain by chance.
    falls
        What leaving runs out says; None where chance alone could have made it.
    before, after
        (A) RMSE of the fitted samples by joint that it touches.
    transfer
        How much of it runs held out showed when it had been added; None before.
    """

    trial: Trial
    shapes: tuple[EffectTerm, ...]
    on: Fit
    p_value: float
    evidence: float
    falls: Falls | None
    before: dict[int, float]
    after: dict[int, float]
    transfer: Transfer | None = None

    @property
    def key(self) -> Key:
        """Effect and joint."""
        return self.trial.added.key

    @property
    def gain(self) -> float:
        """Largest share by which a joint's RMSE falls."""
        return max((1.0 - after / self.before[joint] for joint, after in self.after.items()), default=0.0)

    @property
    def fault(self) -> str | None:
        """Which gate it misses; None where it passes all."""
        if self.p_value > LEVEL or self.falls is None:
            return "chance"
        if self.falls.total <= 0.0 or self.falls.steadiness <= STEADY:
            return "heldout"
        if self.transfer is not None and self.transfer.is_denied:
            return "denied"
        return "worth" if self.gain < WORTH else None


def contender(on: Fit, grid: Trial, trial: Trial, *, shapes: Sequence[EffectTerm], family: Familywise) -> Contender:
    """Judge one candidate.

    Parameters
    ----------
    on
        The system that it is tried on.
    grid, trial
        Its best on the grid (what the flips were compared with), and refined.
    shapes
        Its grid.
    family
        Chances under the flips.
    """
    tried = (*shapes, trial.added)
    chance = family.p_value(trial.added.key, float(surprise(grid.statistic / on.scale, grid.width)))
    before, after = _errors(on, trial)
    joints = sorted(after)
    return Contender(
        trial=trial,
        shapes=tried,
        on=on,
        p_value=chance,
        evidence=evidence(on, trial),
        falls=falls(on, tried, groups_of(on, joints)) if chance <= NEAR else None,
        before=before,
        after=after,
    )


def evidence(on: Fit, trial: Trial) -> float:
    """Twice the gain in log likelihood less (parameters) x log(runs): effects between runs have only runs to go by.

    The variance is that which is left with the effect, so that large effects are told apart as well as small ones.

    Source
    ------
    G. Schwarz, Ann. Stat. 6 (1978) 461-464; the count of clusters for that of observations.
    """
    runs = [len(row.bins.runs) for row in on.joints]
    left = max(on.square - trial.statistic, EXACT * on.square, np.finfo(float).tiny)
    gain = max(on.size - on.rank, 1) * float(np.log(on.square / left)) if trial.statistic > 0.0 else 0.0
    return gain - trial.freedoms * float(np.log(max(sum(runs) / len(runs), 2.0)))


def _errors(on: Fit, trial: Trial) -> tuple[dict[int, float], dict[int, float]]:
    """RMSE (A) of samples by joint in which the effect acts, without and with it, all else refitted."""
    before, after = {}, {}
    for joint, left in misfit_with(on, trial).items():
        row = on.row(joint)
        before[joint] = rmse(row.bins.count, row.bins.inside, row.misfit)
        after[joint] = rmse(row.bins.count, row.bins.inside, left)
    return before, after


def misfit_with(on: Fit, trial: Trial) -> dict[int, Floats]:
    """Joint in which an effect acts -> (N,) A that is left with it, all else refitted."""
    plain = {row.bins.joint: trial.added.linear(on.model.robot, row.bins.samples) for row in on.joints}
    acting = {joint: C for joint, C in plain.items() if np.any(C)}
    cross = np.zeros((len(on.inverse), trial.width))
    for k, C in acting.items():
        cross[on.row(k).acting] += on.row(k).slim.T @ on.row(k).noise.whiten(on.row(k).bins, C)
    turned = on.inverse @ cross
    lost = {k: on.row(k).bare @ turned[on.row(k).acting] for k in acting}
    return {k: on.row(k).misfit - (C - lost[k]) @ trial.sizes for k, C in acting.items()}


def rmse(count: Floats, inside: Floats, misfit: Floats) -> float:
    """RMSE (A) of samples from bins."""
    return float(np.sqrt(count @ (misfit**2 + inside) / count.sum()))


def rivals(chosen: Contender, others: Sequence[Contender], after: Fit) -> tuple[Contender, ...]:
    """Those which these data cannot tell from `chosen`.

    A rival passes the family-wise test itself, has nothing left to explain once `chosen` is in, and is not decisively
    less likely.

    Parameters
    ----------
    chosen, others
        All judged on one system.
    after
        The system with `chosen` in it.
    """
    found = []
    for other in others:
        if other.key == chosen.key or other.p_value > LEVEL or other.falls is None or other.fault == "denied":
            continue
        added, bins = other.trial.added, after
        if added.effect.periodic is not None and added.joint is not None:  # coarse bins do not show it
            bins = at_bins(after, other.on.row(added.joint).bins)
        left = at(Projector(bins), added)
        if left is not None and left.statistic > SAME * other.trial.statistic:
            continue
        if chosen.evidence - other.evidence <= DECISIVE:
            found.append(other)
    return tuple(found)
