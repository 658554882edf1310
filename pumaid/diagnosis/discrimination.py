"""Model discrimination: the runs after which it is decided which of two effects acts."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from pumaid.design.candidate_runs import Block, free_blocks, home, postures, speeds, sweeps, top_speed
from pumaid.design.collision import Collision
from pumaid.diagnosis.candidates import Suspect, grid_of
from pumaid.diagnosis.records import Finding
from pumaid.diagnosis.score_test import DECISIVE, ScoreTest, evidence
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Trace
from pumaid.estimation.fit import ABSORBED, Fit, FitRow, elsewhere
from pumaid.joint_bins import joint_bins
from pumaid.maths import Counts, Floats
from pumaid.robot import Robot
from pumaid.simulation import constant_run
from pumaid.trajectory import Motion, NextRun, Plan, Posture, cruise, duration, in_words, run_trapezoid
from pumaid.units import deviations, factor, number

#: How often each of the two candidates of a set is made.
REPLICATES = 2
#: Chance of a decision that is promised, and sets of runs beyond which none is.
PROMISED, MOST_REPEATS = 0.9, 20
#: Standard deviations below which a set is not worth making. Lead of evidence that is believed at most: what are rivals
#: still is not told apart by evidence alone.
LEAST, BELIEVED = 0.5, 2.0
#: Speeds tried, slowest as a share of the top speed and of the slowest run so far.
SPEEDS, SLOW, SLOWER = 9, 0.02, 0.5
#: Postures from the data and random ones, and candidates from which a set is chosen. What a new posture must tell
#: more: nobody has checked that its way is free. Shapes of an effect's grid that are tried at most.
MEASURED, DRAWN, TRIED, CAUTION, SHAPES = 5, 9, 160, 1.15, 40
#: Bins of a run; of a wave of a periodic effect, and at most.
BINS, A_WAVE, MOST_BINS = 40, 4, 512
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
#: An effect taken for true, its sizes, the data's score statistic for it, and shapes of its rival.
Pair = tuple[EffectTerm, Floats, float, Sequence[EffectTerm]]


def plan_of_findings(findings: Iterable[Finding], robot: Robot) -> Plan:
    """The deciding runs of all findings that have rivals, a set before it is repeated; no motions where none has."""
    motions, postures, assumptions = list[Motion](), list[Posture](), list[str]()
    for item in findings:
        run = item.next_run
        if run is None or not run.motions:
            continue
        often, why = run.repeats or 1, f"tells {item.effect} from {', '.join(item.rivals)}: {run.text}"
        motions += run.motions * often
        postures += [Posture(*at, (), why) for at in dict.fromkeys((m.joint, m.hold) for m in run.motions)]
        assumptions.append(
            f"A set of {len(run.motions)} runs, made {f'{often} times' if often > 1 else 'once'}, {why}."
        )
    made = Plan(robot.name, tuple(motions), tuple(postures), assumptions=tuple(assumptions))
    return replace(made, duration=duration(robot, made))


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


def _grid(fit: Fit, term: EffectTerm) -> list[EffectTerm]:
    """The term with the shapes of its effect's grid, evenly thinned; none of an effect that is periodic or arm-wide."""
    if term.joint not in fit.by_bin or term.effect.periodic is not None:
        return []
    grid = grid_of(fit, term.effect, term.joint)
    thinned = np.linspace(0, len(grid) - 1, min(len(grid), SHAPES)).round().astype(int)
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
        places = 1 + np.arange(len(self.data) - p - 1).reshape(self.shapes, -1)
        gram = beyond[:, places[:, :, None], places[:, None, :]]
        is_seen = np.einsum("mspp->msp", gram) > ABSORBED * total[:, p:, p:][:, places, places]
        gram = gram * (is_seen[..., None] & is_seen[..., None, :]) + np.eye(gram.shape[2]) * ~is_seen[..., None]
        score = np.where(is_seen, beyond[:, places, 0], 0.0)[..., None]
        square = square - (score * np.linalg.solve(gram, score)).sum(axis=(2, 3)).max(axis=1)
        return np.asarray(np.maximum(square[1:] - square[0], 0.0) / self.scale)


def _columns(fit: Fit, row: FitRow, terms: Sequence[EffectTerm], *, is_ahead: bool = False) -> Floats:
    samples = row.bins.samples
    if is_ahead and "time" in terms[0].shape:  # what changed at an instant that has passed stays changed
        long = np.full(len(samples), np.inf)
        samples = replace(samples, time=long, elapsed=long)
    return row.noise.whiten(row.bins, np.hstack([fit.linear(term, samples) for term in terms]))


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
        if any(np.any(fit.linear(term, row.bins.samples)) for term in terms)
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
