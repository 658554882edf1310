"""The arm in every posture of a plan: what stands, what moves and how far, and what it must not touch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from numpy.typing import NDArray

from pumaid.kinematics import frames as chain
from pumaid.reporting.held import Held, held
from pumaid.reporting.plots.skeleton import frames, seen
from pumaid.reporting.plots.style import FAINT, FORWARD, GREY, INK, VERMILION, saved, styled
from pumaid.robot import Box, Robot
from pumaid.trajectory import Plan
from pumaid.units import factor

Floats = NDArray[np.float64]

#: Panels side by side, and at most in all.
ACROSS, MOST_PANELS = 8, 75
#: inch a panel is wide and high.
_WIDE, _HIGH = 2.3, 2.6
#: inch above all panels, below them, and of a panel for its title.
_TOP, _BOTTOM, _TITLES = 0.4, 0.4, 0.52
#: Share of the reach: a hand without a tool, the smallest fan that can be read, the rim around the arm.
_HAND, _LEAST_FAN, _RIM = 0.09, 0.17, 0.12
#: Positions between the ends of a fan.
_STEPS = 41
#: Letters of parameters' names that have room below a panel's title.
_ROOM = 36


def drawn(plan: Plan, robot: Robot, form: str) -> bytes:
    """The picture as ``png``, ``svg`` or ``pdf``."""
    with styled():
        return saved(draw(plan, robot), form, f"{robot.name}: postures of the plan")


@dataclass(frozen=True, eq=False, slots=True)
class _Scene:
    """What the panels of a joint share: m on paper, so that its postures compare."""

    robot: Robot
    reach: float
    low: Floats  # (3,) corners of the space that the arm takes, in which boxes are drawn
    high: Floats
    window: Floats  # (2, 2) corners of every panel


def draw(plan: Plan, robot: Robot) -> Figure:
    """One small picture a posture, all from one side and those of a joint at one scale; a row, or more, a joint.

    Parameters
    ----------
    plan, robot
        The plan and the arm that it is for, with the boxes and spheres of its recipe.
    """
    postures = held(plan)
    shown = postures[:MOST_PANELS]
    rows = [part for _, group in groupby(shown, key=lambda one: one.joint) for part in _parts(list(group))]
    across = max((len(row) for row in rows), default=1)
    high = _HIGH * max(len(rows), 1) + _TOP + _BOTTOM
    figure = Figure(figsize=(_WIDE * max(across, 3), high))
    drawn_high = _HIGH - _TITLES
    place = {"left": 0.01, "right": 0.99, "top": 1.0 - (_TOP + _TITLES) / high, "bottom": _BOTTOM / high}
    spaced = {"hspace": _TITLES / drawn_high, "wspace": 0.06}
    panels = figure.subplots(max(len(rows), 1), max(across, 3), squeeze=False, gridspec_kw=place | spaced)
    scenes = {joint: _scene(robot, list(group)) for joint, group in groupby(shown, key=lambda one: one.joint)}
    for axes in panels.flat:
        axes.axis("off")
    for row, group in zip(panels, rows, strict=False):
        for axes, one in zip(row, group, strict=False):
            _panel(axes, scenes[one.joint], one)
    left_out = f", {len(postures) - len(shown)} more not drawn" if len(postures) > len(shown) else ""
    title = f"{robot.name}: {len(postures)} postures, {len(plan.motions)} runs{left_out}"
    figure.text(0.01, 1.0 - 0.12 / high, title, va="top", fontsize=12, fontweight="bold")
    figure.legend(handles=_handles(robot), loc="lower left", ncols=5, fontsize=8.5, handlelength=1.6)
    return figure


def _parts(group: list[Held]) -> list[list[Held]]:
    """Rows of nearly equal length."""
    count = math.ceil(len(group) / ACROSS)
    size = math.ceil(len(group) / count)
    return [group[k : k + size] for k in range(0, len(group), size)]


def _position(one: Held, value: float) -> Floats:
    position = np.array(one.motions[0].hold, dtype=float)
    position[one.joint - 1] = value
    return position


def _course(robot: Robot, position: Floats, *, hand: float) -> tuple[Floats, list[int]]:
    """Points of the arm (N, 3), bent where a link's `a` ends and its `d` begins, and the place of each joint in it."""
    origins, turned = frames(robot, position)
    points, places = [origins[0]], []
    for k, joint in enumerate(robot.joints, start=1):
        points += [origins[k - 1] + joint.a * turned[k - 1][:, 0], origins[k]]
        places.append(len(points) - 1)
    points.append(origins[-1] + turned[-1] @ _tool(robot, hand))
    return np.array(points), places


