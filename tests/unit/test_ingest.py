"""Logs to a dataset: the same numbers however the files are shared out, whichever worker dies."""

import os
import random
import signal
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from motion_worlds import World, make, robot

from pumaid.dataset import Dataset
from pumaid.errors import LogError
from pumaid.io.paths import expand
from pumaid.io.write import write_log
from pumaid.preprocessing import ingest as module
from pumaid.preprocessing.ingest import dask_workers, ingest, read_file

WORLD = World(motions=4, rate=200.0)
ARM = robot(WORLD)
N_FILES = 6


@pytest.fixture(scope="module")
def paths(tmp_path_factory) -> list[Path]:
    """Six logs of one arm, CSV and Parquet; each but the third follows the one before on the same clock."""
    folder, end = tmp_path_factory.mktemp("logs"), 0.0
    for number in range(N_FILES):
        logs = make(WORLD, number).logs
        start = -2.0 if number == 2 else end + 1.0 - logs[0].time[0]
        logs = [replace(log, time=log.time + start) for log in logs]
        end = logs[-1].time[-1]
        write_log(folder / f"day_{number}.{'csv' if number % 2 else 'parquet'}", logs, ARM)
    return expand([folder])


@pytest.fixture(scope="module")
def expected(paths) -> Dataset:
    """The dataset as this process makes it."""
    return ingest(paths, ARM)


def assert_equal(dataset: Dataset, expected: Dataset) -> None:
    """All numbers agree to 1e-9, all words exactly."""
    assert (len(dataset.runs), len(dataset.rejects)) == (len(expected.runs), len(expected.rejects))
    assert (dataset.files, dataset.notes, dataset.extra) == (expected.files, expected.notes, expected.extra)
    for record, other in zip((*dataset.runs, *dataset.rejects), (*expected.runs, *expected.rejects), strict=True):
        assert (record.origin, record.first_row, record.last_row) == (other.origin, other.first_row, other.last_row)
        assert (record.clock, record.samples) == (other.clock, other.samples)
    for run, alike in zip(dataset.runs, expected.runs, strict=True):
        for item in fields(run.bins):
            value, same = getattr(run.bins, item.name), getattr(alike.bins, item.name)
            if value is not None:
                np.testing.assert_allclose(value, same, rtol=1e-9, atol=1e-12)


class Slow(ThreadPoolExecutor):
    """Workers that take their time, so that files are done in any order."""

    def submit(self, work, /, *words, **more):
        """Begin a task after a random delay."""
        delay = random.Random(repr(words)).uniform(0.0, 0.2)
        return super().submit(lambda: (time.sleep(delay), work(*words, **more))[1])


@pytest.mark.parametrize(("kind", "workers"), [(ProcessPoolExecutor, 4), (Slow, 4)])
def test_numbers_do_not_depend_on_who_reads(paths, expected, kind: type[Executor], workers: int) -> None:
    """Files shared out among one and four workers, done in any order, leave the same dataset."""
    with kind(workers) as executor:
        assert_equal(ingest(paths, ARM, executor=executor), expected)


def killed(path: Path, *, parent: int, victim: Path, **more: object) -> tuple:
    """Read a file; the worker that gets the victim dies of it."""
    if os.getpid() != parent and path == victim:
        os.kill(os.getpid(), signal.SIGKILL)
    return read_file(path, **more)


def test_a_killed_worker_loses_nothing(paths, expected, monkeypatch) -> None:
    """Its file, and those that nobody can read any more, are read by this process."""
    monkeypatch.setattr(module, "read_file", partial(killed, parent=os.getpid(), victim=paths[3]))
    with ProcessPoolExecutor(2) as executor:
        assert_equal(ingest(paths, ARM, executor=executor), expected)


def test_recordings_are_counted_through_the_files(paths, expected) -> None:
    """Files whose times follow share a clock; where time starts anew, another recording begins; no row is lost."""
    records = (*expected.runs, *expected.rejects)
    assert sum(record.samples for record in records) == sum(facts.rows for facts in expected.files)
    clocks = {Path(run.origin).name[:5]: run.clock for run in expected.runs}
    assert clocks == {"day_0": 0, "day_1": 0, "day_2": 1, "day_3": 1, "day_4": 1, "day_5": 1}


def test_a_copy_of_a_file_is_refused(paths, tmp_path) -> None:
    """It says which of the two; --trust takes both, and says it all the same."""
    original, copy = tmp_path / "day.parquet", tmp_path / "day (copy).parquet"
    for path in (original, copy):
        path.write_bytes(paths[0].read_bytes())
    with pytest.raises(LogError) as refused:
        ingest([original, copy], ARM)
    assert refused.value.slug == "log-doubled" and f"{copy} is a copy of {original}" in refused.value.what
    assert [note.slug for note in ingest([original, copy], ARM, trust=True).notes].count("log-doubled") == 1


def test_notes_of_one_kind_do_not_flood(tmp_path) -> None:
    """Of eight files with gaps of their own three are told in full, and how many more there are."""
    for number in range(8):
        logs = make(WORLD, number).logs
        logs = [replace(log, time=log.time + (1.0 + number) * (np.arange(len(log)) > 50)) for log in logs]
        write_log(tmp_path / f"{number}.csv", logs[:1], ARM)
    notes = [note for note in ingest(expand([tmp_path]), ARM, trust=True).notes if note.slug == "gaps"]
    assert len(notes) == 4 and "5 more notes of this kind" in notes[-1].text


def test_a_refused_file_is_refused_by_its_worker_too(paths, tmp_path) -> None:
    """The message of a file that cannot be read comes through."""
    bad = tmp_path / "bad.csv"
    bad.write_text("t,q1,i1\n0,1,2\n")
    with ProcessPoolExecutor(2) as executor, pytest.raises(LogError) as refused:
        ingest([*paths, bad], ARM, executor=executor)
    assert refused.value.slug == "column-missing" and refused.value.where.file == str(bad)


@pytest.mark.slow
def test_dask_workers_leave_the_same(paths, expected) -> None:
    """Workers of dask.distributed on this machine, one of which is killed."""
    pytest.importorskip("distributed")
    with dask_workers("local", 2) as executor:
        assert_equal(ingest(paths, ARM, executor=executor), expected)


def test_no_scheduler_is_one_message(monkeypatch) -> None:
    """An address at which nobody listens."""
    pytest.importorskip("distributed")
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    with pytest.raises(LogError) as refused, dask_workers("tcp://127.0.0.1:9"):
        pass
    assert refused.value.slug == "no-cluster" and "tcp://127.0.0.1:9" in str(refused.value)
