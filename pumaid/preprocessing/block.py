"""The bounded stretch of samples that is looked at at a time, gathered from batches of any size."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from pumaid.records import Log

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Numbers beyond it (rad, m, A) are garbage of a logger, not measurements.
LARGEST = 1e6


@dataclass(frozen=True, eq=False, slots=True)
class Block:
    """N consecutive samples of one recording.

    Attributes
    ----------
    origins
        Names of the files; `file` (N,) points into it.
    rows, time, position, current, temperature, extra
        As in `Log`; temperature (N, J) and extra (N, E) are NaN where not measured.
    clock
        Number of the recording.
    lead
        Samples at the front that were accounted for already; they are here as context.
    """

    origins: tuple[str, ...]
    file: NDArray[np.int32]
    rows: Ints
    time: Floats
    position: Floats
    current: Floats
    temperature: Floats | None
    clock: int
    lead: int
    extra: Floats | None = None

    def __len__(self) -> int:
        return len(self.time)


class Buffer:
    """Samples of one recording that are not reduced yet, whatever batches they came in."""

    def __init__(self, clock: int) -> None:
        self.clock = clock
        self.lead = 0
        self._parts: list[Log] = []
        self._size = 0

    def __len__(self) -> int:
        return self._size

    def copy(self) -> Buffer:
        """Another one that goes on from here."""
        other = copy(self)
        other._parts = self._parts.copy()
        return other

    def add(self, log: Log) -> None:
        """Append a batch."""
        if len(log):
            self._parts.append(log)
            self._size += len(log)

    @property
    def parts(self) -> tuple[Log, ...]:
        """All samples as they came, without what the segmentation does not look at."""
        return tuple(_cut(part, 0, len(part)) for part in self._parts)

    def split(self, size: int) -> tuple[tuple[Log, ...], tuple[Log, ...]]:
        """The first `size` samples, and the others."""
        first, second, at = [], [], 0
        for part in self.parts:
            cut = min(max(size - at, 0), len(part))
            at += len(part)
            first += [_cut(part, 0, cut)] if cut else []
            second += [_cut(part, cut, len(part))] if cut < len(part) else []
        return tuple(first), tuple(second)

    def unseen(self) -> tuple[Floats, Floats]:
        """(N,) times and (N, J) positions of the samples that are not accounted for yet."""
        time = np.concatenate([part.time for part in self._parts])
        return time[self.lead :], _stacked([part.position for part in self._parts], len(time))[self.lead :]

    def block(self, size: int) -> Block:
        """The first `size` samples as one block."""
        parts, missing = [], size
        for part in self._parts:
            if missing > 0:
                parts.append(_cut(part, 0, missing) if missing < len(part) else part)
                missing -= len(part)
        origins = tuple(origin for origin, _ in groupby(part.origin for part in parts))
        number = np.cumsum([k > 0 and part.origin != parts[k - 1].origin for k, part in enumerate(parts)])
        return Block(
            origins=origins,
            file=np.repeat(number.astype(np.int32), [len(part) for part in parts]),
            rows=np.concatenate([part.rows for part in parts]),
            time=np.concatenate([part.time for part in parts]),
            position=_stacked([part.position for part in parts], size),
            current=_stacked([part.current for part in parts], size),
            temperature=_known([part.temperature for part in parts], parts),
            clock=self.clock,
            lead=self.lead,
            extra=_known([part.extra for part in parts], parts),
        )

    def drop(self, count: int, lead: int) -> None:
        """Forget the first `count` samples; the next block starts with `lead` samples that are context."""
        kept = []
        for part in self._parts:
            if count < len(part):
                kept.append(_cut(part, count, len(part)))
            count = max(0, count - len(part))
        self._parts = kept
        self._size = sum(len(part) for part in kept)
        self.lead = lead


def _cut(log: Log, start: int, stop: int) -> Log:
    return Log(
        origin=log.origin,
        rows=log.rows[start:stop],
        time=log.time[start:stop],
        position=log.position[start:stop],
        velocity=None,
        current=log.current[start:stop],
        temperature=None if log.temperature is None else log.temperature[start:stop],
        extra=None if log.extra is None else log.extra[start:stop],
        starts_clock=log.starts_clock and start == 0,
    )


def _stacked(values: Sequence[Floats], size: int) -> Floats:
    """Values (N, J) of consecutive parts as one (size, J), joint after joint in memory."""
    out = np.empty((values[0].shape[1], size))
    at = 0
    for part in values:
        out[:, at : at + len(part)] = part.T
        at += len(part)
    return out.T


def _known(values: list[Floats | None], parts: list[Log]) -> Floats | None:
    """One quantity of consecutive parts, NaN in those that lack it; None where all do."""
    width = next((known.shape[1] for known in values if known is not None), None)
    if width is None:
        return None
    filled = [
        np.full((len(part), width), np.nan) if known is None else known
        for known, part in zip(values, parts, strict=True)
    ]
    return _stacked(filled, sum(map(len, parts)))
