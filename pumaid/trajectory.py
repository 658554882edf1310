"""Planned motions: trapezoids of speed by which an arm makes runs, and trajectories of all joints through knots."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pumaid.errors import Note
from pumaid.maths import Floats
from pumaid.robot import Joint, Payload, Robot
from pumaid.units import factor

#: Speed of moves between postures where a joint states no highest speed: rad/s and m/s.
TURNING_SPEED, SLIDING_SPEED = 1.5, 0.25
#: s in which a joint reaches its highest speed.
RAMP_TIME = 0.4
#: Share of a joint's highest speed at which moves between postures are made.
MOVE_SHARE = 0.7
#: s of rest before each run and after each movement.
REST = 0.4
#: s about which a part of a trajectory lasts; like a run, it has a level of noise of its own.
PART = 5.0
#: s after a ramp (and before the next) in which a controller's speed still differs from the one that it is told.
SETTLING = 0.06


@dataclass(frozen=True, slots=True)
class Motion:
    """One planned run."""

    joint: int  # the moving one, from 1
    hold: tuple[float, ...]  # (J,) rad or m of all joints; that of the moving joint is ignored
    start: float  # rad or m
    end: float
    velocity: float  # positive, rad/s or m/s
    purpose: str = "fit"  # or "heldout"
    payload: Payload | None = None  # the known load that the last link carries, in its frame as the recipe states it


@dataclass(frozen=True, slots=True)
class Posture:
    """A set of held positions and why the plan wants it: `serves` names the parameters that it makes visible."""

    joint: int
    hold: tuple[float, ...]
    serves: tuple[str, ...]
    why: str


@dataclass(frozen=True, eq=False, slots=True)
class Trajectory:
    """All J joints through K knots, `repeats` times one after another: polynomials of the fifth degree between knots.

    (K,) `time` s rises from 0; (K, J) `position`, `velocity` and `acceleration` in rad or m, and s. It begins and ends
    at rest; what is repeated ends where it begins. `kind` is its form, ``fourier`` or ``picks``, where it has one.

    Source: such polynomials are what the joint_trajectory_controller of ROS 2 drives (control.ros.org), and, from rest
    to rest, the motion of least jerk.
    """

    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    repeats: int = 1
    kind: str = ""

    @property
    def cycle(self) -> float:
        """s from the first knot to the last."""
        return float(self.time[-1])

    @property
    def seconds(self) -> float:
        """s of all repeats."""
        return self.repeats * self.cycle

    def at(self, time: Floats) -> tuple[Floats, Floats, Floats]:
        """(N, J) positions, velocities and accelerations `time` (N,) s after the start; at rest before and after."""
        clipped = np.clip(time, 0.0, self.seconds)
        since = clipped - self.cycle * np.minimum(np.floor(clipped / self.cycle), self.repeats - 1)
        k = np.clip(np.searchsorted(self.time, since, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[k + 1] - self.time[k])[:, None]
        s = (since - self.time[k])[:, None] / h
        way = self.position[k + 1] - self.position[k]
        (v, after), (a, last) = (
            (part[k] * scale, part[k + 1] * scale) for part, scale in ((self.velocity, h), (self.acceleration, h**2))
        )
        c = 10.0 * way - 6.0 * v - 4.0 * after - 1.5 * a + 0.5 * last
        d = -15.0 * way + 8.0 * v + 7.0 * after + 1.5 * a - last
        e = 6.0 * way - 3.0 * (v + after) - 0.5 * (a - last)
        position = self.position[k] + s * (v + s * (0.5 * a + s * (c + s * (d + s * e))))
        speed = (v + s * (a + s * (3.0 * c + s * (4.0 * d + s * 5.0 * e)))) / h
        pull = (a + s * (6.0 * c + s * (12.0 * d + s * 20.0 * e))) / h**2
        is_moving = (time == clipped)[:, None]
        return position, speed * is_moving, pull * is_moving

    def knots(self) -> tuple[Floats, ...]:
        """Times (M,), positions, velocities and accelerations (M, J) of the knots of all repeats."""
        time = np.concatenate([[0.0], *(turn * self.cycle + self.time[1:] for turn in range(self.repeats))])
        parts = (self.position, self.velocity, self.acceleration)
        return time, *(np.concatenate([part[:1], *[part[1:]] * self.repeats]) for part in parts)


@dataclass(frozen=True, slots=True)
class Plan:
    """Motions in the order in which they are executed, or a trajectory, with the reasons and the forecast."""

    robot: str
    motions: tuple[Motion, ...]
    postures: tuple[Posture, ...] = ()
    expected: dict[str, float] = field(default_factory=dict)  # parameter -> predicted standard error, SI
    unseen: dict[str, str] = field(default_factory=dict)  # parameter -> why no run of this plan shows it
    duration: float = 0.0  # s, moves between the runs included
    seed: int = 0
    assumptions: tuple[str, ...] = ()  # on which the forecast rests
    notes: tuple[Note, ...] = ()
    trajectory: Trajectory | None = None  # instead of motions


@dataclass(frozen=True, slots=True)
class NextRun:
    """The runs that would decide between two rivals, in words and as motions; none where no feasible run does."""

    text: str
    motions: tuple[Motion, ...] = ()
    separation: float | None = None  # weighted misfit that the set would show, in standard deviations
    repeats: int | None = None  # how often the set must be run for nine chances in ten


_DEG = factor("deg")
#: rad: span of a turning joint without limits (the paper's), and the widest worth its time. Both are well over half a
#: turn, so that a spring is told from a sinusoid.
USUAL_TURN, WIDEST_TURN = 250.0 * _DEG, 270.0 * _DEG
#: m: span of a sliding joint without limits, from zero.
USUAL_SLIDE = 0.3
#: Highest speeds that a plan asks of a joint, whatever it could: rad/s, m/s.
QUICKEST_TURN, QUICKEST_SLIDE = 1.75, 0.25
#: What stays free at each limit, as a share of the range, and at most: rad, m. Real controllers overshoot.
_MARGIN, _MOST_TURN, _MOST_SLIDE = 0.02, 3.0 * _DEG, 0.01


def span(joint: Joint, about: float = 0.0) -> tuple[float, float]:
    """Lowest and highest position that a plan gives the joint when it moves, rad or m; of many turns those `about`."""
    usual = (-0.5 * USUAL_TURN, 0.5 * USUAL_TURN) if joint.is_revolute else (0.0, USUAL_SLIDE)
    if joint.limits is None:
        return usual
    low, high = joint.limits
    margin = min(_MARGIN * (high - low), _MOST_TURN if joint.is_revolute else _MOST_SLIDE)
    low, high = low + margin, high - margin
    if not joint.is_revolute or high - low <= WIDEST_TURN:
        return low, high
    # Of more than a turn the part about zero (or another place) is used, or the part nearest to it.
    centre = min(max(about, low + 0.5 * WIDEST_TURN), high - 0.5 * WIDEST_TURN)
    return centre - 0.5 * WIDEST_TURN, centre + 0.5 * WIDEST_TURN


def highest_speeds(robot: Robot) -> Floats:
    """(J,) highest speed, rad/s or m/s: the recipe's, or a usual one where the recipe states none."""
    return np.array(
        [joint.max_velocity or (TURNING_SPEED if joint.is_revolute else SLIDING_SPEED) for joint in robot.joints]
    )


