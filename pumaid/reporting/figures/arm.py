"""The arm: its skeleton, and the postures of a plan."""

from __future__ import annotations

from functools import partial
from itertools import groupby, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Polygon
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from pumaid.reporting.context import ReportContext
from pumaid.reporting.figures.style import BACKWARD, FAINT, FORWARD, GREY, INK, Drawing, heading, legend
from pumaid.reporting.formatting import in_unit, shortened
from pumaid.reporting.run_tables import PlannedPosture, planned_postures
from pumaid.robot import Box, Robot
from pumaid.trajectory import Plan

Floats = NDArray[np.float64]

#: View from the front right and a little above (rad).
AZIMUTH, ELEVATION = -0.96, 0.38

#: Panels side by side and in all; inch of a panel, and above and below all panels.
ACROSS, MOST_PANELS, PANEL, MARGIN = 8, 75, (2.3, 2.6), 0.5

#: Shares of the reach: length of a tip without tool, rim around the arm.
TIP, RIM = 0.09, 0.12


def skeleton_figure(context: ReportContext) -> Drawing:
    """The arm in the posture of the first run, or at zero."""
    runs = context.dataset.runs
    position = np.nan_to_num(runs[0].posture) if runs else np.zeros(context.robot.n_joints)
    caption = (
        "Circles: revolute joints, squares: prismatic joints, short lines: their axes, arrow: gravity. Drawn from the"
        " recipe in the posture of the first run; if this is not your arm, the recipe is wrong."
    )
    return Drawing("arm", f"{context.robot.name}: skeleton", caption, partial(skeleton, context.robot, position))


def frames(robot: Robot, position: Floats) -> tuple[Floats, Floats]:
    """Origins (J+1, 3) in m, the base first, and rotations (J+1, 3, 3) of all links at (J,) positions."""
    rotations, origins = robot.frames(np.asarray(position, dtype=float)[None])
    return np.vstack([np.zeros(3), origins[0]]), np.concatenate([np.eye(3)[None], rotations[0]])


def projected(points: Floats) -> Floats:
    """(N, 2) of (N, 3) points, as seen from far away with the third base axis up."""
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    across = -s * points[:, 0] + c * points[:, 1]
    depth = c * points[:, 0] + s * points[:, 1]
    return np.column_stack([across, points[:, 2] * np.cos(ELEVATION) - depth * np.sin(ELEVATION)])


def skeleton(robot: Robot, position: Floats) -> Figure:
    """The arm at (J,) positions."""
    origins, rotations = frames(robot, position)
    reach = max(float(np.ptp(origins, axis=0).max()), 0.1)
    flat = projected(origins)
    wide, high = np.ptp(flat, axis=0) + 0.5 * reach
    figure = Figure(figsize=(3.4, float(np.clip(3.4 * high / wide, 2.0, 3.8))), layout="constrained")
    axes = figure.subplots()
    _base(axes, 0.14 * reach, FAINT)
    axes.plot(flat[:, 0], flat[:, 1], color=INK, linewidth=4.5, alpha=0.85, solid_joinstyle="round", zorder=2)
    labels: list[tuple[Floats, list[str]]] = []
    for joint, origin, z in zip(robot.joints, origins[1:], rotations[1:, :, 2], strict=True):
        axis = projected(np.array([origin - 0.09 * reach * z, origin, origin + 0.13 * reach * z]))
        colour, marker = (FORWARD, "o") if joint.is_revolute else (BACKWARD, "s")
        axes.plot(axis[:, 0], axis[:, 1], color=colour, linewidth=1.8, zorder=3)
        axes.plot(*axis[1], marker, color=colour, markersize=8, markeredgecolor="none", zorder=4)
        near = [numbers for place, numbers in labels if np.linalg.norm(axis[1] - place) < 0.03 * reach]
        (near[0].append(str(joint.number)) if near else labels.append((axis[1], [str(joint.number)])))
    for place, numbers in labels:
        look: dict[str, Any] = {"fontsize": 10.5, "fontweight": "bold", "textcoords": "offset points"}
        axes.annotate(", ".join(numbers), (place[0], place[1]), (9, 5), zorder=5, **look)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.margins(0.12)
    axes.set_xlim(axes.get_xlim()[0], axes.get_xlim()[1] + 0.3 * reach)
    _gravity(axes, robot)
    return figure


