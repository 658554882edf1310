"""Plan an experiment, or say what a given plan promises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from pumaid.design.exchange import POWERS
from pumaid.design.forecast_notes import (
    collision_notes,
    conditions,
    lack_notes,
    posture_reasons,
    tight_notes,
    tilt_notes,
    unusable_notes,
    weight_notes,
)
from pumaid.design.information import absent_names, existing_names, parameter_names, predicted_errors
from pumaid.design.planner import Planner, Request
from pumaid.design.prior import Setup, prior_robots
from pumaid.errors import Faults, ModelError, Note, PumaidError
from pumaid.estimate import Estimate
from pumaid.robot import Robot
from pumaid.structure import minimal
from pumaid.trajectory import Plan, duration

#: Minutes of a plan, and postures a joint or passes, at most.
_LONGEST, _MOST = 1440.0, 200


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

    One joint moves at a time, at constant speed, with the others held. Runs are chosen such that the predicted
    standard errors are small: first a coverage that every joint gets in any case (postures, speeds, whole ranges,
    replicates), then what tells most for its time, then exchanges. Some runs of each joint are kept for judging
    (``heldout``).

    Parameters
    ----------
    robot
        Geometry, limits, highest speeds, what must not be struck.
    minutes
        Time that the robot may take, moves included; about four a joint where not given.
    speeds
        Shares (0..1] of each joint's top speed, three or more.
    postures_per_joint
        At least so many.
    replicates
        Passes over the arm.
    criterion
        ``"geometric"``: the geometric mean of the errors; ``"worst"``: nearly the worst, as a share of its usual size.
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
        A number out of range, or an unknown criterion.
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
    _check(minutes, speeds, {"postures": postures_per_joint, "replicates": replicates}, criterion)
    setup = setup or Setup()
    arm = setup.robot(robot)
    structure, assumed = minimal(arm), prior_robots(arm, estimate=prior, setup=setup, seed=seed)
    names = existing_names(arm, structure)
    request = Request(
        None if minutes is None else 60.0 * minutes,
        None if speeds is None else tuple(speeds),
        postures_per_joint,
        replicates,
        criterion,
    )
    planner = Planner(assumed, names, request=request, seed=seed, tell=tell or _silent)
    made = planner.made()
    promised = predicted_errors(assumed.robots, made.motions, names)
    return Plan(
        robot=robot.name,
        motions=made.motions,
        postures=posture_reasons(planner, made),
        expected=promised,
        unseen={**absent_names(structure), **_dark(arm, names, promised)},
        duration=duration(arm, Plan(robot=robot.name, motions=made.motions)),
        seed=seed,
        efficiency=made.efficiency,
        assumptions=(*setup.sentences(), *assumed.sentences, *conditions(arm)),
        notes=(
            *tight_notes(made, postures_per_joint),
            *unusable_notes(arm, made.motions),
            *weight_notes(assumed, promised),
            *tilt_notes(arm, structure),
        ),
    )


def check_plan(
    robot: Robot,
    given: Plan,
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
    given
        A plan by `plan`, edited or written by hand.
    prior, setup, seed, tell
        As for `plan`.

    Returns
    -------
    plan
        With expected errors, what stays unseen, duration, and its share of what could be had in that time.

    Raises
    ------
    ModelError [plan-unsafe]
        The arm can run nowhere without striking something.
    """
    setup = setup or Setup()
    arm = setup.robot(robot)
    structure, assumed = minimal(arm), prior_robots(arm, estimate=prior, setup=setup, seed=seed)
    names = existing_names(arm, structure)
    promised, lasting = predicted_errors(assumed.robots, given.motions, names), duration(arm, given)
    dark = _dark(arm, names, promised)
    (tell or _silent)("comparing with the best conceivable experiment")
    planner = Planner(assumed, names, request=Request(seconds=lasting), seed=seed, tell=_silent)
    mend = "add postures in which the outer links' load differs, or other speeds; compare with: pumaid plan"
    hidden = [Note("plan-dark", f"no run of this plan shows {', '.join(dark)}; {mend}")] if dark else []
    return replace(
        given,
        expected=promised,
        unseen={**absent_names(structure), **dark},
        duration=lasting,
        efficiency=planner.efficiency(promised, lasting),
        assumptions=(*setup.sentences(), *assumed.sentences, *conditions(arm)),
        notes=(
            *collision_notes(arm, given.motions),
            *unusable_notes(arm, given.motions),
            *lack_notes(arm, given.motions),
            *hidden,
            *weight_notes(assumed, promised),
            *tilt_notes(arm, structure),
        ),
    )


def _silent(_: str) -> None:
    """Nobody listens."""


def _dark(robot: Robot, names: Sequence[str], promised: dict[str, float]) -> dict[str, str]:
    """Parameters that no run of a plan shows."""
    return {name: "no run of this plan shows it" for name in parameter_names(robot, names) if name not in promised}


def _check(
    minutes: float | None, shares: Sequence[float] | None, counts: dict[str, int | None], criterion: str
) -> None:
    """Refuse numbers out of range, all at once."""
    faults = []
    if minutes is not None and not 0.0 < minutes <= _LONGEST:
        faults.append((f"{minutes:g} minutes are out of range", f"give a number above 0, and {_LONGEST:g} at most"))
    if shares is not None and len(set(shares)) < 3:
        mend = "give three or more: fewer cannot tell whether friction grows evenly with speed"
        faults.append((f"{len(set(shares))} different speeds are too few", mend))
    for share in shares or ():
        if not 0.0 < share <= 1.0:
            mend = "give shares above 0 and at most 1, such as 0.1,0.3,0.8"
            faults.append((f"{share:g} is no share of a top speed", mend))
    for what, count in counts.items():
        if count is not None and not 1 <= count <= _MOST:
            faults.append((f"{count} {what} are out of range", f"give 1 to {_MOST}"))
    if criterion not in POWERS:
        faults.append((f"{criterion!r} is no criterion", f"known: {', '.join(POWERS)}"))
    errors: list[PumaidError] = [ModelError("plan-impossible", what, mend=mend) for what, mend in faults]
    if errors:
        raise errors[0] if len(errors) == 1 else Faults(errors)
