"""Effects with shapes: looked for on a grid, refined off it, fitted with everything else, their intervals profiled."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Campaign, Run
from pumaid.effect_spec import EffectTerm, columns_each, scale_of, terms_of
from pumaid.effects import Scope
from pumaid.effects.base import Family, Shape
from pumaid.errors import ModelError, Where
from pumaid.estimation.fit import Fit, rmse_by_joint, with_loads
from pumaid.estimation.gls import Progress, eased, fit_bins, plausible, refit, releveled, with_chain_rule
from pumaid.joint_bins import COARSE, FINE, JointBins, extent, joint_bins
from pumaid.model import Model
from pumaid.robot import EffectChoice
from pumaid.units import number

Floats = NDArray[np.float64]
Point = dict[str, float]
Ends = tuple[float, float]

#: Families of effects for which a search is made again with the noise that the first leaves.
SLOW = {Family.SPEED, Family.LOAD, Family.TIME, Family.PAYLOAD, Family.TEMPERATURE, Family.GRAVITY, Family.TORQUE}
SLOW |= {Family.CURRENT}
#: Rounds of renewing shapes and loads, at most; rounds in which noise and loads follow the final fit.
MOST_ROUNDS, POLISH = 15, 2
#: A round moved nothing when every parameter moved by less than this share of its standard error.
SETTLED = 0.05
#: A shape moves by at most this share of its scale in one round: beyond, its derivative says little.
LONGEST = 0.5
#: Relative rise of the weighted squares that is rounding.
RISE = 1e-9
#: Fall of twice the log likelihood within which 95 % of chances lie for one parameter.
WITHIN = 3.84
#: Points of a grid from which a refinement starts.
STARTS = 2
#: How many times beyond its grid a shape is looked for.
BEYOND = 2.0
#: Relative step of the refinement's own derivatives, and its relative gain that is not worth another step: the fit of
#: all parameters together goes on from there.
NUDGE, ENOUGH = 1e-4, 1e-4
#: Frequencies of a long grid that are looked at closely, after a periodogram has ranked them; bins of a period of the
#: highest of them, and of its resolution.
SHORTLIST, PERIOD = 24, 8
#: Share of a column's squares beyond what is fitted already, below which there is only rounding.
NOTHING = 1e-9
#: How much worse a joint may be met with more effects: each is weighted by its noise, so a little is no fault; and the
#: share of its current below which a misfit is nothing.
WORSE, VISIBLE = 1.5, 1e-3
#: First step of a search for an interval's end, in standard errors, and by how much steps grow; steps to each side at
#: most; and the precision to which the other shapes are found at each, in their scale.
STRIDE, GROWTH, MOST_STRIDES, PRECISE = 0.5, 1.5, 12, 1e-2


@dataclass(frozen=True, eq=False, slots=True)
class Refit:
    """An effect added to a fit that is linearised.

    Attributes
    ----------
    gain
        Fall of the weighted squares.
    values, half
        (p,) its linear parameters and (p, k) half of their covariance: ``half half'``.
    shift
        (P, p): by how much all that was fitted before moves with each of them.
    """

    gain: float
    values: Floats
    half: Floats
    shift: Floats


class Linearised:
    """A fit whose bins tell what any further effect would add, all else refitted; loads are those of `whole`."""

    def __init__(self, fit: Fit, term: EffectTerm, *, at_nodes: bool, whole: Fit) -> None:
        self.fit, self.at_nodes, self.robot = fit, at_nodes, fit.model.robot
        self.rows = [fit.row(row.joint) for row in fit.rows if term.touches(row.joint)]
        self.extent = extent([row.bins for row in self.rows], 0 if term.effect.scope is Scope.ARM else term.number)
        self.samples = []
        for row in self.rows:
            points = row.bins.nodes[0] if at_nodes else row.bins.samples
            sizes = (3 if at_nodes else 1) * row.bins.lengths
            self.samples.append(with_loads(whole, points, sizes) if term.effect.needs_loads else points)

    def added(self, terms: Sequence[EffectTerm], *, limits: Floats | None = None) -> list[Refit]:
        """An effect with each of some shapes, without its derivatives, its linear parameters held by priors.

        `limits` (p,) are their prior deviations; where not given, those that a fit with this shape has.
        """
        count, out, peaks = len(terms), [], []
        width = len(terms[0].effect.parameters(self.robot, terms[0].number))
        gram, cross = np.zeros((count, width, width)), np.zeros((count, width))
        overlap = np.zeros((len(self.fit.inverse), count * width))
        for row, samples in zip(self.rows, self.samples, strict=True):
            table = columns_each(terms, self.robot, samples)
            table = row.bins.averaged(table) if self.at_nodes else table
            white = row.noise.whiten(row.bins, table)
            peaks.append(np.abs(table).max(axis=0))
            overlap[row.acting] += row.slim.T @ white
            cross += (row.residual @ white).reshape(count, width)
            by_term = white.reshape(-1, count, width).transpose(1, 2, 0)
            gram += by_term @ by_term.transpose(0, 2, 1)
        spans = [column.span for column in replace(terms[0], fitted=()).parts(self.robot, 0)]
        bins = [row.bins for row in self.rows]
        for k in range(count):
            place = slice(k * width, (k + 1) * width)
            peak = np.array(peaks)[:, place].T.tolist()
            usual = [plausible(list(zip(bins, row, strict=True)), span) for row, span in zip(peak, spans, strict=True)]
            shift = -self.fit.inverse @ overlap[:, place]
            raw, beyond = np.diag(gram[k]), gram[k] + overlap[:, place].T @ shift
            size = np.sqrt(np.where(raw > 0, raw, 1.0))
            scale = np.maximum((np.array(usual) if limits is None else limits) * size, NOTHING)
            values, vectors = np.linalg.eigh(beyond / np.outer(size, size) + np.diag(scale**-2.0))
            is_shown = values > NOTHING
            half = vectors[:, is_shown] / np.sqrt(values[is_shown]) / size[:, None]
            solution = half @ (half.T @ cross[k])
            out.append(Refit(float(solution @ cross[k]), solution, half, shift))
        return out

    def grid(self, term: EffectTerm) -> list[Point]:
        """Where a search begins, given shapes kept; of many frequencies those that are strongest in the misfit."""
        points = _distinct({**point, **term.shape} for point in term.effect.grid(self.robot, self.extent))
        periodic = term.effect.periodic
        if periodic is None or periodic in term.shape or len(points) <= SHORTLIST:
            return points
        frequencies = np.array([point[periodic] for point in points])
        row = next(row for row in self.rows if row.bins.joint == term.number)
        q = row.bins.samples.position[:, term.number - 1]
        step = 2.0 * np.pi / (PERIOD * float(frequencies.max()))
        where = np.round((q - float(q.min())) / step).astype(np.int64)
        size = 2 ** int(np.ceil(np.log2((where.max() + 1) * PERIOD)))
        line = np.bincount(where, weights=row.bins.count * row.misfit, minlength=size)
        spectrum = np.abs(np.fft.rfft(line)) ** 2
        at = np.round(frequencies * step * size / (2.0 * np.pi)).astype(np.int64)
        power = spectrum[np.minimum(at, len(spectrum) - 1)]
        return [points[k] for k in sorted(np.argsort(-power, kind="stable")[:SHORTLIST])]


def _distinct(points: Iterable[Point]) -> list[Point]:
    return list({tuple(sorted(point.items())): point for point in points}.values())


def search_shape(ground: Linearised, term: EffectTerm, free: Sequence[str]) -> tuple[EffectTerm, dict[str, Ends]]:
    """The effect with the shape that explains most of what a fit leaves, and what the data leave open of it at 95 %.

    Parameters
    ----------
    ground
        The fit without it.
    term
        The effect, with the shapes that are given.
    free
        Names of the shapes to look for; what is open is told by name of those without derivative (an instant, a whole
        number).
    """
    shapes = term.shapes(ground.robot)
    fixed = [name for name in free if not shapes[name].is_searched]
    grid = ground.grid(term)
    gains = np.array([refit.gain for refit in ground.added([term.at(point) for point in grid])])
    if fixed:
        grid = _closer(ground, term, grid, grid[int(np.argmax(gains))])
        gains = np.array([refit.gain for refit in ground.added([term.at(point) for point in grid])])
    order = np.argsort(-gains, kind="stable")
    ends = [(grid[order[0]], float(gains[order[0]]))]
    if len(fixed) < len(free):
        bounds = {name: search_bounds(shapes[name], grid) for name in free if name not in fixed}
        ends += [_refined(ground, term, grid[start], bounds) for start in order[:STARTS]]
    best = max(ends, key=lambda end: end[1])[0]
    ranges = {name: _range(shapes[name], grid, gains, starts=ground.extent.starts) for name in fixed}
    return term.at({name: best[name] for name in free}), ranges


def search_bounds(shape: Shape, grid: Sequence[Mapping[str, float]]) -> Ends:
    """Between which values a shape is looked for: not far beyond its grid, which spans what the runs cover.

    A fall of friction at a speed far beyond all that were run, say, is only another curve of viscous friction.
    """
    values = [point[shape.name] for point in grid]
    if shape.low < 0.0 or min(values) <= 0.0 or min(values) == max(values):
        return shape.low, shape.high
    return max(shape.low, min(values) / BEYOND), min(shape.high, max(values) * BEYOND)


def _closer(ground: Linearised, term: EffectTerm, grid: list[Point], best: Point) -> list[Point]:
    """A grid of instants, closer about the best: where runs are many it skips some."""
    for name, value in best.items():
        if term.shapes(ground.robot)[name].unit == "s":
            instants, starts = sorted(point[name] for point in grid), ground.extent.starts
            place = instants.index(value)
            first = bisect_right(starts, instants[max(place - 1, 0)]) - 1
            last = bisect_right(starts, instants[min(place + 1, len(instants) - 1)])
            near = replace(ground.extent, starts=starts[max(first, 0) : last + 1])
            grid = _distinct([*grid, *({**best, **point} for point in term.effect.grid(ground.robot, near))])
    return grid


def _refined(ground: Linearised, term: EffectTerm, start: Point, bounds: Mapping[str, Ends]) -> tuple[Point, float]:
    """The best shape near a point of the grid between `bounds`, each measured by its own scale; and its gain."""
    from scipy import optimize  # it takes as long to load as an identification

    shapes, middle = term.shapes(ground.robot), np.array([start[name] for name in bounds])
    scales = np.array([scale_of(shapes[name], start[name]) for name in bounds])

    def at(step: Floats) -> Point:
        return start | dict(zip(bounds, (middle + scales * step).tolist(), strict=True))

    def cost(step: Floats) -> tuple[float, Floats]:
        nudges = np.where(step + NUDGE <= high, NUDGE, -NUDGE)
        points = [step, *(step + np.diag(nudges))]
        costs = -np.array([refit.gain for refit in ground.added([term.at(at(point)) for point in points])])
        return float(costs[0]), (costs[1:] - costs[0]) / nudges

    low, high = ((np.array(list(bounds.values())) - middle[:, None]) / scales[:, None]).T
    limits = optimize.Bounds(low, high)
    optimum = optimize.minimize(
        cost, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=limits, options={"ftol": ENOUGH}
    )
    return at(optimum.x), -float(optimum.fun)


def _range(shape: Shape, grid: Sequence[Point], gains: Floats, *, starts: Sequence[float]) -> Ends:
    """Lowest and highest value of a shape that the data do not exclude; an instant lies anywhere between two starts."""
    likely = [point[shape.name] for point, gain in zip(grid, gains, strict=True) if gain >= gains.max() - WITHIN]
    low, high = min(likely), max(likely)
    if shape.unit == "s":
        low = max((start for start in starts if start <= low), default=low)
        high = min((start for start in starts if start >= high), default=high)
    return low, high


@dataclass(frozen=True, eq=False)
class EffectFit:
    """A fit with its effects.

    Attributes
    ----------
    fit
        The fit, in a model whose effects have their shapes.
    ranges
        (place of the effect, shape) -> lowest and highest value that the data leave open, of shapes without derivative.
    is_settled
        Whether the last round moved nothing any more.
    search
        What it came from, for looking at its likelihood; None where there are no effects.
    """

    fit: Fit
    ranges: Mapping[tuple[int, str], Ends] = field(default_factory=dict)
    is_settled: bool = True
    search: ShapeSearch | None = None

    @property
    def shapes(self) -> tuple[Point, ...]:
        """Shapes of each effect: what the model has, moved by the fit's last step."""
        model = self.fit.model
        out = [dict(term.shape) for term in model.effects]
        for column, value in zip(model.columns, self.fit.values, strict=True):
            if column.place is not None and column.shape is not None:
                facts = model.effects[column.place].shapes(model.robot)[column.shape]
                moved = out[column.place][column.shape] + float(value)
                out[column.place][column.shape] = _clipped(facts, moved)
        return tuple(out)


