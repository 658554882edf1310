"""A virtual robot whose links push each other: rigid-body dynamics by MuJoCo, motors and friction as in the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError
from pumaid.simulation.physics.mjcf import mjcf
from pumaid.simulation.shafts import shafts
from pumaid.simulation.truth import Truth

Floats = NDArray[np.float64]

#: rad/s or m/s: slower joints are held by stiction.
STILL = 1e-4


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
    gears couple joints, motors and their friction act on shafts (`simulation.shafts`), which push all joints that
    turn them.

    Parameters
    ----------
    truth
        A robot with masses and gains.
    step
        s of the engine's steps.
    taken
        Position and velocity of the shafts (J,) -> (J,) A that other physics takes from the motors; nothing where not
        given. It is asked at every step. To bring friction of one's own, give a truth whose friction is zero.
    grip
        Velocity of the shafts (J,) -> (J,) times Coulomb friction: the dry friction that the engine holds against them.
        Where not given, `Truth.breakaway` at rest and 1 in motion.

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
    >>> from pumaid.simulation import draw, table1
    >>> truth = draw(table1.robot(), 3)
    >>> arm = Rigid(truth)
    >>> arm.place(np.zeros(6))
    >>> for _ in range(250):  # a second of holding the arm against its weight, every 4 ms
    ...     arm.advance(truth.gravity_current(arm.position[None])[0], 0.004)
    >>> bool(np.max(np.abs(arm.position)) < 1e-5)
    True
    """

    def __init__(
        self,
        truth: Truth,
        *,
        step: float = 0.001,
        taken: Callable[[Floats, Floats], Floats] | None = None,
        grip: Callable[[Floats], Floats] | None = None,
    ) -> None:
        mujoco = engine()
        self.truth, self.step, self._taken, self._grip = truth, step, taken, grip or self._stuck
        self.model = mujoco.MjModel.from_xml_string(mjcf(truth, step=step))
        self.data = mujoco.MjData(self.model)
        self._advance, self._forward = mujoco.mj_step, mujoco.mj_forward
        assert truth.gain is not None
        self._gain, friction = truth.gain, truth.friction
        self._dry = truth.coulomb / np.abs(self._gain)
        self._shafts = shafts(truth.robot) if truth.robot.coupling else None
        self._uneven = 0.5 * (friction.coulomb_plus + friction.coulomb_minus)

    @property
    def position(self) -> Floats:
        """(J,) rad or m, exact."""
        return np.array(self.data.qpos)

    @property
    def velocity(self) -> Floats:
        """(J,) rad/s or m/s, exact."""
        return np.array(self.data.qvel)

    @property
    def shaft_velocity(self) -> Floats:
        """(J,) rad/s or m/s at which the motors turn, geared to their joints; the joints' own where none is coupled."""
        return self.velocity if self._shafts is None else np.asarray(self._shafts @ self.velocity)

    def place(self, position: Floats, velocity: Floats | None = None) -> None:
        """Put the arm at `position` (J,), at rest or with `velocity` (J,)."""
        self.data.qpos[:] = position
        self.data.qvel[:] = 0.0 if velocity is None else velocity
        self._forward(self.model, self.data)

    @property
    def load(self) -> Floats:
        """(J,) A that weight and Coriolis forces take of the motors now."""
        torque = np.array(self.data.qfrc_bias)
        return self._gain * (torque if self._shafts is None else torque @ np.linalg.inv(self._shafts))

    def advance(self, current: Floats, seconds: float, *, dry: Floats | None = None) -> None:
        """Let the motors' currents (J,), A, act for `seconds`, a whole number of steps.

        `dry` (J,) A is dry friction beyond Coulomb's, of either sign; stiction grows with it.
        """
        more = np.zeros_like(current) if dry is None else dry / np.abs(self._gain)
        for _ in range(round(seconds / self.step)):
            self._step(current, more)

    def inertia(self, position: Floats) -> Floats:
        """(J, J) kg m2 (kg, kg m): mass matrix at `position` (J,), motors' inertia included."""
        data = engine().MjData(self.model)
        data.qpos[:] = position
        self._forward(self.model, data)
        full = np.zeros((self.model.nv, self.model.nv))
        for j, unit in enumerate(np.eye(self.model.nv)):
            engine().mj_mulM(self.model, data, full[j], unit)
        return full

    def _stuck(self, velocity: Floats) -> Floats:
        return np.where(np.abs(velocity) < STILL, self.truth.breakaway, 1.0)

    def _step(self, current: Floats, more: Floats) -> None:
        v, friction = self.shaft_velocity, self.truth.friction
        lost = np.where(v > 0, friction.viscous_plus, friction.viscous_minus) * v + self._uneven
        if self._taken is not None:
            lost = lost + self._taken(self.position, v)
        torque, dry = (current - lost) / self._gain, np.maximum(self._dry + more, 0.0) * self._grip(v)
        if self._shafts is None:
            self.data.qfrc_applied[:], self.model.dof_frictionloss[:] = torque, dry
        else:
            self.data.qfrc_applied[:], self.model.tendon_frictionloss[:] = torque @ self._shafts, dry
        self._advance(self.model, self.data)
