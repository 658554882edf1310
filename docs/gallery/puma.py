"""A virtual PUMA 560 in MuJoCo with stiction, Stribeck friction and a geared wrist, and logs of its motions.

Nothing here knows the model that pumaid identifies; nothing that identifies it knows what is drawn here.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Log
from pumaid.io.write import write_log
from pumaid.robot import Joint, Robot
from pumaid.simulation import BREAKAWAY, Links, Noise, Truth
from pumaid.simulation.mujoco_engine import RigidArm

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
import table1  # noqa: E402

Floats = NDArray[np.float64]

DEG = np.pi / 180.0
HOME = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0]) * DEG

#: Masses (kg) and centres (m, frames of the recipe): Armstrong, Khatib and Burdick, The explicit dynamic model and
#: inertial parameters of the PUMA 560 arm, ICRA 1986. They give no mass to link 1, which lifts nothing.
MASS = np.array([13.0, 17.4, 4.8, 0.82, 0.34, 0.09])
CENTRE = np.array([[0, 0, 0], [0.068, 0.006, -0.016], [0, -0.070, 0.014], [0, 0, -0.019], [0, 0, 0], [0, 0, 0.032]])

#: Sizes of gear ratios, N m/A of the motors, kg m2 of their rotors: Corke and Armstrong-Helouvry, A search for
#: consensus among model parameters reported for the PUMA 560 robot, ICRA 1994.
GEARS = np.array([62.6111, 107.815, 53.7063, 76.03636, 71.923, 76.686])
TORQUE = np.array([0.223, 0.226, 0.240, 0.069, 0.072, 0.066])
ROTOR = np.array([200e-6, 200e-6, 200e-6, 33e-6, 33e-6, 33e-6])
#: The wrist's gears, of the size of the arm's.
COUPLING = {(5, 4): 0.0139, (6, 4): 0.0130, (6, 5): 0.1806}
#: Motors of joints 3 to 6 count their current against the joint, as in the paper's Table I.
SIDE = np.array([1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
#: A: what the drives give at most, from the arm's greatest torques (Armstrong, Khatib and Burdick).
MOST = np.array([97.6, 186.4, 89.4, 24.2, 20.1, 21.3]) / (TORQUE * GEARS)

#: s: of the controller, and of the filter behind the encoders.
TICK, FILTER = 0.001, 0.002
#: Encoder counts a turn of the motor.
COUNTS = 4000.0
#: Samples of the log per second.
RATE = 100.0


@dataclass(frozen=True)
class Arm:
    """One robot: what it hides.

    `stribeck` (J,) is the share of Coulomb friction that a joint's friction has more at rest than in motion, and
    `speed` (J,) rad/s the one at which a third of it is left.
    """

    truth: Truth
    stribeck: Floats
    speed: Floats
    seed: int

    def engine(self) -> RigidArm:
        """The arm in MuJoCo: dry friction falls from rest to motion, on the shafts of the motors."""
        return RigidArm(self.truth, step=TICK, grip=lambda v: 1.0 + self.stribeck * np.exp(-np.abs(v) / self.speed))


def recipe(*, coupled: bool = True) -> Robot:
    """What a user knows: the paper's arm, with its gears and with or without those that couple its wrist."""
    bare = table1.robot()

    def joint(one: Joint, gear: float) -> Joint:
        return replace(one, gear_ratio=gear)

    joints = tuple(joint(one, gear) for one, gear in zip(bare.joints, GEARS, strict=True))
    return replace(bare, joints=joints, coupling=COUPLING if coupled else {})


def arm(seed: int) -> Arm:
    """A PUMA that is by chance some ten per cent off the published one, with friction as in Table I."""
    rng = np.random.default_rng(seed)
    near = lambda values: values * rng.uniform(0.9, 1.1, np.shape(values))  # noqa: E731
    links = Links(near(MASS), CENTRE + rng.normal(0.0, 0.005, CENTRE.shape))
    gain = SIDE / near(TORQUE * GEARS)
    table = table1.puma560()
    friction = replace(
        table.friction,
        coulomb_plus=near(table.friction.coulomb_plus),
        coulomb_minus=near(table.friction.coulomb_minus),
        viscous_plus=near(table.friction.viscous_plus),
        viscous_minus=near(table.friction.viscous_minus),
    )
    truth = Truth(
        recipe(),
        friction,
        Noise(table.noise.std, current_step=0.0005, counts=COUNTS * GEARS / (2.0 * np.pi)),
        links=links,
        gain=gain,
        inertia=near(ROTOR) * GEARS**2 * gain,
        breakaway=np.full(6, BREAKAWAY),
        seed=seed,
    )
    return Arm(truth, rng.uniform(0.2, 0.4, 6), rng.uniform(2.0, 5.0, 6) * DEG, seed)


