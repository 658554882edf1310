"""Measure what docs/diagnosis.md states: false alarms where all is noise, and whose part a hidden effect grows.

python tools/budget_trials.py

Takes about fifteen minutes. The seeds were not used in development. Shares stand with Wilson's 95 % interval. A link
that sags is left out: simulating it would take longer than all other effects together.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from blind_world.tables import interval

from pumaid.dataset import Dataset, FileFacts
from pumaid.diagnosis.compare import compare
from pumaid.diagnosis.residual_budget import FALSE_ALARM
from pumaid.errors import PumaidError
from pumaid.estimation.estimate import identify
from pumaid.estimation.evaluate import Budget
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.simulation import Bench, Truth, draw, table1
from pumaid.simulation.hidden_effects import Hidden
from pumaid.trajectory import Motion, Plan

#: First seed of the noise-only experiments, and of the others.
NOISE_ONLY, HIDDEN = 970_000, 980_000
#: Noise-only experiments on each arm; hidden effects of each kind and size on each arm.
REPEATS, TRIALS = 12, 2
#: What a hidden effect leaves of the model, as a multiple of the noise; less than `LEAST` of it counts as nothing.
SIZES, LEAST = (0.5, 1.0), 1e-4
#: Design -> postures, speeds (of a slide: a fifth, in m/s), directions, repeats.
DESIGNS: dict[str, tuple[int, Sequence[float], Sequence[int], int]] = {
    "4 postures, 4 speeds, both ways, twice": (4, (0.2, 0.4, 0.8, 1.2), (1, -1), 2),
    "the same, once": (4, (0.2, 0.4, 0.8, 1.2), (1, -1), 1),
    "2 postures, 2 speeds, both ways, twice": (2, (0.3, 0.9), (1, -1), 2),
    "4 postures, 4 speeds, one way, twice": (4, (0.2, 0.4, 0.8, 1.2), (1,), 2),
}
#: Effect -> where its trace may be told: part and variable; and values of it that are no sizes.
TRACES: dict[str, tuple[tuple[tuple[str, str], ...], dict[str, float]]] = {
    "stribeck": ((("odd", "speed"),), {}),
    "load_friction": ((("odd", "load"), ("smooth", "direction")), {}),
    "position_friction": ((("smooth", "direction"),), {}),
    "presliding": ((("start", "travel"),), {}),
    "spring": ((("smooth", "position"), ("smooth", "posture")), {}),
    "counterbalance": ((("smooth", "position"), ("smooth", "posture")), {}),
    "ripple": ((("fast", "position"),), {}),
    "warmup": ((("time", "time"),), {"time_constant": 1500.0}),
    "friction_step": ((("time", "time"),), {"time": 1500.0}),
    "torque_constant_drift": ((("time", "load"), ("time", "time")), {"time_constant": 1500.0}),
    "tilt": ((("smooth", "posture"), ("even", "posture"), ("smooth", "position")), {}),
}
#: Values of a hidden effect that its size multiplies; the others are shapes.
AMPLITUDES = ("a", "b", "cos", "sin", "drive", "back", "x", "y", "c")


def arms() -> Iterator[Truth]:
    """The paper's PUMA, a UR3e and the Stanford arm with its slide, the last two drawn."""
    yield table1.puma560()
    for name, seed in (("ur3e", 21), ("stanford", 22)):
        yield draw(read_recipe(shipped_recipes()[name]), seed)


def plan(robot: Robot, design: str, seed: int) -> Plan:
    """Every joint in random postures, in random order, repeats one after another."""
    postures, speeds, ways, repeats = DESIGNS[design]
    rng, holds, motions = np.random.default_rng(seed), {}, list[Motion]()
    size = np.where(robot.is_revolute, 2.0, 0.3)
    for joint in robot.joints:
        holds[joint.number] = [tuple(rng.uniform(-size, size)) for _ in range(postures)]
    for joint in robot.joints * repeats:
        reach, slow = (2.0, 1.0) if joint.is_revolute else (0.3, 0.2)
        once = [
            Motion(joint.number, hold, -reach * way, reach * way, speed * slow)
            for hold in holds[joint.number]
            for speed in speeds
            for way in ways
        ]
        motions += [once[k] for k in rng.permutation(len(once))]
    return Plan(robot.name, tuple(motions))


