"""Effects with shapes: looked for on a grid, refined off it, fitted with everything else, their intervals profiled."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import FirstMotions, Run
from pumaid.effect_spec import EffectTerm, scale_of, terms_of
from pumaid.effects import Extent, Family, Scope, Shape
from pumaid.effects.base import MOST_INSTANTS
from pumaid.errors import ModelError, Where
from pumaid.estimation.curves import learned
from pumaid.estimation.fit import Fit, Projector, Refit
from pumaid.estimation.gls import Progress, fit_bins, refit, releveled, with_errors
from pumaid.joint_bins import COARSE, FINE, JointBins, extent, joint_bins
from pumaid.maths import Floats
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot
from pumaid.units import number

Point = dict[str, float]
Ends = tuple[float, float]

#: Families of effects for which a search is made again with the noise that the first leaves.
SLOW = {
    Family.SPEED,
    Family.LOAD,
    Family.TIME,
    Family.PAYLOAD,
    Family.TEMPERATURE,
    Family.GRAVITY,
    Family.TORQUE,
    Family.CURRENT,
}
#: Rounds of renewing shapes and loads, at most; rounds in which noise and loads follow the final fit.
MOST_ROUNDS, POLISH = 15, 2
#: A round moved nothing when every parameter moved by less than this share of its standard error.
SETTLED = 0.05
#: A shape moves by at most this share of its scale in one round: beyond, its derivative says little.
LONGEST = 0.5
#: Fall of twice the log likelihood within which 95 % of chances lie for one parameter.
WITHIN = 3.84
#: Points of a grid from which a refinement starts.
STARTS = 2
#: How many times beyond its grid a shape is looked for.
BEYOND = 2.0
#: Relative step of a refinement's own derivatives; its gain that is not worth another step, relative where a search
#: begins (the fit of all parameters together goes on from there), and of the squares where a likelihood is profiled.
NUDGE, ENOUGH, PRECISE = 1e-4, 1e-4, 1e-3
#: Frequencies of a long grid that are looked at closely, after a periodogram has ranked them; bins of a period of the
#: highest of them, and of its resolution.
SHORTLIST, PERIOD = 24, 8
#: How much worse a joint may be met with more effects: each is weighted by its noise, so a little is no fault; and the
#: share of its current below which a misfit is nothing.
WORSE, VISIBLE = 1.5, 1e-3
#: First step of a search for an interval's end, in standard errors, and by how much steps grow; steps to each side at
#: most.
STRIDE, GROWTH, MOST_STRIDES = 0.5, 1.5, 12


class ShapeLikelihood:
    """The likelihood of one effect's shapes, everything else refitted at each.

    `projector` is of the fit without the effect, `term` the effect with the shapes that are given. `limits` (p,) are
    prior deviations of its linear parameters, where not those at each shape: what is plausible does not grow where a
    shape hides what a parameter does. `path` are the shapes looked at, and the fits with them.

    Source: D. M. Bates and D. G. Watts, Nonlinear Regression Analysis and Its Applications, Wiley 1988, section 6.1.
    """

    def __init__(self, projector: Projector, term: EffectTerm, limits: Floats | None = None) -> None:
        self.projector, self.term, self.limits = projector, term, limits
        self.shapes, self.path = term.shapes(projector.solved.model.robot), list[tuple[Point, Refit]]()

    def at(self, points: Sequence[Point]) -> list[tuple[Point, Refit]]:
        """The fits with some shapes."""
        refits = self.projector.refits([self.term.at(point) for point in points], limits=self.limits)
        self.path += zip(points, refits, strict=True)
        return self.path[-len(points) :]

    def best_near(self, start: Point, bounds: Mapping[str, Ends], *, enough: float) -> tuple[Point, Refit]:
        """The best shape near a start between `bounds`, each measured by its own scale."""
        from scipy import optimize  # it takes as long to load as an identification

        middle, before = np.array([start[name] for name in bounds]), len(self.path)
        scales = np.array([scale_of(self.shapes[name], start[name]) for name in bounds])
        low, high = ((np.array(list(bounds.values())) - middle[:, None]) / scales[:, None]).T

        def cost(step: Floats) -> tuple[float, Floats]:
            nudges = np.where(step + NUDGE <= high, NUDGE, -NUDGE)
            steps = middle + scales * np.array([step, *(step + np.diag(nudges))])
            fits = self.at([start | dict(zip(bounds, values.tolist(), strict=True)) for values in steps])
            costs = -np.array([refit.gain for _, refit in fits])
            return float(costs[0]), (costs[1:] - costs[0]) / nudges

        limits, zero = optimize.Bounds(low, high), np.zeros(len(bounds))
        optimize.minimize(cost, zero, jac=True, method="L-BFGS-B", bounds=limits, options={"ftol": enough})
        return max(self.path[before:], key=lambda fit: fit[1].gain)

    def interval(self, name: str, *, error: float, reach: float) -> Ends:
        """Ends of the interval of one fitted shape, `reach` standard errors wide; `error` is that by the tangent."""
        (best,) = self.at([dict(self.term.shape)])
        sides = [self._walk(name, best, stride=way * STRIDE * error, rise=reach**2) for way in (-1.0, 1.0)]
        return sides[0], sides[1]

    def linear(self, reach: Floats) -> Floats:
        """(p, 2) ends of the linear parameters' intervals, (p,) standard errors wide: the envelope at all shapes."""
        values = np.array([refit.values for _, refit in self.path])
        return self._envelope(values, np.array([np.linalg.norm(refit.half, axis=1) for _, refit in self.path]), reach)

    def others(self, reach: Floats) -> Floats:
        """(P, 2) the same of all that was fitted before, parameters and ratios."""
        fitted = self.projector.solved
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

    def _walk(self, name: str, best: tuple[Point, Refit], *, stride: float, rise: float) -> float:
        facts, (shape, before), step = self.shapes[name], best, stride
        rest = {other: (self.shapes[other].low, self.shapes[other].high) for other in self.term.fitted if other != name}
        for _ in range(MOST_STRIDES):
            value = float(np.clip(shape[name] + step, facts.low, facts.high))
            (near,) = self.at([shape | {name: value}])
            enough = PRECISE / max(abs(near[1].gain), 1.0)
            there, refit = self.best_near(near[0], rest, enough=enough) if rest else near
            lost, earlier = best[1].gain - refit.gain, max(best[1].gain - before.gain, 0.0)
            if lost >= rise:
                share = (np.sqrt(rise) - np.sqrt(earlier)) / (np.sqrt(lost) - np.sqrt(earlier))
                return float(shape[name] + share * (value - shape[name]))
            if value in (facts.low, facts.high):
                return value
            shape, before, step = there, refit, step * GROWTH
        return shape[name]


