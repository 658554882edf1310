"""The residual budget: how much of what a model leaves at a joint is noise, and on what the rest depends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.diagnosis.budget_terms import CAUSES, POINTS_TO, RIPPLE, TERMS, BudgetTerm, BudgetVariables, fitted_columns
from pumaid.diagnosis.periodogram import Spectrum, spectrum
from pumaid.estimation.evaluate import Budget, BudgetPart
from pumaid.estimation.noise import noise_of
from pumaid.joint_bins import JointBins
from pumaid.preprocessing.replicates import noise_floor, pairs
from pumaid.robot import Joint

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]
Key = tuple[str, str]

#: A: an RMSE below this is rounding.
ROUNDING = 1e-7
#: Chance that anything at a joint is called more than noise where all is noise.
FALSE_ALARM = 0.05
#: Sign flips, always the same ones.
FLIPS, SEED = 399, 20
#: Most dependences taken out of one joint.
MOST_TAKEN = 16
#: Share of the mean square that a dependence must take, and that a ripple must: ripples come in numbers.
LEAST, LEAST_RIPPLE = 0.02, 0.004
#: Ripples not worth a part after which no further one is looked for: the surest need not be the largest.
MOST_SMALL = 6
#: Fewest runs whose flipped signs can show anything at `FALSE_ALARM`.
FEWEST_RUNS = 6
#: Bins of a run in which all but ripples are looked for: the first ones, where a start shows, and groups of the rest.
FIRST, GROUPS = 16, 48
#: Directions of which less than this share is left beside what was taken out are not looked at; nor are columns that
#: one run fills to `ALONE`: they say nothing of other runs.
LEAST_LEFT, ALONE = 1e-3, 0.9
#: Most of a run's noise that the fit may have taken away before the correction for it stops growing.
MOST_LEVERAGE = 0.8
#: Waves over the longest run from which a wave is a ripple, and the degree of each run's polynomial taken out before.
FEWEST_WAVES, SMOOTH = 5.0, 8

REPEAT = ("unassigned", "")


def _coarse_starts(bins: JointBins) -> Labels:
    """First bins of the groups in which all but ripples are looked for."""
    pieces = []
    for start, length in zip(bins.first, bins.lengths, strict=True):
        inner = np.arange(length)
        if length > FIRST + GROUPS:
            inner = np.append(np.arange(FIRST), np.linspace(FIRST, length, GROUPS + 1).astype(np.int64)[:-1])
        pieces.append(start + inner)
    return np.concatenate(pieces)


def budget(
    bins: JointBins,
    residual: Floats,
    joint: Joint,
    *,
    load: Floats | None = None,
    mean_square: float | None = None,
    floor: float | None = None,
    is_fitted: bool = True,
) -> Budget:
    """Split the mean square of what a model leaves at one joint into parts that add up to it.

    Dependences on position, direction, posture, speed, load, time, temperature and the start of a run, and ripples, are
    taken out one after the other, the largest first, as long as flipped signs of whole runs seldom give as much
    anywhere. What each takes, less what noise brings into its directions, is its part. What repeats between replicates
    and is none of these is unassigned. The rest is noise. Without replicates, what differs from run to run is
    unassigned too, since it may be either.

    Parameters
    ----------
    bins
        The runs of the joint, in as many bins as they have.
    residual
        (N,) A, measured less predicted, at these bins.
    joint
        Whose runs they are.
    load
        (N,) A that gravity draws by the model; that of the bins where they know it.
    mean_square
        A2 of samples, where it is known better than from the bins.
    floor
        A: the noise floor by replicates, where it is known already.
    is_fitted
        Whether the model was fitted to these very runs, so that friction is already at its best.

    Source
    ------
    R. A. Fisher, The Design of Experiments, for the test by flipped signs; P. H. Westfall and S. S. Young,
    Resampling-Based Multiple Testing (1993), for many tests at once.
    """
    if load is None and bins.samples.loads is not None:
        load = bins.samples.loads.moving
    at = BudgetVariables.of(bins, load, is_revolute=joint.is_revolute)
    floor = noise_floor(pairs(bins.runs))[0] if floor is None else floor
    samples, square = float(bins.count.sum()), float(bins.count @ residual**2)
    inside = _inside(bins, residual) if mean_square is None else max(mean_square * samples - square, 0.0)
    total = (square + inside) / samples if mean_square is None else mean_square
    search = _TermSearch(bins, at, residual, inside, is_fitted=is_fitted)
    if total > ROUNDING**2:
        search.run()
    return Budget(
        mean_square=total,
        parts=search.parts(joint, total),
        runs=len(bins.runs),
        replicates=sum(len(group) for group in bins.groups if len(group) > 1),
        floor=None if floor is None else floor**2,
        limits=tuple(_limits(bins, at, has_load=load is not None)),
    )


def _inside(bins: JointBins, residual: Floats) -> float:
    """A2 times samples: what the residual varies inside bins, the prediction's slope across a bin taken out."""
    predicted, total = bins.current - residual, 0.0
    for rows in np.split(np.arange(len(residual)), bins.first[1:]):
        within = np.zeros(len(rows))
        if len(rows) > 1:
            slope, rest = np.gradient(predicted[rows]), np.gradient(residual[rows])
            within = (slope**2 + 2.0 * slope * rest) * (1.0 - 1.0 / bins.count[rows] ** 2) / 12.0
        total += max(float(bins.count[rows] @ (bins.inside[rows] - within)), 0.0)
    return total


