"""A bound on the bins that are kept of logs with thousands of runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from pumaid.dataset import Reject, Run, coarser

Record = TypeVar("Record", Run, Reject)


@dataclass(frozen=True, slots=True)
class Share:
    """Bins of all records together (some 100 bytes each for six joints), and those that a record keeps in any case."""

    most: int
    fewest: int


OF_RUNS = Share(most=1_500_000, fewest=16)
#: What is no run is only looked at from afar: how large the model's error is there.
OF_REJECTS = Share(most=300_000, fewest=4)


class Room(Generic[Record]):
    """Collects records; where they have too many bins together, each keeps half as many as before.

    Parameters
    ----------
    share
        How many bins are too many.

    Attributes
    ----------
    records
        In the order in which they came.
    """

    def __init__(self, share: Share) -> None:
        self.records: list[Record] = []
        self._share, self._bins = share, 0
        self._most = 1 << 20  # of one record

    def add(self, record: Record) -> None:
        """Collect a record."""
        self.records.append(self._coarser(record))
        self._bins += _size(self.records[-1])
        while self._bins > self._share.most and self._most > self._share.fewest:
            self._most = max(self._share.fewest, min(self._most, max(map(_size, self.records))) // 2)
            self.records = [self._coarser(record) for record in self.records]
            self._bins = sum(map(_size, self.records))

    def _coarser(self, record: Record) -> Record:
        if record.bins is None or len(record.bins) <= self._most:
            return record
        return replace(record, bins=coarser([record.bins], self._most))


def _size(record: Run | Reject) -> int:
    return 0 if record.bins is None else len(record.bins)