def _base(axes: Axes, radius: float, colour: str) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    disc = projected(radius * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle]))
    axes.fill(disc[:, 0], disc[:, 1], color=colour, linewidth=0, zorder=0)


def _gravity(axes: Axes, robot: Robot) -> None:
    """An arrow along gravity in the upper right corner, if there is any."""
    if not np.any(robot.gravity):
        return
    along = 28 * projected(np.array([robot.gravity]) / np.linalg.norm(robot.gravity))[0]
    style: dict[str, Any] = {"arrowstyle": "<|-", "color": GREY, "linewidth": 1.3, "shrinkA": 0, "shrinkB": 0}
    look: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axes.annotate("", (0.94, 0.84), (along[0], along[1]), arrowprops=style, zorder=7, **look)
    axes.annotate("g", (0.94, 0.84), (0, 4), ha="center", fontsize=10, style="italic", **look)


# Postures of a plan


def posture_figure(plan: Plan, robot: Robot) -> Drawing:
    """The arm in every posture of a plan."""
    return Drawing("postures", f"{robot.name}: postures of the plan", "", partial(postures, plan, robot))


def postures(plan: Plan, robot: Robot) -> Figure:
    """One panel a posture, those of a row at one scale; a row, or more, a joint."""
    every_posture = planned_postures(plan)
    shown = every_posture[:MOST_PANELS]
    groups = [list(group) for _, group in groupby(shown, key=lambda posture: posture.joint)]
    rows = [group[k : k + ACROSS] for group in groups for k in range(0, len(group), ACROSS)]
    columns, count = max([3, *(len(row) for row in rows)]), max(len(rows), 1)
    figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * count + 2 * MARGIN), layout="constrained")
    panels = figure.subplots(count, columns, squeeze=False, sharex="row", sharey="row")
    for axes in panels.flat:
        axes.axis("off")
    middles = [_course(robot, _positions(posture, 3)[1], 0.0)[0] for posture in shown]
    reach = max([0.1, *(float(np.ptp(points, axis=0).max()) for points in middles)])
    for row, row_panels in zip(rows, panels, strict=False):
        for posture, axes in zip(row, row_panels, strict=False):
            _panel(axes, robot, posture, reach)
    rest = f", {len(every_posture) - len(shown)} more not drawn" if len(every_posture) > len(shown) else ""
    heading(figure, f"{robot.name}: {len(every_posture)} postures, {len(plan.motions)} runs{rest}")
    handles = [
        Patch(color=INK, label="held"),
        Patch(color=FORWARD, label="moves (thin: both ends)"),
        Patch(facecolor=FORWARD, alpha=0.2, label="swept by the tip"),
    ]
    if robot.safety and robot.safety.boxes:
        handles.append(Patch(facecolor=BACKWARD, alpha=0.2, label="forbidden box"))
    legend(figure, handles, 4)
    return figure


def _positions(posture: PlannedPosture, count: int) -> Floats:
    """(count, J) positions of the arm while the joint moves over its range."""
    positions = np.tile(np.array(posture.motions[0].hold, dtype=float), (count, 1))
    positions[:, posture.joint - 1] = np.linspace(*posture.span, count)
    return positions


def _course(robot: Robot, position: Floats, tip: float) -> tuple[Floats, list[int]]:
    """Points of the arm (N, 3), with a bend where a link's `a` ends and its `d` begins; index of each joint in it."""
    origins, rotations = frames(robot, position)
    points, places = [origins[0]], []
    for k, joint in enumerate(robot.joints, start=1):
        points += [origins[k - 1] + joint.a * rotations[k - 1][:, 0], origins[k]]
        places.append(len(points) - 1)
    tool = robot.safety.tool if robot.safety and robot.safety.tool is not None else (0.0, 0.0, tip)
    return np.array([*points, origins[-1] + rotations[-1] @ np.array(tool)]), places