def search_shape(projector: Projector, term: EffectTerm, free: Sequence[str]) -> tuple[EffectTerm, dict[str, Ends]]:
    """The effect with the shape that explains most of what a fit leaves, and what the data leave open of it at 95 %.

    `projector` is of the fit without it, `free` are the shapes to look for; what is open is told by name of those
    without derivative (an instant, a whole number).
    """
    if term.effect.is_free:
        return learned(projector, term)[0], {}
    likelihood, robot = ShapeLikelihood(projector, term), projector.solved.model.robot
    shapes, effect = likelihood.shapes, term.effect
    rows = [row.bins for row in projector.solved.joints if term.touches(row.bins.joint)]
    covered = extent(rows, 0 if effect.scope is Scope.ARM else term.number)
    fixed = [name for name in free if not shapes[name].is_searched]
    fits = likelihood.at(_grid(projector, term, covered))
    best = max(fits, key=lambda fit: fit[1].gain)
    for name in (name for name in fixed if shapes[name].unit == "s"):
        near = covered
        while len(near.starts) > MOST_INSTANTS + 1:
            near = near.nearer(best[0][name])
            fits += likelihood.at([{**best[0], **point} for point in effect.grid(robot, near)])
            best = max(fits, key=lambda fit: fit[1].gain)
    fits.sort(key=lambda fit: -fit[1].gain)
    best, ranges = fits[0], dict[str, Ends]()
    likely = [point for point, refit in fits if refit.gain >= best[1].gain - WITHIN]
    for name in fixed:
        low, high = min(point[name] for point in likely), max(point[name] for point in likely)
        if shapes[name].unit == "s":  # anywhere between two starts
            low = max((start for start in covered.starts if start <= low), default=low)
            high = min((start for start in covered.starts if start >= high), default=high)
        ranges[name] = low, high
    if len(fixed) < len(free):
        grid = [point for point, _ in fits]
        bounds = {name: search_bounds(shapes[name], grid) for name in free if name not in fixed}
        ends = [likelihood.best_near(start, bounds, enough=ENOUGH) for start in grid[:STARTS]]
        best = max([best, *ends], key=lambda fit: fit[1].gain)
    return term.at({name: best[0][name] for name in free}), ranges


