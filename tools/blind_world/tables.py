"""The tables of docs/validation.md from the records of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from blind_world.case import CATALOGUE, SIZES
from blind_world.outside import OUTSIDE
from blind_world.statistics import (
    Record,
    Share,
    chosen,
    excess,
    first_set,
    honest_outside,
    middle,
    near_truth,
    right_or_pair,
    share,
    soundly_outside,
    spoke,
    strictly,
    wrong_alone,
)


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)])


def goals(records: list[Record]) -> str:
    """Each goal, what was measured and whether it is reached."""
    at_two = chosen(records, "effect", least=2.0)
    told = [record for record in at_two if spoke(record)]
    clean = chosen(records, "clean", hidden=False)
    rows = [
        _goal("at 2 x the limit and above: right, or in a set of at most two", share(at_two, right_or_pair), 0.95),
        _goal("the same, only sets of at most two counted", share(at_two, strictly), 0.95),
        _goal("at 2 x and above: wrong and alone", share(at_two, wrong_alone), -0.02),
        _goal("clean experiments with any finding", share(clean, spoke), -0.05),
        _goal(
            "outside the catalogue: called unexplained, or explained to the noise on unseen runs",
            share(chosen(records, "outside"), honest_outside),
            0.90,
        ),
        _goal(
            "the same, but explained means that 90 % of the truth is reproduced without noise",
            share(chosen(records, "outside"), soundly_outside),
            0.90,
        ),
        _goal("at 2 x and above: held-out error within 5 % of the true model's", share(at_two, near_truth), 0.90),
        _goal("the same where something was found", share(told, near_truth), 0.90),
    ]
    return table(("goal", "wanted", "measured (95 % interval)", "reached"), rows)


def _goal(text: str, found: Share, wanted: float) -> tuple[object, ...]:
    """A row; a negative `wanted` is an upper bound."""
    reached = found.value >= wanted if wanted > 0 else found.value < -wanted
    word = f"{100 * wanted:.0f} %" if wanted > 0 else f"< {-100 * wanted:.0f} %"
    return text, word, found, "yes" if found.count and reached else "no"


def _counts(records: list[Record]) -> str:
    found = Counter(record["outcome"] for record in records)
    if not records:
        return "-"
    return " / ".join(str(found[name]) for name in ("first", "set", "wrong", "missed"))


def by_effect(records: list[Record]) -> str:
    """Effect x size: named first / in the set / wrong / missed."""
    whole = [r for r in records if r["group"] == "effect"]
    rows = []
    for name in CATALOGUE:
        own = [r for r in whole if r["effects"] == [name]]
        cells = [_counts([r for r in chosen(own, "effect") if r["size"] == size]) for size in SIZES]
        skipped = sum(r["outcome"] == "skipped" for r in own)
        high = share(chosen(own, "effect", least=2.0), right_or_pair)
        rows.append((f"`{name}`", *cells, f"{high.hits}/{high.count}", skipped or ""))
    head = ("effect", *(f"{size:g} x" for size in SIZES), "right or in two, from 2 x", "not to be seen")
    return table(head, rows)


def by_size(records: list[Record]) -> str:
    """Size, all effects and arms."""
    rows = []
    for size in SIZES:
        own = [r for r in chosen(records, "effect") if r["size"] == size]
        said = [r for r in own if spoke(r)]
        sets = [first_set(r) for r in said]
        rows.append(
            (
                f"{size:g} x",
                len(own),
                *(share(own, lambda r, n=name: r["outcome"] == n) for name in ("first", "set", "wrong", "missed")),
                share(own, wrong_alone),
                f"{np.mean(sets):.2f}" if sets else "-",
                sum(r.get("equivalent", False) for r in own),
                sum(r["needless"] > 0 for r in own),
            )
        )
    head = ("size", "runs", "first", "in the set", "wrong", "missed", "wrong and alone", "names in the set")
    return table((*head, "wrong but equivalent", "with a needless finding"), rows)


def ladder(records: list[Record]) -> str:
    """Held-out error over the true model's, before and after adding."""
    rows = []
    for size in SIZES:
        own = [r for r in chosen(records, "effect") if r["size"] == size]
        said = [r for r in own if spoke(r)]
        rows.append(
            (
                f"{size:g} x",
                middle([r["before"] for r in own]),
                middle([r["after"] for r in own]),
                share(own, near_truth),
                share(said, near_truth),
                middle([excess(r) for r in said]),
            )
        )
    head = ("size", "before, median", "after, median", "within 5 % of the true model", "the same where it spoke")
    return table((*head, "share of the avoidable error taken away, median"), rows)


def by_arm(records: list[Record]) -> str:
    """The same goals arm by arm."""
    rows = []
    for kind in dict.fromkeys(r["arm"] for r in records):
        own = [r for r in records if r["arm"] == kind]
        high = chosen(own, "effect", least=2.0)
        clean = chosen(own, "clean", hidden=False)
        rows.append((kind, share(high, right_or_pair), share(high, wrong_alone), share(clean, spoke)))
    return table(("arm", "right or in two, from 2 x", "wrong and alone", "clean with a finding"), rows)