class Drive:
    """The controller's side of the arm: encoders, speeds from them, currents within what the drives give."""

    def __init__(self, robot: Arm, home: Floats) -> None:
        self.robot, self.engine = robot, robot.engine()
        assert robot.truth.noise.counts is not None
        self._counts = robot.truth.noise.counts
        self.engine.place(home)
        self.position, self.velocity = self._encoder(), np.zeros(6)

    def _encoder(self) -> Floats:
        return np.round(self.engine.position * self._counts) / self._counts

    def step(self, current: Floats) -> Floats:
        """Give (6,) A for a tick; what the drives gave of it."""
        given = np.clip(current, -MOST, MOST)
        self.engine.advance(given)
        before, self.position = self.position, self._encoder()
        self.velocity = self.velocity + TICK / FILTER * ((self.position - before) / TICK - self.velocity)
        return given


def pd(drive: Drive, error: Floats, speed: Floats, *, k_p: float = 100.0, k_d: float = 20.0) -> Floats:
    """(6,) A: K_P (q_d - q) + K_D (qd_d - qd), in the sense in which each motor counts its current."""
    return SIDE * (k_p * error + k_d * (speed - drive.velocity))


#: Joint -> postures (deg) of the paper's experiment.
POSTURES = {
    1: [(0, -90, 90, 0, 0, 0)],
    2: [(0, -90, 90, 0, 0, 0), (0, -90, 150, 0, 0, 0)],
    3: [(0, -90, 90, 0, 0, 0), (0, -90, 90, 0, 90, 0)],
    4: [(0, -90, 0, 0, 0, 0), (0, -90, 0, 0, 90, 0)],
    5: [(0, -90, 0, 0, 0, 0), (0, -90, 0, 0, 0, 90)],
    6: [(0, -90, 0, 0, 0, 0)],
}
#: Speed (deg/s) -> the span (deg) over which it is run, from where the joint's runs begin; slow ones over a part.
SPEEDS = {60.0: 100.0, 30.0: 80.0, 12.0: 28.0, 5.0: 14.0, 2.0: 7.0}
#: deg from zero at which a joint's runs begin, on one side of it in one posture and on the other in the next.
BEGIN = 50.0


@dataclass(frozen=True)
class Way:
    """A motion from `start` to `end` (6,) rad with a trapezoid of speed whose greatest is `speed` (rad/s)."""

    start: Floats
    end: Floats
    speed: float
    ramp: float = 0.25

    @property
    def seconds(self) -> float:
        """s, with a short rest at its end."""
        return float(np.max(np.abs(self.end - self.start))) / self.speed + self.ramp + 0.35

    def at(self, t: float) -> tuple[Floats, Floats]:
        """Wanted position and velocity `t` s after the start."""
        way = self.end - self.start
        length = float(np.max(np.abs(way)))
        if length == 0.0:
            return self.end, np.zeros_like(way)
        ramp = min(self.ramp, length / self.speed)
        whole = length / self.speed + ramp
        t = min(t, whole)
        up, down = min(t, ramp), max(0.0, t - (whole - ramp))
        gone = self.speed * (up**2 / (2 * ramp) + max(0.0, t - ramp) - down**2 / (2 * ramp))
        speed = self.speed * (up - down) / ramp
        return self.start + way * (gone / length), way * (speed / length)


def ways() -> list[Way]:
    """The paper's experiment, and slow runs besides: one joint at a time, there and back."""
    out, here, side = [], HOME, -1.0
    for joint, postures in POSTURES.items():
        for posture in postures:
            side = -side
            begin = np.array(posture) * DEG
            begin[joint - 1] = side * BEGIN * DEG
            out.append(Way(here, begin, 90.0 * DEG))
            for speed, span in SPEEDS.items():
                end = begin.copy()
                end[joint - 1] -= side * span * DEG
                out += [Way(begin, end, speed * DEG), Way(end, begin, speed * DEG)]
            here = begin
    return out


def record(robot: Arm, folder: Path) -> Path:
    """Let the arm make the experiment in closed loop and write what its drives saw: measured positions and currents.

    PD with an integral part, so that a held joint stays where it is while another changes its load.
    """
    drive, rng = Drive(robot, HOME), np.random.default_rng([robot.seed, 7])
    every, n = round(1.0 / (RATE * TICK)), robot.truth.robot.n_joints
    rows: list[Floats] = []
    integral, drawn, seconds = np.zeros(n), np.zeros(n), 0.0
    for way in ways():
        level = rng.normal(size=n) * robot.truth.noise.level_std
        for tick in range(every * round(way.seconds * RATE)):
            wanted, speed = way.at(tick * TICK)
            error = wanted - drive.position
            integral = np.clip(integral + 4000.0 * TICK * error, -5.0, 5.0)
            drawn += drive.step(pd(drive, error, speed, k_p=400.0) + SIDE * integral) / every
            seconds += TICK
            if (tick + 1) % every == 0:
                noise = level + rng.normal(size=n) * robot.truth.noise.sample_std
                rows.append(np.concatenate([[round(seconds, 6)], drive.position, drawn + noise]))
                drawn = np.zeros(n)
    return _written(np.array(rows), folder)


def _written(table: Floats, folder: Path) -> Path:
    path = folder / "session_01.parquet"
    current = np.round(table[:, 7:] / 0.0005) * 0.0005
    log = Log("session_01", np.arange(len(table)), table[:, 0], table[:, 1:7], None, current, starts_clock=True)
    write_log(path, [log], recipe())
    return path
