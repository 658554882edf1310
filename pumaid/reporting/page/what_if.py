"""What if: on the page, effects are switched and parameters moved; errors follow from sums of products."""

from typing import Any

import numpy as np

from pumaid.effect_spec import Column, EffectTerm, marked
from pumaid.effects import Scope, catalogue
from pumaid.effects.curve import spoken_form
from pumaid.estimation.evaluate import JointPrediction, predictions
from pumaid.maths import Flags, Floats
from pumaid.model import INERTIA, Model, loads_at
from pumaid.reporting.page import Content, ReportContext, Section
from pumaid.reporting.table import renamed
from pumaid.reporting.text import current_unit, in_unit, joint_title, posture_text
from pumaid.robot import worded

#: Of a joint: most numbers that are drawn, to so many steps; most bins, groups of runs, and fewest runs of each.
MOST_NUMBERS, STEPS, MOST_BINS, MOST_GROUPS, FEWEST_RUNS = 18_000, 2999, 1500, 3, 4


def what_if(context: ReportContext) -> Content | None:
    """All that the script needs, joint by joint; None where there is no run."""
    joints = predictions(context.estimate, context.dataset, context.robot).values()
    unit = current_unit(context.estimate.notes)
    return {"joints": renamed([_joint(context, part) for part in joints], unit), "unit": unit} if joints else None


def _joint(context: ReportContext, part: JointPrediction) -> dict[str, Any]:
    """One joint, SI: parameters, columns, sums of products (upper triangles, last what the model leaves), and bins."""
    bins, estimate, present = part.bins, context.estimate, {term.key for term in part.model.effects}
    findings = [single for item in (context.diagnosis.findings if context.diagnosis else ()) for single in item.each()]
    tried = [
        (EffectTerm(catalogue()[item.effect], item.joint, item.shape), item.sizes)
        for item in findings
        if item.effect in catalogue()
    ]
    tried = [(term, sizes) for term, sizes in tried if not (context.stale and term.key in present)]
    model = part.model.with_effects(marked((*part.model.effects, *(term for term, _ in tried))))
    facts: dict[str, Any] = {value.name: value for value in estimate.values} | {
        column.name: size
        for term, (_, sizes) in zip(model.effects[len(part.model.effects) :], tried, strict=True)
        for column in term.parts(context.robot, None)
        for size in sizes
        if column.name.rpartition(".")[2] == size.name.rpartition(".")[2] + term.mark
    }
    pieces, p = _pieces(context, part, model), len(estimate.solution)
    numbers, fine = [*dict.fromkeys(k for k, *_ in pieces)], np.column_stack([nodes for *_, nodes in pieces])
    beside, chosen = np.column_stack([bins.averaged(fine), part.residual]), (part.counted, part.heldout)
    start = np.array([1.0 if k < 0 else estimate.solution[k] if k < p else 0.0 for k, *_ in pieces])
    grams = [(beside.T * (bins.count * runs[bins.run])) @ beside for runs in chosen]
    insides = [_inside(part, fine, drawn=fine @ start, runs=runs) for runs in chosen]
    is_fitted = {*context.comparison.logs.values()} <= {*estimate.logs.values()}
    names, triangle = ("fitted runs" if is_fitted else "these runs", "held-out runs"), np.triu_indices(len(grams[0]))
    score = next(score for score in context.comparison.joints if score.joint == bins.joint)
    return {
        "title": joint_title(context.robot, bins.joint),
        "shares": score.shares,
        "floor": score.noise_floor,
        "columns": [[numbers.index(k), name, k < p] for k, name, _ in pieces],
        "shapes": {term.effect.name + term.mark: _shape(term) for term in model.effects if term.touches(bins.joint)},
        "parameters": [
            {"value": 1.0} if k < 0 else _parameter(context, model.columns[k], facts.get(model.columns[k].name))
            for k in numbers
        ],
        "errors": [
            {"runs": name, "grams": [g[triangle].tolist() for g in both], "samples": float(part.samples[runs].sum())}
            for name, *both, runs in zip(names, grams, insides, chosen, strict=True)
            if runs.any()
        ],
        **_drawn(context, part, beside),
    }


def _shape(term: EffectTerm) -> str:
    words = worded(term.shape).items()
    texts = (f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in words)
    return spoken_form(term.shape) if term.effect.is_free else ", ".join(texts)


def _parameter(context: ReportContext, column: Column, fact: Any) -> dict[str, Any]:
    """A parameter with its unit as shown; `fact` is its value in the model, its size by the diagnosis, or None."""
    fitted = dict(zip(context.estimate.names, context.estimate.solution.tolist(), strict=True))
    return {
        "name": column.name,
        "unit": in_unit(column.unit, context.units),
        "value": fitted.get(column.name, getattr(fact, "value", None)),
        "error": getattr(fact, "std_error", None),
        "interval": getattr(fact, "ci95", None),
    }


