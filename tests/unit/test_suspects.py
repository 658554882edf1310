"""Columns that the user suspects reach the bins in the one pass, and change nothing else."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pumaid.dataset import Bins, Dataset
from pumaid.errors import LogError
from pumaid.io.log_reader import LogReader
from pumaid.preprocessing.binning import SegmentOptions
from pumaid.preprocessing.ingest import ingest
from pumaid.preprocessing.segment import segment
from pumaid.robot import Joint, Robot

ARM = Robot("arm", (Joint(1, "base", "revolute"), Joint(2, "arm", "revolute")))


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
    return segment(LogReader(path, ARM, extra=extra), ARM, options=SegmentOptions(**options))


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_a_suspect_is_a_mean_over_each_cell(tmp_path, name):
    """A voltage that falls by 1 V/s is, in each bin, 48 V less the bin's own time."""
    dataset = found(written(tmp_path / name, columns()))
    (run,) = dataset.runs
    assert dataset.extra == ("Vbus",)
    np.testing.assert_allclose(run.bins.extra, 48.0 - run.bins.time[:, None], atol=1e-9)


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_a_column_of_text_is_refused(tmp_path, name):
    """The message names the column that holds words."""
    path = written(tmp_path / name, columns() | {"Vbus": ["low"] * 1500})
    with pytest.raises(LogError, match="Vbus") as refused:
        found(path)
    assert refused.value.slug == "not-a-number"


def test_a_log_without_the_column_is_refused(tmp_path):
    """The nearest name is offered, whatever its capitals."""
    paths = [written(tmp_path / name, columns()) for name in ("a.csv", "b.parquet")]
    with pytest.raises(LogError, match="did you mean Vbus") as refused:
        ingest(paths, ARM, extra=("vbsu",))
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
