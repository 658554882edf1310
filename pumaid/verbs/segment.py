"""Cut logs into runs: the one pass over the samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from pumaid.dataset import Dataset
from pumaid.preprocessing import clock
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.preprocessing.segmenter import Segmenter
from pumaid.records import Log
from pumaid.robot import Robot

__all__ = ["SegmentOptions", "segment"]


def segment(
    logs: Iterable[Log],
    robot: Robot,
    *,
    options: SegmentOptions = DEFAULTS,
    progress: Callable[[int], None] | None = None,
) -> Dataset:
    """Find the stretches in which one joint moves alone, and reduce each to a triangle and bins.

    Speed is judged from position. A movement of one joint yields its stretches of constant speed; where they are too
    small a part of it and it goes from rest to rest, all of it is a stroke. The rest is left out, with its reason.
    Samples are held in a window of bounded size only; how the logs are cut into batches changes nothing. Where a file
    begins or ends, the samples are cut at the nearest rest.

    Parameters
    ----------
    logs
        Consecutive batches, SI. `starts_clock` begins a new recording; within one, a run may go on from file to file.
        What the iterable tells of its files (`files`, `notes`, `extra`) is taken over.
    robot
        Supplies the joints' kinds.
    options
        Thresholds.
    progress
        Called with the number of samples reduced so far.

    Returns
    -------
    dataset
        Runs and rejects in order of time; together they hold every sample once.

    Raises
    ------
    ValueError
        The logs have another number of joints than the robot.

    Source
    ------
    The method page, section 2: within a run the current is C cos q + S sin q + friction.
    """
    segmenter = Segmenter(robot, options)
    segmenter.take(logs, progress=progress)
    runs, rejects = segmenter.close()
    if progress is not None:
        progress(segmenter.done)
    files, notes, extra = (tuple(getattr(logs, name, ())) for name in ("files", "notes", "extra"))
    return Dataset(runs, rejects, files, (*notes, *clock.notes(runs)), extra)
