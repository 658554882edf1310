"""Plans on disk: YAML that people edit; written also as CSV, one row a run or a knot, and as robots' programs.

A program is what a robot's own controller runs: URScript, or a ROS 2 trajectory.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pumaid import __version__
from pumaid.errors import ModelError, Note, Where
from pumaid.io.forms import (
    AngleUnit,
    Fault,
    Finite,
    PayloadForm,
    StrictForm,
    file_name,
    parsed_yaml,
    read_bytes,
    validated,
    yaml_line,
    yaml_number,
    yaml_vector,
)
from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.trajectory import RAMP_TIME, REST, Motion, Plan, Posture, Trajectory, duration, trapezoids
from pumaid.units import factor, number

#: The plan's name in an experiment's folder.
PLAN_NAME = "plan.yaml"
#: Most bytes of a plan: some forty thousand runs.
_MAX_BYTES = 5_000_000
#: Share of its range by which a limit may be passed: round-off.
_ROUNDING = 1e-6
#: What a plan promises and says of itself, which is not read back.
_NOT_READ = ("expected_std_errors", "unseen", "efficiency", "assumptions", "notes", "pumaid", "recipe")
#: Instants between two knots at which a trajectory is held against the limits.
_BETWEEN = 16
#: What a knot has of each joint.
_STATES = ("position", "velocity", "acceleration")
#: rad/s and rad/s2 of URScript's first move, from wherever the arm stands.
_APPROACH, _APPROACH_RAMP = 0.2, 0.5
#: s in which a ROS 2 controller takes the arm to the first posture from where it stands, which must be near it.
LEAD_IN = 5.0

_URSCRIPT = """\
# {what} for {name}, about {minutes:.0f} min; pumaid {version}.
# Before you start it: set payload and TCP in the installation, clear the cell, start the recording of the log, and
# drive it through once with the speed slider low; for the measurement the slider must be at 100 %.
# It first drives slowly, all joints at once, to the first posture: be near it, with the way free.
# movej with one moving joint is a trapezoid of speed: v in rad/s on the plateau, a in rad/s2 on the ramps.
def pumaid_plan():
{body}
end
"""
#: The head of a plan's file.
_RUNS = [
    "# Runs to be executed in this order. One joint moves from `from` to `to` at speed `velocity` (in deg/s, or",
    "# m/s if it slides); the others stay at `hold` (its own entry is ignored). expected_std_errors are in SI,",
    "# duration in s.",
]
_KNOTS = [
    "# A trajectory of all joints (deg, or m of those that slide, and s) that is executed `repeats` times. Between its",
    "# knots each joint moves by the polynomial of the fifth degree. expected_std_errors are in SI, duration in s.",
]
#: To the next knot, in h s, from that before: positions, velocities and accelerations; `late` s are gone of it already.
_TO_KNOT = """\
global late = 0.0
def pumaid_to(h, next_q, next_v, next_a):
  local q = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
  local t = late
  while t < h:
    local s = t / h
    local k = 0
    while k < 6:
      local way = next_q[k] - last_q[k]
      local v = last_v[k] * h
      local v1 = next_v[k] * h
      local a = last_a[k] * h * h
      local a1 = next_a[k] * h * h
      local c3 = 10 * way - 6 * v - 4 * v1 - 1.5 * a + 0.5 * a1
      local c4 = -15 * way + 8 * v + 7 * v1 + 1.5 * a - a1
      local c5 = 6 * way - 3 * (v + v1) - 0.5 * (a - a1)
      q[k] = last_q[k] + s * (v + s * (0.5 * a + s * (c3 + s * (c4 + s * c5))))
      k = k + 1
    end
    servoj(q, t=get_steptime(), lookahead_time=0.05, gain=500)
    t = t + get_steptime()
  end
  late = t - h
  last_q = next_q
  last_v = next_v
  last_a = next_a
