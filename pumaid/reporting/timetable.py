"""When each run of a plan is made: a picture of every joint's speed against time, and a table of the blocks."""

from __future__ import annotations

from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from rich import box
from rich.table import Table
from rich.text import Text

from pumaid.reporting.held import held, key
from pumaid.reporting.plots.style import FAINT, FORWARD, GREY, INK, VERMILION, saved, styled
from pumaid.robot import Robot
from pumaid.trajectory import Motion, Plan
from pumaid.units import factor

Floats = NDArray[np.float64]

#: Tints of the strips below the speeds, in turn; letters tell the postures.
_TINTS = ("#e3e6ea", "#f3f4f6")
#: Share of the picture's width that a letter needs.
_LETTER = 0.008
#: Lower end of the strips, in highest speeds.
_FOOT = 2.1
#: inch of a strip a joint, and in all besides.
_ROW, _REST = 0.95, 1.15


def drawn(plan: Plan, robot: Robot, form: str, *, times: Floats) -> bytes:
    """The picture as ``png``, ``svg`` or ``pdf``; arguments as for `draw`."""
    with styled():
        return saved(draw(plan, robot, times=times), form, f"{robot.name}: timetable of the plan")


def draw(plan: Plan, robot: Robot, *, times: Floats) -> Figure:
    """A strip a joint: speed against time, forward up and backward down, and the posture's letter below.

    Heights are the roots of speeds, so that slow runs are seen beside fast ones.

    Parameters
    ----------
    plan, robot
        The plan and the arm that it is for.
    times
        (M, 2) s at which each run begins and ends.
    """
    figure = Figure(figsize=(12.0, _ROW * robot.n_joints + _REST), layout="constrained")
    strips = figure.subplots(robot.n_joints, 1, squeeze=False, sharex=True)[:, 0]
    minutes = np.asarray(times, dtype=float).reshape(-1, 2) / 60.0
    letters = _letters(plan)
    last = float(minutes.max()) if len(minutes) else 1.0
    for axes, joint in zip(strips, robot.joints, strict=True):
        chosen = [k for k, motion in enumerate(plan.motions) if motion.joint == joint.number]
        scale, unit = (factor("deg"), "deg/s") if joint.is_revolute else (1.0, "m/s")
        fastest = max((plan.motions[k].velocity / scale for k in chosen), default=1.0)
        top = 1.12 * fastest
        _speeds(axes, [plan.motions[k] for k in chosen], minutes[chosen], scale)
        _blocks(axes, [(k, letters[k]) for k in chosen], minutes, top=top)
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.set_yscale("function", functions=(_root, _square))
        axes.set(ylim=(-_FOOT * top, top), xlim=(0.0, 1.002 * last))
        label = f"{joint.number} {joint.name[:16]}\n({unit})"
        axes.set_ylabel(label, fontsize=8.5, rotation=0, ha="right", va="center")
        axes.set_yticks([-fastest, 0.0, fastest], [f"{-fastest:.3g}", "0", f"{fastest:.3g}"])
        axes.tick_params(axis="y", labelsize=8)
    strips[-1].set_xlabel("time (min)")
    figure.suptitle(_title(plan, robot, last), x=0.01, ha="left", fontsize=11, fontweight="bold")
    handles: list[Patch | Line2D] = [
        Patch(color=FORWARD, label="to fit"),
        Patch(color=VERMILION, label="held out, to judge"),
    ]
    handles.append(Patch(facecolor=_TINTS[0], edgecolor=GREY, linewidth=0.5, label="posture of the others (letter)"))
    handles.append(Line2D([], [], linestyle="", label="height: square root of speed; up is forward"))
    figure.legend(handles=handles, loc="outside lower left", ncols=4)
    return figure


def _root(speed: Floats) -> Floats:
    """Signed square root: runs at a thirtieth of the highest speed stay visible."""
    return np.sign(speed) * np.sqrt(np.abs(speed))


def _square(height: Floats) -> Floats:
    return np.sign(height) * np.square(height)


