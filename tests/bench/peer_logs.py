"""One experiment on one virtual arm, written as pumaid, figaroh, aurt and mujoco.sysid each read it.

The arm has the PUMA 560's geometry (or that of its first three joints), drawn masses, rigid-body physics, and friction
that is the same in both directions, so that the model of each tool can describe it. Peers work in N m: they are told
the motors' gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pumaid import export, read_model
from pumaid.exports.robot_xml import xml_name
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.simulation.mujoco_engine import mjcf
from pumaid.simulation.random_robot import draw
from pumaid.simulation.session import simulate
from pumaid.simulation.virtual_robot import Friction, Truth
from pumaid.trajectory import Motion, Plan
from pumaid.units import factor

Floats = NDArray[np.float64]

RECIPE = shipped_recipes()["puma560"]
#: What the recipe's lines of the wrist's joints begin with.
WRIST = "  - {name: wrist"
#: Hz, as a UR controller of the CB series logs; s of robot time that a lap over all joints takes, about.
RATE, LAP = 125.0, 150.0
SEED = 3
#: Postures and speeds in which answers are compared.
POINTS = 1000
#: figaroh's unified configuration: its template for arms, everything on that its model has, and the log's rate.
FIGAROH = """\
robot:
  name: arm
  properties:
    joints:
      active_joints: [{names}]
    mechanics:
      reduction_ratios: [{ones}]
      friction_coefficients: {{viscous: [{zeros}], static: [{zeros}]}}
      actuator_inertias: [{zeros}]
      joint_offsets: [{zeros}]
    coupling: {{has_coupled_wrist: false}}
tasks:
  identification:
    enabled: true
    problem:
      include_external_forces: false
      use_joint_torques: true
      model_components: {{friction: true, joint_offset: true, actuator_inertia: true}}
    signal_processing:
      sampling_frequency: {rate}
      cutoff_frequency: 50.0
      filter_type: butterworth
      filter_order: 4
