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
NOISE_ONLY, HIDDEN = 910_000, 920_000
#: Noise-only experiments on each arm; hidden effects of each kind and size on each arm.
REPEATS, TRIALS = 20, 4
#: What a hidden effect leaves of the model, as a multiple of the noise.
SIZES = (0.5, 1.0)
#: RMSE beyond which a fit to noise alone has missed its minimum, as a multiple of the noise.
ASTRAY = 1.5
#: What an effect must leave of the model to be hidden at all, as a multiple of the noise.
LEAST = 1e-4
#: Design -> postures, speeds (of a slide: a fifth, in m/s), directions, repeats.
DESIGNS: dict[str, tuple[int, Sequence[float], Sequence[int], int]] = {
    "4 postures, 4 speeds, both ways, twice": (4, (0.2, 0.4, 0.8, 1.2), (1, -1), 2),
    "the same, once": (4, (0.2, 0.4, 0.8, 1.2), (1, -1), 1),
    "2 postures, 2 speeds, both ways, twice": (2, (0.3, 0.9), (1, -1), 2),
    "4 postures, 4 speeds, one way, twice": (4, (0.2, 0.4, 0.8, 1.2), (1,), 2),
}
#: Effect -> where its trace may be told, the best first: part, variable.
TRACES: dict[str, tuple[tuple[str, str], ...]] = {
    "stribeck": (("odd", "speed"),),
    "viscous_power": (("odd", "speed"),),
    "load_friction": (("odd", "load"), ("smooth", "direction")),
    "position_friction": (("smooth", "direction"),),
    "presliding": (("start", "travel"),),
    "spring": (("smooth", "position"), ("smooth", "posture")),
    "counterbalance": (("smooth", "position"), ("smooth", "posture")),
    "ripple": (("fast", "position"),),
    "warmup": (("time", "time"),),
    "friction_step": (("time", "time"),),
    "torque_constant_drift": (("time", "load"), ("time", "time")),
    "torque_droop": (("odd", "load"), ("even", "load")),
    "delay": (("odd", "lag"),),
    "tilt": (("smooth", "posture"), ("even", "posture"), ("smooth", "position")),
}
#: What a budget may say of a hidden effect, see `verdict`.
WORDS = ("right", "other", "open", "silent")
#: Values of a hidden effect that its size multiplies; the others are shapes.
AMPLITUDES = ("a", "b", "cos", "sin", "drive", "back", "x", "y", "c", "dt")


def arms() -> Iterator[Truth]:
    """The paper's PUMA, a UR3e and the Stanford arm with its slide, the last two drawn."""
    yield table1.puma560()
    for name, seed in (("ur3e", 21), ("stanford", 22)):
        yield draw(read_recipe(shipped_recipes()[name]), seed)


def plan(robot: Robot, design: str, seed: int) -> Plan:
    """Every joint in random postures, in random order, repeats one after another."""
    postures, speeds, ways, repeats = DESIGNS[design]
    rng, holds = np.random.default_rng(seed), {}
    size = np.where(robot.is_revolute, 2.0, 0.3)
    for joint in robot.joints:
        holds[joint.number] = [tuple(rng.uniform(-size, size)) for _ in range(postures)]
    motions: list[Motion] = []
    for _ in range(repeats):
        for joint in robot.joints:
            reach, slow = (2.0, 1.0) if joint.is_revolute else (0.3, 0.2)
            own = [
                Motion(joint.number, hold, -reach * way, reach * way, speed * slow)
                for hold in holds[joint.number]
                for speed in speeds
                for way in ways
            ]
            motions += [own[k] for k in rng.permutation(len(own))]
    return Plan(robot.name, tuple(motions))


def judged(bench: Bench, seed: int) -> dict[int, Budget]:
    """Budget of every joint of the model that is fitted to one experiment."""
    runs = bench.runs(np.random.default_rng(seed))
    dataset = Dataset(runs, (), (FileFacts("bench", "ab" * 32, 1, 0.01, 0.0, 1.0),))
    comparison = compare(identify(dataset, bench.truth.robot), dataset, bench.truth.robot)
    return {score.joint: score.budget for score in comparison.joints if score.budget is not None}


