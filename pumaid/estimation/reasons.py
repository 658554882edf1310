"""Why the data do not determine a parameter, and the run that would show it, in the user's words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pumaid.dataset import Run
from pumaid.effect_spec import Column
from pumaid.effects import Family, Scope
from pumaid.joint_bins import SAME_POSTURE
from pumaid.kinematics import grouped, marked, near
from pumaid.model import Model
from pumaid.units import number

#: Speeds within this share of each other are one speed, to someone who would tell Coulomb from viscous friction.
ONE_SPEED = 0.02

#: A current below this (A) is rounding, not a load.
UNFELT = 1e-7

#: A load of this many standard errors is felt, whatever else keeps its ratio from being known.
SURELY_FELT = 5.0


@dataclass(frozen=True, slots=True)
class Reason:
    """A sentence and the run that would show the parameter (None where no run would)."""

    text: str
    next_run: str | None = None


@dataclass(frozen=True, slots=True)
class Facts:
    """What the runs of one joint cover: speeds each way, sets of positions of the joints outward of it, strokes."""

    joint: int
    runs: int
    speeds: dict[int, tuple[float, ...]]
    postures: int
    strokes: int

    @classmethod
    def of(cls, joint: int, runs: Sequence[Run]) -> Facts:
        """Of the runs in which `joint` (from 1) moves."""
        moving = [run for run in runs if run.joint == joint]
        speeds = {sign: tuple(sorted(abs(run.speed) for run in moving if run.direction == sign)) for sign in (1, -1)}
        strokes = sum(run.kind == "stroke" for run in moving)
        held = np.array([run.posture[joint:] for run in moving])
        sets = _postures(held.tobytes(), len(moving)) if moving else 0
        return cls(joint, len(moving), speeds, sets, strokes)

    def has_one_speed(self, sign: int) -> bool:
        """Whether all runs in direction `sign` have practically one speed."""
        speeds = self.speeds[sign]
        return bool(speeds) and not self.strokes and speeds[-1] - speeds[0] <= ONE_SPEED * speeds[-1]


@lru_cache(maxsize=16)  # asked for by every table of one fit
def _postures(positions: bytes, count: int) -> int:
    """How many sets of positions there are among `count` sets of the same joints'."""
    held = np.frombuffer(positions).reshape(count, -1)
    alike = grouped(count, lambda one, others: marked(others, near(held, one, others, within=SAME_POSTURE)))
    return sum(1 for _ in alike)


def of_column(
    model: Model, column: Column, *, facts: dict[int, Facts], partners: Sequence[str], lever: float = 1.0
) -> Reason:
    """Why `column` is not determined.

    Parameters
    ----------
    model
        The model fitted.
    column
        One of its columns.
    facts
        By joint (from 1).
    partners
        Names of the other parameters with which it is only determined together.
    lever
        RMS of the column over its joint's own runs, as a share of what it is when the axis lies level.
    """
    if column.place is not None:
        return _of_effect(model, column, facts, partners)
    covered = facts[column.owner]
    if covered.runs == 0:
        return NO_RUNS
    if column.effect in ("coulomb", "viscous"):
        return _friction(model, column, own=covered, partners=partners)
    if column.effect == "gravity":
        if not model.robot.joint(column.owner).is_revolute and any(name.startswith("coulomb") for name in partners):
            return ONE_LOAD
        return UPRIGHT if lever < LEAST_LEVER else _gravity(column, covered, partners)
    shared = some(partners) or "nothing that these runs vary"
    return Reason(f"only determined together with {shared}", "repeat its runs in another posture and at other speeds")


#: Family of an effect -> the run that would show it better.
MORE = {
    Family.SPEED: "run the joint at more speeds, slow and fast ones",
    Family.LOAD: "run the joint in postures in which it carries much and little",
    Family.POSITION: "let the joint travel further, in both directions",
    Family.TORQUE: "let the joint travel further, in both directions",
    Family.START: "run the joint from rest, at several speeds",
    Family.PAYLOAD: "spread repeated runs over a longer time",
    Family.TIME: "spread repeated runs over a longer time",
    Family.TEMPERATURE: "repeat runs with the motor cold and warm",
    Family.GRAVITY: "repeat the runs with the other joints elsewhere",
    Family.CURRENT: "run the joint in postures in which it draws more",
    Family.MOTION: "run the joint with harder acceleration, and slowly",
}


def _of_effect(model: Model, column: Column, facts: dict[int, Facts], partners: Sequence[str]) -> Reason:
    """Of a parameter of a chosen effect."""
    if column.scope in (Scope.JOINT, Scope.LINK) and facts[column.owner].runs == 0:
        return NO_RUNS
    same = [name for name in partners if name.split(".")[0] == column.effect]
    rest = [name for name in partners if name not in same]
    effect = model.effects[column.place or 0].effect
    more = MORE.get(effect.family, MORE[Family.POSITION])
    if column.shape is not None:
        term = model.effects[column.place or 0]
        best = f"best at its bound, {number(term.shape[column.shape])}" if column.shape in term.held else ""
        return Reason(best or "these data fit nearly as well with any value of it that is physical", more)
    if not partners:
        return Reason("nothing in these runs depends on it", more)
    return Reason(f"these data could not tell it from {some(rest or same)}", more)


