"""A virtual robot whose links push each other: rigid-body dynamics by MuJoCo, motors and friction as in the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError
from pumaid.virtual.physics.mjcf import mjcf
from pumaid.virtual.truth import Truth

Floats = NDArray[np.float64]

#: rad/s or m/s: slower joints are held by stiction.
STILL = 1e-4
#: rad/s or m/s over which the friction of a shaft that another joint turns changes its direction.
TURNING = 5e-3


def engine() -> Any:
    """The module ``mujoco``.

    Raises
    ------
    ModelError [physics-wrong]
        It is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        what = "rigid-body physics needs MuJoCo, which is not installed"
        raise ModelError("physics-wrong", what, mend="pip install 'pumaid[mujoco]'") from error
    return mujoco


class Rigid:
    """A virtual arm in MuJoCo that is driven by motor currents, in amperes and SI, signs as in the logs.

    The engine solves the arm's dynamics and its dry friction (as a constraint: a joint at rest stays there until the
    motor's surplus passes the break-away level, `Truth.breakaway` times Coulomb friction). Coulomb friction that
    differs between directions is its mean and a constant push; viscous friction is by direction. Where the recipe's
    gears couple joints, friction follows the speeds of the shafts (`Robot.shaft_velocity`): a shaft that another joint
    turns slides, and its friction pushes its own joint.

    Parameters
    ----------
    truth
        A robot with masses and gains.
    step
        s of the engine's steps.
    taken
        Position, velocity (J,) -> (J,) A that other physics takes from the motors; nothing where not given. It is
        asked at every step. To bring friction of one's own, give a truth whose friction is zero.

    Attributes
    ----------
    model, data
        MuJoCo's own ``MjModel`` and ``MjData``, open to anybody.

    Raises
    ------
    ModelError [physics-wrong]
        MuJoCo is not installed, or the robot is known by constants in amperes alone.

    Examples
    --------
    >>> import numpy as np
    >>> from pumaid.virtual import draw, table1
    >>> truth = draw(table1.robot(), 3)
    >>> arm = Rigid(truth)
    >>> arm.place(np.zeros(6))
    >>> for _ in range(250):  # a second of holding the arm against its weight, every 4 ms
    ...     arm.advance(truth.gravity_current(arm.position[None])[0], 0.004)
    >>> bool(np.max(np.abs(arm.position)) < 1e-5)
    True
    """

    def __init__(
        self, truth: Truth, *, step: float = 0.001, taken: Callable[[Floats, Floats], Floats] | None = None
    ) -> None:
        mujoco = engine()
        self.truth, self.step, self._taken = truth, step, taken
        self.model = mujoco.MjModel.from_xml_string(mjcf(truth, step=step))
        self.data = mujoco.MjData(self.model)
        self._advance, self._forward = mujoco.mj_step, mujoco.mj_forward
        assert truth.gain is not None
        self._gain, friction = truth.gain, truth.friction
        self._even = 0.5 * (friction.coulomb_plus - friction.coulomb_minus)
        self._uneven = 0.5 * (friction.coulomb_plus + friction.coulomb_minus)

    @property
    def position(self) -> Floats:
        """(J,) rad or m, exact."""
        return np.array(self.data.qpos)

    @property
    def velocity(self) -> Floats:
        """(J,) rad/s or m/s, exact."""
        return np.array(self.data.qvel)

    def place(self, position: Floats, velocity: Floats | None = None) -> None:
        """Put the arm at `position` (J,), at rest or with `velocity` (J,)."""
        self.data.qpos[:] = position
        self.data.qvel[:] = 0.0 if velocity is None else velocity
        self._forward(self.model, self.data)

    def advance(self, current: Floats, seconds: float) -> None:
        """Let the motors' currents (J,), A, act for `seconds`, a whole number of steps."""
        for _ in range(round(seconds / self.step)):
            self._step(current)

    def inertia(self, position: Floats) -> Floats:
        """(J, J) kg m2 (kg, kg m): mass matrix at `position` (J,), motors' inertia included."""
        data = engine().MjData(self.model)
        data.qpos[:] = position
        self._forward(self.model, data)
        full = np.zeros((self.model.nv, self.model.nv))
        for j, unit in enumerate(np.eye(self.model.nv)):
            engine().mj_mulM(self.model, data, full[j], unit)
        return full

    def _step(self, current: Floats) -> None:
        v, friction = self.velocity, self.truth.friction
        shaft = self.truth.robot.shaft_velocity(v[None])[0]
        driven = np.abs(shaft - v) > STILL
        viscous = np.where(shaft > 0, friction.viscous_plus, friction.viscous_minus) * shaft
        lost = viscous + self._uneven + np.where(driven, self._even * np.tanh(shaft / TURNING), 0.0)
        if self._taken is not None:
            lost = lost + self._taken(self.position, v)
        self.data.qfrc_applied[:] = (current - lost) / self._gain
        held = np.where(np.abs(v) < STILL, self.truth.breakaway, 1.0)
        self.model.dof_frictionloss[:] = np.where(driven, 0.0, np.abs(self._even / self._gain) * held)
        self._advance(self.model, self.data)
