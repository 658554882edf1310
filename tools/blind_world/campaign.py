"""What an arm is told to do: postures, speeds, order, ramps and pauses, drawn by seed, and the reference in time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blind_world.arms import STEP, Arm

Floats = NDArray[np.float64]

#: Speeds of the full design, as shares of the joint's highest, and of the thin one.
FULL_SPEEDS, THIN_SPEEDS = (0.2, 0.38, 0.65, 1.0), (0.35, 1.0)
HELDOUT_SPEEDS = (0.3, 0.8)


@dataclass(frozen=True)
class Stroke:
    """One commanded motion of one joint (from 0) while the others are held; `speed` unsigned, SI."""

    joint: int
    hold: tuple[float, ...]
    start: float
    end: float
    speed: float
    replicate: int
    is_heldout: bool

    @property
    def sign(self) -> float:
        """Direction."""
        return 1.0 if self.end > self.start else -1.0


@dataclass(frozen=True, eq=False)
class Campaign:
    """All strokes in the order of execution, and how they are ramped."""

    strokes: tuple[Stroke, ...]
    ramp: Floats  # (J,) s of acceleration from rest to the joint's highest speed
    is_smooth: bool  # ramps are raised cosines in speed rather than straight
    pauses: Floats  # (R,) s before each


@dataclass(frozen=True, eq=False)
class Reference:
    """The command in time."""

    position: Floats  # (K, J) at every step of the simulation, like the next two
    velocity: Floats
    acceleration: Floats
    begins: Floats  # (R,) s: where each stroke's speed is commanded constant
    ends: Floats
    opens: Floats  # (R,) s: where each stroke starts from and comes to rest
    closes: Floats


def draw_campaign(arm: Arm, *, is_thin: bool) -> Campaign:
    """4 postures x 4 speeds x 2 directions x 2 replicates a joint, or 2 x 2 x 2 x 1; and held-out runs at one more.

    Blocks of one joint at one posture come in random order, all first replicates before all second ones.
    """
    rng = np.random.default_rng([arm.seed, sum(map(ord, arm.kind)), 2, is_thin])
    n_postures, replicates = (2, 1) if is_thin else (4, 2)
    speeds = THIN_SPEEDS if is_thin else FULL_SPEEDS
    spans = [_span(arm, joint, rng) for joint in range(arm.n)]
    shares = [np.array(speeds) * rng.uniform(0.93, 1.07, len(speeds)) for _ in range(arm.n)]
    outside = [np.array(HELDOUT_SPEEDS) * rng.uniform(0.93, 1.07, 2) for _ in range(arm.n)]
    postures = [_postures(arm, joint, rng, n_postures + 1) for joint in range(arm.n)]
    pairs, rounds = [(joint, posture) for joint in range(arm.n) for posture in range(n_postures)], []
    for replicate in range(replicates):
        rounds += [(*pairs[index], replicate) for index in rng.permutation(len(pairs))]
    for joint in range(arm.n):
        rounds.insert(int(rng.integers(0, len(rounds) + 1)), (joint, n_postures, 0))
    strokes: list[Stroke] = []
    for joint, posture, replicate in rounds:
        is_heldout = posture == n_postures
        own = outside[joint] if is_heldout else shares[joint]
        hold = tuple(postures[joint][posture])
        low, high = spans[joint] if rng.random() < 0.5 else spans[joint][::-1]
        for share in rng.permutation(np.minimum(own, 1.0)):
            speed = round(float(share * arm.speed[joint]), 4)
            strokes.append(Stroke(joint, hold, low, high, speed, replicate, is_heldout))
            strokes.append(Stroke(joint, hold, high, low, speed, replicate, is_heldout))
    return Campaign(
        strokes=tuple(strokes),
        ramp=rng.uniform(0.2, 0.45, arm.n),
        is_smooth=bool(rng.random() < 0.5),
        pauses=rng.uniform(0.08, 0.35, len(strokes)),
    )


def _span(arm: Arm, joint: int, rng: np.random.Generator) -> tuple[float, float]:
    """Ends of a joint's strokes, the same in every posture."""
    width = float(arm.high[joint] - arm.low[joint])
    length = rng.uniform(0.55, 0.7) * width if arm.slides[joint] else min(rng.uniform(1.7, 2.2), 0.85 * width)
    low = arm.low[joint] + 0.03 * width + rng.uniform(0.0, 1.0) * (0.94 * width - length)
    return round(float(low), 4), round(float(low + length), 4)


