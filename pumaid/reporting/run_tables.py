"""Tables of runs: those that logs contain, those that a plan asks for; and of the arm that makes them."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from pumaid.dataset import BLOCK, CONSTANT, STROKE, Dataset, Reject
from pumaid.maths import by_key
from pumaid.reporting.table import Row, Table
from pumaid.reporting.text import count_kinds, counted_runs, in_unit, posture_text, relative_names, run_time
from pumaid.robot import Robot, roll_pitch_yaw
from pumaid.trajectory import Plan, Trajectory
from pumaid.units import number

#: Row of the predicted standard errors -> parameter of joint n.
_EXPECTED = {
    "k_x·g (A)": "gravity.l{n}.x",
    "k_y·g (A)": "gravity.l{n}.y",
    "m·g (A)": "gravity.l{n}.mass",
    "gain ratio to the next joint": "gain_ratio.{n}.{m}",
    "coulomb + (A)": "coulomb.j{n}.plus",
    "coulomb - (A)": "coulomb.j{n}.minus",
    "viscous + (A s/rad, A s/m)": "viscous.j{n}.plus",
    "viscous - (A s/rad, A s/m)": "viscous.j{n}.minus",
    "rotor (A s2/rad, A s2/m)": "rotor.j{n}",
}


# Runs of logs


def run_table(dataset: Dataset, robot: Robot, *, units: str = "rad") -> Table:
    """Every run: file, time, joint, posture and motion; a block of any motion is one row for all its joints."""
    kinds = [robot.joint(joint).position_unit for joint in sorted({run.joint for run in dataset.runs})]
    unit = " or ".join(dict.fromkeys(in_unit(kind, units)[1] for kind in kinds)) or units
    names = relative_names([run.origin for run in dataset.runs])
    rows: list[Row] = []

    blocks = by_key(
        enumerate(dataset.runs, start=1),
        lambda pair: (pair[1].origin, pair[1].first_row, pair[1].joint * (pair[1].kind != BLOCK)),
    )
    for group in blocks.values():
        (index, run), joints = group[0], [part for _, part in group]
        motion = [" ".join(str(part.joint) for part in joints), "-", "-", "-"]
        if run.kind != BLOCK:
            joint = robot.joint(run.joint)
            scale = in_unit(joint.position_unit, units)[0]
            low, high, speed = (number(value * scale, 4) for value in (*run.span, run.speed))
            motion = [
                f"{run.joint} {joint.name}",
                posture_text(robot, run.posture.tolist(), units),
                f"{low} to {high}",
                speed,
            ]
        place = [f"{index} *" if run.heldout else str(index), names[run.origin], run_time(run)]
        rows.append([*place, *motion, str(max(part.samples for part in joints)), run.kind])
    notes = [("*", "held out for validation")] if any(run.heldout for run in dataset.runs) else []
    caption = "A stroke's speed is its mean speed."
    cells = [float(np.median(np.diff(run.bins.time))) for run in dataset.runs if run.kind == BLOCK]
    if cells:
        caption += f" Cells of blocks last {number(1e3 * min(cells), 3)} to {number(1e3 * max(cells), 3)} ms."
    header = (
        *("run", "file", "time (s)", "joint", "other joints at", f"range ({unit})", f"speed ({unit}/s)"),
        *("samples", "kind"),
    )
    table = Table(f"{robot.name}: {counted_runs(dataset.runs)}", header, rows, notes, caption, words=(1, 3, 4, 8))
    return table.columns([k for k in range(len(header)) if any(row[k] != "-" for row in rows) or not rows])


def runs_by_joint_table(dataset: Dataset, robot: Robot, *, units: str = "rad") -> Table:
    """The runs of each joint: counts, speeds in both directions, postures, time."""
    rows = []
    for joint in robot.joints:
        runs = dataset.of_joint(joint.number)
        scale, unit = in_unit(f"{joint.position_unit}/s", units)
        steady = [run for run in runs if run.kind != BLOCK]
        speeds = [[run.speed * scale for run in steady if run.speed * sign > 0] for sign in (1, -1)]
        kinds = [str(count_kinds(runs).get(kind, "-")) for kind in (CONSTANT, STROKE, BLOCK)]
        postures = {tuple(np.round(np.delete(run.posture, joint.number - 1), 1)) for run in steady}
        sides = [sorted({number(speed, 3) for speed in side}, key=lambda text: abs(float(text))) for side in speeds]
        ranges = [" to ".join(side[:: max(1, len(side) - 1)]) or "-" for side in sides]
        head = [f"{joint.number} {joint.name}", *kinds, *ranges, unit if steady else "-", str(len(postures) or "-")]
        rows.append([*head, number(sum(run.duration for run in runs), 4) if runs else "-"])
    header = (
        *("joint", "constant", "strokes", "blocks", "forward speeds", "backward speeds", "unit"),
        *("postures", "time (s)"),
    )
    table = Table("Runs by joint", header, rows, words=(0, 4, 5, 6))
    return table.columns([k for k in range(len(header)) if k == 0 or any(row[k] != "-" for row in rows)])


def rejection_table(dataset: Dataset, *, is_whole: bool = False) -> Table:
    """What was not used, by reason, with the longest stretch as an example; or every stretch."""
    read = samples_read(dataset)
    names = relative_names([reject.origin for reject in dataset.rejects])
    rows = []
    for rejects in [[x] for x in dataset.rejects] if is_whole else by_reason(dataset.rejects).values():
        longest = max(rejects, key=lambda reject: reject.samples)
        samples = sum(reject.samples for reject in rejects)
        seconds = number(sum(reject.duration for reject in rejects), 4)
        example = f"{names[longest.origin]}, rows {longest.first_row}–{longest.last_row}: {longest.text}"
        rows.append(
            [longest.reason, str(len(rejects)), f"{samples:,}", f"{100 * samples / read:.1f} %", seconds, example]
        )
    unused = sum(reject.samples for reject in dataset.rejects)
    title = f"Not used: {unused:,} of {read:,} samples ({100 * unused / max(1, read):.1f} %)"
    return Table(title, ("reason", "stretches", "samples", "share", "time (s)", "longest stretch"), rows, words=(0, 5))


def by_reason(rejects: Iterable[Reject]) -> dict[str, list[Reject]]:
    """Rejects by reason, the reason with most samples first."""
    groups = by_key(rejects, lambda reject: reject.reason)
    return dict(sorted(groups.items(), key=lambda item: -sum(reject.samples for reject in item[1])))


def samples_read(dataset: Dataset) -> int:
    """All samples of the logs: of runs, of blocks of all joints once, and of rejects."""
    alone = sum(run.samples for run in dataset.runs if run.kind != BLOCK)
    blocks = {(run.origin, run.first_row): run.last_row - run.first_row for run in dataset.runs if run.kind == BLOCK}
    return alone + sum(blocks.values()) + sum(reject.samples for reject in dataset.rejects)


# The arm


def axes_table(robot: Robot, units: str = "deg") -> Table:
    """Geometry, limits and speeds of the joints, as the recipe states them; angles in `units`."""
    rows = []
    is_placed = any(joint.placement is not None for joint in robot.joints)
    for joint in robot.joints:
        scale, unit = in_unit(joint.position_unit, units)
        values = [*joint.frame[:3, 3], *roll_pitch_yaw(joint.frame[:3, :3])]
        turned = values[3:] if is_placed else [joint.theta, joint.alpha]
        angles = [f"{round(in_unit('rad', units)[0] * value, 4) + 0.0:.6g}" for value in turned]
        geometry = [*(f"{round(value, 7) + 0.0:.5g}" for value in values[:3]), *angles]
        if not is_placed:
            theta, d = (" + q", "") if joint.is_revolute else ("", " + q")
            geometry = [angles[0] + theta, angles[1], f"{joint.a:.5g}", f"{joint.d:.5g}{d}"]
        low, high = joint.limits or (-math.inf, math.inf)
        limits = "-" if joint.limits is None else f"{low * scale:.4g} to {high * scale:.4g} {unit}"
        speed = "-" if joint.max_velocity is None else f"{number(joint.max_velocity * scale)} {unit}/s"
        rows.append([str(joint.number), joint.name, joint.kind, *geometry, limits, speed])
    columns: tuple[str, ...] = (f"theta ({units})", f"alpha ({units})", "a (m)", "d (m)")
    caption = "Modified Denavit-Hartenberg parameters (Craig); q is the measured position."
    if is_placed:
        columns = ("x (m)", "y (m)", "z (m)", *(f"{name} ({units})" for name in ("roll", "pitch", "yaw")))
        caption = "Frame of each joint in that of the joint before, at zero; it moves about or along its z."
    return Table(
        f"{robot.name}: geometry",
        ("joint", "name", "type", *columns, "limits", "max. speed"),
        rows,
        caption=caption,
        words=(0, 1, 2),
    )


# Plans


def plan_tables(plan: Plan, robot: Robot) -> list[Table]:
    """What a plan does by joint, its postures, and the standard errors that it predicts."""
    lines = [
        *(f"Not identifiable: {name}: {reason.rstrip('.')}." for name, reason in plan.unseen.items()),
        *(f"Assumed: {sentence.rstrip('.')}." for sentence in plan.assumptions),
    ]
    tables = [
        _motion_table(plan, robot) if plan.trajectory is None else _trajectory_table(plan, plan.trajectory, robot)
    ]
    if plan.postures:
        rows = [
            [str(posture.joint), posture_text(robot, posture.hold, "deg", moving=posture.joint), posture.why]
            for posture in plan.postures
        ]
        tables.append(Table("Postures", ("joint", "other joints at (deg, m)", "purpose"), rows, words=(0, 1, 2)))
    gravity, rows = math.hypot(*robot.gravity) or 1.0, []
    for label, pattern in _EXPECTED.items():
        names = [pattern.format(n=joint.number, m=joint.number + 1) for joint in robot.joints]
        scale = gravity if pattern.startswith("gravity") else 1.0
        if any(name in plan.expected for name in names):
            rows.append(
                [label, *(number(plan.expected[name] * scale, 2) if name in plan.expected else "-" for name in names)]
            )
    header = ["joint", *(str(joint.number) for joint in robot.joints)]
    tables += [Table("Predicted standard errors", header, rows)] if plan.expected else []
    return [*tables[:-1], replace(tables[-1], notes=[("-", line) for line in lines])]


def _motion_table(plan: Plan, robot: Robot) -> Table:
    rows = []
    for joint in (robot.joint(moved) for moved in sorted({motion.joint for motion in plan.motions})):
        motions = [motion for motion in plan.motions if motion.joint == joint.number]
        fitted = [motion for motion in motions if motion.purpose == "fit"]
        scale, unit = in_unit(joint.position_unit, "deg")
        ends = [end * scale for motion in motions for end in (motion.start, motion.end)]
        speeds = sorted({f"{motion.velocity * scale:.4g}" for motion in fitted}, key=float)
        postures = {tuple(np.round(np.delete(motion.hold, motion.joint - 1), 6) + 0.0) for motion in fitted}
        rows.append(
            [
                f"{joint.number} {joint.name}",
                str(len(postures)),
                f"{min(ends) + 0.0:.4g} to {max(ends) + 0.0:.4g} {unit}",
                f"{', '.join(speeds)} {unit}/s",
                str(len(fitted)),
                str(len(motions) - len(fitted)),
            ]
        )
    heldout = sum(motion.purpose == "heldout" for motion in plan.motions)
    return Table(
        f"{plan.robot}: {len(plan.motions)} runs, {heldout} of them held out, {number(plan.duration / 60.0, 3)} min",
        ("joint", "postures", "range", "speeds", "fit", "hold-out"),
        rows,
        words=(0, 2, 3),
    )


def _trajectory_table(plan: Plan, made: Trajectory, robot: Robot) -> Table:
    states, rows = made.at(np.linspace(0.0, made.cycle, 8 * len(made.time))), []
    for joint in robot.joints:
        scale, unit = in_unit(joint.position_unit, "deg")
        position, speed, acceleration = (part[:, joint.number - 1] * scale for part in states)
        ways = f"{position.min() + 0.0:.4g} to {position.max() + 0.0:.4g} {unit}"
        highest = [f"{np.abs(part).max():.4g} {unit}{per}" for part, per in ((speed, "/s"), (acceleration, "/s2"))]
        rows.append([f"{joint.number} {joint.name}", ways, *highest])
    times = f"{made.repeats} times {number(made.cycle, 3)} s, {number(plan.duration / 60.0, 3)} min"
    title = f"{plan.robot}: {f'{made.kind} ' * bool(made.kind)}trajectory, {times}"
    return Table(title, ("joint", "range", "highest speed", "highest acceleration"), rows, words=(0, 1, 2, 3))