def accelerations(robot: Robot) -> Floats:
    """(J,) rad/s2 or m/s2 of all ramps: the highest speed in `RAMP_TIME`."""
    return highest_speeds(robot) / RAMP_TIME


class Trapezoid:
    """All joints from `start` to `end` (J,), rad or m, together, straight in joint space, by one trapezoid of speed.

    Of the joint that goes farthest, over `way`: `speed` (rad/s or m/s), `acceleration`, and the speed that it reaches,
    `peak`, less on a short way. `motion` is the run of the plan, None for a move between postures, `number` that of the
    run, from 1, or of the run to which a move leads. In s: the `ramp` in which the speed rises, and in which it falls,
    the `duration` without rests, the rest before it, `lead`, all together, `seconds`; and from the start `cruise`,
    between which the speed is kept, the same instant twice where it never is. `places` (5, J) are positions on its way.
    """

    def __init__(
        self, start: Floats, end: Floats, *, speed: float, acceleration: float, motion: Motion | None, number: int
    ) -> None:
        self.start, self.end, self.speed, self.acceleration = start, end, speed, acceleration
        self.motion, self.number, self.way = motion, number, float(np.max(np.abs(end - start)))
        self.peak = float(min(speed, np.sqrt(acceleration * self.way)))
        self.ramp = self.peak / acceleration
        self.duration = self.ramp + self.way / self.peak if self.way > 0 else 0.0
        self.lead = 0.0 if motion is None else REST
        self.seconds = self.lead + self.duration + REST
        self.places = np.linspace(start, end, 5)
        first, last = self.ramp + SETTLING, self.duration - self.ramp - SETTLING
        self.cruise = (first, last) if last > first else (0.5 * self.duration,) * 2

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """(N, J) positions and velocities `time` (N,) s after the start."""
        ramp, total = self.ramp, self.duration
        rising, falling = np.clip(time, 0.0, ramp), np.clip(time - (total - ramp), 0.0, ramp)
        cruising = np.clip(time - ramp, 0.0, total - 2.0 * ramp)
        gone = self.peak * (cruising + falling) + 0.5 * self.acceleration * (rising**2 - falling**2)
        direction = (self.end - self.start) / (self.way or 1.0)
        return self.start + gone[:, None] * direction, (self.acceleration * (rising - falling))[:, None] * direction


