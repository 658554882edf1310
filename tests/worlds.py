"""Small arms, their truths and what their logs would leave, for tests of the estimate.

Runs come from `monte_carlo.Bench` (which is tested against samples elsewhere) or, where a test must know every
sample, from `run_of`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import table1
from monte_carlo import Bench

from pumaid.dataset import Bins, Dataset, Run
from pumaid.estimate import Estimate
from pumaid.estimation.fit import Fit
from pumaid.estimation.gls import fit_bins
from pumaid.joint_bins import joint_bins
from pumaid.model import Model
from pumaid.robot import Joint, Robot
from pumaid.simulation import Truth, draw
from pumaid.trajectory import Motion, Plan

TURN = np.pi / 2


def arm(kinds: str, alphas: Sequence[float], *, gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665)) -> Robot:
    """An arm of these joints (R, P) and twists (rad), its lengths a quarter metre."""
    joints = tuple(
        Joint(number, f"joint {number}", "revolute" if kind == "R" else "prismatic", alpha=alpha, a=0.25, d=0.1)
        for number, (kind, alpha) in enumerate(zip(kinds, alphas, strict=True), start=1)
    )
    return Robot(f"arm {kinds}", joints, gravity)


def random_arm(kinds: str, rng: np.random.Generator) -> Robot:
    """An arm of these joints with everything else random, gravity too."""
    robot = arm(kinds, rng.uniform(-3.0, 3.0, len(kinds)), gravity=tuple(rng.uniform(-9.0, 9.0, 3)))
    joints = [
        replace(joint, a=rng.uniform(-0.5, 0.5), d=rng.uniform(-0.5, 0.5), theta=rng.uniform(-3, 3))
        for joint in robot.joints
    ]
    return replace(robot, joints=tuple(joints))


#: Both axes level; both axes level with a slide between two turning joints; Stanford's order of joints.
PENDULUM = arm("RR", [TURN, 0.0])
CRANE = arm("RPR", [TURN, -TURN, TURN])
STANFORD = arm("RRPRRR", [0.0, -TURN, TURN, 0.0, -TURN, TURN])

#: Motor turns a joint turn of the paper's PUMA 560.
GEARS = (-62.6, 107.8, -53.7, 76.0, 71.9, 76.7)


def wrist(coupling: Mapping[tuple[int, int], float] | None = None) -> Robot:
    """The paper's PUMA with gears that couple its wrist, by these ratios or about those of the paper."""
    joints = tuple(replace(joint, gear_ratio=gear) for joint, gear in zip(table1.robot().joints, GEARS, strict=True))
    return replace(table1.robot(), joints=joints, coupling=coupling or {(5, 4): 0.0139, (6, 4): 0.013, (6, 5): 0.18})


def experiment(
    robot: Robot, *, seed: int = 0, postures: int = 3, speeds: Sequence[float] = (0.3, 0.6, 1.0), repeats: int = 1
) -> Plan:
    """Every joint in random postures, at these speeds (rad/s; a fifth of them in m/s), both ways."""
    rng, motions = np.random.default_rng(seed), []
    size = np.where(robot.is_revolute, 2.0, 0.3)
    for joint in robot.joints:
        for _ in range(postures):
            hold = tuple(rng.uniform(-size, size))
            reach, slow = (2.0, 1.0) if joint.is_revolute else (0.3, 0.2)
            for speed in speeds:
                for sign in (1, -1):
                    motions += [Motion(joint.number, hold, -reach * sign, reach * sign, speed * slow)] * repeats
    return Plan(robot.name, tuple(motions))


def only(plan: Plan, chosen) -> Plan:
    """The plan's motions for which `chosen(motion)` is true."""
    return replace(plan, motions=tuple(motion for motion in plan.motions if chosen(motion)))


def dataset(truth: Truth, plan: Plan, *, seed: int = 0, rate: float = 50.0) -> Dataset:
    """What the logs of `plan` on `truth` leave."""
    return Dataset(Bench(truth, plan, rate=rate).runs(np.random.default_rng(seed)))


