"""Logs to a dataset: the same numbers however files are shared out, whichever worker dies; suspected columns too."""

import os
import random
import signal
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from motion_worlds import World, make, robot

from pumaid.dataset import Bins, Dataset, Log
from pumaid.errors import LogError
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import expand
from pumaid.io.write import write_log
from pumaid.preprocessing import ingest as module
from pumaid.preprocessing.binning import SegmentOptions
from pumaid.preprocessing.ingest import dask_workers, ingest, read_file
from pumaid.preprocessing.segment import segment
from pumaid.robot import Joint, Robot

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
    """Also in another format, at other times and with fewer rows, and whichever of the two comes first."""
    original, copy = paths[0], tmp_path / "copy.csv"
    log = Log.joined(list(LogReader(original, ARM)))
    for part, late in ((slice(None), 0.0), (slice(None), 1e3), (slice(37, -400), 0.5)):
        write_log(copy, [replace(log.part(part), time=log.time[part] + late)], ARM)
        for pair in ((original, copy), (copy, original)):
            with pytest.raises(LogError) as refused:
                ingest(pair, ARM)
            assert (
                refused.value.slug == "log-doubled" and f"{pair[1]} has the samples of {pair[0]}" in refused.value.what
            )
    assert [note.slug for note in ingest([original, copy], ARM, trust=True).notes].count("log-doubled") == 1


def test_a_file_in_another_unit_is_told_apart(tmp_path) -> None:
    """Of a file in mA among files in A the refusal names this one, and another way to mend it; of all the first."""
    for scales, which, is_alone in (((1.0, 1e3, 1.0), 1, True), ((1e3, 1e3, 1e3), 0, False)):
        for number, scale in enumerate(scales):
            logs = [replace(log, current=scale * log.current) for log in make(WORLD, number).logs]
            write_log(tmp_path / f"{number}.csv", logs, ARM)
        with pytest.raises(LogError) as refused:
            ingest(expand([tmp_path]), ARM)
        assert refused.value.where.file == str(tmp_path / f"{which}.csv") and "mA" in refused.value.mend
        assert ("of 3 logs this is of" in refused.value.mend) == is_alone


def test_notes_of_one_kind_do_not_flood(tmp_path) -> None:
    """Of eight files with gaps of their own three are told in full, and how many more there are."""
    for number in range(8):
        logs = make(WORLD, number).logs
        logs = [replace(log, time=log.time + (1.0 + number) * (np.arange(len(log)) > 50)) for log in logs]
        write_log(tmp_path / f"{number}.csv", logs[:1], ARM)
    notes = [note for note in ingest(expand([tmp_path]), ARM, trust=True).notes if note.slug == "gaps"]
    assert len(notes) == 4 and "5 more notes of this kind" in notes[-1].text


