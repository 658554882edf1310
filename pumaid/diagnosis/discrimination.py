"""Model discrimination: the runs after which it is decided which of two effects acts, or which show one effect."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy import special

from pumaid.dataset import Dataset, Run
from pumaid.design.candidate_runs import Block, free_blocks, home, postures, speeds, sweeps, top_speed
from pumaid.design.collision import Collision
from pumaid.design.information import prior_robots
from pumaid.diagnosis.candidates import Suspect, grid_of
from pumaid.diagnosis.records import Finding
from pumaid.diagnosis.score_test import ScoreTest, refine_shape, scores_at
from pumaid.diagnosis.stepwise import DECISIVE, evidence
from pumaid.effect_spec import EffectTerm, at_one_joint, known_effect, option_text
from pumaid.effects import Scope, Trace, catalogue
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import Estimate
from pumaid.estimation.fit import ABSORBED, Fit, FitRow, Projector, elsewhere, loaded
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import COARSE, joint_bins
from pumaid.maths import Counts, Floats
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot
from pumaid.simulation import Bench, Hidden, Truth, constant_run
from pumaid.simulation.hidden_effects import LAWS
from pumaid.trajectory import Motion, NextRun, Plan, Posture, cruise, duration, in_words, run_trapezoid
from pumaid.units import deviations, factor, number

#: How often each of the two candidates of a set is made.
REPLICATES = 2
#: Chance of a decision that is promised, and sets of runs beyond which none is.
PROMISED, MOST_REPEATS = 0.9, 20
#: Standard deviations below which a set is not worth making, and with which an effect shows among a whole catalogue.
#: Lead of evidence that is believed at most: what are rivals still is not told apart by evidence alone.
LEAST, FOUND, BELIEVED = 0.5, 5.0, 2.0
#: Speeds tried, slowest as a share of the top speed and of the slowest run so far.
SPEEDS, SLOW, SLOWER = 9, 0.02, 0.5
#: Postures from the data and random ones, and candidates from which a set is chosen. What a new posture must tell
#: more: nobody has checked that its way is free. Shapes of an effect's grid that are tried at most.
MEASURED, DRAWN, TRIED, CAUTION, SHAPES = 5, 9, 160, 1.15, 40
#: Bins of a run; of a wave of a periodic effect, and at most.
BINS, A_WAVE, MOST_BINS = 40, 4, 512
#: Sizes of an effect (SI) that a plan is made for; samples a second and bins a run of a rehearsal.
_LEAST, _LARGEST, _RATE, _BINS = 1e-12, 1e9, 50.0, 60
#: Ridge on scaled information; share of the worth of a set that is rounding.
_RIDGE, _EQUAL = 1e-10, 1e-6
#: What could tell effects apart where no run within the limits does, by the residual that shows both.
_WAYS_OUT = {
    Trace.LOAD: "another payload would change the load without the position",
    Trace.POSITION: "a wider span would, or a tool that changes the load",
    Trace.SPEED: "speeds beyond the recipe's limits might, or a measurement without the gear",
    Trace.TIME: "a thermometer at the motor might, in a column of the logs, or a rest until the arm is cold",
    Trace.DIRECTION: "another payload or a wider span might",
}
#: An effect taken for true, its sizes, the data's score statistic for it, and shapes of its rival (or none).
Pair = tuple[EffectTerm, Floats, float, Sequence[EffectTerm]]


def plan_for_effect(
    robot: Robot,
    wanted: EffectChoice,
    *,
    whole: Callable[[], Plan],
    against: EffectChoice | None = None,
    size: float | None = None,
    dataset: Dataset | None = None,
    prior: Estimate | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan the runs after which an effect is seen, if it is there, or told from a rival.

    Runs are chosen as the deciding run of a diagnosis is. Without a dataset the plan is the experiment `whole`,
    rehearsed on a virtual robot (of `prior` and `seed`), with the runs on top of it; with one it is the runs alone.
    `size` is that of the effect's first parameter, SI, others in proportion; else such that it shows at a usual robot.

    Raises
    ------
    ModelError [plan-undecided], [plan-impossible], [unknown-effect], [effect-joint], [effect-not-here]
        No runs within the limits show it, or tell the two apart; a size out of range; no such effect, or not there.
    """
    effect, rival, base, notes = at_one_joint(wanted, robot, "--for"), None, None, list[Note]()
    if against is not None:
        arm_wide = known_effect(against.effect, Where(field=f"--against {against.effect}")).scope is Scope.ARM
        joint = against.joint if against.joint is not None or arm_wide else effect.joint
        rival = at_one_joint(replace(against, joint=joint), robot, "--against")
    truth = prior_robots(robot, estimate=prior, seed=seed).robots[0]
    hidden = usual(truth, effect, size)
    if dataset is None:
        base = whole()
        tell("rehearsing the experiment on a virtual robot")
        dataset = rehearsed(truth if rival is None or hidden is None else truth.hiding([hidden]), base, seed=seed)
    solved = solved_on(robot, [run for run in dataset.runs if not run.heldout])
    tell("choosing runs")
    name, runs = option_text(effect.effect, effect.joint, {}), None
    title, mend = f"shows {name}", "widen limits or speeds in the recipe, look for a larger effect, or add a sensor"
    if rival is None:
        runs = showing(solved, effect, {} if hidden is None else hidden.values)
    else:
        other, first, second = option_text(rival.effect, rival.joint, {}), *(_trial(solved, c) for c in (effect, rival))
        title = f"tells {name} from {other}"
        mend = mend if base else "plan without --logs for the size that you look for"
        if first is not None and second is not None:
            runs, lead = deciding(solved, first, second), evidence(solved, first) - evidence(solved, second)
            if lead > DECISIVE:
                notes.append(
                    Note(
                        "plan-decided",
                        f"the runs before these tell {name} of this size from {other} already (evidence"
                        f" {number(lead, 3)}, decisive from {DECISIVE:g}); a smaller one needs more",
                    )
                )
    if runs is None or not runs.motions:
        raise ModelError("plan-undecided", f"no run within the limits {title}", mend=mend)
    plan = extended(base or Plan(robot.name, ()), [(title, runs)], robot)
    return replace(plan, notes=(*plan.notes, *notes))