def false_alarms() -> Iterator[str]:
    """A table row a design; the last is the largest gap between a budget's parts and its whole.

    Joints of which the fit itself leaves far more than the noise are counted apart: there is something to tell.
    """
    gap = 0.0
    for design in DESIGNS:
        chances, flagged, astray = [], [], []
        for truth in arms():
            for seed in range(NOISE_ONLY, NOISE_ONLY + REPEATS):
                bench = Bench(truth, plan(truth.robot, design, seed), rate=50.0, bins=120)
                for joint, found in judged(bench, seed).items():
                    gap = max(gap, abs(sum(found.by_name().values()) / found.mean_square - 1.0))
                    is_told = any(part.is_more for part in found.parts)
                    if found.mean_square**0.5 > ASTRAY * truth.noise.std[joint - 1]:
                        astray.append(is_told)
                        continue
                    flagged.append(is_told)
                    chances.append(min(part.p_value for part in found.parts if part.p_value is not None))
        rare = interval(sum(chance <= FALSE_ALARM for chance in chances), len(chances))
        told = interval(sum(flagged), len(flagged))
        yield f"| {design} | {rare} | {told} | {np.median(chances):.2f} | {sum(astray)} of {len(astray)} |"
    yield f"Parts add up to the whole within {gap:.1e} of it."


def hidden(truth: Truth, effect: str, joint: int, *, seed: int) -> tuple[list[Bench], int] | None:
    """Arms on which `effect` leaves `SIZES` times the noise of the joint where it shows most; None if it cannot."""
    motions = plan(truth.robot, next(iter(DESIGNS)), seed)
    where = None if effect == "tilt" else joint
    values = {"friction_step": {"time": 1500.0}}.get(effect, {})
    values |= {"time_constant": 1500.0} if effect in ("warmup", "torque_constant_drift") else {}
    try:
        (one,) = truth.hiding([Hidden(effect, where, values)]).hidden
    except PumaidError:
        return None
    bare = replace(truth.with_noise(0.0), hidden=(one,))
    left = {number: found.mean_square**0.5 for number, found in judged(Bench(bare, motions, rate=50.0), seed).items()}
    shown = max(left, key=lambda number: left[number] / truth.noise.std[number - 1]) if where is None else joint
    if left[shown] < LEAST * truth.noise.std[shown - 1]:
        return None
    made = []
    for ratio in SIZES:
        scale = ratio * truth.noise.std[shown - 1] / left[shown]
        full = {key: value * (scale if key in AMPLITUDES else 1.0) for key, value in one.values.items()}
        made.append(Bench(replace(truth, hidden=(Hidden(effect, where, full),)), motions, rate=50.0, bins=120))
    return made, shown


def verdict(found: Budget, effect: str) -> str:
    """``right``: the largest part is the effect's; ``other``: it is not, ``open``: it has no name; ``silent``."""
    parts = sorted((part for part in found.parts if part.is_more), key=lambda part: -part.mean_square)
    if not parts:
        return "silent"
    if parts[0].name == "unassigned":
        return "open"
    return "right" if any((parts[0].name, against) in TRACES[effect] for against in parts[0].against) else "other"


def attributions() -> Iterator[str]:
    """A table row an effect: verdicts at each size, and what the parts hold of the error that it leaves."""
    for effect in TRACES:
        seen: list[Counter[str]] = [Counter() for _ in SIZES]
        held: list[float] = []
        for place, truth in enumerate(arms()):
            for trial in range(TRIALS):
                seed = HIDDEN + 100 * place + trial
                joint = int(np.random.default_rng(seed).integers(1, truth.robot.n_joints + 1))
                made = hidden(truth, effect, joint, seed=seed)
                for number, bench in enumerate(made[0] if made else []):
                    shown = made[1] if made else joint
                    found = judged(bench, seed)[shown]
                    seen[number][verdict(found, effect)] += 1
                    if number == len(SIZES) - 1:
                        left = SIZES[number] * truth.noise.std[shown - 1]
                        held.append((found.mean_square - found.noise) / left**2)
        bins = [", ".join(f"{some[word]} {word}" for word in WORDS if some[word]) for some in seen]
        yield f"| {effect} | {' | '.join(bins)} | {100.0 * np.median(held):.0f} % |"


def main() -> None:
    """Print both tables."""
    print(
        "| design | smallest chance below 5 % | told more than noise | median chance | told where the fit went astray |"
    )
    for row in false_alarms():
        print(row, flush=True)
    print("\n| effect | 0.5 x noise | 1 x noise | of it in parts that are not noise |")
    for row in attributions():
        print(row, flush=True)


if __name__ == "__main__":
    main()
