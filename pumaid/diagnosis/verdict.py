"""What has no name (free functions of one variable, scored like effects), and what would not have been seen."""

from collections.abc import Iterable, Iterator
from typing import ClassVar

import numpy as np
from scipy import special

from pumaid.diagnosis.candidates import PERIODIC, Candidates, Expansion, Key
from pumaid.diagnosis.records import ADEQUATE, MISSING, UNEXPLAINED_JOINT, JointDiagnosis, Limit, Unexplained
from pumaid.diagnosis.score_test import (
    GROSS,
    ScoreTable,
    ScoreTest,
    SignFlips,
    alike,
    replicate_test,
    score_of,
    sign_flips,
)
from pumaid.diagnosis.stepwise import DECISIVE, LEVEL, WORTH, evidence, rmse
from pumaid.effect_spec import EffectTerm
from pumaid.effects import Effect, Family, Samples, catalogue
from pumaid.estimation.fit import Fit, Projector
from pumaid.joint_bins import JointBins
from pumaid.maths import Floats
from pumaid.robot import Robot

#: Variable -> its unit (``{unit}`` is rad or m), and knots of a free function over its span: a bump of an eighth of the
#: span is still seen.
VARIABLES = {"q": ("{unit}", 16), "v": ("{unit}/s", 8), "load": ("A", 8), "t": ("s", 8), "travel": ("{unit}", 8)}
#: Variable of each form, and what multiplies the function of it: nothing, the direction s or the velocity v.
FORMS = (("q", ""), ("q", "s"), ("q", "v"), ("v", "s"), ("load", "s"), ("t", "s"), ("t", ""), ("travel", "s"))
#: Share of a knot's square below which it is absorbed by the model, and eigenvalues of what is left of the hats, as a
#: share of the largest, below which it absorbs a combination of them.
ABSORBED, FLAT = 1e-4, 1e-3
#: Combinations of hats of which the model absorbs more than all but this share are not drawn: their sizes are told with
#: errors far above anything that is left.
DRAWN = 0.1


class FreeForm(Expansion):
    """A free function of one variable, as hat functions, named like ``s f(q)``.

    Source: C. de Boor, A Practical Guide to Splines, ch. 9 (linear B-splines).
    """

    needs_loads: ClassVar[bool] = True

    def __init__(self, variable: str, factor: str, knots: Floats) -> None:
        super().__init__(f"{factor} f({variable})".strip(), len(knots), self._made)
        self.variable, self.factor, self.knots = variable, factor, knots

    def _made(self, samples: Samples) -> Floats:
        factors = {"": np.ones(len(samples)), "s": samples.direction, "v": samples.velocity[:, samples.joint - 1]}
        x = variable(samples, self.variable)
        hats = np.column_stack([np.interp(x, self.knots, hat) for hat in np.eye(len(self.knots))])
        return np.asarray(hats * factors[self.factor][:, None])


def variable(samples: Samples, name: str) -> Floats:
    """(M,) values of a form's variable."""
    column = samples.joint - 1
    return {
        "q": samples.position[:, column],
        "v": np.abs(samples.velocity[:, column]),
        "load": np.zeros(len(samples)) if samples.loads is None else samples.loads.moving,
        "t": samples.time,
        "travel": samples.travel,
    }[name]


def forms(bins: JointBins) -> Iterator[FreeForm]:
    """Every form that the runs of a joint can show."""
    for name, factor in FORMS:
        x, count = variable(bins.samples, name), VARIABLES[name][1]
        low, high = float(x.min()), float(x.max())
        if high - low <= 1e-6 * max(abs(high), 1.0):
            continue
        knots: Floats = np.linspace(low, high, count)
        if name == "v":
            speeds = np.array(bins.speeds)
            knots = speeds if len(speeds) <= count else np.quantile(speeds, np.linspace(0.0, 1.0, count))
        if len(knots) > 1:
            yield FreeForm(name, factor, knots)


def free_form_scores(solved: Fit, joint: int) -> list[ScoreTest]:
    """Every free form at one joint, in the directions of its hats that a fit with loads does not absorb."""
    projector, out = Projector(solved), []
    for form in forms(solved.by_bin[joint].bins):
        term = EffectTerm(form, joint)
        scores, information, raw = _hat_scores(projector, term)
        visible = np.flatnonzero(np.diagonal(information) > ABSORBED * raw)
        if len(visible) < 2:
            continue
        values, vectors = np.linalg.eigh(information[np.ix_(visible, visible)])
        turn = vectors[:, values > FLAT * values[-1]]
        information, free = turn.T @ information[np.ix_(visible, visible)] @ turn, np.zeros(turn.shape[1])
        out.append(score_of(term, scores[:, visible] @ turn, information, share=free + 1.0, signs=free))
    return [trial for trial in out if trial is not None]


def _hat_scores(projector: Projector, term: EffectTerm) -> tuple[Floats, Floats, Floats]:
    """(R, K) scores, (K, K) information and (K,) squares of the hats of a form."""
    columns = projector.columns([term])
    scores, information, raw = projector.scores(projector.whitened(columns), columns[term.number].shape[1])
    return scores, information[0], raw


