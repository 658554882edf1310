"""The weight that joints carry by their vendors' published masses: an estimate that owes nothing to any current."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
#: A joint and its link: transforms (4, 4) before and after the joint turns about z; kg and m in the frame behind both.
Link = tuple[Floats, Floats, float, tuple[float, float, float]]

#: m/s2, as in the recipes.
G = 9.80665


def _turn(axis: int, angle: float) -> Floats:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(4)
    out[first, first] = out[second, second] = math.cos(angle)
    out[second, first], out[first, second] = math.sin(angle), -math.sin(angle)
    return out


def _shift(x: float, y: float, z: float) -> Floats:
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def _standard(a: float, d: float, alpha: float, *, mass: float, centre: tuple[float, float, float]) -> Link:
    """A link in the vendor's standard Denavit-Hartenberg convention; its frame lies at the far end."""
    return np.eye(4), _shift(a, 0.0, d) @ _turn(0, alpha), mass, centre


def _urdf(xyz: tuple[float, float, float], roll: float, *, mass: float, centre: tuple[float, float, float]) -> Link:
    """A link in the URDF's convention; its frame lies at the joint."""
    return _shift(*xyz) @ _turn(0, roll), np.eye(4), mass, centre


#: Universal Robots, "DH Parameters for calculations of kinematics and dynamics" (support article), UR3e; the same
#: masses in UniversalRobots/Universal_Robots_ROS2_Description, config/ur3e/physical_parameters.yaml.
UR3E = (
    _standard(0.0, 0.15185, math.pi / 2, mass=1.98, centre=(0.0, -0.02, 0.0)),
    _standard(-0.24355, 0.0, 0.0, mass=3.4445, centre=(0.13, 0.0, 0.1157)),
    _standard(-0.2132, 0.0, 0.0, mass=1.437, centre=(0.05, 0.0, 0.0238)),
    _standard(0.0, 0.13105, math.pi / 2, mass=0.871, centre=(0.0, 0.0, 0.01)),
    _standard(0.0, 0.08535, -math.pi / 2, mass=0.805, centre=(0.0, 0.0, 0.01)),
    _standard(0.0, 0.0921, 0.0, mass=0.261, centre=(0.0, 0.0, -0.02)),
)

_HALF = math.pi / 2
#: Kinova, ros2_kortex, kortex_description/arms/gen3/7dof/urdf/gen3_macro.xacro: the arm with its camera.
GEN3 = (
    _urdf((0.0, 0.0, 0.15643), math.pi, mass=1.3773, centre=(-2.3e-05, -0.010364, -0.07336)),
    _urdf((0.0, 0.005375, -0.12838), _HALF, mass=1.1636, centre=(-4.4e-05, -0.09958, -0.013278)),
    _urdf((0.0, -0.21038, -0.006375), -_HALF, mass=1.1636, centre=(-4.4e-05, -0.006641, -0.117892)),
    _urdf((0.0, 0.006375, -0.21038), _HALF, mass=0.9302, centre=(-1.8e-05, -0.075478, -0.015006)),
    _urdf((0.0, -0.20843, -0.006375), -_HALF, mass=0.6781, centre=(1e-06, -0.009432, -0.063883)),
    _urdf((0.0, 0.00017505, -0.10593), _HALF, mass=0.6781, centre=(1e-06, -0.045483, -0.00965)),
    _urdf((0.0, -0.10593, -0.00017505), -_HALF, mass=0.5, centre=(0.000281, 0.011402, -0.029798)),
)


def loads(links: Sequence[Link], position: Sequence[float] | Floats) -> Floats:
    """(J,) N m that every joint must give to hold the arm at `position` (rad), the base upright."""
    frame, axes, origins, centres = np.eye(4), [], [], []
    for (before, after, _, centre), angle in zip(links, position, strict=True):
        frame = frame @ before
        axes.append(frame[:3, 2])
        origins.append(frame[:3, 3])
        frame = frame @ _turn(2, angle) @ after
        centres.append((frame @ np.append(centre, 1.0))[:3])
    weights = [mass * G for _, _, mass, _ in links]
    return np.array(
        [
            sum(weights[j] * np.cross(axes[i], centres[j] - origins[i])[2] for j in range(i, len(links)))
            for i in range(len(links))
        ]
    )


def first_harmonic(links: Sequence[Link], position: Sequence[float], joint: int) -> tuple[float, float]:
    """N m on `joint` (from 1) at its positions 0 and a quarter turn, the other joints held at `position`.

    The load at any other position q of the joint is their sum weighted with cos q and sin q.
    """
    held = np.array(position, dtype=float)
    out = []
    for angle in (0.0, math.pi / 2):
        held[joint - 1] = angle
        out.append(float(loads(links, held)[joint - 1]))
    return out[0], out[1]
