"""Plan an experiment that shows every parameter that the arm has."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Faults, ModelError, Note, PumaidError, Where
from pumaid.maths.frames import axes
from pumaid.records import Motion, Plan, Posture, Robot
from pumaid.structure import Structure, minimal
from pumaid.units import factor, number
from pumaid.virtual.draw import draw
from pumaid.virtual.forecast import forecast, gravity_names
from pumaid.virtual.postures import Choice, choose
from pumaid.virtual.ranges import span
from pumaid.virtual.timetable import Block, timetable
from pumaid.virtual.timetable import speeds as speeds_of
from pumaid.virtual.timing import duration, highest_speeds
from pumaid.virtual.truth import Noise

Floats = NDArray[np.float64]

#: Shares of a joint's highest speed at which runs are fitted: the first where time is no matter; a budget may take any
#: (the slowest runs take most of the time).
SHARES = ((0.1, 0.3, 0.55, 0.85), (0.1, 0.45, 0.85), (0.15, 0.5, 0.95), (0.25, 0.6, 0.95))
#: Postures and replicates where neither user nor budget says otherwise.
POSTURES, REPLICATES = 3, 2
#: What a budget may choose from.
_POSTURES, _MOST_REPLICATES = (2, 3, 4), 20
#: Robots drawn from the recipe for which the choice and the forecast are made.
_ASSUMED = 4
#: A, noise of a sample, a fifth of its variance being a level that a run shares; a usual arm's.
_NOISE = 0.02
#: Samples a second that the forecast assumes.
_RATE = 100.0
#: A standard error above this share of a ratio leaves it in the dark.
_WEAK = 0.5


@dataclass(frozen=True, slots=True)
class _Size:
    """How much is done: postures and replicates a joint, shares of the highest speed."""

    postures: int
    replicates: int
    shares: tuple[float, ...]


def plan(
    robot: Robot,
    *,
    minutes: float | None = None,
    speeds: Sequence[float] | None = None,
    postures_per_joint: int | None = None,
    replicates: int | None = None,
    seed: int = 0,
) -> Plan:
    """Plan runs that show every parameter which the arm has, within its limits.

    Postures are chosen by what they tell (`pumaid.virtual.postures.choose`) on several robots drawn from the recipe;
    every joint runs over its span at three or more speeds, both ways, in each; each replicate is a pass of its own over
    all joints, so that replicates lie far apart in time; blocks follow in random order. A posture and two speeds a
    joint are kept for judging only (``heldout``).

    Parameters
    ----------
    robot
        Geometry, limits, highest speeds.
    minutes
        Time that the robot may take; of all sizes that fit the one with the smallest predicted standard errors
        (geometric mean) is taken.
    speeds
        Shares of each joint's highest speed, above 0 and at most 1, three or more.
    postures_per_joint
        3 where neither this nor `minutes` is given. Joints that carry no weight get two.
    replicates
        2 where neither this nor `minutes` is given.
    seed
        Same seed, same plan.

    Returns
    -------
    plan
        Motions with purpose, postures with their reasons, expected standard errors, what stays unseen, duration.

    Raises
    ------
    ModelError [plan-too-short]
        The least experiment that shows everything takes longer than `minutes`.
    ModelError [plan-impossible]
        Fewer than three speeds, a speed out of range, less than one posture or replicate.

    Source
    ------
    S.-K. Lin, on persistently exciting runs; Corollary 4 for what exists.

    Examples
    --------
    >>> from pumaid.virtual import table1
    >>> experiment = plan(table1.robot(), seed=1)
    >>> experiment.unseen["gravity.l1.x"][:20]
    'joint 1 (waist) turn'
    """
    _check(minutes, speeds, (postures_per_joint, replicates))
    drafts = _Drafts(robot, seed)
    if minutes is None:
        size = _Size(postures_per_joint or POSTURES, replicates or REPLICATES, tuple(speeds or SHARES[0]))
        return drafts.finished(size)
    share_sets = [tuple(speeds)] if speeds else list(SHARES)
    counts = [postures_per_joint] if postures_per_joint else _POSTURES
    sizes = [_Size(count, 1, shares) for count in counts for shares in share_sets]
    return drafts.finished(_fitting(drafts, sizes, 60.0 * minutes, replicates))


class _Drafts:
    """Plans of different sizes for one robot, and what each would tell."""

    def __init__(self, robot: Robot, seed: int) -> None:
        self.robot, self.seed = robot, seed
        self.structure: Structure = minimal(robot)
        self.names = _existing(robot, self.structure)
        noise = Noise(np.full(robot.n_joints, _NOISE))
        self.truths = [replace(draw(robot, 1000 * seed + k), noise=noise) for k in range(_ASSUMED)]
        self._chosen: dict[int, list[Choice]] = {}

    def choices(self, postures: int) -> list[Choice]:
        """Postures of every joint, the same whenever asked."""
        if postures not in self._chosen:
            rng = np.random.default_rng([self.seed, 3])
            self._chosen[postures] = choose(self.truths, names=self.names, count=postures, rng=rng)
        return self._chosen[postures]

    def motions(self, size: _Size) -> tuple[Motion, ...]:
        """The timetable of a plan of this size."""
        passes: list[list[Block]] = [[] for _ in range(size.replicates)]
        rng = np.random.default_rng([self.seed, 4])
        for choice in self.choices(size.postures):
            fitted = speeds_of(self.robot, choice.joint, size.shares)
            judged = speeds_of(self.robot, choice.joint, _between(size.shares)[: size.replicates])
            for blocks in passes:
                ends = (place % 2 == 1 for place in range(len(choice.fitted)))
                blocks += [
                    Block(choice.joint, hold, fitted, is_high=end)
                    for hold, end in zip(choice.fitted, ends, strict=True)
                ]
            late = int(rng.integers(size.replicates))
            passes[late].append(Block(choice.joint, choice.heldout, judged, purpose="heldout"))
        return timetable(self.robot, passes, rng)

    def errors(self, motions: Sequence[Motion]) -> dict[str, float]:
        """Predicted standard errors, the median over the assumed robots; a parameter that any of them hides is out."""
        each = [forecast(truth, motions, names=self.names, rate=_RATE).std_errors() for truth in self.truths]
        return {
            name: float(np.median([found[name] for found in each])) for name in each[0] if all(name in e for e in each)
        }

    def finished(self, size: _Size) -> Plan:
        """The plan of this size with its reasons and its forecast."""
        motions = self.motions(size)
        expected = self.errors(motions)
        unseen = dict(self.structure.absent)
        unseen |= {f"gain_ratio.{i}.{j}": why for (i, j), why in self.structure.redundant.items()}
        unseen |= {name: "no run of this plan shows it" for name in self.names if name not in expected}
        draft = Plan(
            robot=self.robot.name,
            motions=motions,
            postures=tuple(itertools.chain(*(_reasons(self.robot, choice) for choice in self.choices(size.postures)))),
            expected=expected,
            unseen=unseen,
            seed=self.seed,
            assumptions=_assumptions(self.robot),
            notes=self._notes(expected),
        )
        return replace(draft, duration=duration(self.robot, draft))

    def _notes(self, expected: dict[str, float]) -> tuple[Note, ...]:
        """How much weight the last link must have off its axis for the last ratio to be seen."""
        n = self.robot.n_joints
        name = f"gain_ratio.{n - 1}.{n}"
        if name not in expected or not self.robot.joint(n).is_revolute:
            return ()
        needed = []
        for truth in self.truths:
            assert truth.links is not None
            off_axis = float(truth.links.mass[-1] * np.linalg.norm(truth.links.centre[-1, :2]))
            needed.append(off_axis * expected[name] / (_WEAK * abs(truth.parameters()[name])))
        text = (
            f"{name} is seen only if link {n} carries enough off its axis: about {number(float(np.median(needed)), 2)}"
            f" kg m (mass times distance) for an error of half its value; a bare flange often has less"
        )
        return (Note("plan-needs-weight", text, Where(joint=n)),)


def _fitting(drafts: _Drafts, sizes: Sequence[_Size], seconds: float, replicates: int | None) -> _Size:
    """Of the sizes that fit into the time the one that tells most; two replicates before anything else.

    Replicates multiply a plan's information and, but for the held-out runs, its time.
    """
    ranked, shortest = [], math.inf
    for size in sizes:
        motions = drafts.motions(size)
        whole = _seconds(drafts.robot, motions)
        once = _seconds(drafts.robot, [motion for motion in motions if motion.purpose == "fit"])
        shortest = min(shortest, whole + ((replicates or 1) - 1) * once)
        most = 1 + math.floor((seconds - whole) / once)
        counts = [replicates] if replicates else range(1, min(most, _MOST_REPLICATES) + 1)
        error = float(np.mean(np.log(list(drafts.errors(motions).values())))) if most >= 1 else math.inf
        for count in counts:
            # Rounded: of sizes that tell the same the first is taken, on every machine.
            key = (count < REPLICATES, round(error - 0.5 * math.log(count), 6))
            ranked.append((key, replace(size, replicates=count)))
    for _, size in sorted(ranked, key=lambda item: item[0]):
        if _seconds(drafts.robot, drafts.motions(size)) <= seconds:
            return size
    raise ModelError(
        "plan-too-short",
        f"{number(seconds / 60.0)} minutes are too short: the least experiment that shows everything takes"
        f" {math.ceil(shortest / 6.0) / 10.0:g} minutes",
        mend=f"give --minutes {math.ceil(shortest / 60.0)} or more, or fewer postures, replicates or faster speeds",
    )


def _seconds(robot: Robot, motions: Sequence[Motion]) -> float:
    return duration(robot, Plan(robot=robot.name, motions=tuple(motions)))


def _between(shares: Sequence[float]) -> tuple[float, float]:
    """Two speeds for judging that no fitted run has: between the fastest two and between the slowest two."""
    rising = sorted(set(shares))
    return math.sqrt(rising[-2] * rising[-1]), math.sqrt(rising[0] * rising[1])


def _existing(robot: Robot, structure: Structure) -> list[str]:
    redundant = {f"gain_ratio.{i}.{j}" for i, j in structure.redundant}
    return [name for name in gravity_names(robot) if name not in structure.absent and name not in redundant]


def _check(minutes: float | None, shares: Sequence[float] | None, counts: tuple[int | None, int | None]) -> None:
    faults: list[PumaidError] = []
    if minutes is not None and not (math.isfinite(minutes) and minutes > 0):
        faults.append(ModelError("plan-impossible", f"{minutes:g} minutes is no time", mend="give a positive number"))
    if shares is not None and len(set(shares)) < 3:
        mend = "give three or more: fewer cannot tell whether friction grows evenly with speed"
        faults.append(ModelError("plan-impossible", f"{len(set(shares))} different speeds are too few", mend=mend))
    for share in shares or ():
        if not 0.0 < share <= 1.0:
            mend = "give shares above 0 and at most 1, such as 0.1,0.3,0.8"
            faults.append(ModelError("plan-impossible", f"{share:g} is no share of a highest speed", mend=mend))
    for what, count in zip(("postures", "replicates"), counts, strict=True):
        if count is not None and count < 1:
            faults.append(ModelError("plan-impossible", f"{count} {what} show nothing", mend="give 1 or more"))
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)


def _reasons(robot: Robot, choice: Choice) -> list[Posture]:
    """Each posture with what it is for, in the user's words."""
    name = f"joint {choice.joint} ({robot.joint(choice.joint).name})"
    out = []
    for place, (hold, serves) in enumerate(zip(choice.fitted, choice.serves, strict=True)):
        if not choice.wanted:
            why = f"{name} carries no weight that can be told from friction: its runs are for friction"
            why += "" if place == 0 else ", here to see whether the posture changes it"
        elif serves:
            why = f"{_stance(robot, choice.joint, hold)}; without it {_loss(serves)}"
        else:
            why = f"{_stance(robot, choice.joint, hold)}; the load differs from that of the other postures"
        out.append(Posture(choice.joint, tuple(hold.tolist()), tuple(serves), why))
    judged = f"{name} is judged here, at speeds and in a posture that no fit has seen"
    return [*out, Posture(choice.joint, tuple(choice.heldout.tolist()), (), judged)]


