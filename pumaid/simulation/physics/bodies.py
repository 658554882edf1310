"""A session with rigid-body dynamics: one stretch after the other in MuJoCo, under the same controller."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import ModelError, Where
from pumaid.simulation.heat import AMBIENT, RISE, TIME_CONSTANT, Heat
from pumaid.simulation.physics.drive import Drive, control_rate
from pumaid.simulation.physics.forces import Forces
from pumaid.simulation.physics.joints import motor_inertia
from pumaid.simulation.physics.march import Course, Orders
from pumaid.simulation.physics.rigid import Rigid
from pumaid.simulation.timing import Stretch
from pumaid.simulation.truth import Truth
from pumaid.trajectory import MOVE_SHARE, highest_speeds

Floats = NDArray[np.float64]

#: s: longest step of the engine, which looks at the arm where a step begins: half a step of lag.
ENGINE_STEP = 0.0005
#: Hidden effects that no force at a joint stands for: a link that stands elsewhere, a mass that comes and moves.
REFUSED = ("flexibility", "payload", "zero_offset")


class Bodies:
    """A robot of rigid bodies that executes a session.

    The links push each other, what a ramp must accelerate follows the posture, and the controller's J is tuned for the
    mean of the plan's postures. Hidden loads and hidden friction act as forces at the joints.

    Parameters
    ----------
    truth
        A robot with masses and gains.
    first
        (J,) s at which each joint's first run begins.
    rate
        Samples a second.
    postures
        (K, J) of the plan.

    Raises
    ------
    ModelError [physics-wrong]
        MuJoCo is not installed, the robot has no masses, or something hidden is no force at a joint.
    """

    def __init__(self, truth: Truth, first: Floats, *, rate: float, postures: Floats) -> None:
        for one in truth.hidden:
            if one.effect in REFUSED:
                what = f"{one.effect} is no force at a joint, and rigid-body physics cannot hide it"
                raise ModelError("physics-wrong", what, Where(field=f"--hide {one.effect}"), "use the built-in physics")
        self._truth, self._first, self._rate = truth, first, rate
        self._ticks, self._parts = control_rate(rate)
        self._tick = 1.0 / (rate * self._ticks)
        step = self._tick / max(1, int(np.ceil(self._tick / ENGINE_STEP - 1e-9)))
        # The motors' own inertia, what is hidden of it included.
        self._arm = Rigid(replace(truth, inertia=motor_inertia(truth)), step=step)
        assert truth.gain is not None
        self.inertia = truth.gain * np.mean([np.diag(self._arm.inertia(place)) for place in postures], axis=0)
        self._drive = Drive(self.inertia, truth.noise.counts, truth.robot.is_revolute, step=self._parts * self._tick)
        self._holding = MOVE_SHARE * highest_speeds(truth.robot)

    def courses(self, stretches: Sequence[Stretch], settled: Floats, heat: Heat | None) -> Iterator[Course]:
        """What the arm does, stretch by stretch; `settled` (J,) -1..1 is where in its stiction each joint begins.

        Parameters
        ----------
        stretches
            The session.
        settled
            (J,).
        heat
            The cold motors, where something hidden depends on them.
        """
        start, clock = np.array([path.start for path in stretches[0].paths]), 0.0
        warmth = np.full(len(start), AMBIENT)
        self._arm.place(start)
        self._drive.start(start[None], (self._arm.load + 0.8 * settled * self._truth.coulomb)[None])
        for stretch in stretches:
            course = self._stretch(stretch, clock, warmth)
            yield course
            seconds = stretch.samples(self._rate) / self._rate
            clock += seconds
            if heat is not None:
                wanted = AMBIENT + RISE * np.mean(course.current**2, axis=0) / heat.usual**2
                warmth = wanted + np.exp(-seconds / TIME_CONSTANT) * (warmth - wanted)

    def _stretch(self, stretch: Stretch, clock: float, warmth: Floats) -> Course:
        count, step = stretch.samples(self._rate), self._parts * self._tick
        joint = np.array([0 if stretch.motion is None else stretch.motion.joint])
        forces = Forces(self._truth, self._first, begin=np.array([clock]), alone=joint, step=step, with_weight=False)
        forces.start(self._arm.position[None], (warmth[None], np.zeros((1, len(warmth)))))
        orders, rows = Orders.of([stretch]), []
        before = current = load = dry = np.zeros(len(warmth))
        for tick in range(count * self._ticks):
            q, v = self._arm.position[None], self._arm.velocity[None]
            if tick % self._parts == 0:
                target, limit = orders.at(tick * self._tick, self._holding, 1)
                before = self._drive.current[0].copy()
                current = self._drive.command(q, target, limit)[0].copy()
                load, dry = self._acting(forces, tick // self._parts, q + 0.5 * step * v, v)
            if tick % self._ticks == 0:
                rows.append((q[0], self._drive.velocity[0].copy(), 0.5 * (before + current)))
            self._arm.advance(current - load, self._tick, dry=dry)
        return Course(*(np.array(column) for column in zip(*rows, strict=True)))

    def _acting(self, forces: Forces, period: int, position: Floats, velocity: Floats) -> tuple[Floats, Floats]:
        """(J,) A of hidden loads and of hidden dry friction, positive where it is friction."""
        push = (self._drive.current - self._arm.load) / self.inertia
        load, against = forces.at(period, position, velocity, push=push)
        if against is None:
            return load[0], np.zeros_like(load[0])
        ahead = np.where(velocity[0] == 0.0, push[0], velocity[0]) > 0.0
        return load[0], np.where(ahead, 1.0, -1.0) * np.sign(self.inertia) * against[0]
