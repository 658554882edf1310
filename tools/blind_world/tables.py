"""The page of a run of the blind benchmark, as Markdown."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from blind_world.case import SIZES
from blind_world.effects import CATALOGUE

Record = dict[str, Any]

OUTCOMES = ("first", "set", "wrong", "missed")


def interval(outcomes: Iterable[object]) -> str:
    """A share with Wilson's 95 % interval."""
    passed = [bool(outcome) for outcome in outcomes]
    if not passed:
        return "none"
    low, high = binomtest(sum(passed), len(passed)).proportion_ci(method="wilson")
    return f"{100 * np.mean(passed):.1f} % ({100 * low:.1f}..{100 * high:.1f}; {sum(passed)}/{len(passed)})"


def row(*cells: object) -> str:
    """A line of a Markdown table."""
    return f"| {' | '.join(map(str, cells))} |"


def header(*cells: str) -> str:
    """The two first lines of a Markdown table."""
    return row(*cells) + "\n" + "|---" * len(cells) + "|"


def page(records: list[Record]) -> str:
    """All tables of the records of a file of results."""
    seeds = ", ".join(map(str, sorted({record["seed"] for record in records})))
    run = [record for record in records if record["outcome"] != "skipped"]
    crashed = [record["key"] for record in run if record["outcome"] == "crashed"]
    sections = {"Goals": goals, "By size": by_size, "By effect": by_effect}
    parts = [f"{len(run)} experiments, seeds {seeds}; {len(crashed)} ended in an error: {', '.join(crashed) or 'none'}"]
    parts += [f"## {title}\n\n" + "\n".join(table(records)) for title, table in sections.items()]
    return "\n\n".join(parts) + "\n"


def of_group(records: Iterable[Record], group: str, least: float = 0.0) -> list[Record]:
    """Records of a group that were run, of at least a size."""
    chosen = [record for record in records if record["group"] == group and record["size"] >= least]
    return [record for record in chosen if record["outcome"] not in ("skipped", "crashed")]


def right_or_pair(record: Record) -> bool:
    """Named first, or in a first set of at most two."""
    return record["outcome"] == "first" or (record["outcome"] == "set" and record["sets"][0] <= 2)


def wrong_alone(record: Record) -> bool:
    """A wrong name with no rival, and the truth in no later finding."""
    return bool(record["outcome"] == "wrong" and record["sets"][0] == 1 and not record["later"])


def near_truth(record: Record) -> bool:
    """Error on held-out runs within 5 % of the true model's."""
    return record["after"] is not None and record["after"] <= 1.05


def spoke(record: Record) -> bool:
    """Something was found."""
    return bool(record["sets"])


def honest(record: Record) -> bool:
    """Called unexplained where it is felt, or explained to the noise on unseen runs."""
    return bool(record["unexplained"] or (spoke(record) and near_truth(record)))


def goals(records: list[Record]) -> list[str]:
    """Each goal and what was measured."""
    at_two, clean = of_group(records, "effect", 2.0), of_group(records, "clean")
    told, quiet = ([record["told"] for record in group if "told" in record] for group in (at_two, clean))
    rows: tuple[tuple[str, Sequence[Record], Callable[[Record], bool], float], ...] = (
        ("at 2 x the limit and above: right, or in a set of at most two", at_two, right_or_pair, 0.95),
        ("the same with what is told and not added, as held-out error does not fall", told, right_or_pair, 0.95),
        ("at 2 x and above: wrong and alone", at_two, wrong_alone, -0.02),
        ("clean experiments with any finding", clean, spoke, -0.05),
        ("clean experiments in which anything is told", quiet, spoke, -0.05),
        ("outside the catalogue: unexplained, or explained to the noise", of_group(records, "outside"), honest, 0.90),
        ("at 2 x and above: held-out error within 5 % of the true model's", at_two, near_truth, 0.90),
    )
    lines = [goal(text, wanted, map(holds, chosen)) for text, chosen, holds, wanted in rows]
    return [header("goal", "wanted", "measured (95 % interval)"), *lines]


def goal(text: str, wanted: float, passed: Iterable[bool], *cells: str) -> str:
    """A goal, the share that is wanted (negative: an upper bound) and what was measured."""
    bound = f"{100 * wanted:.0f} %" if wanted > 0 else f"< {-100 * wanted:.0f} %"
    return row(text, bound, interval(passed), *cells)


def by_size(records: list[Record]) -> list[str]:
    """Size, all effects and arms."""
    effects = of_group(records, "effect")
    groups = {f"{size:g} x": [record for record in effects if record["size"] == size] for size in SIZES}
    error = "held-out error over the true model's, before and after"
    lines = [header("size", "runs", "named first", "in the set", "wrong", "missed", "wrong and alone", error)]
    for name, group in groups.items():
        outcomes = (interval(record["outcome"] == outcome for record in group) for outcome in OUTCOMES)
        errors = [[record[when] for record in group if record[when] is not None] for when in ("before", "after")]
        medians = ", ".join(f"{np.nanmedian(values):.3f}" if values else "-" for values in errors)
        lines.append(row(name, len(group), *outcomes, interval(map(wrong_alone, group)), medians))
    return lines


def by_effect(records: list[Record]) -> list[str]:
    """Effect x size: named first / in the set / wrong / missed."""
    sizes = (f"{size:g} x" for size in SIZES)
    lines = [header("effect", *sizes, "right or in two, from 2 x", "not to be seen, by reason")]
    for name in CATALOGUE:
        of_effect = [record for record in records if record["effects"] == [name]]
        run, cells = of_group(of_effect, "effect"), []
        for size in SIZES:
            counts = Counter(record["outcome"] for record in run if record["size"] == size)
            cells.append(" / ".join(str(counts[outcome]) for outcome in OUTCOMES) if counts else "-")
        right = [right_or_pair(record) for record in run if record["size"] >= 2.0]
        reasons = {record["reason"] for record in of_effect if record["outcome"] == "skipped"}
        lines.append(row(f"`{name}`", *cells, f"{sum(right)}/{len(right)}", "; ".join(sorted(reasons))))
    return lines
