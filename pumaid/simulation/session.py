"""A virtual robot executes a plan in closed loop, logged sample by sample; and the runs that a plan would leave."""

import math
from collections.abc import Iterator

import numpy as np

from pumaid.dataset import Bins, Log, Run, finite_means
from pumaid.errors import ModelError, Where
from pumaid.maths import Counts, Floats
from pumaid.robot import Robot
from pumaid.simulation.hidden_effects import AMBIENT, RISE, WARMING_TIME, ArmState, JointState, Kind, acted, delays
from pumaid.simulation.mujoco_engine import RigidArm
from pumaid.simulation.virtual_robot import Truth, draw
from pumaid.trajectory import (
    MOVE_SHARE,
    Plan,
    TrajectoryPart,
    Trapezoid,
    highest_speeds,
    trajectory_parts,
    trapezoids,
)

#: Hz of a log: slower, and a run of a few seconds would leave a sample or none; no drive that is logged is faster.
SLOWEST, FASTEST = 1.0, 1000.0
#: Hz: the controller works at the log's rate, but not slower than this; slower ones let the speed waver.
CONTROL = 250.0
#: degC: resolution of the motors' temperatures.
_TEMPERATURE_STEP = 0.1
#: rad or m, A: an arm that is farther away, or a motor that draws more, is not held by its controller.
_FARTHEST, _MOST = 1e3, 1e6
#: Gains of (34): 1/s2 and 1/s, K_D = 2 sqrt(K_P). Within a `NEAR`th of a second's way of its target a joint leaves its
#: speed and creeps in.
K_P, K_D = 400.0, 40.0
NEAR = K_P / K_D
#: J of (35) as a share of the inertia; A that the encoder's steps may leave in the current (the paper, too, tunes J for
#: a calm current); s over which the compensator averages the load for it at most, and periods at least.
SHARE, CALM, LONGEST, FEWEST = 0.7, 0.01, 0.02, 2.0
#: rad and m: a joint that rests so near its target is in position, and its drive asks for no more.
TURN_WINDOW, SLIDE_WINDOW = 1e-3, 2.5e-4


def simulate(
    robot: Robot,
    plan: Plan,
    *,
    seed: int = 0,
    truth: Truth | None = None,
    rate: float = 250.0,
    runs_per_file: int = 40,
    has_velocity: bool = True,
    has_temperature: bool = False,
) -> Iterator[Log]:
    """A virtual robot executes a plan, motion by motion, and logs what a real one would.

    It goes to each motion's start with all joints at once, rests, runs, rests, in closed loop under the controller of
    the paper's experiment; a trajectory it follows, in movements of some seconds. Logs come in order of time, one a
    movement; those of one file share their `origin`.

    The virtual robot `truth` is drawn from the seed where not given; `rate` is in samples a second, 1 to 1000. A log
    has temperatures also where something hidden depends on them.

    Raises
    ------
    ModelError [plan-misfit], [rate-impossible]
        The plan is for another number of joints; the rate is none.
    ModelError [simulation-diverged]
        While the logs are read: the controller does not hold this arm.
    """
    if not SLOWEST <= rate <= FASTEST:
        raise ModelError(
            "rate-impossible",
            f"a log cannot have {rate:g} samples a second",
            mend=f"give a rate of {SLOWEST:g} to {FASTEST:g} Hz",
        )
    held = [motion.hold for motion in plan.motions] if plan.trajectory is None else plan.trajectory.position
    if wrong := {len(posture) for posture in held} - {robot.n_joints}:
        raise ModelError(
            "plan-misfit",
            f"the plan is for {min(wrong)} joints; {robot.name} has {robot.n_joints}",
            mend="take a plan made for this robot: pumaid plan",
        )
    truth = draw(robot, seed) if truth is None else truth
    return _Session(truth, plan, rate, seed=seed, has_temperature=has_temperature).logs(
        runs_per_file, has_velocity=has_velocity
    )