def budgets(truth: Truth, motions: Plan, seed: int) -> dict[int, Budget]:
    """Budget of every joint of the model that is fitted to one experiment."""
    runs = Bench(truth, motions, rate=50.0, bins=120).runs(np.random.default_rng(seed))
    dataset = Dataset(runs, (), (FileFacts("bench", "ab" * 32, 1, 0.01, 0.0, 1.0),))
    comparison = compare(identify(dataset, truth.robot), dataset, truth.robot)
    return {score.joint: score.budget for score in comparison.joints if score.budget is not None}


def false_alarms() -> Iterator[str]:
    """A table row a design."""
    for design in DESIGNS:
        chances, flagged = [], []
        for truth in arms():
            for seed in range(NOISE_ONLY, NOISE_ONLY + REPEATS):
                for split in budgets(truth, plan(truth.robot, design, seed), seed).values():
                    flagged.append(any(part.is_more for part in split.parts))
                    chances.append(min(part.p_value for part in split.parts if part.p_value is not None))
        rare = interval(sum(chance <= FALSE_ALARM for chance in chances), len(chances))
        yield f"| {design} | {rare} | {interval(sum(flagged), len(flagged))} | {np.median(chances):.2f} |"


def hiding(truth: Truth, effect: str, joint: int, seed: int) -> tuple[list[Truth], int]:
    """The arm with an effect that leaves `SIZES` times the noise of the joint that shows it most; none if it cannot."""
    motions, where = plan(truth.robot, next(iter(DESIGNS)), seed), None if effect == "tilt" else joint
    try:
        (bare,) = truth.hiding([Hidden(effect, where, TRACES[effect][1])]).hidden
    except PumaidError:
        return [], joint
    quiet = budgets(replace(truth.with_noise(0.0), hidden=(bare,)), motions, seed)
    ratios = {number: split.mean_square**0.5 / truth.noise.std[number - 1] for number, split in quiet.items()}
    shown = max(ratios, key=lambda number: ratios[number]) if where is None else joint
    made = []
    for size in SIZES if ratios[shown] > LEAST else ():
        scale = size / ratios[shown]
        values = {key: value * (scale if key in AMPLITUDES else 1.0) for key, value in bare.values.items()}
        made.append(replace(truth, hidden=(Hidden(effect, where, values),)))
    return made, shown


def verdict(split: Budget, effect: str) -> str:
    """``right``: the largest part is the effect's; ``other``: it is not, ``open``: it has no name; ``silent``."""
    parts = sorted((part for part in split.parts if part.is_more), key=lambda part: -part.mean_square)
    if not parts or parts[0].name == "unassigned":
        return "open" if parts else "silent"
    return "right" if any((parts[0].name, variable) in TRACES[effect][0] for variable in parts[0].against) else "other"


def attributions() -> Iterator[str]:
    """A table row an effect: verdicts at each size, and what the parts hold of the error that it leaves."""
    for effect in TRACES:
        counts, shares = [Counter[str]() for _ in SIZES], []
        for place, truth in enumerate(arms()):
            for seed in range(HIDDEN + 100 * place, HIDDEN + 100 * place + TRIALS):
                joint = int(np.random.default_rng(seed).integers(1, truth.robot.n_joints + 1))
                made, shown = hiding(truth, effect, joint, seed)
                for count, size, arm in zip(counts, SIZES, made, strict=False):
                    split = budgets(arm, plan(truth.robot, next(iter(DESIGNS)), seed), seed)[shown]
                    count[verdict(split, effect)] += 1
                    shares.append((split.mean_square - split.noise) / (size * truth.noise.std[shown - 1]) ** 2)
        words = (", ".join(f"{count[word]} {word}" for word in sorted(count)) for count in counts)
        yield f"| {effect} | {' | '.join(words)} | {100.0 * np.median(shares):.0f} % |"


def main() -> None:
    """Print both tables."""
    print("| design | smallest chance below 5 % | told more than noise | median chance |")
    for row in false_alarms():
        print(row, flush=True)
    print("\n| effect | 0.5 x noise | 1 x noise | of it in parts that are not noise |")
    for row in attributions():
        print(row, flush=True)


if __name__ == "__main__":
    main()
