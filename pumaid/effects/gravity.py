"""Gravity load of the links."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from pumaid.effects import NO_SHAPE, Effect, Family, Parameter, Samples, Scope
from pumaid.maths import Floats
from pumaid.robot import Robot

#: Columns below this share of g are rounding of rotations by right angles, not levers.
ROUNDING = 1e-13


class Gravity(Effect):
    """The load of links i..n on joint i, in regrouped constants that absorb every length and mass.

    A revolute joint i feels (z_i x g) . x_j and (z_i x g) . y_j of every revolute link j >= i, and
    d_j (z_i x g) . z_j of every prismatic link j > i; a prismatic joint feels only its own -(g . z_i).
    g is gravity in base axes (m/s2), d_j the full displacement (m).
    """

    equation = "sum over links j: k_jx (z_i x g) . x_j + k_jy (z_i x g) . y_j"
    source = "S.-K. Lin, Identification of a Class of Nonlinear Deterministic Systems, eq. (9)-(25)"
    scope = Scope.LINK
    family = Family.GRAVITY
    base = True

    def parameters(self, robot: Robot, number: int) -> tuple[Parameter, ...]:
        if not robot.joint(number).is_revolute:
            return (Parameter("mass", "A s2/m", "mass of this link and all outward, as current", "m{n}", 0.05),)
        return (
            Parameter("x", "A s2/m", "first moment along the link's x axis, as current", "k{n}x", 0.05),
            Parameter("y", "A s2/m", "first moment along the link's y axis, as current", "k{n}y", -0.02),
        )

    def columns(
        self, robot: Robot, samples: Samples, *, number: int | None = None, shape: Mapping[str, float] = NO_SHAPE
    ) -> Floats:
        link, moving = number or samples.joint, samples.joint
        rotations, g = _rotations(robot, samples), np.asarray(robot.gravity)
        z_i, frame_j = rotations[:, moving - 1, :, 2], rotations[:, link - 1]
        slides = not robot.joint(moving).is_revolute
        if slides and link == moving:
            out = -(z_i @ g)[:, None]
        elif slides:
            out = np.zeros((len(samples), len(self.parameters(robot, link))))
        elif robot.joint(link).is_revolute:
            out = np.einsum("mk,mkp->mp", np.cross(z_i, g), frame_j[:, :, :2])
        else:
            d_j = robot.displacements(samples.position)[:, link - 1]
            out = (d_j * np.einsum("mk,mk->m", np.cross(z_i, g), frame_j[:, :, 2]))[:, None]
        return np.where(np.abs(out) > ROUNDING * np.linalg.norm(g), out, 0.0)


@lru_cache(maxsize=1)  # asked again for every link
def _rotations(robot: Robot, samples: Samples) -> Floats:
    return robot.rotations(samples.position)
