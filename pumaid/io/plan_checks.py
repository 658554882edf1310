"""What a plan's file may hold, checked value by value; every fault is told, with its line and path."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn

from pumaid.errors import Faults, ModelError, PumaidError, Where
from pumaid.io.yaml_lines import Item, nearest
from pumaid.robot import Joint, Robot
from pumaid.units import factor, number

PLAN_FORMAT = 1
PURPOSES = ("fit", "heldout")
_RUN_KEYS = ("joint", "hold", "from", "to", "velocity", "purpose")
_POSTURE_KEYS = ("joint", "hold", "serves", "why")
_TOP_KEYS = ("kind", "format", "robot", "units", "runs", "postures", "expected_std_errors", "unseen")
_MORE_KEYS = ("duration", "seed", "efficiency", "assumptions", "notes", "pumaid", "recipe")
#: Faults that are told; of more, the count.
_MOST_FAULTS = 12
#: A limit may be passed by this share of its range: what rounding to ten digits does to it.
_ROUNDING = 1e-8


@dataclass(slots=True)
class CheckedPlan:
    """A plan's values without faults, angles in `angle`."""

    robot: str = ""
    angle: str = "rad"
    runs: list[dict[str, Any]] = field(default_factory=list)
    postures: list[dict[str, Any]] = field(default_factory=list)
    expected: dict[str, float] = field(default_factory=dict)
    unseen: dict[str, str] = field(default_factory=dict)
    assumptions: list[str] = field(default_factory=list)
    notes: list[dict[str, str]] = field(default_factory=list)
    duration: float = 0.0
    seed: int = 0
    efficiency: float | None = None