def _tool(robot: Robot, hand: float) -> Floats:
    """(3,) m: where the tip is in the last link's frame; `hand` beyond it where the recipe has no tool."""
    tool = robot.safety.tool if robot.safety else None
    return np.array(tool if tool is not None else (0.0, 0.0, hand))


def _tips(robot: Robot, position: Floats, *, hand: float) -> Floats:
    """(N, 3) where the tip is at (N, J) positions."""
    shifts, angles = robot.dh_displacements(position), robot.dh_angles(position)
    turned, placed = chain(robot.alphas, robot.lengths, offsets=shifts, thetas=angles)
    return np.asarray(placed[:, -1] + turned[:, -1] @ _tool(robot, hand))


def _scene(robot: Robot, postures: list[Held]) -> _Scene:
    reach = max(
        float(np.ptp(_course(robot, _position(one, sum(one.span) / 2), hand=0.0)[0], axis=0).max()) for one in postures
    )
    reach = max(reach, 0.1)
    ends = [_course(robot, _position(one, value), hand=_HAND * reach)[0] for one in postures for value in _ways(one)]
    swept = [_swept(robot, one, reach)[0] for one in postures]
    balls = [ball for one in postures for ball in _balls(robot, _position(one, sum(one.span) / 2))]
    points = np.concatenate([*ends, *swept, *balls])
    flat, rim = np.concatenate([seen(points), seen(points * (1, 1, 0))]), _RIM * reach
    middle, size = 0.5 * (flat.min(axis=0) + flat.max(axis=0)), np.ptp(flat, axis=0) + 2.0 * rim
    shape = np.array([_WIDE * 0.94, _HIGH - _TITLES])  # of a panel: a window of another would leave part of it empty
    half = 0.5 * shape * np.max(size / shape)
    window = np.array([middle - half, middle + half])
    return _Scene(robot, reach, points.min(axis=0) - rim, points.max(axis=0) + rim, window)


def _ways(one: Held) -> Floats:
    return np.linspace(*one.span, 9)


def _panel(axes: Axes, scene: _Scene, one: Held) -> None:
    robot, (low, high) = scene.robot, one.span
    joint = robot.joint(one.joint)
    middle = _position(one, 0.5 * (low + high))
    hand = _HAND * scene.reach
    points, places = _course(robot, middle, hand=hand)
    for box in robot.safety.boxes if robot.safety else ():
        _box(axes, scene, box)
    _ground(axes, scene, points)
    _fan(axes, scene, one)
    split = places[one.joint - 1]
    for value in (low, high):
        ghost, _ = _course(robot, _position(one, value), hand=hand)
        flat = seen(ghost[split:])
        axes.plot(flat[:, 0], flat[:, 1], color=FORWARD, linewidth=1.5, alpha=0.4, solid_joinstyle="round", zorder=4)
    flat = seen(points)
    axes.plot(flat[: split + 1, 0], flat[: split + 1, 1], color=INK, linewidth=3.4, solid_joinstyle="round", zorder=5)
    axes.plot(flat[split:, 0], flat[split:, 1], color=FORWARD, linewidth=3.4, solid_joinstyle="round", zorder=6)
    _spheres(axes, scene, middle, one.joint)
    mark = "o" if joint.is_revolute else "s"
    axes.plot(*flat[split], mark, color="white", markeredgecolor=FORWARD, markeredgewidth=1.6, markersize=6.5, zorder=8)
    axes.set_xlim(*scene.window[:, 0])
    axes.set_ylim(*scene.window[:, 1])
    axes.set_aspect("equal")
    _gravity(axes, robot)
    _title(axes, robot, one)