def _postures(arm: Arm, joint: int, rng: np.random.Generator, count: int) -> list[Floats]:
    """Held positions that differ in at least two joints by a fifth of the range."""
    out: list[Floats] = []
    width = arm.high - arm.low
    while len(out) < count:
        one = np.round(arm.low + width * rng.uniform(0.08, 0.92, arm.n), 3)
        far = [np.sum(np.delete(np.abs(one - other), joint) > 0.2 * np.delete(width, joint)) >= 2 for other in out]
        if all(far):
            out.append(one)
    return out


def reference(campaign: Campaign, arm: Arm) -> Reference:
    """The command at every step of the simulation, moves between the strokes included."""
    parts: list[Floats] = []
    marks = []
    at, clock = _before(campaign.strokes[0]), 0
    for stroke, pause in zip(campaign.strokes, campaign.pauses, strict=True):
        first = _before(stroke)
        if np.abs(first - at).max() > 1e-9:
            parts.append(_move(at, first, arm))
            clock += len(parts[-1])
        still = _rest(first, float(pause))
        motion, inner = _stroke(stroke, first, campaign, arm)
        opens = clock + len(still)
        marks.append((opens, opens + inner[0], opens + inner[1], opens + len(motion)))
        clock = opens + len(motion)
        parts += [still, motion]
        at = first.copy()
        at[stroke.joint] = stroke.end
    parts.append(_rest(at, 0.3))
    whole = np.concatenate(parts)
    opens, begins, ends, closes = np.array(marks, dtype=float).T * STEP
    return Reference(whole[:, 0], whole[:, 1], whole[:, 2], begins, ends, opens, closes)


def _before(stroke: Stroke) -> Floats:
    out = np.array(stroke.hold)
    out[stroke.joint] = stroke.start
    return out


def _rest(position: Floats, seconds: float) -> Floats:
    """(K, 3, J)."""
    out = np.zeros((max(1, round(seconds / STEP)), 3, len(position)))
    out[:, 0] = position
    return out


def _move(start: Floats, end: Floats, arm: Arm) -> Floats:
    """(K, 3, J) all joints together, along the polynomial of least jerk."""
    seconds = float(np.max(1.9 * np.abs(end - start) / (0.9 * arm.speed))) + 0.2
    count = max(2, round(seconds / STEP))
    u = (np.arange(count) + 0.5)[:, None] / count
    way, total = (end - start)[None], count * STEP
    place = start + way * (10 * u**3 - 15 * u**4 + 6 * u**5)
    rate = way * (30 * u**2 - 60 * u**3 + 30 * u**4) / total
    return np.stack([place, rate, way * (60 * u - 180 * u**2 + 120 * u**3) / total**2], axis=1)


def _stroke(stroke: Stroke, first: Floats, campaign: Campaign, arm: Arm) -> tuple[Floats, tuple[int, int]]:
    """(K, 3, J) of a trapezoid in speed, and the steps between which its speed is constant."""
    joint, way = stroke.joint, abs(stroke.end - stroke.start)
    ramp = max(0.05, campaign.ramp[joint] * stroke.speed / arm.speed[joint])
    total = way / stroke.speed + ramp  # each ramp covers half of what the constant speed would
    count = round(total / STEP)
    t = np.arange(count) * STEP
    u = np.clip(np.minimum(t, total - t) / ramp, 0.0, 1.0)
    side = np.where(t < total / 2, 1.0, -1.0) * (u < 1.0)
    if campaign.is_smooth:
        share, slope = 0.5 - 0.5 * np.cos(np.pi * u), 0.5 * np.pi * np.sin(np.pi * u)
    else:
        share, slope = u, np.ones(count)
    rate = stroke.sign * stroke.speed * share
    out = np.zeros((count, 3, arm.n))
    out[:, 0] = first
    travelled = np.cumsum(rate) * STEP
    out[:, 0, joint] = stroke.start + travelled * (stroke.end - stroke.start) / travelled[-1]
    out[:, 1, joint] = rate
    out[:, 2, joint] = stroke.sign * stroke.speed * slope * side / ramp
    inner = round(ramp / STEP)
    return out, (inner, count - inner)