@dataclass(frozen=True, eq=False, slots=True)
class Dependence:
    """What is tried, or was taken out.

    Attributes
    ----------
    key
        Part and variable.
    rarity, flipped
        How rare it is alone, and each of its flips (B,).
    basis
        (n, k) directions, orthonormal under the weights: at coarse bins while tried, at all bins once taken out.
    square, noise, within
        A2 times samples: the residual along it, noise along it, and what it varies inside bins.
    frequency
        rad of phase per rad or m; 0 of what is no ripple.
    chance
        Of as much anywhere at the joint by noise.
    """

    key: Key
    rarity: float
    flipped: Floats
    basis: Floats
    square: float = 0.0
    noise: float = 0.0
    within: float = 0.0
    frequency: float = 0.0
    chance: float = 1.0


class _TermSearch:
    """The residual of one joint while it is taken apart."""

    def __init__(
        self, bins: JointBins, at: BudgetVariables, residual: Floats, inside: float, *, is_fitted: bool
    ) -> None:
        self.bins, self.at, self.residual, self.inside = bins, at, residual.copy(), inside
        self.whole = self._square(residual) + inside
        self.starts = _coarse_starts(bins)
        self.coarse = at.coarse(self.starts)
        self.taken: list[Dependence] = []
        self.chance: dict[Key, float] = {}
        self.open: dict[Key, BudgetTerm] = {}
        for term in TERMS:
            columns = term.columns(self.coarse)
            if np.isfinite(columns).all() and columns.any():
                self.open[term.part, term.against] = term
        self.small: list[float] = []
        self.basis, self.basis_coarse = np.zeros((len(bins), 0)), np.zeros((len(self.starts), 0))
        if is_fitted:
            self.basis = _orthonormal(fitted_columns(at), at, self.basis)
            self.basis_coarse = _orthonormal(fitted_columns(self.coarse), self.coarse, self.basis_coarse)
        self.groups = [group for group in bins.groups if len(group) > 1]

    def run(self) -> None:
        """Take the residual apart until nothing in it is more than noise."""
        rng = np.random.default_rng(SEED)
        signs = rng.choice([-1.0, 1.0], (FLIPS, len(self.bins.runs)))
        for _ in range(MOST_TAKEN + MOST_SMALL):
            best = self._largest(self._tried(signs))
            if best is None:
                return
            self._take(best)

    def _tried(self, signs: Floats) -> list[Dependence]:
        """Every dependence that is still open, with what flipped signs make of it."""
        out: list[Dependence] = []
        if len(self.bins.runs) >= FEWEST_RUNS:
            rest = np.add.reduceat(self.at.weight * self.residual, self.starts) / self.coarse.weight
            tried = [self._term(term, rest, signs) for term in self.open.values()]
            out = [item for item in tried if item is not None]
            if self.groups:
                out.append(self._repeat(signs))
        return [*out, *self._ripple(signs)]

    def _term(self, term: BudgetTerm, rest: Floats, signs: Floats) -> Dependence | None:
        """A term of which something is left beside what was taken out."""
        at, first = self.coarse, np.searchsorted(self.coarse.run, np.arange(len(self.bins.runs)))
        columns = term.columns(at)
        by_run = np.add.reduceat(at.weight[:, None] * columns**2, first, axis=0)
        columns = columns[:, by_run.max(axis=0) <= ALONE * by_run.sum(axis=0)]
        basis = _orthonormal(columns, at, self.basis_coarse)
        if not basis.shape[1]:
            return None
        weighted = at.weight[:, None] * basis
        scores = np.add.reduceat(weighted * rest[:, None], first, axis=0)
        fills = np.add.reduceat(weighted * basis, first, axis=0)
        crossed = np.add.reduceat(weighted[:, :, None] * self.basis_coarse[:, None, :], first, axis=0)
        lost = np.divide(np.sum(crossed**2, axis=2), fills, out=np.zeros_like(fills), where=fills > 1e-12)
        corrected = scores / np.sqrt(1.0 - np.clip(lost, 0.0, MOST_LEVERAGE))
        square, flipped = float(np.sum(scores.sum(axis=0) ** 2)), np.sum((signs @ corrected) ** 2, axis=1)
        return Dependence((term.part, term.against), *_rarity(square, flipped), basis, square, float(flipped.mean()))

    def _ripple(self, signs: Floats) -> Sequence[Dependence]:
        """The strongest ripple that is not taken out yet."""
        if len(self.small) > MOST_SMALL:
            return []
        rough = self._rough()
        alone = replace(self.bins, groups=tuple((k,) for k in range(len(self.bins.runs))))
        noise = noise_of(alone, rough)
        done = [*self.small, *(item.frequency for item in self.taken if item.frequency)]
        white = noise.whiten(self.bins, rough)
        waves = spectrum(self.bins, noise, white, without=done, fewest_periods=FEWEST_WAVES)
        if waves is None:
            return []
        height = waves.statistic()
        frequency = self._refined(rough, float(waves.frequency[int(np.argmax(height))]), waves)
        basis = self._waves(frequency)[0]
        square = float(np.sum((basis.T @ (self.at.weight * rough)) ** 2))
        rarity = _rarity(float(height.max()), waves.highest(signs))
        return [Dependence(RIPPLE, *rarity, basis, square, self._noise(basis), 0.0, frequency)]

    def _repeat(self, signs: Floats) -> Dependence:
        """What replicates leave alike."""
        first, second = np.array(self.bins.pairs).T
        products = np.array([self._product(pair) for pair in self.bins.pairs])
        flipped = (signs[:, first] * signs[:, second]) @ products
        chances = special.ndtr(-np.append(products.sum(), flipped) / (float(flipped.std()) or 1.0))
        return Dependence(REPEAT, float(chances[0]), chances[1:], np.zeros((0, 0)))

    def _product(self, pair: tuple[int, int]) -> float:
        first, second = self.bins.side_by_side(self.residual, pair)
        samples = self.bins.sums(self.bins.count)[list(pair)].mean()
        return float(samples * np.mean(first * second)) if len(first) else 0.0

    def _largest(self, tried: Sequence[Dependence]) -> Dependence | None:
        """What takes out most of what is more than noise, directions counted against it; chances are noted."""
        if not tried:
            return None
        smallest = np.min([item.flipped for item in tried], axis=0)
        chances = [float((1 + np.count_nonzero(smallest <= item.rarity)) / (1 + len(smallest))) for item in tried]
        done = {item.key for item in self.taken}
        self.chance |= {item.key: p for item, p in zip(tried, chances, strict=True) if item.key not in done}
        surest = [replace(item, chance=p) for item, p in zip(tried, chances, strict=True) if p <= FALSE_ALARM]
        cost = np.log(len(self.bins.runs))
        candidates = [item for item in surest if item.key != REPEAT]
        return max(candidates, key=lambda item: item.square - cost * item.noise, default=None)

    def _take(self, item: Dependence) -> None:
        """Take a dependence out if it is worth a part, and look at it no more; at ripples until several were not."""
        is_ripple, within = item.key == RIPPLE, 0.0
        if is_ripple:
            basis, waves = self._waves(item.frequency)
            within = self._within_bins(basis, waves)
        else:
            basis = _orthonormal(self.open.pop(item.key).columns(self.at), self.at, self.basis)
        along = basis.T @ (self.at.weight * self.residual)
        rest, fall = self.residual - basis @ along, float(along @ along)
        if fall - self._noise(basis, rest) < (LEAST_RIPPLE if is_ripple else LEAST) * self.whole:
            self.small += [item.frequency] if is_ripple else []
            return
        self.residual = rest
        self.taken.append(replace(item, basis=basis, square=fall, within=within))
        if not is_ripple:
            self.basis = np.hstack([self.basis, basis])
            self.basis_coarse = np.hstack([self.basis_coarse, item.basis])

    def _waves(self, frequency: float) -> tuple[Floats, Floats]:
        """(N, k) orthonormal means over bins of the waves of the position in each direction; (3 N, 4) at the nodes."""
        nodes, _ = self.bins.nodes
        angle = frequency * nodes.position[:, self.bins.joint - 1]
        waves = np.column_stack([np.cos(angle), np.sin(angle)])
        both = np.hstack([waves * (nodes.direction > 0)[:, None], waves * (nodes.direction < 0)[:, None]])
        return _orthonormal(self.bins.averaged(both), self.at, np.zeros((len(self.bins), 0))), both

    def _within_bins(self, basis: Floats, waves: Floats) -> float:
        """What the fitted ripple varies inside bins (A2 times samples)."""
        means, root = self.bins.averaged(waves), np.sqrt(self.at.weight)
        fitted = basis @ (basis.T @ (self.at.weight * self.residual))
        size = np.linalg.lstsq(means * root[:, None], fitted * root, rcond=1e-9)[0]
        return float(self.at.weight @ self.bins.variance(waves @ size))

    def _refined(self, rough: Floats, frequency: float, waves: Spectrum) -> float:
        """The frequency near `frequency` of which the residual holds most."""
        place, weighted = self.bins.samples.position[:, self.bins.joint - 1], rough * self.at.weight
        sides = (self.at.direction > 0, self.at.direction < 0)
        reach = float(waves.frequency[1] - waves.frequency[0])
        for _ in range(2):
            tried = frequency + reach * np.linspace(-1.0, 1.0, 25)
            turned = np.exp(-1j * np.outer(tried, place))
            power = sum(np.abs(turned[:, side] @ weighted[side]) ** 2 for side in sides)
            frequency, reach = float(tried[int(np.argmax(power))]), reach / 12.0
        return frequency

    def _rough(self) -> Floats:
        """(N,) the residual less a polynomial of each run's own."""
        out = np.empty_like(self.residual)
        for rows in np.split(np.arange(len(out)), self.bins.first[1:]):
            steps = np.linspace(-1.0, 1.0, len(rows))
            smooth = np.linalg.qr(np.polynomial.legendre.legvander(steps, min(SMOOTH, len(rows) // 2)))[0]
            out[rows] = self.residual[rows] - smooth @ (smooth.T @ self.residual[rows])
        return out

    def _noise(self, basis: Floats, rest: Floats | None = None) -> float:
        """Square (A2 times samples) that noise brings into directions, by what each run has left there."""
        rest = self.residual if rest is None else rest
        weighted = self.at.weight[:, None] * basis
        free = np.maximum(1.0 - self.bins.sums(weighted * basis), 1.0 - MOST_LEVERAGE)
        return float(np.sum(self.bins.sums(weighted * rest[:, None]) ** 2 / free))

    def _square(self, values: Floats) -> float:
        return float(self.bins.count @ values**2)

    def parts(self, joint: Joint, total: float) -> tuple[BudgetPart, ...]:
        """Every part; they add up to the mean square `total` (A2)."""
        samples, inside = float(self.at.weight.sum()), self.inside
        explained = dict.fromkeys(CAUSES, 0.0)
        for item in self.taken:
            more = min(item.within, inside)
            inside -= more
            explained[item.key[0]] += (max(item.square - self._noise(item.basis), 0.0) + more) / samples
        rest = max(total - sum(explained.values()), 0.0)
        unassigned = min(self._unassigned() / samples, rest)
        noise = rest - unassigned
        shared = min(self._levels() / samples, noise) if self.groups else 0.0
        chance = self.chance.get(REPEAT)
        is_more = unassigned > 0.0 and chance is not None and chance <= FALSE_ALARM
        causes = [self._cause(name, joint, explained[name]) for name in CAUSES]
        noises = (BudgetPart("noise_shared", shared), BudgetPart("noise_inside", noise - shared))
        return (*noises, *causes, BudgetPart("unassigned", unassigned, chance, is_more))

    def _cause(self, name: str, joint: Joint, mean_square: float) -> BudgetPart:
        items = sorted((item for item in self.taken if item.key[0] == name), key=lambda item: -item.square)
        tried = [chance for key, chance in self.chance.items() if key[0] == name]
        turn = 1.0 if joint.is_revolute else 2.0 * np.pi
        cycles = tuple(item.frequency / turn for item in items if item.frequency)
        gearing = joint.gear_ratio if joint.is_revolute else None
        return BudgetPart(
            name=name,
            mean_square=mean_square,
            p_value=min((item.chance for item in items), default=min(tried, default=None)),
            is_more=bool(items),
            against=tuple(dict.fromkeys(item.key[1] for item in items)),
            cycles=cycles,
            per="" if not cycles else "turn" if joint.is_revolute else "m",
            gearing=tuple(number / gearing for number in cycles) if gearing else (),
            points_to=tuple(dict.fromkeys(effect for item in items for effect in POINTS_TO[item.key])),
        )

    def _unassigned(self) -> float:
        """A2 times samples that repeat and have no name, and what may be noise or not: in few runs, without repeats."""
        if not self.residual.any():
            return 0.0
        if len(self.bins.runs) < FEWEST_RUNS:
            slow = self._square(self.residual) - self._square(self._rough())
            return max(slow, 0.0) if slow >= LEAST * self.whole else 0.0
        if not self.groups:
            return self._levels()
        if self.chance.get(REPEAT, 1.0) > FALSE_ALARM:
            return 0.0
        samples = self.bins.sums(self.bins.count)
        paired = sum(float(samples[list(pair)].mean()) for pair in self.bins.pairs)
        shared = sum(self._product(pair) for pair in self.bins.pairs) * float(samples.sum()) / paired
        return shared if shared >= LEAST * self.whole else 0.0

    def _levels(self) -> float:
        """A2 times samples of the level that each run has for itself, beside its replicates where there are any.

        The product of the means of a run's first and second half holds what both share, and no noise inside the run but
        what lasts that long.
        """
        bins, weight = self.bins, self.at.weight
        is_late = np.arange(len(bins)) - bins.first[bins.run] >= bins.lengths[bins.run] / 2.0
        label, size = 2 * bins.run + is_late, 2 * len(bins.runs)
        total, sums = np.bincount(label, weight, size), np.bincount(label, weight * self.residual, size)
        halves = np.divide(sums, total, out=np.zeros_like(sums), where=total > 0).reshape(-1, 2)
        samples = bins.sums(bins.count)
        if not self.groups:
            return max(float(samples @ (halves[:, 0] * halves[:, 1])), 0.0)
        square, members = 0.0, 0.0
        for group in self.groups:
            rows = np.array(group)
            off = halves[rows] - halves[rows].mean(axis=0)
            square += float(np.sum(samples[rows] * off[:, 0] * off[:, 1])) * len(rows) / (len(rows) - 1.0)
            members += float(samples[rows].sum())
        return max(square, 0.0) * float(samples.sum()) / members


def _orthonormal(columns: Floats, at: BudgetVariables, taken: Floats) -> Floats:
    """(N, k) directions of columns, orthonormal under the weights and free of the columns `taken` (N, K)."""
    root = np.sqrt(at.weight)[:, None]
    size = np.linalg.norm(columns * root, axis=0)
    unit = columns[:, size > 0] / size[size > 0]
    if not unit.shape[1]:
        return np.zeros((len(columns), 0))
    rest = unit - taken @ (taken.T @ (at.weight[:, None] * unit))
    directions, singular, _ = np.linalg.svd(rest * root, full_matrices=False)
    return np.asarray(directions[:, singular**2 > LEAST_LEFT] / root)


def _rarity(observed: float, flipped: Floats) -> tuple[float, Floats]:
    """How rare the observed statistic and each flipped one (B,) are, by the gamma law of the flipped ones' moments.

    It only makes unlike statistics comparable; what is right on the whole is the smallest of them over all statistics,
    compared with the smallest of each flip.
    """
    mean, variance = float(flipped.mean()), float(flipped.var())
    if variance <= 1e-24 * mean**2 or mean <= 0.0:
        return 1.0, np.ones(len(flipped))
    shape, scale = mean**2 / variance, variance / mean
    tail = special.gammaincc(shape, np.maximum(np.append(observed, flipped), 0.0) / scale)
    return float(tail[0]), np.asarray(tail[1:])


def _limits(bins: JointBins, at: BudgetVariables, *, has_load: bool) -> list[str]:
    """What these runs cannot split."""
    strokes = bool(bins.is_stroke.any())
    claims = {
        "few-runs": len(bins.runs) < FEWEST_RUNS,
        "no-replicates": all(len(group) < 2 for group in bins.groups),
        "one-direction": len({run.direction for run in bins.runs}) == 1,
        "one-posture": int(at.posture.max()) == 0,
        "one-speed": len(bins.speeds) == 1 and not strokes,
        "two-speeds": len(bins.speeds) == 2 and not strokes,
        "strokes": strokes,
        "several-clocks": int(at.clock.max()) > 0,
        "no-load": not has_load,
    }
    return [slug for slug, is_so in claims.items() if is_so]