def _title(axes: Axes, robot: Robot, one: Held) -> None:
    joint = robot.joint(one.joint)
    scale, unit = (factor("deg"), "deg") if joint.is_revolute else (1.0, "m")
    low, high = (f"{round(value / scale, 1 if joint.is_revolute else 3) + 0.0:g}" for value in one.span)
    judged = len(one.motions) - one.fitted
    fitted = f"{one.fitted} to fit" if one.fitted else ""
    told = ", ".join(text for text in (fitted, f"{judged} to judge" if judged else "") if text)
    lines = (
        (f"{one.name} {joint.name}", 9, "bold", INK),
        (f"{low} to {high} {unit}, {told}", 7.5, "normal", INK if one.fitted else VERMILION),
        (_served(one.serves), 6.5, "normal", GREY),
    )
    for place, (text, size, weight, colour) in zip((21, 11, 2), lines, strict=True):
        look: dict[str, Any] = {"fontsize": size, "fontweight": weight, "color": colour}
        axes.annotate(text, (0, 1), (0, place), xycoords="axes fraction", textcoords="offset points", **look)


def _served(names: tuple[str, ...]) -> str:
    """As many names as have room."""
    known = 0
    while known < len(names) and len(", ".join(names[: known + 1])) <= _ROOM:
        known += 1
    return f"shows {', '.join(names[:known])}{', ...' if known < len(names) else ''}" if names else ""


def _ground(axes: Axes, scene: _Scene, points: Floats) -> None:
    """The base, and the arm's shadow on the plane on which it stands: depth for the eye."""
    flat = seen(points * (1.0, 1.0, 0.0))
    axes.plot(flat[:, 0], flat[:, 1], color=FAINT, linewidth=2.6, solid_joinstyle="round", zorder=1)
    angle = np.linspace(0.0, 2.0 * np.pi, 40)
    disc = seen(0.09 * scene.reach * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]))
    axes.fill(disc[:, 0], disc[:, 1], color=GREY, linewidth=0, zorder=2)


def _swept(robot: Robot, one: Held, reach: float) -> tuple[Floats, Floats]:
    """(N, 3) course of the tip and (3,) the middle of its turn; a wider one about the axis where it hardly moves."""
    j = one.joint
    values = np.linspace(*one.span, _STEPS)
    tips = _tips(robot, np.array([_position(one, value) for value in values]), hand=_HAND * reach)
    origins, turned = frames(robot, _position(one, one.span[0]))
    axis = turned[j][:, 2]
    centre = origins[j] + axis * float((tips[0] - origins[j]) @ axis)
    radius, least = float(np.linalg.norm(tips[0] - centre)), _LEAST_FAN * reach
    if not robot.joint(j).is_revolute or radius >= least:
        return tips, centre
    if radius > 0.1 * least:
        return centre + (tips - centre) * least / radius, centre
    turn = (values - values[0])[:, None]
    tips = centre + least * (np.cos(turn) * turned[j][:, 0] + np.sin(turn) * turned[j][:, 1])
    return tips, centre


def _fan(axes: Axes, scene: _Scene, one: Held) -> None:
    """What the tip sweeps; for a joint that slides an arrow beside the arm."""
    tips, centre = _swept(scene.robot, one, scene.reach)
    flat = seen(tips)
    if scene.robot.joint(one.joint).is_revolute:
        fan = seen(np.vstack([centre, tips]))
        axes.add_patch(Polygon(fan, facecolor=FORWARD, alpha=0.13, linewidth=0, zorder=3))
    else:
        aside = np.array([[0.0, -1.0], [1.0, 0.0]]) @ (flat[-1] - flat[0])
        flat = flat + 0.1 * scene.reach * aside / max(float(np.linalg.norm(aside)), 1e-9)
    _arc(axes, flat)


