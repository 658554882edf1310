"""The page of a run of the blind benchmark, as Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from blind_world.case import CATALOGUE, OUTSIDE_SIZES, PAIR_SIZE, SIZES, THIN_SIZE
from blind_world.outside import OUTSIDE

Record = dict[str, Any]
Test = Callable[[Record], object]

OUTCOMES = ("first", "set", "wrong", "missed")


def page(records: list[Record]) -> str:
    """All tables of the records of a file of results."""
    seeds = sorted({record["seed"] for record in records})
    count = sum(record["outcome"] != "skipped" for record in records)
    crashed = [record["key"] for record in records if record["outcome"] == "crashed"]
    checked = [record["same_on_command_line"] for record in records if "same_on_command_line" in record]
    sections = {
        "Goals": goals(records),
        "All effects by size": by_size(records),
        "Effect by effect: first / in the set / wrong / missed": by_effect(records),
        f"Outside the catalogue, at {' and '.join(f'{s:g}' for s in OUTSIDE_SIZES)} x the limit": outside(records),
        f"Two at once, each at {PAIR_SIZE:g} x its limit": pairs(records),
    }
    about = (
        f"{count} experiments, seeds {', '.join(map(str, seeds))}; {len(crashed)} ended in an error"
        f"{': ' if crashed else ''}{', '.join(crashed)}."
        f" {len(checked)} also went through the command line, {sum(checked)} of them with the same findings."
    )
    return "\n\n".join([about, *(f"## {title}\n\n{text}" for title, text in sections.items())]) + "\n"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)])


def interval(hits: int, count: int) -> str:
    """A share with Wilson's 95 % interval."""
    if not count:
        return "none"
    low, high = binomtest(hits, count).proportion_ci(method="wilson")
    return f"{100 * hits / count:.1f} % ({100 * low:.1f}..{100 * high:.1f}; {hits}/{count})"


def share(records: Sequence[Record], holds: Test) -> str:
    """How many of some records something holds for."""
    return interval(sum(bool(holds(record)) for record in records), len(records))


def of_group(records: Iterable[Record], group: str, *, least: float = 0.0, hidden: bool = True) -> list[Record]:
    """Records of a group that were run, of at least a size; with something hidden, or with nothing."""
    return [
        record
        for record in records
        if record["group"] == group
        and record["outcome"] not in ("skipped", "crashed")
        and record["size"] >= least
        and bool(record["effects"]) == hidden
    ]


def first_set(record: Record) -> int:
    """Names in the first finding's set; 0 without a finding."""
    return int(record["sets"][0]) if record["sets"] else 0


def right_or_pair(record: Record) -> bool:
    """Named first, or in a first set of at most two."""
    return record["outcome"] == "first" or (record["outcome"] == "set" and first_set(record) <= 2)


def strictly(record: Record) -> bool:
    """In a first set of at most two, first or not."""
    return record["outcome"] in ("first", "set") and first_set(record) <= 2


def wrong_alone(record: Record) -> bool:
    """A wrong name with no rival, and the truth in no later finding."""
    return record["outcome"] == "wrong" and first_set(record) == 1 and not record["later"]


def near_truth(record: Record) -> bool:
    """Error on held-out runs within 5 % of the true model's."""
    return record.get("after") is not None and record["after"] <= 1.05


def spoke(record: Record) -> bool:
    """Something was found."""
    return bool(record["sets"])


def honest_outside(record: Record) -> bool:
    """Called unexplained where it is felt, or explained to the noise on unseen runs."""
    return bool(record["unexplained"] or (spoke(record) and near_truth(record)))


def soundly_outside(record: Record) -> bool:
    """Called unexplained, or what was named reproduces 90 % of the truth where there is hardly any noise."""
    return bool(record["unexplained"] or record.get("equivalent", False))


def goals(records: list[Record]) -> str:
    """Each goal, what was measured and whether it is reached; a negative one is an upper bound."""
    at_two, strange = of_group(records, "effect", least=2.0), of_group(records, "outside")
    clean = of_group(records, "clean", hidden=False)
    rows = []
    for text, some_records, holds, wanted in (
        ("at 2 x the limit and above: right, or in a set of at most two", at_two, right_or_pair, 0.95),
        ("the same, only sets of at most two counted", at_two, strictly, 0.95),
        ("at 2 x and above: wrong and alone", at_two, wrong_alone, -0.02),
        ("clean experiments with any finding", clean, spoke, -0.05),
        ("outside the catalogue: called unexplained, or explained to the noise", strange, honest_outside, 0.90),
        ("the same, but explained means that 90 % of the truth is reproduced", strange, soundly_outside, 0.90),
        ("at 2 x and above: held-out error within 5 % of the true model's", at_two, near_truth, 0.90),
    ):
        measured = np.mean([bool(holds(record)) for record in some_records]) if some_records else np.nan
        reached = measured >= wanted if wanted > 0 else measured < -wanted
        bound = f"{100 * wanted:.0f} %" if wanted > 0 else f"< {-100 * wanted:.0f} %"
        rows.append((text, bound, share(some_records, holds), "yes" if reached else "no"))
    return table(("goal", "wanted", "measured (95 % interval)", "reached"), rows)


