"""What the user should know of a plan: why each posture is there, what it lacks, what it takes for granted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pumaid.design.collision import Collision
from pumaid.design.information import RATE, absent_names, gravity_names, gravity_slopes
from pumaid.design.planner import POSTURES, SPEEDS, Made, Planner
from pumaid.design.prior import Prior
from pumaid.errors import Note, Where
from pumaid.preprocessing.options import DEFAULTS
from pumaid.robot import Robot
from pumaid.structure import Structure
from pumaid.trajectory import Motion, Posture, highest_speeds, span
from pumaid.units import factor, number

#: A posture serves a parameter whose error grows by this factor without it; from the second on it is lost.
_SERVES, _LOST = 1.15, 1e3
#: Parameters that are named of a posture, at most.
_NAMED = 3
#: A standard error above this share of a ratio leaves it unknown.
_WEAK = 0.5
#: m off its axis at which a payload is suggested, and kg m that it has at least.
_LEVER, _LEAST = 0.1, 0.02


def posture_reasons(planner: Planner, made: Made) -> tuple[Posture, ...]:
    """Every posture of a plan with the parameters that it serves; those for judging come last of each joint."""
    candidates, out = made.objective.candidates, list[Posture]()
    counts = made.counts.reshape(len(made.objective.times), -1)
    before = planner.criterion.errors(made.objective.information(made.counts))
    for joint in planner.robot.joints:
        label = f"joint {joint.number} ({joint.name})"
        slopes = gravity_slopes(
            planner.truths, joint=joint.number, holds=candidates.joints[joint.number - 1].holds, names=planner.names
        )
        carries = bool(np.any(np.abs(slopes) > 1e-9))
        rows = candidates.joint == joint.number
        for hold in np.unique(candidates.hold[rows & counts.any(axis=0)]).tolist():
            in_posture = rows & (candidates.hold == hold)
            rest = np.where(in_posture, 0, counts).ravel()
            after = planner.criterion.errors(made.objective.information(rest))
            rises = _rises(candidates.names, np.median(after / before, axis=0), gravity_names(planner.robot))
            why = f"{label} carries no weight that can be told from friction: its runs are for friction"
            if carries:
                why = _loss(rises) if rises else "adds a load that differs from that of the other postures"
            place = tuple(candidates.joints[joint.number - 1].holds[hold].tolist())
            out.append(Posture(joint.number, place, tuple(rises), why))
        why = f"{label} is judged here, at speeds that no fit uses"
        out.append(Posture(joint.number, tuple(made.judged[joint.number - 1].tolist()), (), why))
    return tuple(out)


def _rises(names: Sequence[str], growth: np.ndarray, gravity: Sequence[str]) -> dict[str, float]:
    """Gravity parameters and ratios whose error grows, and by which factor, the worst first."""
    table = {name: float(g) for name, g in zip(names, growth, strict=True) if name in gravity and g >= _SERVES}
    return dict(sorted(table.items(), key=lambda item: (-round(item[1], 6), item[0]))[:_NAMED])


def _loss(rises: dict[str, float]) -> str:
    parts = []
    if lost := [name for name, growth in rises.items() if growth >= _LOST]:
        parts.append(f"without it {', '.join(lost)} could not be identified")
    if worse := [f"{name} {growth:.2g} times" for name, growth in rises.items() if growth < _LOST]:
        parts.append(f"without it the error of {', '.join(worse)} as large")
    return "; ".join(parts)


def tight_notes(made: Made, asked: int | None) -> list[Note]:
    """What had to be given up: replicates, postures."""
    short = []
    if made.coverage.passes < 2:
        short.append("no run is made twice, so nothing separates noise from what a model misses")
    if made.coverage.postures < min(POSTURES, asked or POSTURES):
        short.append(f"joints run in {made.coverage.postures} postures only")
    fitted = [motion for motion in made.motions if motion.purpose == "fit"]
    counts = {joint: len({m.hold for m in fitted if m.joint == joint}) for joint in {m.joint for m in fitted}}
    if few := [f"joint {joint} in {count}" for joint, count in counts.items() if count < (asked or 0)]:
        short.append(f"fewer than {asked} postures differ and are free: {', '.join(few)}")
    if not short:
        return []
    return [Note("plan-tight", f"the plan is thin: {'; '.join(short)}; more time (--minutes) or range helps")]


def weight_notes(prior: Prior, promised: dict[str, float]) -> list[Note]:
    """How much weight the last link needs off its axis for the last gain ratio to be seen."""
    truth = prior.robots[0]
    n = truth.robot.n_joints
    name = f"gain_ratio.{n - 1}.{n}"
    if name not in promised or not truth.robot.joint(n).is_revolute:
        return []
    hint = "A payload {:g} mm off the axis shows it: --payload {},{:g},0,0"
    share = promised[name] / abs(float(np.median([t.parameters()[name] for t in prior.robots])))
    if truth.given_constants is not None:
        text = (
            f"{name} cannot be identified with the weight that this arm has: its predicted error is"
            f" {number(share, 2)} times its value. {hint.format(1e3 * _LEVER, 0.5, _LEVER)}"
        )
        return [Note("plan-needs-weight", text, Where(joint=n))] if share >= _WEAK else []
    moments = [
        np.hypot(t.constants.x[-1], t.constants.y[-1]) / abs(t.gain[-1])
        for t in prior.robots
        if t.given_constants is None
    ]
    least = max(float(np.median(moments)) * share / _WEAK, _LEAST)
    text = (
        f"{name} is seen only if link {n} has about {number(least, 2)} kg m (mass times distance) or more off its axis;"
        f" a bare flange often has less. {hint.format(1e3 * _LEVER, number(least / _LEVER, 2), _LEVER)}"
    )
    return [Note("plan-needs-weight", text, Where(joint=n))]


def tilt_notes(robot: Robot, structure: Structure) -> list[Note]:
    """That a tilted base would show what an upright one hides, where it would."""
    first = next((joint for joint in robot.joints if joint.is_revolute), None)
    hidden = absent_names(structure)
    if first is None or not np.any(robot.gravity) or not any(f".l{first.number}." in name for name in hidden):
        return []
    text = (
        f"{', '.join(hidden)} cannot be seen while joint {first.number} ({first.name}) turns about the vertical. With"
        " the base tilted they can: --tilt 10,0 plans for 10 deg about the base's x axis"
    )
    return [Note("plan-needs-tilt", text, Where(joint=first.number))]


def unusable_notes(robot: Robot, motions: Sequence[Motion]) -> list[Note]:
    """Runs that are too short or too slow to be found in a log; one note a joint."""
    out = []
    for joint in robot.joints:
        numbers = [k for k, m in enumerate(motions, start=1) if m.joint == joint.number and _is_lost(m)]
        if not numbers:
            continue
        unit = "rad" if joint.is_revolute else "m"
        text = (
            f"{len(numbers)} run(s) of joint {joint.number} ({joint.name}) will not be found in the logs: a run must go"
            f" over {DEFAULTS.min_travel:g} {unit} or more, faster than {DEFAULTS.rest_speed:g} {unit}/s; the first is"
            f" run {numbers[0]}. Give it more room (its limits in the recipe) or speed"
        )
        out.append(Note("plan-unusable", text, Where(joint=joint.number, field=f"runs[{numbers[0]}]")))
    return out


def _is_lost(motion: Motion) -> bool:
    return abs(motion.end - motion.start) < DEFAULTS.min_travel or motion.velocity <= DEFAULTS.rest_speed


def collision_notes(robot: Robot, motions: Sequence[Motion]) -> list[Note]:
    """Runs, and moves between them, that strike something."""
    collision, out = Collision(robot), list[Note]()
    ends = [[np.array(motion.hold, dtype=float) for motion in motions] for _ in range(2)]
    for motion, start, end in zip(motions, *ends, strict=True):
        start[motion.joint - 1], end[motion.joint - 1] = motion.start, motion.end
    for k, motion in enumerate(motions):
        if hit := collision.first_hit(ends[0][k], ends[1][k]):
            where = Where(joint=motion.joint, field=f"runs[{k + 1}]")
            out.append(Note("plan-strikes", f"run {k + 1}: {collision.describe(hit)}", where))
        if k and (hit := collision.first_hit(ends[1][k - 1], ends[0][k])):
            text = f"the move from run {k} to run {k + 1}: {collision.describe(hit)}"
            out.append(Note("plan-strikes", text, Where(field=f"runs[{k + 1}]")))
    return out


def lack_notes(robot: Robot, motions: Sequence[Motion]) -> list[Note]:
    """What diagnosis would miss: postures, speeds, replicates, runs for judging."""
    out = []
    for joint in robot.joints:
        runs = [motion for motion in motions if motion.joint == joint.number]
        fitted = [motion for motion in runs if motion.purpose == "fit"]
        faults = []
        if (count := len({_others(motion) for motion in fitted})) < POSTURES and robot.n_joints > 1:
            faults.append(f"{count} of {POSTURES} postures")
        if (count := len({round(motion.velocity, 4) for motion in fitted})) < SPEEDS:
            faults.append(f"{count} of {SPEEDS} speeds")
        if len({(_others(m), m.start, m.end, m.velocity) for m in fitted}) == len(fitted):
            faults.append("no run is made twice")
        if not runs:
            faults = ["it never runs"]
        elif len(runs) == len(fitted):
            faults.append("no run is kept for judging")
        if faults:
            text = f"joint {joint.number} ({joint.name}): {'; '.join(faults)}"
            out.append(Note("plan-lacks", text, Where(joint=joint.number)))
    return out


def _others(motion: Motion) -> tuple[float, ...]:
    """Where the joints that do not move are held."""
    return tuple(round(value, 4) for k, value in enumerate(motion.hold, start=1) if k != motion.joint)


def conditions(robot: Robot) -> list[str]:
    """What a forecast takes for granted of limits, speeds and surroundings."""
    out = [f"{RATE:g} samples a second; ramps reach the highest speed in 0.4 s."]
    if robot.safety is None:
        out.append(
            "The recipe states no boxes and no spheres (block safety): collisions are not checked. Look at each posture"
            " before it is run."
        )
    for joint in robot.joints:
        unit = "deg" if joint.is_revolute else "m"
        if joint.limits is None:
            low, high = (end / factor(unit) for end in span(joint))
            out.append(f"Joint {joint.number} ({joint.name}) states no limits: {low:.4g}..{high:.4g} {unit} taken.")
        if joint.max_velocity is None:
            top = highest_speeds(robot)[joint.number - 1] / factor(unit)
            out.append(f"Joint {joint.number} ({joint.name}) states no max_velocity: {top:.3g} {unit}/s taken.")
    return out