def rehearsed(truth: Truth, plan: Plan, *, seed: int) -> Dataset:
    """The fitted runs of a plan as a virtual robot would make them."""
    fitted = replace(plan, motions=tuple(motion for motion in plan.motions if motion.purpose == "fit"))
    return Dataset(Bench(truth, fitted, rate=_RATE, bins=_BINS).runs(np.random.default_rng([seed, 5])))


def solved_on(robot: Robot, runs: Sequence[Run]) -> Fit:
    """The base model fitted to runs, as diagnosis starts from it."""
    return loaded(fit_with_replicates(Model.of_runs(robot, runs), joint_bins(robot, runs, most=COARSE)))


def usual(truth: Truth, wanted: EffectChoice, size: float | None = None) -> Hidden | None:
    """An effect as it shows at a robot without ruling it, its first parameter of `size` where that is given.

    None where the simulator has no such effect and no size is given.
    """
    if size is not None and not _LEAST <= abs(size) <= _LARGEST:
        raise ModelError(
            "plan-impossible",
            f"no arm has an effect of the size {size:g}",
            Where(field=f"--for {wanted.effect}"),
            f"give a number from {_LEAST:g} to {_LARGEST:g}",
        )
    first = catalogue()[wanted.effect].parameters(truth.robot, wanted.joint or 0)[0].name
    given = {} if size is None else {first: size}
    hidden = Hidden(wanted.effect, wanted.joint, {**wanted.shape, **given})
    if wanted.effect in LAWS:
        with suppress(ModelError):
            return truth.hiding([hidden]).hidden[0]
    return hidden if given else None