def by_size(records: list[Record]) -> str:
    """Size, all effects and arms; and the thin design."""
    effects = of_group(records, "effect")
    groups = {f"{size:g} x": [record for record in effects if record["size"] == size] for size in SIZES}
    groups[f"thin, {THIN_SIZE:g} x"] = of_group(records, "thin")
    rows = []
    for name_of_group, of_size in groups.items():
        counts = Counter(record["outcome"] for record in of_size)
        outcomes = (interval(counts[name], len(of_size)) for name in OUTCOMES)
        errors = [
            [record[when] for record in of_size if record[when] is not None and np.isfinite(record[when])]
            for when in ("before", "after")
        ]
        medians = ", ".join(f"{np.median(values):.3f}" if values else "-" for values in errors)
        needless = sum(record["needless"] > 0 for record in of_size)
        rows.append((name_of_group, len(of_size), *outcomes, share(of_size, wrong_alone), needless, medians))
    head = ("size", "runs", "named first", "in the set", "wrong", "missed", "wrong and alone")
    error = "held-out error over the true model's, before and after"
    return table((*head, "with a needless finding", error), rows)


def by_effect(records: list[Record]) -> str:
    """Effect x size: named first / in the set / wrong / missed."""
    rows = []
    for name in CATALOGUE:
        of_effect = [record for record in records if record["group"] == "effect" and record["effects"] == [name]]
        run = of_group(of_effect, "effect")
        cells = []
        for size in SIZES:
            counts = Counter(record["outcome"] for record in run if record["size"] == size)
            cells.append(" / ".join(str(counts[outcome]) for outcome in OUTCOMES) if counts else "-")
        high = of_group(run, "effect", least=2.0)
        right = f"{sum(map(right_or_pair, high))}/{len(high)}"
        reasons = {record["reason"] for record in of_effect if record["outcome"] == "skipped"}
        rows.append((f"`{name}`", *cells, right, "; ".join(sorted(reasons))))
    head = ("effect", *(f"{size:g} x" for size in SIZES), "right or in two, from 2 x", "not to be seen, by reason")
    return table(head, rows)


def outside(records: list[Record]) -> str:
    """What happened to physics that no catalogue has."""
    rows = []
    for name in OUTSIDE:
        run = [record for record in of_group(records, "outside") if record["effects"] == [name]]
        named = Counter(record["findings"][0]["effect"] for record in run if spoke(record))
        silent = [record for record in run if not record["unexplained"]]
        rows.append(
            (
                f"`{name}`",
                len(run),
                len(run) - len(silent),
                sum(spoke(record) and near_truth(record) for record in silent),
                sum(record.get("equivalent", False) for record in silent),
                sum(spoke(record) and not near_truth(record) for record in silent),
                sum(not spoke(record) for record in silent),
                ", ".join(f"{effect} {count}" for effect, count in named.most_common(3)) or "-",
            )
        )
    head = ("hidden", "runs", "unexplained", "explained to the noise", "90 % reproduced")
    return table((*head, "named, not explained", "nothing said", "names given"), rows)


def pairs(records: list[Record]) -> str:
    """Two effects at once."""
    run, rows = of_group(records, "pair"), []
    for pair in [*dict.fromkeys(tuple(record["effects"]) for record in run), ()]:
        of_pair = [record for record in run if tuple(record["effects"]) == pair or not pair]
        named = [sum(rank != "no" for rank in record["named"]) for record in of_pair]
        needless = sum(record["needless"] > 0 for record in of_pair)
        counts = (named.count(k) for k in (2, 1, 0))
        hidden = " + ".join(f"`{name}`" for name in pair) or "all"
        rows.append((hidden, len(of_pair), *counts, needless, share(of_pair, near_truth)))
    head = ("hidden", "runs", "both named", "one", "none", "with a needless finding", "within 5 % of the true model")
    return table(head, rows)
