"""How many bins may be kept where there are thousands of runs: all of some, a few of the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Any, Generic, TypeVar

from pumaid.dataset import Bins, Means, Reject, Run
from pumaid.preprocessing.reduce import coarser

Kept = TypeVar("Kept", Run, Reject)
Held = TypeVar("Held", Bins, Means)

#: Of how many runs of a joint one pair keeps all its bins, for each time that there were too many. Odd: programs
#: repeat in twos and fours, and one direction or one speed must not be left out.
ONE_IN = 3


@dataclass(frozen=True, slots=True)
class Share:
    """Bins of all records together (for six joints 100 bytes each, 170 of what is no run), and what most must do with.

    Attributes
    ----------
    most
        Bins of all together.
    few, fewest
        Bins that most records keep at first, and at last.
    """

    most: int
    few: int
    fewest: int


#: Runs keep enough for gravity, friction and how noise goes on.
OF_RUNS = Share(most=1_500_000, few=64, fewest=16)
#: What is no run is only looked at from afar: how large the model's error is there, and how far a ramp reaches back.
OF_REJECTS = Share(most=300_000, few=16, fewest=4)


class Room(Generic[Kept]):
    """Sees to it that the bins of endless logs stay bounded.

    Triangles hold every sample in any case. Fine bins are for what changes along a run (ripples, bends), and of that
    some runs of each joint, evenly through the logs, tell as much as a thousand do.

    Parameters
    ----------
    share
        How much room there is.

    Attributes
    ----------
    records
        What was kept, in the order in which it came; some of it coarser than it came.
    """

    def __init__(self, share: Share) -> None:
        self.records: list[Kept] = []
        self._share, self._bins, self._times = share, 0, 0
        self._numbers: list[int] = []
        self._seen: Counter[int] = Counter()

    def copy(self) -> Room[Kept]:
        """Another one that goes on from here."""
        other = copy(self)
        other.records, other._numbers, other._seen = self.records.copy(), self._numbers.copy(), self._seen.copy()
        return other

    def add(self, record: Kept) -> None:
        """Keep a record, and make room where there are too many bins."""
        joint = record.joint if isinstance(record, Run) else next(iter(record.joints), 0)
        number = self._seen[joint]
        self._seen[joint] += _size(record) > 0
        self.records.append(self._fitting(record, number))
        self._numbers.append(number)
        self._bins += _size(self.records[-1])
        while self._bins > self._share.most and self._few > self._share.fewest:
            self._times += 1
            self.records = list(self._all_fitting(self.records))
            self._bins = sum(map(_size, self.records))

    @property
    def _few(self) -> int:
        few, fewest = self._share.few, self._share.fewest
        return max(fewest, few >> max(0, self._times - 1)) if self._times else 2 * few

    def _all_fitting(self, records: Sequence[Kept]) -> Iterator[Kept]:
        for record, number in zip(records, self._numbers, strict=True):
            yield self._fitting(record, number)

    def _fitting(self, record: Kept, number: int) -> Kept:
        """The record with as many bins as there is room for; `number` counts its joint's from 0."""
        # Runs come in pairs, there and back, and so do the ramps of each.
        if record.bins is None or not self._times:
            return record
        if number // 2 % ONE_IN**self._times == 0 or len(record.bins) <= self._few:
            return replace(record, bins=_apart(record.bins))
        return replace(record, bins=coarser([record.bins], self._few))


def _apart(bins: Held) -> Held:
    """The same with memory of their own: what came from another process is a view of all that came with it."""
    if bins.count.base is None:
        return bins
    own: list[Any] = [getattr(bins, item.name) for item in fields(bins)]
    own = [None if values is None else values.copy("K") for values in own]
    return type(bins)(*own)


def _size(record: Run | Reject) -> int:
    return 0 if record.bins is None else len(record.bins)
