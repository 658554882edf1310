"""Everything that could be missing: each effect at each joint with each shape of its grid, waves at all frequencies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special

from pumaid.dataset import Dataset
from pumaid.effect_spec import EffectTerm
from pumaid.effects import NO_SHAPE, USUAL, Effect, Extent, Family, Parameter, Samples, Scope, Shape, catalogue
from pumaid.estimation.fit import Fit
from pumaid.estimation.noise import NoiseModel
from pumaid.joint_bins import JointBins, extent
from pumaid.maths import Counts, Flags, Floats
from pumaid.robot import ALL, Robot

#: Effect and joint (from 1; None: the whole arm).
Key = tuple[str, int | None]


@dataclass(frozen=True, eq=False, slots=True)
class Candidates:
    """What may be missing: `groups` of one effect at one joint with each shape of its grid, and what is `excluded`.

    Effect and joint (None: the whole arm) of those that cannot act, or cannot be tried, map to the reason.
    """

    groups: Mapping[Key, tuple[EffectTerm, ...]] = field(default_factory=dict)
    excluded: Mapping[Key, str] = field(default_factory=dict)


def grid_of(solved: Fit, effect: Effect, joint: int | None, *, covered: Extent | None = None) -> tuple[EffectTerm, ...]:
    """An effect with each shape at which a search begins, given what the runs of its joint cover, or those of all."""
    grid = effect.grid(solved.model.robot, covered or _covered(solved, joint))
    return tuple(EffectTerm(effect, joint, dict(shape)) for shape in grid)


def _covered(solved: Fit, joint: int | None) -> Extent:
    row = solved.by_bin.get(joint or 0)
    bins = [part.bins for part in solved.joints]
    return replace(extent(bins, 0), joint=joint) if row is None else extent([row.bins], row.bins.joint, row.drawn)


def candidates(solved: Fit, effects: Sequence[Effect] | None = None) -> Candidates:
    """Every effect (of the catalogue, where not given) that the model lacks; of periodic ones slow waves alone.

    Of what is fast there are spectra.
    """
    robot, moving = solved.model.robot, [row.bins.joint for row in solved.joints]
    owners: dict[Scope, Sequence[int | None]] = {Scope.ARM: (None,), Scope.CAUSE: range(1, robot.n_joints + 1)}
    present = {term.key for term in solved.model.effects}
    present |= {(column.effect, column.owner or None) for column in solved.model.columns}
    covered = {joint: _covered(solved, joint) for joint in (None, *range(1, robot.n_joints + 1))}
    groups, excluded = {}, {}
    for effect in (x for x in effects or catalogue().values() if not (x.base or x.is_free)):
        for joint in owners.get(effect.scope, moving):
            why = None if joint is None else effect.applies(robot, joint, in_motion=solved.model.is_dynamic)
            if why is not None:
                excluded[effect.name, joint] = why
            elif effect.periodic is not None:
                groups[effect.name, joint] = _slow_waves(solved, effect, joint, covered[joint])
            elif effect.is_repeatable or not present & {(effect.name, joint), (effect.name, None)}:
                groups[effect.name, joint] = grid_of(solved, effect, joint, covered=covered[joint])
    return Candidates({key: group for key, group in groups.items() if group}, excluded)


def _slow_waves(solved: Fit, effect: Effect, joint: int | None, covered: Extent) -> tuple[EffectTerm, ...]:
    """A periodic effect at the frequencies below those of its spectrum, which the model's slow columns absorb in part.

    And at those of waves of another kind that the model has, for which alone one that grows with the load is tried; but
    not within a resolution of its own waves, which frequencies refined beside each other part.
    """
    name, slow, resolution = str(effect.periodic), covered.travel / FEWEST_PERIODS, 2.0 * np.pi / covered.travel
    periodic = [x for x in solved.model.effects if x.joint == joint and x.effect.periodic is not None]
    waves = [(x.effect.name == effect.name, x.shape[str(x.effect.periodic)]) for x in periodic]
    grid = () if effect.needs_loads else grid_of(solved, effect, joint, covered=replace(covered, finest=slow))
    tried = [EffectTerm(effect, joint, {name: wave}) for is_own, wave in waves if not is_own]
    tried += [term for term in grid if term.shape[name] < 2.0 * np.pi / slow]
    return tuple(
        term for term in tried if all(abs(term.shape[name] - wave) > resolution for is_own, wave in waves if is_own)
    )


class Expansion(Effect):
    """Columns of one joint's samples without a law, a parameter each; in no catalogue."""

    title, source, family = "Columns without a law", "least squares", Family.SUSPECT
    name: str = ""

    def __init__(self, name: str, width: int, made: Callable[[Samples], Floats]) -> None:
        self.name, self.width, self.made = name, width, made

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return tuple(Parameter(f"b{k}", "A", "of a column", f"b{k}") for k in range(self.width))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        return self.made(samples)


