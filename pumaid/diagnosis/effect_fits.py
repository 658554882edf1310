"""Fits of one model with any effects beside it, on the bins that show these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pumaid.dataset import FirstMotions, Run
from pumaid.diagnosis.candidates import settling
from pumaid.effect_spec import EffectTerm, marked
from pumaid.effects import Family, Scope
from pumaid.estimation.fit import Fit, FitRow, loaded, with_row
from pumaid.estimation.gls import fit_bins, refit, with_settled_loads
from pumaid.estimation.noise import NoiseModel, noise_of
from pumaid.joint_bins import COARSE, FINE, JointBins, joint_bins
from pumaid.model import Model

#: Phase (rad) of a wave over a bin beyond which the mean over the bin blunts it.
FASTEST = 1.0


class EffectFits:
    """Fits of `model` with effects to fitted `runs`; `unseen` are runs that only judge, `begun` is that of all runs.

    `bins` are the coarse and the finest bins of each joint. The last fit is kept, and where the next one starts.
    """

    def __init__(self, model: Model, runs: Sequence[Run], unseen: Sequence[Run], *, begun: FirstMotions | None) -> None:
        joints, sizes = range(1, model.robot.n_joints + 1), (COARSE, FINE)
        self.model = model
        self.bins, self._unseen = (
            [joint_bins(model.robot, part, most=n, begun=begun, finest=joints if n == FINE else ()) for n in sizes]
            for part in (runs, unseen)
        )
        self._first, self._settling = fit_bins(model, self.bins[0]), settling(self.bins[0])
        self._latest: tuple[list[EffectTerm], Fit] | None = None
        self._like: Fit | None = None

    def unseen_with(self, added: Sequence[EffectTerm]) -> tuple[JointBins, ...]:
        """Bins of runs that are not fitted: the finest of joints that have a periodic effect, else coarse ones."""
        return _chosen(self._unseen, added)

    def solved(
        self,
        added: Sequence[EffectTerm],
        noises: Mapping[int, NoiseModel] | None = None,
        *,
        beside: Sequence[EffectTerm] = (),
    ) -> Fit:
        """The model with `added`, on the finest bins of joints that have a periodic effect, else on coarse ones.

        Weighted by `noises` by joint, else by the noise that is left with `added`; bins are those of `beside`, too.
        """
        if noises is None and self._latest is not None and self._latest[0] == list(added):
            return self._latest[1]
        fitted = self._unsized(added, noises, beside)
        if noises is None or added:
            sized = [
                term.searched(self.model.robot).at({}, fitted.sizes(place).tolist())
                for place, term in enumerate(fitted.model.effects)
            ]
            fitted = refit(fitted, self.model.with_effects(sized), noise=noises or _noises(fitted))
            # A tilt gives a load to joints that had none, by ratios that nothing else shows.
            if any((term.effect.family, term.effect.scope) == (Family.GRAVITY, Scope.ARM) for term in added):
                fitted = with_settled_loads(fitted)
        fitted = loaded(fitted)
        if noises is None:
            self._latest = (list(added), fitted)
        return fitted

    def noises_with(self, added: Sequence[EffectTerm]) -> dict[int, NoiseModel]:
        """By joint, the noise that is left with `added`."""
        return _noises(self._unsized(added))

    def where_it_shows(self, solved: Fit, term: EffectTerm) -> Fit:
        """A fit with the finest bins of the joint of a fast wave, the noise there beside this; else as it is."""
        bins = next((fine for coarse, fine in zip(*self.bins, strict=True) if _is_fast(term, coarse)), None)
        return solved if bins is None else with_noise_beside(solved, _finely(solved, bins), term)

    def _unsized(
        self,
        added: Sequence[EffectTerm],
        noises: Mapping[int, NoiseModel] | None = None,
        beside: Sequence[EffectTerm] = (),
    ) -> Fit:
        """A fit without derivatives by shapes, weighted, where no noise is given, by what the base model leaves."""
        model, bins = self.model.with_effects(marked([*self._settling, *added])), _chosen(self.bins, [*added, *beside])
        terms, latest = self._latest or ([], self._first)
        # A payload shows ratios of gains, by which a fit that has none starts astray.
        is_start = any(term.is_carried for term in terms) and terms == list(added)[: len(terms)]
        like = latest if noises else self._like
        fitted = refit(latest if is_start else self._first, model, bins=bins, noise=noises, like=like)
        if noises is None:
            self._like = fitted
        return fitted


@lru_cache(maxsize=8)  # the same for all waves of a joint
def _finely(solved: Fit, bins: JointBins) -> FitRow:
    return solved.at(bins)


def with_noise_beside(solved: Fit, row: FitRow, term: EffectTerm) -> Fit:
    """A fit with this row of a joint, the noise there what is left beside an effect: what it explains is none."""
    columns = term.linear(solved.model.robot, row.bins.samples)
    remaining = row.misfit - columns @ np.linalg.lstsq(columns, row.misfit, rcond=None)[0]
    return with_row(solved, replace(row, noise=noise_of(row.bins, remaining)))


def _noises(fitted: Fit) -> dict[int, NoiseModel]:
    return {row.joint: noise_of(row.bins, fitted.misfit(row.bins, row.design)) for row in fitted.rows}


def _chosen(bins: Sequence[Sequence[JointBins]], added: Sequence[EffectTerm]) -> tuple[JointBins, ...]:
    """Of coarse and finest bins the finest of joints that have an effect which coarse ones blunt, else coarse ones."""
    return tuple(b if any(_is_fast(term, a) for term in added) else a for a, b in zip(*bins, strict=True))


def _is_fast(term: EffectTerm, bins: JointBins) -> bool:
    if term.effect.periodic is None or term.joint != bins.joint:
        return False
    return bins.way * term.shape[term.effect.periodic] > FASTEST