def fit_effects(
    model: Model,
    runs: Sequence[Run],
    choices: Sequence[EffectChoice],
    *,
    campaign: Campaign,
    recursive: bool = False,
    progress: Progress | None = None,
) -> EffectFit:
    """Fit the arm's base model and chosen effects together.

    Effects whose shapes are known come first; then one free effect after the other is looked for where the fit so far
    leaves something; then all shapes are moved together by Gauss and Newton's steps, loads renewed in each round.

    Parameters
    ----------
    model
        The base model that `runs` ask for.
    runs
        To be fitted.
    choices
        One joint each, or the whole arm.
    campaign
        When the joints first moved.
    recursive, progress
        As for `fit_bins`.

    Raises
    ------
    ModelError [effects-astray]
        The fit with the effects is far worse than without.

    Source
    ------
    G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432: what is linear is refitted at every shape.
    """
    wanted = terms_of(choices)
    bins = bins_for(model, runs, wanted, campaign=campaign)
    if not choices:
        return EffectFit(fit_bins(model, bins, recursive=recursive, progress=progress))
    tell = progress or (lambda joint, text: None)
    work = ShapeSearch(model, bins, wanted)
    before, moving = rmse_by_joint(work.fit), {part.joint for part in bins}
    for place, term in enumerate(wanted):
        free = _free(term, model)
        if free and not any(term.touches(joint) for joint in moving):
            work.terms[place] = term.at({name: term.shapes(model.robot)[name].example for name in free})
        elif free:
            tell(term.number, f"looking for {' and '.join(free)} of {term.effect.name}")
            work.look(place, term, free)
        elif term.effect.needs_loads:
            work.terms[place] = term
            work.refit()
    tell(0, "refining all effects together")
    is_settled = work.settle()
    work.finish(recursive=recursive, progress=progress)
    check_better(before, work.fit, [term.effect.name for term in wanted])
    return EffectFit(eased(work.fit), work.ranges, is_settled, work)


