"""How many cells may be kept of runs when there are thousands: all of some of them, a few of the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

from pumaid.motion.reduce import coarser
from pumaid.records import Run

#: Cells of all runs together (200 bytes each for six joints); beyond it most runs keep few.
MOST_CELLS = 1_500_000
#: Of how many runs of a joint one pair keeps all its cells, for each time that there were too many. Odd: programs
#: repeat in twos and fours, and one direction or one speed must not be left out.
ONE_IN = 3
#: Cells that the other runs keep at first, and at last: enough for gravity, friction and how noise goes on.
FEW, FEWEST = 64, 16


class Room:
    """Sees to it that the cells of endless runs stay bounded, whatever the logs' length.

    Triangles hold every sample in any case. Fine cells are for what changes along a run (ripples, bends), and of that
    some runs of each joint, evenly through the logs, tell as much as a thousand do.

    Attributes
    ----------
    runs
        What was kept, in the order in which it came; some of it coarser than it came.
    """

    def __init__(self, most: int = MOST_CELLS) -> None:
        self.runs: list[Run] = []
        self._most, self._cells, self._times = most, 0, 0
        self._numbers: list[int] = []
        self._seen: Counter[int] = Counter()

    def add(self, run: Run) -> None:
        """Keep a run, and make room where there are too many cells."""
        number = self._seen[run.joint]
        self._seen[run.joint] += 1
        self.runs.append(self._fitting(run, number))
        self._numbers.append(number)
        self._cells += len(self.runs[-1].cells)
        while self._cells > self._most and self._few > FEWEST:
            self._times += 1
            self.runs = list(self._all_fitting(self.runs))
            self._cells = sum(len(one.cells) for one in self.runs)

    @property
    def _few(self) -> int:
        return max(FEWEST, FEW >> max(0, self._times - 1)) if self._times else 2 * FEW

    def _all_fitting(self, runs: Sequence[Run]) -> Iterator[Run]:
        for run, number in zip(runs, self._numbers, strict=True):
            yield self._fitting(run, number)

    def _fitting(self, run: Run, number: int) -> Run:
        """The run with as many cells as there is room for; `number` counts its joint's runs from 0."""
        # Runs come in pairs, there and back.
        if number // 2 % ONE_IN**self._times == 0 or len(run.cells) <= self._few:
            return run
        return replace(run, cells=coarser([run.cells], self._few, joint=run.joint))