class Together(Effect):
    """One effect at several joints, each with parameters of its own, as one effect of the arm; in no catalogue."""

    title, source, family = "An effect of several joints", "the effect's own", Family.SUSPECT
    scope, prior_odds, needs_loads = Scope.ARM, USUAL, True
    name: str = ""

    def __init__(self, terms: Sequence[EffectTerm], signs: Floats) -> None:
        self.name, self.terms, self.sides = terms[0].effect.name, terms, signs
        self.joints = tuple(term.number for term in terms)

    def options(self, robot: Robot) -> list[str]:
        """The effect at its joints as ``--add`` reads it, once for all where these are all that can have it."""
        able = [joint.number for joint in robot.joints if self.terms[0].effect.applies(robot, joint.number) is None]
        return [f"{self.name}@{joint}" for joint in ((ALL,) if able == [*self.joints] else self.joints)]

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return tuple(
            replace(item, name=f"{item.name}@{term.joint}", symbol=item.symbol.format(n=term.joint))
            for term in self.terms
            for item in term.parameters(robot)
        )

    def signs(self, shape: Mapping[str, float]) -> tuple[int, ...]:
        return tuple(self.sides.astype(int).tolist())

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        return np.hstack([term.linear(robot, samples) for term in self.terms])


class Suspect(Effect):
    """a x, s a x or a tau x, with x a column of the logs less its mean, s the direction and tau gravity's load.

    Parameters
    ----------
    column
        Its name.
    place
        Its number in `Samples.extra`.
    middle, spread
        Mean and standard deviation over the runs, in the column's own unit.
    """

    title = "A suspected column of the logs"
    source = "the user's suspicion"
    family = Family.SUSPECT
    needs_loads: ClassVar[bool] = True
    name: str = ""

    def __init__(self, column: str, place: int, *, middle: float, spread: float) -> None:
        self.name = f"suspect:{column}"
        self.column, self.place, self.middle, self.spread = column, place, middle, spread

    @classmethod
    def of(cls, dataset: Dataset, column: str) -> Suspect:
        """A column that `dataset` carries, scaled by what it does in these runs."""
        place = dataset.extra.index(column)
        parts = [run.bins.extra[:, place] for run in dataset.runs if run.bins.extra is not None]
        values = np.concatenate(parts) if parts else np.zeros(1)
        values = values[np.isfinite(values)]
        middle, spread = (float(values.mean()), float(values.std())) if len(values) else (0.0, 0.0)
        return cls(column, place, middle=middle, spread=spread)

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        return (Parameter("a", "A", f"current per standard deviation ({self.spread:.4g}) of {self.column}", "a{n}"),)

    def shapes(self, robot: Robot, number: int) -> tuple[Shape, ...]:
        return (Shape("times", "1", "0: as it is, 1: times direction, 2: times load", 0.0, 2.0, 1.0, False),)

    def grid(self, robot: Robot, extent: Extent) -> tuple[Mapping[str, float], ...]:
        return tuple({"times": float(number)} for number in range(3))

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        if samples.extra is None or self.spread <= 0.0:
            return np.zeros((len(samples), 1))
        x = np.nan_to_num((samples.extra[:, self.place] - self.middle) / self.spread)
        load = np.zeros(len(samples)) if samples.loads is None else samples.loads.moving
        factor = (np.ones(len(samples)), samples.direction, load)[int(shape.get("times", 0.0))]
        return np.asarray((x * factor)[:, None])


#: s in which the transient of a position controller dies down (servo drives have bandwidths of 3 to 10 Hz). Speeds
#: beyond which the transients of single speeds are not told apart but scaled with speed.
SETTLING_TIME, MOST_SPEEDS = 0.025, 6