def bins_for(
    model: Model, runs: Sequence[Run], terms: Sequence[EffectTerm], *, campaign: Campaign
) -> tuple[JointBins, ...]:
    """The bins that a fit with these effects needs: the finest at joints that have a periodic one."""
    fine = {term.joint for term in terms if term.effect.periodic is not None}
    out: list[JointBins] = []
    for limit, chosen in ((COARSE, False), (FINE, True)):
        part = [run for run in runs if (run.joint in fine) == chosen]
        out += joint_bins(model.robot, part, most=limit, campaign=campaign, is_settled=False) if part else ()
    return tuple(sorted(out, key=lambda part: part.joint))


def check_better(before: Mapping[int, float], fitted: Fit, names: Sequence[str]) -> None:
    """Refuse a fit with effects of these `names` that meets a joint far worse than `before`, RMSE (A) by joint.

    Raises
    ------
    ModelError [effects-astray]
        A joint is missed by `WORSE` times as much.
    """
    current = {row.joint: float(np.sqrt(row.bins.mean_square)) for row in fitted.rows}
    for joint, size in rmse_by_joint(fitted).items():
        was = before.get(joint, np.inf)
        if size > WORSE * was and size > VISIBLE * current[joint]:
            what = f"the fit with {', '.join(names)} misses joint {joint} by {number(size)} A"
            what = f"{what}, without by {number(was)} A: it went astray"
            mend = "give its shape, as in --add payload:time=400, or add fewer effects; nothing was written"
            raise ModelError("effects-astray", what, Where(joint=joint), mend)