def _loss(serves: dict[str, float]) -> str:
    """What would be lost without a posture, worst first."""
    dark = [name for name, rise in serves.items() if math.isinf(rise)]
    worse = sorted(((rise, name) for name, rise in serves.items() if not math.isinf(rise)), reverse=True)
    told = []
    if dark:
        # One posture shows the sum of several loads; it takes another to divide it among them.
        listed = ", ".join(dark[:-1]) + (" and " if len(dark) > 1 else "") + dark[-1]
        told.append(f"{listed} could not be told {'apart' if len(dark) > 1 else 'at all'}")
    if worse:
        told.append(f"the error of {', '.join(f'{name} would be {rise:.2g} times' for rise, name in worse)} as large")
    return "; ".join(told)


def _stance(robot: Robot, joint: int, hold: Floats) -> str:
    axis = axes(robot.alphas, robot.dh_angles(hold[None]))[0, joint - 1, :, 2]
    gravity = np.asarray(robot.gravity)
    size = float(np.linalg.norm(gravity)) or 1.0
    tilt_deg = math.acos(min(1.0, abs(float(axis @ gravity)) / size)) / factor("deg")
    return f"the axis of joint {joint} stands {tilt_deg:.0f} deg from the direction of gravity"


def _assumptions(robot: Robot) -> tuple[str, ...]:
    told = [
        f"Noise of {_NOISE:g} A a sample, a fifth of its variance a level of each run; {_RATE:g} samples a second.",
        f"Masses, centres of mass and gains as of {_ASSUMED} robots drawn from the geometry; errors are their median.",
        "Ramps reach the highest speed in 0.4 s. Collisions are not checked: look at each posture before it is run.",
    ]
    for joint in robot.joints:
        unit = "deg" if joint.is_revolute else "m"
        if joint.limits is None:
            low, high = (end / factor(unit) for end in span(joint))
            told.append(f"Joint {joint.number} ({joint.name}) states no limits: {low:.4g}..{high:.4g} {unit} taken.")
        if joint.max_velocity is None:
            most = highest_speeds(robot)[joint.number - 1] / factor(unit)
            told.append(f"Joint {joint.number} ({joint.name}) states no max_velocity: {most:.3g} {unit}/s taken.")
    return tuple(told)
