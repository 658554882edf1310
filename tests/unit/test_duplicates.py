"""Measurements that stand twice are told; repeats of a motion, with noise of their own, are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from motion_worlds import World, make, robot

from pumaid.errors import LogError
from pumaid.io.log_writer import write_log
from pumaid.io.paths import expand
from pumaid.preprocessing.ingest import ingest
from pumaid.preprocessing.replicates import duplicates

WORLD = World(motions=8, rate=200.0)
ARM = robot(WORLD)


@pytest.fixture
def logs(tmp_path) -> Path:
    """A folder with two logs of the same arm."""
    for seed in (1, 2):
        write_log(tmp_path / "logs" / f"day_{seed}.parquet", make(WORLD, seed).logs, ARM)
    return tmp_path / "logs"


def read(logs: Path, *, trust: bool = False):
    """The dataset of a folder."""
    paths = expand([logs])
    return ingest(paths, ARM, trust=trust)


def told(logs: Path) -> list[str]:
    """Texts of notes on runs that stand twice."""
    return [note.text for note in read(logs).notes if note.slug == "runs-doubled"]


def test_two_days_are_two_measurements(logs):
    """What was planned alike is measured with noise of its own."""
    assert len(read(logs).runs) > 8 and told(logs) == []


def test_a_copy_of_a_file_is_refused(logs):
    """It says which of the two; --trust takes both, and says it all the same."""
    (logs / "day_1 (copy).parquet").write_bytes((logs / "day_1.parquet").read_bytes())
    with pytest.raises(LogError) as refused:
        read(logs)
    assert refused.value.slug == "log-doubled"
    assert "day_1.parquet" in refused.value.what and "day_1 (copy).parquet" in refused.value.what
    assert [note.slug for note in read(logs, trust=True).notes].count("log-doubled") == 1


@pytest.mark.parametrize("places", [4, 6, 9])
def test_a_log_in_another_form_is_told(logs, places):
    """A text of a session beside its Parquet file, with as many places as loggers write."""
    table = pd.read_parquet(logs / "day_1.parquet")
    table.round(places).to_csv(logs / "day_1.csv", index=False)
    (text,) = told(logs)
    assert "day_1.parquet" in text and "day_1.csv" in text
    assert int(text.split()[0]) >= 0.8 * sum(run.origin.endswith("day_1.parquet") for run in read(logs).runs)


def test_a_part_of_another_log_is_told(logs):
    """Half of one day at the end of the other."""
    one, other = (pd.read_parquet(logs / f"day_{seed}.parquet") for seed in (1, 2))
    half = other.iloc[: len(other) // 2].copy()
    half["t"] += one["t"].iloc[-1] + 100.0
    pd.concat([one, half]).to_parquet(logs / "day_1.parquet", index=False)
    (text,) = told(logs)
    assert "day_1.parquet" in text and "day_2.parquet" in text


def test_a_part_that_stands_twice_in_one_file_is_told(logs):
    """A log whose end was added once more."""
    (logs / "day_2.parquet").unlink()
    one = pd.read_parquet(logs / "day_1.parquet")
    half = one.iloc[len(one) // 2 :].copy()
    half["t"] += one["t"].iloc[-1] + 1.0
    pd.concat([one, half]).to_parquet(logs / "day_1.parquet", index=False)
    (text,) = told(logs)
    assert text.count("day_1.parquet") == 1


@pytest.mark.parametrize("step", [0.05, 0.2, 0.5, 1.0])
def test_coarse_currents_are_no_copies(logs, step):
    """Repeats whose currents are read in steps larger than their noise often are the same: that says nothing."""
    for path in logs.iterdir():
        table = pd.read_parquet(path)
        names = [name for name in table if name.startswith("i")]
        table[names] = step * (table[names] / step).round()
        table.to_parquet(path, index=False)
    assert told(logs) == []


def test_thousands_of_repeats_are_no_copies():
    """Ten thousand runs of one motion, each with noise of its own, also coarse noise; one copy is found among them."""
    dataset = read_many(10_000, seed=3)
    assert list(duplicates(dataset)) == []
    copy = replace(dataset.runs[77], origin="b")
    (found,) = duplicates(replace(dataset, runs=(*dataset.runs, copy)))
    assert found.slug == "runs-doubled" and found.text.startswith("1 run is there twice")


def read_many(number: int, seed: int):
    """Evidence of many runs of one motion, whose currents are read in steps of half the noise."""
    from pumaid.dataset import Bins, Dataset

    rng, (run, *_) = np.random.default_rng(seed), make_runs()
    count = np.full(8, 40)
    runs = []
    for _ in range(number):
        samples = np.round(np.sin(np.arange(8) / 50.0)[:, None] + rng.normal(0.0, 0.02, (8, 40)), 2)
        pick = np.arange(8) % len(run.bins)
        bins = Bins(
            count,
            run.bins.time[pick],
            run.bins.position[pick],
            run.bins.velocity[pick],
            run.bins.acceleration[pick],
            samples.mean(axis=1),
            samples.var(axis=1),
            run.bins.temperature[pick],
        )
        runs.append(replace(run, bins=bins, origin="a"))
    return Dataset(tuple(runs))


def make_runs():
    """Runs of the small world."""
    from pumaid.preprocessing.segment import segment

    return segment(make(WORLD, 1).logs, ARM).runs