def _free(term: EffectTerm, model: Model) -> list[str]:
    """Shapes that are not given."""
    return [name for name in term.shapes(model.robot) if name not in term.shape]


class ShapeSearch:
    """A fit that grows: `terms` by place, and the `fit` of those so far."""

    def __init__(self, model: Model, bins: Sequence[JointBins], wanted: Sequence[EffectTerm]) -> None:
        self.model, self.bins = model, bins
        self.terms = {n: t for n, t in enumerate(wanted) if not _free(t, model) and not t.effect.needs_loads}
        self.ranges: dict[tuple[int, str], Ends] = {}
        self.fit = fit_bins(self.now(), bins)

    def now(self) -> Model:
        """The model with the effects so far, in order."""
        return self.model.with_effects([self.terms[place] for place in sorted(self.terms)])

    def refit(self) -> None:
        """The quick fit of the effects so far."""
        self.fit = refit(self.fit, self.now())

    def look(self, place: int, term: EffectTerm, free: Sequence[str]) -> None:
        """One more effect, some of its shapes to be looked for.

        What it explains passes for noise at first, most of all where it is the same throughout a run; so the search is
        made again with the noise that is left with it.
        """
        shapes = term.shapes(self.model.robot)
        for _ in range(2 if term.effect.family in SLOW else 1):
            self.terms[place], ranges = search_shape(self.without(place, term, at_nodes=False), term, free)
            self.ranges |= {(place, name): ends for name, ends in ranges.items()}
            self.fit = releveled(refit(self.fit, self.now(), is_renewed=True))
        fitted = tuple(name for name in free if shapes[name].is_searched)
        self.terms[place] = replace(self.terms[place], fitted=fitted, sizes=self._sizes(place))

    def without(self, place: int, term: EffectTerm | None = None, *, at_nodes: bool = True) -> Linearised:
        """The fit of all effects but the one at `place`, where that one (or `term`) may act."""
        rest = [self.terms[other] for other in sorted(self.terms) if other != place]
        fitted = refit(self.fit, self.model.with_effects(rest))
        return Linearised(fitted, term or self.terms[place], at_nodes=at_nodes, whole=self.fit)

    def _rank(self, place: int) -> int:
        """Place in the model of the effects so far."""
        return sorted(self.terms).index(place)

    def _sizes(self, place: int) -> tuple[float, ...]:
        """Linear parameters of an effect by the fit so far."""
        return tuple(self.fit.sizes(self._rank(place)).tolist())

    def settle(self) -> bool:
        """Renew loads and shapes until nothing moves; whether that happened."""
        if not any(term.fitted or term.effect.needs_loads for term in self.terms.values()):
            return True
        before: dict[str, float] = {}
        last, cost = dict(self.terms), np.inf
        for _ in range(MOST_ROUNDS):
            now = self._cost_of_shapes()
            if now > cost * (1.0 + RISE) and any(last[n].shape != term.shape for n, term in self.terms.items()):
                self.terms = {place: _half_way(last[place], term) for place, term in self.terms.items()}
                continue
            self.refit()
            values = dict(zip(self.fit.model.names, self.fit.values, strict=True))
            moved = self._moved(values, before)
            last, cost, before = dict(self.terms), now, values
            if moved < SETTLED:
                return True
            self.terms = {place: self._stepped(place, term) for place, term in self.terms.items()}
        return False

    def _cost_of_shapes(self) -> float:
        """Weighted squares that the fit leaves at these shapes, whose derivatives are then taken at its sizes."""
        if not any(term.fitted for term in self.terms.values()):
            return 0.0
        full = dict(self.terms)
        self.terms = {place: replace(term, fitted=()) for place, term in full.items()}
        self.refit()
        self.terms = {place: replace(term, sizes=self._sizes(place)) for place, term in full.items()}
        return self.fit.square

    def finish(self, *, recursive: bool, progress: Progress | None) -> None:
        """The whole fit, noise included; loads follow it, so that what only looks like another load is known to."""
        now = self.now()
        start = fit_bins(now, self.bins, before=self.fit, recursive=True, progress=progress)
        if recursive:
            self.fit = start
            return
        for _ in range(POLISH):
            self.fit = refit(releveled(refit(self.fit, now, is_renewed=True)), now)
        self.fit = replace(with_chain_rule(self.fit), first=start.first)

    def _moved(self, values: Mapping[str, float], before: Mapping[str, float]) -> float:
        """Largest move of a parameter, or step of a shape that is due, in standard errors."""
        columns = self.fit.model.columns
        errors = np.sqrt(np.diag(self.fit.inverse))[: len(columns)]
        starts = np.array([0.0 if column.shape else before.get(column.name, np.inf) for column in columns])
        moves = np.abs(np.array(list(values.values())) - starts)
        return float(np.max(moves[errors > 0.0] / errors[errors > 0.0], initial=0.0))

    def _stepped(self, place: int, term: EffectTerm) -> EffectTerm:
        """An effect with its shapes moved by the fit's step, within bounds."""
        shape, held = dict(term.shape), list(term.held)
        for n in self.fit.columns_of(self._rank(place)):
            name = self.fit.model.columns[n].shape
            if name is None or name in held:
                continue
            facts, now = term.shapes(self.model.robot)[name], shape[name]
            longest = LONGEST * scale_of(facts, now)
            shape[name] = _clipped(facts, now + float(np.clip(self.fit.values[n], -longest, longest)))
            if now == shape[name] and now in (facts.low, facts.high):
                held.append(name)
        return replace(term.at(shape, term.sizes), held=tuple(held))