def _trial(solved: Fit, choice: EffectChoice) -> ScoreTest | None:
    """The effect at its best shape on the runs so far; None where the model absorbs it."""
    effect, projector = catalogue()[choice.effect], Projector(solved)
    shaped = [EffectTerm(effect, choice.joint, dict(choice.shape))]
    terms = shaped if choice.shape else grid_of(solved, effect, choice.joint) or shaped
    trials = [trial for trial in scores_at(projector, terms[:: max(1, len(terms) // SHAPES)]) if trial is not None]
    return refine_shape(projector, max(trials, key=lambda trial: trial.statistic)) if trials else None


def extended(base: Plan, sets: Sequence[tuple[str, NextRun]], robot: Robot) -> Plan:
    """A plan with sets of runs on top of it, each as often as it takes, and in words what each does."""
    motions, postures, assumptions = list(base.motions), list(base.postures), list(base.assumptions)
    for title, run in sets:
        often, why = run.repeats or 1, f"{title}: {run.text}"
        motions += run.motions * often
        postures += [Posture(*at, (), why) for at in dict.fromkeys((m.joint, m.hold) for m in run.motions)]
        assumptions.append(
            f"A set of {len(run.motions)} runs, made {f'{often} times' if often > 1 else 'once'}, {why}."
        )
    longer = replace(base, motions=tuple(motions), postures=tuple(postures), assumptions=tuple(assumptions))
    return replace(longer, duration=duration(robot, longer), efficiency=None)


def plan_of_findings(findings: Iterable[Finding], robot: Robot) -> Plan:
    """The deciding runs of all findings that have rivals, a set before it is repeated; no motions where none has."""
    sets = [
        (f"tells {item.effect} from {', '.join(item.rivals)}", item.next_run)
        for item in findings
        if item.next_run and item.next_run.motions
    ]
    return extended(Plan(robot.name, ()), sets, robot)


def deciding(fit: Fit, first: ScoreTest, second: ScoreTest) -> NextRun:
    """The feasible runs after which it is soonest decided which of two effects acts; without motions where none does.

    Both were tested on `fit`, the model without either, and are at their best shapes. Each is fitted, with any shape
    and with the whole model, to the data and to what the other predicts of the new runs. The smaller of the two misfits
    is made as large as possible (T-optimality).

    Source
    ------
    A. C. Atkinson and V. V. Fedorov, The design of experiments for discriminating between two rival models, Biometrika
    62 (1975) 57-70, with the data so far in both fits.
    """
    terms, lead = [first.added, second.added], evidence(fit, first) - evidence(fit, second)
    for effect in (term.effect for term in terms):
        if isinstance(effect, Suspect):
            return NextRun(f"change {effect.column} on purpose while all else is repeated: no plan of motions can")
    rivals = [[term, *_grid(fit, term)] for term in reversed(terms)]
    pairs = [(t.added, t.sizes, t.statistic, rival) for t, rival in zip((first, second), rivals, strict=True)]
    motions, gains, words = _best_set(fit, pairs, enough=lambda gains: bool(_chance(gains, lead)[0] >= PROMISED))
    at = [f" at joint {term.joint}" if term.joint and terms[0].joint != terms[1].joint else "" for term in terms]
    chosen, rival = (term.effect.name + place for term, place in zip(terms, at, strict=True))
    if gains.max(initial=0.0) < LEAST**2:
        shared = [trace for trace in _WAYS_OUT if all(trace in term.effect.trace for term in terms)]
        way_out = _WAYS_OUT[shared[0] if shared else Trace.DIRECTION]
        return NextRun(f"no run within the limits tells {chosen} and {rival} apart; {way_out}")
    chances = _chance(gains * np.arange(1, MOST_REPEATS + 1), lead)
    sure = np.flatnonzero(chances >= PROMISED)
    apart = np.sqrt(gains[:, 0])
    text = (
        f"{words}: {chosen} and {rival} would then differ by"
        f" {deviations(apart[0])} standard deviations if it is {chosen}, by {deviations(apart[1])} if it is {rival}"
    )
    if not len(sure):
        once, often = (100.0 * float(chances[k]) for k in (0, -1))
        text += f"; they decide with a chance of {once:.0f} %, made {MOST_REPEATS} times with {often:.0f} %"
    return NextRun(text, motions, float(apart.min()), int(sure[0]) + 1 if len(sure) else None)


def showing(fit: Fit, wanted: EffectChoice, values: Mapping[str, float]) -> NextRun | None:
    """The feasible runs that best show an effect which the data, fitted without it, cannot show; None where none does.

    `values` are shapes, and of its parameters the first, the others being in the proportion of the effect's examples. A
    shape that is given nowhere is one from the middle of the effect's grid.
    """
    robot, effect, joint = fit.model.robot, catalogue()[wanted.effect], wanted.joint or 0
    parameters, shapes = effect.parameters(robot, joint), effect.shapes(robot, joint)
    sizes = np.array([parameter.example for parameter in parameters])
    sizes = sizes * values.get(parameters[0].name, sizes[0]) / (sizes[0] or 1.0)
    term = EffectTerm(effect, wanted.joint, {item.name: item.example for item in shapes})
    grid = _grid(fit, term, most=None) or [term]
    middle, given = grid[len(grid) // 2].shape, {**values, **wanted.shape}
    term = replace(term, shape={name: given.get(name, middle[name]) for name in term.shape})
    if "time" in term.shape:  # an instant that has passed
        return None
    pairs: list[Pair] = [(term, part, 0.0, ()) for part in np.diag(sizes)]
    motions, gains, words = _best_set(fit, pairs, enough=lambda gains: bool(gains.min() >= FOUND**2))
    gain = float(gains.min()) if motions else 0.0
    if MOST_REPEATS * gain < FOUND**2:
        return None
    return NextRun(
        f"{words}: {effect.name} would show by {deviations(np.sqrt(gain))} standard deviations",
        motions,
        float(np.sqrt(gain)),
        int(np.ceil(FOUND**2 / gain)),
    )


def _grid(fit: Fit, term: EffectTerm, *, most: int | None = SHAPES) -> list[EffectTerm]:
    """The term with the shapes of its effect's grid, evenly thinned; none of an effect that is periodic or arm-wide."""
    if term.joint not in fit.by_bin or term.effect.periodic is not None:
        return []
    grid = grid_of(fit, term.effect, term.joint)
    thinned = np.linspace(0, len(grid) - 1, min(len(grid), most or len(grid))).round().astype(int)
    return [replace(term, shape={**term.shape, **grid[k].shape}) for k in thinned]


def _chance(gains: Floats, lead: float) -> Floats:
    """(M,) chance that one of two effects is decisively ahead after gains (2, M), where `lead` is the first's so far.

    A lead changes by a normal variate of mean g and variance 4 g; which effect is true is weighed by the lead so far.
    """
    believed = float(np.clip(lead, -BELIEVED, BELIEVED))
    leads, first = np.array([[believed], [-believed]]), special.expit(0.5 * believed)
    sure = special.ndtr((leads + gains - DECISIVE) / (2.0 * np.sqrt(gains) + 1e-6))
    return np.asarray(np.array([first, 1.0 - first]) @ sure)


class Separation:
    """How far a rival stays from what an effect predicts, fitted to the data and to `count` candidates' runs."""

    def __init__(self, fit: Fit, runs: Sequence[tuple[FitRow, Counts]], count: int, *, pair: Pair) -> None:
        truth, sizes, statistic, rival = pair
        self.scale = (fit.square - statistic) / max(fit.size - fit.rank, 1)
        self.width, self.shapes = len(fit.inverse), len(rival)
        turned = fit.inverse @ sum(row.jacobian.T @ _columns(fit, row, [truth]) for row in fit.joints)
        # Products of the columns [Jacobian, what is to be explained, rival's columns] of the data and each candidate.
        tables = (np.column_stack([r.jacobian, r.residual, _columns(fit, r, rival)]) for r in fit.joints)
        self.data = np.sum([table.T @ table for table in tables], axis=0)
        self.data[self.width, self.width] = 0.0
        self.grams = np.zeros((count, *self.data.shape))
        for row, owner in runs:
            beyond = _columns(fit, row, [truth], is_ahead=True) - row.jacobian @ turned
            table = np.column_stack([row.jacobian, beyond @ sizes, _columns(fit, row, rival, is_ahead=True)])
            for candidate in np.unique(owner):
                part = table[owner[row.bins.run] == candidate]
                self.grams[candidate] = part.T @ part

    def gains(self, counts: Floats) -> Floats:
        """(M,) twice the log likelihood that the rival loses when candidates are made `counts` (M, L) times."""
        counts = np.vstack([0 * counts[:1], counts])
        p, used = self.width, np.flatnonzero(counts.any(axis=0))
        total = self.data + np.tensordot(counts[:, used], self.grams[used], axes=1)
        size = np.sqrt(np.einsum("mpp->mp", total[:, :p, :p]))
        unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
        scaled = total[:, :p, :p] * unit[:, :, None] * unit[:, None, :] + _RIDGE * np.eye(p)
        both = total[:, :p, p:] * unit[:, :, None]
        beyond = total[:, p:, p:] - np.swapaxes(both, 1, 2) @ np.linalg.solve(scaled, both)
        square = beyond[:, 0, 0]  # less that of the data before any fit
        if self.shapes:
            places = 1 + np.arange(len(self.data) - p - 1).reshape(self.shapes, -1)
            gram = beyond[:, places[:, :, None], places[:, None, :]]
            is_seen = np.einsum("mspp->msp", gram) > ABSORBED * total[:, p:, p:][:, places, places]
            gram = gram * (is_seen[..., None] & is_seen[..., None, :]) + np.eye(gram.shape[2]) * ~is_seen[..., None]
            score = np.where(is_seen, beyond[:, places, 0], 0.0)[..., None]
            square = square - (score * np.linalg.solve(gram, score)).sum(axis=(2, 3)).max(axis=1)
        return np.asarray(np.maximum(square[1:] - square[0], 0.0) / self.scale)


def _columns(fit: Fit, row: FitRow, terms: Sequence[EffectTerm], *, is_ahead: bool = False) -> Floats:
    """(N, V) whitened columns of an effect with several shapes."""
    samples = row.bins.samples
    if not terms:
        return np.zeros((len(samples), 0))
    if is_ahead and "time" in terms[0].shape:  # what changed at an instant that has passed stays changed
        long = np.full(len(samples), np.inf)
        samples = replace(samples, time=long, elapsed=long)
    return row.noise.whiten(row.bins, np.hstack([term.linear(fit.model.robot, samples) for term in terms]))


def _best_set(
    fit: Fit, pairs: Sequence[Pair], *, enough: Callable[[Floats], bool]
) -> tuple[tuple[Motion, ...], Floats, str]:
    """The best set of one or two candidates in which the true effects act, made at the begin of a new recording.

    Its motions in rounds, so that replicates lie apart in time, the (D, 1) gain of each pair, and the set in words; of
    no candidate, nothing. By exchange: several candidates each get their best partner, that its own, and so on.
    """
    terms, robot = [truth for truth, *_ in pairs], fit.model.robot
    tables = [
        candidates(fit, row.bins.joint)
        for row in fit.joints
        if any(np.any(term.linear(robot, row.bins.samples)) for term in terms)
    ]
    tried = [candidate for table, _ in tables for candidate in table]
    new = frozenset(hold for _, holds in tables for hold in holds)
    waves = [
        term.shape[str(term.effect.periodic)]
        * np.ptp(fit.by_bin[term.number].bins.samples.position[:, term.number - 1])
        for term in terms
        if term.effect.periodic is not None and term.joint is not None
    ]
    bins = int(np.clip(A_WAVE * max(waves, default=0.0) / (2.0 * np.pi), BINS, MOST_BINS))
    limit = max(TRIED * BINS // bins, 32)
    rng = np.random.default_rng(len(tried))
    tried = [tried[k] for k in np.sort(rng.permutation(len(tried))[:limit])]
    if not tried:
        return (), np.zeros((0, 1)), ""
    joint = np.array([candidate.joint for candidate in tried])
    runs = [runs_ahead(fit, tried, np.flatnonzero(joint == j), bins=bins) for j in np.unique(joint)]
    separations = [Separation(fit, runs, len(tried), pair=pair) for pair in pairs]
    caution = np.array([1.0 / CAUTION if candidate.hold in new else 1.0 for candidate in tried])
    single = np.eye(len(tried))

    def gains(counts: Floats) -> Floats:
        return np.array([part.gains(REPLICATES * counts) for part in separations])

    def worth(counts: Floats) -> Floats:
        return np.asarray(gains(counts).min(axis=0) * (counts @ caution) / counts.sum(axis=1))

    alone = worth(single)
    best = tried[int(np.argmax(alone))]
    alike = [k for k, c in enumerate(tried) if (c.joint, c.hold) == (best.joint, best.hold)]
    alike.sort(key=lambda k: tried[k].sweeps[0].speed)
    sets = dict[tuple[int, ...], float]()
    # Candidates chosen one by one miss what tells something only together, such as the slowest and the fastest.
    for place in (int(np.argmax(alone)), alike[0], alike[-1]):
        value = -1.0
        while (together := worth(single + single[place])).max() > value + _EQUAL * abs(value):
            partner, value = int(np.argmax(together)), float(together.max())
            sets[tuple(sorted((place, partner)))], place = value, partner
    chosen = max(sets, key=lambda pair: sets[pair])
    if enough(gains(single[[max(chosen, key=lambda k: alone[k])]])):
        chosen = (max(chosen, key=lambda k: alone[k]),)
    picked = [tried[k] for k in chosen]
    return (
        tuple(motion for block in picked * REPLICATES for motion in block.motions),
        gains(single[list(chosen)].sum(axis=0, keepdims=True)),
        _in_words(robot, picked, terms, new=new),
    )


def _explored(fit: Fit) -> Robot:
    """The arm, with the range and the highest speed that the data show where the recipe states none."""
    robot = fit.model.robot
    position = np.vstack([row.bins.samples.position for row in fit.joints])
    low, high = position.min(axis=0).tolist(), position.max(axis=0).tolist()
    fastest = {row.bins.joint: max(abs(run.speed) for run in row.bins.runs) for row in fit.joints}
    return replace(
        robot,
        joints=tuple(
            replace(
                joint,
                limits=joint.limits or (low[joint.number - 1], high[joint.number - 1]),
                max_velocity=joint.max_velocity or fastest.get(joint.number),
            )
            for joint in robot.joints
        ),
    )


def candidates(fit: Fit, joint: int) -> tuple[list[Block], set[tuple[float, ...]]]:
    """What a joint (from 1) can do: at every speed a wide and a narrow sweep, in postures of the data and in new ones.

    The second result are the new postures.
    """
    robot, bins = _explored(fit), fit.by_bin[joint].bins
    slowest = min(abs(run.speed) for run in bins.runs)
    shares = np.geomspace(min(SLOW, SLOWER * slowest / top_speed(robot, joint)), 1.0, SPEEDS)
    parts = sweeps(robot, joint, speeds(robot, joint, shares.tolist()))[::-1]
    # Of each speed the widest sweep and the one whose runs last nearest to two seconds; of equals the first.
    widest = {way.speed: way for way in sorted(parts, key=lambda way: way.high - way.low)}
    handy = {way.speed: way for way in sorted(parts, key=lambda way: -abs((way.high - way.low) / way.speed - 2.0))}
    ways = list(dict.fromkeys(way for speed in sorted(widest) for way in (widest[speed], handy[speed])))
    groups = sorted(bins.postures, key=lambda group: (-len(group), group[0]))[:MEASURED]
    held = np.round(bins.samples.position[bins.first[[group[0] for group in groups]]], 4)
    held = np.clip(held, *np.transpose([arm.limits or (0.0, 0.0) for arm in robot.joints]))
    holds = np.vstack([held, postures(robot, joint, count=DRAWN, rng=np.random.default_rng([41, joint]))])
    holds[:, joint - 1] = home(robot)[joint - 1]
    places = [tuple(hold) for hold in holds.tolist()]
    return free_blocks(Collision(robot), holds, ways), set(places) - set(places[: len(held)])


def runs_ahead(fit: Fit, tried: Sequence[Block], numbers: Counts, *, bins: int) -> tuple[FitRow, Counts]:
    """The runs of the candidates `numbers`, all of one joint, with so many bins each, nothing measured.

    Each is the first of a recording. Noise is that of the run of the data that is nearest in speed.
    """
    robot, before = _explored(fit), fit.by_bin[tried[int(numbers[0])].joint].bins.samples
    measured = before.temperature[np.isfinite(before.temperature)]
    coldest = float(measured.min()) if len(measured) else np.nan
    nothing = None if before.extra is None else np.zeros((bins, before.extra.shape[1]))
    runs, owner = [], []
    for place in numbers.tolist():
        for motion in tried[place].motions:
            movement = run_trapezoid(robot, motion)
            first, last = movement.cruise
            middle = (np.arange(bins) + 0.5) / bins * (last - first)
            run = constant_run(movement, first + middle, np.ones(bins, dtype=np.int64))
            values = replace(run.bins, time=middle, temperature=np.full(bins, coldest), extra=nothing)
            runs.append(replace(run, duration=last - first, span=cruise(robot, motion)[0], bins=values))
            owner.append(place)
    (ahead,) = joint_bins(robot, runs, begun={}, is_settled=False)
    return elsewhere(fit, ahead), np.array(owner)


def _in_words(robot: Robot, picked: Sequence[Block], terms: Sequence[EffectTerm], *, new: frozenset[object]) -> str:
    """The runs of a set: when, which joint at which speeds over which way, and where the others are held."""
    parts = []
    for joint, hold in dict.fromkeys((block.joint, block.hold) for block in picked):
        unit, scale = ("deg", factor("deg")) if robot.joint(joint).is_revolute else ("m", 1.0)
        made = Counter(block.sweeps[0] for block in picked if (block.joint, block.hold) == (joint, hold))
        ways = [
            f"{number(sweep.speed / scale, 2)} {unit}/s ({sweep.low / scale + 0.0:.4g} to"
            f" {sweep.high / scale + 0.0:.4g} {unit}, {REPLICATES * made[sweep]} times)"
            for sweep in sorted(made, key=lambda sweep: sweep.speed)
        ]
        text = f"joint {joint} both ways at {' and '.join(ways)}"
        if robot.n_joints > 1:
            text += f" with the others at [{in_words(robot, hold, moving=joint)}]"
            text += ", a new posture: check that its way is free" if hold in new else ""
        parts.append(text)
    # Unlike what changed for good at an instant, some effects come and go with every recording.
    is_ageing = any(Trace.TIME in term.effect.trace and "time" not in term.shape for term in terms)
    when = "let the arm cool, then as the first runs of a new recording " if is_ageing else ""
    return f"{when}run {', then '.join(parts)}"