class _Checker:
    """Collects the faults of one file."""

    def __init__(self, file: str, robot: Robot) -> None:
        self.file, self.robot = file, robot
        self.faults: list[PumaidError] = []

    def fault(self, what: str, *, line: int | None, path: str, mend: str = "") -> None:
        where = Where(file=self.file, line=line, field=path or None)
        self.faults.append(ModelError("plan-wrong", what, where, mend))

    def refuse(self) -> NoReturn:
        """All faults in the order of their lines."""
        ordered = sorted(self.faults, key=lambda fault: fault.where.line or 0)
        more = len(ordered) - _MOST_FAULTS
        if more > 0:
            last = ordered[_MOST_FAULTS - 1]
            ordered = [
                *ordered[: _MOST_FAULTS - 1],
                ModelError(last.slug, f"{last.what} (and {more} more faults)", last.where, last.mend),
            ]
        raise ordered[0] if len(ordered) == 1 else Faults(ordered)

    def keys(self, item: Item, known: Sequence[str], needed: Sequence[str], *, path: str) -> bool:
        """Whether `item` is a mapping; unknown and missing keys are faults."""
        if not isinstance(item.value, dict):
            self.fault(f"{path or 'the file'} is no mapping of keys to values", line=item.line, path=path)
            return False
        meant = set()
        for key in item.value:
            if key not in known:
                near = nearest(key, [name for name in known if name not in item.value])
                meant.add(near)
                mend = f"did you mean {near}?" if near else f"known here: {', '.join(known)}"
                self.fault(
                    f"nobody knows the key {key[:60]!r}", line=item.key_lines[key], path=_at(path, key), mend=mend
                )
        for key in needed:
            if key not in item.value and key not in meant:
                self.fault(f"the key {key} is missing", line=item.line, path=_at(path, key), mend=f"add {key}: ...")
        return True

    def finite(self, item: Item | None, *, path: str) -> float | None:
        """A number, or none and a fault."""
        if item is None:
            return None
        value = item.value
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.fault(f"{_shown(value)} is no finite number", line=item.line, path=path, mend="give a number")
            return None
        return float(value)

    def whole(self, item: Item, *, low: int, high: int | None, path: str) -> int | None:
        """A whole number in a range, or none and a fault."""
        value = item.value
        if isinstance(value, bool) or not isinstance(value, int) or value < low or (high is not None and value > high):
            room = f"{low} to {high}" if high is not None else f"{low} or more"
            self.fault(f"{_shown(value)} is no whole number from {room}", line=item.line, path=path)
            return None
        return value

    def text(self, item: Item, *, path: str) -> str:
        """A text, or an empty one and a fault."""
        if not isinstance(item.value, str):
            self.fault(f"{_shown(item.value)} is no text", line=item.line, path=path, mend="put it in quotes")
            return ""
        return item.value

    def entries(self, item: Item | None, kind: type, *, path: str) -> Any:
        """The list or dict of `item`; empty, and a fault, where it is none."""
        if item is None:
            return kind()
        if not isinstance(item.value, kind):
            word = "a list" if kind is list else "a mapping"
            self.fault(f"{path} is not {word}", line=item.line, path=path)
            return kind()
        return item.value

    def hold(self, item: Item, *, path: str) -> list[float]:
        """Held positions, one a joint; checked against nothing but their number."""
        values = self.entries(item, list, path=path)
        if len(values) != self.robot.n_joints:
            what = f"{len(values)} held positions, {self.robot.name} has {self.robot.n_joints} joints"
            self.fault(what, line=item.line, path=path, mend="is the plan for another robot?")
            return []
        found = [self.finite(value, path=f"{path}[{k}]") for k, value in enumerate(values, start=1)]
        return [value for value in found if value is not None]

    def run(self, row: Mapping[str, Any], angle: str, *, line: int, path: str) -> None:
        """What a run's numbers must be among themselves and to the recipe."""
        joint = self.robot.joint(row["joint"])
        unit = angle if joint.is_revolute else "m"
        if row["velocity"] <= 0:
            mend = "speeds are positive; the direction follows from `from` and `to`"
            self.fault(f"velocity {row['velocity']:g} is not positive", line=line, path=f"{path}.velocity", mend=mend)
        scale = factor(unit)
        most = joint.max_velocity
        if most is not None and row["velocity"] * scale > most * (1 + 1e-6):
            what = f"joint {joint.number} may do {number(most / scale)} {unit}/s, the run wants {row['velocity']:g}"
            self.fault(what, line=line, path=f"{path}.velocity", mend="lower the velocity")
        if row["from"] == row["to"]:
            what = f"the run goes from {row['from']:g} to the same place"
            self.fault(what, line=line, path=f"{path}.to", mend="give the span another end")
        for key in ("from", "to"):
            self.inside(joint, row[key], angle, line=line, path=f"{path}.{key}")
        for other in self.robot.joints:
            if other.number != joint.number:
                self.inside(other, row["hold"][other.number - 1], angle, line=line, path=f"{path}.hold[{other.number}]")

    def inside(self, joint: Joint, value: float, angle: str, *, line: int, path: str) -> None:
        """Whether a position is within the joint's limits."""
        if joint.limits is None:
            return
        scale = factor(angle) if joint.is_revolute else 1.0
        low, high = (limit / scale for limit in joint.limits)
        slack = _ROUNDING * (high - low)
        if not low - slack <= value <= high + slack:
            unit = angle if joint.is_revolute else "m"
            what = f"{value:g} {unit} is outside joint {joint.number}'s limits {number(low)}..{number(high)} {unit}"
            self.fault(what, line=line, path=path, mend="stay inside the limits, or correct them in the recipe")


