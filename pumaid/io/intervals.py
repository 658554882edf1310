"""The time between samples of a file: its median, and the gaps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, Where

Floats = NDArray[np.float64]

#: Intervals from which the median is taken: enough for any jitter, few enough to keep (800 kB).
PROBE = 100_000
#: A gap is this many median intervals: one or two lost packets are jitter, five are a hole ...
GAP_INTERVALS = 5.0
#: ... and at least this long (s): shorter ones are within what a ramp of an arm takes, and harm no mean.
GAP_SECONDS = 0.05
#: Share by which a step may differ from that and be a gap by one median of the same file and none by another.
CLOSE = 0.02
#: s, and share of the median: times between samples that vary by more (RMS) blur where an arm speeds up and slows down.
JITTER_SECONDS, JITTER_SHARE = 0.005, 0.1


@dataclass(eq=False, slots=True)
class Intervals:
    """Statistics of the steps of time, fed chunk by chunk; the result does not depend on the cuts.

    `jitter` (s) is the RMS by which the steps differ from their median, gaps apart. `is_settled` tells whether there
    were enough of them for the median, which then stays what it is.
    """

    median: float = float("nan")
    jitter: float = 0.0
    first_row: int = 0
    n_gaps: int = 0
    longest: float = 0.0
    first_gaps: list[tuple[int, float, float]] = field(default_factory=list)
    _kept: list[tuple[NDArray[np.int64], Floats, Floats]] = field(default_factory=list)
    _n_kept: int = 0
    _n_close: int = 0  # steps that are a gap just so, or just not

    @property
    def is_settled(self) -> bool:
        """Whether more samples would not change the median."""
        return self._n_kept >= PROBE

    @property
    def _limit(self) -> float:
        return max(GAP_INTERVALS * self.median, GAP_SECONDS)

    def fit(self, following: Intervals) -> bool:
        """Whether the gaps among the next samples, found by their own median, are those by this one."""
        limits = self._limit, following._limit
        near = abs(limits[0] - limits[1]) <= CLOSE * limits[0] / 2
        return self.is_settled and (near or following.median != following.median) and not following._n_close

    def join(self, following: Intervals, above: int, *, border: tuple[float, float]) -> None:
        """Take what was found in the next samples, whose rows count from so many above, and the step to their first."""
        self._count(np.array([above + following.first_row]), np.array(border[1:]), np.diff(border))
        self.n_gaps += following.n_gaps
        self.longest = max(self.longest, following.longest)
        gaps = following.first_gaps[: 3 - len(self.first_gaps)]
        self.first_gaps += [(row + above, start, seconds) for row, start, seconds in gaps]

    def take(self, rows: NDArray[np.int64], time: Floats, before: float | None) -> None:
        """Rows (N,) and times (N,) of the next samples, and the time before them (s) if there is one."""
        if before is None and len(rows) and not self._n_kept:
            self.first_row = int(rows[0])
        start = time[:1] if before is None else np.array([before])
        steps = np.diff(time, prepend=start)
        skip = before is None
        rows, time, steps = rows[skip:], time[skip:], steps[skip:]
        if self._n_kept < PROBE:
            self._kept.append((rows, time, steps))
            self._n_kept += len(rows)
            if self._n_kept >= PROBE:
                self.finish()
        else:
            self._count(rows, time, steps)

    def finish(self) -> None:
        """Settle the median and count the gaps among what was kept for it."""
        if not self._kept:
            return
        if self._n_kept:
            probe = np.concatenate([steps for _, _, steps in self._kept])[:PROBE]
            self.median = float(np.median(probe))
            even = probe[probe <= self._limit]
            self.jitter = float(np.sqrt(np.mean((even - self.median) ** 2)))
        kept, self._kept = self._kept, []
        for rows, time, steps in kept:
            self._count(rows, time, steps)

    def _count(self, rows: NDArray[np.int64], time: Floats, steps: Floats) -> None:
        limit = self._limit
        longest = steps.max(initial=0.0)
        if longest <= (1.0 - CLOSE) * limit:
            return
        where = np.flatnonzero(steps > limit)
        self._n_close += int(np.count_nonzero(np.abs(steps - limit) <= CLOSE * limit))
        self.n_gaps += len(where)
        for k in where[: 3 - len(self.first_gaps)]:
            self.first_gaps.append((int(rows[k]), float(time[k] - steps[k]), float(steps[k])))
        self.longest = max(self.longest, float(steps[where].max(initial=0.0)))

    def notes(self, name: str) -> list[Note]:
        """A note if times jitter, and one if there are gaps."""
        found = []
        if self.jitter > max(JITTER_SECONDS, JITTER_SHARE * self.median):
            text = (
                f"times between samples vary by {1e3 * self.jitter:.2g} ms RMS about {1e3 * self.median:.3g} ms: where"
                " the stamps and not the samples are uneven, speeds and friction come out wrong"
            )
            found.append(Note("clock-jitter", text, Where(file=name)))
        if not self.n_gaps:
            return found
        shown = ", ".join(f"{seconds:.3g} s at {start:.6g} s" for _, start, seconds in self.first_gaps)
        more = f" ... ({self.n_gaps} in all, the longest {self.longest:.3g} s)" if self.n_gaps > 3 else ""
        text = (
            f"samples are missing: {shown}{more}; the median interval is {self.median:.4g} s and no run crosses a gap"
        )
        return [*found, Note("gaps", text, Where(file=name, row=self.first_gaps[0][0]))]
