"""Plans on disk: YAML that people edit and robots' programs read, or CSV with one row a run."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

from pydantic import AfterValidator, BaseModel, Field, ValidationInfo

from pumaid import __version__
from pumaid.errors import ModelError, Note, Where, listed
from pumaid.io.forms import (
    FORM,
    Document,
    Finite,
    file_name,
    parsed_yaml,
    read_bytes,
    refusal,
    shown,
    validated,
    yaml_text,
)
from pumaid.io.write import write_file
from pumaid.robot import Robot
from pumaid.trajectory import Motion, Plan, Posture
from pumaid.units import factor, number

PLAN_FORMAT = 1
#: The plan's name in an experiment's folder.
PLAN_NAME = "plan.yaml"
#: Most bytes of a plan: some forty thousand runs.
_MAX_BYTES = 5_000_000
#: Significant digits of positions and speeds; whole degrees stay whole.
_DIGITS = 10
#: Share of its range by which a limit may be passed: round-off of ten digits.
_ROUNDING = 1e-8


@dataclass(frozen=True, slots=True)
class _PlannedArm:
    """The robot of a plan, and the plan's unit of angles."""

    robot: Robot
    angle: str

    def unit(self, joint: int) -> tuple[str, float]:
        """The plan's unit of the joint's position, and SI per unit."""
        return (self.angle, factor(self.angle)) if self.robot.joint(joint).is_revolute else ("m", 1.0)

    def scaled(self, hold: Sequence[float]) -> list[float]:
        """Held positions in the plan's units."""
        return [value / self.unit(joint)[1] for joint, value in enumerate(hold, start=1)]

    @property
    def holds(self) -> list[str]:
        """The columns of held positions in a plan's CSV."""
        return [f"hold{joint.number}_{self.unit(joint.number)[0]}" for joint in self.robot.joints]


def _arm(info: ValidationInfo) -> _PlannedArm:
    return cast(_PlannedArm, info.context)


def _joint_number(joint: int, info: ValidationInfo) -> int:
    n_joints = _arm(info).robot.n_joints
    if not 1 <= joint <= n_joints:
        raise refusal(f"there is no joint {joint}", f"joints count from 1 to {n_joints}")
    return joint


def _within_limits(joint: int, value: float, arm: _PlannedArm) -> float:
    """A position in SI; one outside the joint's limits is refused."""
    unit, scale = arm.unit(joint)
    low, high = (limit / scale for limit in arm.robot.joint(joint).limits or (-math.inf, math.inf))
    slack = _ROUNDING * (high - low) if high < math.inf else 0.0
    if not low - slack <= value <= high + slack:
        what = f"{value:g} {unit} is outside joint {joint}'s limits {number(low)}..{number(high)} {unit}"
        raise refusal(what, "stay inside the limits, or correct them in the recipe")
    return value * scale


def _hold(values: list[float], info: ValidationInfo) -> tuple[float, ...]:
    arm, moving = _arm(info), info.data.get("joint")
    if len(values) != arm.robot.n_joints:
        what = f"{len(values)} held positions, {arm.robot.name} has {arm.robot.n_joints} joints"
        raise refusal(what, "is the plan for another robot?")
    return tuple(
        value * arm.unit(joint)[1] if joint == moving else _within_limits(joint, value, arm)
        for joint, value in enumerate(values, start=1)
    )


def _position(value: float, info: ValidationInfo) -> float:
    if "joint" not in info.data:
        return value
    out = _within_limits(info.data["joint"], value, _arm(info))
    if info.field_name == "end" and out == info.data.get("start"):
        raise refusal(f"the run goes from {value:g} to the same place", "give the span another end")
    return out


def _velocity(value: float, info: ValidationInfo) -> float:
    if "joint" not in info.data:
        return value
    joint = _arm(info).robot.joint(info.data["joint"])
    unit, scale = _arm(info).unit(joint.number)
    if joint.max_velocity is not None and value * scale > joint.max_velocity * (1.0 + 1e-6):
        highest = number(joint.max_velocity / scale)
        what = f"joint {joint.number} may do {highest} {unit}/s, the run wants {value:g}"
        raise refusal(what, "lower the velocity")
    return value * scale


Number = Annotated[int, Field(strict=True), AfterValidator(_joint_number)]
Hold = Annotated[list[Finite], AfterValidator(_hold)]
Position = Annotated[Finite, AfterValidator(_position)]