def knot_values(solved: Fit, trial: ScoreTest) -> tuple[Floats, Floats, Floats]:
    """Knots, values there (A, as a current in the direction of motion where the form says so) and standard errors."""
    free = trial.added.effect
    assert isinstance(free, FreeForm)
    scores, information, raw = _hat_scores(Projector(solved), trial.added)
    unit = np.divide(1.0, np.sqrt(raw), out=np.zeros_like(raw), where=raw > 0.0)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    good = values > DRAWN
    inverse = unit[:, None] * ((vectors[:, good] / values[good]) @ vectors[:, good].T) * unit
    return free.knots, inverse @ scores.sum(axis=0), np.sqrt(np.diagonal(inverse) * solved.scale)


#: Chance, over all joints together, below which what repeats between replicates is not noise. Chance, over all joints
#: together, below which a free form is more than noise.
REPEATS, NAMELESS = 0.005, 0.01
#: Share of the excess over the noise floor that what was added must take away. Excess of the mean square over the
#: floor below which there is none to speak of.
ENOUGH, EXCESS = 0.8, 1.02


def joint_verdict(first: Fit, last: Fit, *, joint: int, acting: bool) -> JointDiagnosis:
    """One joint's verdict, what repeats, and the shape of what has no name, without the rest of its diagnosis.

    It is that of the fits as it was given and with all that was added; `acting`: something of it acts there.
    """
    a, b = first.by_bin[joint], last.by_bin[joint]
    before, after = (replicate_test(item.bins, item.misfit, item.residual) for item in (a, b))
    is_repeated = after is not None and after.p_value * len(last.joints) <= REPEATS
    forms = free_form_scores(last, joint)
    chances = sign_flips(ScoreTable(last, Candidates(), tuple(forms)))
    level = NAMELESS / len(last.joints)
    passing = [form for form in forms if chances.p_value(form.added.key, form.surprise(last.scale)) <= level]
    best = max(passing, key=lambda form: evidence(last, form), default=None)
    is_clear = best is not None and evidence(last, best) > DECISIVE
    is_gone, shape = False, None
    verdict = MISSING if acting else ADEQUATE
    if acting and after is not None and after.floor is not None:
        floor2 = after.floor**2 + float(b.bins.count @ b.bins.inside / b.bins.count.sum())
        start2, end2 = (rmse(item.bins, item.misfit) ** 2 for item in (a, b))
        is_gone = start2 > EXCESS * floor2 and start2 - end2 >= ENOUGH * (start2 - min(floor2, end2))
    if is_clear or (is_repeated and not is_gone):
        verdict, top = UNEXPLAINED_JOINT, best or max(forms, key=lambda form: evidence(last, form), default=None)
        shape = None if top is None else _shape(last, top, is_clear=is_clear)
    return JointDiagnosis(joint, verdict, "", rmse(a.bins, a.misfit), None, before, unexplained=shape)


def _shape(solved: Fit, trial: ScoreTest, *, is_clear: bool) -> Unexplained:
    """The free form for people."""
    free = trial.added.effect
    assert isinstance(free, FreeForm) and trial.added.joint is not None
    knots, values, errors = knot_values(solved, trial)
    unit = VARIABLES[free.variable][0].format(unit=solved.model.robot.joint(trial.added.joint).position_unit)
    peak = float(knots[int(np.argmax(np.abs(values)))])
    row = solved.by_bin[trial.added.joint]
    freedom = len(row.bins) * (1.0 - solved.rank / max(solved.size, 1))
    explained = max(trial.statistic - trial.width, 0.0)
    excess = max(float(row.residual @ row.residual) - freedom, explained)
    gain = explained / excess if excess > 0.0 else 0.0
    text = f"what is left looks like {free.name}, largest at {peak:.3g} {unit}"
    return Unexplained(
        *(free.name, free.variable, unit, knots, values, errors, peak, float(gain), text), is_clear=is_clear
    )


#: FreeForm forms that are a family's own, and so no competitors of its effects.
OWN = {
    Family.SPEED: {"s f(v)"},
    Family.LOAD: {"s f(load)"},
    Family.POSITION: {"s f(q)"},
    Family.START: {"s f(travel)"},
    Family.TIME: {"s f(t)", "f(t)"},
    Family.TEMPERATURE: {"s f(t)", "f(t)"},
    Family.TORQUE: {"f(q)"},
}


def free_shape(
    solved: Fit, joint: int, *, families: Iterable[Family] = (), beyond: float = -np.inf
) -> Unexplained | None:
    """The free form, other than some families' own, that explains a joint best, if its evidence is `beyond`."""
    skipped = set[str]().union(*(OWN.get(family, set()) for family in families))
    forms = [form for form in free_form_scores(solved, joint) if form.added.effect.name not in skipped]
    best = max(forms, key=lambda form: evidence(solved, form), default=None)
    if best is None or evidence(solved, best) <= beyond:
        return None
    return _shape(solved, best, is_clear=evidence(solved, best) > DECISIVE)


