"""Planned motions, and the trapezoids of speed by which an arm makes them in programs, simulations and forecasts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pumaid.errors import Note
from pumaid.maths import Floats
from pumaid.robot import Joint, Robot
from pumaid.units import factor

#: Speed of moves between postures where a joint states no highest speed: rad/s and m/s.
TURNING_SPEED, SLIDING_SPEED = 1.5, 0.25
#: s in which a joint reaches its highest speed.
RAMP_TIME = 0.4
#: Share of a joint's highest speed at which moves between postures are made.
MOVE_SHARE = 0.7
#: s of rest before each run and after each movement.
REST = 0.4
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


@dataclass(frozen=True, slots=True)
class Posture:
    """A set of held positions and why the plan wants it: `serves` names the parameters that it makes visible."""

    joint: int
    hold: tuple[float, ...]
    serves: tuple[str, ...]
    why: str


@dataclass(frozen=True, slots=True)
class Plan:
    """Motions in the order in which they are executed, with the reasons and the forecast."""

    robot: str
    motions: tuple[Motion, ...]
    postures: tuple[Posture, ...] = ()
    expected: dict[str, float] = field(default_factory=dict)  # parameter -> predicted standard error, SI
    unseen: dict[str, str] = field(default_factory=dict)  # parameter -> why no run of this plan shows it
    duration: float = 0.0  # s, moves between the runs included
    seed: int = 0
    # Predicted error of the best conceivable experiment of as much time as a share of this plan's (0..1), if computed.
    efficiency: float | None = None
    assumptions: tuple[str, ...] = ()  # on which the forecast rests
    notes: tuple[Note, ...] = ()


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


def span(joint: Joint) -> tuple[float, float]:
    """Lowest and highest position that a plan gives the joint when it moves, rad or m."""
    usual = (-0.5 * USUAL_TURN, 0.5 * USUAL_TURN) if joint.is_revolute else (0.0, USUAL_SLIDE)
    if joint.limits is None:
        return usual
    low, high = joint.limits
    margin = min(_MARGIN * (high - low), _MOST_TURN if joint.is_revolute else _MOST_SLIDE)
    low, high = low + margin, high - margin
    if not joint.is_revolute or high - low <= WIDEST_TURN:
        return low, high
    # Of more than a turn the part about zero is used, or the part nearest to it.
    centre = min(max(0.0, low + 0.5 * WIDEST_TURN), high - 0.5 * WIDEST_TURN)
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
    between which the speed is kept, the same instant twice where it never is.
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
        first, last = self.ramp + SETTLING, self.duration - self.ramp - SETTLING
        self.cruise = (first, last) if last > first else (0.5 * self.duration,) * 2

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """(N, J) positions and velocities `time` (N,) s after the start."""
        ramp, total = self.ramp, self.duration
        rising, falling = np.clip(time, 0.0, ramp), np.clip(time - (total - ramp), 0.0, ramp)
        cruising = np.clip(time - ramp, 0.0, total - 2.0 * ramp)
        gone = self.peak * (cruising + falling) + 0.5 * self.acceleration * (rising**2 - falling**2)
        direction = (self.end - self.start) / (self.way or 1.0)
        speed = self.acceleration * (rising - falling)
        return self.start + gone[:, None] * direction, speed[:, None] * direction


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
    return float(sum(trapezoid.seconds for trapezoid in trapezoids(robot, plan)))


def cruise(robot: Robot, motion: Motion) -> tuple[tuple[float, float], float]:
    """First and last position between which a run keeps its speed, and for how long (s)."""
    run = run_trapezoid(robot, motion)
    first, last = run.cruise
    begin, end = run.at(np.array([first, last]))[0][:, motion.joint - 1].tolist()
    return (begin, end), last - first