class TrajectoryPart:
    """Some `seconds` of a trajectory as a movement like a trapezoid; `number` counts them from 1.

    It begins at `first` s of the trajectory, after `lead` s of rest.
    """

    motion = None

    def __init__(self, trajectory: Trajectory, number: int, first: float, *, seconds: float) -> None:
        self.trajectory, self.number, self.first, self.seconds = trajectory, number, max(first, 0.0), seconds
        self.lead = self.first - first
        self.places = trajectory.at(first + np.linspace(0.0, seconds, 5))[0]
        self.start = self.places[0]

    def at(self, time: Floats) -> tuple[Floats, Floats, Floats]:
        """(N, J) positions, velocities and accelerations `time` (N,) s after its start, the rest before it gone."""
        return self.trajectory.at(self.first + time)


def trajectory_parts(trajectory: Trajectory, rate: float) -> list[TrajectoryPart]:
    """A trajectory, and the rests around it, in parts of about `PART` s, whole samples at `rate` (Hz)."""
    samples = math.ceil((trajectory.seconds + 2.0 * REST) * rate)
    edges = np.round(np.linspace(0, samples, max(round(samples / rate / PART), 1) + 1)) / rate - REST
    ends = enumerate(itertools.pairwise(edges.tolist()), start=1)
    return [TrajectoryPart(trajectory, number, first, seconds=last - first) for number, (first, last) in ends]


def in_words(robot: Robot, position: Sequence[float] | Floats, *, moving: int | None = None) -> str:
    """Joint positions (J,) for people, without that of the joint `moving` (from 1): ``90 deg, 0.1 m``."""
    return ", ".join(
        f"{value / _DEG + 0.0:.4g} deg" if joint.is_revolute else f"{value:.4g} m"
        for joint, value in zip(robot.joints, position, strict=True)
        if joint.number != moving
    )


def trapezoids(robot: Robot, plan: Plan) -> Iterator[Trapezoid]:
    """The plan's moves and runs in the order of their execution; the arm begins in the first run's posture."""
    now, highest, rising = None, MOVE_SHARE * highest_speeds(robot), accelerations(robot)
    for number, motion in enumerate(plan.motions, start=1):
        run = run_trapezoid(robot, motion, number)
        way = np.abs(run.start - (run.start if now is None else now))
        if now is not None and np.max(way) > 1e-9:
            # As fast as the slowest joint allows when all arrive together.
            share = np.maximum(way / way.max(), 1e-12)
            speed, acceleration = float(np.min(highest / share)), float(np.min(rising / share))
            yield Trapezoid(now, run.start, speed=speed, acceleration=acceleration, motion=None, number=number)
        yield run
        now = run.end


def run_trapezoid(robot: Robot, motion: Motion, number: int = 1) -> Trapezoid:
    """The movement of one run, `number` being its place in the plan."""
    j = motion.joint - 1
    start = np.array(motion.hold, dtype=float)
    end = start.copy()
    start[j], end[j] = motion.start, motion.end
    return Trapezoid(
        start,
        end,
        speed=motion.velocity,
        acceleration=max(float(accelerations(robot)[j]), motion.velocity / RAMP_TIME),
        motion=motion,
        number=number,
    )


def duration(robot: Robot, plan: Plan) -> float:
    """s that the plan takes, moves between postures and rests included."""
    moved = 0.0 if plan.trajectory is None else plan.trajectory.seconds + 2.0 * REST
    return moved + float(sum(trapezoid.seconds for trapezoid in trapezoids(robot, plan)))


def cruise(robot: Robot, motion: Motion) -> tuple[tuple[float, float], float]:
    """First and last position between which a run keeps its speed, and for how long (s)."""
    run = run_trapezoid(robot, motion)
    first, last = run.cruise
    begin, end = run.at(np.array([first, last]))[0][:, motion.joint - 1].tolist()
    return (begin, end), last - first
