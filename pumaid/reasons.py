"""Why the data do not determine a parameter, and the run that would show it, in the user's words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pumaid.model import SAME_POSTURE, Column, Model
from pumaid.records import Run
from pumaid.units import number

#: Speeds within this share of each other are one speed, to someone who would tell Coulomb from viscous friction.
ONE_SPEED = 0.02


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
        own = [run for run in runs if run.joint == joint]
        held: list[np.ndarray] = []
        for run in own:
            if not any(np.all(np.abs(run.posture[joint:] - other[joint:]) < SAME_POSTURE) for other in held):
                held.append(run.posture)
        speeds = {sign: tuple(sorted(abs(run.speed) for run in own if run.direction == sign)) for sign in (1, -1)}
        strokes = sum(run.kind == "stroke" for run in own)
        return cls(joint, len(own), speeds, len(held), strokes)

    def has_one_speed(self, sign: int) -> bool:
        """Whether all runs in direction `sign` have practically one speed."""
        speeds = self.speeds[sign]
        return bool(speeds) and not self.strokes and speeds[-1] - speeds[0] <= ONE_SPEED * speeds[-1]


def of_column(model: Model, column: Column, *, facts: dict[int, Facts], partners: Sequence[str]) -> Reason:
    """Why `column` is not determined.

    Parameters
    ----------
    facts
        By joint (from 1).
    partners
        Names of the other parameters with which it is only determined together.
    """
    joint, own = model.robot.joint(column.owner), facts[column.owner]
    title = f"joint {joint.number} ({joint.name})"
    if own.runs == 0:
        return Reason(
            f"waits for logs in which {title} moves alone", f"move {title} alone, at several speeds, both ways"
        )
    if column.effect in ("coulomb", "viscous"):
        return _friction(column, own, title)
    if column.effect == "gravity":
        return _gravity(model, column, own, partners)
    shared = ", ".join(partners) if partners else "nothing that these runs vary"
    return Reason(f"only determined together with {shared}", f"repeat {title} in another posture and at other speeds")


def _friction(column: Column, own: Facts, title: str) -> Reason:
    sign, way, other = (1, "forward", "backward") if column.name.endswith(".plus") else (-1, "backward", "forward")
    if not own.speeds[sign]:
        return Reason(f"{title} never moves {way} in these logs", f"repeat the {other} runs of {title} {way}")
    if own.has_one_speed(sign):
        speed = own.speeds[sign][-1]
        return Reason(
            f"every {way} run of {title} has the same speed ({number(speed, 3)} {column_unit(column)}), so Coulomb and"
            " viscous friction cannot be told apart; their sum at that speed is determined",
            f"repeat a {way} run of {title} at {number(speed / 3.0, 2)} {column_unit(column)}",
        )
    return Reason(
        f"over the span that {title} travels, friction cannot be told from its weight",
        f"let {title} travel further, in both directions",
    )


def column_unit(column: Column) -> str:
    """Unit of the joint's velocity, read off the column's unit."""
    return "m/s" if column.unit.endswith("/m") else "rad/s"


def _gravity(model: Model, column: Column, own: Facts, partners: Sequence[str]) -> Reason:
    title = f"joint {column.owner} ({model.robot.joint(column.owner).name})"
    outer = sorted({name for name in partners if name.startswith(("gravity", "gain_ratio"))})
    if outer and own.postures < 2:
        what = "weight of the links outward" if column.owner < model.robot.n_joints else "weight"
        return Reason(
            f"{title} was moved with its outer joints held in one posture only, so its own weight cannot be told from"
            f" the {what} ({', '.join(outer[:3])})",
            f"repeat the runs of {title} with the joints outward of it held elsewhere",
        )
    if any(name.startswith(("coulomb", "viscous")) for name in partners):
        return Reason(
            f"over the span and directions in which {title} travels, its weight cannot be told from its friction",
            f"let {title} travel further, in both directions",
        )
    shared = ", ".join(partners[:4]) if partners else "no run shows it"
    return Reason(
        f"only determined together with {shared}",
        f"repeat the runs of {title} with inner and outer joints held elsewhere",
    )


def of_ratio(model: Model, inner: int, outer: int, *, facts: dict[int, Facts], felt: float, noise: float) -> Reason:
    """Why eta_inner / eta_outer is not determined.

    Parameters
    ----------
    felt
        RMS (A) of the part of joint `inner`'s current that carries the ratio.
    noise
        Standard error (A) of that part: felt must be several times this.
    """
    titles = {n: f"joint {n} ({model.robot.joint(n).name})" for n in (inner, outer)}
    for joint in (inner, outer):
        if facts[joint].runs == 0:
            return Reason(
                f"waits for logs in which {titles[joint]} moves alone",
                f"move {titles[joint]} alone, at several speeds, both ways",
            )
    redundant = model.structure.redundant.get((inner, outer))
    if redundant is not None:
        return Reason(redundant)
    if felt > 0:
        return Reason(
            f"link {outer} is too light to be felt by joint {inner}: its weight moves that current by about"
            f" {number(felt, 2)} A, known to {number(noise, 2)} A only",
            f"repeat the runs of {titles[inner]} with a payload, {titles[outer]} held at two positions",
        )
    return Reason(
        f"{titles[inner]} was not moved in postures that tell its own weight from the weight outward of it",
        f"repeat the runs of {titles[inner]} with {titles[outer]} held at two or more positions",
    )
