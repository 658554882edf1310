"""The one weighted fit: bins of all joints, whitened by their noise, to parameters and ratios and their covariance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from pumaid.effect_spec import STEP, scale_of
from pumaid.effects import Scope
from pumaid.estimation.fit import Fit, Row, clusters, design_of, plausible, with_loads
from pumaid.estimation.noise import AT_ONCE, NoiseModel, estimate, excess, freedoms, inside_runs
from pumaid.joint_bins import JointBins
from pumaid.maths import (
    LARGEST_RATIO,
    RATIO_SPREAD,
    USUAL_RATIO,
    Bilinear,
    Counts,
    Flags,
    Floats,
    Gains,
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
#: An eigenvalue of I - H below this belongs to a direction that a run fits alone, but for what a prior says: its
#: residual tells nothing, and its variance is taken from the working model.
FITTED_ALONE = 1e-3
#: Steps in which loads settle at most, and the whitened square (a twentieth of a standard error) by which the last may
#: still move what is drawn.
LOAD_STEPS, LOADS_STILL = 30, 0.05**2
#: A variance that rests on fewer degrees of freedom than this is taken from the working model of the noise instead.
FEWEST_FREEDOMS = 3.0


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
    paper, start, noises, weak = _recursions(model, rows, owners, limit, tell=tell)
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
    return _refined(fitted, start)


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


def _recursions(
    model: Model, rows: Sequence[Row], owners: Counts, limit: Floats, *, tell: Progress
) -> tuple[Recursion, Recursion, dict[int, NoiseModel], list[int]]:
    """The paper's recursion, one whose weakly shown ratios cannot run off, the noise by joint, and weak joints."""
    solved = np.where([column.shape is not None for column in model.columns], -1, owners)
    paper, start = (Recursion(solved, model.robot.n_joints) for _ in range(2))
    noises, weak = dict[int, NoiseModel](), []
    for row in rows:
        tell(row.joint, "solving")
        number = row.joint - 1
        design = start.design(number, row.regressors.reshape(row.target.size, -1))[0].reshape(*row.target.shape, -1)
        estimated = estimate(row.ones, design, row.target, counts=row.counts)
        if estimated is None:
            weak.append(row.joint)
            estimated = row.slow, 0.0, max(int(row.bins.lengths.sum() - row.counts.sum()) // 4, 1)
        noises[row.joint] = row.noise(*estimated)
        white = row.whitened(noises[row.joint], row.joined)
        paper.take(number, white[:, :-1], white[:, -1], limit=limit)
        start.take(number, white[:, :-1], white[:, -1], limit=limit, spread=RATIO_SPREAD)
        # Where only the product of a ratio and its load is known, it is shared out so that the ratio is a usual one:
        # the load's own row cannot tell it (from friction, say) and gave it any size, perhaps next to none.
        gains = start.gains
        for root in [n for n in gains.edges if gains.parent[n] == number and abs(gains.edge[n]) > RATIO_SPREAD]:
            load = np.isin(solved, gains.subtree(root)) & model.is_weight
            if np.all(start.undetermined[load] | (start.values[load] == 0.0)):
                start.values[load] *= gains.edge[root]
                gains.edge[root] = USUAL_RATIO
    return paper, start, noises, weak


def _refined(fitted: Fit, start: Recursion) -> Fit:
    """The joint fit from a recursion, with weights from its own residuals."""
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
    """The fit of its own model, with its own noise and prior, from these parameters and ratios."""
    system = system_of(fitted.rows, fitted.noises, owners_of(fitted.model, fitted.assigned))
    limit = reach_of(fitted.limit, fitted.prior)
    return replace(fitted, system=system, solution=fit_bilinear(system, values, gains, limit=limit, prior=fitted.prior))


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
        {
            joint: replace(
                row,
                bare=row.bare + through[joint],
                jacobian=row.jacobian + row.noise.whiten(row.bins, through[joint]),
            )
            for joint, row in out.by_bin.items()
            if joint in through
        }
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


def clustered(
    jacobian: Floats, residual: Floats, inverse: Floats, *, runs: Counts, kin: Counts | None = None
) -> tuple[Floats, Floats]:
    """(p, p) cluster-robust covariance with the bias-reduced correction CR2, and (p,) Satterthwaite degrees of freedom.

    What a single run determines leaves no residual that could tell its error: there the working model's noise counts,
    as well known as the runs that it was estimated from are many: of each run, by rising number, `kin` (R,) says with
    which others that was, all where not given. `jacobian` (N, p) and `residual` (N,) are whitened by the working model,
    `inverse` (p, p) is the inverse information of all runs together, `runs` (N,) the run of each equation.

    Source: R. M. Bell and D. F. McCaffrey, Survey Methodology 28 (2002) 169-181; J. E. Pustejovsky and E. Tipton, J.
    Bus. Econ. Stat. 36 (2018) 672-683.
    """
    # Rows of each run by rising number, zero where a run has fewer than others.
    _, run, lengths = np.unique(runs, return_inverse=True, return_counts=True)
    order, p = np.argsort(run, kind="stable"), len(inverse)
    table = np.zeros((len(lengths), int(lengths.max()), p + 1))
    place = np.arange(len(runs)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    table[run[order], place] = np.column_stack([jacobian, residual])[order]
    scores, alone = np.zeros((len(table), p)), np.zeros((len(table), p))
    lent, trace, squares, gram = np.zeros((p, p)), np.zeros(p), np.zeros(p), np.zeros((p, p, p))
    for start in range(0, len(table), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        J, e = table[block, :, :-1], table[block, :, -1:]
        eigenvalues, vectors = np.linalg.eigh(np.eye(J.shape[1]) - J @ inverse @ J.transpose(0, 2, 1))
        is_alone = eigenvalues <= FITTED_ALONE
        root = np.where(is_alone, 0.0, 1.0 / np.sqrt(np.maximum(eigenvalues, FITTED_ALONE)))
        A = (vectors * root[:, None, :]) @ vectors.transpose(0, 2, 1)
        scores[block] = np.sum(J * (A @ e), axis=1) @ inverse
        # What a unit of noise does in directions that a run fits alone.
        out = (vectors.transpose(0, 2, 1) @ J * is_alone[:, :, None]) @ inverse
        alone[block] = np.sum(out**2, axis=1)
        lent += np.tensordot(out, out, ((0, 1), (0, 1)))
        a = A @ J @ inverse
        squared, pull = np.sum(a**2, axis=1), J.transpose(0, 2, 1) @ a  # how each run's J' A J M pulls a contrast
        turned = inverse @ pull
        crossed = np.sum(pull * turned, axis=1)
        trace += np.sum(squared - crossed, axis=0)
        squares += np.sum(squared**2 - 2.0 * squared * crossed, axis=0)
        gram += pull.transpose(2, 1, 0) @ turned.transpose(2, 0, 1)
    squares += np.sum(gram * gram.transpose(0, 2, 1), axis=(1, 2))
    by_residuals = trace.copy()
    groups = np.zeros(len(table), dtype=np.int64) if kin is None else kin
    for group in np.unique(groups):
        borrowed = alone[groups == group].sum(axis=0)
        trace += borrowed
        squares += borrowed**2 / max(1, np.count_nonzero(groups == group) - 1)
    # Where next to nothing of a variance comes from residuals, they tell nothing of how well it is known.
    is_shown = (squares > 0) & (by_residuals > FITTED_ALONE * trace)
    return scores.T @ scores + lent, np.divide(trace**2, squares, out=np.zeros(p), where=is_shown)


def completed(working: Floats, errors: Floats, poor: Flags) -> Floats:
    """A covariance `errors` (p, p) of which the `poor` parameters (p,) are known by `working` (p, p) only.

    Taking the poor ones' rows and columns from the other would not do: the two together may give a sum of parameters a
    variance below zero. The poor ones depend on the rest as by `working`, and are never surer than there.
    """
    good, bad = np.flatnonzero(~poor), np.flatnonzero(poor)
    size = np.sqrt(np.where(np.diag(working) > 0.0, np.diag(working), 1.0))
    scaled, spread = working / np.outer(size, size), np.eye(len(working))[:, good]
    slope = scaled[np.ix_(bad, good)] @ np.linalg.pinv(scaled[np.ix_(good, good)], rcond=1e-10, hermitian=True)
    rest = scaled[np.ix_(bad, bad)] - slope @ scaled[np.ix_(good, bad)]
    spread[bad] = slope * size[bad][:, None] / size[good]
    out = spread @ errors[np.ix_(good, good)] @ spread.T
    out[np.ix_(bad, bad)] += rest * np.outer(size[bad], size[bad])
    out[bad, bad] = np.maximum(out[bad, bad], np.diag(working)[bad])
    return np.asarray(0.5 * (out + out.T))


def interval(value: float, std_error: float, freedoms: float, *, level: float = 0.95) -> tuple[float, float]:
    """Student's interval; the normal one where `freedoms` is infinite."""
    half = float(special.stdtrit(freedoms, 0.5 + level / 2.0)) * std_error
    return value - half, value + half


def two_sided(statistic: float, freedoms: float) -> float:
    """Probability of a Student t at least as large as |statistic|."""
    return float(2.0 * special.stdtr(freedoms, -abs(statistic)))


def recursion_covariance(system: Bilinear, values: Floats, gains: Gains, *, runs: Counts) -> tuple[Floats, Floats]:
    """Covariance of the recursion's parameters and ratios, clustered by `runs` (N,), with each one's freedoms in its
    own row.

    Row i is least squares given the outer rows' results, so an outer run moves it, too: by minus the row's own solution
    operator times the derivative of the row's prediction by the outer results.
    """
    p, jacobian, residual = len(values), system.jacobian(gains, values), system.left(values, gains)
    size = jacobian.shape[1]
    covariance, freedoms = np.zeros((size, size)), np.zeros(size)
    for row in reversed(range(gains.n_rows)):
        equations = np.flatnonzero(system.row == row)
        edges = [p + k for k, upper in enumerate(gains.uppers) if upper == row]
        columns = np.append(np.flatnonzero(system.owners == row), edges).astype(int)
        if len(equations) == 0 or len(columns) == 0:
            continue
        J = jacobian[np.ix_(equations, columns)]
        scale = np.linalg.norm(J, axis=0)
        back = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
        unit = J * back
        # The columns' own singular values, squared, with four digits to spare above machine precision.
        inverse = back[:, None] * np.linalg.pinv(unit.T @ unit, rcond=1e-12, hermitian=True) * back
        outer = np.setdiff1d(np.arange(size), columns)
        carry = -inverse @ J.T @ jacobian[np.ix_(equations, outer)]
        alone, freedoms[columns] = clustered(J, residual[equations], inverse, runs=runs[equations])
        crossed = carry @ covariance[np.ix_(outer, outer)]
        covariance[np.ix_(columns, columns)] = alone + crossed @ carry.T
        covariance[np.ix_(columns, outer)], covariance[np.ix_(outer, columns)] = crossed, crossed.T
    return covariance, freedoms


def covariance_of(fitted: Fit) -> tuple[Floats, Floats]:
    """(P, P) covariance of all parameters and ratios of a fit, or of the recursion that it began with, and (P,) degrees
    of freedom: clustered by run, by the working model of the noise where clusters are too few.
    """
    solution, (runs, kin) = fitted.solution, clusters(fitted.rows)
    if fitted.first is None:
        covariance, dof = recursion_covariance(fitted.system, solution.values, solution.gains, runs=runs)
    else:
        covariance, dof = clustered(solution.jacobian, solution.residual, fitted.inverse, runs=runs, kin=kin)
        # What rests on the prior of a ratio or shape is as uncertain as the prior says: no run's residual shows that.
        priors = fitted.inverse * fitted.prior
        covariance = covariance + priors @ priors.T
    poor = dof < FEWEST_FREEDOMS
    joints = np.array([*fitted.system.owners, *solution.gains.uppers])
    parts = np.split(solution.jacobian, np.cumsum([row.target.size for row in fitted.rows])[:-1])
    for row, part in zip(fitted.rows, parts, strict=True):
        noise, chosen = fitted.noises[row.joint], np.flatnonzero(poor & (joints == row.joint - 1))
        if len(chosen):
            J = part.reshape(*row.target.shape, -1)
            estimated = np.full(len(joints), float(noise.freedoms))
            if row.joint not in fitted.weak:
                estimated = freedoms(noise, ones=row.ones, jacobian=J, inverse=fitted.inverse)
            dof[chosen] = np.clip(estimated[chosen], 1.0, float(noise.freedoms))
    return completed(fitted.inverse, covariance, poor) if poor.any() else covariance, dof
