"""The one weighted fit: bins of all joints, whitened by their noise, to parameters and ratios and their covariance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pumaid.effect_spec import STEP, scale_of
from pumaid.effects import Scope
from pumaid.estimation.fit import Fit, Row, design_of, plausible, with_loads
from pumaid.estimation.noise import NoiseModel, estimate, excess, inside_runs
from pumaid.joint_bins import JointBins
from pumaid.maths import (
    BETTER,
    LARGEST_RATIO,
    RATIO_SPREAD,
    USUAL_RATIO,
    Bilinear,
    Counts,
    Floats,
    Gains,
    JointSolution,
    Recursion,
    fit_bilinear,
    least_squares,
    ratio_spread,
    restarted,
)
from pumaid.model import INERTIA, Model

Progress = Callable[[int, str], None]

#: Rounds of variances and joint fit: the second changes weights by well under a percent.
ROUNDS = 2
#: How much firmer than its prior a shape is held at a bound, and inverse of the deviation by which a ratio is held.
TIGHT = 1e6
#: Noise of a joint between runs, over that inside them, beyond which the recursion is taken to have gone astray.
ASTRAY = 10.0
#: Steps in which loads settle at most, and the whitened square (a twentieth of a standard error) by which the last may
#: still move what is drawn.
LOAD_STEPS, LOADS_STILL = 30, 0.05**2


def assign(model: Model, moving: Sequence[int]) -> Counts:
    """(J,) joint (from 0) in whose gain each link's parameters are when `moving` joints (from 1) have runs.

    A prismatic joint feels no weight but its own link's parameter.
    """
    turns = model.robot.is_revolute
    rows = [joint - 1 for joint in moving]
    felt_by = [[row for row in rows if row == link or (row < link and turns[row])] for link in range(len(turns))]
    return np.array([max(joints, default=-1) for joints in felt_by])


def owners_of(model: Model, assigned: Counts) -> Counts:
    """(p,) joint (from 0) in whose gain each column counts; -1 for one that acts on several joints in their own."""
    return np.where([c.scope in (Scope.CAUSE, Scope.ARM) for c in model.columns], -1, assigned[model.owners - 1])


def fit_bins(
    model: Model,
    bins: Sequence[JointBins],
    *,
    before: Fit | None = None,
    recursive: bool = False,
    progress: Progress | None = None,
) -> Fit:
    """Recursion from the last joint to the first, then (unless `recursive`) all rows together.

    Each row is weighted by its own noise: correlated bins, and the level that a run shares. Effects of the load are
    made by the loads of the fit `before`; `progress` is called with the joint at work (0: all) and a word on what is
    done.

    Source: S.-K. Lin, Theorem 1, for the recursion; the refinement is maximum likelihood for the same system.
    """
    tell = progress or (lambda joint, text: None)
    rows = tuple(_row(model, part, before, like=before) for part in sorted(bins, key=lambda part: -part.joint))
    assigned = assign(model, [row.joint for row in rows])
    owners, limit = owners_of(model, assigned), limits(rows, model)
    paper, noises, weak = _recursion(model, rows, owners, limit, tell=tell)
    # Columns left open by their own row; and weights of rows that were solved with an open load taken for known.
    gains, absorbed = paper.gains, dict[int, list[tuple[int, int]]]()
    is_open = paper.undetermined.copy()
    for edge in sorted(gains.edges, reverse=True):
        if np.any(is_open & model.is_weight & np.isin(paper.owners, gains.subtree(edge))):
            is_open |= model.is_weight & (paper.owners == gains.parent[edge])
    for n in np.flatnonzero(is_open).tolist():
        absorbed[n] = [(row + 1, root + 1) for row, root in paper.redundant if row == paper.owners[n]]
    system, prior = system_of(rows, noises, owners), np.append(priors(model, limit), np.zeros(len(paper.gains.edges)))
    solution = fit_bilinear(system, paper.values, paper.gains, limit=reach_of(limit, prior), most_steps=0)
    first = Fit(model, rows, assigned, noises, tuple(weak), system, solution, prior, limit, absorbed=absorbed)
    fitted = replace(first, first=first, absorbed={})
    if recursive:
        return fitted
    tell(0, "refining all joints together")
    return _refined(fitted)


def _row(
    model: Model, bins: JointBins, before: Fit | None, *, noise: NoiseModel | None = None, like: Fit | None = None
) -> Row:
    """The runs of a joint in `model`; as they are in `like` where neither effects nor noise differ there."""
    old = None if like is None else next((row for row in like.rows if row.bins is bins), None)
    design = None
    if like is not None and old is not None:
        terms = [[term for term in part.effects if term.touches(bins.joint)] for part in (like.model, model)]
        if terms[0] == terms[1] and not any(term.needs_loads for term in terms[0]):
            old = old.in_columns(like.model.names, model.names)
            if noise is None or all(
                np.array_equal(getattr(noise, part), getattr(old.inner, part)) for part in ("correlation", "spread")
            ):  # a level that runs share is taken out of what they are reduced to
                return old
            design = old.design
    design = design_of(model, bins, before) if design is None else design
    if noise is not None:
        return Row.of(bins, design, noise)
    inner, slow = inside_runs(bins, design.T[design.any(axis=0)].T)
    row = Row.of(bins, design, inner, slow=slow)
    times = excess(row.regressors, row.target, counts=row.counts, is_other=bins.accelerates)
    if times == 1.0:
        return row
    # What the model misses where joints accelerate comes again in each such run, and does not average out.
    times = 1.0 + (times - 1.0) * np.count_nonzero(bins.accelerates)
    spread = inner.spread * np.where(bins.accelerates, np.sqrt(times), 1.0)
    return Row.of(bins, design, replace(inner, spread=spread), slow=slow)


def _recursion(
    model: Model, rows: Sequence[Row], owners: Counts, limit: Floats, *, tell: Progress
) -> tuple[Recursion, dict[int, NoiseModel], list[int]]:
    flat = {row.joint - 1: row.regressors.reshape(row.target.size, -1) for row in rows}
    paper = Recursion(_solved_with(model, owners, flat), model.robot.n_joints)
    noises, weak = dict[int, NoiseModel](), []
    for row in rows:
        tell(row.joint, "solving")
        number = row.joint - 1
        design = paper.design(number, flat[number])[0].reshape(*row.target.shape, -1)
        estimated = estimate(row.ones, design, row.target, counts=row.counts)
        if estimated is None:
            weak.append(row.joint)
            estimated = row.slow, 0.0, max(int(row.bins.lengths.sum() - row.counts.sum()) // 4, 1)
        noises[row.joint] = row.noise(*estimated)
        white = row.whitened(noises[row.joint], row.joined)
        paper.take(number, white[:, :-1], white[:, -1], limit=limit)
    return paper, noises, weak


def _solved_with(model: Model, owners: Counts, rows: Mapping[int, Floats]) -> Counts:
    """(p,) joint (from 0) with which a recursion over `rows` solves each column; -1 of what it does not: derivatives by
    shapes, and what acts on several joints.
    """
    felt = np.array([part.any(axis=0) for part in rows.values()])
    alone = np.where(felt.sum(axis=0) == 1, np.array([*rows])[felt.argmax(axis=0)], -1)
    return np.where([column.shape is not None for column in model.columns], -1, np.maximum(owners, alone))


def _start(fitted: Fit, system: Bilinear) -> Recursion:
    """The recursion over a whitened system, with the priors of a fit, whose weakly shown ratios cannot run off.

    Each row is linear, so no wrong minimum is in the way.
    """
    small, prior, is_weight = system.condensed(), fitted.prior[: len(fitted.limit)], fitted.model.is_weight
    rows = {row: small.regressors[small.row == row] for row in np.unique(small.row).tolist()}
    start = Recursion(_solved_with(fitted.model, system.owners, rows), fitted.gains.n_rows)
    gains = start.gains
    for row in sorted(rows, reverse=True):
        held = np.diag(prior)[(start.owners == row) & (prior > 0.0)]
        target = np.append(small.target[small.row == row], np.zeros(len(held)))
        start.take(row, np.vstack([rows[row], held]), target, limit=fitted.limit, spread=RATIO_SPREAD)
        # Where only the product of a ratio and its load is known, it is shared out so that the ratio is a usual one:
        # the load's own row cannot tell it (from friction, say) and gave it any size, perhaps next to none.
        for root in [n for n in gains.edges if gains.parent[n] == row and abs(gains.edge[n]) > RATIO_SPREAD]:
            load = np.isin(start.owners, gains.subtree(root)) & is_weight
            if np.all(start.undetermined[load] | (start.values[load] == 0.0)):
                start.values[load] *= gains.edge[root]
                gains.edge[root] = USUAL_RATIO
    return start


def _refined(fitted: Fit) -> Fit:
    start = _start(fitted, fitted.system)
    values, gains, weights = start.values, start.gains, fitted.prior[: len(start.values)]
    noises = fitted.noises
    inside = {row.joint: row.noise(row.slow, freedoms=noises[row.joint].freedoms) for row in fitted.rows}

    def with_prior(fitted: Fit, noises: Mapping[int, NoiseModel]) -> Fit:
        system = system_of(fitted.rows, noises, fitted.system.owners)
        prior = np.append(weights, 1.0 / ratio_spread(system, fitted.values, fitted.gains))
        return replace(fitted, system=system, prior=prior)

    fitted = replace(fitted, solution=replace(fitted.solution, values=values, gains=gains))
    if any(noises[joint].sample > ASTRAY * noise.sample for joint, noise in inside.items()):
        fitted = with_prior(fitted, inside)
        limit = reach_of(fitted.limit, fitted.prior)
        values, gains = restarted(fitted.system, values, gains, limit=limit, prior=fitted.prior)
        fitted = releveled(replace(fitted, solution=replace(fitted.solution, values=values, gains=gains)))
    for _ in range(ROUNDS):  # what ratios show, and so need no prior for, the recursion may not have seen
        fitted = with_prior(fitted, fitted.noises)
        fitted = releveled(_solved(fitted, fitted.values, fitted.gains))
    fitted = with_prior(fitted, fitted.noises)
    return _solved(fitted, fitted.values, fitted.gains)


def _solved(fitted: Fit, values: Floats, gains: Gains) -> Fit:
    """The fit of its own model, with its own noise and prior, from these parameters and ratios or, where that meets the
    data decidedly better, from the recursion's: ratios bent by what a model lacked lead downhill to a wrong minimum.
    """
    system = system_of(fitted.rows, fitted.noises, owners_of(fitted.model, fitted.assigned))
    limit, start = reach_of(fitted.limit, fitted.prior), _start(fitted, system)
    solution = fit_bilinear(system, values, gains, limit=limit, prior=fitted.prior)

    def square(at: Recursion | JointSolution) -> float:
        held = fitted.prior[: len(at.values)] * at.values
        return float(np.sum(system.left(at.values, at.gains) ** 2) + held @ held)

    is_carried = any(term.is_carried for term in fitted.model.effects)
    if start.gains.parent == gains.parent and (is_carried or square(start) < BETTER * square(solution)):
        other = fit_bilinear(system, start.values, start.gains, limit=limit, prior=fitted.prior)
        solution = min(solution, other, key=square)
    return replace(fitted, system=system, solution=solution)


def refit(
    before: Fit,
    model: Model,
    *,
    bins: Sequence[JointBins] | None = None,
    noise: Mapping[int, NoiseModel] | None = None,
    is_renewed: bool = False,
    like: Fit | None = None,
) -> Fit:
    """The joint fit of another model, from where `before` ended and with its variances: a quick one.

    `bins` are the runs, where not those of `before`, `noise` by joint (from 1) what the fit is weighted by, where not
    as before; `is_renewed` asks to estimate noise inside runs anew, by what the other model leaves of each; rows are
    taken from `like`, where not from `before`, if they are the same.
    """
    chosen = [row.bins for row in before.rows] if bins is None else sorted(bins, key=lambda part: -part.joint)
    given = dict(noise or {})
    if noise is None and bins is None and not is_renewed:
        given = {row.joint: row.inner for row in before.rows}
    rows = tuple(_row(model, part, before, noise=given.get(part.joint), like=like or before) for part in chosen)
    noises = dict[int, NoiseModel]()
    for row in rows:
        old, part = before.noises[row.joint], (noise or {}).get(row.joint)
        sample, level = (old.sample, old.level[0]) if part is None else (1.0, part.level[0])
        noises[row.joint] = row.noise(sample, float(level) ** 2, old.freedoms)
    limit, start = limits(rows, model), dict(zip(before.model.names, before.values, strict=True))
    values = np.array([0.0 if column.shape else start.get(column.name, 0.0) for column in model.columns])
    prior = np.append(priors(model, limit), before.prior[len(before.values) :])
    fitted = replace(before, model=model, rows=rows, noises=noises, prior=prior, limit=limit)
    return _solved(fitted, values, before.gains)


def rise(fitted: Fit, edge: int, ratio: float) -> float:
    """By how much the whitened square, priors included, rises where the ratio on edge number `edge` is held at another
    and all else is fitted anew.
    """
    p, ratios = len(fitted.values), fitted.gains.ratios
    held, centre = np.arange(len(fitted.prior)) == p + edge, np.repeat([0.0, USUAL_RATIO], [p, len(ratios)])
    there = fit_bilinear(
        fitted.system,
        fitted.values,
        fitted.gains.with_ratios(np.where(held[p:], ratio, ratios)),
        limit=reach_of(fitted.limit, fitted.prior),
        prior=np.where(held, TIGHT, fitted.prior),
        centre=np.where(held, ratio, centre),
    )
    squares = []
    for solution in (there, fitted.solution):
        off = fitted.prior * (np.append(solution.values, solution.gains.ratios) - centre)
        squares.append(float(solution.residual @ solution.residual + off @ off))
    return squares[0] - squares[1]


def with_errors(fitted: Fit) -> Fit:
    """With errors as the data have them.

    Shapes that are best at a bound are no better known than others, and effects of the load move with the parameters
    and ratios that make the load: a payload felt by an inner joint is its mass times a ratio of gains, so where the
    ratio is not known well, the mass is not, either.
    """
    fitted, weights = _with_settled_loads(fitted), priors(fitted.model, fitted.limit, is_tight=False)
    return _linearised(replace(fitted, prior=np.append(weights, fitted.prior[len(weights) :])), _through_loads(fitted))


def with_settled_loads(fitted: Fit) -> Fit:
    """With effects of the load that have the loads which the fit leaves, and move with what makes these."""
    settled = _with_settled_loads(fitted)
    through = _through_loads(settled)
    out = _linearised(settled, through)
    return out.with_rows(
        {joint: replace(row, bare=row.bare + through[joint]) for joint, row in out.by_bin.items() if joint in through}
    )


def _with_settled_loads(fitted: Fit) -> Fit:
    """By Gauss and Newton's steps in which effects of the load move with what makes it, until nothing drawn moves.

    A fit of effects with loads as they were takes what only rescales the load for a direction of its own. A step that
    does not lower the sum of squares, loads renewed, is halved. The derivative through loads takes most of the time: it
    is renewed while a step is beyond what noise moves.
    """
    if not fitted.model.needs_loads():
        return fitted
    p = len(fitted.values)
    centre = np.repeat([0.0, USUAL_RATIO], [p, len(fitted.prior) - p])

    def moved(theta: Floats) -> tuple[Fit, Floats, float]:  # with what priors ask, and the sum of squares
        solution = replace(fitted.solution, values=theta[:p], gains=fitted.gains.with_ratios(theta[p:]))
        out, off = replace(fitted, solution=solution), fitted.prior * (centre - theta)
        parts = [fitted.noises[row.joint].whiten(row.bins, out.misfit(row.bins)) for row in fitted.rows]
        return out, off, float(off @ off + sum(part @ part for part in parts))

    theta, through, promised = np.append(fitted.values, fitted.gains.ratios), dict[int, Floats](), np.inf
    now, off, cost = moved(theta)
    for _ in range(LOAD_STEPS):
        through = _through_loads(now) if promised > 1.0 else through
        solution = _linearised(now, through, off).solution
        step, J = solution.linear.values, solution.jacobian
        promised, tried = float(np.sum((J @ step) ** 2)), moved(theta + step)
        while tried[2] >= cost and np.sum((J @ step) ** 2) > LOADS_STILL:
            step = step / 2.0
            tried = moved(theta + step)
        if tried[2] < cost:
            theta, (now, off, cost) = theta + step, tried
        if np.sum((J @ step) ** 2) < LOADS_STILL:
            break
    return now


def _linearised(fitted: Fit, through: Mapping[int, Floats], off: Floats | None = None) -> Fit:
    """With the least squares about its parameters, loads moving with them; `off` (P,) is what priors ask of them."""
    rows = tuple(
        Row.of(row.bins, design_of(fitted.model, row.bins, fitted), row.inner, moved=through[row.joint], slow=row.slow)
        if row.joint in through
        else row
        for row in fitted.rows
    )
    system = system_of(rows, fitted.noises, fitted.system.owners)
    more = [
        np.zeros((row.target.size, len(fitted.prior)))
        if row.moved is None
        else row.whitened(fitted.noises[row.joint], row.moved)
        for row in rows
    ]
    jacobian = system.jacobian(fitted.gains, fitted.values) + np.vstack(more)
    residual, asked = system.left(fitted.values, fitted.gains), np.zeros(len(fitted.prior)) if off is None else off
    equations, target = np.vstack([jacobian, np.diag(fitted.prior)]), np.append(residual, asked)
    linear = least_squares(equations, target, limit=reach_of(fitted.limit, fitted.prior))
    solution = replace(fitted.solution, linear=linear, jacobian=jacobian, residual=residual)
    return replace(fitted, rows=rows, system=system, solution=solution)


def _through_loads(fitted: Fit) -> dict[int, Floats]:
    """Joint -> (N, P) derivative of what effects of the load draw there, by what the load is made of."""
    needs = [term for term in fitted.model.effects if term.needs_loads]
    rows = [row for row in fitted.rows if any(term.touches(row.joint) for term in needs)]
    return {row.joint: _moved_through_loads(fitted, row.bins) for row in rows}


def _moved_through_loads(fitted: Fit, bins: JointBins) -> Floats:
    """(N, P) derivative of what effects of the load draw, by what the load is made of."""
    model, p = fitted.model, len(fitted.values)
    theta = np.append(fitted.values, fitted.gains.ratios)
    least = np.append(fitted.limit, np.ones(len(theta) - p))
    terms = [(place, t) for place, t in enumerate(model.effects) if t.needs_loads and t.touches(bins.joint)]
    makers = {bins.joint, *(term.number for _, term in terms)}
    makes = [c.place is None and (c.scope is Scope.LINK or c.owner in makers) for c in model.columns]
    kinds = np.array([c.effect for c in model.columns] + ["ratio"] * (len(theta) - p))
    kinds[:p][~np.array(makes)] = ""

    def drawn(theta: Floats) -> Floats:
        solution = replace(fitted.solution, values=theta[:p], gains=fitted.gains.with_ratios(theta[p:]))
        samples = with_loads(replace(fitted, solution=solution), bins)
        return np.sum([term.linear(model.robot, samples) @ fitted.sizes(place) for place, term in terms], axis=0)

    out, start = np.zeros((len(bins), len(theta))), drawn(theta)
    steps = STEP * np.maximum(np.abs(theta), STEP * least)
    for kind in set(kinds) - {""}:
        # Most kinds change nothing in most joints, which a step of all of a kind shows.
        acts = np.any(drawn(theta + steps * (kinds == kind)) != start)
        for n in np.flatnonzero(kinds == kind) if acts else ():
            out[:, n] = (drawn(theta + steps * (np.arange(len(theta)) == n)) - start) / steps[n]
    return out


def limits(rows: Sequence[Row], model: Model) -> Floats:
    """(p,) standard error at which each parameter, acting in full, is as uncertain as all that its joint drew."""
    drawn = {row.joint: float(np.sqrt(row.bins.mean_square)) for row in rows}
    speed = {row.joint: max(abs(run.speed) for run in row.bins.runs) for row in rows}
    g, out = float(np.linalg.norm(model.robot.gravity)), []
    for index, column in enumerate(model.columns):
        if column.place is not None and column.shape is not None:
            term = model.effects[column.place]
            out.append(scale_of(term.shapes(model.robot)[column.shape], term.shape[column.shape]))
        elif column.place is not None or column.effect == INERTIA:
            felt = [row for row in rows if column.place is not None or row.joint == column.owner]
            peaks = [(row.bins, float(np.abs(row.design[:, index]).max())) for row in felt]
            out.append(column.deviation or plausible(peaks, column.span))
        else:
            in_full = {"gravity": g, "viscous": speed.get(column.owner)}.get(column.effect) or 1.0
            out.append(max(drawn.get(column.owner, max(drawn.values())), np.finfo(float).tiny) / in_full)
    return np.array(out)


def priors(model: Model, limit: Floats, *, is_tight: bool = True) -> Floats:
    """(p,) inverse of each parameter's prior standard deviation: of effects their limit, of others infinite.

    The paper's parameters have none: what the data do not show of them is not identifiable. An effect's are held so
    that a shape at which it looks like the paper's model does not let it, and with it that model, run off; and shapes
    that are best at a bound are kept there where the prior `is_tight`.
    """
    places = [None if column.place is None else model.effects[column.place].held for column in model.columns]
    at_bound = [held is not None and column.shape in held for column, held in zip(model.columns, places, strict=True)]
    return np.array([held is not None for held in places]) * np.where(at_bound, TIGHT if is_tight else 1.0, 1.0) / limit


def system_of(rows: Sequence[Row], noises: Mapping[int, NoiseModel], owners: Counts) -> Bilinear:
    """The rows whitened by each joint's own noise."""
    stacked = np.vstack([row.whitened(noises[row.joint], row.joined) for row in rows])
    number = np.concatenate([np.full(row.target.size, row.joint - 1) for row in rows])
    return Bilinear(number, stacked[:, :-1], stacked[:, -1], owners)


