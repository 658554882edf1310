"""Shares with their intervals, and the outcomes of many experiments counted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Normal quantile of a two-sided 95 % interval.
Z = 1.959964


@dataclass(frozen=True)
class Share:
    """`hits` of `count`."""

    hits: int
    count: int

    @property
    def value(self) -> float:
        """Share, NaN of none."""
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval."""
        if not self.count:
            return 0.0, 1.0
        p, n = self.value, self.count
        middle = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
        half = Z / (1 + Z**2 / n) * float(np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2)))
        return max(0.0, middle - half), min(1.0, middle + half)

    def __str__(self) -> str:
        if not self.count:
            return "none"
        low, high = self.interval
        return f"{100 * self.value:.1f} % ({100 * low:.1f}..{100 * high:.1f}; {self.hits}/{self.count})"


Record = dict[str, Any]


def share(records: Iterable[Record], holds: Any) -> Share:
    """How many of some records something holds for."""
    found = [bool(holds(record)) for record in records]
    return Share(sum(found), len(found))


def chosen(records: Iterable[Record], group: str, *, least: float = 0.0, hidden: bool = True) -> list[Record]:
    """Records of a group that were run, at `least` this size.

    Parameters
    ----------
    records
        All.
    group
        Of the case.
    least
        Smallest size.
    hidden
        Only those in which something is hidden, or only those in which nothing is.
    """
    return [
        record
        for record in records
        if record["group"] == group
        and record["outcome"] not in ("skipped", "crashed")
        and record["size"] >= least
        and bool(record["effects"]) == hidden
    ]


def right_or_pair(record: Record) -> bool:
    """Named first, or in a first set of at most two."""
    return record["outcome"] == "first" or (record["outcome"] == "set" and first_set(record) <= 2)


def strictly(record: Record) -> bool:
    """In a first set of at most two, first or not."""
    return record["outcome"] in ("first", "set") and first_set(record) <= 2


def first_set(record: Record) -> int:
    """Names in the first finding's set; 0 without a finding."""
    return int(record["sets"][0]) if record["sets"] else 0


def wrong_alone(record: Record) -> bool:
    """A wrong name with no rival, and the truth in no later finding."""
    return record["outcome"] == "wrong" and first_set(record) == 1 and not record["later"]


def near_truth(record: Record) -> bool:
    """Error on held-out runs within 5 % of the true model's."""
    return record.get("after") is not None and record["after"] <= 1.05


def spoke(record: Record) -> bool:
    """Something was found."""
    return bool(record["sets"])


def excess(record: Record) -> float:
    """Share of the held-out error above the true model's that adding took away; NaN where there was next to none."""
    before, after = record.get("before"), record.get("after")
    if before is None or after is None or before < 1.02:
        return float("nan")
    return float((before**2 - after**2) / (before**2 - 1.0))


def honest_outside(record: Record) -> bool:
    """Called unexplained where it is felt, or explained to the noise on unseen runs."""
    return bool(record["unexplained"] or (spoke(record) and near_truth(record)))


def soundly_outside(record: Record) -> bool:
    """Called unexplained, or what was named reproduces 90 % of the truth where there is hardly any noise."""
    return bool(record["unexplained"] or record.get("equivalent", False))


def middle(values: Sequence[float]) -> str:
    """Median of what is known, as text."""
    known = [value for value in values if value is not None and np.isfinite(value)]
    return f"{np.median(known):.3f}" if known else "-"