def _grid(projector: Projector, term: EffectTerm, covered: Extent) -> list[Point]:
    """Where a search begins, given shapes kept; of many frequencies those that are strongest in the misfit."""
    points = [{**point, **term.shape} for point in term.effect.grid(projector.solved.model.robot, covered)]
    points = [point for n, point in enumerate(points) if point not in points[:n]] if term.shape else points
    periodic = term.effect.periodic
    if periodic is None or periodic in term.shape or len(points) <= SHORTLIST:
        return points
    frequencies, row = np.array([point[periodic] for point in points]), projector.solved.by_bin[term.number]
    q = row.bins.samples.position[:, term.number - 1]
    step = 2.0 * np.pi / (PERIOD * float(frequencies.max()))
    where = np.round((q - float(q.min())) / step).astype(np.int64)
    size = 2 ** int(np.ceil(np.log2((where.max() + 1) * PERIOD)))
    spectrum = np.abs(np.fft.rfft(np.bincount(where, weights=row.bins.count * row.misfit, minlength=size))) ** 2
    power = np.interp(np.round(frequencies * step * size / (2.0 * np.pi)), np.arange(len(spectrum)), spectrum)
    return [points[k] for k in sorted(np.argsort(-power, kind="stable")[:SHORTLIST])]


def search_bounds(shape: Shape, grid: Sequence[Mapping[str, float]]) -> Ends:
    """Between which values a shape is looked for: not far beyond its grid, which spans what the runs cover.

    A fall of friction at a speed far beyond all that were run, say, is only another curve of viscous friction.
    """
    values = [point[shape.name] for point in grid]
    if shape.low < 0.0 or min(values) <= 0.0 or min(values) == max(values):
        return shape.low, shape.high
    return max(shape.low, min(values) / BEYOND), min(shape.high, max(values) * BEYOND)