def _at(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _shown(value: object) -> str:
    return {dict: "a mapping", list: "a list", type(None): "nothing"}.get(type(value), repr(value)[:60])


def checked_yaml(document: Item, file: str, robot: Robot, *, doubled: Sequence[PumaidError] = ()) -> CheckedPlan:
    """The values of a YAML plan; `doubled` are faults that its reader found.

    Raises
    ------
    ModelError [plan-wrong]
        One fault; `Faults` where there are several.
    """
    check, found = _Checker(file, robot), CheckedPlan()
    check.faults += doubled
    if not check.keys(document, (*_TOP_KEYS, *_MORE_KEYS), ("kind", "format", "runs"), path=""):
        check.refuse()
    top = document.value
    _head(check, top, found)
    runs = check.entries(top.get("runs"), list, path="runs")
    if "runs" in top and isinstance(top["runs"].value, list) and not runs:
        check.fault("the plan has no runs", line=top["runs"].line, path="runs", mend="make one with: pumaid plan")
    for k, item in enumerate(runs, start=1):
        row = _run(check, item, f"runs[{k}]")
        if row is not None:
            found.runs.append(row)
            # Limits in an unknown unit would only add noise.
            if found.angle:
                check.run(row, found.angle, line=item.line, path=f"runs[{k}]")
    _extras(check, top, found)
    if check.faults:
        check.refuse()
    return found


def _head(check: _Checker, top: Mapping[str, Item], found: CheckedPlan) -> None:
    if "kind" in top and top["kind"].value != "plan":
        what = f"the file's kind is {_shown(top['kind'].value)}, not plan"
        check.fault(what, line=top["kind"].line, path="kind", mend="give a file that pumaid plan wrote")
    if "format" in top and top["format"].value != PLAN_FORMAT:
        what = f"format {_shown(top['format'].value)} is not known; this pumaid reads format {PLAN_FORMAT}"
        check.fault(what, line=top["format"].line, path="format", mend="use the pumaid that wrote it")
    if "robot" in top:
        found.robot = check.text(top["robot"], path="robot")
    if "units" in top and check.keys(top["units"], ("angle",), ("angle",), path="units"):
        item = top["units"].value.get("angle")
        if item is not None and item.value not in ("deg", "rad"):
            check.fault(
                f"{_shown(item.value)} is no unit of angles", line=item.line, path="units.angle", mend="deg or rad"
            )
            found.angle = ""
        elif item is not None:
            found.angle = item.value
    if "duration" in top:
        found.duration = check.finite(top["duration"], path="duration") or 0.0
    if "efficiency" in top:
        found.efficiency = check.finite(top["efficiency"], path="efficiency")
    if "seed" in top:
        found.seed = check.whole(top["seed"], low=0, high=None, path="seed") or 0


def _run(check: _Checker, item: Item, path: str) -> dict[str, Any] | None:
    """A run's values, or none and faults; purpose is ``fit`` where it is not said."""
    before = len(check.faults)
    if not check.keys(item, _RUN_KEYS, _RUN_KEYS[:-1], path=path):
        return None
    row: dict[str, Any] = {"purpose": "fit"}
    for key, value in item.value.items():
        at = f"{path}.{key}"
        if key == "joint":
            row[key] = check.whole(value, low=1, high=check.robot.n_joints, path=at)
        elif key == "hold":
            row[key] = check.hold(value, path=at)
        elif key in ("from", "to", "velocity"):
            row[key] = check.finite(value, path=at)
        elif key == "purpose" and value.value not in PURPOSES:
            near = nearest(value.value, PURPOSES)
            mend = f"did you mean {near}?" if near else "fit or heldout"
            check.fault(f"{_shown(value.value)} is no purpose", line=value.line, path=at, mend=mend)
        elif key == "purpose":
            row[key] = value.value
    return row if len(check.faults) == before else None


def _extras(check: _Checker, top: Mapping[str, Item], found: CheckedPlan) -> None:
    """Reasons and forecast: what an edited plan may have lost."""
    for k, item in enumerate(check.entries(top.get("postures"), list, path="postures"), start=1):
        path, before = f"postures[{k}]", len(check.faults)
        if not check.keys(item, _POSTURE_KEYS, ("joint", "hold"), path=path):
            continue
        inner = item.value
        joint = (
            check.whole(inner["joint"], low=1, high=check.robot.n_joints, path=f"{path}.joint")
            if "joint" in inner
            else 1
        )
        hold = check.hold(inner["hold"], path=f"{path}.hold") if "hold" in inner else []
        serves = [check.text(one, path=f"{path}.serves") for one in check.entries(inner.get("serves"), list, path=path)]
        why = check.text(inner["why"], path=f"{path}.why") if "why" in inner else ""
        if len(check.faults) == before:
            found.postures.append({"joint": joint, "hold": hold, "serves": serves, "why": why})
    for name, item in check.entries(top.get("expected_std_errors"), dict, path="expected_std_errors").items():
        found.expected[name] = check.finite(item, path=f"expected_std_errors.{name}") or 0.0
    for name, item in check.entries(top.get("unseen"), dict, path="unseen").items():
        found.unseen[name] = check.text(item, path=f"unseen.{name}")
    for k, item in enumerate(check.entries(top.get("assumptions"), list, path="assumptions"), start=1):
        found.assumptions.append(check.text(item, path=f"assumptions[{k}]"))
    for k, item in enumerate(check.entries(top.get("notes"), list, path="notes"), start=1):
        path = f"notes[{k}]"
        if check.keys(item, ("note", "text", "where"), ("note", "text"), path=path):
            found.notes.append(
                {
                    key: check.text(item.value[key], path=f"{path}.{key}")
                    for key in ("note", "text")
                    if key in item.value
                }
            )


def checked_rows(text: str, file: str, robot: Robot) -> CheckedPlan:
    """The values of a CSV plan, rows as `pumaid.io.plan.plan_text` writes them.

    Raises
    ------
    ModelError [plan-wrong]
        One fault; `Faults` where there are several.
    """
    check, found = _Checker(file, robot), CheckedPlan()
    rows = list(csv.reader(text.splitlines()))
    header = [name.strip() for name in rows[0]] if rows else []
    angle = "rad" if any(name.endswith("_rad") for name in header) else "deg"
    units = [angle if joint.is_revolute else "m" for joint in robot.joints]
    holds = [f"hold{joint.number}_{unit}" for joint, unit in zip(robot.joints, units, strict=True)]
    needed = ["joint", *holds, "from", "to", "velocity"]
    found.angle = angle
    for name in header:
        if name not in (*needed, "run", "unit", "purpose"):
            near = nearest(name, needed)
            mend = f"did you mean {near}?" if near else f"a plan for {robot.name} has {', '.join(needed)}"
            check.fault(f"nobody knows the column {name[:60]!r}", line=1, path=name, mend=mend)
    for name in needed:
        if name not in header:
            check.fault(f"the column {name} is missing", line=1, path=name, mend="is the plan for another robot?")
    if check.faults:
        check.refuse()
    for line, cells in enumerate(rows[1:], start=2):
        if cells:
            _row(check, found, dict(zip(header, cells, strict=False)), line=line, holds=holds)
    if not found.runs and not check.faults:
        check.fault("the plan has no runs", line=1, path="", mend="make one with: pumaid plan --format csv")
    if check.faults:
        check.refuse()
    return found


def _row(check: _Checker, found: CheckedPlan, cells: Mapping[str, str], *, line: int, holds: Sequence[str]) -> None:
    def item(name: str) -> Item:
        text = cells.get(name, "").strip()
        try:
            return Item(int(text) if name == "joint" else float(text), line)
        except ValueError:
            return Item(text, line)

    entries = {key: item(key) for key in ("joint", "from", "to", "velocity")}
    entries["hold"] = Item([item(name) for name in holds], line)
    entries["purpose"] = Item(cells.get("purpose", "fit").strip() or "fit", line)
    path = f"row {line}"
    row = _run(check, Item(entries, line, dict.fromkeys(entries, line)), path)
    if row is None:
        return
    unit = found.angle if check.robot.joint(row["joint"]).is_revolute else "m"
    told = cells.get("unit", unit).strip()
    if told not in ("", unit):
        check.fault(
            f"unit {told} does not fit the header's {unit}", line=line, path=f"{path}.unit", mend=f"give {unit}"
        )
    check.run(row, found.angle, line=line, path=path)
    found.runs.append(row)