def _panel(axes: Axes, robot: Robot, posture: PlannedPosture, reach: float) -> None:
    """The arm with the moving joint in the middle of its range, its ends, what its tip sweeps, and forbidden boxes."""
    positions = _positions(posture, 41)
    courses = [_course(robot, position, TIP * reach) for position in positions]
    points, places = courses[len(courses) // 2]
    space = np.concatenate([course[0] for course in courses])
    for box in robot.safety.boxes if robot.safety else ():
        _box(axes, box, space.min(axis=0) - RIM * reach, space.max(axis=0) + RIM * reach)
    look: dict[str, Any] = {"linewidth": 3.4, "solid_joinstyle": "round"}
    shadow = projected(points * (1.0, 1.0, 0.0))
    axes.plot(*shadow.T, color=FAINT, linewidth=2.6, solid_joinstyle="round", zorder=1)
    _base(axes, 0.09 * reach, GREY)
    swept, pivot = projected(np.array([course[0][-1] for course in courses])), places[posture.joint - 1]
    flat = projected(points)
    if robot.joint(posture.joint).is_revolute:
        axes.add_patch(Polygon(np.vstack([flat[pivot], swept]), facecolor=FORWARD, alpha=0.13, linewidth=0, zorder=3))
    axes.plot(*swept.T, color=FORWARD, linewidth=1.1, zorder=7)
    for end in (courses[0][0], courses[-1][0]):
        axes.plot(*projected(end[pivot:]).T, color=FORWARD, linewidth=1.5, alpha=0.4, zorder=4)
    axes.plot(*flat[: pivot + 1].T, color=INK, zorder=5, **look)
    axes.plot(*flat[pivot:].T, color=FORWARD, zorder=6, **look)
    axes.plot(*flat[pivot], "o", color="white", markeredgecolor=FORWARD, markersize=6.5, zorder=8)
    _spheres(axes, robot, positions[len(positions) // 2], posture.joint)
    axes.set_aspect("equal")
    _gravity(axes, robot)
    _title(axes, robot, posture)


def _title(axes: Axes, robot: Robot, posture: PlannedPosture) -> None:
    scale, unit = in_unit(robot.joint(posture.joint).position_unit, "deg")
    low, high = (f"{round(value * scale, 3) + 0.0:.4g}" for value in posture.span)
    heldout = len(posture.motions) - posture.fitted
    counts = [f"{posture.fitted} fit"] * (posture.fitted > 0) + [f"{heldout} hold-out"] * (heldout > 0)
    serves = f"\nfor {', '.join(posture.serves)}" if posture.serves else ""
    name = f"{posture.joint}{posture.letter} {robot.joint(posture.joint).name}"
    title = f"{shortened(name, 34)}\n{low} to {high} {unit}, {', '.join(counts)}{shortened(serves, 38)}"
    axes.set_title(title, fontsize=7.5, fontweight="normal")


def _spheres(axes: Axes, robot: Robot, position: Floats, joint: int) -> None:
    origins, rotations = frames(robot, position)
    for sphere in robot.safety.spheres if robot.safety else ():
        centre = projected((origins[sphere.link] + rotations[sphere.link] @ np.array(sphere.centre))[None])[0]
        colour = FORWARD if sphere.link >= joint else INK
        axes.add_patch(Circle(centre, sphere.radius, facecolor=colour, alpha=0.12, linewidth=0, zorder=4))


def _box(axes: Axes, box: Box, lowest: Floats, highest: Floats) -> None:
    """The outline of the part of a box that lies between two corners (3,) of the space drawn."""
    low, high = np.maximum(box.low, lowest), np.minimum(box.high, highest)
    if (low < high).all():
        corners = projected(np.array(list(product(*zip(low, high, strict=True)))))
        outline = corners[ConvexHull(corners).vertices]
        axes.add_patch(Polygon(outline, facecolor=BACKWARD, edgecolor=BACKWARD, alpha=0.14, linewidth=0.6, zorder=0))
