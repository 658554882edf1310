"""Plans on disk: YAML that people edit and robots' programs read, or CSV with a row a run."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pumaid import __version__
from pumaid.errors import ModelError, Note, ResultError, Where
from pumaid.io.plan_checks import PLAN_FORMAT, CheckedPlan, checked_rows, checked_yaml
from pumaid.io.write import write_file
from pumaid.io.yaml_lines import read_yaml
from pumaid.records import Motion, Plan, Posture
from pumaid.robot import Robot
from pumaid.units import factor

#: The plan's name in an experiment's folder.
PLAN_NAME = "plan.yaml"
#: Bytes that a plan may have: some forty thousand runs.
_MAX_BYTES = 5_000_000
#: Significant digits of positions and speeds: finer than any encoder, and whole degrees stay whole.
_DIGITS = 10


def find_plan(folders: Iterable[Path]) -> Path | None:
    """The first ``plan.yaml`` in some folders (the recipe's, the logs', the one above those), or none."""
    for folder in folders:
        if (Path(folder) / PLAN_NAME).is_file():
            return Path(folder) / PLAN_NAME
    return None


def refuse_to_replace(path: Path) -> None:
    """Refuse to write a plan where one stands: it may have been edited, or logs may have been made by it.

    Raises
    ------
    ResultError [plan-in-the-way]
        There is a file of that name.
    """
    if str(path) != "-" and path.is_file():
        what, mend = f"{path} is there already", "replace it with --force, or write to another file"
        raise ResultError("plan-in-the-way", what, Where(file=str(path)), mend)


def read_plan(path: Path, robot: Robot) -> Plan:
    """Read a plan, YAML or (by its ending) CSV, and hold it against the robot's recipe.

    Parameters
    ----------
    path
        The file; ``-`` is standard input, as YAML.
    robot
        Number of joints, their kinds, limits and highest speeds.

    Returns
    -------
    plan
        In SI. A plan that names another robot with as many joints says so in its notes.

    Raises
    ------
    ModelError [plan-wrong]
        The file has a fault: a key that nobody knows (with the nearest that is known), a missing or impossible value, a
        position outside the joint's limits, a speed above its highest. Several are told together (`Faults`), each with
        its line and path (``runs[12].velocity``; runs count from 1).
    ModelError [yaml-refused], [file-not-readable]
        It cannot be read at all.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        found = checked_rows(_csv_text(path), str(path), robot)
    else:
        document = read_yaml(path, kind=ModelError, max_bytes=_MAX_BYTES)
        file = "standard input" if str(path) == "-" else str(path)
        found = checked_yaml(document.root, file, robot, doubled=document.doubled)
    return _plan(found, robot)


def write_plan(path: Path, plan: Plan, robot: Robot, *, format: str = "yaml", angle: str = "deg") -> None:
    """Write a plan, whole or not at all.

    Parameters
    ----------
    path
        The file.
    plan, robot
        The plan and the arm that it is for.
    format, angle
        As for `plan_text`.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses.
    """
    write_file(path, plan_text(plan, robot, format=format, angle=angle))


def plan_text(plan: Plan, robot: Robot, *, format: str = "yaml", angle: str = "deg") -> str:
    """A plan as the text of its file.

    Parameters
    ----------
    plan, robot
        The plan and the arm that it is for.
    format
        ``"yaml"``, or ``"csv"``: a row a run, units in the columns' names, without the reasons and the forecast.
    angle
        ``"deg"`` or ``"rad"``: unit of angles. Lengths are in m, forecast errors in SI.
    """
    return _csv(plan, robot, angle) if format == "csv" else _yaml(plan, robot, angle)


def plan_document(plan: Plan, robot: Robot) -> dict[str, Any]:
    """A plan as the document of ``--json``: angles in rad, SI otherwise."""
    return {
        "kind": "plan",
        "format": PLAN_FORMAT,
        "pumaid": __version__,
        "robot": plan.robot,
        "recipe": {"file": robot.origin, "sha256": robot.digest},
        "units": {"angle": "rad"},
        "seed": plan.seed,
        "duration": plan.duration,
        "efficiency": plan.efficiency,
        "runs": [
            {
                "joint": motion.joint,
                "hold": list(motion.hold),
                "from": motion.start,
                "to": motion.end,
                "velocity": motion.velocity,
                "purpose": motion.purpose,
            }
            for motion in plan.motions
        ],
        "postures": [
            {"joint": one.joint, "hold": list(one.hold), "serves": list(one.serves), "why": one.why}
            for one in plan.postures
        ],
        "expected_std_errors": dict(plan.expected),
        "unseen": dict(plan.unseen),
        "assumptions": list(plan.assumptions),
        "notes": [note.as_json() for note in plan.notes],
    }


def _scales(robot: Robot, angle: str) -> list[float]:
    """(J,) SI per unit of the file, joint by joint."""
    return [factor(angle) if joint.is_revolute else 1.0 for joint in robot.joints]


def _number(value: float) -> str:
    text = f"{value:.{_DIGITS}g}"
    return "0" if text == "-0" else text


def _text(value: str) -> str:
    """As YAML: plain where that is safe, else in JSON's quotes, which YAML reads too."""
    plain = re.fullmatch(r"[A-Za-z][\w./()-]*(?: [\w./()-]+)*", value) is not None
    words = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
    return value if plain and value.lower() not in words else json.dumps(value, ensure_ascii=False)