def releveled(fitted: Fit) -> Fit:
    """With each joint's noise as the fit leaves it, where its runs are enough to tell; the next is weighted by it.

    What priors keep from fitting is left here, too: they count as equations of one run more, with the noise so far.
    """
    out, values, gains, owners = dict(fitted.noises), fitted.values, fitted.gains, fitted.system.owners
    for row in fitted.rows:
        flat = row.regressors.reshape(row.target.size, -1)
        plain = Bilinear(np.full(len(flat), row.joint - 1), flat, row.target.ravel(), owners)
        edges = [len(values) + k for k, edge in enumerate(gains.edges) if gains.parent[edge] == row.joint - 1]
        columns = np.append(np.flatnonzero(owners == row.joint - 1), edges).astype(int)
        design = plain.jacobian(gains, values)[:, columns].reshape(*row.target.shape, -1)
        residual = plain.left(values, gains).reshape(row.target.shape)
        weights = fitted.prior[columns] * (columns < len(values)) * np.sqrt(fitted.noises[row.joint].sample)
        last = np.diag(weights)[weights > 0.0]
        ones, counts = row.ones, row.counts
        if len(last):
            wide = [(0, 1), (0, max(len(last) - row.target.shape[1], 0)), (0, 0)]
            design, residual, ones = np.pad(design, wide), np.pad(residual, wide[:2]), np.pad(ones, wide[:2])
            design[-1, : len(last)], residual[-1, : len(last)] = last, -last @ np.append(values, gains.ratios)[columns]
            counts = np.append(counts, len(last))
        estimated = estimate(ones, design, residual, counts=counts)
        if estimated is not None:
            out[row.joint] = row.noise(*estimated)
    return replace(fitted, noises=out)


def reach_of(limit: Floats, prior: Floats) -> Floats:
    """(P,) standard errors that say nothing; what has a prior is never as uncertain as that."""
    parameters = np.where(prior[: len(limit)] > 0.0, 2.0 * limit, limit)
    return np.append(parameters, np.full(len(prior) - len(limit), LARGEST_RATIO))
