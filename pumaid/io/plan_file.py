"""Plans on disk: YAML that people edit; written also as CSV, one row a run, and as robots' programs.

A program is what a robot's own controller runs: URScript, or a ROS 2 trajectory.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
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
    StrictForm,
    file_name,
    parsed_yaml,
    read_bytes,
    validated,
    yaml_text,
    yaml_vector,
)
from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.trajectory import REST, Motion, Plan, Posture, duration, trapezoids
from pumaid.units import factor, number

#: The plan's name in an experiment's folder.
PLAN_NAME = "plan.yaml"
#: Most bytes of a plan: some forty thousand runs.
_MAX_BYTES = 5_000_000
#: Significant digits of positions and speeds; whole degrees stay whole.
_DIGITS = 10
#: Share of its range by which a limit may be passed: round-off.
_ROUNDING = 1e-6
#: What a plan promises and says of itself, which is not read back.
_NOT_READ = ("expected_std_errors", "unseen", "efficiency", "assumptions", "notes", "pumaid", "recipe")
#: rad/s and rad/s2 of URScript's first move, from wherever the arm stands.
_APPROACH, _APPROACH_RAMP = 0.2, 0.5
#: s in which a ROS 2 controller takes the arm to the first posture from where it stands, which must be near it.
LEAD_IN = 5.0

_URSCRIPT = """\
# {count} runs for {name}, about {minutes:.0f} min; pumaid {version}.
# Before you start it: set payload and TCP in the installation, clear the cell, start the recording of the log, and
# drive it through once with the speed slider low; for the measurement the slider must be at 100 %.
# It first drives slowly, all joints at once, to the posture of the first run: be near it, with the way free.
# movej with one moving joint is a trapezoid of speed: v in rad/s on the plateau, a in rad/s2 on the ramps.
def pumaid_plan():
{body}
end
"""

_ROS2 = """\
# {count} runs for {name} as one trajectory_msgs/msg/JointTrajectory (rad, m, s); pumaid {version}.
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


class PlanForm(StrictForm):
    """What is read of a file; only kind, format and runs are needed."""

    kind: Literal["plan"] = Field(examples=["plan"])
    format: Literal[1] = Field(examples=["1"])
    runs: list[RunForm] = Field(min_length=1, examples=["at least one, or make a plan with: pumaid plan"])
    robot: str = ""
    units: dict[Literal["angle"], AngleUnit] = Field({})
    postures: list[PostureForm] = Field([])
    duration: Finite = 0.0
    seed: Annotated[int, Field(ge=0)] = 0


def _units(robot: Robot, angle: str) -> list[tuple[str, float]]:
    """By joint, a plan's unit of its position, and SI per unit."""
    return [(angle, factor(angle)) if joint.is_revolute else ("m", 1.0) for joint in robot.joints]


def _faults(form: PlanForm, robot: Robot) -> Iterator[Fault]:
    """What an arm cannot do of a plan."""
    units = _units(robot, form.units.get("angle", "rad"))
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
                what = f"the run goes from {entry.start:g} to the same place"
                yield ((*path, "to"), what, "give the span another end")
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


def find_plan(folders: Iterable[Path]) -> Path | None:
    """The first ``plan.yaml`` in some folders, or none."""
    return next((path for path in (Path(folder) / PLAN_NAME for folder in folders) if path.is_file()), None)