class Controller:
    """Load compensators with acceleration feedback, one for each of J joints.

    Wanted acceleration (34) K_D (-v + V (K_P/K_D) (target - q)), V (36) such that the part in brackets stays within a
    speed limit; a target that moves adds its speed and acceleration. Current (35) J (wanted) + load. The paper's load
    is i(t-dt) - J (v(t) - v(t-dt)) / dt with v(t) = (q(t) - q(t-dt)) / dt of encoder readings; here it is that,
    averaged by a filter of the second order that follows a steady change without lag, over as short a time as leaves
    the current calm. Its `position` (J,) is that of the encoders, rad or m, its `velocity` (J,) as the drives know it,
    its `current` (J,) in A.
    """

    def __init__(self, truth: Truth, *, period: float) -> None:
        n, counts = truth.robot.n_joints, truth.noise.counts
        counts = np.zeros(n) if counts is None else counts
        self._counts = np.where(counts > 0, counts, 1e12)
        self._window = np.where(truth.robot.is_revolute, TURN_WINDOW, SLIDE_WINDOW)
        self._holding = MOVE_SHARE * highest_speeds(truth.robot)
        self._period, self._rate = period, 1.0 / period
        self.position = self.velocity = self.current = self._load = self._rise = np.zeros(n)
        self.tune(np.zeros(n))

    def tune(self, inertia: Floats) -> None:
        """Take J from the inertia (J,) A s2/rad or A s2/m that the motors move, as they count."""
        self._inertia, self._wanting = SHARE * inertia * self._rate, SHARE * inertia * K_D
        # Two readings, each wrong by a uniform part of a count, put J (K_D + 2/T) times their speed into the current.
        shortest = FEWEST * self._period
        unrest = np.abs(SHARE * inertia) * np.sqrt(1.0 / 6.0) / (self._counts * self._period)
        calm = np.maximum(CALM / np.maximum(unrest, 1e-12) - K_D, 1e-6)
        share = np.minimum(1.0, self._period / np.clip(2.0 / calm, shortest, max(LONGEST, shortest)))
        self._level, self._trend = 1.0 - (1.0 - share) ** 2, share**2

    def start(self, position: Floats, current: Floats) -> None:
        """An arm at rest at `position` (J,), its motors drawing `current` (J,)."""
        self.position, self.velocity = self.read(position), np.zeros_like(position)
        self._load, self._rise, self.current = current.copy(), np.zeros_like(current), current.copy()

    def read(self, position: Floats) -> Floats:
        """What the encoders tell of `position` (..., J)."""
        return np.rint(position * self._counts) / self._counts

    def targets(self, movement: Trapezoid | TrajectoryPart, count: int) -> tuple[Floats, Floats, Floats]:
        """(count, J) targets, speed limits and speeds ahead, period by period, of a movement with the rests around it.

        A run's limit is the trapezoid's speed until it has fallen to where a joint creeps in by itself. Ahead goes what
        a trajectory moves at, with its acceleration in K_D.
        """
        since = np.asarray(np.arange(count) * self._period - movement.lead, dtype=float)[:, None]
        if isinstance(movement, TrajectoryPart):
            target, speed, acceleration = movement.at(since[:, 0])
            return target, np.full_like(target, np.inf), speed + acceleration / K_D
        falling = np.maximum(movement.duration - since, 2.0 / NEAR)
        moves = (since >= 0.0) & (movement.start != movement.end)
        share = np.abs(movement.end - movement.start) / (movement.way or 1.0)
        allowed = share * np.minimum(movement.speed, movement.acceleration * np.minimum(since, falling))
        limits = np.where(moves, allowed, self._holding)
        return np.where(since >= 0.0, movement.end, movement.start), limits, np.zeros_like(limits)

    def command(self, position: Floats, target: Floats, *, limit: Floats, ahead: Floats) -> Floats:
        """(J,) A for the next period of motors that stand at `position` (J,) and shall go to `target` (J,).

        `limit` (J,) is the highest speed now, V_max, `ahead` (J,) what a moving target adds to the speed.
        """
        q = self.read(position)
        v = (q - self.position) * self._rate
        load, rise = self._load, self._rise
        load += rise
        miss = self.current - self._inertia * (v - self.velocity) - load
        load += self._level * miss
        rise += self._trend * miss
        error = target - q
        reach = np.minimum(np.maximum(NEAR * error, -limit), limit) + ahead
        inside = (np.abs(error) <= self._window) & (ahead == 0.0)
        if inside.any():
            reach[inside] = 0.0
            rise[inside & (v == 0.0)] = 0.0
        self.position, self.velocity = q, v
        self.current = self._wanting * (reach - v) + load
        return self.current


