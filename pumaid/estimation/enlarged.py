"""A fit with effects beyond the paper's model: shapes looked for, loads and derivatives renewed until all settle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.chosen import Chosen, in_order, scale_of
from pumaid.dataset import Run
from pumaid.effects import Family
from pumaid.equations import Block
from pumaid.estimation.gauge import Gauge, gauge_of
from pumaid.estimation.ground import Ground
from pumaid.estimation.misfit import check_better, missed
from pumaid.estimation.shapes import look
from pumaid.estimation.system import Fitted, Progress, again, eased, releveled, solve, stroke_noise
from pumaid.estimation.views import Sights, loaded, sights
from pumaid.model import Model
from pumaid.preprocessing.binning import coarser
from pumaid.records import Campaign
from pumaid.robot import EffectChoice

Floats = NDArray[np.float64]

#: Searches for a shape, the second with the noise that the first leaves.
SEARCHES = 2

#: Families of effects that are the same within a stretch of a run as long as a few of its bins.
SLOW = (
    *(Family.SPEED, Family.LOAD, Family.TIME, Family.PAYLOAD),
    *(Family.TEMPERATURE, Family.GRAVITY, Family.TORQUE, Family.CURRENT),
)

#: Bins a run in which these are looked for.
COARSE = 64

#: Rounds of renewing shapes and loads, at most.
MOST_ROUNDS = 15

#: Rounds in which the loads follow the final fit.
POLISH = 2

#: A round moved nothing when every parameter moved by less than this share of its standard error.
SETTLED = 0.05

#: A shape moves by at most this share of its scale in one round: beyond, its derivative says little.
LONGEST = 0.5

#: Relative rise of the weighted squares that is rounding.
RISE = 1e-9


@dataclass(frozen=True, eq=False, slots=True)
class Enlarged:
    """A fit with its effects.

    Attributes
    ----------
    fitted
        The fit, in a model whose effects have their shapes.
    sights
        The joints on which effects act, with loads.
    ranges
        (place of the effect, shape) -> lowest and highest value that the data leave open, of shapes without derivative.
    is_settled
        Whether the last round moved nothing any more.
    gauge
        What the data show of effects only together with the paper's model.
    without
        Place of an effect -> the fit without it, for looking at its likelihood; None where there are no effects.
    """

    fitted: Fitted
    sights: Sights = field(default_factory=dict)
    ranges: Mapping[tuple[int, str], tuple[float, float]] = field(default_factory=dict)
    is_settled: bool = True
    gauge: Gauge | None = None
    without: Callable[[int], Ground] | None = None

    @property
    def shapes(self) -> tuple[dict[str, float], ...]:
        """Shapes of each effect: what the model has, moved by the fit's last step."""
        model, values = self.fitted.model, self.fitted.solution.values
        out = [dict(one.choice.shape) for one in model.effects]
        for column, value in zip(model.columns, values, strict=True):
            if column.place is not None and column.shape is not None:
                facts = model.effects[column.place].shapes(model.robot)[column.shape]
                moved = out[column.place][column.shape] + float(value)
                out[column.place][column.shape] = min(max(moved, facts.low), facts.high)
        return tuple(out)


