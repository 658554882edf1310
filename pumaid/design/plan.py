"""Plan an experiment, or say what a given plan promises, with what the user should know of it."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from pumaid.design.candidate_runs import Collision
from pumaid.design.information import (
    RATE,
    Payload,
    Prior,
    absent_names,
    parameter_names,
    predicted_errors,
    prior_robots,
)
from pumaid.design.planner import POSTURES, SPEEDS, Planner
from pumaid.errors import ModelError, Note, Where, refuse
from pumaid.estimate import Estimate
from pumaid.preprocessing.binning import DEFAULTS
from pumaid.robot import Robot
from pumaid.trajectory import Plan, duration, highest_speeds, span, trapezoids
from pumaid.units import factor, number

#: Minutes of a plan, and postures a joint or passes, at most.
_LONGEST, _MOST = 1440.0, 200
#: A standard error above this share of a ratio leaves it unknown.
_WEAK = 0.5
#: m off its axis at which a payload is suggested.
_LEVER = 0.1


def plan(
    robot: Robot,
    *,
    minutes: float | None = None,
    speeds: Sequence[float] | None = None,
    postures_per_joint: int | None = None,
    replicates: int | None = None,
    prior: Estimate | None = None,
    payload: Payload | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Plan runs that show every parameter which the arm has, as well as the time allows, within its limits.

    First comes what every joint gets in any case (postures, speeds, whole ranges, replicates, runs ``heldout`` for
    judging), then the runs that make the predicted standard errors smallest for their time, with exchanges.

    Parameters
    ----------
    robot, minutes
        The arm; time that it may take, moves included, about four a joint where not given.
    speeds, postures_per_joint, replicates
        Shares (0..1] of each joint's top speed, three or more; at least so many postures; passes over the arm.
    prior, payload, seed, tell
        An earlier model of the arm, else several robots drawn from the geometry are planned for at once; kg, x, y, z
        (m) of what the last link carries; same seed, same plan; called with a word on what is done.

    Raises
    ------
    ModelError [plan-too-short], [plan-impossible], [plan-unsafe]
        The least experiment takes longer; a number out of range; nothing can be run without a collision.

    Examples
    --------
    >>> from pumaid.simulation import table1
    >>> plan(table1.robot(), minutes=12, seed=1).unseen["gravity.l1.x"][:20]
    'joint 1 (waist) turn'
    """
    _check(minutes, speeds, {"postures": postures_per_joint, "replicates": replicates})
    planner = Planner(
        robot,
        seconds=None if minutes is None else 60.0 * minutes,
        shares=speeds,
        postures=postures_per_joint,
        passes=replicates,
        prior=prior_robots(robot, estimate=prior, payload=payload, seed=seed),
        seed=seed,
        tell=tell,
    )
    made = planner.plan()
    return _with_forecast(made, planner, lack_notes(robot, made))


def check_plan(
    robot: Robot,
    given: Plan,
    *,
    prior: Estimate | None = None,
    payload: Payload | None = None,
    seed: int = 0,
    tell: Callable[[str], None] = lambda _: None,
) -> Plan:
    """The runs of a plan, edited or written by hand, with what they promise and notes on all that asks for attention.

    Other parameters are those of `plan`.
    """
    assumed = prior_robots(robot, estimate=prior, payload=payload, seed=seed)
    planner = Planner(robot, seconds=duration(robot, given), prior=assumed, seed=seed, tell=tell)
    checked = _with_forecast(given, planner, [*collision_notes(robot, given), *lack_notes(robot, given)])
    notes, absent = checked.notes, absent_names(planner.structure)
    if dark := [name for name in checked.unseen if name not in absent]:
        mend = "add postures in which the outer links' load differs, or other speeds; compare with: pumaid plan"
        notes = (*notes, Note("plan-dark", f"no run of this plan shows {', '.join(dark)}; {mend}"))
    return replace(checked, efficiency=planner.efficiency(checked.expected, checked.duration), notes=notes)


def _with_forecast(bare: Plan, planner: Planner, notes: Iterable[Note]) -> Plan:
    """A plan with its expected errors, what stays unseen, its duration, assumptions and notes."""
    promised, arm = predicted_errors(planner.prior.robots, bare.motions, planner.names), planner.robot
    dark = [name for name in parameter_names(arm, planner.names) if name not in promised]
    return replace(
        bare,
        expected=promised,
        unseen={**absent_names(planner.structure), **dict.fromkeys(dark, "no run of this plan shows it")},
        duration=duration(arm, bare),
        assumptions=(*planner.prior.sentences, *conditions(arm)),
        notes=(*notes, *unusable_notes(arm, bare), *weight_notes(planner.prior, promised), *tilt_notes(planner)),
    )


def _check(minutes: float | None, shares: Sequence[float] | None, counts: dict[str, int | None]) -> None:
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
    refuse([ModelError("plan-impossible", what, mend=mend) for what, mend in faults])