class EffectFit:
    """A fit that grows: `terms` of a model's effects by place, `fit` of those so far, at `bins`.

    `ranges` maps (place of the effect, shape) to the lowest and highest value that the data leave open, of shapes
    without derivative; `is_settled` says whether the last round moved nothing any more.
    """

    fit: Fit

    def __init__(self, model: Model, bins: Sequence[JointBins], wanted: Sequence[EffectTerm]) -> None:
        self.model, self.bins, self.is_settled = model, bins, True
        self.terms = {n: t for n, t in enumerate(wanted) if not self.free(t) and not t.needs_loads}
        self.ranges: dict[tuple[int, str], Ends] = {}

    def free(self, term: EffectTerm) -> list[str]:
        """Shapes that are not given."""
        return [name for name in term.shapes(self.model.robot) if name not in term.shape]

    @property
    def shapes(self) -> tuple[Point, ...]:
        """Shapes of each effect: what the model has, moved by the fit's last step."""
        return tuple(dict(self._stepped(place, term).shape) for place, term in enumerate(self.fit.model.effects))

    def now(self) -> Model:
        """The model with the effects so far, in order."""
        return self.model.with_effects([self.terms[place] for place in sorted(self.terms)])

    def look(self, place: int, term: EffectTerm, free: Sequence[str]) -> None:
        """One more effect, some of its shapes to be looked for.

        What it explains passes for noise at first, most of all where it is the same throughout a run; so the search is
        made again with the noise that is left with it.
        """
        shapes = term.shapes(self.model.robot)
        self.terms[place] = term
        for _ in range(2 if term.effect.family in SLOW or term.effect.is_free else 1):
            self.terms[place], ranges = search_shape(self.without(place, at_nodes=False), term, free)
            self.ranges |= {(place, name): ends for name, ends in ranges.items()}
            self.fit = releveled(refit(self.fit, self.now(), is_renewed=True))
        fitted = tuple(name for name in free if shapes[name].is_searched)
        self.terms[place] = replace(self.terms[place], fitted=fitted, sizes=self._sizes(place))

    def without(self, place: int, *, at_nodes: bool = True) -> Projector:
        """What can be added to the fit of all effects but the one at `place`; beside a payload at its ratios."""
        if self.terms[place].is_carried and len(self.fit.model.effects) == len(self.terms):
            return Projector(self.fit.without(sorted(self.terms).index(place)), at_nodes=at_nodes)
        rest = [self.terms[other] for other in sorted(self.terms) if other != place]
        fitted = refit(self.fit, self.model.with_effects(rest))
        return Projector(fitted, whole=self.fit if self.terms[place].effect.needs_loads else None, at_nodes=at_nodes)

    def _sizes(self, place: int) -> tuple[float, ...]:
        return tuple(self.fit.sizes(sorted(self.terms).index(place)).tolist())

    def settle(self) -> bool:
        """Renew loads and shapes until nothing moves; whether that happened.

        A round fits with the shapes as they are, which tells the cost and the sizes at which derivatives are taken,
        then with these; a step of the shapes that raised the cost is halved.
        """
        has_shapes, moves = any(term.fitted for term in self.terms.values()), dict[str, float]()
        if not has_shapes and not self.now().needs_loads():
            return True
        last, cost = self.terms, np.inf
        for _ in range(MOST_ROUNDS):
            terms, now = self.terms, 0.0
            if has_shapes:
                self.terms = {place: replace(term, fitted=()) for place, term in terms.items()}
                self.fit = refit(self.fit, self.now())
                terms = {place: replace(term, sizes=self._sizes(place)) for place, term in terms.items()}
                now = self.fit.square
            self.terms = terms
            if now > cost * (1.0 + 1e-9) and any(last[n].shape != term.shape for n, term in terms.items()):
                for n, term in terms.items():
                    half = {name: 0.5 * (last[n].shape[name] + value) for name, value in term.shape.items()}
                    terms[n] = term.at(half, term.sizes)
                continue
            self.fit = refit(self.fit, self.now())
            columns, values = self.fit.model.columns, self.fit.values
            errors = np.sqrt(np.diag(self.fit.inverse))[: len(columns)]
            starts = np.array([0.0 if column.shape else moves.get(column.name, np.inf) for column in columns])
            moved = np.abs(values - starts)[errors > 0.0] / errors[errors > 0.0]
            last, cost, moves = terms, now, dict(zip(self.fit.model.names, values.tolist(), strict=True))
            if moved.max(initial=0.0) < SETTLED:
                return True
            self.terms = {place: self._stepped(place, term) for place, term in terms.items()}
        return False

    def _stepped(self, place: int, term: EffectTerm) -> EffectTerm:
        shape, held = dict(term.shape), list(term.held)
        for n in self.fit.columns_of(sorted(self.terms).index(place)):
            name = self.fit.model.columns[n].shape
            if name is None or name in held:
                continue
            facts, now = term.shapes(self.model.robot)[name], shape[name]
            longest = LONGEST * scale_of(facts, now)
            moved = now + float(np.clip(self.fit.values[n], -longest, longest))
            shape[name] = float(np.clip(moved, facts.low, facts.high))
            if now == shape[name] and now in (facts.low, facts.high):
                held.append(name)
        return replace(term.at(shape, term.sizes), held=tuple(held))


