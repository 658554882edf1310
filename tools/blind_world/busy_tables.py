"""The page of busy arms, as Markdown: effects, joints and forecasts of all experiments."""

from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from blind_world.busy import DESIGNS, SIZES
from blind_world.tables import Record, goal, header, row

#: How an effect was named, as `score.answers` says.
ANSWERS = ("right", "pair", "set", "wrong", "missed")
#: An effect counts from so many times its limit on; errors are alike within this share.
CLEAR, NEAR = 2.0, 0.05
#: Each goal with its share, negative where that is an upper bound; in the order of `outcomes`.
GOALS = {
    "effects at 2 x their limit and above: right, or in a set of two": 0.95,
    "the same: another name alone at the joint": -0.02,
    "ripple at 2 x and above: right, or in a set of two": 0.95,
    "joints without an effect: something is missing": -0.02,
    "joints with an effect above its stated limit: called clean": -0.05,
    "joints whose unseen runs can be told: their error within 5 % of the true model's": 0.90,
    "forecasts of that error: within 5 % of what came": 0.95,
    "the same: within 5 % of what the same motion, made again, gives": 0.95,
    "joints at the floor: called unexplained": -0.01,
    "outside the catalogue: unexplained, or explained to the noise": 0.95,
    "there, with a false name: error on unseen runs not lower": -0.01,
}


def busy_page(records: list[Record]) -> str:
    """All tables of busy arms."""
    done = [record for record in records if record["outcome"] == "done"]
    crashed = [record["key"] for record in records if record["outcome"] == "crashed"]
    seeds = [record["seed"] for record in records]
    title = f"{len(done)} busy arms, seeds {min(seeds)} to {max(seeds)}; {len(crashed)} ended in an error: {crashed}"
    false = Counter(f["effect"] for record in done for f in record["findings"] if not f["right"])
    names = "Named where it is not: " + ", ".join(f"{name} {count}" for name, count in false.most_common())
    return "\n\n".join([title, "\n".join(goals(done)), "\n".join(by_effect(done)), names]) + "\n"


def outcomes(record: Record) -> dict[str, list[bool]]:
    """By goal, whether it holds of each effect, joint or forecast that it is about."""
    out: dict[str, list[bool]] = {text: [] for text in GOALS}
    named, wrong, ripples, false, clean, near, forecasts, again, floor, outside, worse = out.values()
    for effect in record["effects"]:
        if effect["inside"] and effect["multiple"] >= CLEAR:
            is_named = effect["answer"] in ANSWERS[:2]
            named.append(is_named)
            wrong.append(effect["answer"] == "wrong")
            ripples += [is_named] * (effect["effect"] == "ripple")
    for joint in record["joints"]:
        effects = [effect for effect in record["effects"] if effect["joint"] == joint["joint"]]
        findings = [finding for finding in record["findings"] if finding["joint"] == joint["joint"]]
        is_quiet, is_unexplained = joint["last"] == "adequate" and not findings, joint["last"] == "unexplained"
        before, after = joint["ratios"]
        if not effects:
            false.append(not is_quiet)
        if any(effect["above"] for effect in effects):
            clean.append(is_quiet)
        is_near = after is not None and after <= 1.0 + NEAR
        near += [is_near] * (after is not None)
        if is_near and all(e["answer"] in ANSWERS[:3] or e["multiple"] < 1.0 for e in effects):
            floor.append(is_unexplained)
        if any(effect["multiple"] >= CLEAR and not effect["inside"] for effect in effects):
            outside.append(is_unexplained or is_near)
            if after is not None and not all(finding["right"] for finding in findings):
                worse.append(after >= before)
    for passed, came in ((forecasts, "came"), (again, "fresh")):
        passed += [bool(abs(item["told"] / item[came] - 1.0) <= NEAR) for item in record["forecasts"]]
    return out


def goals(records: list[Record]) -> list[str]:
    """Each goal, what was measured, and of how many by design."""
    lines = [header("goal", "wanted", "measured (95 % interval)", *DESIGNS)]
    judged = [(record["design"], outcomes(record)) for record in records]
    for text, wanted in GOALS.items():
        passed = {name: [is_so for design, out in judged if design == name for is_so in out[text]] for name in DESIGNS}
        cells = [f"{sum(held)}/{len(held)}" for held in passed.values()]
        lines.append(goal(text, wanted, (is_so for held in passed.values() for is_so in held), *cells))
    return lines


def by_effect(records: list[Record]) -> list[str]:
    """How each effect was named, by size: right / in a set of two / in a larger one / another name / missed."""
    lines = [header("effect", "below 1 x", "1 x to 2 x", "2 x and above")]
    for name in SIZES:
        same = [effect for record in records for effect in record["effects"] if effect["effect"] == name]
        cells = []
        for low, high in ((0.0, 1.0), (1.0, CLEAR), (CLEAR, np.inf)):
            counts = Counter(effect["answer"] for effect in same if low <= effect["multiple"] < high)
            cells.append(" / ".join(str(counts[answer]) for answer in ANSWERS))
        lines.append(row(f"`{name}`", *cells))
    return lines


def draw_forecasts(records: list[Record], path: Path) -> None:
    """What was told of each addition against what came: in the runs held out, and in the same motion made again."""
    told, errors, came, fresh = np.array(
        [[item["told"], item["error"] or 0.0, item["came"], item["fresh"]] for r in records for item in r["forecasts"]]
    ).T
    fig, both = plt.subplots(1, 2, figsize=(9, 4.4), layout="constrained", sharex=True, sharey=True)
    ends = np.array([0.8 * min(told.min(), came.min()), 1.25 * max(told.max(), came.max())])
    names = ("runs that were held out", "the same motion made again")
    for ax, name, there in zip(both, names, (came, fresh), strict=True):
        ax.fill_between(ends, (1.0 - NEAR) * ends, (1.0 + NEAR) * ends, color="#0072b2", alpha=0.2, lw=0)
        ax.errorbar(there, told, yerr=errors, fmt="o", ms=3.5, lw=0.8, color="#222222")
        near = int(np.sum(np.abs(told / there - 1.0) <= NEAR))
        ax.set(xscale="log", yscale="log", xlim=ends, ylim=ends, xlabel=f"RMSE that came, A: {name}")
        ax.set_title(f"{near} of {len(told)} within {100 * NEAR:.0f} %", fontsize=10)
    both[0].set_ylabel("RMSE told before adding, A")
    fig.savefig(path, dpi=110)
