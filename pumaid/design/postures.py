"""Which postures of the other joints are worth a look: those that the best conceivable experiment would use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.clearance import Clearance
from pumaid.design.compose import settled
from pumaid.design.criterion import Criterion
from pumaid.design.laps import courses, free, speeds
from pumaid.design.menu import Ways, menu
from pumaid.design.relaxed import relaxed
from pumaid.errors import ModelError, Where
from pumaid.robot import Robot
from pumaid.simulation.forecast import run_slopes
from pumaid.simulation.ranges import candidates
from pumaid.simulation.truth import Truth

Floats = NDArray[np.float64]

#: Candidate postures drawn a joint, and of a joint whose runs no posture changes.
_DRAWN, _DRAWN_IDLE = 120, 12
#: Postures a joint that are left after the first look.
SHORTLIST = 14
#: Shares of the top speed of the first look, its steps, and its time a joint (s); ranks hardly depend on them.
_LOOK, _STEPS, _SECONDS = (0.05, 1.0), 40, 120.0
#: Slopes below this share of the greatest are rounding.
_NOTHING = 1e-9


def shortlist(
    truths: Sequence[Truth],
    *,
    names: Sequence[str],
    clearance: Clearance,
    rate: float,
    rng: np.random.Generator,
    count: int = SHORTLIST,
) -> list[Floats]:
    """(K, J) postures worth a look, for each joint in order, those with most of the time first.

    Of many postures that can be reached those are kept on which the best conceivable experiment, with one fast and one
    slow course, would spend its time.

    Parameters
    ----------
    truths
        Assumed robots.
    names
        Gravity parameters and ratios that the arm has.
    clearance
        What must not be struck.
    rate
        Samples a second.
    rng
        Source of the candidates.
    count
        Postures a joint at most.

    Raises
    ------
    ModelError [plan-unsafe]
        A joint cannot run in any candidate.
    """
    robot = truths[0].robot
    ways = [_ways(truths[0], joint.number, clearance, rng) for joint in robot.joints]
    found = menu(truths, ways, names=names, rate=rate)
    criterion = Criterion(0.0, np.ones(len(found.names)))
    weights = relaxed(found, criterion, seconds=found.seconds, total=_SECONDS * robot.n_joints, steps=_STEPS).weights
    out = []
    for way in ways:
        own = found.joint == way.joint
        spent = np.bincount(found.hold[own], (weights * found.seconds)[own], minlength=len(way.holds))
        usable = np.flatnonzero(way.usable.any(axis=1))
        order = usable[np.argsort(-settled(np.asarray(spent[usable], dtype=float)), kind="stable")]
        out.append(way.holds[order[:count]])
    return out


def _ways(truth: Truth, joint: int, clearance: Clearance, rng: np.random.Generator) -> Ways:
    robot = truth.robot
    matter = [number for number in that_matter(truth, joint, rng) if number != joint]
    others = [number for number in range(1, robot.n_joints + 1) if number != joint]
    holds = candidates(robot, joint, free=matter or others, count=_DRAWN if matter else _DRAWN_IDLE, rng=rng)
    own = courses(robot, joint, speeds(robot, joint, _LOOK))
    some = tuple(dict.fromkeys((own[0], own[-1])))
    usable = free(clearance, holds, some)
    if not usable.any():
        start, end = holds[0].copy(), holds[0].copy()
        start[joint - 1], end[joint - 1] = some[0].low, some[0].high
        raise ModelError(
            "plan-unsafe",
            f"joint {joint} ({robot.joint(joint).name}) can run nowhere without striking something, in none of"
            f" {len(holds)} postures of the others; where they stand by default: {clearance.explain(start, end)}",
            Where(joint=joint),
            "widen the limits, or mend the recipe's boxes and spheres",
        )
    return Ways(joint, holds, some, usable)


def that_matter(truth: Truth, joint: int, rng: np.random.Generator) -> list[int]:
    """Joints (from 1) whose position changes what joint `joint` (from 1) tells when it runs.

    Parameters
    ----------
    truth
        An assumed robot.
    joint
        Moves.
    rng
        Source of the postures that are tried.
    """
    robot: Robot = truth.robot
    postures = rng.uniform(-1.0, 1.0, (12, robot.n_joints)) * np.where(robot.is_revolute, np.pi, 0.5)
    before = run_slopes(robot, truth.constants, joint=joint, holds=postures)
    scale = np.max(np.abs(before)) or 1.0
    found = []
    for number in range(1, robot.n_joints + 1):
        turned = postures.copy()
        turned[:, number - 1] += 0.7
        if np.max(np.abs(run_slopes(robot, truth.constants, joint=joint, holds=turned) - before)) > _NOTHING * scale:
            found.append(number)
    return found
