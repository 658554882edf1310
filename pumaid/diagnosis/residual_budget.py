"""The residual budget: how much of what a model leaves at a joint is noise, and on what the rest depends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

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
#: Directions of which less than this share remains beside what was taken out are not looked at; nor are columns that
#: one run fills to `ALONE`: they say nothing of other runs.
LEAST_BESIDE, ALONE = 1e-3, 0.9
#: Most of a run's noise that the fit may have taken away before the correction for it stops growing.
MOST_LEVERAGE = 0.8
#: Waves over the longest run from which a wave is a ripple, and the degree of each run's polynomial taken out before.
FEWEST_WAVES, SMOOTH = 5.0, 8
#: Distinct speeds beyond which friction over speed is a smooth curve; postures beyond which the rest count as one.
MOST_SPEEDS, MOST_POSTURES = 8, 24
#: Smooth over position: harmonics of a turn and the degree of a polynomial over the span; that of a slide.
HARMONICS, DEGREE, SLIDING_DEGREE = 3, 5, 9
#: Half waves over the campaign: a warm-up, a drift or a step shows in these. Lengths of a start, shares of the span.
SLOW, STARTS = 6, (0.01, 0.03, 0.1)

RIPPLE, REPEAT = ("fast", "position"), ("unassigned", "")
#: Parts that point to causes, in the order in which they are told.
CAUSES = ("smooth", "fast", "start", "odd", "even", "time")
#: Part and variable of each dependence that is tried -> the effects that look like it.
POINTS_TO: dict[Key, tuple[str, ...]] = {
    ("smooth", "position"): ("spring", "counterbalance", "flexibility"),
    ("smooth", "direction"): ("position_friction", "load_friction"),
    ("smooth", "posture"): ("tilt", "zero_offset", "flexibility", "coupling"),
    ("smooth", "load"): ("flexibility",),
    ("start", "travel"): ("presliding", "inertia"),
    ("odd", "direction"): ("warmup", "thermal_friction"),
    ("odd", "speed"): ("stribeck", "viscous_power"),
    ("odd", "load"): ("load_friction",),
    ("odd", "lag"): ("delay",),
    ("odd", "posture"): ("side_load_friction", "load_friction", "coupling"),
    ("even", "direction"): ("payload",),
    ("even", "posture"): ("tilt", "zero_offset", "coupling", "payload"),
    ("even", "speed"): ("torque_droop", "saturation"),
    ("even", "load"): ("torque_droop", "saturation"),
    ("time", "time"): ("warmup", "friction_step"),
    ("time", "load"): ("torque_constant_drift", "payload"),
    ("time", "even"): ("payload",),
    ("time", "temperature"): ("thermal_friction", "warmup"),
    RIPPLE: ("ripple",),
}


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
    floor = noise_floor(pairs(bins.runs))[0] if floor is None else floor
    samples, square = float(bins.count.sum()), float(bins.count @ residual**2)
    if mean_square is None:
        mean_square = (square + _inside(bins, residual)) / samples
    inside = max(mean_square * samples - square, 0.0)
    search = _Decomposition(bins, joint, residual, load=load, inside=inside, is_fitted=is_fitted)
    if mean_square > ROUNDING**2:
        search.run()
    return Budget(
        mean_square=mean_square,
        parts=search.parts(joint, mean_square),
        runs=len(bins.runs),
        replicates=sum(len(group) for group in bins.groups if len(group) > 1),
        floor=None if floor is None else floor**2,
        limits=tuple(_limits(bins, has_load=load is not None)),
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


def columns_of(bins: JointBins, joint: Joint, load: Floats | None) -> dict[Key, Floats]:
    """(N, K) columns of every dependence that these bins can show; those that turn round with the direction are odd.

    `load` (N,) is what gravity draws by the model (A), or None.
    """
    samples, run = bins.samples, bins.run
    position, s = samples.position[:, bins.joint - 1], samples.direction[:, None]
    span = float(np.ptp(position)) or 1.0
    share = (position - position.min()) / span
    speed = np.abs(samples.velocity[:, bins.joint - 1])
    v = (speed / (speed.max() or 1.0))[:, None]
    age = samples.time / (samples.time.max() or 1.0)
    posture, by_speed = _postures(bins), _by_speed(bins, v[:, 0])
    smooth = np.polynomial.legendre.legvander(2.0 * share - 1.0, DEGREE if joint.is_revolute else SLIDING_DEGREE)[:, 1:]
    first = posture * 0.0
    if joint.is_revolute:
        turns = np.arange(1, HARMONICS + 1) * position[:, None]
        smooth = np.hstack([np.cos(turns), np.sin(turns), smooth])
        first = np.hstack([posture * np.cos(turns[:, :1]), posture * np.sin(turns[:, :1])])
    # Time within each recording and direction, since recordings cannot be compared in time.
    clock = np.unique([run_of.clock for run_of in bins.runs], return_inverse=True)[1][run]
    ages = _centred(_half_waves(age, SLOW), bins.count, 2 * clock + (samples.direction > 0))
    measured = np.isfinite(samples.temperature)
    degrees = np.where(measured, samples.temperature, 0.0)
    warmth = _centred(degrees[:, None], bins.count * measured, np.zeros(len(bins), np.int64)) * measured[:, None]
    starts = s * np.exp(-samples.travel[:, None] / span / np.array(STARTS))
    out = {
        ("smooth", "position"): _centred(smooth, bins.count, run),
        ("smooth", "direction"): _centred(s * smooth, bins.count, run),
        ("smooth", "posture"): _centred(first, bins.count, run),
        ("start", "travel"): _centred(starts, bins.count, run),
        ("odd", "direction"): s * v ** [0.0, 1.0],
        ("odd", "speed"): s * by_speed,
        ("odd", "posture"): s * posture,
        ("even", "direction"): v ** [0.0, 1.0],
        ("even", "posture"): posture,
        ("even", "speed"): by_speed,
        ("time", "time"): s * ages,
        ("time", "even"): ages,
        ("time", "temperature"): np.hstack([s * warmth, warmth]),
    }
    if load is not None:
        slope, size = _slope(load, position / span, bins), np.abs(load).max() or 1.0
        out |= {
            ("smooth", "load"): _centred((load * slope)[:, None], bins.count, run),
            ("odd", "load"): s * np.abs(load)[:, None] ** [1.0, 2.0],
            ("odd", "lag"): s * v * slope[:, None],
            ("even", "load"): np.column_stack([load * np.abs(load) / size, load**3 / size**2]),
            ("time", "load"): _half_waves(age, 2) * load[:, None],
        }
    return {key: out[key] for key in POINTS_TO if key in out and np.isfinite(out[key]).all() and out[key].any()}


def fitted_columns(bins: JointBins) -> Floats:
    """(N, 5) friction by direction and inertia: the joint's own in every model, so that a fit has taken them away.

    Gravity is not: it is shared with other joints, which may have bent it.
    """
    samples = bins.samples
    sides = samples.direction[:, None] * [1.0, -1.0] > 0
    speed = np.abs(samples.velocity[:, [bins.joint - 1]])
    return np.hstack([sides, sides * speed, samples.acceleration[:, None]]).astype(float)


def _half_waves(share: Floats, count: int) -> Floats:
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, count + 1)))


def _indicators(label: Labels) -> Floats:
    """(N, K) one column for each number from 0 on."""
    return np.asarray((label[:, None] == np.arange(label.max() + 1)).astype(float))


def _postures(bins: JointBins) -> Floats:
    """(N, K) one column for each held posture, the most frequent first."""
    number = np.zeros(len(bins.runs), dtype=np.int64)
    for place, group in enumerate(sorted(bins.postures, key=len, reverse=True)):
        number[list(group)] = min(place, MOST_POSTURES)
    return _indicators(number[bins.run])


def _by_speed(bins: JointBins, share: Floats) -> Floats:
    """(N, K) one column for each speed where runs at constant speed have few, else half waves over its `share`."""
    speeds = np.array(bins.speeds)
    if len(speeds) > MOST_SPEEDS or bins.is_stroke.any():
        return _half_waves(share, 4)
    nearest = np.array([int(np.argmin(np.abs(speeds - abs(run.speed)))) for run in bins.runs])
    return _indicators(nearest[bins.run])


def _centred(columns: Floats, weight: Floats, label: Labels) -> Floats:
    """Less their mean over the bins of each label."""
    total = np.bincount(label, weight)
    means = [np.bincount(label, weight * column) / np.where(total > 0, total, 1.0) for column in columns.T]
    return columns - np.array(means).T[label]


def _slope(load: Floats, share: Floats, bins: JointBins) -> Floats:
    """(N,) derivative of a load by the position, run by run; 0 where a run stands still."""
    out = np.zeros_like(load)
    for rows in np.split(np.arange(len(load)), bins.first[1:]):
        if len(rows) > 1:
            rise, way = np.gradient(load[rows]), np.gradient(share[rows])
            out[rows] = np.divide(rise, way, out=np.zeros(len(rows)), where=way != 0.0)
    return out


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
        (n, k) directions, orthonormal under the weights: at groups of bins while tried, at all bins once taken out.
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


class _Decomposition:
    """The residual of one joint while it is taken apart."""

    def __init__(
        self, bins: JointBins, joint: Joint, residual: Floats, *, load: Floats | None, inside: float, is_fitted: bool
    ) -> None:
        self.bins, self.weight, self.residual, self.inside = bins, bins.count, residual.copy(), inside
        self.whole = self._square(residual) + inside
        self.taken: list[Dependence] = []
        self.chance: dict[Key, float] = {}
        self.small: list[float] = []
        self.columns = columns_of(bins, joint, load)
        self.starts = _group_starts(bins)
        self.grouped = {key: self._grouped(columns) for key, columns in self.columns.items()}
        fitted = fitted_columns(bins)[:, : None if is_fitted else 0]
        self.basis = _orthonormal(fitted, self.weight)
        self.grouped_basis = _orthonormal(self._grouped(fitted), self._grouped_weight)
        self.groups = [group for group in bins.groups if len(group) > 1]

    @property
    def _grouped_weight(self) -> Floats:
        return np.add.reduceat(self.weight, self.starts)

    def _grouped(self, columns: Floats) -> Floats:
        """(n, K) means over the groups of bins in which all but ripples are looked for."""
        return np.add.reduceat(self.weight[:, None] * columns, self.starts) / self._grouped_weight[:, None]

    def run(self) -> None:
        """Take the residual apart until nothing in it is more than noise."""
        rng = np.random.default_rng(SEED)
        signs = rng.choice([-1.0, 1.0], (FLIPS, len(self.bins.runs)))
        for _ in range(MOST_TAKEN + MOST_SMALL):
            largest = self._largest(self._tried(signs))
            if largest is None:
                return
            self._take(largest)

    def _tried(self, signs: Floats) -> list[Dependence]:
        """Every dependence that is still open, with what flipped signs make of it."""
        out: list[Dependence] = []
        if len(self.bins.runs) >= FEWEST_RUNS:
            rest = self._grouped(self.residual[:, None])
            tried = [self._test(key, rest, signs) for key in self.grouped]
            out = [item for item in tried if item is not None]
            if self.groups:
                out.append(self._repeat(signs))
        return [*out, *self._ripple(signs)]

    def _test(self, key: Key, rest: Floats, signs: Floats) -> Dependence | None:
        """A dependence of which something remains beside what was taken out."""
        weight, first = self._grouped_weight, np.searchsorted(self.starts, self.bins.first)
        columns = self.grouped[key]
        by_run = np.add.reduceat(weight[:, None] * columns**2, first, axis=0)
        columns = columns[:, by_run.max(axis=0) <= ALONE * by_run.sum(axis=0)]
        basis = _orthonormal(columns, weight, self.grouped_basis)
        if not basis.shape[1]:
            return None
        weighted = weight[:, None] * basis
        scores = np.add.reduceat(weighted * rest, first, axis=0)
        fills = np.add.reduceat(weighted * basis, first, axis=0)
        crossed = np.add.reduceat(weighted[:, :, None] * self.grouped_basis[:, None, :], first, axis=0)
        lost = np.divide(np.sum(crossed**2, axis=2), fills, out=np.zeros_like(fills), where=fills > 1e-12)
        corrected = scores / np.sqrt(1.0 - np.clip(lost, 0.0, MOST_LEVERAGE))
        square, flipped = float(np.sum(scores.sum(axis=0) ** 2)), np.sum((signs @ corrected) ** 2, axis=1)
        return Dependence(key, *_rarity(square, flipped), basis, square, float(flipped.mean()))

    def _ripple(self, signs: Floats) -> Sequence[Dependence]:
        """The strongest ripple that is not taken out yet."""
        if len(self.small) > MOST_SMALL:
            return []
        rough = self._rough()
        noise = noise_of(self.bins, rough, pairs=())
        done = [*self.small, *(item.frequency for item in self.taken if item.frequency)]
        white = noise.whiten(self.bins, rough)
        waves = spectrum(self.bins, noise, white, without=done, fewest_periods=FEWEST_WAVES)
        if waves is None:
            return []
        height = waves.statistic()
        frequency = self._refined(rough, float(waves.frequency[int(np.argmax(height))]), waves)
        basis = self._waves(frequency)[0]
        square = float(np.sum((basis.T @ (self.weight * rough)) ** 2))
        rarity = _rarity(float(height.max()), waves.highest(signs))
        return [Dependence(RIPPLE, *rarity, basis, square, self._noise(basis, self.residual), 0.0, frequency)]

    def _repeat(self, signs: Floats) -> Dependence:
        """What replicates leave alike."""
        first, second = np.array(self.bins.pairs).T
        products = self._products()
        flipped = (signs[:, first] * signs[:, second]) @ products
        chances = special.ndtr(-np.append(products.sum(), flipped) / (float(flipped.std()) or 1.0))
        return Dependence(REPEAT, float(chances[0]), chances[1:], np.zeros((0, 0)))

    def _products(self) -> Floats:
        """Product of the residuals of each pair of replicates, A2 times samples of one."""
        samples, out = self.bins.sums(self.weight), []
        for pair in self.bins.pairs:
            first, second = self.bins.side_by_side(self.residual, pair)
            out.append(samples[list(pair)].mean() * np.mean(first * second) if len(first) else 0.0)
        return np.array(out)

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
            del self.grouped[item.key]
            basis = _orthonormal(self.columns[item.key], self.weight, self.basis)
        along = basis.T @ (self.weight * self.residual)
        rest, fall = self.residual - basis @ along, float(along @ along)
        if fall - self._noise(basis, rest) < (LEAST_RIPPLE if is_ripple else LEAST) * self.whole:
            self.small += [item.frequency] if is_ripple else []
            return
        self.residual = rest
        self.taken.append(replace(item, basis=basis, square=fall, within=within))
        if not is_ripple:
            self.basis = np.hstack([self.basis, basis])
            self.grouped_basis = np.hstack([self.grouped_basis, item.basis])

    def _waves(self, frequency: float) -> tuple[Floats, Floats]:
        """(N, k) orthonormal means over bins of the waves of the position in each direction; (3 N, 4) at the nodes."""
        nodes, _ = self.bins.nodes
        angle = frequency * nodes.position[:, self.bins.joint - 1]
        waves = np.column_stack([np.cos(angle), np.sin(angle)])
        both = np.hstack([waves * (nodes.direction > 0)[:, None], waves * (nodes.direction < 0)[:, None]])
        return _orthonormal(self.bins.averaged(both), self.weight), both

    def _within_bins(self, basis: Floats, waves: Floats) -> float:
        """What the fitted ripple varies inside bins (A2 times samples)."""
        means, root = self.bins.averaged(waves), np.sqrt(self.weight)
        fitted = basis @ (basis.T @ (self.weight * self.residual))
        size = np.linalg.lstsq(means * root[:, None], fitted * root, rcond=1e-9)[0]
        return float(self.weight @ self.bins.variance(waves @ size))

    def _refined(self, rough: Floats, frequency: float, waves: Spectrum) -> float:
        """The frequency near `frequency` of which the residual holds most."""
        place, weighted = self.bins.samples.position[:, self.bins.joint - 1], rough * self.weight
        sides = (self.bins.samples.direction > 0, self.bins.samples.direction < 0)
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

    def _noise(self, basis: Floats, rest: Floats) -> float:
        """Square (A2 times samples) that noise brings into directions, by what each run has of `rest` there."""
        weighted = self.weight[:, None] * basis
        free = np.maximum(1.0 - self.bins.sums(weighted * basis), 1.0 - MOST_LEVERAGE)
        return float(np.sum(self.bins.sums(weighted * rest[:, None]) ** 2 / free))

    def _square(self, values: Floats) -> float:
        return float(self.weight @ values**2)

    def parts(self, joint: Joint, total: float) -> tuple[BudgetPart, ...]:
        """Every part; they add up to the mean square `total` (A2)."""
        samples, inside = float(self.weight.sum()), self.inside
        explained = dict.fromkeys(CAUSES, 0.0)
        for item in self.taken:
            more = min(item.within, inside)
            inside -= more
            explained[item.key[0]] += (max(item.square - self._noise(item.basis, self.residual), 0.0) + more) / samples
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
        samples = self.bins.sums(self.weight)
        paired = sum(float(samples[list(pair)].mean()) for pair in self.bins.pairs)
        shared = float(self._products().sum()) * float(samples.sum()) / paired
        return shared if shared >= LEAST * self.whole else 0.0

    def _levels(self) -> float:
        """A2 times samples of the level that each run has for itself, beside its replicates where there are any.

        The product of the means of a run's first and second half holds what both share, and no noise inside the run but
        what lasts that long.
        """
        bins, weight = self.bins, self.weight
        is_late = np.arange(len(bins)) - bins.first[bins.run] >= bins.lengths[bins.run] / 2.0
        label, size = 2 * bins.run + is_late, 2 * len(bins.runs)
        total, sums = np.bincount(label, weight, size), np.bincount(label, weight * self.residual, size)
        halves = np.divide(sums, total, out=np.zeros_like(sums), where=total > 0).reshape(-1, 2)
        samples = bins.sums(weight)
        if not self.groups:
            return max(float(samples @ (halves[:, 0] * halves[:, 1])), 0.0)
        square, members = 0.0, 0.0
        for group in self.groups:
            rows = np.array(group)
            off = halves[rows] - halves[rows].mean(axis=0)
            square += float(np.sum(samples[rows] * off[:, 0] * off[:, 1])) * len(rows) / (len(rows) - 1.0)
            members += float(samples[rows].sum())
        return max(square, 0.0) * float(samples.sum()) / members


def _group_starts(bins: JointBins) -> Labels:
    """First bins of the groups in which all but ripples are looked for."""
    pieces = []
    for start, length in zip(bins.first, bins.lengths, strict=True):
        inner = np.arange(length)
        if length > FIRST + GROUPS:
            inner = np.append(np.arange(FIRST), np.linspace(FIRST, length, GROUPS + 1).astype(np.int64)[:-1])
        pieces.append(start + inner)
    return np.concatenate(pieces)


def _orthonormal(columns: Floats, weight: Floats, taken: Floats | None = None) -> Floats:
    """(N, k) directions of columns, orthonormal under the weights and free of the orthonormal columns `taken`."""
    root = np.sqrt(weight)[:, None]
    size = np.linalg.norm(columns * root, axis=0)
    unit = columns[:, size > 0] / size[size > 0]
    if not unit.shape[1]:
        return np.zeros((len(columns), 0))
    rest = unit if taken is None else unit - taken @ (taken.T @ (weight[:, None] * unit))
    directions, singular, _ = np.linalg.svd(rest * root, full_matrices=False)
    return np.asarray(directions[:, singular**2 > LEAST_BESIDE] / root)


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


def _limits(bins: JointBins, *, has_load: bool) -> list[str]:
    """What these runs cannot split."""
    strokes = bool(bins.is_stroke.any())
    claims = {
        "few-runs": len(bins.runs) < FEWEST_RUNS,
        "no-replicates": all(len(group) < 2 for group in bins.groups),
        "one-direction": len({run.direction for run in bins.runs}) == 1,
        "one-posture": len(bins.postures) == 1,
        "one-speed": len(bins.speeds) == 1 and not strokes,
        "two-speeds": len(bins.speeds) == 2 and not strokes,
        "strokes": strokes,
        "several-clocks": len({run.clock for run in bins.runs}) > 1,
        "no-load": not has_load,
    }
    return [slug for slug, is_so in claims.items() if is_so]
