"""The dataset file: to the bit as it was written, refused where it is damaged or of other logs."""

import io
import random
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from motion_worlds import World, make, robot

from pumaid.dataset import Dataset, load_dataset, save_dataset
from pumaid.experiment import dataset_inputs, keep_dataset, read_dataset
from pumaid.io.write import write_log
from pumaid.preprocessing.ingest import ingest
from pumaid.robot import Robot

WORLD = World(motions=4, rate=100.0)
ARM = robot(WORLD)


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    """Two logs of an arm, one with a gap that is worth a note."""
    folder = tmp_path_factory.mktemp("logs")
    for seed in (1, 2):
        write_log(folder / f"day_{seed}.parquet", make(WORLD, seed).logs, ARM)
    return folder


@pytest.fixture(scope="module")
def dataset(logs) -> Dataset:
    """The dataset of the logs."""
    return ingest(sorted(logs.iterdir()), ARM)


def written(dataset: Dataset, path: Path) -> Path:
    """The dataset in a file."""
    with path.open("wb") as sink:
        save_dataset(sink, dataset, {"logs": "these"})
    return path


def same(one: object, other: object) -> bool:
    """Whether two records hold the same, NaN and all, to the bit."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if hasattr(one, "__dataclass_fields__"):
        return type(one) is type(other) and all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and repr(one) == repr(other)


def test_what_is_saved_is_loaded(dataset, tmp_path) -> None:
    """Every number of every run, reject, file and note, to the bit; with suspected columns; without a run."""
    assert len(dataset.runs) > 4 and len(dataset.rejects) > 4
    runs = tuple(replace(run, bins=replace(run.bins, extra=np.ones((len(run.bins), 2)))) for run in dataset.runs)
    more = replace(dataset, runs=runs, extra=("Vbus", "oil"))
    for saved in (dataset, more, Dataset((), files=dataset.files)):
        loaded, made_from = load_dataset(written(saved, tmp_path / "d.npz"))
        assert same(loaded, saved) and made_from == {"logs": "these"}


@pytest.mark.parametrize("seed", range(8))
def test_damage_is_noticed(dataset, tmp_path, seed) -> None:
    """A bit turned anywhere, or an end cut off: the dataset comes back whole or not at all."""
    path, rng = written(dataset, tmp_path / "d.npz"), random.Random(seed)
    content = bytearray(path.read_bytes())
    place = rng.randrange(len(content))
    content[place] ^= 1 << rng.randrange(8)
    path.write_bytes(content if seed % 4 else content[:place])
    try:
        assert same(load_dataset(path)[0], dataset)
    except ValueError:
        return


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"not a dataset", bytes(1000)])
def test_what_is_no_dataset_is_refused(tmp_path, content) -> None:
    """Any other file, a folder, and an array that would have to be unpickled."""
    (tmp_path / "a.npz").write_bytes(content)
    pickled = io.BytesIO()
    np.savez(pickled, about=np.array([{}], dtype=object))
    (tmp_path / "b.npz").write_bytes(pickled.getvalue())
    np.save(tmp_path / "c.npy", np.zeros(3))
    for path in (*sorted(tmp_path.iterdir()), tmp_path):
        with pytest.raises(ValueError):
            load_dataset(path)


def remembered(
    logs: Path, file: Path, *, robot: Robot = ARM, plan: Path | None = None, **settings: object
) -> Dataset | None:
    """What is read of the file of these logs' dataset."""
    return read_dataset(file, sorted(logs.iterdir()), dataset_inputs(robot, plan, **settings), tell=print)


def test_it_is_used_for_these_logs_only(logs, dataset, tmp_path, capsys) -> None:
    """Another recipe, plan, options, another log, a changed one: each is a reason to read again, and is told."""
    file = tmp_path / "dataset.npz"
    keep_dataset(file, dataset, dataset_inputs(ARM), tell=print)
    assert "dataset written to" in capsys.readouterr().out
    assert same(remembered(logs, file), dataset) and capsys.readouterr().out == ""
    changed = tmp_path / "logs"
    changed.mkdir()
    for path in logs.iterdir():
        (changed / path.name).write_bytes(path.read_bytes())
    for reason, folder, inputs in (
        ("recipe", logs, {"robot": replace(ARM, name="another")}),
        ("plan", logs, {"plan": next(logs.iterdir())}),
        ("options", logs, {"trust": True}),
        ("logs", changed, {}),
    ):
        assert remembered(folder, file, **inputs) is None and f"other {reason}" in capsys.readouterr().out


def test_a_folder_that_cannot_be_written_stops_nothing(dataset, tmp_path, capsys) -> None:
    (tmp_path / "results").write_text("a file")
    keep_dataset(tmp_path / "results" / "dataset.npz", dataset, {}, tell=print)
    assert "not kept" in capsys.readouterr().out
