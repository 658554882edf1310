"""Plans for one effect: the runs that show it or tell it from a rival, and the deciding runs of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pumaid.dataset import Dataset, Run
from pumaid.design.discrimination import SHAPES, showing
from pumaid.design.prior import Setup, prior_robots
from pumaid.diagnosis.candidates import grid_of
from pumaid.diagnosis.records import Finding
from pumaid.diagnosis.score_test import ScoreTest, refine_shape, scores_at
from pumaid.diagnosis.stepwise import DECISIVE, evidence
from pumaid.diagnosis.verdict import next_run
from pumaid.effect_spec import EffectTerm, at_one_joint, known_effect
from pumaid.effects import Scope
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import Estimate
from pumaid.estimation.fit import Fit, Projector, loaded
from pumaid.estimation.gls import fit_with_replicates
from pumaid.joint_bins import COARSE, joint_bins
from pumaid.model import Model
from pumaid.robot import EffectChoice, Robot
from pumaid.simulation import Bench
from pumaid.simulation.hidden_effects import LAWS, Hidden
from pumaid.simulation.virtual_robot import Truth
from pumaid.trajectory import NextRun, Plan, Posture, duration
from pumaid.units import number

#: Sets of runs at most: what takes more is no plan.
_MOST_SETS = 12
#: Sizes of an effect, SI.
_LEAST, _LARGEST = 1e-12, 1e9
#: Samples a second and bins a run of a rehearsal.
_RATE, _BINS = 50.0, 60


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
    effect = at_one_joint(wanted, robot, "--for")
    rival = None if against is None else at_one_joint(_beside(against, effect), robot, "--against")
    (truth, *_) = prior_robots(robot, estimate=prior, setup=Setup(), seed=seed).robots
    hidden = _of_size(robot, effect, usual(truth, effect), size)
    base = None
    if dataset is None:
        if whole is None:
            raise ValueError("without logs there must be an experiment to rehearse")
        base = whole()
        tell("rehearsing the experiment on a virtual robot")
        shown = truth if rival is None or hidden is None else truth.hiding([hidden])
        dataset = rehearsed(shown, base, seed=seed)
    solved = solved_on(robot, [run for run in dataset.runs if not run.heldout])
    tell("choosing runs")
    if rival is None:
        title, notes = f"shows {_name(effect)}", list[Note]()
        runs = _shown(solved, effect, {} if hidden is None else hidden.values)
    else:
        title = f"tells {_name(effect)} from {_name(rival)}"
        runs, notes = _told_apart(solved, effect, rival, with_logs=base is None)
    return _plan(base or Plan(robot.name, ()), runs, robot, title=title, notes=notes)


def rehearsed(truth: Truth, plan: Plan, *, seed: int) -> Dataset:
    """The fitted runs of a plan as a virtual robot would make them."""
    fitted = replace(plan, motions=tuple(motion for motion in plan.motions if motion.purpose == "fit"))
    return Dataset(Bench(truth, fitted, rate=_RATE, bins=_BINS).runs(np.random.default_rng([seed, 5])))


def solved_on(robot: Robot, runs: Sequence[Run]) -> Fit:
    """The base model fitted to runs, as diagnosis starts from it."""
    return loaded(fit_with_replicates(Model.of_runs(robot, runs), joint_bins(robot, runs, most=COARSE)))


def usual(truth: Truth, wanted: EffectChoice) -> Hidden | None:
    """An effect with sizes that show at a robot and do not rule it; None where the simulator has no such effect."""
    if wanted.effect not in LAWS:
        return None
    try:
        return truth.hiding([Hidden(wanted.effect, wanted.joint, dict(wanted.shape))]).hidden[0]
    except ModelError:
        return None


def _beside(rival: EffectChoice, wanted: EffectChoice) -> EffectChoice:
    """A rival at the joint of what it rivals where it names none."""
    arm_wide = known_effect(rival.effect, Where(field=f"--against {rival.effect}")).scope is Scope.ARM
    return rival if rival.joint is not None or arm_wide else replace(rival, joint=wanted.joint)


def _of_size(robot: Robot, wanted: EffectChoice, typical: Hidden | None, size: float | None) -> Hidden | None:
    """The effect at a usual robot, of the size that is asked for."""
    if size is None:
        return typical
    if not _LEAST <= abs(size) <= _LARGEST:
        what, mend = f"no arm has an effect of the size {size:g}", f"give a number from {_LEAST:g} to {_LARGEST:g}"
        raise ModelError("plan-impossible", what, Where(field=f"--for {wanted.effect}"), mend)
    effect, joint = known_effect(wanted.effect, Where()), wanted.joint or 0
    first, shapes = effect.parameters(robot, joint)[0].name, {shape.name for shape in effect.shapes(robot, joint)}
    values = {} if typical is None else typical.values
    share = size / values[first] if values.get(first) else 1.0
    scaled = {name: value if name in shapes else share * value for name, value in values.items()}
    return Hidden(wanted.effect, wanted.joint, {**scaled, first: size})


def _shown(solved: Fit, wanted: EffectChoice, values: Mapping[str, float]) -> NextRun:
    """The runs that show an effect of these sizes and shapes."""
    robot, effect, joint = solved.model.robot, known_effect(wanted.effect, Where()), wanted.joint or 0
    names = [shape.name for shape in effect.shapes(robot, joint)]
    shape = {name: value for name, value in {**values, **wanted.shape}.items() if name in names}
    size = values.get(effect.parameters(robot, joint)[0].name)
    shown = showing(solved, effect, wanted.joint, size=size, shape=shape)
    if shown is None:
        of = "" if size is None else f" of the size {number(size, 3)}"
        raise _undecided(f"no run within the limits shows {_name(wanted)}{of}")
    return shown


def _told_apart(
    solved: Fit, wanted: EffectChoice, rival: EffectChoice, *, with_logs: bool
) -> tuple[NextRun, list[Note]]:
    """The runs that tell an effect from a rival, and a note where the runs before them do already."""
    projector = Projector(solved)
    first, second = (_best_trial(solved, projector, choice) for choice in (wanted, rival))
    lead = evidence(solved, first) - evidence(solved, second)
    notes = list[Note]()
    if lead > DECISIVE:
        text = (
            f"the runs before these tell {_name(wanted)} of this size from {_name(rival)} already (evidence"
            f" {number(lead, 3)}, decisive from {DECISIVE:g}); a smaller one needs more"
        )
        notes.append(Note("plan-decided", text))
    runs = next_run(solved, first, second)
    if not runs.motions:
        of = " of the size that these logs have of them" if with_logs else ""
        mend = "plan without --logs for the size that you look for" if with_logs else ""
        raise _undecided(f"no run within the limits tells {_name(wanted)} from {_name(rival)}{of}", mend)
    return runs, notes


def _best_trial(solved: Fit, projector: Projector, choice: EffectChoice) -> ScoreTest:
    """The effect at its best shape on the runs so far."""
    law = known_effect(choice.effect, Where())
    terms = [EffectTerm(law, choice.joint, dict(choice.shape))] if choice.shape else grid_of(solved, law, choice.joint)
    terms = terms[:: max(1, len(terms) // SHAPES)] or [EffectTerm(law, choice.joint)]
    trials = [trial for trial in scores_at(projector, terms) if trial is not None]
    if not trials:
        raise _undecided(f"{_name(choice)} leaves no trace in these runs that the model does not absorb")
    return refine_shape(projector, max(trials, key=lambda trial: trial.statistic))


def _undecided(what: str, mend: str = "") -> ModelError:
    mend = mend or "widen limits or speeds in the recipe, look for a larger effect, or add a sensor"
    return ModelError("plan-undecided", what, mend=mend)


def _name(choice: EffectChoice) -> str:
    return choice.effect if choice.joint is None else f"{choice.effect}@{choice.joint}"


def _plan(base: Plan, added: NextRun, robot: Robot, *, title: str, notes: Sequence[Note]) -> Plan:
    """The runs as often as it takes, on top of the experiment that was rehearsed."""
    sets = min(added.repeats or 1, _MOST_SETS)
    longer = replace(base, motions=(*base.motions, *(added.motions * sets)), efficiency=None)
    holds = dict.fromkeys((motion.joint, motion.hold) for motion in added.motions)
    reasons = [Posture(joint, hold, (), f"{title}: {added.text}") for joint, hold in holds]
    times = f"made {sets} times" if sets > 1 else "made once"
    sentence = f"A set of {len(added.motions)} runs, {times}, {title}: {added.text}."
    return replace(
        longer,
        postures=(*base.postures, *reasons),
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