def puma(*, noisy: bool = True) -> Truth:
    """The paper's PUMA 560."""
    return table1.puma560() if noisy else table1.puma560().with_noise(0.0)


def drawn(robot: Robot, seed: int = 5, *, noisy: bool = True) -> Truth:
    """A virtual robot of this geometry."""
    return draw(robot, seed) if noisy else draw(robot, seed).with_noise(0.0)


def truth_in_units(truth: Truth, moving: Sequence[int]) -> dict[str, float]:
    """The truth's parameters, gravity of a link whose joint never moves in the gain of the next inner one that does."""
    # A sliding joint feels nothing of the links beyond but their mass, so only turning joints stand in for others.
    values, known, turns = truth.parameters(), truth.constants, truth.robot.is_revolute
    gain = np.append(np.cumprod(known.ratio[::-1])[::-1], 1.0)
    for name in values:
        if name.startswith("gravity"):
            link = int(name.split(".")[1][1:])
            inner = link if link in moving else max((j for j in moving if j < link and turns[j - 1]), default=link)
            values[name] *= float(gain[inner - 1] / gain[link - 1])
    n = truth.robot.n_joints
    return values | {f"gain_ratio.{i}.{j}": gain[i - 1] / gain[j - 1] for i in range(1, n) for j in range(i + 1, n + 1)}


def fit_runs(robot: Robot, runs: Sequence[Run], **more: bool) -> Fit:
    """The base model fitted to all bins of some runs."""
    return fit_bins(Model.of_runs(robot, runs), joint_bins(robot, runs, is_settled=False), **more)


def identified(estimate: Estimate) -> dict[str, float]:
    """Values of what was identified."""
    return {value.name: value.value for value in estimate.values if value.state == "identified"}


def course(kind: str, start: float, end: float, *, duration: float = 2.0, samples: int = 200) -> tuple[np.ndarray, ...]:
    """Time, position, velocity and acceleration of a run at constant speed or of a stroke from rest to rest."""
    t = np.linspace(0.0, duration, samples)
    x, way = t / duration, end - start
    if kind == "constant":
        return t, start + way * x, np.full(samples, way / duration), np.zeros(samples)
    shape = 10 * x**3 - 15 * x**4 + 6 * x**5
    rate = (30 * x**2 - 60 * x**3 + 30 * x**4) / duration
    pull = (60 * x - 180 * x**2 + 120 * x**3) / duration**2
    return t, start + way * shape, way * rate, way * pull


def run_of(
    robot: Robot,
    joint: int,
    hold: Sequence[float],
    *,
    course: tuple[np.ndarray, ...],
    current: np.ndarray,
    bins: int = 40,
) -> Run:
    """The run that these samples (of `course`, currents in A) would leave; a stroke where they accelerate."""
    t, q, qd, qdd = course
    kind, own = ("stroke" if np.any(qdd) else "constant"), joint - 1
    edges = np.linspace(0, len(q), min(bins, len(q)) + 1).astype(int)[:-1]
    count = np.diff(np.append(edges, len(q)))

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(values, edges) / count

    position = np.tile(np.array(hold, dtype=float), (len(count), 1))
    position[:, own] = mean(q)
    posture = np.array(hold, dtype=float)
    posture[own] = np.nan
    return Run(
        joint=joint,
        kind=kind,
        origin="samples",
        first_row=2,
        last_row=len(q) + 1,
        start=float(t[0]),
        duration=float(t[-1] - t[0]),
        posture=posture,
        span=(float(q[0]), float(q[-1])),
        speed=float(np.mean(qd)),
        ripple=0.0,
        temperature=float("nan"),
        samples=len(current),
        bins=Bins(
            count=count,
            time=mean(t),
            position=position,
            velocity=mean(qd),
            acceleration=mean(qdd),
            current=mean(current),
            variance=np.maximum(mean(current**2) - mean(current) ** 2, 0.0),
            temperature=np.full(len(count), np.nan),
        ),
    )