class _PlanEntry(BaseModel):
    model_config = FORM


class RunForm(_PlanEntry):
    """One entry of `runs`."""

    joint: Number
    hold: Hold = Field(examples=["[...], one position a joint"])
    start: Position = Field(alias="from")
    end: Position = Field(alias="to")
    velocity: Annotated[Finite, Field(gt=0), AfterValidator(_velocity)] = Field(
        examples=["a speed above 0; the direction follows from `from` and `to`"]
    )
    purpose: Literal["fit", "heldout"] = "fit"


class PostureForm(_PlanEntry):
    """One entry of `postures`."""

    joint: Number
    hold: Hold
    serves: list[str] = []
    why: str = ""


class PlanForm(_PlanEntry):
    """The whole file; only kind, format and runs are needed, and what the runs promise is not read back."""

    kind: Literal["plan"] = Field(examples=["plan"])
    format: Literal[1] = Field(examples=["1"])
    runs: list[RunForm] = Field(min_length=1, examples=["at least one, or make a plan with: pumaid plan"])
    robot: str = ""
    units: dict[Literal["angle"], Any] = {}
    postures: list[PostureForm] = []
    duration: Finite = 0.0
    seed: Annotated[int, Field(ge=0)] = 0
    expected_std_errors: Any = None
    unseen: Any = None
    efficiency: Any = None
    assumptions: Any = None
    notes: Any = None
    pumaid: Any = None
    recipe: Any = None


def find_plan(folders: Iterable[Path]) -> Path | None:
    """The first ``plan.yaml`` in some folders, or none."""
    paths = (Path(folder) / PLAN_NAME for folder in folders)
    return next((path for path in paths if path.is_file()), None)


def read_plan(path: Path, robot: Robot) -> Plan:
    """Read a plan, YAML or (by its ending) CSV; ``-`` is standard input, as YAML. A plan for another robot has a note.

    Raises
    ------
    ModelError [plan-wrong], or Faults of several
        Unknown keys, missing or impossible values, positions outside the robot's limits, speeds above its highest; each
        with line and path (``runs[12].velocity``).
    ModelError [yaml-refused], [file-not-readable]
        It cannot be read at all.
    """
    path, name = Path(path), file_name(path)
    content = read_bytes(path, kind=ModelError, most=_MAX_BYTES)
    is_csv = path.suffix.lower() == ".csv"
    document = _csv_document(content, name, robot) if is_csv else parsed_yaml(content, name, kind=ModelError)
    data = document.data
    if not isinstance(data, dict):
        what = f"the file holds {shown(data)}, not keys and values"
        raise ModelError("plan-wrong", what, Where(file=name, line=1), "make one with: pumaid plan")
    units = data.get("units", {"angle": "rad"})
    angle = units.get("angle") if isinstance(units, dict) else units
    if angle not in ("deg", "rad"):  # limits in an unknown unit mean nothing
        where = Where(file=name, line=document.line_of(("units", "angle")), field="units.angle")
        mend = "write units: {angle: deg}, or rad"
        raise ModelError("plan-wrong", f"the angles' unit is {shown(angle)}", where, mend)
    form = validated(PlanForm, document, name, kind=ModelError, slug="plan-wrong", context=_PlannedArm(robot, angle))
    notes = []
    if form.robot and form.robot != robot.name:
        notes.append(Note("plan-other-robot", f"the plan is for '{form.robot}', the recipe is of '{robot.name}'"))
    return Plan(
        form.robot or robot.name,
        tuple(Motion(run.joint, tuple(run.hold), run.start, run.end, run.velocity, run.purpose) for run in form.runs),
        tuple(Posture(p.joint, tuple(p.hold), tuple(p.serves), p.why) for p in form.postures),
        duration=form.duration,
        seed=form.seed,
        notes=tuple(notes),
    )