class _Session:
    """A virtual robot at work."""

    def __init__(self, truth: Truth, plan: Plan, rate: float, *, seed: int, has_temperature: bool) -> None:
        self._truth, self._rng, self._rate = truth, np.random.default_rng([seed, 2]), rate
        self._has_temperature = has_temperature or truth.hides("thermal_friction")
        n = truth.robot.n_joints
        self._movements: list[Trapezoid | TrajectoryPart] = [*trapezoids(truth.robot, plan)]
        if plan.trajectory is not None:
            self._movements += trajectory_parts(plan.trajectory, rate)
        # Every movement, with its rests, is a whole number of samples.
        self._counts = [max(1, math.ceil(movement.seconds * rate - 1e-9)) for movement in self._movements]
        lengths = np.array(self._counts) / rate
        starts = np.cumsum(lengths) - lengths + [movement.lead for movement in self._movements]
        self._first = first_starts(plan, starts[[step.motion is not None for step in self._movements]], n_joints=n)
        self._delays = delays(truth.hidden, n)
        self._late = np.zeros((0, n))
        self._noise, settled = self._rng.standard_normal(n), self._rng.uniform(-1.0, 1.0, n)
        self._ticks = math.ceil(CONTROL / rate - 1e-9)
        period = 1.0 / (rate * self._ticks)
        self._arm = RigidArm(truth, step=period)
        self._controller = Controller(truth, period=period)
        self._arm.state.first = self._first
        self._arm.place(self._movements[0].start)
        self._controller.start(self._arm.reading, self._arm.load + 0.8 * settled * truth.coulomb)
        held = [motion.hold for motion in plan.motions] if plan.trajectory is None else plan.trajectory.position
        self._usual = np.sqrt(np.mean(truth.gravity_current(np.array(held, dtype=float)) ** 2, axis=0)) + truth.coulomb

    def logs(self, runs_per_file: int, *, has_velocity: bool) -> Iterator[Log]:
        """Samples of one movement after the other; `origin` names the file."""
        sample, row, origin, truth, noise = 0, 2, "", self._truth, self._truth.noise
        n, step = len(noise.std), noise.current_step
        for movement, count in zip(self._movements, self._counts, strict=True):
            name = f"session_{(movement.number - 1) // runs_per_file + 1:02d}"
            row, origin = (row, origin) if name == origin else (2, name)
            with np.errstate(all="ignore"):  # what overflows is told below, once
                position, velocity, current, temperature = self._execute(movement, count)
            time = np.round((sample + np.arange(count)) / self._rate, 9)
            far = ~(np.abs(position) <= _FARTHEST) | ~(np.abs(current) <= _MOST)
            if far.any():
                k, j = np.argwhere(far)[0].tolist()
                raise ModelError(
                    "simulation-diverged",
                    f"joint {j + 1} ({truth.robot.joint(j + 1).name}) ran away at {time[k]:.3g} s of {origin}",
                    Where(joint=j + 1),
                    "make smaller what is out of proportion: hidden effects, or coupling",
                )
            arm = ArmState(time, self._first, position, velocity, *[np.zeros_like(current)] * 3)
            joints = [JointState(arm, j + 1, 1.0) for j in range(n)]
            bent = [acted(truth.hidden, joint, Kind.CURRENT, current=current[:, joint.joint - 1]) for joint in joints]
            levels = noise.level_std * self._rng.standard_normal(n)
            series = noise.series(self._rng, (count, n), rate=self._rate, start=self._noise)
            self._noise = series[-1]
            current = self._delayed(np.column_stack(bent)) + noise.sample_std * series + levels
            yield Log(
                origin=origin,
                rows=np.arange(row, row + count, dtype=np.int64),
                time=time,
                position=position,
                # Rounded so that the bytes of a log do not depend on how a machine orders its additions.
                velocity=np.round(velocity, 9) if has_velocity else None,
                current=np.round(current / step) * step if step > 0 else current,
                temperature=np.round(temperature, 6) if self._has_temperature else None,
                starts_clock=sample == 0,
            )
            sample, row = sample + count, row + count

    def _execute(self, movement: Trapezoid | TrajectoryPart, count: int) -> tuple[Floats, Floats, Floats, Floats]:
        arm, controller, state, n = self._arm, self._controller, self._arm.state, self._truth.robot.n_joints
        ticks = self._ticks
        targets, limits, ahead = controller.targets(movement, count * ticks)
        # Tuned for where the arm is lightest: too large a J swings, too small a one only lags.
        controller.tune(self._truth.gain * np.min([arm.felt_inertia(place) for place in movement.places], axis=0))
        out, currents = np.zeros((3, count, n)), np.zeros((count * ticks + 2, n))
        currents[0] = controller.current
        warming = -np.expm1(-arm.step / WARMING_TIME) if self._has_temperature else 0.0
        for tick in range(count * ticks):
            current = controller.command(arm.reading, targets[tick], limit=limits[tick], ahead=ahead[tick])
            currents[tick + 1] = current
            if tick % ticks == 0:
                out[:, tick // ticks] = controller.position, controller.velocity, state.temperature
            arm.advance(current)
            if warming:
                wanted = AMBIENT + RISE * (current / self._usual) ** 2
                state.temperature = state.temperature + warming * (wanted - state.temperature)
        currents[-1] = currents[-2]
        # A sensor averages: over the periods before and after the instant.
        drawn = 0.25 * (currents[:-2] + 2.0 * currents[1:-1] + currents[2:])[::ticks]
        position, velocity, temperature = out
        return position, velocity, drawn, np.round(temperature / _TEMPERATURE_STEP) * _TEMPERATURE_STEP

    def _delayed(self, current: Floats) -> Floats:
        longest = int(np.ceil(np.max(self._delays) * self._rate)) + 1
        before = self._late if len(self._late) else np.tile(current[:1], (longest, 1))
        joined, out = np.concatenate([before, current]), current.copy()
        places = len(before) + np.arange(len(current))
        for j in np.flatnonzero(self._delays):
            out[:, j] = np.interp(places - self._delays[j] * self._rate, np.arange(len(joined)), joined[:, j])
        self._late = joined[-longest:]
        return out


def constant_run(movement: Trapezoid, local: Floats, count: Counts, *, start: float = 0.0, first_row: int = 2) -> Run:
    """The run that a movement leaves which begins at `start` s, without currents and temperatures.

    It is sampled at `local` (N,) s from its start, `count` (M,) of the samples being in each bin.
    """
    motion, position = movement.motion, movement.at(local)[0]
    assert motion is not None, "a move between postures is no run"
    j, speed = motion.joint - 1, movement.peak * float(np.sign(motion.end - motion.start))
    starts, nothing = np.cumsum(count) - count, np.zeros(len(count))
    time = finite_means(start + local, starts)
    posture = np.array(motion.hold, dtype=float)
    mean_position = np.tile(posture, (len(count), 1))
    mean_position[:, j] = finite_means(position[:, j], starts)
    posture[j] = np.nan
    speeds, unknown = np.full(len(count), speed), np.full(len(count), np.nan)
    return Run(
        joint=motion.joint,
        kind="constant",
        origin="bench",
        first_row=first_row,
        last_row=first_row + len(local) - 1,
        start=float(time[0]),
        duration=float(time[-1] - time[0]),
        posture=posture,
        span=(float(position[0, j]), float(position[-1, j])),
        speed=speed,
        ripple=0.0,
        temperature=np.nan,
        samples=len(local),
        bins=Bins(count, time, mean_position, speeds, nothing, nothing, nothing, unknown),
        heldout=motion.purpose == "heldout",
    )


def first_starts(plan: Plan, starts: Floats, *, n_joints: int) -> Floats:
    """(J,) s at which each joint's first run begins, of runs that begin at `starts`; the first of all if none."""
    out = np.full(n_joints, starts[0] if len(starts) else 0.0)
    for motion, start in zip(reversed(plan.motions), starts[::-1], strict=True):
        out[motion.joint - 1] = start
    return out