def fit_effects(
    model: Model,
    runs: Sequence[Run],
    choices: Sequence[EffectChoice],
    *,
    begun: FirstMotions | None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> EffectFit:
    """Fit the arm's base model and chosen effects together.

    `model` is the base model that `runs` ask for, `choices` have one joint each, or the whole arm. Effects whose shapes
    are known come first; then one free effect after the other is looked for where the fit so far leaves something; then
    all shapes are moved together by Gauss and Newton's steps, loads renewed in each round. Raises ModelError
    (effects-astray) where the fit with the effects is far worse than without.

    Source: G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432: what is linear is refitted at every
    shape.
    """
    wanted = terms_of(choices)
    work = EffectFit(model, effect_bins(model.robot, runs, wanted, begun=begun), wanted)
    if not choices:
        work.fit = fit_bins(model, work.bins, recursive=recursive, progress=progress)
        return work
    tell = progress or (lambda joint, text: None)
    work.fit = fit_bins(work.now(), work.bins)
    before = {joint: row.rmse for joint, row in work.fit.by_bin.items()}
    for place, term in enumerate(wanted):
        free = work.free(term)
        if free and not any(term.touches(joint) for joint in before):
            work.terms[place] = term.at({name: term.shapes(model.robot)[name].example for name in free})
        elif free:
            tell(term.number, f"looking for {' and '.join(free)} of {term.effect.name}")
            work.look(place, term, free)
        elif term.needs_loads:
            work.terms[place] = term
            work.fit = refit(work.fit, work.now())
    tell(0, "refining all effects together")
    work.is_settled, now = work.settle(), work.now()
    # The whole fit, noise included; loads follow it, so that what only looks like another load is known to.
    start = fit_bins(now, work.bins, before=work.fit, recursive=True, progress=progress)
    for _ in range(0 if recursive else POLISH):
        work.terms = {n: replace(t, sizes=work._sizes(n)) if t.is_carried else t for n, t in work.terms.items()}
        now = work.now()
        work.fit = refit(releveled(refit(work.fit, now, is_renewed=True)), now)
    work.fit = start if recursive else replace(with_errors(work.fit), first=start.first)
    check_better(before, work.fit, [term.effect.name for term in wanted])
    return work


def effect_bins(
    robot: Robot, runs: Sequence[Run], terms: Sequence[EffectTerm], *, begun: FirstMotions | None
) -> list[JointBins]:
    """The bins of each joint that moves, by which a model with some effects is fitted: where it ripples the finest."""
    fine, binned = {term.joint for term in terms if term.effect.periodic is not None}, list[JointBins]()
    for limit, is_fine in ((COARSE, False), (FINE, True)):
        part = [run for run in runs if (run.joint in fine) == is_fine]
        binned += joint_bins(robot, part, most=limit, begun=begun, is_settled=False, finest=fine)
    return sorted(binned, key=lambda part: part.joint)


def check_better(before: Mapping[int, float], fitted: Fit, names: Sequence[str]) -> None:
    """Refuse (effects-astray) a fit with effects of these `names` that misses a joint by `WORSE` times as much as
    `before`, RMSE (A) by joint."""
    current = {row.joint: float(np.sqrt(row.bins.mean_square)) for row in fitted.rows}
    for joint, row in fitted.by_bin.items():
        was, size, where = before.get(joint, np.inf), row.rmse, Where(joint=joint)
        if size > WORSE * was and size > VISIBLE * current[joint]:
            miss = f"misses joint {joint} by {number(size)} A, without by {number(was)} A"
            mend = "give its shape, as in --add payload:time=400, or add fewer effects; nothing was written"
            raise ModelError("effects-astray", f"the fit with {', '.join(names)} {miss}: it went astray", where, mend)