def _csv_document(content: bytes, file: str, robot: Robot) -> Document:
    """A CSV plan as the document that the same plan in YAML would be."""
    try:
        rows = list(csv.reader(content.decode("utf-8-sig").splitlines()))
    except (ValueError, csv.Error) as error:
        what = f"{file} is not CSV text: {error}"
        raise ModelError("file-not-readable", what, Where(file=file), "save it as UTF-8") from error
    header = [name.strip() for name in rows[0]] if rows else []
    arm = _PlannedArm(robot, "rad" if any(name.endswith("_rad") for name in header) else "deg")
    needed = ["joint", *arm.holds, "from", "to", "velocity"]
    if set(header) - {"run", "unit", "purpose"} != set(needed):
        what = f"the columns are {listed(header, 20)}"
        mend = f"a plan of {robot.name} has {', '.join(needed)}, and may have run, unit, purpose"
        raise ModelError("plan-wrong", what, Where(file=file, line=1), mend)
    lines: dict[tuple[str | int, ...], int] = {(): 1}
    runs: list[dict[str, Any]] = []
    for line, cells in enumerate(rows[1:], start=2):
        if cells:
            lines["runs", len(runs)] = line
            row = {name: _cell(name, cell.strip()) for name, cell in zip(header, cells, strict=False)}
            run = {name: row.get(name, "") for name in ("joint", "from", "to", "velocity")}
            hold = [row.get(name, "") for name in arm.holds]
            runs.append({**run, "hold": hold, "purpose": row.get("purpose") or "fit"})
    return Document({"kind": "plan", "format": 1, "units": {"angle": arm.angle}, "runs": runs}, lines, [])


def _cell(name: str, text: str) -> Any:
    """A number where it is one."""
    try:
        return int(text) if name == "joint" else float(text)
    except ValueError:
        return text


def write_plan(path: Path, plan: Plan, robot: Robot, *, format: str = "yaml") -> None:
    """Write a plan atomically; arguments as for `plan_text`, errors as of `write_file`."""
    write_file(path, plan_text(plan, robot, format=format))


def plan_text(plan: Plan, robot: Robot, *, format: str = "yaml") -> str:
    """A plan for a robot as the text of its file, in deg and m: YAML, or with `format` ``"csv"`` a row a run without
    the reasons and the forecast, units in the columns' names.
    """
    arm = _PlannedArm(robot, "deg")
    entries = _entries(plan, arm)
    if format == "csv":
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["run", "joint", *arm.holds, "from", "to", "velocity", "unit", "purpose"])
        for count, run in enumerate(entries["runs"], start=1):
            numbers = map(_flow, (*run["hold"], run["from"], run["to"], run["velocity"]))
            writer.writerow([count, run["joint"], *numbers, arm.unit(run["joint"])[0], run["purpose"]])
        return out.getvalue()
    entries["duration"] = round(plan.duration, 1)
    entries["efficiency"] = None if plan.efficiency is None else round(plan.efficiency, 3)
    entries["expected_std_errors"] = {name: float(f"{value:.3g}") for name, value in plan.expected.items()}
    entries["notes"] = [{"note": note.slug, "text": note.text} for note in plan.notes]
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


def plan_document(plan: Plan, robot: Robot) -> dict[str, Any]:
    """A plan as the document of ``--json``: angles in rad, SI otherwise."""
    return {
        **_entries(plan, _PlannedArm(robot, "rad")),
        "pumaid": __version__,
        "recipe": {"file": robot.origin, "sha256": robot.digest},
        "notes": [note.as_json() for note in plan.notes],
    }


def _entries(plan: Plan, arm: _PlannedArm) -> dict[str, Any]:
    """What a plan's document holds, positions in the unit of `arm`."""
    runs = []
    for motion in plan.motions:
        scale = arm.unit(motion.joint)[1]
        ends = {"from": motion.start / scale, "to": motion.end / scale, "velocity": motion.velocity / scale}
        runs.append({"joint": motion.joint, "hold": arm.scaled(motion.hold), **ends, "purpose": motion.purpose})
    postures = [
        {"joint": posture.joint, "hold": arm.scaled(posture.hold), "serves": list(posture.serves), "why": posture.why}
        for posture in plan.postures
    ]
    return {
        "kind": "plan",
        "format": PLAN_FORMAT,
        "robot": plan.robot,
        "units": {"angle": arm.angle},
        "seed": plan.seed,
        "duration": plan.duration,
        "efficiency": plan.efficiency,
        "runs": runs,
        "postures": postures,
        "expected_std_errors": dict(plan.expected),
        "unseen": dict(plan.unseen),
        "assumptions": list(plan.assumptions),
    }


def _flow(value: Any) -> str:
    """A value in YAML's flow style."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str):
        return yaml_text(value)
    text = f"{value:.{_DIGITS}g}"
    return "0" if text == "-0" else text