def _clipped(shape: Shape, value: float) -> float:
    return min(max(value, shape.low), shape.high)


def _half_way(start: EffectTerm, end: EffectTerm) -> EffectTerm:
    """The shapes half way between two."""
    return end.at({name: 0.5 * (start.shape[name] + value) for name, value in end.shape.items()}, end.sizes)


@dataclass(eq=False, slots=True)
class Profile:
    """The likelihood of one effect's shapes about their best values, everything else refitted at each.

    Attributes
    ----------
    ground
        The fit without the effect, with the noise that is left with it.
    term
        The effect at its best shape.
    limits
        (p,) prior deviations of its linear parameters, those at its best shape: what is plausible does not grow where a
        shape hides what a parameter does.
    path
        Shapes looked at so far, and the fits with them.

    Source
    ------
    D. M. Bates and D. G. Watts, Nonlinear Regression Analysis and Its Applications, Wiley 1988, section 6.1.
    """

    ground: Linearised
    term: EffectTerm
    limits: Floats
    path: list[tuple[Point, Refit]] = field(default_factory=list)

    def shape(self, name: str, *, error: float, reach: float) -> Ends:
        """Ends of the interval of one fitted shape, `reach` standard errors wide; `error` is that by the tangent."""
        best = self._at(dict(self.term.shape))
        sides = [self._walk(name, best, stride=way * STRIDE * error, rise=reach**2) for way in (-1.0, 1.0)]
        return sides[0], sides[1]

    def linear(self, reach: Floats) -> Floats:
        """(p, 2) ends of the linear parameters' intervals, (p,) standard errors wide: the envelope at all shapes."""
        values = np.array([refit.values for _, refit in self.path])
        errors = np.array([np.linalg.norm(refit.half, axis=1) for _, refit in self.path])
        return self._envelope(values, errors, reach)

    def others(self, reach: Floats) -> Floats:
        """(P, 2) the same of all that was fitted before, parameters and ratios."""
        fitted = self.ground.fit
        start, variances = np.append(fitted.values, fitted.gains.ratios), np.diag(fitted.inverse)
        values = np.array([start + refit.shift @ refit.values for _, refit in self.path])
        errors = [np.sqrt(variances + np.sum((refit.shift @ refit.half) ** 2, axis=1)) for _, refit in self.path]
        return self._envelope(values, np.array(errors), reach)

    def _envelope(self, values: Floats, errors: Floats, reach: Floats) -> Floats:
        """(P, 2) lowest and highest ends of intervals at (K, P) values, narrower where the likelihood is lower."""
        gains = np.array([refit.gain for _, refit in self.path])
        remaining = reach**2 - (gains.max() - gains)[:, None]
        widths = np.where(remaining > 0.0, np.sqrt(np.maximum(remaining, 0.0)) * errors, -np.inf)
        return np.column_stack([np.min(values - widths, axis=0), np.max(values + widths, axis=0)])

    def _at(self, shape: Point) -> tuple[Point, Refit]:
        (refit,) = self.ground.added([self.term.at(shape)], limits=self.limits)
        self.path.append((shape, refit))
        return self.path[-1]

    def _walk(self, name: str, best: tuple[Point, Refit], *, stride: float, rise: float) -> float:
        """The end of an interval on one side: where the squares have risen by `rise`, or a bound."""
        facts = self.term.shapes(self.ground.robot)[name]
        (shape, before), step = best, stride
        for _ in range(MOST_STRIDES):
            value = _clipped(facts, shape[name] + step)
            there, refit = self._best(name, value, shape)
            lost, earlier = best[1].gain - refit.gain, max(best[1].gain - before.gain, 0.0)
            if lost >= rise:
                share = (np.sqrt(rise) - np.sqrt(earlier)) / (np.sqrt(lost) - np.sqrt(earlier))
                return float(shape[name] + share * (value - shape[name]))
            if value in (facts.low, facts.high):
                return value
            shape, before, step = there, refit, step * GROWTH
        return shape[name]

    def _best(self, name: str, value: float, before: Point) -> tuple[Point, Refit]:
        """The place with this value at which the other fitted shapes are best, from those of the step before."""
        facts = self.term.shapes(self.ground.robot)
        free = [facts[other] for other in self.term.fitted if other != name]
        point = self._at(before | {name: value})
        for other in free * min(len(free), 2):
            point = self._along(other, point)
        return point

    def _along(self, shape: Shape, start: tuple[Point, Refit]) -> tuple[Point, Refit]:
        """The best place along one shape near `start`."""
        from scipy import optimize

        at, first = start[0][shape.name], len(self.path)
        reach = scale_of(shape, at)
        optimize.minimize_scalar(
            lambda value: -self._at(start[0] | {shape.name: float(value)})[1].gain,
            bounds=(_clipped(shape, at - reach), _clipped(shape, at + reach)),
            method="bounded",
            options={"xatol": PRECISE * reach},
        )
        return max([start, *self.path[first:]], key=lambda point: point[1].gain)