def _listed(values: Sequence[float], scales: Sequence[float]) -> str:
    return "[" + ", ".join(_number(value / scale) for value, scale in zip(values, scales, strict=True)) + "]"


def _yaml(plan: Plan, robot: Robot, angle: str) -> str:
    scales = _scales(robot, angle)
    lines = [
        "# Runs to be executed in this order. One joint moves from `from` to `to` at the speed `velocity`",
        f"# ({angle} and {angle}/s, m and m/s if it slides); the others stay at `hold` (its own entry is ignored).",
        "kind: plan",
        f"format: {PLAN_FORMAT}",
        f"robot: {_text(plan.robot)}",
        f"units: {{angle: {angle}}}",
        f"seed: {plan.seed}",
        f"duration: {plan.duration:.1f}  # s, moves between postures included",
        *_efficiency(plan),
        "runs:",
    ]
    lines += [f"  - {_run(motion, scales)}" for motion in plan.motions]
    lines += _section("postures", [_posture(posture, scales) for posture in plan.postures])
    errors = [f"{name}: {value:.3g}" for name, value in plan.expected.items()]
    lines += _section("expected_std_errors", errors, mark="", told="  # SI, rad")
    lines += _section("unseen", [f"{name}: {_text(why)}" for name, why in plan.unseen.items()], mark="")
    lines += _section("assumptions", [_text(sentence) for sentence in plan.assumptions])
    lines += _section("notes", [f"{{note: {_text(note.slug)}, text: {_text(note.text)}}}" for note in plan.notes])
    return "\n".join(lines) + "\n"


def _efficiency(plan: Plan) -> list[str]:
    if plan.efficiency is None:
        return []
    return [
        f"efficiency: {plan.efficiency:.3f}  # error of the best conceivable runs in this time, as a share of these'"
    ]


def _run(motion: Motion, scales: Sequence[float]) -> str:
    scale = scales[motion.joint - 1]
    start, end, velocity = (_number(value / scale) for value in (motion.start, motion.end, motion.velocity))
    return (
        f"{{joint: {motion.joint}, hold: {_listed(motion.hold, scales)}, from: {start}, to: {end},"
        f" velocity: {velocity}, purpose: {motion.purpose}}}"
    )


def _posture(posture: Posture, scales: Sequence[float]) -> str:
    serves = ", ".join(posture.serves)
    hold = _listed(posture.hold, scales)
    return f"{{joint: {posture.joint}, hold: {hold}, serves: [{serves}], why: {_text(posture.why)}}}"


def _section(name: str, entries: Sequence[str], *, mark: str = "- ", told: str = "") -> list[str]:
    return [f"{name}:{told}", *(f"  {mark}{entry}" for entry in entries)] if entries else []


def _csv(plan: Plan, robot: Robot, angle: str) -> str:
    scales = _scales(robot, angle)
    units = [angle if joint.is_revolute else "m" for joint in robot.joints]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    holds = [f"hold{joint.number}_{unit}" for joint, unit in zip(robot.joints, units, strict=True)]
    writer.writerow(["run", "joint", *holds, "from", "to", "velocity", "unit", "purpose"])
    for number, motion in enumerate(plan.motions, start=1):
        scale = scales[motion.joint - 1]
        held = [_number(value / size) for value, size in zip(motion.hold, scales, strict=True)]
        own = [_number(value / scale) for value in (motion.start, motion.end, motion.velocity)]
        writer.writerow([number, motion.joint, *held, *own, units[motion.joint - 1], motion.purpose])
    return out.getvalue()


def _csv_text(path: Path) -> str:
    try:
        content = path.read_bytes()
        if len(content) > _MAX_BYTES:
            what = f"{path.name} has more than {_MAX_BYTES} bytes: no plan is that long"
            raise ModelError("plan-wrong", what, Where(file=str(path)), "is this a log?")
        return content.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        what, mend = f"{path} cannot be read: {reason}", "check the path, its permissions and its encoding"
        raise ModelError("file-not-readable", what, Where(file=str(path)), mend) from error


def _plan(found: CheckedPlan, robot: Robot) -> Plan:
    """In SI."""
    scales = _scales(robot, found.angle)

    def held(values: Sequence[float]) -> tuple[float, ...]:
        return tuple(value * scale for value, scale in zip(values, scales, strict=True))

    motions = []
    for row in found.runs:
        scale = scales[row["joint"] - 1]
        start, end, velocity = (float(row[key]) * scale for key in ("from", "to", "velocity"))
        motions.append(Motion(row["joint"], held(row["hold"]), start, end, velocity, row["purpose"]))
    notes = tuple(Note(entry["note"], entry["text"]) for entry in found.notes)
    if found.robot and found.robot != robot.name:
        text = f"the plan is for '{found.robot}', the recipe is of '{robot.name}'"
        notes = (*notes, Note("plan-other-robot", text))
    return Plan(
        robot=found.robot or robot.name,
        motions=tuple(motions),
        postures=tuple(Posture(p["joint"], held(p["hold"]), tuple(p["serves"]), p["why"]) for p in found.postures),
        expected=dict(found.expected),
        unseen=dict(found.unseen),
        duration=found.duration,
        seed=found.seed,
        efficiency=found.efficiency,
        assumptions=tuple(found.assumptions),
        notes=notes,
    )