def _arc(axes: Axes, flat: Floats) -> None:
    axes.plot(flat[:, 0], flat[:, 1], color=FORWARD, linewidth=1.1, zorder=7)
    for tip, before in ((flat[-1], flat[-3]), (flat[0], flat[2])):
        arrow = {
            "arrowstyle": "-|>",
            "color": FORWARD,
            "linewidth": 1.1,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 8,
        }
        axes.annotate("", (tip[0], tip[1]), (before[0], before[1]), arrowprops=arrow, zorder=7)


def _balls(robot: Robot, position: Floats) -> list[Floats]:
    """(6, 3) outermost points of each sphere along the base's axes."""
    origins, turned = frames(robot, position)
    ways = np.vstack([np.eye(3), -np.eye(3)])
    spheres = robot.safety.spheres if robot.safety else ()
    return [origins[one.link] + turned[one.link] @ np.array(one.centre) + one.radius * ways for one in spheres]


def _spheres(axes: Axes, scene: _Scene, position: Floats, joint: int) -> None:
    spheres = scene.robot.safety.spheres if scene.robot.safety else ()
    for one, ball in zip(spheres, _balls(scene.robot, position), strict=True):
        x, y = seen(ball.mean(axis=0)[None])[0]
        colour = FORWARD if one.link >= joint else INK
        axes.add_patch(Circle((x, y), one.radius, facecolor=colour, alpha=0.10, linewidth=0, zorder=4))
        axes.add_patch(Circle((x, y), one.radius, fill=False, edgecolor=colour, alpha=0.55, linewidth=0.7, zorder=4))


def _box(axes: Axes, scene: _Scene, box: Box) -> None:
    """The part of a box that lies in the space drawn."""
    low, high = np.maximum(box.low, scene.low), np.minimum(box.high, scene.high)
    if (low >= high).any():
        return
    for axis, side in product(range(3), (0, 1)):
        others = [k for k in range(3) if k != axis]
        corners = np.empty((4, 3))
        corners[:, axis] = (low, high)[side][axis]
        corners[:, others[0]] = [low[others[0]], high[others[0]], high[others[0]], low[others[0]]]
        corners[:, others[1]] = [low[others[1]], low[others[1]], high[others[1]], high[others[1]]]
        flat = seen(corners)
        axes.add_patch(Polygon(flat, facecolor=VERMILION, alpha=0.05, linewidth=0, zorder=0))
        axes.add_patch(Polygon(flat, fill=False, edgecolor=VERMILION, alpha=0.35, linewidth=0.6, zorder=0))


def _gravity(axes: Axes, robot: Robot) -> None:
    pull = np.asarray(robot.gravity, dtype=float)
    size = float(np.linalg.norm(pull))
    if size == 0.0:
        return
    along = seen((pull / size)[None])[0]
    start = np.array([0.95, 0.9])
    end = start + 0.13 * along / max(float(np.linalg.norm(along)), 1e-9)
    arrow = {"arrowstyle": "-|>", "color": GREY, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(end), tuple(start), xycoords="axes fraction", arrowprops=arrow)
    axes.text(start[0], start[1] + 0.02, "g", transform=axes.transAxes, ha="center", fontsize=7.5, style="italic")


def _handles(robot: Robot) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=INK, linewidth=3.4, label="held"),
        Line2D([], [], color=FORWARD, linewidth=3.4, label="moves (middle; thin: both ends)"),
        Patch(facecolor=FORWARD, alpha=0.2, label="what the tip sweeps"),
        Line2D([], [], color=FAINT, linewidth=2.6, label="shadow on the base's plane"),
    ]
    if robot.safety and robot.safety.boxes:
        handles.append(Patch(facecolor=VERMILION, alpha=0.2, label="forbidden box"))
    return handles
