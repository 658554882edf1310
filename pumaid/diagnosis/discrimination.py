"""Model discrimination: the runs after which it is decided which of two effects acts, or which show one effect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from pumaid.dataset import Campaign, Dataset, Run
from pumaid.design.candidate_runs import Block, Sweep, free_blocks, home, postures, speeds, sweeps, top_speed
from pumaid.design.collision import Collision
from pumaid.design.exchange import Exchange
from pumaid.design.prior import prior_robots
from pumaid.diagnosis.candidates import Suspect, grid_of
from pumaid.diagnosis.records import Finding
from pumaid.diagnosis.score_test import ScoreTest, refine_shape, scores_at
from pumaid.diagnosis.stepwise import DECISIVE, evidence
from pumaid.effect_spec import EffectTerm, at_one_joint, columns_each, known_effect
from pumaid.effects import Scope, Trace
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import Estimate
from pumaid.estimation.fit import ABSORBED, Fit, FitRow, Projector, elsewhere, loaded
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import COARSE, extent, joint_bins
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot
from pumaid.simulation import Bench
from pumaid.simulation.hidden_effects import LAWS, Hidden
from pumaid.simulation.monte_carlo import constant_run
from pumaid.simulation.virtual_robot import Truth
from pumaid.trajectory import Motion, NextRun, Plan, Posture, cruise, duration, in_words, run_trapezoid
from pumaid.units import deviations, factor, number

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Distinct candidates of a set at most, and how often each is made: an effect is believed when it repeats.
PICKED, REPLICATES = 2, 2
#: Chance of a decision that is promised, and sets of runs beyond which none is.
PROMISED, MOST_REPEATS = 0.9, 20
#: Standard deviations below which a set is not worth making, and with which an effect shows among a whole catalogue.
LEAST, FOUND = 0.5, 5.0
#: Lead of evidence that is believed at most: what are rivals still is not told apart by evidence alone.
BELIEVED = 2.0
#: Speeds tried, slowest as a share of the top speed and of the slowest run so far.
SPEEDS, SLOW, SLOWER = 9, 0.02, 0.5
#: Postures from the data and random ones, and candidates from which a set is chosen.
MEASURED, DRAWN, TRIED = 5, 9, 160
#: What a new posture must tell more: nobody has checked that its way is free.
CAUTION = 1.15
#: Shapes of an effect's grid that are tried at most.
SHAPES = 40
#: Bins of a run; of a wave of a periodic effect, and at most.
BINS, A_WAVE, MOST_BINS = 40, 4, 512
#: Sets of runs that a plan holds at most, and sizes of an effect (SI) that it is made for.
_MOST_SETS, _LEAST, _LARGEST = 12, 1e-12, 1e9
#: Samples a second and bins a run of a rehearsal.
_RATE, _BINS = 50.0, 60
#: Ridge on scaled information.
_RIDGE = 1e-10
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
#: Runs of a joint that are not made yet, as a row of the fit, and (R,) the candidate of each.
RunsAhead = tuple[FitRow, Counts]


def plan_for_effect(
    robot: Robot,
    wanted: EffectChoice,
    *,
    against: EffectChoice | None = None,
    size: float | None = None,
    whole: Callable[[], Plan] | None = None,
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
        if whole is None:
            raise ValueError("without logs there must be an experiment to rehearse")
        base = whole()
        tell("rehearsing the experiment on a virtual robot")
        dataset = rehearsed(truth if rival is None or hidden is None else truth.hiding([hidden]), base, seed=seed)
    solved = solved_on(robot, [run for run in dataset.runs if not run.heldout])
    tell("choosing runs")
    name = _named(effect)
    if rival is None:
        title, runs = f"shows {name}", showing(solved, effect, {} if hidden is None else hidden.values)
    else:
        title = f"tells {name} from {_named(rival)}"
        first, second = (_best_trial(solved, choice) for choice in (effect, rival))
        runs, lead = deciding(solved, first, second), evidence(solved, first) - evidence(solved, second)
        if lead > DECISIVE:
            text = (
                f"the runs before these tell {name} of this size from {_named(rival)} already (evidence"
                f" {number(lead, 3)}, decisive from {DECISIVE:g}); a smaller one needs more"
            )
            notes.append(Note("plan-decided", text))
    if runs is None or not runs.motions:
        of = "" if size is None or rival is not None else f" of the size {number(size, 3)}"
        of += " of the size that these logs have of them" if rival is not None and base is None else ""
        raise _undecided(f"no run within the limits {title}{of}", is_of_logs=rival is not None and base is None)
    return _plan(base or Plan(robot.name, ()), runs, robot, title=title, notes=notes)


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
    typical = None
    if wanted.effect in LAWS:
        with suppress(ModelError):
            typical = truth.hiding([Hidden(wanted.effect, wanted.joint, dict(wanted.shape))]).hidden[0]
    if size is None:
        return typical
    if not _LEAST <= abs(size) <= _LARGEST:
        what, mend = f"no arm has an effect of the size {size:g}", f"give a number from {_LEAST:g} to {_LARGEST:g}"
        raise ModelError("plan-impossible", what, Where(field=f"--for {wanted.effect}"), mend)
    effect, joint = known_effect(wanted.effect, Where()), wanted.joint or 0
    first = effect.parameters(truth.robot, joint)[0].name
    shapes = {shape.name for shape in effect.shapes(truth.robot, joint)}
    values = {} if typical is None else typical.values
    share = size / values[first] if values.get(first) else 1.0
    scaled = {name: value if name in shapes else share * value for name, value in values.items()}
    return Hidden(wanted.effect, wanted.joint, {**scaled, first: size})


def _best_trial(solved: Fit, choice: EffectChoice) -> ScoreTest:
    """The effect at its best shape on the runs so far."""
    effect, projector = known_effect(choice.effect, Where()), Projector(solved)
    shaped = [EffectTerm(effect, choice.joint, dict(choice.shape))]
    terms = shaped if choice.shape else grid_of(solved, effect, choice.joint) or shaped
    trials = [trial for trial in scores_at(projector, terms[:: max(1, len(terms) // SHAPES)]) if trial is not None]
    if not trials:
        raise _undecided(f"{_named(choice)} leaves no trace in these runs that the model does not absorb")
    return refine_shape(projector, max(trials, key=lambda trial: trial.statistic))


def _undecided(what: str, *, is_of_logs: bool = False) -> ModelError:
    mend = "widen limits or speeds in the recipe, look for a larger effect, or add a sensor"
    return ModelError(
        "plan-undecided", what, mend="plan without --logs for the size that you look for" if is_of_logs else mend
    )


def _named(choice: EffectChoice) -> str:
    return choice.effect if choice.joint is None else f"{choice.effect}@{choice.joint}"


def _plan(base: Plan, added: NextRun, robot: Robot, *, title: str, notes: Sequence[Note]) -> Plan:
    """The runs as often as it takes, on top of the experiment that was rehearsed."""
    sets = min(added.repeats or 1, _MOST_SETS)
    longer = replace(base, motions=(*base.motions, *(added.motions * sets)), efficiency=None)
    holds = dict.fromkeys((motion.joint, motion.hold) for motion in added.motions)
    times = f"made {sets} times" if sets > 1 else "made once"
    sentence = f"A set of {len(added.motions)} runs, {times}, {title}: {added.text}."
    return replace(
        longer,
        postures=(*base.postures, *(Posture(joint, hold, (), f"{title}: {added.text}") for joint, hold in holds)),
        duration=duration(robot, longer),
        assumptions=(*base.assumptions, sentence),
        notes=(*base.notes, *notes),
    )


def plan_of_findings(findings: Iterable[Finding], robot: Robot) -> Plan:
    """The deciding runs of all findings that have rivals, a set before it is repeated; no motions where none has."""
    decided = [(finding, finding.next_run) for finding in findings if finding.next_run and finding.next_run.motions]
    motions = tuple(motion for _, run in decided for motion in run.motions * (run.repeats or 1))
    reasons = [f"tells {finding.effect} from {', '.join(finding.rivals)}: {run.text}" for finding, run in decided]
    plan = Plan(robot.name, motions, assumptions=tuple(reasons))
    return replace(plan, duration=duration(robot, plan))


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
    shapes = [[term, *_grid(fit, term)] for term in terms]
    pairs = [
        (test.added, test.sizes, test.statistic, rival)
        for test, rival in zip((first, second), reversed(shapes), strict=True)
    ]
    best = _best_set(fit, pairs, enough=lambda gains: bool(_chance(gains, lead)[0] >= PROMISED))
    chosen, rival = _names(terms)
    if best is None or best.gains.max() < LEAST**2:
        shared = [trace for trace in _WAYS_OUT if all(trace in term.effect.trace for term in terms)]
        way_out = _WAYS_OUT[shared[0] if shared else Trace.DIRECTION]
        return NextRun(f"no run within the limits tells {chosen} and {rival} apart; {way_out}")
    chances = _chance(best.gains * np.arange(1, MOST_REPEATS + 1), lead)
    sure = np.flatnonzero(chances >= PROMISED)
    apart = np.sqrt(best.gains[:, 0])
    text = (
        f"{_in_words(fit.model.robot, best, terms)}: {chosen} and {rival} would then differ by"
        f" {deviations(apart[0])} standard deviations if it is {chosen}, by {deviations(apart[1])} if it is {rival}"
    )
    if not len(sure):
        once, often = (100.0 * float(chances[k]) for k in (0, -1))
        text += f"; they decide with a chance of {once:.0f} %, made {MOST_REPEATS} times with {often:.0f} %"
    return NextRun(text, best.motions, float(apart.min()), int(sure[0]) + 1 if len(sure) else None)


def showing(fit: Fit, wanted: EffectChoice, values: Mapping[str, float]) -> NextRun | None:
    """The feasible runs that best show an effect which the data, fitted without it, cannot show; None where none does.

    `values` are shapes, and of its parameters the first, the others being in the proportion of the effect's examples. A
    shape that is given nowhere is one from the middle of the effect's grid.
    """
    robot, effect, joint = fit.model.robot, known_effect(wanted.effect, Where()), wanted.joint or 0
    parameters, shapes = effect.parameters(robot, joint), effect.shapes(robot, joint)
    if not parameters or effect.applies(robot, joint) is not None:
        return None
    sizes = np.array([parameter.example for parameter in parameters])
    size = values.get(parameters[0].name)
    if size is not None and sizes[0] != 0.0:
        sizes = sizes * size / sizes[0]
    usual_term = EffectTerm(effect, wanted.joint, {item.name: item.example for item in shapes})
    grid, names = _grid(fit, usual_term, most=None) or [usual_term], [item.name for item in shapes]
    given = {name: value for name, value in {**values, **wanted.shape}.items() if name in names}
    term = replace(usual_term, shape={**grid[len(grid) // 2].shape, **given})
    if "time" in term.shape:  # an instant that has passed
        return None
    pairs = [(term, part, 0.0, ()) for part in np.diag(sizes)]
    best = _best_set(fit, pairs, enough=lambda gains: bool(gains.min() >= FOUND**2))
    gain = 0.0 if best is None else float(best.gains.min())
    if best is None or MOST_REPEATS * gain < FOUND**2:
        return None
    apart = float(np.sqrt(gain))
    text = f"{_in_words(robot, best, [term])}: {effect.name} would show by {deviations(apart)} standard deviations"
    return NextRun(text, best.motions, apart, int(np.ceil(FOUND**2 / gain)))


def _grid(fit: Fit, term: EffectTerm, *, most: int | None = SHAPES) -> list[EffectTerm]:
    """The term with the shapes of its effect's grid, evenly thinned; none of an effect that is periodic or arm-wide."""
    row = fit.by_bin.get(term.joint or 0)
    if row is None or term.effect.periodic is not None:
        return []
    grid = term.effect.grid(fit.model.robot, extent([row.bins], row.bins.joint, row.drawn))
    thinned = np.linspace(0, len(grid) - 1, min(len(grid), most or len(grid))).round().astype(int)
    return [replace(term, shape={**term.shape, **grid[k]}) for k in thinned]


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

    def __init__(self, fit: Fit, runs: Sequence[RunsAhead], count: int, *, pair: Pair) -> None:
        truth, sizes, statistic, rival = pair
        self.scale = (fit.square - statistic) / max(fit.size - fit.rank, 1)
        self.width, self.shapes = len(fit.inverse), len(rival)
        cross = sum(row.jacobian.T @ _columns(fit, row, [truth]) for row in fit.joints)
        turned = fit.inverse @ cross
        # Products of the columns [Jacobian, what is to be explained, rival's columns] of the data and each candidate.
        tables = [np.column_stack([r.jacobian, r.residual, _columns(fit, r, rival)]) for r in fit.joints]
        self.data = np.sum([table.T @ table for table in tables], axis=0)
        self.data[self.width, self.width] = 0.0
        self.grams = np.zeros((count, *self.data.shape))
        for row, owner in runs:
            beyond = _columns(fit, row, [truth], is_ahead=True) - row.jacobian @ turned
            rivals = _columns(fit, row, rival, is_ahead=True)
            table = np.column_stack([row.jacobian, beyond @ sizes, rivals])
            for candidate in np.unique(owner):
                part = table[owner[row.bins.run] == candidate]
                self.grams[candidate] = part.T @ part

    def gains(self, counts: Floats) -> Floats:
        """(M,) twice the log likelihood that the rival loses when candidates are made `counts` (M, L) times."""
        parts = np.array_split(np.vstack([0 * counts[:1], counts]), 8)
        squares = np.concatenate([self._squares(part) for part in parts])
        return np.asarray(np.maximum(squares[1:] - squares[0], 0.0) / self.scale)

    def _squares(self, counts: Floats) -> Floats:
        """(M,) least sum of squares of the rival over its shapes, less that of the data before any fit."""
        p, used = self.width, np.flatnonzero(counts.any(axis=0))
        total = self.data + np.tensordot(counts[:, used], self.grams[used], axes=1)
        size = np.sqrt(np.einsum("mpp->mp", total[:, :p, :p]))
        unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
        scaled = total[:, :p, :p] * unit[:, :, None] * unit[:, None, :] + _RIDGE * np.eye(p)
        both = total[:, :p, p:] * unit[:, :, None]
        beyond = total[:, p:, p:] - np.swapaxes(both, 1, 2) @ np.linalg.solve(scaled, both)
        square = beyond[:, 0, 0]
        if not self.shapes:
            return np.asarray(square)
        places = 1 + np.arange(len(self.data) - p - 1).reshape(self.shapes, -1)
        gram = beyond[:, places[:, :, None], places[:, None, :]]
        before = total[:, p:, p:][:, places, places]
        is_seen = np.einsum("mspp->msp", gram) > ABSORBED * before
        gram = gram * (is_seen[..., None] & is_seen[..., None, :]) + np.eye(gram.shape[2]) * ~is_seen[..., None]
        score = np.where(is_seen, beyond[:, places, 0], 0.0)[..., None]
        explained = (score * np.linalg.solve(gram, score)).sum(axis=(2, 3))
        return np.asarray(square - explained.max(axis=1))


