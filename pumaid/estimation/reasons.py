"""Why the data do not determine a parameter, and the run that would show it: a table of reasons, and which applies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pumaid.dataset import BLOCK, Run
from pumaid.effect_spec import Column
from pumaid.effects import Family, Scope
from pumaid.errors import listed
from pumaid.joint_bins import SAME_POSTURE
from pumaid.kinematics import posture_groups
from pumaid.model import Model
from pumaid.preprocessing.options import CONSTANT
from pumaid.units import number

#: Speeds within this share of each other are one speed, to someone who would tell Coulomb from viscous friction.
ONE_SPEED = 0.02
#: A current below this (A) is rounding, not a load.
UNFELT = 1e-7
#: A load of this many standard errors is felt, whatever else keeps its ratio from being known.
SURELY_FELT = 5.0
#: Share of its full lever below which a weight is as good as not felt: an axis within two degrees of upright.
LEAST_LEVER = 0.035

#: Names that a reason lists at most.
NAMED = 3

MOVE_ALONE = "move the joint alone, at several speeds, both ways"
ACCELERATE = "record motion in which several joints accelerate at once"
LEVEL = "repeat the runs of joint {inner}, its axis level, with joint {outer} held at two or more positions"
WITH_TOOL = "record more, and more varied, motion, with a tool or payload of 1 to 2 kg"
TRAVEL = "let the joint travel further, in both directions"
#: Kind -> why a parameter is not determined, and the run that would show it (None where no run would).
REASONS: dict[str, tuple[str, str | None]] = {
    "no runs": ("waits for logs in which its joint moves alone", MOVE_ALONE),
    "no runs of one joint": ("waits for logs in which joint {joint} moves alone", MOVE_ALONE),
    "together": ("only determined together with {names}", "repeat its runs in other postures and at other speeds"),
    "not accelerated": ("no motion in these logs shows it", ACCELERATE),
    "inertia in sums": ("these logs show it only in sums with inertias of other links", ACCELERATE),
    "one direction": ("the joint never moves {way} in these logs", "repeat its {other} runs {way}"),
    "one speed": (
        "every {way} run has {speeds} {unit}, so Coulomb and viscous friction cannot be told apart, only their sum at"
        " that speed",
        "repeat a {way} run at {slower} {unit}",
    ),
    "friction and weight": (
        "over the span and directions in which the joint travels, its friction cannot be told from its weight",
        TRAVEL,
    ),
    "one load": (
        "in these logs the joint's axis keeps one angle to gravity, so its constant load cannot be told from Coulomb"
        " friction",
        "repeat its runs with the joints before it turned so that its axis stands at another angle to gravity",
    ),
    "upright": (
        "the joint's axis stood upright in all its runs, so it felt next to nothing of this weight",
        "repeat its runs with the joints before it turned so that its axis lies level",
    ),
    "one posture": (
        "the joints outward of it were held in one posture only, so its weight cannot be told from that of the links"
        " outward ({names})",
        "repeat its runs with the joints outward of it held elsewhere",
    ),
    "several joints": (
        "it acts on several joints, and the recursion solves one after the other; identify without --recursive",
        None,
    ),
    "confounded": ("these data could not tell it from {names}", None),
    "at bound": ("best at its bound, {bound}", None),
    "any value": ("these data fit nearly as well with any value of it that is physical", None),
    "no effect": ("nothing in these runs depends on it", None),
    "no size": ("no size of {effect} shows in these data", None),
    "ratio, one posture": (
        "the joints outward of joint {inner} were held in one posture only, so its own weight cannot be told from the"
        " weight outward of it",
        LEVEL,
    ),
    "ratio, light link": (
        "link {outer} is too light to be felt by joint {inner}: its weight moves that current by about {felt} A, known"
        " to {noise} A",
        "repeat the runs of joint {inner} with a payload and joint {outer} held at two positions",
    ),
    "ratio, light link in motion": (
        "link {outer} is too light to be felt by joint {inner}: what it asks of that current is about {felt} A, known"
        " to {noise} A",
        WITH_TOOL,
    ),
    "ratio in motion": (
        "in this motion joint {inner}'s own load cannot be told from the load outward of it",
        WITH_TOOL,
    ),
    "ratio": (
        "in no posture of these logs can joint {inner}'s own weight be told from the weight outward of it",
        LEVEL,
    ),
}

#: Family of an effect -> the run that would show it better.
MORE = {
    Family.SPEED: "run the joint at more speeds, slow and fast ones",
    Family.LOAD: "run the joint in postures in which it carries much and little",
    Family.POSITION: TRAVEL,
    Family.TORQUE: TRAVEL,
    Family.START: "run the joint from rest, at several speeds",
    Family.PAYLOAD: "spread repeated runs over a longer time",
    Family.TIME: "spread repeated runs over a longer time",
    Family.TEMPERATURE: "repeat runs with the motor cold and warm",
    Family.GRAVITY: "repeat the runs with the other joints elsewhere",
    Family.CURRENT: "run the joint in postures in which it draws more",
    Family.MOTION: "run the joint with harder acceleration, and slowly",
}


#: The fields `reason` and `next_run` of a `Value` that is not determined.
Reason = dict[str, Any]


def reason(kind: str, **values: object) -> Reason:
    """An entry of `REASONS` with its values; `more`, where given, is the next run."""
    text, next_run = REASONS[kind]
    next_run = str(values["more"]) if "more" in values else next_run
    return {"reason": text.format(**values), "next_run": next_run and next_run.format(**values)}


@dataclass(frozen=True, slots=True)
class JointCoverage:
    """What the runs of one joint cover: speeds by direction, sets of positions of the joints outward of it, strokes."""

    runs: int
    speeds: Mapping[int, tuple[float, ...]]
    postures: int
    strokes: int

    @classmethod
    def of(cls, joint: int, runs: Sequence[Run]) -> "JointCoverage":
        """Of the runs in which `joint` (from 1) moves."""
        moving = [run for run in runs if run.joint == joint]
        speeds = {}
        for sign in (1, -1):  # in a block the highest counts
            of_blocks = [float(np.max(sign * run.bins.velocity)) for run in moving if run.kind == BLOCK]
            of_runs = [abs(run.speed) for run in moving if run.kind != BLOCK and run.direction == sign]
            speeds[sign] = tuple(sorted(speed for speed in (*of_blocks, *of_runs) if speed > 0.0))
        held = np.array([run.posture[joint:] for run in moving])
        postures = posture_groups(held, SAME_POSTURE)
        # In a block the joints outward move, too.
        many = any(run.kind == BLOCK for run in moving)
        return cls(len(moving), speeds, max(len(postures), 2 * many), sum(run.kind != CONSTANT for run in moving))

    def has_one_speed(self, sign: int) -> bool:
        """Whether all runs in direction `sign` have practically one speed."""
        speeds = self.speeds[sign]
        return bool(speeds) and not self.strokes and speeds[-1] - speeds[0] <= ONE_SPEED * speeds[-1]


def of_column(
    model: Model, column: Column, *, coverage: Mapping[int, JointCoverage], partners: Sequence[str], lever: float = 1.0
) -> Reason:
    """Why `column` is not determined.

    `partners` are the other parameters with which it is only determined together, `lever` the RMS of the column over
    its joint's own runs, as a share of what it is when the axis lies level.
    """
    if column.scope in (Scope.JOINT, Scope.LINK) and coverage[column.owner].runs == 0:
        return reason("no runs")
    if column.place is not None:
        term = model.effects[column.place]
        more = MORE.get(term.effect.family, TRAVEL)
        if column.shape in term.held:
            return reason("at bound", bound=number(term.shape[column.shape]), more=more)
        if column.shape is not None or not partners:
            return reason("no effect" if column.shape is None else "any value", more=more)
        rest = [name for name in partners if name.split(".")[0] != column.effect]
        return reason("confounded", names=listed(rest or partners, NAMED), more=more)
    if column.effect in ("coulomb", "viscous"):
        return _of_friction(model, column, coverage[column.owner], partners)
    if column.effect != "gravity":
        kind = "together" if 0 < len(partners) <= NAMED else "inertia in sums" if partners else "not accelerated"
        return reason(kind, names=listed(partners, NAMED))
    of_friction = any(name.startswith(("coulomb", "viscous")) for name in partners)
    if not model.robot.joint(column.owner).is_revolute and of_friction:
        return reason("one load")
    outer = sorted(name for name in partners if name.startswith(("gravity", "gain_ratio")))
    beyond = [name for name in outer if int(name.split(".")[1].lstrip("l")) > column.owner]
    if lever < LEAST_LEVER or not partners:
        return reason("upright")
    if beyond and coverage[column.owner].postures < 2:
        return reason("one posture", names=listed(beyond, NAMED))
    return (
        reason("together", names=listed(outer, NAMED)) if outer and not of_friction else reason("friction and weight")
    )


def _of_friction(model: Model, column: Column, covered: JointCoverage, partners: Sequence[str]) -> Reason:
    side = column.name.rsplit(".", 1)[1]
    sign, way, other = (1, "forward", "backward") if side == "plus" else (-1, "backward", "forward")
    if not covered.speeds[sign]:
        return reason("one direction", way=way, other=other)
    joint, low, high = model.robot.joint(column.owner), covered.speeds[sign][0], covered.speeds[sign][-1]
    pair = {f"{effect}.j{column.owner}.{side}" for effect in ("coulomb", "viscous")}
    if pair - {column.name} <= set(partners):
        speeds = f"practically one speed, {number(high, 2)}"
        if not covered.has_one_speed(sign):
            speeds = f"a speed between {number(low, 2)} and {number(high, 2)}"
        unit, slower = f"{joint.position_unit}/s", number(high / 3.0, 2)
        return reason("one speed", way=way, speeds=speeds, slower=slower, unit=unit)
    return reason("friction and weight" if joint.is_revolute else "one load")


def of_ratio(
    model: Model,
    inner: int,
    outer: int,
    *,
    coverage: Mapping[int, JointCoverage],
    load: tuple[float, float] = (0.0, 0.0),
) -> Reason:
    """Why eta_inner / eta_outer (joints from 1) is not determined.

    `load` is the RMS (A) of the part of joint `inner`'s current that carries the ratio, and that part's standard error
    (A).
    """
    redundant = model.structure.redundant.get((inner, outer))
    if redundant is not None:
        return {"reason": redundant, "next_run": None}
    for joint in (inner, outer):
        if coverage[joint].runs == 0:
            return reason("no runs of one joint", joint=joint)
    (felt, noise), kind = load, "ratio"
    if coverage[inner].postures < 2:
        kind = "ratio" if model.is_dynamic else "ratio, one posture"
    elif UNFELT < felt < SURELY_FELT * noise:
        kind = "ratio, light link"
    kind = f"{kind} in motion" if model.is_dynamic else kind
    return reason(kind, inner=inner, outer=outer, felt=number(felt, 2), noise=number(noise, 2))