#: Chance with which an effect of the limit's size is found.
POWER = 0.8
#: Fourth moment of a normal score over its square's square. Mean square of a wave of size one. Times an effect's usual
#: size beyond which a limit is that of rounding.
NORMAL, WAVE, ABSURD = 3.0, 0.5, 1e6
#: A: errors below this count as it.
TINY = float(np.finfo(float).tiny) ** 0.5
#: Why no size of an effect could be seen.
FAINT = "the fitted model absorbs all of it in these runs"


def detection_limits(scan: ScoreTable, family: SignFlips) -> dict[Key, Limit]:
    """The detection limit of every effect at every joint, in the unit of its first parameter.

    With information S of the parameter, all else refitted, a size a shifts the score by a sqrt(S) standard deviations;
    it is found in `POWER` of all cases when this exceeds the family-wise threshold, as it then is, by the normal
    quantile of `POWER`. It must also lower some joint's error by the share `WORTH`. Of an effect with a shape the limit
    is the median over shapes that can be seen.
    """
    robot, scale, projector = scan.solved.model.robot, scan.solved.scale, Projector(scan.solved)
    shares = {row.bins.joint: row.bins.count / row.bins.count.sum() for row in scan.solved.joints}
    errors = {row.bins.joint: max(rmse(row.bins, row.misfit), TINY) for row in scan.solved.joints}
    tests, out = {id(test.added): test for test in scan.trials}, dict[Key, Limit]()
    for key, group in scan.candidates.groups.items():
        falls = [shares[joint] @ (values / errors[joint]) ** 2 for joint, values in projector.columns(group).items()]
        largest = np.max(falls, axis=0, initial=0.0).reshape(len(group), -1)[:, 0] if falls else np.zeros(len(group))
        sizes = [
            _size(tests[id(term)], family, scan, fall=fall)
            for term, fall in zip(group, largest, strict=True)
            if id(term) in tests
        ]
        out[key] = _limit(robot, group[0].effect, key, float(np.median(sizes or [np.inf])))
    for waves in scan.spectra:
        shift = needed(family.threshold(waves.key, LEVEL), PERIODIC, runs=len(waves.scores))
        size = shift * float(np.sqrt(scale / np.median(waves.information)))
        least = errors[waves.key[1] or 0] * float(np.sqrt(2.0 * WORTH / WAVE))
        out[waves.key] = _limit(robot, catalogue()[waves.key[0]], waves.key, max(size, least))
    return out | {key: Limit(*key, "", None, "", why) for key, why in scan.candidates.excluded.items()}


def _size(test: ScoreTest, family: SignFlips, scan: ScoreTable, *, fall: float) -> float:
    """Of the first parameter, the others zero: what is found, and lowers an error by the share `WORTH`.

    `fall` is the largest share of a joint's squared error that a unit of it makes; what the model absorbs takes none
    away. A fitted size must be expected above a threshold by a margin to pass it with `POWER`.
    """
    information, key = float(test.information[0, 0]), test.added.key
    if information <= 0.0 or fall <= 0.0:
        return float("inf")
    error = float(np.sqrt(scan.solved.scale / information))
    threshold, gross = family.threshold(key, LEVEL), family.gross(key)
    # Runs, each telling as much as any other, that would flip like these.
    runs = min(NORMAL * alike(test.scores[:, :1]) or 1.0, len(test.scores)) / float(np.mean(scan.leverage**2))
    shown = needed(threshold, test.width, runs=runs, gross=gross) * error
    return max(shown, float(np.sqrt(2.0 * WORTH / (test.visible * fall)) + special.ndtri(POWER) * error))


def needed(surprise: float, freedoms: int, *, runs: float, gross: float = GROSS) -> float:
    """Standard deviations of shift that are found with `POWER` when the threshold is `surprise` (-log10 p).

    Flipped scores hold the effect, too: a shift of d, spread over R runs, raises the flips' squares and with them the
    threshold by the share d^2 / R; but beyond `gross` no flip is asked.
    """
    more = float(special.ndtri(POWER))
    threshold, surely = (float(special.chdtri(freedoms, 10.0**-alarm)) for alarm in (min(surprise, gross), gross))
    rest = 1.0 - threshold / runs
    upper = float(np.sqrt(surely)) + more
    if rest <= 0.0:
        return upper
    return min((more + float(np.sqrt(more**2 - rest * (more**2 - threshold)))) / rest, upper)


def _limit(robot: Robot, effect: Effect, key: Key, size: float) -> Limit:
    """Of that size; where it is infinite, with the reason and the runs in which the effect would be seen."""
    first = effect.parameters(robot, key[1] or 0)[0]
    if size < ABSURD * (abs(first.example) or 1.0):
        return Limit(*key, first.name, size, first.unit)
    best = f"; it is seen best in {effect.seen_in}" if effect.seen_in else ""
    return Limit(*key, first.name, None, first.unit, FAINT + best)