def weight_notes(prior: Prior, promised: dict[str, float]) -> Iterator[Note]:
    """How much weight the last link needs off its axis for the last gain ratio to be seen."""
    truth = prior.robots[0]
    n = truth.robot.n_joints
    name = f"gain_ratio.{n - 1}.{n}"
    if name not in promised or not truth.robot.joint(n).is_revolute:
        return
    share = promised[name] / abs(float(np.median([t.parameters()[name] for t in prior.robots])))
    if share >= _WEAK:
        text = (
            f"{name} cannot be identified with the weight that this arm has: its predicted error is {number(share, 2)}"
            f" times its value. A payload {1e3 * _LEVER:g} mm off the axis shows it: --payload 0.5,{_LEVER:g},0,0"
        )
        yield Note("plan-needs-weight", text, Where(joint=n))


def tilt_notes(planner: Planner) -> Iterator[Note]:
    """That a tilted base would show what an upright one hides, where it would."""
    first = next((joint for joint in planner.robot.joints if joint.is_revolute), None)
    hidden = absent_names(planner.structure)
    if first is None or not np.any(planner.robot.gravity) or not any(f".l{first.number}." in name for name in hidden):
        return
    text = (
        f"{', '.join(hidden)} cannot be seen while joint {first.number} ({first.name}) turns about the vertical. With"
        " the base tilted by some 10 deg they can: plan and identify with a recipe whose gravity says so"
    )
    yield Note("plan-needs-tilt", text, Where(joint=first.number))


def unusable_notes(robot: Robot, given: Plan) -> Iterator[Note]:
    """Runs that are too short or too slow to be found in a log; one note a joint."""
    lost: dict[int, list[int]] = {}
    for place, motion in enumerate(given.motions, start=1):
        if abs(motion.end - motion.start) < DEFAULTS.min_travel or motion.velocity <= DEFAULTS.rest_speed:
            lost.setdefault(motion.joint, []).append(place)
    for moving, places in sorted(lost.items()):
        joint = robot.joint(moving)
        unit = joint.position_unit
        text = (
            f"{len(places)} run(s) of joint {moving} ({joint.name}) will not be found in the logs: a run must go"
            f" over {DEFAULTS.min_travel:g} {unit} or more, faster than {DEFAULTS.rest_speed:g} {unit}/s; the first is"
            f" run {places[0]}. Give it more room (its limits in the recipe) or speed"
        )
        yield Note("plan-unusable", text, Where(joint=moving, field=f"runs[{places[0]}]"))


def collision_notes(robot: Robot, given: Plan) -> Iterator[Note]:
    """Runs, and moves between them, that strike something."""
    collision = Collision(robot)
    for step in trapezoids(robot, given):
        if (hit := collision.first_hit(step.start, step.end)) is not None:
            way = f"the move from run {step.number - 1} to run" if step.motion is None else "run"
            joint = None if step.motion is None else step.motion.joint
            text = f"{way} {step.number}: {hit}"
            yield Note("plan-strikes", text, Where(joint=joint, field=f"runs[{step.number}]"))


def lack_notes(robot: Robot, given: Plan) -> Iterator[Note]:
    """What diagnosis would miss: postures, speeds, replicates, runs for judging."""
    for joint in robot.joints:
        runs = [motion for motion in given.motions if motion.joint == joint.number]
        fitted = [
            (tuple(np.round(np.delete(m.hold, m.joint - 1), 4)), round(m.velocity, 4), m.start, m.end)
            for m in runs
            if m.purpose == "fit"
        ]
        holds, speeds = ({run[k] for run in fitted} for k in (0, 1))
        lacks = [
            (f"{len(holds)} of {POSTURES} postures", len(holds) < POSTURES and robot.n_joints > 1),
            (f"{len(speeds)} of {SPEEDS} speeds", len(speeds) < SPEEDS),
            ("no run is made twice", len(set(fitted)) == len(fitted)),
            ("no run is kept for judging", len(runs) == len(fitted)),
        ]
        faults = [text for text, is_lacking in lacks if is_lacking] if runs else ["it never runs"]
        if faults:
            text = f"joint {joint.number} ({joint.name}): {'; '.join(faults)}"
            yield Note("plan-lacks", text, Where(joint=joint.number))


def conditions(robot: Robot) -> Iterator[str]:
    """What a forecast takes for granted of limits, speeds and surroundings."""
    yield f"{RATE:g} samples a second; ramps reach the highest speed in 0.4 s."
    if robot.safety is None:
        yield (
            "The recipe states no boxes and no spheres (block safety): collisions are not checked. Look at each posture"
            " before it is run."
        )
    for joint, top in zip(robot.joints, highest_speeds(robot), strict=True):
        unit, label = "deg" if joint.is_revolute else "m", f"Joint {joint.number} ({joint.name}) states no"
        if joint.limits is None:
            low, high = (end / factor(unit) for end in span(joint))
            yield f"{label} limits: {low:.4g}..{high:.4g} {unit} taken."
        if joint.max_velocity is None:
            yield f"{label} max_velocity: {top / factor(unit):.3g} {unit}/s taken."