def read_plan(path: Path, robot: Robot) -> Plan:
    """Read a plan; ``-`` is standard input. A plan for another robot has a note.

    Raises
    ------
    ModelError [plan-wrong], or Faults of several
        Unknown keys, missing or impossible values, positions outside the robot's limits, speeds above its highest; each
        with line and path (``runs[12].velocity``).
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
        motions.append(Motion(run.joint, held(run), start, end, velocity, run.purpose))
    return Plan(
        form.robot or robot.name,
        tuple(motions),
        tuple(Posture(entry.joint, held(entry), tuple(entry.serves), entry.why) for entry in form.postures),
        duration=form.duration,
        seed=form.seed,
        notes=()
        if form.robot in ("", robot.name)
        else (Note("plan-other-robot", f"the plan is for '{form.robot}', the recipe is of '{robot.name}'"),),
    )


def plan_text(plan: Plan, robot: Robot, *, format: str = "yaml") -> str:
    """A plan for a robot as the text of its file, in deg and m: YAML, or with `format` ``"csv"`` a row a run without
    the reasons and the forecast, units in the columns' names.
    """
    entries = plan_document(plan, robot, angle="deg")
    if format == "csv":
        units = [unit for unit, _ in _units(robot, "deg")]
        holds = [f"hold{number}_{unit}" for number, unit in enumerate(units, start=1)]
        rows = [["run", "joint", *holds, "from", "to", "velocity", "unit", "purpose"]]
        for count, run in enumerate(entries["runs"], start=1):
            numbers = map(_flow, (*run["hold"], run["from"], run["to"], run["velocity"]))
            rows.append([str(count), str(run["joint"]), *numbers, units[run["joint"] - 1], run["purpose"]])
        return "".join(",".join(row) + "\n" for row in rows)
    entries |= {
        "duration": round(plan.duration, 1),
        "efficiency": None if plan.efficiency is None else round(plan.efficiency, 3),
        "expected_std_errors": {name: float(f"{value:.3g}") for name, value in plan.expected.items()},
        "notes": [{"note": note.slug, "text": note.text} for note in plan.notes],
    }
    lines = [
        "# Runs to be executed in this order. One joint moves from `from` to `to` at speed `velocity` (in deg/s, or",
        "# m/s if it slides); the others stay at `hold` (its own entry is ignored). expected_std_errors are in SI,",
        "# duration in s; efficiency is the error of the best conceivable runs in this time, as a share of these'.",
    ]
    for key, value in entries.items():
        if isinstance(value, list) and value:
            lines += [f"{key}:", *(f"  - {_flow(entry)}" for entry in value)]
        elif isinstance(value, dict) and value and key != "units":
            lines += [f"{key}:", *(f"  {name}: {_flow(entry)}" for name, entry in value.items())]
        elif value not in (None, [], {}):
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def plan_document(plan: Plan, robot: Robot, *, angle: str = "rad") -> dict[str, Any]:
    """A plan as the document of ``--json``: angles in the unit `angle`, SI otherwise."""
    scales = [scale for _, scale in _units(robot, angle)]

    def head(entry: Motion | Posture) -> dict[str, Any]:
        return {"joint": entry.joint, "hold": [value / scale for value, scale in zip(entry.hold, scales, strict=True)]}

    runs = []
    for motion in plan.motions:
        scale = scales[motion.joint - 1]
        ends = {"from": motion.start / scale, "to": motion.end / scale, "velocity": motion.velocity / scale}
        runs.append(head(motion) | ends | {"purpose": motion.purpose})
    return {
        "kind": "plan",
        "format": 1,
        "robot": plan.robot,
        "units": {"angle": angle},
        "seed": plan.seed,
        "duration": plan.duration,
        "efficiency": plan.efficiency,
        "runs": runs,
        "postures": [head(posture) | {"serves": list(posture.serves), "why": posture.why} for posture in plan.postures],
        "expected_std_errors": dict(plan.expected),
        "unseen": dict(plan.unseen),
        "assumptions": list(plan.assumptions),
        "pumaid": __version__,
        "recipe": {"file": robot.origin, "sha256": robot.digest},
        "notes": [note.as_json() for note in plan.notes],
    }


def _flow(value: Any) -> str:
    """A value in YAML's flow style."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str):
        return yaml_text(value)
    return f"{value + 0.0:.{_DIGITS}g}"  # never -0


def urscript(plan: Plan, robot: Robot) -> str:
    """The text of a ``.script`` file: a move to each run's posture, a rest, the run, a rest.

    Raises
    ------
    ModelError [program-other-robot]
        URScript moves six revolute joints, and this arm has others.

    Source
    ------
    Universal Robots, The URScript Programming Language, module motion: movej(q, a, v) is straight in the joints' space,
    a and v being those of the leading axis; textmsg(s1, s2); sleep(t).
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
        if step.motion is None:
            move(step.end, step.acceleration, step.speed)
            continue
        lines += [f"sleep({REST})", f"# {_comment(step.motion, robot)}", f'textmsg("pumaid run ", {step.number})']
        move(step.end, step.acceleration, step.speed)
        lines.append(f"sleep({REST})")
    body = "\n".join(f"  {line}" for line in [*lines, 'textmsg("pumaid plan done")'])
    return _URSCRIPT.format(
        count=len(plan.motions), name=robot.name, minutes=duration(robot, plan) / 60.0, version=__version__, body=body
    )


def ros2_trajectory(plan: Plan, robot: Robot) -> str:
    """A trajectory_msgs/JointTrajectory as YAML: every corner of the trapezoids of speed is a point.

    A controller that interpolates positions and velocities by cubics drives exact trapezoids; one that interpolates by
    quintics rounds the ramps; the plateau is at constant speed either way.

    Source
    ------
    trajectory_msgs/msg/JointTrajectory and JointTrajectoryPoint (docs.ros.org); interpolation: the documentation of
    joint_trajectory_controller (control.ros.org).
    """
    still, clock, lines = np.zeros(robot.n_joints), LEAD_IN, list[str]()

    def point(time: float, position: Floats, velocity: Floats) -> None:
        seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
        positions, velocities, accelerations = (yaml_vector(part, 9) for part in (position, velocity, still))
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
    joints, points = ", ".join(json.dumps(joint.name) for joint in robot.joints), "".join(f"\n{x}" for x in lines)
    return _ROS2.format(
        count=len(plan.motions),
        name=robot.name,
        version=__version__,
        lead=LEAD_IN,
        joints=joints,
        points=points or " []",
    )


def _comment(motion: Motion, robot: Robot) -> str:
    """A run in a comment: ``joint 3 (elbow) from -125 to 125 deg at 30 deg/s, fit``."""
    joint = robot.joint(motion.joint)
    unit, scale = _units(robot, "deg")[motion.joint - 1]
    start, end, speed = (f"{value / scale + 0.0:.6g}" for value in (motion.start, motion.end, motion.velocity))
    return f"joint {joint.number} ({joint.name}) from {start} to {end} {unit} at {speed} {unit}/s, {motion.purpose}"


#: Form -> (suffix of its files, what writes it).
PROGRAMS: dict[str, tuple[str, Callable[[Plan, Robot], str]]] = {
    "urscript": (".script", urscript),
    "ros2": (".ros2.yaml", ros2_trajectory),
}
