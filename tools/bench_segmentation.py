"""Print how well the segmentation finds runs whose true edges are known, as the table of docs/identification.md.

python tools/bench_segmentation.py [SEEDS]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from motion_worlds import SCENARIOS, Score, World, make, robot, score

from pumaid.preprocessing.segment import segment

#: Seeds from here on were never looked at while thresholds were chosen (below 10 000 they were).
FIRST_SEED = 12_000


def bench(name: str, n_seeds: int) -> tuple[list[Score], float]:
    """Scores of one scenario over `n_seeds` worlds, and seconds spent a million samples."""
    world = World(**SCENARIOS[name])
    scores, spent, samples = [], 0.0, 0
    for seed in range(FIRST_SEED, FIRST_SEED + n_seeds):
        truth = make(world, seed)
        begun = time.process_time()
        dataset = segment(truth.logs, robot(world))
        spent += time.process_time() - begun
        samples += len(truth.joint)
        scores.append(score(truth, dataset))
    return scores, spent / samples * 1e6


def main() -> None:
    """Print the table."""
    n_seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    lines = ["| scenario | runs | share of constant velocity kept | bias, standard errors |", "|---|---|---|---|"]
    for name in SCENARIOS:
        scores, _ = bench(name, n_seeds)
        share = sum(s.right for s in scores) / sum(s.true for s in scores)
        lines.append(f"| {name} | {sum(s.runs for s in scores)} | {share:.3f} | {max(s.bias for s in scores):.2f} |")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