#: Share of its full lever below which a weight is as good as not felt: an axis within two degrees of upright.
LEAST_LEVER = 0.035

#: Of a joint whose axis never lay level.
UPRIGHT = Reason(
    "the joint's axis stood upright in all its runs, so it felt next to nothing of this weight",
    "repeat its runs with the joints before it turned so that its axis lies level",
)

#: Of a joint that the logs never move alone.
NO_RUNS = Reason("waits for logs in which its joint moves alone", "move the joint alone, at several speeds, both ways")


#: Of a prismatic joint whose load is the same in all its runs.
ONE_LOAD = Reason(
    "in these logs the joint's axis keeps one angle to gravity, so its constant load cannot be told from Coulomb"
    " friction",
    "repeat its runs with the joints before it turned so that its axis stands at another angle to gravity",
)


def some(names: Sequence[str]) -> str:
    """Up to three names, and how many more there are."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _friction(model: Model, column: Column, *, own: Facts, partners: Sequence[str]) -> Reason:
    sign, way, other = (1, "forward", "backward") if column.name.endswith(".plus") else (-1, "backward", "forward")
    if not own.speeds[sign]:
        return Reason(f"the joint never moves {way} in these logs", f"repeat its {other} runs {way}")
    low, high = own.speeds[sign][0], own.speeds[sign][-1]
    joint = model.robot.joint(column.owner)
    unit = f"{joint.position_unit}/s"
    pair = {f"{effect}.j{column.owner}.{column.name.rsplit('.', 1)[1]}" for effect in ("coulomb", "viscous")}
    if pair - {column.name} <= set(partners):
        speeds = f"has practically one speed ({number(high, 2)} {unit})"
        if not own.has_one_speed(sign):
            speeds = f"has a speed between {number(low, 2)} and {number(high, 2)} {unit}"
        return Reason(
            f"every {way} run {speeds}, so Coulomb and viscous friction cannot be told apart, only their sum at that"
            " speed",
            f"repeat a {way} run at {number(high / 3.0, 2)} {unit}",
        )
    if not joint.is_revolute:
        return ONE_LOAD
    return Reason(
        "over the span that the joint travels, its friction cannot be told from its weight",
        "let it travel further, in both directions",
    )


def _gravity(column: Column, own: Facts, partners: Sequence[str]) -> Reason:
    outer = sorted(name for name in partners if name.startswith(("gravity", "gain_ratio")))
    beyond = [name for name in outer if _number(name) > column.owner]
    if beyond and own.postures < 2:
        return Reason(
            "the joints outward of it were held in one posture only, so its weight cannot be told from that of the"
            f" links outward ({some(beyond)})",
            "repeat its runs with the joints outward of it held elsewhere",
        )
    if outer and not any(name.startswith(("coulomb", "viscous")) for name in partners):
        return Reason(f"only determined together with {some(outer)}", "repeat its runs with the other joints elsewhere")
    if partners:
        return Reason(
            "over the span and directions in which the joint travels, its weight cannot be told from its friction",
            "let it travel further, in both directions",
        )
    return UPRIGHT


def _number(name: str) -> int:
    """Joint or link number in a parameter's name."""
    return int(name.split(".")[1].lstrip("lj"))


def of_ratio(
    model: Model, inner: int, outer: int, *, facts: dict[int, Facts], felt: float = 0.0, noise: float = 0.0
) -> Reason:
    """Why eta_inner / eta_outer is not determined.

    Parameters
    ----------
    model
        The model fitted.
    inner, outer
        Joints (from 1).
    facts
        By joint.
    felt
        RMS (A) of the part of joint `inner`'s current that carries the ratio; 0 where there is none.
    noise
        Standard error (A) of that part: felt must be several times this.
    """
    redundant = model.structure.redundant.get((inner, outer))
    if redundant is not None:
        return Reason(redundant)
    for joint in (inner, outer):
        if facts[joint].runs == 0:
            return Reason(f"waits for logs in which joint {joint} moves alone", NO_RUNS.next_run)
    level = f"repeat the runs of joint {inner}, its axis level, with joint {outer} held at two or more positions"
    if facts[inner].postures < 2:
        return Reason(
            f"the joints outward of joint {inner} were held in one posture only, so its own weight cannot be told from"
            " the weight outward of it",
            level,
        )
    if UNFELT < felt < SURELY_FELT * noise:
        return Reason(
            f"link {outer} is too light to be felt by joint {inner}: its weight moves that current by about"
            f" {number(felt, 2)} A, known to {number(noise, 2)} A",
            f"repeat the runs of joint {inner} with a payload and joint {outer} held at two positions",
        )
    return Reason(
        f"in no posture of these logs can joint {inner}'s own weight be told from the weight outward of it",
        level,
    )
