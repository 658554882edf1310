"""Plan the runs that would show an effect, or tell it from a rival."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from pumaid.dataset import Dataset
from pumaid.design.prior import Setup, prior_robots
from pumaid.diagnosis.deciding import deciding, showing
from pumaid.diagnosis.rehearsal import rehearsed, solved, usual
from pumaid.diagnosis.score_test import Projector, ScoreTest, refine_shape, scores_at
from pumaid.diagnosis.stepwise import DECISIVE, evidence
from pumaid.effect_spec import EffectTerm, at_one_joint, known_effect
from pumaid.effects import Effect, Scope
from pumaid.errors import ModelError, Note, Where
from pumaid.estimation.fit import Fit
from pumaid.records import Estimate, NextRun
from pumaid.robot import EffectChoice, Robot
from pumaid.simulation.hidden import Hidden
from pumaid.trajectory import Motion, Plan, Posture, duration
from pumaid.units import number

#: Sets of runs at most: what takes more is no plan.
_MOST_SETS = 12
#: Sizes of an effect, SI.
_LEAST, _LARGEST = 1e-12, 1e9
#: Shapes with which an effect is tried before its best is refined.
_SHAPES = 24


def decide(
    robot: Robot,
    wanted: EffectChoice,
    *,
    against: EffectChoice | None = None,
    size: float | None = None,
    ground: Plan | None = None,
    logs: Dataset | None = None,
    estimate: Estimate | None = None,
    seed: int = 0,
    tell: Callable[[str], None] | None = None,
) -> Plan:
    """Plan the runs after which an effect is seen, if it is there, or told from a rival.

    By the same code as the deciding run of a diagnosis: laps within the limits, in postures of the data and in new
    ones, are chosen for what is left of the effect once the whole model, and the rival with any shape, are refitted.
    Without logs an experiment is rehearsed on a virtual robot first, and the runs come on top of it.

    Parameters
    ----------
    robot
        The arm.
    wanted
        Effect and joint; shapes where they are known.
    against
        What it must be told from; none: it must be seen at all.
    size
        Of the effect's first parameter, SI, others in proportion; else such that it shows at a usual robot. What must
        be told from a rival in logs has the size that it has there.
    ground
        The experiment that is rehearsed; needed without `logs`.
    logs
        Runs that were made; their `estimate` is made where not given.
    estimate
        An earlier model: of the logs where there are some, else the robot on which is rehearsed.
    seed
        Of the virtual robot.
    tell
        Called with a word on what is done.

    Returns
    -------
    plan
        The runs: on top of `ground` without logs, alone with logs; `assumptions` say what they tell, and how sure.

    Raises
    ------
    ModelError [plan-undecided]
        No runs within the limits show it, or tell the two apart.
    ModelError [plan-impossible]
        A size of nothing.
    ModelError [unknown-effect], [effect-joint], [effect-not-here]
        There is no such effect, or not at that joint.
    """
    say = tell or _silent
    one = at_one_joint(wanted, robot, "--for")
    rival = None if against is None else at_one_joint(_beside(against, one), robot, "--against")
    truth = prior_robots(robot, estimate=estimate if logs is None else None, setup=Setup(), seed=seed).robots[0]
    if logs is None and ground is None:
        raise ValueError("without logs there must be an experiment to rehearse")
    hidden = _hidden(robot, one, usual(truth, one), size)
    if logs is None:
        say("rehearsing the experiment on a virtual robot")
        assert ground is not None
        shown = truth if rival is None or hidden is None else truth.hiding([hidden])
        system = solved(robot, rehearsed(shown, ground, seed=seed).runs)
    else:
        runs = [run for run in logs.runs if not run.heldout]
        system = solved(robot, runs)
    say("choosing runs")
    told: tuple[Note, ...] = ()
    if rival is None:
        found = _shown(system, one, {} if hidden is None else hidden.values)
    else:
        found, told = _told_apart(system, one, rival, with_logs=logs is not None)
    return _plan(robot, found, ground if logs is None else None, title=_title(one, rival), notes=told)


def _silent(_: str) -> None:
    """Nobody listens."""


def _beside(rival: EffectChoice, wanted: EffectChoice) -> EffectChoice:
    """A rival at the joint of what it rivals where it names none."""
    arm_wide = known_effect(rival.effect, Where(field=f"--against {rival.effect}")).scope is Scope.ARM
    return rival if rival.joint is not None or arm_wide else replace(rival, joint=wanted.joint)


def _first(wanted: EffectChoice, robot: Robot) -> str:
    """The effect's first parameter."""
    return _law(wanted).parameters(robot, wanted.joint or 0)[0].name