def enlarged(
    model: Model,
    runs: Sequence[Run],
    choices: Sequence[EffectChoice],
    *,
    campaign: Campaign,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Enlarged:
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
        As for `solve`.

    Raises
    ------
    ModelError [effects-astray]
        The fit with the effects is far worse than without.

    Source
    ------
    G. H. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413-432: what is linear is refitted at every shape.
    """
    if not choices:
        return Enlarged(solve(model, runs, recursive=recursive, progress=progress))
    tell = progress or (lambda joint, text: None)
    wanted = in_order(choices)
    work = _Work.begun(model, runs, wanted, campaign=campaign)
    before = missed(work.fitted)
    for place, one in enumerate(wanted):
        free = _free(one, model)
        if free and not any(one.touches(joint) for joint in work.seen):
            work.chosen[place] = one.at({name: one.shapes(model.robot)[name].example for name in free})
        elif free:
            tell(one.number, f"looking for {' and '.join(free)} of {one.effect.name}")
            work.look(place, one, free)
        elif one.effect.needs_loads:
            work.add(place, one)
    tell(0, "refining all effects together")
    is_settled = work.settle()
    seen = work.finish(recursive=recursive, progress=progress)
    check_better(before, work.fitted, [one.effect.name for one in wanted])
    return Enlarged(eased(work.fitted), seen, work.ranges, is_settled, work.gauge, work.without)


def _free(one: Chosen, model: Model) -> list[str]:
    """Shapes that are not given."""
    return [name for name in one.shapes(model.robot) if name not in one.choice.shape]


class _Work:
    """A fit that grows: `chosen` by place, `fitted` and the `blocks` that it is of, `bare` ones of the base model.

    `seen` are the runs in all their bins, `thin` in a few.
    """

    def __init__(self, model: Model, runs: Sequence[Run], *, seen: Sights, thin: Sights) -> None:
        self.model, self.runs, self.seen, self.thin = model, runs, seen, thin
        self.chosen: dict[int, Chosen] = {}
        self.ranges: dict[tuple[int, str], tuple[float, float]] = {}
        self.fitted: Fitted
        self.bare: list[Block]
        self.blocks: list[Block]
        self.gauge: Gauge | None = None

    @classmethod
    def begun(cls, model: Model, runs: Sequence[Run], wanted: Sequence[Chosen], *, campaign: Campaign) -> _Work:
        """With the effects that wait for nothing."""
        every = model.with_effects(wanted)
        slow = any(_free(one, model) and one.effect.family in SLOW for one in wanted)
        thin = [replace(r, bins=coarser([r.bins], COARSE)) for r in runs] if slow else []
        noise = stroke_noise(model, runs)
        seen, coarse = (sights(every, some, campaign, noise=noise) for some in (runs, thin))
        work = cls(model, runs, seen=seen, thin=coarse)
        ready = {n: one for n, one in enumerate(wanted) if not _free(one, model) and not one.effect.needs_loads}
        work.chosen = ready
        now = work.now()
        work.bare = model.blocks(runs, noise=noise)
        work.blocks = now.widened(work.bare, work.seen)
        work.fitted = solve(now, runs, blocks=work.blocks)
        if work.chosen:
            work.refit()
        return work

    @property
    def convention(self) -> Floats | None:
        """Sums of the effects' parameters that are held at 0."""
        return None if self.gauge is None else self.gauge.rows

    def now(self) -> Model:
        """The model with the effects so far, in order."""
        return self.model.with_effects([self.chosen[place] for place in sorted(self.chosen)])

    def loaded(self, extra: Sequence[Chosen] = (), *, seen: Sights | None = None) -> Sights:
        """The sights with loads by the fit so far, if an effect of it (or an `extra` one) needs them."""
        seen = self.seen if seen is None else seen
        model, values = self.fitted.model, self.fitted.solution.values
        if not any(one.effect.needs_loads for one in (*self.chosen.values(), *extra)):
            return seen
        return loaded(seen, model, solution=values, scales=self.fitted.scales())

    def refit(self) -> None:
        """The quick fit of the effects so far."""
        now, before = self.now(), self.fitted
        self.blocks = now.widened(self.bare, self.loaded())
        self.fitted = again(before, now, self.blocks)
        self.gauge = gauge_of(self.fitted) if now.needs_loads() else None
        if self.gauge is not None:
            self.fitted = again(before, now, self.blocks, gauge=self.gauge.rows)

    def add(self, place: int, one: Chosen) -> None:
        """One more effect, all its shapes known."""
        self.chosen[place] = one
        self.refit()

    def look(self, place: int, one: Chosen, free: Sequence[str]) -> None:
        """One more effect, some of its shapes to be looked for.

        What it explains passes for noise at first, most of all where it is the same throughout a run; so the search is
        made again with the noise that is left with it.
        """
        shapes = one.shapes(self.model.robot)
        for _ in range(SEARCHES if one.effect.family in SLOW else 1):
            ground = self.without(place, one, is_quick=True)
            sights = {joint: at.sight for joint, at in ground.places.items()}
            found = look(ground, one, free=free, model=self.model, sights=sights)
            self.ranges |= {(place, name): ends for name, ends in found.ranges.items()}
            self.chosen[place] = found.one
            self.refit()
            self.fitted = releveled(self.fitted)
        fitted = tuple(name for name in free if shapes[name].is_searched)
        self.chosen[place] = replace(self.chosen[place], fitted=fitted, sizes=self._sizes(place))

    def without(self, place: int, one: Chosen | None = None, *, is_quick: bool = False) -> Ground:
        """The fit of all effects but the one at `place`, where that one (or `one`) may act.

        A quick one looks at the bins' middles only, where a ripple of two bins a period is too small by a third.
        """
        out = one or self.chosen[place]
        now = self.model.with_effects([self.chosen[other] for other in sorted(self.chosen) if other != place])
        acting = {joint: [each for each in (*now.effects, out) if each.touches(joint)] for joint in self.seen}
        is_slow = {joint: all(each.effect.family in SLOW for each in own) for joint, own in acting.items()}
        mixed = {joint: (self.thin if self.thin and slow else self.seen)[joint] for joint, slow in is_slow.items()}
        seen, kept = self.loaded([out], seen=mixed), [joint for joint in mixed if out.touches(joint)]
        blocks = now.widened(self.bare, seen)
        fitted = again(self.fitted, now, blocks)
        shown = {joint: seen[joint].middles() if is_quick else seen[joint] for joint in kept}
        return Ground.of(fitted, blocks, shown)

    def _sizes(self, place: int) -> tuple[float, ...]:
        """Linear parameters of an effect by the fit so far."""
        rank = sorted(self.chosen).index(place)
        columns = zip(self.fitted.model.columns, self.fitted.solution.values, strict=True)
        return tuple(float(value) for column, value in columns if column.place == rank and column.shape is None)

    def settle(self) -> bool:
        """Renew loads and shapes until nothing moves; whether that happened."""
        if not any(one.fitted or one.effect.needs_loads for one in self.chosen.values()):
            return True
        before: dict[str, float] = {}
        last, cost = dict(self.chosen), np.inf
        for _ in range(MOST_ROUNDS):
            now = self._cost_of_shapes()
            if now > cost * (1.0 + RISE) and not _same(last, self.chosen):
                self.chosen = {place: _half_way(last[place], one) for place, one in self.chosen.items()}
                continue
            self.refit()
            values = dict(zip(self.fitted.model.names, self.fitted.solution.values, strict=True))
            moved = self._moved(values, before)
            last, cost, before = dict(self.chosen), now, values
            if moved < SETTLED:
                return True
            self.chosen = {place: self._stepped(place, one) for place, one in self.chosen.items()}
        return False

    def _cost_of_shapes(self) -> float:
        """Weighted squares that the fit leaves at these shapes, whose derivatives are then taken at its sizes."""
        if not any(one.fitted for one in self.chosen.values()):
            return 0.0
        full = dict(self.chosen)
        self.chosen = {place: replace(one, fitted=()) for place, one in full.items()}
        self.refit()
        self.chosen = {place: replace(one, sizes=self._sizes(place)) for place, one in full.items()}
        beyond = sum(row.white_rest(self.fitted.levels[row.joint]) for row in self.fitted.rows)
        return float(self.fitted.solution.residual @ self.fitted.solution.residual + beyond)

    def finish(self, *, recursive: bool, progress: Progress | None) -> Sights:
        """The whole fit, noise included, and the sights that it is of.

        Loads follow the fit once more, so that what only looks like a change of load is known to be nothing else; and
        the paper's model has the first word where the data cannot tell it from an effect.
        """
        now, seen, gauge = self.now(), self.loaded(), self.convention
        self.blocks = now.widened(self.bare, seen)
        self.fitted = solve(now, self.runs, blocks=self.blocks, gauge=gauge, recursive=recursive, progress=progress)
        if recursive:
            return seen
        for _ in range(POLISH if now.needs_loads() else 0):
            seen = self.loaded()
            self.blocks = now.widened(self.bare, seen)
            self.fitted = again(self.fitted, now, self.blocks, gauge=gauge)
        if gauge is None and (found := gauge_of(self.fitted)) is not None:
            self.gauge = found
            self.fitted = again(self.fitted, now, self.blocks, gauge=found.rows)
        return seen

    def _moved(self, values: Mapping[str, float], before: Mapping[str, float]) -> float:
        """Largest move of a parameter, or step of a shape that is due, in standard errors."""
        errors = np.sqrt(np.diag(self.fitted.solution.linear.inverse))
        moves = [0.0]
        for column, error in zip(self.fitted.model.columns, errors, strict=False):
            step = values[column.name] - (0.0 if column.shape else before.get(column.name, np.inf))
            if error > 0.0:
                moves.append(abs(step) / float(error))
        return max(moves)

    def _stepped(self, place: int, one: Chosen) -> Chosen:
        """An effect with its shapes moved by the fit's step, within bounds."""
        rank, shape, held = sorted(self.chosen).index(place), dict(one.choice.shape), list(one.held)
        for column, value in zip(self.fitted.model.columns, self.fitted.solution.values, strict=True):
            if column.place != rank or column.shape is None or column.shape in held:
                continue
            facts, now = one.shapes(self.model.robot)[column.shape], shape[column.shape]
            longest = LONGEST * scale_of(facts, now)
            shape[column.shape] = min(max(now + min(max(float(value), -longest), longest), facts.low), facts.high)
            if now == shape[column.shape] and now in (facts.low, facts.high):
                held.append(column.shape)
        return replace(one.at(shape, one.sizes), held=tuple(held))


def _same(first: Mapping[int, Chosen], second: Mapping[int, Chosen]) -> bool:
    """Whether all shapes are equal."""
    return all(first[place].choice.shape == one.choice.shape for place, one in second.items())


def _half_way(start: Chosen, end: Chosen) -> Chosen:
    """The shapes half way between two."""
    middle = {name: 0.5 * (start.choice.shape[name] + value) for name, value in end.choice.shape.items()}
    return end.at(middle, end.sizes)
