"""A virtual arm of rigid bodies in MuJoCo, driven by motor currents, with friction and hidden effects of its own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pumaid.maths import Floats
from pumaid.robot import Robot
from pumaid.simulation.hidden_effects import AMBIENT, ArmState, JointState, Kind, acted, values_of
from pumaid.simulation.virtual_robot import Truth, gravity_load, link_sizes
from pumaid.trajectory import accelerations

#: Attributes of a body or a joint of MuJoCo.
Attributes = Mapping[str, Any]
#: A link is taken for a solid cylinder of its length, its radius this share of that.
_RADIUS = 0.25
#: What every arm has; dry friction is held this stiffly: a loaded joint at rest creeps by some 1e-6 rad/s.
_OPTIONS = (
    '<mujoco><option integrator="implicitfast" iterations="50" tolerance="1e-12"><flag autoreset="disable"/></option>'
    "</mujoco>"
)
_HARD = (0.9999, 0.9999, 0.001, 0.5, 2.0)
#: A robot that is known by its constants in amperes has fictitious masses; they are made so much lighter, and gravity
#: so much larger: the same weights, and hardly any inertia but the motors'. kg m2 below which the engine takes none.
_LIGHT, _LEAST = 1e-4, 1e-9
#: A motor whose truth has no inertia gets one that draws this share of its Coulomb friction in a ramp.
_LEAST_INERTIA = 0.3
#: rad/s or m/s: slower joints are held by stiction.
STILL = 1e-4
#: Share of a joint's inertia below which what it feels while the others are free is another.
_ALONE = 0.9
#: Rounds in which an arm with sagging drives is put to rest.
_ROUNDS = 8


def chain(
    robot: Robot, links: Sequence[Attributes], joints: Sequence[Attributes] | None = None
) -> tuple[Any, list[Any]]:
    """MuJoCo's specification (``mujoco.MjSpec``) of an arm, and its bodies, the base's first.

    Body ``link<k>`` carries joint ``joint<k>`` about (along) its z axis; frames and positions are those of the recipe.
    `links` and `joints` (J each) are more of their attributes: a body that moves must have a mass.
    """
    mujoco = engine()
    spec = mujoco.MjSpec.from_string(_OPTIONS)
    bodies = [spec.worldbody]
    for joint, link, drive in zip(robot.joints, links, joints or [{}] * len(links), strict=True):
        bodies.append(
            bodies[-1].add_body(
                name=f"link{joint.number}",
                pos=joint.frame[:3, 3],
                quat=Rotation.from_matrix(joint.frame[:3, :3]).as_quat()[[3, 0, 1, 2]],
                **link,
            )
        )
        bodies[-1].add_joint(
            name=f"joint{joint.number}",
            type=mujoco.mjtJoint.mjJNT_HINGE if joint.is_revolute else mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[0, 0, 1],
            **drive,
        )
    return spec, bodies


def specification(truth: Truth, *, step: float = 0.001) -> Any:
    """The arm of a virtual robot as MuJoCo's specification, with steps of `step` (s), by `chain`.

    Inertia tensors are those of solid cylinders of the links' lengths, ``armature`` the motors' inertia. Dry friction
    is ``frictionloss``, half the sum of both directions' Coulomb terms; where gears couple joints it is that of tendons
    ``shaft<k>``, while the inertia of rotors stays at their joints. A hidden tilt turns gravity, hidden inertia is the
    motor's; the rest is left to `RigidArm`.
    """
    least = truth.sides * _LEAST_INERTIA * np.maximum(truth.coulomb, 0.1) / accelerations(truth.robot)
    visible = np.where(truth.inertia == 0, least, truth.inertia)
    motors = visible + np.sign(visible) * values_of(truth.hidden, "inertia", "J", n_joints=len(visible))
    armature, dry = motors / truth.gain, truth.coulomb / np.abs(truth.gain)
    light = 1.0 if truth.given_constants is None else _LIGHT
    rounded = light * tensors(truth) + _LEAST * np.eye(3)
    links: list[Attributes] = [
        {"mass": mass, "ipos": centre, "fullinertia": tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]}
        for mass, centre, tensor in zip(light * truth.links.mass, truth.links.centre, rounded, strict=True)
    ]
    rubs: list[Attributes] = [
        {"frictionloss": size, "solref_friction": [2 * step, 1.0], "solimp_friction": _HARD} for size in dry
    ]
    beside = [{}] * len(rubs) if truth.robot.coupling else rubs
    spec, _ = chain(truth.robot, links, [{"armature": size, **rub} for size, rub in zip(armature, beside, strict=True)])
    spec.option.timestep, spec.option.gravity = step, np.asarray(truth.gravity()) / light
    for k, row in enumerate(truth.robot.shaft_speeds if truth.robot.coupling else ()):
        shaft = spec.add_tendon(name=f"shaft{k + 1}", **rubs[k])
        for driving in np.flatnonzero(row):
            shaft.wrap_joint(f"joint{driving + 1}", row[driving])
    return spec


def tensors(truth: Truth) -> Floats:
    """(J, 3, 3) kg m2 about the links' centres of mass: solid cylinders that lie along the links."""
    along, length, shortest = link_sizes(truth.robot)
    # A link without length (a wrist's) is as long as it is thick, along its own axis.
    unit = np.where(length[:, None] > 1e-9, along / np.maximum(length, 1e-9)[:, None], [0.0, 0.0, 1.0])
    size = np.maximum(length, shortest)
    radius = np.maximum(_RADIUS * size, 0.5 * shortest)
    axial, across = 0.5 * radius**2, (3 * radius**2 + size**2) / 12
    outer = unit[:, :, None] * unit[:, None, :]
    shape = across[:, None, None] * (np.eye(3) - outer) + axial[:, None, None] * outer
    return np.asarray(truth.links.mass[:, None, None] * shape)