def _pieces(context: ReportContext, part: JointPrediction, model: Model) -> list[tuple[int, str, Floats]]:
    """Columns: parameter's number in `model`, effect, (k N,) A at the nodes; -1 is all that stays as fitted."""
    estimate, bins, columns = context.estimate, part.bins, model.columns
    factors, weight = np.nan_to_num(model.factors(estimate.scales, bins.joint)), np.flatnonzero(model.is_weight)
    loads = loads_at(part.model, bins, solution=estimate.solution, scales=estimate.scales, at_nodes=True)
    fine = model.at_nodes(bins, loads) * factors
    moved = np.zeros_like(fine)
    if model.is_dynamic:  # what parameters of weight ask by inertia is not weight
        moved[:, weight] = fine[:, weight] - model.base(bins.nodes[0], (Scope.LINK,))[:, weight] * factors[weight]
    stays = {term.effect.name for term in model.effects if term.effect.is_free}
    is_own = np.array([c.scope is not Scope.LINK or c.owner == bins.joint for c in columns])
    is_own &= [c.shape is None and c.effect not in stays for c in columns]
    names = np.array([c.effect + ("" if c.place is None else model.effects[c.place].mark) for c in columns])
    parts = [(names, fine - moved), (np.full(len(names), INERTIA), moved)]
    solution = np.append(estimate.solution, np.zeros(len(columns) - len(estimate.solution))) * ~is_own
    pieces = [(k, str(of[k]), at[:, k]) for of, at in parts for k in np.flatnonzero(is_own & at.any(axis=0)).tolist()]
    outer = {name: sum(at @ (solution * (of == name)) for of, at in parts) for name in names.tolist()}
    return [*pieces, *((-1, name, nodes) for name, nodes in outer.items() if np.any(nodes))]


def _inside(part: JointPrediction, fine: Floats, *, drawn: Floats, runs: Flags) -> Floats:
    """(K + 1, K + 1) sums of products of what (k N, K) columns leave inside bins, `drawn` (k N,) being as fitted.

    As `JointBins.inside_left`; bins of which the fitted model leaves nothing stay so.
    """
    bins, count = part.bins, np.where(runs[part.bins.run], part.bins.count, 0.0)
    varying = np.where(bins.is_block[bins.run] | (part.inside <= 0.0), 0.0, count)
    rises = [bins.rises(column) for column in bins.averaged(fine).T]
    slopes = np.column_stack([*rises, 0.5 * bins.rises(bins.current) - bins.rises(part.predicted)])
    nodes = np.column_stack([fine, -drawn]).reshape(*bins.nodes[1].shape, -1)
    spread = nodes - np.einsum("ng,ngk->nk", bins.nodes[1], nodes)[:, None]
    spread *= np.sqrt(varying[:, None] * bins.nodes[1])[..., None]
    out = (slopes.T * (varying * (1.0 - 1.0 / bins.count**2) / 6.0)) @ slopes - np.einsum("ngk,ngl->kl", spread, spread)
    out[-1, -1] = count @ part.inside
    return np.asarray(out)


def _drawn(context: ReportContext, part: JointPrediction, beside: Floats) -> dict[str, Any]:
    """Bins of runs in the postures with most of them, or of the first blocks of recordings, one group after another."""
    bins, (scale, unit) = part.bins, context.unit(part.bins.joint)
    steady = [*filter(None, ([n for n in group if not bins.is_block[n]] for group in bins.postures))]
    clocks = [run.clock for run in bins.runs]
    free = [[n for n, clock in enumerate(clocks) if clock == first] for first in dict.fromkeys(clocks)]
    groups, cells = sorted(steady, key=len, reverse=True)[:MOST_GROUPS] or free[:MOST_GROUPS], []
    limit = min(MOST_BINS, MOST_NUMBERS // (beside.shape[1] + 4)) // len(groups)
    for group in groups:
        count = max(FEWEST_RUNS, limit * len(group) // int(bins.lengths[group].sum()))
        runs = sorted(group, key=lambda n: bins.runs[n].speed)[:: -(-len(group) // count)] if steady else group
        spans = [np.arange(bins.first[n], bins.first[n] + bins.lengths[n]) for n in runs]
        thin = [whole[:: -(-len(whole) * len(runs) // limit)] for whole in spans] if steady else spans
        cells.append(np.concatenate(thin)[:limit])
    x = scale * bins.samples.position[:, bins.joint - 1] if steady else bins.samples.elapsed
    table = np.column_stack([x, bins.samples.direction, bins.run, bins.current, beside])[np.concatenate(cells)]
    units = " | ".join(dict.fromkeys(context.unit(other.number)[1] for other in context.robot.joints))
    places = [
        f"other joints at {posture_text(context.robot, run.posture.tolist(), context.units)} {units}"
        if steady
        else f"{run.origin}, from {run.start:.1f} s"
        for run in (bins.runs[group[0]] for group in groups)
    ]
    steps = np.abs(table).max(axis=0) / STEPS + 1e-300
    return {
        "axis": ["position", unit] if steady else ["time", "s"],
        "groups": [[places[n], len(part)] for n, part in enumerate(cells)],
        "speeds": {n: scale * bins.runs[n].speed for n in np.unique(bins.run[np.concatenate(cells)]).tolist()},
        "steps": steps.tolist(),
        "drawn": np.diff(np.rint(table / steps).astype(int), axis=0, prepend=0).T.tolist(),
    }


SECTIONS = (Section("what_if", "What if", 5, what_if),)