end"""

_ROS2 = """\
# {what} for {name} as one trajectory_msgs/msg/JointTrajectory (rad, m, s); pumaid {version}.
# The names of joints must be those of your controller. The first point is reached in {lead:g} s from wherever the arm
# is: bring it there before you send this. To drive it slowly once, multiply all times and divide all velocities by 5.
header: {{stamp: {{sec: 0, nanosec: 0}}, frame_id: ''}}
joint_names: [{joints}]
points:{points}
"""


class HoldForm(StrictForm):
    """The joint that moves, and where all are held."""

    joint: int
    hold: list[Finite] = Field(examples=["[...], one position a joint"])


class PostureForm(HoldForm):
    """One entry of `postures`."""

    serves: list[str] = Field([])
    why: str = ""


class RunForm(HoldForm):
    """One entry of `runs`."""

    start: Finite = Field(alias="from")
    end: Finite = Field(alias="to")
    velocity: Annotated[Finite, Field(gt=0)] = Field(
        examples=["a speed above 0; the direction follows from `from` and `to`"]
    )
    purpose: Literal["fit", "heldout"] = "fit"
    payload: PayloadForm | None = None


class KnotForm(StrictForm):
    """A knot of the trajectory; what it does not say of velocity and acceleration is zero."""

    time: Finite
    position: list[Finite] = Field(examples=["[...], one position a joint"])
    velocity: list[Finite] = Field([])
    acceleration: list[Finite] = Field([])


class TrajectoryForm(StrictForm):
    """All joints at once."""

    knots: list[KnotForm] = Field(min_length=2, examples=["two or more of {time: 0, position: [...]}"])
    repeats: Annotated[int, Field(ge=1, le=10_000)] = 1
    kind: Literal["", "fourier", "picks"] = ""


class PlanForm(StrictForm):
    """What is read of a file; only kind, format, and runs or a trajectory are needed."""

    kind: Literal["plan"] = Field(examples=["plan"])
    format: Literal[1] = Field(examples=["1"])
    runs: list[RunForm] = Field([])
    trajectory: TrajectoryForm | None = None
    robot: str = ""
    units: dict[Literal["angle"], AngleUnit] = Field({})
    postures: list[PostureForm] = Field([])
    duration: Finite = 0.0
    seed: Annotated[int, Field(ge=0)] = 0


def _units(robot: Robot, angle: str) -> list[tuple[str, float]]:
    return [(angle, factor(angle)) if joint.is_revolute else ("m", 1.0) for joint in robot.joints]


def _faults(form: PlanForm, robot: Robot) -> Iterator[Fault]:
    units = _units(robot, form.units.get("angle", "rad"))
    if (form.trajectory is None) != bool(form.runs):
        what = "it has runs and a trajectory" if form.runs else "it has neither runs nor a trajectory"
        yield (("runs",), what, "write one of them, or make a plan with: pumaid plan")
    if form.trajectory is not None:
        yield from _trajectory_faults(form.trajectory, robot, units)
    runs, postures = [(("runs", index), entry) for index, entry in enumerate(form.runs)], enumerate(form.postures)
    for path, entry in [*runs, *((("postures", index), entry) for index, entry in postures)]:
        if not 1 <= entry.joint <= robot.n_joints or len(entry.hold) != robot.n_joints:
            what = f"joint {entry.joint} and {len(entry.hold)} held positions; {robot.name} has {robot.n_joints} joints"
            yield (path, what, f"joints count from 1 to {robot.n_joints}; is the plan for another robot?")
            continue
        moving = robot.joint(entry.joint)
        places = [("hold", joint, value) for joint, value in zip(robot.joints, entry.hold, strict=True)]
        places = [place for place in places if place[1] != moving]
        if isinstance(entry, RunForm):
            places += [("from", moving, entry.start), ("to", moving, entry.end), ("velocity", moving, entry.velocity)]
            if entry.start == entry.end:
                yield (*path, "to"), f"the run goes from {entry.start:g} to the same place", "give the span another end"
        for key, joint, value in places:
            unit, scale = units[joint.number - 1]
            speeds = None if joint.max_velocity is None else (0.0, joint.max_velocity)
            limits = speeds if key == "velocity" else joint.limits
            low, high = (limit / scale for limit in limits or (-math.inf, math.inf))
            slack = _ROUNDING * (high - low) if limits else 0.0
            if not low - slack <= value <= high + slack:
                what = (
                    f"{key} of {value:g} is not within joint {joint.number}'s {number(low)}..{number(high)}"
                    f" {unit}{'/s' * (key == 'velocity')}"
                )
                yield ((*path, key), what, "stay inside the limits, or correct them in the recipe")


def _trajectory_faults(form: TrajectoryForm, robot: Robot, units: list[tuple[str, float]]) -> Iterator[Fault]:
    knots, before, ways = ("trajectory", "knots"), -math.inf, list[Fault]()
    for index, knot in enumerate(form.knots):
        for key in _STATES:
            values = getattr(knot, key)
            if len(values) != robot.n_joints and (values or key == "position"):
                what = f"{len(values)} values; {robot.name} has {robot.n_joints} joints"
                ways.append(((*knots, index, key), what, "write one a joint; is the plan for another robot?"))
        if knot.time <= before or (index == 0 and knot.time != 0.0):
            ways.append(((*knots, index, "time"), f"{knot.time:g} s", "let time begin at 0 and rise"))
        before = knot.time
    if ways:
        yield from ways
        return
    made = _trajectory(form, [scale for _, scale in units])
    if made.velocity[[0, -1]].any():
        yield (
            (*knots, 0 if made.velocity[0].any() else len(form.knots) - 1),
            "it does not rest there",
            "begin and end at rest",
        )
    if made.repeats > 1 and not all(
        np.allclose(part[0], part[-1], atol=1e-6) for part in (made.position, made.acceleration)
    ):
        yield ((*knots, len(form.knots) - 1), "what is repeated does not end as it begins", "end at the first knot")
    between = np.linspace(made.time[:-1], made.time[1:], _BETWEEN + 1, axis=1)
    states = [part.reshape(*between.shape, -1) for part in replace(made, repeats=1).at(between.ravel())]
    for joint, (order, (key, values)) in product(robot.joints, enumerate(zip(_STATES, states, strict=True))):
        unit, scale = units[joint.number - 1]
        highest = (joint.max_velocity or math.inf) / (RAMP_TIME if key == "acceleration" else 1.0)
        low, high = (joint.limits or (-math.inf, math.inf)) if key == "position" else (-highest, highest)
        slack = _ROUNDING * (high - low) if math.isfinite(high - low) else 0.0
        reached = values[..., joint.number - 1]
        beyond = np.maximum(low - slack - reached, reached - high - slack).max(axis=1)
        if (beyond > 0.0).any():
            index = int(np.argmax(beyond > 0.0))
            per = ("", "/s", "/s2")[order]
            worst = reached[index].flat[np.argmax(np.abs(reached[index]))] / scale
            what = (
                f"{key} of joint {joint.number} ({joint.name}) gets to {number(worst)} before the next knot, beyond"
                f" {number(low / scale)}..{number(high / scale)} {unit}{per}"
            )
            yield ((*knots, index, key), what, "stay inside the limits, give it more time, or correct the recipe")


def _trajectory(form: TrajectoryForm, scales: list[float]) -> Trajectory:
    nothing = [0.0] * len(scales)
    q, v, a = (np.array([getattr(knot, key) or nothing for knot in form.knots]) * scales for key in _STATES)
    return Trajectory(np.array([knot.time for knot in form.knots]), q, v, a, form.repeats, form.kind)


def find_plan(folders: Iterable[Path]) -> Path | None:
    """The first ``plan.yaml`` in some folders, or none."""
    return next((path for path in (Path(folder) / PLAN_NAME for folder in folders) if path.is_file()), None)


def read_plan(path: Path, robot: Robot) -> Plan:
    """Read a plan; ``-`` is standard input. A plan for another robot has a note.

    Raises
    ------
    ModelError [plan-wrong], or Faults of several
        Unknown keys, missing or impossible values, positions outside the robot's limits, speeds above its highest,
        accelerations beyond this in 0.4 s; each with line and path (``runs[12].velocity``).
    ModelError [file-not-readable]
        It cannot be read at all.
    """
    document = parsed_yaml(read_bytes(Path(path), kind=ModelError, most=_MAX_BYTES), file_name(path), kind=ModelError)
    for key in _NOT_READ:
        document.data.pop(key, None)
    form = validated(PlanForm, document, "plan-wrong", between=partial(_faults, robot=robot))
    scales = [scale for _, scale in _units(robot, form.units.get("angle", "rad"))]

    def held(entry: HoldForm) -> tuple[float, ...]:
        return tuple(value * scale for value, scale in zip(entry.hold, scales, strict=True))

    motions = []
    for run in form.runs:
        start, end, velocity = (value * scales[run.joint - 1] for value in (run.start, run.end, run.velocity))
        payload = None if run.payload is None else (run.payload.mass, *run.payload.at)
        motions.append(Motion(run.joint, held(run), start, end, velocity, run.purpose, payload))
    return Plan(
        form.robot or robot.name,
        tuple(motions),
        tuple(Posture(entry.joint, held(entry), tuple(entry.serves), entry.why) for entry in form.postures),
        duration=form.duration,
        seed=form.seed,
        trajectory=None if form.trajectory is None else _trajectory(form.trajectory, scales),
        notes=()
        if form.robot in ("", robot.name)
        else (Note("plan-other-robot", f"the plan is for '{form.robot}', the recipe is of '{robot.name}'"),),
    )


def plan_text(plan: Plan, robot: Robot, *, format: str = "yaml") -> str:
    """A plan for a robot as the text of its file, in deg and m: YAML, or with `format` ``"csv"`` a row a run, or a knot
    of all repeats, without the reasons and the forecast, units in the columns' names.
    """
    entries = plan_document(plan, robot, angle="deg")
    if format == "csv":
        units = [unit for unit, _ in _units(robot, "deg")]
        if plan.trajectory is not None:
            pers = zip(_STATES, ("", "_s", "_s2"), strict=True)
            head = [f"{key}{j}_{unit}{per}" for key, per in pers for j, unit in enumerate(units, start=1)]
            scales = np.tile([scale for _, scale in _units(robot, "deg")], 3)
            time, *states = plan.trajectory.knots()
            rows = [
                ["time_s", *head],
                *(map(yaml_line, row) for row in np.column_stack([time, np.hstack(states) / scales])),
            ]
        else:
            holds = [f"hold{number}_{unit}" for number, unit in enumerate(units, start=1)]
            rows = [["run", "joint", *holds, "from", "to", "velocity", "unit", "purpose"]]
            for count, run in enumerate(entries["runs"], start=1):
                numbers = map(yaml_line, (*run["hold"], run["from"], run["to"], run["velocity"]))
                rows.append([str(count), str(run["joint"]), *numbers, units[run["joint"] - 1], run["purpose"]])
        return "".join(",".join(row) + "\n" for row in rows)
    entries |= {
        "duration": round(plan.duration, 1),
        "expected_std_errors": {name: float(f"{value:.3g}") for name, value in plan.expected.items()},
        "notes": [{"note": note.slug, "text": note.text} for note in plan.notes],
    }
    lines = _RUNS if plan.trajectory is None else _KNOTS
    return "\n".join([*lines, *(line for item in entries.items() for line in _block(*item))]) + "\n"


def _block(key: str, value: Any, indent: str = "") -> list[str]:
    """Lines of a key with its value: lists and mappings have a line an entry; nothing of what is empty."""
    if isinstance(value, list) and value and isinstance(value[0], dict | str):
        return [f"{indent}{key}:", *(f"{indent}  - {yaml_line(entry)}" for entry in value)]
    if isinstance(value, dict) and value and key != "units":
        return [f"{indent}{key}:", *(line for item in value.items() for line in _block(*item, indent=f"{indent}  "))]
    return [] if value in (None, [], {}, "") else [f"{indent}{key}: {yaml_line(value)}"]


def plan_document(plan: Plan, robot: Robot, *, angle: str = "rad") -> dict[str, Any]:
    """A plan as the document of ``--json``: angles in the unit `angle`, SI otherwise."""
    scales = [scale for _, scale in _units(robot, angle)]

    def head(entry: Motion | Posture) -> dict[str, Any]:
        return {"joint": entry.joint, "hold": [value / scale for value, scale in zip(entry.hold, scales, strict=True)]}

    runs = []
    for motion in plan.motions:
        scale = scales[motion.joint - 1]
        ends = {"from": motion.start / scale, "to": motion.end / scale, "velocity": motion.velocity / scale}
        mass, *at = motion.payload or [0.0]
        carried = {"payload": {"mass": mass, "at": at}} if motion.payload else {}
        runs.append(head(motion) | ends | {"purpose": motion.purpose} | carried)
    made, names = plan.trajectory, ("time", *_STATES)
    states = zip(made.time, *(getattr(made, key) / scales for key in _STATES), strict=True) if made else ()
    knots = [{name: part.tolist() for name, part in zip(names, knot, strict=True)} for knot in states]
    return {
        "kind": "plan",
        "format": 1,
        "robot": plan.robot,
        "units": {"angle": angle},
        "seed": plan.seed,
        "duration": plan.duration,
        "runs": runs,
        "trajectory": made and {"kind": made.kind, "repeats": made.repeats, "knots": knots},
        "postures": [head(posture) | {"serves": list(posture.serves), "why": posture.why} for posture in plan.postures],
        "expected_std_errors": dict(plan.expected),
        "unseen": dict(plan.unseen),
        "assumptions": list(plan.assumptions),
        "pumaid": __version__,
        "recipe": {"file": robot.origin, "sha256": robot.digest},
        "notes": [note.as_json() for note in plan.notes],
    }


def urscript(plan: Plan, robot: Robot) -> str:
    """The text of a ``.script`` file: a move to each run's posture, a rest, the run, a rest; or the trajectory.

    Raises
    ------
    ModelError [program-other-robot]
        URScript moves six revolute joints, and this arm has others.

    Source
    ------
    Universal Robots, The URScript Programming Language, module motion: movej(q, a, v) is straight in the joints' space,
    a and v being those of the leading axis; servoj(q, t, lookahead_time, gain); textmsg(s1, s2); sleep(t); stopj(a).
    """
    if robot.n_joints != 6 or not robot.is_revolute.all():
        raise ModelError(
            "program-other-robot",
            f"URScript moves six revolute joints; {robot.name} has {int(robot.is_revolute.sum())} of {robot.n_joints}",
            Where(file=robot.origin or None),
            "use the form ros2, yaml or csv for this arm",
        )
    lines: list[str] = []

    def move(position: Floats, acceleration: float, speed: float) -> None:
        listed = ", ".join(f"{value + 0.0:.7f}" for value in position)
        lines.append(f"movej([{listed}], a={acceleration:.6f}, v={speed:.6f})")

    for step in trapezoids(robot, plan):
        if not lines:
            move(step.start, _APPROACH_RAMP, _APPROACH)
        if step.motion is not None:
            lines += [f"sleep({REST})", f"# {_comment(step.motion, robot)}", f'textmsg("pumaid run ", {step.number})']
        move(step.end, step.acceleration, step.speed)
        lines += [f"sleep({REST})"] * (step.motion is not None)
    if plan.trajectory is not None:
        move(plan.trajectory.position[0], _APPROACH_RAMP, _APPROACH)
        lines += _knot_calls(plan.trajectory)
    body = "\n".join(f"  {line}" for line in [*lines, 'textmsg("pumaid plan done")'])
    minutes = duration(robot, plan) / 60.0
    return _URSCRIPT.format(what=_what(plan), name=robot.name, minutes=minutes, version=__version__, body=body)


def _knot_calls(made: Trajectory) -> list[str]:
    states = [[yaml_vector(row, 7) for row in getattr(made, key)] for key in _STATES]
    calls = [
        f"  pumaid_to({yaml_number(h, 9)}, {', '.join(row)})"
        for h, row in zip(np.diff(made.time), list(zip(*states, strict=True))[1:], strict=True)
    ]
    start = [f"global last_{name} = {rows[0]}" for name, rows in zip("qva", states, strict=True)]
    loop = ["local turn = 0", f"while turn < {made.repeats}:", *calls, "  turn = turn + 1", "end", "stopj(2.0)"]
    return [*start, *_TO_KNOT.splitlines(), f"sleep({REST})", 'textmsg("pumaid trajectory")', *loop]


def _what(plan: Plan) -> str:
    return f"{len(plan.motions)} runs" if plan.trajectory is None else "A trajectory"


def ros2_trajectory(plan: Plan, robot: Robot) -> str:
    """A trajectory_msgs/JointTrajectory as YAML: every corner of the trapezoids of speed, or every knot, is a point.

    Of runs, a controller that interpolates positions and velocities by cubics drives exact trapezoids; one that
    interpolates by quintics, as a trajectory needs, rounds the ramps; the plateau is at constant speed either way.

    Source
    ------
    trajectory_msgs/msg/JointTrajectory and JointTrajectoryPoint (docs.ros.org); interpolation: the documentation of
    joint_trajectory_controller (control.ros.org).
    """
    still, clock, lines = np.zeros(robot.n_joints), LEAD_IN, list[str]()

    def point(time: float, position: Floats, velocity: Floats, *, acceleration: Floats = still) -> None:
        seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
        positions, velocities, accelerations = (yaml_vector(part, 9) for part in (position, velocity, acceleration))
        lines.append(
            f"- {{positions: {positions}, velocities: {velocities}, accelerations: {accelerations},"
            f" time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}}}"
        )

    for step in trapezoids(robot, plan):
        if not lines:
            point(clock, step.start, still)
        if step.motion is not None:
            lines.append(f"# run {step.number}: {_comment(step.motion, robot)}")
            point(clock + REST, step.start, still)
        clock += step.lead
        ends = np.array([step.ramp, step.duration - step.ramp, step.duration])
        times = ends if ends[1] - ends[0] > 1e-9 else ends[[0, 2]]
        for time, position, velocity in zip(times.tolist(), *step.at(times), strict=True):
            point(clock + time, position, velocity)
        clock += step.duration
        if step.motion is not None:
            clock += REST
            point(clock, step.end, still)
    for time, q, v, a in zip(*plan.trajectory.knots(), strict=True) if plan.trajectory is not None else ():
        point(clock + float(time), q, v, acceleration=a)
    joints, points = ", ".join(json.dumps(joint.name) for joint in robot.joints), "".join(f"\n{x}" for x in lines)
    return _ROS2.format(
        what=_what(plan),
        name=robot.name,
        version=__version__,
        lead=LEAD_IN,
        joints=joints,
        points=points or " []",
    )


def _comment(motion: Motion, robot: Robot) -> str:
    joint = robot.joint(motion.joint)
    unit, scale = _units(robot, "deg")[motion.joint - 1]
    start, end, speed = (f"{value / scale + 0.0:.6g}" for value in (motion.start, motion.end, motion.velocity))
    return f"joint {joint.number} ({joint.name}) from {start} to {end} {unit} at {speed} {unit}/s, {motion.purpose}"


#: Form -> (suffix of its files, what writes it).
PROGRAMS: dict[str, tuple[str, Callable[[Plan, Robot], str]]] = {
    "urscript": (".script", urscript),
    "ros2": (".ros2.yaml", ros2_trajectory),
}