"""


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """A log in N m: (N,) s and (N, J) rad, rad/s, N m."""

    time: Floats
    position: Floats
    velocity: Floats
    torque: Floats

    def first(self, count: int) -> Rows:
        """The first `count` rows."""
        return Rows(self.time[:count], self.position[:count], self.velocity[:count], self.torque[:count])


def recipe(joints: int) -> str:
    """The shipped recipe of the PUMA 560, or what is left of it without its wrist: six joints or three."""
    lines = RECIPE.read_text(encoding="utf-8").splitlines(keepends=True)
    return "".join(text for text in lines if joints > 3 or not text.startswith(WRIST))


def arm(recipe: Path) -> Truth:
    """The virtual arm of a recipe: drawn, then its friction made the same in both directions."""
    drawn = draw(read_recipe(recipe), SEED)
    told = drawn.friction
    dry = 0.5 * (told.coulomb_plus - told.coulomb_minus)
    viscous = 0.5 * (told.viscous_plus + told.viscous_minus)
    return replace(drawn, friction=Friction(dry, -dry, viscous, viscous))


def experiment(robot: Robot, laps: int) -> Plan:
    """Laps over all joints, one at a time, there and back; every lap in postures and at speeds of its own."""
    rng, motions = np.random.default_rng(SEED), []
    for _ in range(2 * laps):
        for joint in range(1, robot.n_joints + 1):
            hold = tuple(float(value) for value in rng.uniform(-1.5, 1.5, robot.n_joints))
            speed, half = float(rng.uniform(40, 70)) * factor("deg"), float(rng.uniform(0.8, 1.6))
            there = Motion(joint=joint, hold=hold, start=-half, end=half, velocity=speed)
            motions += [there, replace(there, start=half, end=-half)]
    return Plan(robot=robot.name, motions=tuple(motions))


def session(truth: Truth, rows: int) -> Rows:
    """At least so many rows of the experiment, in rigid-body physics, currents turned into N m."""
    plan = experiment(truth.robot, math.ceil(rows / (RATE * LAP)))
    logs = list(simulate(truth.robot, plan, seed=SEED, truth=truth, rate=RATE, runs_per_file=10**9))
    columns = ("time", "position", "velocity", "current")
    time, position, velocity, current = (np.concatenate([getattr(log, name) for log in logs]) for name in columns)
    return Rows(time, position, velocity, current / truth.gain)


def moving_all(truth: Truth, count: int) -> Rows:
    """A log of the kind that peers are made for: all joints move all the time (Fourier series); no closed loop.

    Torques are the engine's inverse dynamics, friction and white noise; positions are exact.
    """
    import mujoco

    free = replace(truth, friction=Friction(*np.zeros((4, truth.robot.n_joints))))
    model = mujoco.MjModel.from_xml_string(mjcf(free))
    data = mujoco.MjData(model)
    rng, n = np.random.default_rng(SEED), truth.robot.n_joints
    time, waves = np.arange(count) / RATE, 2 * np.pi * np.array([0.07, 0.11, 0.19, 0.29, 0.41])
    size, phase = rng.uniform(0.2, 1.0, (2, len(waves), n)) * np.array([[[1.0]], [[2 * np.pi]]])
    size *= 1.2 / np.sum(size * waves[:, None], axis=0)
    angle = time[:, None, None] * waves[:, None] + phase
    position, velocity = np.sum(size * np.sin(angle), 1), np.sum(size * waves[:, None] * np.cos(angle), 1)
    acceleration = -np.sum(size * waves[:, None] ** 2 * np.sin(angle), 1)
    torque = np.empty_like(position)
    for row in range(count):
        data.qpos[:], data.qvel[:], data.qacc[:] = position[row], velocity[row], acceleration[row]
        mujoco.mj_inverse(model, data)
        torque[row] = data.qfrc_inverse
    torque += _friction(truth, velocity) + rng.normal(0.0, 1.0, torque.shape) * truth.noise.std / np.abs(truth.gain)
    return Rows(time, position, velocity, torque)


def _friction(truth: Truth, velocity: Floats) -> Floats:
    """(N, J) N m; nothing where a joint rests."""
    assert truth.gain is not None
    return np.stack([truth.friction.current(j + 1, v) for j, v in enumerate(velocity.T)], axis=1) / truth.gain


def questions(truth: Truth) -> dict[str, Floats]:
    """Postures, in each of which one joint moves steadily, and what every joint asks there, N m."""
    assert truth.gain is not None
    rng, n = np.random.default_rng(SEED + 1), truth.robot.n_joints
    position, velocity = rng.uniform(-1.5, 1.5, (POINTS, n)), np.zeros((POINTS, n))
    moving = rng.integers(0, n, POINTS)
    velocity[np.arange(POINTS), moving] = rng.uniform(20, 70, POINTS) * factor("deg") * rng.choice([-1, 1], POINTS)
    gravity = truth.gravity_current(position) / truth.gain
    whole = gravity + _friction(truth, velocity)
    return {"position": position, "velocity": velocity, "moving": moving, "gravity": gravity, "whole": whole}


def write(folder: Path, rows: Rows, truth: Truth) -> None:
    """The log as each tool reads it.

    pumaid: its own names. figaroh: those of its UR10 example. aurt: separated by blanks, with every column that its
    reader asks for; what it does not use is zero. mujoco.sysid: times, the motors' torques, positions and velocities.
    """
    n, nothing = rows.position.shape[1], np.zeros_like(rows.position)
    idle = ("target_q", "target_qd", "target_qdd", "target_current", "target_moment")
    pumaid = {"q{1}": rows.position, "qd{1}": rows.velocity, "i{1}": rows.torque * truth.gain}
    aurt = {"actual_q_{0}": rows.position, "actual_qd_{0}": rows.velocity, "actual_current_{0}": rows.torque}
    texts = (
        ("pumaid/log.csv", ",", "t", pumaid),
        ("figaroh.csv", ",", "t", {"q{0}": rows.position, "tau{1}": rows.torque}),
        ("aurt.csv", " ", "timestamp", aurt | {f"{name}_{{0}}": nothing for name in idle}),
    )
    (folder / "pumaid").mkdir(exist_ok=True)
    for name, delimiter, time, columns in texts:
        names = [time, *(kind.format(j, j + 1) for kind in columns for j in range(n))]
        table, header = np.column_stack([rows.time, *columns.values()]), delimiter.join(names)
        np.savetxt(folder / name, table, fmt="%.9g", delimiter=delimiter, header=header, comments="")
    sensors = np.concatenate([rows.position, rows.velocity], axis=1)
    np.savez(folder / "mujoco.npz", times=rows.time, control=rows.torque, sensors=sensors)


def mdh_table(robot: Robot) -> str:
    """The arm's geometry as aurt's file: alpha and a of a row are those after its joint, not before it."""
    right = {0.0: "0", 90.0: "pi/2", -90.0: "-pi/2"}
    after = [(joint.a, right[round(joint.alpha / factor("deg"), 9)]) for joint in robot.joints[1:]] + [(0.0, "0")]
    rows = [f"{joint.d},{a},{alpha}" for joint, (a, alpha) in zip(robot.joints, after, strict=True)]
    return "\n".join(["d,a,alpha", *rows, ""])


def mujoco_model(truth: Truth) -> str:
    """MJCF of the arm as a user might know it: masses a tenth too large, centres off by 2 cm, friction half."""
    assert truth.links is not None
    links = replace(truth.links, mass=1.1 * truth.links.mass, centre=truth.links.centre + 0.02)
    told = truth.friction
    friction = Friction(0.5 * told.coulomb_plus, 0.5 * told.coulomb_minus, told.viscous_plus, told.viscous_minus)
    guess = replace(truth, links=links, friction=friction, inertia=0.5 * truth.inertia)
    names = [f"joint{joint.number}" for joint in truth.robot.joints]
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in names)
    sensors = "".join(f'<jointpos name="{name}_position" joint="{name}"/>' for name in names)
    parts = f"<actuator>{motors}</actuator>\n<sensor>{sensors}</sensor>\n</mujoco>"
    own = ' iterations="50" tolerance="1e-12"'  # of pumaid's physics; the engine's defaults are quicker
    return mjcf(guess, step=1.0 / RATE).replace(own, "").replace("</mujoco>", parts)


def figaroh_configuration(robot: Robot) -> str:
    """What figaroh shall identify, as the configuration of its UR10 example says it."""
    n = robot.n_joints
    names = ", ".join(xml_name(joint.name) for joint in robot.joints)
    return FIGAROH.format(names=names, ones=", ".join(["1"] * n), zeros=", ".join(["0"] * n), rate=RATE)


def figaroh_model(recipe: Path, model: Path) -> str:
    """URDF of the arm: what `pumaid export` makes of an identified model; figaroh takes the geometry from it."""
    truth = arm(recipe)
    assert truth.gain is not None
    constants = {number: float(1.0 / gain) for number, gain in enumerate(truth.gain, start=1)}
    exported = export(read_model(model), truth.robot, form="urdf", torque_constants=constants)
    return exported.files[".urdf"]