def _hidden(robot: Robot, wanted: EffectChoice, found: Hidden | None, size: float | None) -> Hidden | None:
    """The effect at a usual robot, of the size that is asked for."""
    if size is None:
        return found
    if not _LEAST <= abs(size) <= _LARGEST:
        what, mend = f"no arm has an effect of the size {size:g}", f"give a number from {_LEAST:g} to {_LARGEST:g}"
        raise ModelError("plan-impossible", what, Where(field=f"--for {wanted.effect}"), mend)
    values = {} if found is None else found.values
    first, shapes = _first(wanted, robot), {one.name for one in _law(wanted).shapes(robot, wanted.joint or 0)}
    share = size / values[first] if values.get(first) else 1.0
    scaled = {name: value if name in shapes else share * value for name, value in values.items()}
    return Hidden(wanted.effect, wanted.joint, {**scaled, first: size})


def _law(wanted: EffectChoice) -> Effect:
    """The effect by its name, which has been checked."""
    return known_effect(wanted.effect, Where())


def _shown(system: Fit, wanted: EffectChoice, values: Mapping[str, float]) -> NextRun:
    """The runs that show an effect of the sizes and shapes that a usual robot has."""
    robot, effect = system.model.robot, _law(wanted)
    shapes = {one.name for one in effect.shapes(robot, wanted.joint or 0)}
    shape = {name: value for name, value in {**values, **wanted.shape}.items() if name in shapes}
    size = values.get(_first(wanted, robot))
    found = showing(system, effect, wanted.joint, size=size, shape=shape)
    if found is None or not found.motions:
        of = "" if size is None else f" of the size {number(size, 3)}"
        raise _undecided(f"no run within the limits shows {_name(wanted)}{of}")
    return found


def _told_apart(
    system: Fit, wanted: EffectChoice, rival: EffectChoice, *, with_logs: bool
) -> tuple[NextRun, tuple[Note, ...]]:
    projector = Projector(system)
    first, second = (_best(system, projector, one) for one in (wanted, rival))
    lead = evidence(system, first) - evidence(system, second)
    notes: tuple[Note, ...] = ()
    if lead > DECISIVE:
        text = (
            f"the runs before these tell {_name(wanted)} of this size from {_name(rival)} already (evidence"
            f" {number(lead, 3)}, decisive from {DECISIVE:g}); a smaller one needs more"
        )
        notes = (Note("plan-decided", text),)
    found = deciding(system, first, second)
    if not found.motions:
        of = " of the size that these logs have of them" if with_logs else ""
        mend = "plan without --logs for the size that you look for" if with_logs else None
        raise _undecided(f"no run within the limits tells {_name(wanted)} from {_name(rival)}{of}", mend)
    return found, notes


def _best(system: Fit, projector: Projector, choice: EffectChoice) -> ScoreTest:
    """The effect at its best shape on what there is."""
    robot, effect = system.model.robot, _law(choice)
    rows = [row for row in system.joints if row.bins.joint == choice.joint] or list(system.joints[:1])
    grid = [dict(choice.shape)] if choice.shape else list(effect.grid(robot, rows[0].bins.extent(rows[0].drawn)))
    every = max(1, len(grid) // _SHAPES)
    some = [EffectTerm(effect, choice.joint, dict(shape)) for shape in (grid[::every] or [{}])]
    found = [one for one in scores_at(projector, some) if one is not None]
    if not found:
        raise _undecided(f"{_name(choice)} leaves no trace in these runs that the model does not absorb")
    return refine_shape(projector, max(found, key=lambda one: one.statistic))


def _undecided(what: str, mend: str | None = None) -> ModelError:
    usual_mend = "widen limits or speeds in the recipe, look for a larger effect, or add a sensor"
    return ModelError("plan-undecided", what, mend=mend or usual_mend)


def _name(choice: EffectChoice) -> str:
    return choice.effect if choice.joint is None else f"{choice.effect}@{choice.joint}"


def _title(wanted: EffectChoice, rival: EffectChoice | None) -> str:
    return f"shows {_name(wanted)}" if rival is None else f"tells {_name(wanted)} from {_name(rival)}"


def _plan(robot: Robot, found: NextRun, ground: Plan | None, *, title: str, notes: tuple[Note, ...]) -> Plan:
    """The runs as often as it takes, on top of the experiment that was rehearsed."""
    sets = min(found.repeats or 1, _MOST_SETS)
    more: tuple[Motion, ...] = tuple(found.motions) * sets
    holds = dict.fromkeys((motion.joint, motion.hold) for motion in found.motions)
    reasons = [Posture(joint, hold, (), f"{title}: {found.text}") for joint, hold in holds]
    base = ground or Plan(robot=robot.name, motions=())
    times = f"made {sets} times" if sets > 1 else "made once"
    return replace(
        base,
        motions=(*base.motions, *more),
        postures=(*base.postures, *reasons),
        duration=duration(robot, replace(base, motions=(*base.motions, *more))),
        efficiency=None,
        assumptions=(*base.assumptions, f"A set of {len(found.motions)} runs, {times}, {title}: {found.text}."),
        notes=(*base.notes, *notes),
    )
