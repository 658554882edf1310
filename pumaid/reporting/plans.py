"""Tables of a plan, and of what a virtual robot made of one."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from pumaid import __version__
from pumaid.robot import Robot
from pumaid.trajectory import Plan, Posture
from pumaid.units import factor, number


def plan_table(plan: Plan, robot: Robot) -> Group:
    """What a plan does joint by joint, what it promises, and what it cannot show; for the terminal.

    Parameters
    ----------
    plan
        The plan.
    robot
        The arm that it is for.
    """
    parts: list[Table | Text] = [_motions(plan, robot)]
    if plan.postures:
        parts.append(_postures(plan, robot))
    if plan.expected:
        parts.append(_promises(plan, robot))
    lines = []
    if plan.efficiency is not None:
        lines.append(
            f"errors are, in the mean, {number(1.0 / plan.efficiency, 3)} times those of the best conceivable runs in"
            " this time (no moves between postures, no repeats, none for judging)"
        )
    lines += [f"not to be seen: {name}: {why}" for name, why in plan.unseen.items()]
    lines += [f"assumed: {sentence}" for sentence in plan.assumptions]
    if lines:
        parts.append(Text("\n".join(lines)))
    return Group(*parts)


def duration_text(seconds: float) -> str:
    """Seconds in the words of a clock: ``12 min 5 s``."""
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def _shown(value: float, is_turning: bool) -> str:
    """Positions as people set them: degrees to a tenth, millimetres as metres."""
    return f"{value / factor('deg') + 0.0:.4g}" if is_turning else f"{value:.4g}"


def _motions(plan: Plan, robot: Robot) -> Table:
    heldout = sum(motion.purpose == "heldout" for motion in plan.motions)
    title = f"{plan.robot}: {len(plan.motions)} runs ({heldout} for judging only), {duration_text(plan.duration)}"
    table = Table(title=Text(title, style="table.title"), title_justify="left", box=box.SIMPLE_HEAD)
    for name, justify in (("joint", "left"), ("postures", "right"), ("span", "left"), ("speeds", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    table.add_column("fitted", justify="right")
    table.add_column("judged", justify="right")
    for joint in robot.joints:
        own = [motion for motion in plan.motions if motion.joint == joint.number]
        if not own:
            table.add_row(Text(f"{joint.number} {joint.name}"), "0", "-", "-", "0", "0")
            continue
        fitted = [motion for motion in own if motion.purpose == "fit"]
        turning, unit = joint.is_revolute, "deg" if joint.is_revolute else "m"
        ends = [end for motion in own for end in (motion.start, motion.end)]
        speeds = sorted({_shown(motion.velocity, turning) for motion in fitted}, key=float)
        table.add_row(
            Text(f"{joint.number} {joint.name}"),
            str(len({_others(motion.hold, joint.number) for motion in fitted})),
            f"{_shown(min(ends), turning)}..{_shown(max(ends), turning)} {unit}",
            f"{', '.join(speeds)} {unit}/s",
            str(len(fitted)),
            str(len(own) - len(fitted)),
        )
    return table


def _others(hold: Sequence[float], joint: int) -> tuple[float, ...]:
    return tuple(round(value, 6) for k, value in enumerate(hold, start=1) if k != joint)


def _postures(plan: Plan, robot: Robot) -> Table:
    table = Table(title="postures", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("joint", justify="right")
    table.add_column("others held at (deg, m)", no_wrap=True)
    table.add_column("why")
    for posture in plan.postures:
        table.add_row(str(posture.joint), _held(posture, robot), Text(posture.why))
    return table


def _held(posture: Posture, robot: Robot) -> str:
    shown = [
        "·" if joint.number == posture.joint else _shown(value, joint.is_revolute)
        for joint, value in zip(robot.joints, posture.hold, strict=True)
    ]
    return " ".join(f"{text:>5}" for text in shown)


def _promises(plan: Plan, robot: Robot) -> Table:
    """Predicted standard errors, a joint a column as in the parameter table; gravity in A (times g)."""
    size = math.sqrt(sum(part**2 for part in robot.gravity)) or 1.0
    rows = (
        ("k_x g (A)", "gravity.l{n}.x", size),
        ("k_y g (A)", "gravity.l{n}.y", size),
        ("m g (A)", "gravity.l{n}.mass", size),
        ("gain ratio to the next joint", "gain_ratio.{n}.{m}", 1.0),
        ("coulomb + (A)", "coulomb.j{n}.plus", 1.0),
        ("coulomb - (A)", "coulomb.j{n}.minus", 1.0),
        ("viscous + (A s/rad, A s/m)", "viscous.j{n}.plus", 1.0),
        ("viscous - (A s/rad, A s/m)", "viscous.j{n}.minus", 1.0),
    )
    table = Table(title="predicted standard errors", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("")
    for joint in robot.joints:
        table.add_column(str(joint.number), justify="right")
    for label, name, scale in rows:
        found = [plan.expected.get(name.format(n=joint.number, m=joint.number + 1)) for joint in robot.joints]
        if any(value is not None for value in found):
            table.add_row(label, *("-" if value is None else number(value * scale, 2) for value in found))
    return table


def session_document(robot: str, seed: int, files: Sequence[tuple[str, int, float, float]]) -> dict[str, object]:
    """What ``simulate --json`` prints; `files` as in `session_table`."""
    listed = [dict(zip(("file", "samples", "start", "end"), one, strict=True)) for one in files]
    return {"kind": "simulation", "format": 1, "pumaid": __version__, "robot": robot, "seed": seed, "files": listed}


def session_table(files: Sequence[tuple[str, int, float, float]]) -> Table:
    """Files that a virtual robot wrote: name, samples, first and last time (s) of each."""
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("file")
    for name in ("samples", "from (s)", "to (s)"):
        table.add_column(name, justify="right")
    for name, samples, first, last in files:
        table.add_row(Text(name), f"{samples:,}", f"{first:.1f}", f"{last:.1f}")
    return table
