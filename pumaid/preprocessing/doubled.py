"""Measurements that are there twice: counted as two, a log and its copy make errors too small by the root of two."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pumaid.dataset import Dataset, FileFacts, Run
from pumaid.errors import LogError, Note, Where

#: Copies of files that are told one by one.
TOLD = 5
#: Bins that a run needs for its noise to be its own, and those that are looked at of a longer one.
FEWEST, MOST = 8, 32
#: Share of the noise, and of a variance, by which what was written in another form may differ.
SAME = 0.02
#: Share of a current below which its noise is that of arithmetic: repeats of such runs may well be the same.
NOISELESS = 1e-6
#: Share of a run's means that must be numbers of their own.
OWN = 0.5


def doubled(dataset: Dataset) -> Iterator[LogError | Note]:
    """What stands twice in some logs.

    Parameters
    ----------
    dataset
        With the digests of its files.

    Yields
    ------
    LogError [log-doubled]
        Two files are the same, byte for byte.
    Note [runs-doubled]
        Runs are the same down to their noise, though the files are not: one was written anew in another form, or a
        part of one was added to another.
    """
    same = _same_files(dataset.files)
    for copy, first in list(same.items())[:TOLD]:
        more = f" (and {len(same) - TOLD} more such files)" if len(same) > TOLD else ""
        what = f"{copy} is {first} over again, byte for byte{more}: counted twice, errors would come out too small"
        yield LogError("log-doubled", what, Where(file=copy), "leave one of the two out")
    pairs = Counter((first.origin, again.origin) for first, again in _same_runs(dataset.runs))
    for (first, again), count in sorted(pairs.items()):
        if same.get(again, again) == same.get(first, first) and again != first:
            continue
        where = f"in {first}" if first == again else f"in {first} and in {again}"
        runs = "1 run stands" if count == 1 else f"{count} runs stand"
        text = f"{runs} twice {where}, the same down to their noise: counted twice, errors come out too small"
        yield Note("runs-doubled", f"{text}; leave one of the two out", Where(file=again))


def _same_files(files: Sequence[FileFacts]) -> dict[str, str]:
    """Name of a copy -> name of the first file of the same bytes, if it has rows."""
    first: dict[str, str] = {}
    out = {}
    for facts in files:
        if facts.rows and facts.digest and first.setdefault(facts.digest, facts.name) != facts.name:
            out[facts.name] = first[facts.digest]
    return out


def _same_runs(runs: Sequence[Run]) -> Iterator[tuple[Run, Run]]:
    """Pairs of runs that are one measurement, the earlier first."""
    alike: dict[tuple[int, str, int], list[int]] = {}
    for number, run in enumerate(runs):
        if len(run.bins) >= FEWEST:
            alike.setdefault((run.joint, run.kind, len(run.bins)), []).append(number)
    for numbers in alike.values():
        if len(numbers) > 1:
            prints = _Prints([runs[number] for number in numbers])
            yield from ((runs[numbers[a]], runs[numbers[b]]) for a, b in prints.pairs())


class _Prints:
    """What tells a run from every other: the noise of its means of current and their variances, (R, M) each.

    Parameters
    ----------
    runs
        R of one joint, kind and number of bins.
    """

    def __init__(self, runs: Sequence[Run]) -> None:
        self._mean = np.array([run.bins.current[:MOST] for run in runs])
        self._variance = np.array([run.bins.variance[:MOST] for run in runs])
        self._count = np.array([run.bins.count[:MOST] for run in runs])
        # Third differences leave nothing of gravity's course, and of independent noise 20 times its variance.
        self._noise = np.sqrt(np.mean(np.diff(self._mean, n=3, axis=1) ** 2, axis=1) / 20.0)
        self._noise[self._noise < NOISELESS * np.abs(self._mean).max(axis=1)] = 0.0
        # Of currents in coarse steps the means of two runs may well be the same.
        levels = np.array([len(np.unique(mean)) for mean in self._mean])
        self._noise[levels < max(FEWEST, OWN * self._mean.shape[1])] = 0.0

    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of runs, the earlier first, each run in one pair at most as the later."""
        level = self._mean.mean(axis=1)
        order = np.argsort(level, kind="stable")
        found: dict[int, int] = {}
        for step in range(1, len(order)):
            # The means of a copy's bins are near, so their mean is.
            near = level[order[step:]] - level[order[:-step]] <= SAME * self._noise[order[:-step]]
            if not near.any():
                break
            one, other = order[:-step][near], order[step:][near]
            for a, b in self._alike(one, other).tolist():
                first, again = min(a, b), max(a, b)
                found[again] = min(first, found.get(again, first))
        return sorted((first, again) for again, first in found.items())

    def _alike(self, one: NDArray[np.intp], other: NDArray[np.intp]) -> NDArray[np.intp]:
        """Of pairs (P,) of runs, those (K, 2) in which all bins agree; the first bin tells most of them apart."""
        begins = np.abs(self._mean[one, 0] - self._mean[other, 0]) <= SAME * self._noise[one]
        one, other = one[begins], other[begins]
        noise = self._noise[one]
        means = np.abs(self._mean[one] - self._mean[other]) <= SAME * noise[:, None]
        variances = np.abs(self._variance[one] - self._variance[other]) <= SAME * self._variance[one]
        agree = (noise > 0.0) & (means & variances & (self._count[one] == self._count[other])).all(axis=1)
        return np.stack([one[agree], other[agree]], axis=1)