def test_a_refused_file_is_refused_by_its_worker_too(paths, tmp_path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("t,q1,i1\n0,1,2\n")
    with ProcessPoolExecutor(2) as executor, pytest.raises(LogError) as refused:
        ingest([*paths, bad], ARM, executor=executor)
    assert refused.value.slug == "column-missing" and refused.value.where.file == str(bad)


@pytest.mark.slow
def test_dask_workers_leave_the_same(paths, expected) -> None:
    """Workers of dask.distributed on this machine, one of which is killed."""
    distributed, alone = pytest.importorskip("distributed"), {"threads_per_worker": 1, "dashboard_address": ":0"}
    with distributed.LocalCluster(2, **alone) as cluster, dask_workers(cluster.scheduler_address) as executor:
        assert_equal(ingest(paths, ARM, executor=executor), expected)


def test_no_scheduler_is_one_message(monkeypatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    with pytest.raises(LogError) as refused, dask_workers("tcp://127.0.0.1:9"):
        pass
    assert refused.value.slug == "no-cluster" and "tcp://127.0.0.1:9" in str(refused.value)


PAIR = Robot("arm", (Joint(1, "base", "revolute"), Joint(2, "arm", "revolute")))


def columns(n_rows: int = 1500, *, start: float = 0.0, stop: float = 2.5) -> dict[str, list[float] | list[str]]:
    """Joint 2 from rest to a constant 0.5 rad/s to rest (at `stop`, s), 500 Hz; a supply voltage falls by 1 V/s."""
    clock = np.arange(n_rows) / 500.0
    ends = np.clip((clock - 0.5) / 0.1, 0.0, 1.0) * np.clip((stop - clock) / 0.1, 0.0, 1.0)
    position = np.cumsum(0.5 * ends) / 500.0
    noise = np.random.default_rng(2).normal(scale=0.02, size=(2, n_rows))
    table = {"t": start + clock, "q1": 0.3 + 0 * clock, "q2": position, "i1": noise[0], "i2": 1 + noise[1]}
    return {name: values.tolist() for name, values in table.items()} | {"Vbus": (48.0 - clock).tolist()}


def written(path: Path, table: dict[str, list]) -> Path:
    """The table as CSV or Parquet, by what the file is called."""
    if path.suffix == ".parquet":
        pq.write_table(pa.table(table), path)
    else:
        rows = zip(*table.values(), strict=True)
        path.write_text("\n".join([",".join(table), *(",".join(str(cell) for cell in row) for row in rows)]) + "\n")
    return path


def found(path: Path, *, extra: tuple[str, ...] = ("Vbus",), **options: int) -> Dataset:
    """What the one pass leaves."""
    return segment(LogReader(path, PAIR, extra=extra), PAIR, options=SegmentOptions(**options))


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_a_suspect_is_a_mean_over_each_cell(tmp_path, name):
    """A voltage that falls by 1 V/s is, in each bin, 48 V less the bin's own time."""
    dataset = found(written(tmp_path / name, columns()))
    (run,) = dataset.runs
    assert dataset.extra == ("Vbus",)
    np.testing.assert_allclose(run.bins.extra, 48.0 - run.bins.time[:, None], atol=1e-9)


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_a_column_of_text_is_refused(tmp_path, name):
    path = written(tmp_path / name, columns() | {"Vbus": ["low"] * 1500})
    with pytest.raises(LogError, match="Vbus") as refused:
        found(path)
    assert refused.value.slug == "not-a-number"


def test_a_log_without_the_column_is_refused(tmp_path):
    paths = [written(tmp_path / name, columns()) for name in ("a.csv", "b.parquet")]
    with pytest.raises(LogError, match="did you mean Vbus") as refused:
        ingest(paths, PAIR, extra=("vbsu",))
    assert refused.value.slug == "column-missing"


def test_empty_cells_are_left_out_of_the_means(tmp_path):
    """Half of the voltages are missing: the means are of those that are there, and no sample is lost."""
    table = columns()
    table["Vbus"] = [value if row % 2 else "" for row, value in enumerate(table["Vbus"])]
    (run,) = found(written(tmp_path / "a.csv", table), max_bins=40).runs
    (whole,) = found(written(tmp_path / "b.csv", columns()), max_bins=40).runs
    assert run.samples == whole.samples
    np.testing.assert_allclose(run.bins.extra, whole.bins.extra, atol=2.5e-3)  # one sample is 2 ms


def test_nothing_else_changes(tmp_path):
    """With a suspect, doubled rows, empty bins and a run over two windows, all else is the same to the bit."""
    table = columns(3500, stop=6.5)
    doubled = {name: [v for v in values for _ in range(2)] for name, values in table.items()}
    doubled["Vbus"] = [value if row % 3 else "nan" for row, value in enumerate(doubled["Vbus"])]
    path = written(tmp_path / "a.csv", doubled)
    plain, suspect = found(path, extra=(), max_bins=40, window=2048), found(path, max_bins=40, window=2048)
    for one, other in zip(plain.runs, suspect.runs, strict=True):
        assert other.bins.extra.shape == (len(one.bins), 1)
        names = [item.name for item in fields(Bins) if getattr(one.bins, item.name) is not None]
        assert all(np.array_equal(getattr(one.bins, n), getattr(other.bins, n), equal_nan=True) for n in names)
    assert (plain.notes, plain.files) == (suspect.notes, suspect.files)
    assert [left.text for left in plain.rejects] == [left.text for left in suspect.rejects]