def _letters(plan: Plan) -> list[str]:
    """The letter of each run's posture."""
    known = {key(one.motions[0]): one.label for one in held(plan)}
    return [known[key(motion)] for motion in plan.motions]


def _title(plan: Plan, robot: Robot, minutes: float) -> str:
    different = len({(motion.joint, key(motion), motion.start, motion.end, motion.velocity) for motion in plan.motions})
    return (
        f"{robot.name}: {len(plan.motions)} runs in {minutes:.0f} min, {different} of them different, the rest repeats"
    )


def _speeds(axes: Axes, motions: list[Motion], minutes: Floats, scale: float) -> None:
    """A bar a run, as high as its speed: forward up, backward down."""
    for purpose, colour in (("fit", FORWARD), ("heldout", VERMILION)):
        bars = []
        for motion, (begin, end) in zip(motions, minutes.tolist(), strict=True):
            if (motion.purpose == "heldout") == (purpose == "heldout"):
                speed = motion.velocity / scale * (1.0 if motion.end >= motion.start else -1.0)
                bars.append([(begin, 0.0), (begin, speed), (end, speed), (end, 0.0)])
        axes.add_collection(PolyCollection(bars, facecolor=colour, edgecolor=colour, linewidth=0.5))


def _blocks(axes: Axes, runs: list[tuple[int, str]], minutes: Floats, *, top: float) -> None:
    """Strips with letters below the speeds, one for runs in one posture that no other joint's run comes between."""
    low, high = -_FOOT * top, -1.25 * top
    known = sorted({name for _, name in runs}, key=lambda name: (len(name), name))
    room, before = _LETTER * float(minutes.max(initial=0.0)), -np.inf
    # Numbers of runs that follow one another differ from their places in the list by the same.
    for (name, _), group in groupby(enumerate(runs), key=lambda one: (one[1][1], one[1][0] - one[0])):
        numbers = [run for _, (run, _) in group]
        begin, end = float(minutes[numbers[0], 0]), float(minutes[numbers[-1], 1])
        tint = _TINTS[known.index(name) % 2]
        axes.fill_between([begin, end], low, high, facecolor=tint, edgecolor=FAINT, linewidth=0.5)
        middle = 0.5 * (begin + end)
        if middle - before > room:
            heart = float(_square(0.5 * (_root(np.array(low)) + _root(np.array(high)))))
            axes.text(middle, heart, name, ha="center", va="center", fontsize=7)
            before = middle


def timetable_table(plan: Plan, robot: Robot, *, times: Floats) -> Table:
    """A row for each stretch of runs of one joint in one posture, in the order in which they are made.

    Parameters
    ----------
    plan, robot, times
        As for `draw`.
    """
    table = Table(title="timetable", title_justify="left", box=box.SIMPLE_HEAD)
    for name in ("from", "to", "posture", "joint", "runs", "speeds", "purpose"):
        table.add_column(name, justify="left" if name in ("posture", "joint", "speeds", "purpose") else "right")
    letters = _letters(plan)
    rows = zip(plan.motions, letters, np.asarray(times, dtype=float).reshape(-1, 2).tolist(), strict=True)
    for _, group in groupby(rows, key=lambda row: (row[0].joint, row[1])):
        part = list(group)
        joint = robot.joint(part[0][0].joint)
        scale, unit = (factor("deg"), "deg/s") if joint.is_revolute else (1.0, "m/s")
        speeds = dict.fromkeys(f"{motion.velocity / scale:.3g}" for motion, *_ in part)
        judged = sum(motion.purpose == "heldout" for motion, *_ in part)
        purpose = "fit" if not judged else "judge" if judged == len(part) else f"fit, {judged} to judge"
        table.add_row(
            _clock(part[0][2][0]),
            _clock(part[-1][2][1]),
            f"{joint.number}{part[0][1]}",
            Text(joint.name),
            str(len(part)),
            f"{', '.join(speeds)} {unit}",
            purpose,
        )
    return table


def _clock(seconds: float) -> str:
    """``1:05`` for 65 s."""
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