def _columns(fit: Fit, row: FitRow, terms: Sequence[EffectTerm], *, is_ahead: bool = False) -> Floats:
    """(N, V) whitened columns of an effect with several shapes."""
    samples = row.bins.samples
    if not terms:
        return np.zeros((len(samples), 0))
    if is_ahead and "time" in terms[0].shape:  # what changed at an instant that has passed stays changed
        long = np.full(len(samples), np.inf)
        samples = replace(samples, time=long, elapsed=long)
    return row.noise.whiten(row.bins, columns_each(terms, fit.model.robot, samples))


@dataclass(frozen=True, eq=False, slots=True)
class Chosen:
    """A set of candidates: how often each is made (each `REPLICATES` times that), its gains (D, 1), new postures."""

    candidates: dict[Block, int]
    gains: Floats
    new: frozenset[tuple[float, ...]]

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All runs in rounds, so that replicates lie apart in time."""
        rounds = range(REPLICATES * max(self.candidates.values()))
        made = [(c, REPLICATES * count) for c, count in self.candidates.items()]
        return tuple(motion for k in rounds for c, count in made if count > k for motion in c.motions)


@dataclass(frozen=True, eq=False, slots=True)
class _WorstSeparation:
    """Objective of the exchange: the smallest gain of a set, new postures counting less; its negative is made small."""

    separations: Sequence[Separation]
    caution: Floats

    def gains(self, counts: Counts) -> Floats:
        """(D, M) of M sets (M, C)."""
        return np.array([part.gains(REPLICATES * np.atleast_2d(counts).astype(float)) for part in self.separations])

    def _values(self, counts: Counts) -> Floats:
        share = counts @ self.caution / np.maximum(counts.sum(axis=1), 1)
        return np.asarray(-self.gains(counts).min(axis=0) * share)

    def value(self, counts: Counts) -> float:
        return float(self._values(counts[None])[0])

    def values_with(self, counts: Counts, candidates: Counts) -> Floats:
        return self._values(counts + np.eye(len(counts), dtype=np.int64)[candidates])

    def falls(self, counts: Counts) -> Floats:
        return self.value(counts) - self.values_with(counts, np.arange(len(counts)))


def _best_set(fit: Fit, pairs: Sequence[Pair], *, enough: Callable[[Floats], bool]) -> Chosen | None:
    """The best set of candidates in which the true effects act, made at the begin of a new recording; or None."""
    terms, robot = [truth for truth, *_ in pairs], fit.model.robot
    moved = [r.bins.joint for r in fit.joints if any(np.any(t.linear(robot, r.bins.samples)) for t in terms)]
    tables = [candidates(fit, joint) for joint in moved]
    tried = [candidate for table, _ in tables for candidate in table]
    new = frozenset(hold for _, holds in tables for hold in holds)
    bins = _bins_for(fit, terms)
    limit = max(TRIED * BINS // bins, 32)
    if len(tried) > limit:
        rng = np.random.default_rng(len(tried))
        tried = [tried[k] for k in np.sort(rng.permutation(len(tried))[:limit])]
    if not tried:
        return None
    joint = np.array([candidate.joint for candidate in tried])
    runs = [runs_ahead(fit, tried, np.flatnonzero(joint == j), bins=bins) for j in np.unique(joint)]
    separations = [Separation(fit, runs, len(tried), pair=pair) for pair in pairs]
    worst = _WorstSeparation(separations, np.array([1.0 / CAUTION if c.hold in new else 1.0 for c in tried]))
    none, ones = np.zeros(len(tried), dtype=np.int64), np.ones(len(tried))
    exchange = Exchange(worst, ones, np.arange(len(tried)), 0.0 * ones, budget=float(PICKED), limit=PICKED)
    greedy = exchange.filled(none)
    best = tried[int(np.argmax(greedy))]
    alike = [k for k, c in enumerate(tried) if (c.joint, c.hold) == (best.joint, best.hold)]
    alike.sort(key=lambda k: tried[k].sweeps[0].speed)
    # Candidates chosen one by one miss what tells something only together, such as the slowest and the fastest.
    extremes = np.bincount([alike[0], alike[-1]], minlength=len(tried))
    counts = min((exchange.exchanged(start, required=none) for start in (greedy, extremes)), key=worst.value)
    while counts.sum() > 1:
        places = np.flatnonzero(counts).tolist()
        fewer = min((counts - np.eye(len(counts), dtype=np.int64)[k] for k in places), key=worst.value)
        if not enough(worst.gains(fewer)):
            break
        counts = fewer
    return Chosen({tried[k]: int(counts[k]) for k in np.flatnonzero(counts).tolist()}, worst.gains(counts), new)


def _bins_for(fit: Fit, terms: Sequence[EffectTerm]) -> int:
    """Bins a run that show all effects, periodic ones too."""
    waves = [0.0]
    for term in terms:
        if term.effect.periodic is not None and term.joint is not None:
            width = np.ptp(fit.row(term.joint).bins.samples.position[:, term.joint - 1])
            waves.append(float(term.shape[term.effect.periodic] * width / (2.0 * np.pi)))
    return int(np.clip(A_WAVE * max(waves), BINS, MOST_BINS))


def _explored(fit: Fit) -> Robot:
    """The arm, with the range and the highest speed that the data show where the recipe states none."""
    robot = fit.model.robot
    position = np.vstack([row.bins.samples.position for row in fit.joints])
    fastest = {row.bins.joint: max(abs(run.speed) for run in row.bins.runs) for row in fit.joints}
    joints = []
    for joint, low, high in zip(robot.joints, position.min(axis=0), position.max(axis=0), strict=True):
        limits = (float(low), float(high)) if joint.limits is None and high > low else joint.limits
        joints.append(replace(joint, limits=limits, max_velocity=joint.max_velocity or fastest.get(joint.number)))
    return replace(robot, joints=tuple(joints))


def candidates(fit: Fit, joint: int) -> tuple[list[Block], set[tuple[float, ...]]]:
    """What a joint (from 1) can do: at every speed a wide and a narrow sweep, in postures of the data and in new ones.

    The second result are the new postures.
    """
    robot, bins = _explored(fit), fit.row(joint).bins
    slowest = min(abs(run.speed) for run in bins.runs)
    shares = np.geomspace(min(SLOW, SLOWER * slowest / top_speed(robot, joint)), 1.0, SPEEDS)
    ways = _wide_and_narrow(sweeps(robot, joint, speeds(robot, joint, shares.tolist())))
    groups = sorted(bins.postures, key=lambda group: (-len(group), group[0]))[:MEASURED]
    held = np.round(bins.samples.position[bins.first[[group[0] for group in groups]]], 4)
    held = np.clip(held, *np.transpose([arm.limits or (-np.inf, np.inf) for arm in robot.joints]))
    moved = [arm.number for arm in robot.joints if arm.limits is not None and arm.number != joint]
    rng = np.random.default_rng([41, joint])
    drawn = postures(robot, joint, varied=moved, count=DRAWN, rng=rng)[-DRAWN:] if moved else held[:0]
    still = [k for k in range(robot.n_joints) if k + 1 not in moved]
    drawn[:, still] = held[0, still]
    holds = np.vstack([held, drawn])
    holds[:, joint - 1] = home(robot)[joint - 1]
    been = {tuple(hold) for hold in holds[: len(held)].tolist()}
    return free_blocks(Collision(robot), holds, ways), {tuple(hold) for hold in holds.tolist()} - been


def _wide_and_narrow(ways: Sequence[Sweep]) -> tuple[Sweep, ...]:
    """Of each speed the widest sweep and the one whose runs last nearest to two seconds."""
    out: dict[Sweep, None] = {}
    for speed in sorted({way.speed for way in ways}):
        same = [way for way in ways if way.speed == speed]
        out[max(same, key=lambda way: way.high - way.low)] = None
        out[min(same, key=lambda way: abs((way.high - way.low) / way.speed - 2.0))] = None
    return tuple(out)


def runs_ahead(fit: Fit, tried: Sequence[Block], numbers: Counts, *, bins: int) -> RunsAhead:
    """The runs of the candidates `numbers`, all of one joint, with so many bins each, nothing measured.

    Each is the first of a recording. Noise is that of the run of the data that is nearest in speed.
    """
    robot, before = _explored(fit), fit.row(tried[int(numbers[0])].joint).bins.samples
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
    (ahead,) = joint_bins(robot, runs, campaign=Campaign(), is_settled=False)
    return elsewhere(fit, ahead), np.array(owner)


def _names(terms: Sequence[EffectTerm]) -> list[str]:
    """With their joints where these differ."""
    differ = len({term.joint for term in terms}) > 1
    return [f"{t.effect.name} at joint {t.joint}" if differ and t.joint is not None else t.effect.name for t in terms]


def _in_words(robot: Robot, best: Chosen, terms: Sequence[EffectTerm]) -> str:
    """The runs of a set: when, which joint at which speeds over which way, and where the others are held."""
    parts = []
    for joint, hold in dict.fromkeys((candidate.joint, candidate.hold) for candidate in best.candidates):
        unit, scale = ("deg", factor("deg")) if robot.joint(joint).is_revolute else ("m", 1.0)
        made = [(c.sweeps[0], n) for c, n in best.candidates.items() if (c.joint, c.hold) == (joint, hold)]
        ways = [
            f"{number(sweep.speed / scale, 2)} {unit}/s ({sweep.low / scale + 0.0:.4g} to"
            f" {sweep.high / scale + 0.0:.4g} {unit}, {REPLICATES * n} times)"
            for sweep, n in sorted(made, key=lambda item: item[0].speed)
        ]
        text = f"joint {joint} both ways at {' and '.join(ways)}"
        if robot.n_joints > 1:
            text += f" with the others at [{in_words(robot, hold, moving=joint)}]"
            text += ", a new posture: check that its way is free" if hold in best.new else ""
        parts.append(text)
    # Unlike what changed for good at an instant, some effects come and go with every recording.
    is_ageing = any(Trace.TIME in term.effect.trace and "time" not in term.shape for term in terms)
    when = "let the arm cool, then as the first runs of a new recording " if is_ageing else ""
    return f"{when}run {', then '.join(parts)}"
