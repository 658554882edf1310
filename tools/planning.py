"""The planner against the paper's postures on the paper's PUMA in the same robot time, by simulated experiments.

Each experiment is simulated sample by sample, segmented and identified as a user's logs would be. What is compared is
the standard deviation of each estimate over the experiments, in the geometric mean over the parameters that both plans
show. Prints the tables of docs/planning.md.

Run:  python tools/planning.py --experiments 50 --jobs 2
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from pumaid import identify, plan, segment, simulate
from pumaid.estimate import Estimate
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.robot import Robot
from pumaid.simulation import table1
from pumaid.trajectory import Plan, duration

#: Samples a second, and how often the paper's experiment is made: its time is that of the plans.
RATE, TIMES = 100.0, (1, 2, 4)
#: A ratio whose scatter is above this share of it is shown by no plan here: eta_5/eta_6 of the paper's PUMA.
DARK = "gain_ratio.5.6"


def robot() -> Robot:
    """The shipped recipe: the spans and the fastest run of the paper's experiment are its limits."""
    return read_recipe(shipped_recipes()["puma560"])


def experiment(arm: Robot, made: Plan, seed: int) -> Estimate:
    """One experiment on the robot of Table I, through its logs."""
    truth = replace(table1.puma560(), robot=arm)
    logs = simulate(arm, made, truth=truth, seed=seed, rate=RATE)
    dataset = segment(logs, arm)
    held = [motion for motion in made.motions if motion.purpose == "heldout"]
    runs = tuple(run for run in dataset.runs if not any(_same(run, motion) for motion in held))
    return identify(replace(dataset, runs=runs), replace(arm, effects=()))


def _same(run: object, motion: object) -> bool:
    """Whether a run is one that was planned for judging."""
    posture, hold = np.delete(run.posture, motion.joint - 1), np.delete(motion.hold, motion.joint - 1)  # type: ignore[attr-defined]
    is_there = run.joint == motion.joint and bool(np.all(np.abs(posture - hold) < 0.01))  # type: ignore[attr-defined]
    return is_there and abs(abs(run.speed) / motion.velocity - 1.0) < 0.05  # type: ignore[attr-defined]


def _values(job: tuple[Robot, Plan, int]) -> dict[str, float]:
    arm, made, seed = job
    return {value.name: value.value for value in experiment(arm, made, seed).values if value.value is not None}


def scatter(arm: Robot, made: Plan, seeds: Sequence[int], *, jobs: int) -> dict[str, float]:
    """Standard deviation of every estimate over experiments; what any of them does not tell is left out."""
    with ProcessPoolExecutor(jobs) as pool:
        found = list(pool.map(_values, [(arm, made, seed) for seed in seeds]))
    names = [name for name in found[0] if all(name in one for one in found)]
    return {name: float(np.std([one[name] for one in found], ddof=1)) for name in names}


def mean_of(errors: dict[str, float], names: Sequence[str]) -> float:
    """Geometric mean."""
    return math.exp(float(np.mean([math.log(errors[name]) for name in names])))


def plans(times: int, seed: int) -> dict[str, Plan]:
    """The paper's experiment made so often, and plans for as much time: from the recipe alone, and with a model."""
    arm = robot()
    paper = table1.experiment(times)
    paper = replace(paper, duration=duration(arm, paper))
    minutes = paper.duration / 60.0
    prior = experiment(arm, table1.experiment(), 999)
    return {
        "paper": paper,
        "recipe alone": plan(arm, minutes=minutes, seed=seed),
        "--prior": plan(arm, minutes=minutes, seed=seed, prior=prior),
    }


def main() -> None:
    """Print a table a time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--experiments", type=int, default=50)
    parser.add_argument("--times", type=int, nargs="*", default=list(TIMES), help="how often the paper's is made")
    parser.add_argument("--first", type=int, default=5000, help="first seed of the experiments")
    parser.add_argument("--seed", type=int, default=0, help="of the plans")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    arm, seeds = robot(), range(options.first, options.first + options.experiments)
    for times in options.times:
        begin = time.monotonic()
        made = plans(times, options.seed)
        found = {name: scatter(arm, one, seeds, jobs=options.jobs) for name, one in made.items()}
        names = [name for name in found["paper"] if all(name in one for one in found.values()) and name != DARK]
        base = mean_of(found["paper"], names)
        print(f"## {made['paper'].duration / 60.0:.1f} minutes, {len(names)} parameters, {len(seeds)} experiments\n")
        print("| plan | runs | minutes | predicted | measured | paper / this |\n|---|---|---|---|---|---|")
        for name, one in made.items():
            known = [each for each in names if each in one.expected]
            told = f"{mean_of(one.expected, known):.6f}" if known else "-"
            mean = mean_of(found[name], names)
            row = (name, len(one.motions), f"{one.duration / 60:.1f}", told, f"{mean:.6f}", f"{base / mean:.2f}")
            print("| " + " | ".join(map(str, row)) + " |")
        worst = sorted((found["paper"][name] / found["--prior"][name], name) for name in names)
        print("\nleast gained: " + ", ".join(f"{name} {gain:.2f}" for gain, name in worst[:6]))
        print("most gained: " + ", ".join(f"{name} {gain:.2f}" for gain, name in worst[-6:]))
        print(f"({time.monotonic() - begin:.0f} s)\n", flush=True)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    main()
