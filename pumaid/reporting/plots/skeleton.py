"""The arm's skeleton: joints, axes and gravity, drawn from the recipe's geometry."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pumaid.kinematics import frames as chain
from pumaid.reporting.plots.style import BACKWARD, FAINT, FORWARD, GREY, INK, Drawing
from pumaid.reporting.story import Story
from pumaid.robot import Robot

Floats = NDArray[np.float64]

#: Where it stands among the figures of a report.
ORDER = 0

#: Looking at the arm from the front right and a little above (rad).
AZIMUTH, ELEVATION = -0.96, 0.38


def drawings(story: Story) -> Iterator[Drawing]:
    """The arm in the first posture of the logs, or at zero."""
    position = _pose(story)
    yield Drawing(
        "arm",
        f"{story.robot.name}: skeleton",
        "Circles turn, squares slide; short lines are the joints' axes, the arrow is gravity. Drawn as the recipe says,"
        " in the posture of the first run: if this is not your arm, the recipe is wrong.",
        lambda: draw(story.robot, position),
    )


def _pose(story: Story) -> Floats:
    runs = story.dataset.runs
    return np.nan_to_num(runs[0].posture) if runs else np.zeros(story.robot.n_joints)


def frames(robot: Robot, position: Floats) -> tuple[Floats, Floats]:
    """Origins (J+1, 3) in m, the base first, and rotations (J+1, 3, 3) of all links at (J,) positions."""
    posture = np.asarray(position, dtype=float)[None]
    shifts = robot.dh_displacements(posture)
    turned, placed = chain(robot.alphas, robot.lengths, offsets=shifts, thetas=robot.dh_angles(posture))
    return np.vstack([np.zeros(3), placed[0]]), np.concatenate([np.eye(3)[None], turned[0]])


def draw(robot: Robot, position: Floats) -> Figure:
    """The figure, seen with the third base axis up."""
    origins, rotations = frames(robot, position)
    reach = max(float(np.ptp(origins, axis=0).max()), 0.1)
    flat = seen(origins)
    wide, high = np.ptp(flat, axis=0) + 0.5 * reach
    figure = Figure(figsize=(3.4, float(np.clip(3.4 * high / wide, 2.0, 3.8))), layout="constrained")
    axes = figure.subplots()
    _base(axes, reach)
    axes.plot(flat[:, 0], flat[:, 1], color=INK, linewidth=4.5, alpha=0.85, solid_joinstyle="round", zorder=2)
    placed: list[tuple[Floats, list[int]]] = []
    for joint, origin, z in zip(robot.joints, origins[1:], rotations[1:, :, 2], strict=True):
        tip = seen(np.array([origin - 0.09 * reach * z, origin + 0.13 * reach * z]))
        colour = FORWARD if joint.is_revolute else BACKWARD
        axes.plot(tip[:, 0], tip[:, 1], color=colour, linewidth=1.8, zorder=3)
        here = seen(origin[None])[0]
        axes.plot(
            *here, "o" if joint.is_revolute else "s", color=colour, markersize=8, markeredgecolor="none", zorder=4
        )
        near = next((numbers for other, numbers in placed if np.linalg.norm(here - other) < 0.03 * reach), None)
        if near is None:
            placed.append((here, [joint.number]))
        else:
            near.append(joint.number)
    _numbers(axes, placed)
    _gravity(axes, robot, flat, reach)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.margins(0.12)
    return figure


def seen(points: Floats) -> Floats:
    """(N, 2) of (N, 3) points, as seen from far away."""
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    across = -s * points[:, 0] + c * points[:, 1]
    depth = c * points[:, 0] + s * points[:, 1]
    return np.column_stack([across, points[:, 2] * np.cos(ELEVATION) - depth * np.sin(ELEVATION)])


def _base(axes: Axes, reach: float) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = 0.14 * reach * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    disc = seen(ring)
    axes.fill(disc[:, 0], disc[:, 1], color=FAINT, linewidth=0, zorder=0)


def _numbers(axes: Axes, placed: list[tuple[Floats, list[int]]]) -> None:
    """Numbers of joints; those that share a place stand in one label."""
    for here, numbers in placed:
        text = ", ".join(map(str, numbers))
        place = (here[0], here[1])
        axes.annotate(text, place, (9, 5), textcoords="offset points", fontsize=10.5, fontweight="bold", zorder=5)


def _gravity(axes: Axes, robot: Robot, flat: Floats, reach: float) -> None:
    pull = np.asarray(robot.gravity, dtype=float)
    size = float(np.linalg.norm(pull))
    if size == 0.0:
        return
    along = seen(0.3 * reach * (pull / size)[None])[0]
    start = np.array([flat[:, 0].max() + 0.36 * reach, flat[:, 1].max()])
    axes.annotate(
        "",
        _pair(start + along),
        _pair(start),
        arrowprops={"arrowstyle": "-|>", "color": GREY, "linewidth": 1.6, "shrinkA": 0},
    )
    axes.annotate("g", _pair(start), (0, 4), textcoords="offset points", ha="center", fontsize=10.5, style="italic")
    axes.update_datalim([start, start + along])


def _pair(point: Floats) -> tuple[float, float]:
    return float(point[0]), float(point[1])