def settling(bins: Sequence[JointBins]) -> tuple[EffectTerm, ...]:
    """s b exp(-t/T), t the time since a run began, T `SETTLING_TIME`: one b for each speed, at each joint of which all
    runs are at constant speed.

    Inertia makes it: at the end of a ramp the speed is off by a few tenths of a per cent, and to mend that in some tens
    of milliseconds draws more than friction does. It is no finding, since every arm has it.

    Source: S.-K. Lin, eq. (35): acceleration feedback within the load compensator.
    """
    return tuple(
        EffectTerm(
            Expansion(
                "settling",
                2 if len(item.speeds) > MOST_SPEEDS else len(item.speeds),
                partial(_fading, np.array(item.speeds)),
            ),
            item.joint,
            NO_SHAPE,
        )
        for item in bins
        if not item.accelerates.any()
    )


def _fading(speeds: Floats, samples: Samples) -> Floats:
    """(M, K) a transient in which the current settles at each of K speeds, or of two that scale with speed."""
    v = np.abs(samples.velocity[:, samples.joint - 1])
    fading = samples.direction * np.exp(-samples.travel / np.maximum(v, 1e-9) / SETTLING_TIME)
    groups = np.column_stack([np.ones(len(v)), v])
    if len(speeds) <= MOST_SPEEDS:
        groups = np.eye(len(speeds))[np.abs(v[:, None] - speeds).argmin(axis=1)]
    return np.asarray(groups * fading[:, None])


#: Lowest frequency looked at, in periods over the longest run: below, gravity and friction that vary with position
#: absorb or mimic it.
FEWEST_PERIODS = 3.0
#: Steps of the frequency a resolution (2 pi / way from the lowest to the highest position): the peak is missed by at
#: most a tenth of a step's power.
OVERSAMPLING = 2.5
#: Share of the finest bins' Nyquist frequency that is looked at: bins are means, which damp what is near it.
HIGHEST = 0.9
#: Resolutions of a run about a wave that the model has already, in which there is no other: what is left there is that
#: wave, stronger or shifted in some runs.
SAME = 2.0
#: Points of the even grid that bins are shared out to, a period of the highest frequency: a wave there leaks 1 %.
#: Lengths that stand for the ways from bin to bin, which are unequal where the speed is.
POINTS, WIDTHS = 4, 8
QUANTILES = (np.arange(WIDTHS) + 0.5) / WIDTHS
#: Runs below which signs are flipped of pieces of runs, about so many in all: of so few whole runs, flips that change
#: nothing or all are more than one in fifty. Waves are looked at of which a piece holds this many: what is slower may
#: be noise that neighbouring pieces share.
FEWEST_RUNS, PIECES, A_PIECE = 8, 12, 2.0
#: Of the flips of pieces; a diagnosis is the same each time.
SEED = 20_262
#: Frequencies looked at together in all flips: what a processor's cache holds.
AT_ONCE = 256
#: Degrees of freedom of a periodic effect: cosine and sine.
PERIODIC = 2
#: Half of a chi-square beyond which its tail is told by the expansion, for no program can hold it.
FAR = 500.0


@dataclass(frozen=True, eq=False, slots=True)
class Spectrum:
    """Scores of an effect that is periodic in the position of one joint, at F frequencies (1/rad or 1/m).

    `key` is its name and joint. `scores` (S, F) are complex, cosine and sine part of each run's score, or of each
    piece's where runs are few (`is_pieces`); `information` (F,) is that of either part, since both are alike and do not
    mix. `power` (F,) is the share of a wave's power that means over bins leave.
    """

    key: Key
    frequency: Floats
    scores: np.ndarray
    information: Floats
    power: Floats
    is_pieces: bool = False

    @property
    def visible(self) -> slice:
        """Frequencies from the lowest up to that at which bins average half of a wave's power away."""
        is_lost = self.power < 0.5
        return slice(0, int(is_lost.argmax()) if is_lost.any() else len(is_lost))

    def statistic(self) -> Floats:
        """(F,) twice the gain in log likelihood."""
        return np.asarray(np.abs(self.scores.sum(axis=0, dtype=complex)) ** 2 / self.information)

    def peak(self) -> float:
        """Frequency of the largest statistic, by a parabola through it and its neighbours."""
        statistic = self.statistic()
        top = int(np.clip(np.argmax(statistic), 1, len(statistic) - 2))
        before, at, after = statistic[top - 1 : top + 2]
        bend = before - 2.0 * at + after
        shift = 0.0 if bend >= 0.0 else float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))
        return float(self.frequency[top] + shift * (self.frequency[top] - self.frequency[top - 1]))

    def surprise(self, scale: float) -> float:
        """-log10 of the chance of its largest statistic at one frequency alone; as of a `ScoreTest`."""
        return float(minus_log10_p(self.statistic().max() / scale, PERIODIC))

    def highest(self, signs: Floats) -> Floats:
        """(B,) the largest statistic of all frequencies, the signs of runs being those of `signs` (B, R).

        The size of `signs`, by which scores of slow effects are corrected for the fit, means nothing here: the fit
        takes nothing from so fast a wave. Where runs are few, other flips are drawn, of pieces.
        """
        rng, flips, out = np.random.default_rng(SEED), np.sign(signs), np.zeros(len(signs))
        if self.is_pieces:
            flips = rng.choice([-1.0, 1.0], size=(len(signs), len(self.scores)))
        flips, unit = flips.astype(np.float32), (1.0 / np.sqrt(self.information)).astype(np.float32)
        for part in (slice(start, start + AT_ONCE) for start in range(0, len(unit), AT_ONCE)):
            block = self.scores[:, part] * unit[part]
            cosine, sine = flips @ block.real.copy(), flips @ block.imag.copy()
            cosine *= cosine
            sine *= sine
            cosine += sine
            np.maximum(out, cosine.max(axis=1), out=out)
        return out


