"""What runs that are left out of a fit, or were never in it, say of a candidate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pumaid.diagnosis.records import ADD, DENIED, DOUBTFUL, Finding, Transfer
from pumaid.effect_spec import EffectTerm
from pumaid.estimation.fit import Fit, Projector, elsewhere, with_loads
from pumaid.joint_bins import JointBins
from pumaid.maths import Floats, inverse_root, pseudo_inverse

#: Share of a parameter's information that runs must keep for it to be fitted to them. Most of a joint's runs that
#: leave together: with all runs of one direction gone, the others could not even tell friction from weight.
KEPT, MOST_LEAVING = 0.01, 1.0 / 3.0
#: Standard errors by which the error of runs left out must fall, on average.
STEADY = 1.0


@dataclass(frozen=True, eq=False, slots=True)
class FoldLosses:
    """What leaving runs out says of one effect: (F,) `falls` of the held-out whitened square, one a fold.

    `before` and `after` are the RMSE (A) of the runs left out, without and with the effect.
    """

    falls: Floats
    before: float
    after: float

    @property
    def predicts(self) -> bool:
        """Whether the error falls, steadily: by more than `STEADY` of its own standard errors; and so does the RMSE."""
        error = float(self.falls.std(ddof=1)) / np.sqrt(len(self.falls)) if len(self.falls) > 1 else 0.0
        return bool(error > 0.0 and self.falls.mean() > STEADY * error and self.after < self.before)


def without_strongest(losses: FoldLosses, folds: Sequence[tuple[int, tuple[int, ...]]]) -> FoldLosses:
    """Without the joint whose runs show an effect most: of what the whole arm feels, none stands for all."""
    joints = np.array([joint for joint, _ in folds])
    strongest = max(joints.tolist(), key=lambda joint: float(losses.falls[joints == joint].sum()))
    return replace(losses, falls=losses.falls[joints != strongest])


def replicate_folds(solved: Fit, joints: Sequence[int]) -> list[tuple[int, tuple[int, ...]]]:
    """Joints (from 1) and motions of each that leave together: repeated ones, or each alone if too many would."""
    folds = []
    for bins in (solved.by_bin[joint].bins for joint in joints):
        numbers = np.unique(bins.motions).tolist()
        alone = [(number,) for number in numbers]
        groups = [g for g in bins.groups if g[0] in numbers] + [g for g in alone if g[0] >= len(bins.runs)]
        is_too_many = max(map(len, groups)) > MOST_LEAVING * len(numbers)
        folds += [(bins.joint, group) for group in (alone if is_too_many else groups)]
    return folds


def leave_out(
    solved: Fit,
    shapes: Sequence[EffectTerm],
    folds: Sequence[tuple[int, tuple[int, ...]]],
    *,
    prior: Floats | None = None,
) -> FoldLosses:
    """Leave each fold out, choose one of the effect's shapes and fit without it, and see what it then predicts.

    Everything is done on Gram matrices of the whole less those of the fold. `prior` (m,) is added to the information of
    the effect's parameters.

    Source
    ------
    M. Stone, J. R. Stat. Soc. B 36 (1974) 111-147, with clusters left out whole.
    """
    projector = Projector(solved)
    plain = projector.columns(shapes)
    white = projector.whitened(plain)
    whole_cross, whole = projector.crossed(white), solved.information() + np.diag(solved.prior**2)
    gram = np.sum([columns.T @ columns for columns in white.values()], axis=0)
    slope = np.sum([columns.T @ solved.by_bin[joint].residual for joint, columns in white.items()], axis=0)
    alone = np.diagonal(gram) - np.sum(whole_cross * (solved.inverse @ whole_cross), axis=0)
    unit = np.divide(1.0, np.sqrt(np.maximum(alone, 0.0)), out=np.zeros_like(alone), where=alone > 0.0)
    half = solved.solution.linear.half
    places, falls, squares = np.arange(len(slope)).reshape(len(shapes), -1), [], np.zeros(3)
    units = unit[places][:, :, None] * np.eye(places.shape[1])
    firm = np.zeros((places.shape[1],) * 2) if prior is None else np.diag(prior)
    if prior is not None:
        units = inverse_root(gram - whole_cross.T @ (solved.inverse @ whole_cross) + firm)[None]
    remaining = {row.bins.joint: row.bins.inside_left(row.bins.current - row.misfit) for row in solved.joints}
    for joint, motions in folds:
        row = solved.by_bin[joint]
        bins = np.isin(row.bins.motions, motions)
        J, r, weight = row.jacobian[bins], row.residual[bins], row.bins.count[bins]
        C = white[joint][bins] if joint in white else np.zeros((len(r), len(slope)))
        cross, inverse = whole_cross - J.T @ C, _inverse(whole - J.T @ J, half)
        move = -inverse @ (J.T @ r)
        turned = inverse @ cross
        score = slope - C.T @ r - cross.T @ move
        alone = (gram - C.T @ C - cross.T @ turned)[places[:, :, None], places[:, None, :]]
        fitted = np.einsum("kvw,kw->kv", _inverse(alone + firm, units), score[places])
        best = int(np.argmax(np.sum(score[places] * fitted, axis=1)))
        place, sizes = places[best], fitted[best]
        error, bare = r - J @ move, row.bare[bins]
        after = error - (C - J @ turned)[:, place] @ sizes
        raw = row.misfit[bins] - bare @ move
        drawn = plain[joint][bins][:, place] if joint in plain else 0.0
        raw_after = raw - (drawn - bare @ turned[:, place]) @ sizes
        inside = weight @ remaining[joint][bins]
        falls.append(float(error @ error - after @ after))
        squares += (weight @ raw**2 + inside, weight @ raw_after**2 + inside, weight.sum())
    return FoldLosses(np.array(falls), *np.sqrt(squares[:2] / squares[2]).tolist())


def refit_losses(without: Fit, within: Fit, folds: Sequence[tuple[int, tuple[int, ...]]]) -> FoldLosses:
    """The same of what `within` has and `without` lacks, each linear at its own values; both have the same noise."""
    losses = np.array([[_loss(solved, *fold) for solved in (without, within)] for fold in folds])
    rmse = np.sqrt(losses[:, :, 1].sum(axis=0) / losses[:, :, 2].sum(axis=0))
    return FoldLosses(losses[:, 0, 0] - losses[:, 1, 0], *rmse.tolist())


def _loss(solved: Fit, joint: int, motions: tuple[int, ...]) -> tuple[float, float, float]:
    """Whitened square of runs left out of a fit, their sum of squares (A2), and the number of their samples."""
    row = solved.by_bin[joint]
    bins = np.isin(row.bins.motions, motions)
    J, r, weight = row.jacobian[bins], row.residual[bins], row.bins.count[bins]
    information = solved.information() + np.diag(solved.prior**2) - J.T @ J
    move = -_inverse(information, solved.solution.linear.half) @ (J.T @ r)
    error, raw = r - J @ move, row.misfit[bins] - row.bare[bins] @ move
    inside = row.bins.inside_left(row.bins.current - row.misfit)[bins]
    return float(error @ error), float(weight @ (raw**2 + inside)), float(weight.sum())


def _inverse(information: Floats, half: Floats) -> Floats:
    """Inverse (..., P, P) of what training runs tell, in directions of which they keep `KEPT` of the whole information.

    What only the fold could tell stays at the fit of all: friction guessed at a speed never run is wrong by more than
    any effect. `half` is a root of the inverse of the whole.
    """
    values, vectors = np.linalg.eigh(np.swapaxes(half, -1, -2) @ information @ half)
    weight = np.where(values > KEPT, 1.0 / np.sqrt(np.maximum(values, KEPT)), 0.0)
    turned = half @ (vectors * weight[..., None, :])
    return np.asarray(turned @ np.swapaxes(turned, -1, -2))


#: Standard deviations of what the effect adds to runs held out below which these say nothing of it.
LEAST = 2.0


def confirmed_share(last: Fit, added: EffectTerm, heldout: Sequence[JointBins]) -> Transfer | None:
    """The share of an effect's current that runs held out show; None where they could not show it.

    What the whole model leaves of these runs is projected on what the effect adds there, by generalised least squares
    with the covariance of their noise and of all fitted parameters but the effect's own; the error of these is told as
    an error of the share. `added` is one of the effects of `last`, `heldout` are runs that were not fitted.

    Source
    ------
    A. C. Atkinson, Biometrika 56 (1969) 33-41: a variable of the model's own prediction as a test of it.
    """
    place = [(effect.key, effect.shape) for effect in last.model.effects].index((added.key, added.shape))
    is_effect = np.isin(np.arange(len(last.inverse)), last.columns_of(place))
    held, sums = np.zeros_like(last.inverse), np.zeros((2, len(is_effect)))
    drawn2, shared = 0.0, 0.0
    for row in (elsewhere(last, bins) for bins in heldout if bins.joint in last.by_bin):
        drawn = row.noise.whiten(row.bins, last.linear(added, row.bins.samples) @ last.sizes(place))
        held += row.jacobian.T @ row.jacobian
        sums += np.vstack([drawn, row.residual]) @ row.jacobian
        drawn2, shared = drawn2 + float(drawn @ drawn), shared + float(drawn @ row.residual)
    training = (last.information() + held)[np.ix_(~is_effect, ~is_effect)]
    turned = np.zeros_like(sums)
    turned[:, ~is_effect] = sums[:, ~is_effect] @ pseudo_inverse(training)[0]
    square = drawn2 - float(sums[0] @ turned[0])
    if square <= LEAST**2 * last.scale:
        return None
    weighed = (drawn2 - 2.0 * float(turned[0] @ sums[0]) + float(turned[0] @ held @ turned[0])) / square**2
    along = (sums[0] - held @ turned[0]) / square
    error = float(np.sqrt(last.scale * (weighed + along @ last.inverse @ along)))
    # Parameters are wrong by chance, too, and with them what these runs lose: as much as that is no loss.
    chance = float(np.sqrt(last.scale * (drawn2 + sums[0] @ last.inverse @ sums[0])))
    lost = -(drawn2 + 2.0 * (shared + DENIED * chance)) / last.scale
    return Transfer(1.0 + (shared - float(sums[0] @ turned[1])) / square, error, lost)


def rmse_of(fit: Fit, heldout: Sequence[JointBins]) -> tuple[float, float | None]:
    """RMSE (A) of runs that were not fitted, and its standard error as runs differ from each other; None of one run."""
    parts = list[Floats]()
    for bins in heldout:
        factors = np.nan_to_num(fit.model.factors(fit.scales(), bins.joint))
        columns = fit.model.at_nodes(bins, with_loads(fit, bins, at_nodes=True).loads)
        drawn, waves = (columns @ (factors * fit.values * part) for part in (1.0, fit.model.is_wave))
        misfit = bins.current - bins.averaged(drawn)
        square = misfit**2 + bins.inside_left(bins.current - misfit, bins.variance(drawn, waves))
        parts.append(np.column_stack([bins.sums(bins.count * square), bins.sums(bins.count)]))
    squares, counts = np.vstack(parts).T
    rmse, runs = float(np.sqrt(squares.sum() / counts.sum())), len(counts)
    spread = float(np.linalg.norm(squares - rmse**2 * counts) / counts.sum() / np.sqrt(1.0 - 1.0 / max(runs, 2)))
    return rmse, spread / max(2.0 * rmse, np.finfo(float).tiny) if runs > 1 else None


def forecast(finding: Finding, before: Fit, after: Fit | None, *, unseen: Sequence[JointBins]) -> Finding:
    """A finding with the error of runs that were not fitted, without and with it; doubtful where that does not fall."""
    if after is None:
        return replace(finding, verdict=DOUBTFUL, reason="a fit with it goes astray")
    without, (rmse, error) = rmse_of(before, unseen)[0], rmse_of(after, unseen)
    if rmse >= without and finding.verdict == ADD:
        finding = replace(finding, verdict=DOUBTFUL, reason="it does not lower the error of runs that were held out")
    return replace(finding, rmse_heldout_before=without, rmse_heldout_after=rmse, forecast=rmse, forecast_error=error)