class RigidArm:
    """A virtual arm in MuJoCo that is driven by motor currents, in amperes and SI, signs as in the logs.

    The engine solves the arm's dynamics and its dry friction, as a constraint: a joint at rest stays there until the
    motor's surplus passes the break-away level. Coulomb friction that differs between directions is its mean and a
    constant push. Where the recipe's gears couple joints, motors and their friction act on shafts. Hidden loads and
    friction act at the joints; a payload is a body that comes at its time; what stands elsewhere than the encoders
    tell (an offset, a drive that sags) is in `reading`.

    The engine steps by `step` s. `grip` gives of the shafts' velocity (J,) the (J,) times Coulomb friction that the
    engine holds against them (docs/gallery has a law of its own); else `Truth.breakaway` at rest and 1 in motion.
    `model` and `data` are MuJoCo's own, and so are `position` (J,) rad or m and `velocity` (J,), the joints' exact
    ones; `state` is what hidden effects depend on, whose `time`, `first` and `temperature` the caller sets.
    """

    def __init__(self, truth: Truth, *, step: float, grip: Callable[[Floats], Floats] | None = None) -> None:
        self.step, n = step, truth.robot.n_joints
        friction, self._gain, self._coulomb = truth.friction, truth.gain, truth.coulomb
        self._uneven = 0.5 * (friction.coulomb_plus + friction.coulomb_minus)
        self._grip = grip or (lambda v: np.where(np.abs(v) < STILL, truth.breakaway, 1.0))
        self._shafts = truth.robot.shaft_speeds
        self._shares = np.linalg.inv(self._shafts)
        self._offset = values_of(truth.hidden, "zero_offset", "delta", n_joints=n)
        self._sag = truth.sides * values_of(truth.hidden, "flexibility", "c", n_joints=n)
        self._payloads = [hidden.values for hidden in truth.hidden if hidden.effect == "payload"]
        self._acting = [hidden for hidden in truth.hidden if hidden.effect != "inertia"]
        self._needs_across = truth.hides("side_load_friction")
        self._departure, zero = np.zeros(n), np.zeros(n)
        self.state = ArmState(np.zeros(()), zero, zero, zero, zero, zero, np.full(n, AMBIENT), zero, zero, zero)
        self._joints = [JointState(self.state, j + 1, float(truth.sides[j])) for j in range(n)]
        self._extra = np.zeros(n)
        self._build(truth)

    def _build(self, truth: Truth) -> None:
        self.truth, mujoco = truth, engine()
        self.model = specification(truth, step=self.step).compile()
        self.data = mujoco.MjData(self.model)
        self._begin, self._finish = mujoco.mj_step1, mujoco.mj_step2
        self._dry = self.model.tendon_frictionloss if truth.robot.coupling else self.model.dof_frictionloss
        self.position, self.velocity, self._bias = self.data.qpos, self.data.qvel, self.data.qfrc_bias

    @property
    def shaft_velocity(self) -> Floats:
        """(J,) rad/s or m/s at which the motors turn, geared to their joints; the joints' own where none is coupled."""
        return np.asarray(self._shafts @ self.velocity)

    @property
    def load(self) -> Floats:
        """(J,) A that weight and Coriolis forces take of the motors now."""
        return np.asarray(self._gain * (self._bias @ self._shares))

    @property
    def reading(self) -> Floats:
        """(J,) rad or m that exact encoders tell: where the motors stand, not the links."""
        return self.position - self._offset + self._sag * self.load

    def place(self, reading: Floats) -> None:
        """Put the arm at rest where exact encoders tell `reading` (J,)."""
        self.velocity[:] = 0.0
        self.position[:] = reading + self._offset
        for _ in range(_ROUNDS):
            self._begin(self.model, self.data)
            self.position[:] = reading + self._offset - self._sag * self.load
        self._departure = reading.copy()
        self._look()

    def advance(self, current: Floats) -> None:
        """Let the motors' currents (J,), A, act for a step."""
        friction, v = self.truth.friction, self.shaft_velocity
        lost = self._uneven + friction.viscous_plus * np.maximum(v, 0.0) + friction.viscous_minus * np.minimum(v, 0.0)
        self.data.qfrc_applied[:] = ((current - lost - self._extra) / self._gain) @ self._shafts
        self._finish(self.model, self.data)
        self.state.time = self.state.time + self.step
        if self._payloads and self.state.time - np.min(self.state.first) > self._payloads[0]["time"]:
            position, velocity = self.position.copy(), self.velocity.copy()
            self._build(replace(self.truth, links=self.truth.links.loaded(self._payloads.pop(0))))
            self.position[:], self.velocity[:] = position, velocity
        self._look()

    def _look(self) -> None:
        """Friction and loads where the arm is now; friction knows what gears passed on in the step before."""
        v, state = self.shaft_velocity, self.state
        rests = np.abs(v) < STILL
        dry = self._coulomb * self._grip(v)
        if self._acting:
            state.position, state.velocity = self.reading, np.where(rests, 0.0, v)
            # Beside the weight what the links' accelerations in the last step took, without the motors' own inertia.
            taken = np.zeros(self.model.nv)
            engine().mj_mulM(self.model, self.data, taken, self.data.qacc)
            taken -= self.model.dof_armature * self.data.qacc
            state.load = self.load + self._gain * (taken @ self._shares)
            self._departure[rests] = state.position[rests]
            state.travel = np.abs(state.position - self._departure)
            state.friction = self.truth.friction.currents(state.velocity)
            if self._needs_across:
                arm = replace(self.truth.robot, gravity=self.truth.gravity())
                state.across = gravity_load(arm, self.truth.links, self.position[None])[1][0] * np.abs(self._gain)
            dry = dry + self._hidden(Kind.FRICTION)
        self._dry[:] = np.maximum(dry / np.abs(self._gain), 0.0)
        self._begin(self.model, self.data)
        if self._acting:
            self.state.load = self.load
            self._extra = self._hidden(Kind.LOAD)

    def _hidden(self, kind: Kind) -> Floats:
        """(J,) A of hidden friction (its size) or of hidden loads."""
        return np.array([acted(self._acting, joint, kind) for joint in self._joints])

    def inertia(self, position: Floats) -> Floats:
        """(J, J) kg m2 (kg, kg m): mass matrix at `position` (J,), motors' inertia included."""
        mujoco, n = engine(), self.model.nv
        data, out = mujoco.MjData(self.model), np.zeros((n, n))
        data.qpos[:] = position
        mujoco.mj_forward(self.model, data)
        for row, unit in zip(out, np.eye(n), strict=True):
            mujoco.mj_mulM(self.model, data, row, unit)
        return out

    def felt_inertia(self, position: Floats) -> Floats:
        """(J,) kg m2 (kg) that each motor moves at `position`: with the others held, or where others' links, left free,
        would take more than a tenth of it away, with these free."""
        mass = self.inertia(position)
        held, free = np.diag(mass), 1.0 / np.diag(np.linalg.inv(mass))
        return np.where(free < _ALONE * held, free, held)


def engine() -> Any:
    """The module ``mujoco``, which writes no file about arms that are out of control."""
    import mujoco

    mujoco.set_mju_user_warning(lambda _: None)
    return mujoco