def minus_log10_p(statistic: Floats | float, freedoms: int) -> Floats:
    """-log10 of the chance of at least `statistic` under chi-square, also far out in the tail."""
    half, x = freedoms / 2.0, np.asarray(statistic, dtype=float) / 2.0
    whole = special.erfc(np.sqrt(x)) if freedoms == 1 else special.gammaincc(half, x)  # the first is quicker
    tail, beyond = np.maximum(whole, 1e-300), np.maximum(x, FAR)
    far = (half - 1.0) * np.log(beyond) - beyond - special.gammaln(half) + np.log1p((half - 1.0) / beyond)
    return np.asarray(-np.where(x > FAR, far, np.log(tail)) / np.log(10.0))


def spectrum(
    key: Key,
    bins: JointBins,
    noise: NoiseModel,
    *,
    white: Floats,
    scale: float = 1.0,
    without: Sequence[float] = (),
    fewest_periods: float = FEWEST_PERIODS,
    delay: float = 0.0,
) -> Spectrum | None:
    """Scores of cos(f q) and sin(f q) at all frequencies that the bins can show; None where runs are too short for any.

    Bins lie at uneven places where the speed is not constant, so each is shared out to the four nearest points of an
    even grid, whose transform gives all frequencies at once. What the base model would absorb is left out of account:
    nothing of it varies so fast.

    Parameters
    ----------
    key, bins, noise, white
        The effect and its joint, that joint at its finest bins, what their noise is like, and (N,) whitened residual.
    scale
        Variance of a whitened residual at these bins, as a share of that by which statistics are divided.
    without, fewest_periods
        Frequencies of waves that the model has; lowest frequency, in periods over the longest run.
    delay
        s by which the currents are taken to be drawn before the positions beside them; other phases stay unknown.

    Source
    ------
    J. D. Scargle, Astrophys. J. 263 (1982) 835-853; W. H. Press and G. B. Rybicki, Astrophys. J. 338 (1989) 277-280.
    """
    grid = _frequency_grid(bins, fewest_periods)
    if grid is None:
        return None
    back = noise.unwhiten(bins, white) * grid.usable[bins.run]
    per_rad = grid.points * (grid.frequency[1] - grid.frequency[0]) / (2.0 * np.pi)
    place = grid.place - delay * per_rad * bins.samples.velocity[:, bins.joint - 1] * grid.usable[bins.run]
    place -= (1.0 + 1e-9) * min(float(place.min()) - 1.0, 0.0)  # on the grid again, whatever is rounded
    shared = _shared(place, back, piece=grid.piece, points=int(place.max()) + 3)
    scores = np.conj(fft.rfft(shared, n=grid.points, axis=1)[:, grid.chosen])
    scores *= grid.turn / np.float32(scale)
    rho = noise.correlation
    weight = np.where(grid.usable, 0.5 * bins.lengths / (noise.spread**2 * (1.0 - rho**2)), 0.0)
    information = weight @ (1.0 + rho**2) - (2.0 * weight * rho) @ grid.likeness
    for wave in without:
        scores[:, np.abs(grid.frequency - wave) < grid.resolution * SAME] = 0.0
    return Spectrum(key, grid.frequency, scores, information / scale, grid.power, len(bins.runs) < FEWEST_RUNS)