def clean(records: list[Record]) -> str:
    """What was found where nothing is hidden."""
    own = chosen(records, "clean", hidden=False)
    thin = chosen(records, "thin", hidden=False)
    false = Counter(f["effect"] for r in own for f in r["findings"] if f["verdict"] == "add")
    rows = [
        ("any finding", share(own, spoke), share(thin, spoke)),
        *(
            (text, share(own, holds), share(thin, holds))
            for text, holds in (
                ("a doubtful one only", lambda r: not spoke(r) and bool(r["findings"])),
                ("a joint called unexplained", lambda r: "unexplained" in r["verdicts"]),
            )
        ),
    ]
    named = ", ".join(f"{name} {count}" for name, count in false.most_common()) or "none"
    head = ("nothing hidden", "full design", "thin design")
    return table(head, rows) + f"\n\nFalse findings of the full design by name: {named}."


def outside(records: list[Record]) -> str:
    """What happened to physics that no catalogue has."""
    rows = []
    for name in OUTSIDE:
        own = [r for r in chosen(records, "outside") if r["effects"] == [name]]
        skipped = sum(r["outcome"] == "skipped" for r in records if r["effects"] == [name])
        named = Counter(r["findings"][0]["effect"] for r in own if spoke(r))
        rows.append(
            (
                f"`{name}`",
                len(own),
                sum(r["unexplained"] for r in own),
                sum(not r["unexplained"] and spoke(r) and near_truth(r) for r in own),
                sum(not r["unexplained"] and r.get("equivalent", False) for r in own),
                sum(not honest_outside(r) and spoke(r) for r in own),
                sum(not r["unexplained"] and not spoke(r) for r in own),
                ", ".join(f"{effect} {count}" for effect, count in named.most_common(3)) or "-",
                skipped or "",
            )
        )
    head = ("hidden", "runs", "unexplained", "explained to the noise", "of these 90 % reproduced")
    return table((*head, "named, not explained", "nothing said", "names given", "not to be seen"), rows)


def pairs(records: list[Record]) -> str:
    """Two effects at once."""
    rows = []
    own = chosen(records, "pair")
    for pair in dict.fromkeys(tuple(r["effects"]) for r in own):
        of_pair = [r for r in own if tuple(r["effects"]) == pair]
        rows.append((" + ".join(f"`{name}`" for name in pair), *_pair_row(of_pair)))
    rows.append(("all", *_pair_row(own)))
    head = ("hidden", "runs", "both named", "one", "none", "with a needless finding", "within 5 % of the true model")
    return table(head, rows)


def _pair_row(own: list[Record]) -> tuple[object, ...]:
    named = [sum(one != "no" for one in r["named"]) for r in own]
    needless = sum(r["needless"] > 0 for r in own)
    return (len(own), *(named.count(k) for k in (2, 1, 0)), needless, share(own, near_truth))


def thin(records: list[Record]) -> str:
    """Two postures, two speeds, no replicates."""
    own = chosen(records, "thin")
    skipped = sum(r["outcome"] == "skipped" for r in records if r["group"] == "thin")
    rows: list[tuple[object, object]] = [("experiments; not to be seen at all", f"{len(own)}; {skipped}")]
    tests: tuple[tuple[str, Callable[[Record], bool]], ...] = (
        ("right, or in a set of at most two", right_or_pair),
        ("wrong and alone", wrong_alone),
        ("missed", lambda r: r["outcome"] == "missed"),
        ("held-out error within 5 % of the true model's", near_truth),
    )
    rows += [(text, share(own, holds)) for text, holds in tests]
    return table(("thin design, at 2 x its own limit", ""), rows)


def skipped(records: list[Record]) -> str:
    """Cases that no physical size can show, by reason."""
    found: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        if record["outcome"] == "skipped" and record["group"] == "effect":
            found.setdefault((record["effects"][0], record["arm"]), []).append(record)
    rows = [
        (
            f"`{name}`",
            kind,
            ", ".join(f"{r['size']:g} x" for r in sorted(own, key=lambda r: r["size"])),
            own[0]["reason"],
        )
        for (name, kind), own in sorted(found.items())
    ]
    return table(("effect", "arm", "sizes", "tries that failed, by reason"), rows) if rows else "None."


def spent(records: list[Record]) -> str:
    """Seconds of processor time a step takes, median and longest; the longest simulate a motion for the first time."""
    timed = [r["seconds"] for r in records if "seconds" in r]
    names = dict.fromkeys(name for one in timed for name in one)
    rows = []
    for name in names:
        values = [one[name] for one in timed if name in one]
        rows.append((name, f"{np.median(values):.2f}", f"{np.max(values):.2f}"))
    return table(("step", "median s", "longest s"), rows)
