"""Measure what docs/validation.md states and draw its figure.

python tools/accuracy.py [-o FIGURE.png]

Takes about five minutes: 200 experiments on each of five virtual arms, 200 with white noise, 20 through log files.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import matplotlib.pyplot as plt
import numpy as np
from experiments import EXPERIMENTS, coverage, logged, losses

from pumaid.design.plan import plan
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.simulation import Bench, Noise, draw, table1

#: Recipe and seed of the drawn arms.
ARMS = (("ur3e", 11), ("stanford", 12), ("panda", 14), ("pendulum2", 13))
#: Seeds of the experiments that go through log files.
LOGS = range(900, 920)


def intervals() -> tuple[dict[str, float], dict[str, float], list[str]]:
    """Coverage on the paper's PUMA (ours, white noise) and a table row for each arm."""
    truth = table1.puma560()
    ours, theirs = coverage(truth, Bench(truth, table1.experiment(2), rate=50.0), white=True)
    rows = [_row("PUMA 560, the paper's experiment twice", ours)]
    rows.append(_row("the same, errors as of white noise", theirs))
    for name, seed in ARMS:
        robot = read_recipe(shipped_recipes()[name])
        drawn = draw(robot, seed)
        found, _ = coverage(drawn, Bench(drawn, plan(robot, seed=seed, replicates=1), rate=50.0))
        rows.append(_row(f"{robot.name}, planned experiment", found))
    return ours, theirs, rows


def _row(title: str, found: dict[str, float]) -> str:
    shares = np.array(list(found.values()))
    least = min(found, key=lambda name: found[name])
    return f"| {title} | {len(found)} | {100 * shares.mean():.1f} % | {100 * shares.min():.1f} % ({least}) |"


def efficiency() -> Iterator[str]:
    """Table rows: RMS error over the Cramer-Rao bound of joint fit and recursion."""
    truth = table1.puma560()
    white = replace(truth, noise=Noise(truth.noise.std, level_share=0.0, correlation_time=0.0))
    names, joint, first = losses(white, table1.experiment())
    friction = np.array([name.startswith(("coulomb", "viscous")) for name in names])
    for name, ours, theirs in zip(names, joint, first, strict=True):
        if not name.startswith(("coulomb", "viscous")):
            yield f"| {name} | {ours:.2f} | {theirs:.2f} |"
    yield f"| friction terms, mean | {joint[friction].mean():.2f} | {first[friction].mean():.2f} |"
    yield f"| all, geometric mean | {_middle(joint):.3f} | {_middle(first):.3f} |"


def _middle(values: np.ndarray) -> float:
    return float(np.exp(np.mean(np.log(values))))


def through_logs() -> Iterator[str]:
    """Table rows: Table I against what 20 experiments found through log files."""
    truth = table1.puma560()
    known, hits = truth.parameters(), []
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in LOGS:
        with TemporaryDirectory() as folder:
            for value in logged(Path(folder), seed).values:
                if value.value is not None and value.std_error is not None and value.ci95 is not None:
                    found.setdefault(value.name, []).append((value.value, value.std_error))
                    hits.append(value.ci95[0] <= known[value.name] <= value.ci95[1])
    for name, pairs in found.items():
        values, errors = np.array(pairs).T
        mean, error = values.mean(), errors.mean()
        yield f"| {name} | {known[name]:.6f} | {mean:.6f} | {error:.6f} | {len(pairs)} of {len(LOGS)} |"
    yield f"All {len(hits)} intervals: {100 * np.mean(hits):.1f} % hold the table's value."


def figure(ours: dict[str, float], theirs: dict[str, float], path: Path) -> None:
    """Coverage by parameter: clustered by run against white noise, with the band in which 200 experiments scatter."""
    names = list(ours)
    fig, ax = plt.subplots(figsize=(9, 4.6), layout="constrained")
    half = 1.96 * np.sqrt(0.95 * 0.05 / EXPERIMENTS)
    ax.axhspan(100 * (0.95 - half), 100 * (0.95 + half), color="#d9e6f2", lw=0, label="95 % and its scatter")
    ax.axhline(95, color="#5b7fa3", lw=1)
    ax.plot([100 * ours[name] for name in names], "o", color="#0072b2", ms=5, label="pumaid: clustered by run")
    white = [100 * theirs.get(name, np.nan) for name in names]
    ax.plot(white, "s", color="#d55e00", ms=5, mfc="none", label="plain least squares: white noise")
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    ax.set(ylim=(0, 103), ylabel="intervals that hold the truth (%)")
    ax.set_title(
        "How often a 95 % interval holds the truth: virtual PUMA 560, 200 experiments", loc="left", fontsize=10
    )
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="center right", bbox_to_anchor=(1.0, 0.6), frameon=False, fontsize=8)
    fig.savefig(path, dpi=150)


def main() -> None:
    """Print the page's tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("-o", "--output", type=Path, help="where the figure goes")
    output = options.parse_args().output
    ours, theirs, rows = intervals()
    if output is not None:
        figure(ours, theirs, output)
    sys.stdout.write(
        "\n".join(["INTERVALS", *rows, "", "EFFICIENCY", *efficiency(), "", "TABLE I", *through_logs(), ""])
    )


if __name__ == "__main__":
    main()
