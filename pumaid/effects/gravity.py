"""Gravity: the current that carries the links' weight."""

from collections.abc import Mapping, Sequence

import numpy as np

from pumaid.effects.base import NO_SHAPE, Effect, Family, Floats, Parameter, Scope
from pumaid.robot import Robot
from pumaid.samples import Samples

#: Columns below this share of g are rounding of rotations by right angles, not levers.
ROUNDING = 1e-13


class Gravity(Effect):
    """The load of links i..n on joint i, in regrouped constants that absorb every length and mass.

    A revolute joint i feels (z_i x g) . x_j and (z_i x g) . y_j of every revolute link j >= i, and
    d_j (z_i x g) . z_j of every prismatic link j > i; a prismatic joint feels only its own -(g . z_i).
    g is gravity in base axes (m/s2), d_j the full displacement (m).
    """

    title = "Gravity load of the links"
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
        link = number or samples.joint
        return self.columns_of(robot, samples, (link,))[link]

    def columns_of(self, robot: Robot, samples: Samples, numbers: Sequence[int]) -> dict[int, Floats]:
        rotations = robot.rotations(samples.position)
        return {link: self._of_link(robot, samples, rotations, link=link) for link in numbers}

    def _of_link(self, robot: Robot, samples: Samples, rotations: Floats, *, link: int) -> Floats:
        moving, g = samples.joint, np.asarray(robot.gravity)
        z_i, frame_j = rotations[:, moving - 1, :, 2], rotations[:, link - 1]
        width = len(self.parameters(robot, link))
        if not robot.joint(moving).is_revolute:
            return _cleaned(-(z_i @ g)[:, None], g) if link == moving else np.zeros((len(samples), width))
        lever = np.cross(z_i, g)
        if robot.joint(link).is_revolute:
            return _cleaned(np.einsum("mk,mkp->mp", lever, frame_j[:, :, :2]), g)
        d_j = robot.displacements(samples.position)[:, link - 1]
        return _cleaned((d_j * np.einsum("mk,mk->m", lever, frame_j[:, :, 2]))[:, None], g)


def _cleaned(columns: Floats, g: Floats) -> Floats:
    return np.where(np.abs(columns) > ROUNDING * np.linalg.norm(g), columns, 0.0)
