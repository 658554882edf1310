"""What a given plan promises: predicted errors, what stays in the dark, what it strikes, what it lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pumaid.clearance import Clearance
from pumaid.design.assume import assume
from pumaid.design.coverage import POSTURES, SPEEDS
from pumaid.design.menu import parameters
from pumaid.design.moves import explained, struck
from pumaid.design.outlook import absent, conditions, existing, expected, short_note, tilt_note, weight_note
from pumaid.design.planner import Planner, Wish
from pumaid.design.setup import Setup
from pumaid.errors import Note, Where
from pumaid.records import Estimate, Motion, Plan
from pumaid.robot import Robot
from pumaid.structure import minimal
from pumaid.trajectory import duration


def foresee(
    robot: Robot,
    plan: Plan,
    *,
    prior: Estimate | None = None,
    setup: Setup | None = None,
    seed: int = 0,
    tell: Callable[[str], None] | None = None,
) -> Plan:
    """The same runs with what they promise, and notes on all that asks for attention.

    Parameters
    ----------
    robot
        The arm.
    plan
        By `pumaid.verbs.plan.plan`, edited or written by hand.
    prior
        An earlier model of the arm; else several robots drawn from the geometry are looked at.
    setup
        A tilted base, a payload.
    seed
        Of the drawn robots: that of the plan that is compared with.
    tell
        Called with a word on what is done.

    Returns
    -------
    plan
        With expected errors, what stays unseen, duration, and its share of what could be had in that time.

    Raises
    ------
    ModelError [plan-unsafe]
        The arm can stand nowhere without striking something.
    """
    stand = setup or Setup()
    arm = stand.robot(robot)
    structure, assumed = minimal(arm), assume(arm, prior=prior, setup=stand, seed=seed)
    names = existing(arm, structure)
    promised = expected(assumed, plan.motions, names)
    lasting = duration(arm, plan)
    dark = {name: "no run of this plan shows it" for name in parameters(arm, names) if name not in promised}
    found = replace(
        plan,
        expected=promised,
        unseen={**absent(structure), **dark},
        duration=lasting,
        assumptions=(*stand.told(), *assumed.told, *conditions(arm)),
    )
    notes = [*_strikes(arm, plan.motions), *short_note(arm, plan.motions)]
    notes += [*_lacks(arm, plan.motions), *_darkness(dark)]
    notes += [*weight_note(assumed, promised), *tilt_note(arm, structure)]
    (tell or _silent)("comparing with the best conceivable experiment")
    wish = Wish(seconds=lasting)
    planner = Planner(assumed.truths, names, size=assumed.sizes(), wish=wish, seed=seed, tell=_silent)
    return replace(found, efficiency=planner.efficiency(promised, lasting), notes=tuple(notes))


def _silent(_: str) -> None:
    """Nobody listens."""


def _darkness(dark: dict[str, str]) -> list[Note]:
    if not dark:
        return []
    mend = "add postures in which the outer links' load differs, or other speeds; compare with: pumaid plan"
    return [Note("plan-dark", f"no run of this plan shows {', '.join(dark)}; {mend}")]


def _strikes(robot: Robot, motions: Sequence[Motion]) -> list[Note]:
    """Runs, and moves between them, that strike something."""
    clearance = Clearance.of(robot)
    if clearance.is_free or not motions:
        return []
    starts, ends = (np.array([motion.hold for motion in motions], dtype=float) for _ in range(2))
    own = np.array([motion.joint - 1 for motion in motions])
    rows = np.arange(len(motions))
    starts[rows, own] = [motion.start for motion in motions]
    ends[rows, own] = [motion.end for motion in motions]
    out = []
    for k in np.flatnonzero(clearance.struck(starts, ends)):
        what = clearance.explain(starts[k], ends[k])
        out.append(Note("plan-strikes", f"run {k + 1}: {what}", Where(joint=int(own[k]) + 1, field=f"runs[{k + 1}]")))
    for k in np.flatnonzero(struck(clearance, ends[:-1], starts[1:])):
        what = f"the move from run {k + 1} to run {k + 2}: {explained(clearance, ends[k], starts[k + 1])}"
        out.append(Note("plan-strikes", what, Where(field=f"runs[{k + 2}]")))
    return out


def _lacks(robot: Robot, motions: Sequence[Motion]) -> list[Note]:
    """What diagnosis would miss: postures, speeds, replicates, runs for judging."""
    out = []
    for joint in robot.joints:
        own = [motion for motion in motions if motion.joint == joint.number]
        fitted = [motion for motion in own if motion.purpose == "fit"]
        faults = []
        if (count := len({_others(motion) for motion in fitted})) < POSTURES and robot.n_joints > 1:
            faults.append(f"{count} of {POSTURES} postures")
        if (count := len({round(motion.velocity, 4) for motion in fitted})) < SPEEDS:
            faults.append(f"{count} of {SPEEDS} speeds")
        if len({(_others(m), m.start, m.end, m.velocity) for m in fitted}) == len(fitted):
            faults.append("no run is made twice")
        if not own:
            faults = ["it never runs"]
        elif len(own) == len(fitted):
            faults.append("no run is kept for judging")
        if faults:
            text = f"joint {joint.number} ({joint.name}): {'; '.join(faults)}"
            out.append(Note("plan-lacks", text, Where(joint=joint.number)))
    return out


def _others(motion: Motion) -> tuple[float, ...]:
    """Where the joints that do not move are held."""
    return tuple(round(value, 4) for k, value in enumerate(motion.hold, start=1) if k != motion.joint)
