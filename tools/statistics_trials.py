"""Measure what docs/statistics.md states: false findings, chances on clean data, and hits at the announced limits.

python tools/statistics_trials.py

Takes about ten minutes. The seeds were not used in development. Arms, noise and hidden effects are those of
`pumaid.simulation`, which shares no code with the model. Shares stand with Wilson's 95 % interval.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from blind_world.tables import interval
from budget_trials import DESIGNS, plan

from pumaid.dataset import Campaign
from pumaid.diagnosis.detection_limit import detection_limits
from pumaid.diagnosis.diagnose import DiagnosisBuilder
from pumaid.diagnosis.records import UNEXPLAINED_JOINT
from pumaid.diagnosis.score_test import minus_log10_p
from pumaid.diagnosis.stepwise import LEVEL, Step, Stepwise
from pumaid.effects import catalogue
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model
from pumaid.simulation import Bench, Truth, draw, table1
from pumaid.simulation.hidden_effects import Hidden

#: First seed of the clean experiments, and of those with a hidden effect.
CLEAN, HIDDEN = 610_000, 620_000
#: The first three of these designs are looked at.
LOOKED_AT = tuple(DESIGNS)[:3]
#: Clean experiments with each design on the small arm, and on the PUMA.
SMALL, LARGE = 300, 30
#: Shares of clean experiments with a chance below these are told.
QUANTILES = (LEVEL, 0.1, 0.25, 0.5, 0.75, 0.9)
#: Hidden effects: name, joint.
EFFECTS = (("spring", 1), ("stribeck", 2), ("warmup", 1), ("ripple", 2))
#: Experiments at the limit with the middle shape, at the limit with any shape, and at a third of it.
AT_MIDDLE, AT_ANY, BELOW = 60, 40, 20
#: Clean experiments whose limits are averaged.
ANNOUNCED = 10

Key = tuple[str, int | None]


@dataclass(frozen=True)
class Shown:
    """A shape of an effect and the information (1/A2) that these runs hold of it."""

    information: float
    shape: dict[str, float]


def small() -> Truth:
    """A two-link pendulum."""
    return draw(read_recipe(shipped_recipes()["pendulum2"]), 31)


def searching(bench: Bench, seed: int) -> Stepwise:
    """A search on one experiment, not yet run."""
    runs = bench.runs(np.random.default_rng(seed))
    return Stepwise(Model.of_runs(bench.truth.robot, runs), runs, campaign=Campaign.of(runs))


def chances(step: Step, *, periodic: str = "ripple") -> dict[Key, float]:
    """Of the best shape of each effect at each joint, the whole catalogue counted."""
    scale = step.scan.solved.scale
    seen = {key: minus_log10_p(best.statistic / scale, best.width) for key, best in step.scan.best().items()}
    for joint, found in step.scan.spectra.items():
        seen[periodic, joint] = minus_log10_p(found.statistic().max() / scale, 2)
    return {key: step.family.p_value(key, float(one)) for key, one in seen.items()}


def textbook(step: Step) -> float:
    """Of the best of the whole catalogue by chi-square, times as many as were tried (Bonferroni)."""
    scale = step.scan.solved.scale
    seen = [float(minus_log10_p(one.statistic / scale, one.width)) for one in step.scan.trials]
    seen += [float(one) for found in step.scan.spectra.values() for one in minus_log10_p(found.statistic() / scale, 2)]
    return min(1.0, len(seen) * 10.0 ** -max(seen))


def clean() -> Iterator[str]:
    """Two tables with a row a design: what was told of experiments that lack nothing, and how chances are spread."""
    told, spread, every = [], [], []
    for design in LOOKED_AT:
        found, strange, smallest, theory = [], [], [], []
        for truth, count in ((small(), SMALL), (table1.puma560(), LARGE)):
            bench = Bench(truth, plan(truth.robot, design, CLEAN), rate=50.0, bins=120)
            for seed in range(CLEAN, CLEAN + count):
                search = searching(bench, seed)
                search.run()
                verdicts = DiagnosisBuilder(search).verdicts.values()
                found.append(bool(search.accepted))
                strange.append(any(one.verdict == UNEXPLAINED_JOINT for one in verdicts))
                smallest.append(min(chances(search.steps[0]).values()))
                theory.append(textbook(search.steps[0]) <= LEVEL)
        both = [a or b for a, b in zip(found, strange, strict=True)]
        shares = [interval(sum(some), len(some)) for some in (found, strange, both, theory)]
        told.append(f"| {design} | {' | '.join(shares)} |")
        spread.append(f"| {design} | {' | '.join(_below(smallest))} |")
        every += smallest
    yield "| design | something called missing | a joint unexplained | either | chi-square |"
    yield from told
    yield f"\n| design | {' | '.join(f'p <= {level:g}' for level in QUANTILES)} |"
    yield from spread
    yield f"| all | {' | '.join(_below(every))} |"


def _below(seen: Sequence[float]) -> Iterator[str]:
    for level in QUANTILES:
        yield interval(int(np.sum(np.array(seen) <= level)), len(seen))


def shown(step: Step, name: str, joint: int) -> list[Shown]:
    """Shapes that the limit of an effect is the median of, the least visible first."""
    spectrum = step.scan.spectra.get(joint)
    if name == "ripple" and spectrum is not None:
        pairs = zip(spectrum.information, spectrum.frequency, strict=True)
        some = [Shown(float(known), {"frequency": float(frequency)}) for known, frequency in pairs]
    else:
        own = [one for one in step.scan.trials if one.added.key == (name, joint)]
        some = [Shown(float(one.information[0, 0]), dict(one.added.shape)) for one in own]
    return sorted(some, key=lambda one: one.information)


def hiding(truth: Truth, name: str, joint: int, *, size: float, shape: dict[str, float], seed: int) -> Truth:
    """The arm with the effect: a wave of any phase, the sign that the physics has, either where it has none."""
    rng = np.random.default_rng([HIDDEN, seed])
    if name == "ripple":
        phase = rng.uniform(0.0, 2.0 * np.pi)
        values = {"cos": size * float(np.cos(phase)), "sin": size * float(np.sin(phase))}
    else:
        signs = catalogue()[name].signs(shape)
        values = {"a": size * (signs[0] or float(rng.choice([-1.0, 1.0])) if signs else float(rng.choice([-1.0, 1.0])))}
    return replace(truth, hidden=(Hidden(name, joint, {**values, **shape}),))


def hits() -> Iterator[str]:
    """A table row an effect: beyond chance, and called missing by its name or as a rival, at and below its limit."""
    truth = small()
    motions = plan(truth.robot, LOOKED_AT[0], HIDDEN)
    quiet = Bench(truth, motions, rate=50.0, bins=120)
    looks = [searching(quiet, HIDDEN + number).look([]) for number in range(ANNOUNCED)]
    announced = [detection_limits(one.scan, one.family, periodic=catalogue()["ripple"]) for one in looks]
    yield "| effect | limit | beyond chance | called missing | of any shape | at a third |"
    for place, (name, joint) in enumerate(EFFECTS):
        sizes = [one[name, joint].size for one in announced]
        limit = float(np.mean([size for size in sizes if size is not None]))
        shapes = shown(looks[0], name, joint)
        bins: list[str] = []
        for count, share, is_any in ((AT_MIDDLE, 1.0, False), (AT_ANY, 1.0, True), (BELOW, 1.0 / 3.0, False)):
            seeds = [HIDDEN + 1000 * (place + 1) + 100 * len(bins) + number for number in range(count)]
            beyond, found = 0, 0
            for seed in seeds:
                pick = int(np.random.default_rng(seed).integers(len(shapes))) if is_any else len(shapes) // 2
                arm = hiding(truth, name, joint, size=share * limit, shape=shapes[pick].shape, seed=seed)
                step = searching(Bench(arm, motions, rate=50.0, bins=120), seed).look([])
                named = [step.chosen, *step.chosen.rivals] if step.chosen is not None else []
                beyond += chances(step).get((name, joint), 1.0) <= LEVEL
                found += (name, joint) in [one.key for one in named]
            bins += [interval(beyond, count), interval(found, count)] if not bins else [interval(found, count)]
        yield f"| {name}@{joint} | {limit:.4g} {announced[0][name, joint].unit} | {' | '.join(bins)} |"


def main() -> None:
    """Print all tables."""
    for row in clean():
        print(row, flush=True)
    print()
    for row in hits():
        print(row, flush=True)


if __name__ == "__main__":
    main()