@dataclass(frozen=True, eq=False, slots=True)
class _FrequencyGrid:
    """F frequencies that the bins can show, and what of a spectrum the places of bins alone decide.

    `chosen` are they among those of a transform of `points` points, `resolution` is that of the longest run, `usable`
    (R,) runs are long enough, bins are at `place` (N,) on the even grid and in `piece` (N,); `turn` (F,) moves phases
    to the joint's zero, `likeness` (R, F) is the mean cosine of the phase from bin to bin, `power` (F,) the share of a
    wave's power that bins leave.
    """

    frequency: Floats
    chosen: slice
    points: int
    resolution: float
    usable: Flags
    place: Floats
    piece: Counts
    turn: np.ndarray
    likeness: Floats
    power: Floats


@lru_cache(maxsize=16)  # the same at every look at a joint
def _frequency_grid(bins: JointBins, fewest_periods: float) -> _FrequencyGrid | None:
    q, lengths = bins.samples.position[:, bins.joint - 1], bins.lengths
    low, high = np.minimum.reduceat(q, bins.first), np.maximum.reduceat(q, bins.first)
    way = high - low
    usable, is_pieces = (lengths > 4) & (way > 0), len(bins.runs) < FEWEST_RUNS
    if not usable.any():
        return None
    top = HIGHEST * np.pi / float(np.median(way[usable] / (lengths[usable] - 1)))
    slow = fewest_periods / way.max()
    lowest = 2.0 * np.pi * (max(slow, A_PIECE * PIECES / way[usable].sum()) if is_pieces else slow)
    step = 2.0 * np.pi / (POINTS * top)
    start = float(low[usable].min()) - 1.5 * step
    points = fft.next_fast_len(int(np.ceil(OVERSAMPLING * (high[usable].max() - start) / step)), real=True)
    frequency = np.asarray(2.0 * np.pi * np.fft.rfftfreq(points, step))
    chosen = slice(*np.searchsorted(frequency, (lowest, np.nextafter(top, np.inf))).tolist())
    frequency = frequency[chosen]
    if len(frequency) < 3:
        return None
    likeness = np.zeros((len(lengths), len(frequency)))
    passed = np.quantile(np.abs(bins.samples.velocity[:, bins.joint - 1]) * bins.step[bins.run], QUANTILES)
    rounds = np.where(bins.is_cells.any(), 3.0, 1.0)
    for number in np.flatnonzero(usable):
        places = q[bins.first[number] : bins.first[number] + lengths[number]]
        likeness[number] = _likeness(np.abs(np.diff(places)), frequency)
    return _FrequencyGrid(
        frequency,
        chosen,
        points,
        2.0 * np.pi / float(way.max()),
        usable,
        np.where(usable[bins.run], (q - start) / step, 1.0),
        _pieces(bins, np.where(usable, way, 0.0)) if is_pieces else bins.run,
        (np.exp(1j * frequency * start) / np.sinc(0.5 * frequency * step / np.pi) ** 4).astype(np.complex64),
        likeness,
        np.mean(np.sinc(np.outer(passed, frequency) / (2.0 * np.pi)) ** (2.0 * rounds), axis=0),
    )


def _pieces(bins: JointBins, way: Floats) -> Counts:
    parts = np.maximum(np.round(way / way.sum() * PIECES), 1.0).astype(np.int64)
    within = (np.arange(len(bins)) - bins.first[bins.run]) * parts[bins.run] // bins.lengths[bins.run]
    return np.asarray((np.cumsum(parts) - parts)[bins.run] + within)


def _shared(place: Floats, values: Floats, *, piece: Counts, points: int) -> NDArray[np.float32]:
    """(S, points) values at places among the points of a grid, shared out by cubic splines; what is off it is zero."""
    lower = place.astype(np.int64)
    t, index = place - lower, piece * points + lower
    shares = ((1.0 - t) ** 3, 4.0 + 3.0 * t**2 * (t - 2.0), 1.0 + 3.0 * t * (1.0 + t - t**2), t**3)
    out = np.bincount(
        np.concatenate([index + shift for shift in (-1, 0, 1, 2)]),
        np.concatenate([values / 6.0 * share for share in shares]),
        minlength=int(piece[-1] + 1) * points,
    )
    return out.reshape(-1, points).astype(np.float32)  # six digits of a chance, in half the time


def _likeness(ways: Floats, frequency: Floats) -> Floats:
    widths = np.quantile(ways, QUANTILES)
    if widths[-1] - widths[0] < 0.05 * widths[-1]:
        widths = widths[WIDTHS // 2 : WIDTHS // 2 + 1]
    return np.asarray(np.cos(np.outer(widths, frequency)).mean(axis=0))
