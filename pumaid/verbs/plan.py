"""Plan an experiment: the runs that tell most of an arm in the time that it has."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from pumaid.design.assume import assume
from pumaid.design.coverage import POSTURES, Extent
from pumaid.design.criterion import POWERS
from pumaid.design.menu import parameters
from pumaid.design.outlook import absent, conditions, existing, expected, short_note, tilt_note, weight_note
from pumaid.design.planner import Made, Planner, Wish
from pumaid.design.reasons import postures
from pumaid.design.setup import Setup
from pumaid.errors import Faults, ModelError, Note, PumaidError
from pumaid.records import Estimate, Plan
from pumaid.robot import Robot
from pumaid.structure import minimal
from pumaid.trajectory import duration

#: Minutes of a plan at most: in a day an arm and its room are no longer the same.
_LONGEST = 1440.0
#: Postures a joint, and passes, at most.
_MOST = 200


def plan(
    robot: Robot,
    *,
    minutes: float | None = None,
    speeds: Sequence[float] | None = None,
    postures_per_joint: int | None = None,
    replicates: int | None = None,
    criterion: str = "geometric",
    prior: Estimate | None = None,
    setup: Setup | None = None,
    seed: int = 0,
    tell: Callable[[str], None] | None = None,
) -> Plan:
    """Plan runs that show every parameter which the arm has, as well as the time allows, within its limits.

    Laps (there and back with one joint, in a posture of the others, over the span or a part of it, at a speed) are
    chosen such that the predicted standard errors are as small as they get: first a coverage that every joint has
    whatever it tells (four postures, four speeds, the slowest and the fastest among them, whole spans), then what tells
    most for its time, then exchanges. All but short plans are made of two or more passes over the arm, in an order of
    their own each, so that repeats lie far apart in time. A posture and speeds of each joint are kept for judging only
    (``heldout``).

    Parameters
    ----------
    robot
        Geometry, limits, highest speeds, what must not be struck.
    minutes
        Time that the robot may take, moves included, a day at most; four or five a joint where not given, more
        where the least that every joint needs takes longer.
    speeds
        Shares of each joint's highest speed, above 0 and at most 1, three or more.
    postures_per_joint
        At least so many.
    replicates
        Passes over the arm.
    criterion
        ``"geometric"``: the geometric mean of the errors; ``"worst"``: nearly the worst, as a share of what is usual.
    prior
        An earlier model of the arm; else several robots drawn from the geometry are planned for at once.
    setup
        A tilted base, a payload.
    seed
        Same seed, same plan.
    tell
        Called with a word on what is done.

    Returns
    -------
    plan
        Motions with purpose, postures with their reasons, expected standard errors, what stays unseen, duration.

    Raises
    ------
    ModelError [plan-too-short]
        The least experiment that shows everything takes longer than `minutes`.
    ModelError [plan-impossible]
        More than a day, fewer than three speeds, a speed out of range, less than one posture or replicate or very
        many, an unknown criterion.
    ModelError [plan-unsafe]
        Nothing can be run, or reached, without striking what must not be struck.

    Source
    ------
    S.-K. Lin, on persistently exciting runs; Corollary 4 for what exists.

    Examples
    --------
    >>> from pumaid.simulation import table1
    >>> experiment = plan(table1.robot(), minutes=12, seed=1)
    >>> experiment.unseen["gravity.l1.x"][:20]
    'joint 1 (waist) turn'
    """
    _check(minutes, speeds, (postures_per_joint, replicates), criterion)
    stand = setup or Setup()
    arm = stand.robot(robot)
    structure, assumed = minimal(arm), assume(arm, prior=prior, setup=stand, seed=seed)
    names = existing(arm, structure)
    wish = Wish(
        None if minutes is None else 60.0 * minutes,
        None if speeds is None else tuple(speeds),
        postures_per_joint,
        replicates,
        criterion,
    )
    planner = Planner(assumed.truths, names, size=assumed.sizes(), wish=wish, seed=seed, tell=tell or _silent)
    made = planner.made()
    promised = expected(assumed, made.motions, names)
    dark = {name: "no run of this plan shows it" for name in parameters(arm, names) if name not in promised}
    return Plan(
        robot=robot.name,
        motions=made.motions,
        postures=postures(planner, made),
        expected=promised,
        unseen={**absent(structure), **dark},
        duration=duration(arm, Plan(robot=robot.name, motions=made.motions)),
        seed=seed,
        efficiency=made.efficiency,
        assumptions=(*stand.told(), *assumed.told, *conditions(arm)),
        notes=(
            *_tight(made.extent),
            *short_note(arm, made.motions),
            *_few(arm, made, postures_per_joint),
            *weight_note(assumed, promised),
            *tilt_note(arm, structure),
        ),
    )


def _silent(_: str) -> None:
    """Nobody listens."""


def _tight(extent: Extent) -> tuple[Note, ...]:
    """What was given up for want of time."""
    short = []
    if extent.passes < 2:
        short.append("no run is made twice, so that nothing tells the noise from what a model misses")
    if extent.postures < POSTURES:
        short.append(f"joints run in {extent.postures} postures only")
    if not short:
        return ()
    return (
        Note(
            "plan-tight",
            f"the plan is thin: {' and '.join(short)}; more --minutes, --postures and --replicates mend it",
        ),
    )


def _few(robot: Robot, made: Made, asked: int | None) -> tuple[Note, ...]:
    """Joints with fewer postures than asked for: all that differ and can be reached."""
    fitted = [motion for motion in made.motions if motion.purpose == "fit"]
    counts = {n: len({m.hold for m in fitted if m.joint == n}) for n in range(1, robot.n_joints + 1)}
    short = [f"joint {n} {count}" for n, count in counts.items() if count < (asked or 0)]
    if not short:
        return ()
    return (Note("plan-few-postures", f"fewer postures than {asked} differ and can be reached: {', '.join(short)}"),)


def _check(
    minutes: float | None, shares: Sequence[float] | None, counts: tuple[int | None, int | None], criterion: str
) -> None:
    faults: list[PumaidError] = []
    if minutes is not None and not (math.isfinite(minutes) and minutes > 0):
        faults.append(ModelError("plan-impossible", f"{minutes:g} minutes is no time", mend="give a positive number"))
    if shares is not None and len(set(shares)) < 3:
        mend = "give three or more: fewer cannot tell whether friction grows evenly with speed"
        faults.append(ModelError("plan-impossible", f"{len(set(shares))} different speeds are too few", mend=mend))
    for share in shares or ():
        if not 0.0 < share <= 1.0:
            mend = "give shares above 0 and at most 1, such as 0.1,0.3,0.8"
            faults.append(ModelError("plan-impossible", f"{share:g} is no share of a highest speed", mend=mend))
    if minutes is not None and minutes > _LONGEST:
        mend = "plan a day, and make it again with another --seed on the next"
        faults.append(ModelError("plan-impossible", f"{minutes:g} minutes are more than a day", mend=mend))
    for what, count in zip(("postures", "replicates"), counts, strict=True):
        if count is not None and count > _MOST:
            mend = f"give {_MOST} or less"
            faults.append(ModelError("plan-impossible", f"{count} {what} are more than a plan holds", mend=mend))
        if count is not None and count < 1:
            faults.append(ModelError("plan-impossible", f"{count} {what} show nothing", mend="give 1 or more"))
    if criterion not in POWERS:
        what = f"{criterion!r} is no criterion"
        faults.append(ModelError("plan-impossible", what, mend=f"known: {', '.join(POWERS)}"))
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)
