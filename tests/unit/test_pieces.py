"""Files in pieces, on several cores: the same as in one pass, to the bit."""

from __future__ import annotations

import os
import signal
from itertools import pairwise

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sessions import Eager, make_session, same

from pumaid.cluster import cores, pieces
from pumaid.cluster import gather as gathering
from pumaid.cluster.cores import Mate, others, spread, started
from pumaid.cluster.gather import gather
from pumaid.cluster.pieces import Reading, pieces_of
from pumaid.cluster.whole import Whole
from pumaid.errors import LogError
from pumaid.files import intervals, parts
from pumaid.files.recipe import read_recipe
from pumaid.files.table import LogReader, expand
from pumaid.motion.options import DEFAULTS, SegmentOptions
from pumaid.motion.suspicion import Watch
from pumaid.verbs.segment import segment

#: Rows from which a row group is a piece here; in earnest they are 150 000.
ROWS = 600


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A pendulum's session in one Parquet file, and its recipe."""
    return make_session(tmp_path_factory.mktemp("pieces"))


@pytest.fixture
def small_parts(monkeypatch):
    """Pieces of a few hundred rows; in earnest, too, the first one tells the file's sampling interval."""
    monkeypatch.setattr(parts, "PART_ROWS", ROWS)
    monkeypatch.setattr(intervals, "PROBE", 50)


def table_of(logs) -> pa.Table:
    return pq.read_table(expand([logs / "logs"])[0])


def written(folder, table: pa.Table, *, rows: int = ROWS, number: int = 0):
    """The table as a file of row groups."""
    folder.mkdir(exist_ok=True)
    pq.write_table(table, folder / f"session_{number}.parquet", row_group_size=rows)
    return expand([folder])


def changed(table: pa.Table, name: str, change) -> pa.Table:
    values = table[name].to_numpy().copy()
    change(values)
    return table.set_column(table.column_names.index(name), name, [values])


def one_pass(paths, robot):
    return segment(Watch(LogReader(paths, robot), robot), robot)


def in_pieces(paths, robot, *, mates: int = 0):
    reading = Reading(robot, DEFAULTS)
    with started(reading, mates) as processes:
        return spread(paths, reading, processes)


def test_row_groups_are_the_whole(logs, tmp_path, small_parts):
    """Row groups that end in the middle of motions leave the runs of one pass, to the bit, and the file's facts."""
    robot = read_recipe(logs / "recipe.yaml")
    paths = written(tmp_path / "logs", table_of(logs))
    assert len(pieces_of(paths[0])) > 5
    assert same(in_pieces(paths, robot), one_pass(paths, robot))


def test_row_groups_are_tasks_of_a_cluster(logs, tmp_path, small_parts):
    """On a cluster each row group is a task, and the runs are those of one pass, to the bit."""
    robot, client = read_recipe(logs / "recipe.yaml"), Eager()
    for number in (0, 1):
        paths = written(tmp_path / "logs", table_of(logs), number=number)
    assert same(gather(paths, robot, client), one_pass(paths, robot))
    assert client.calls.count("tried") == sum(len(pieces_of(path)) for path in paths) > 10


def test_of_many_files_small_ones_are_not_cut(logs, tmp_path, small_parts, monkeypatch):
    """Where every reader has files enough, only large ones are read in pieces."""
    robot, client = read_recipe(logs / "recipe.yaml"), Eager()
    for number in range(4):
        paths = written(tmp_path / "logs", table_of(logs), number=number)
    assert same(gather(paths, robot, client), one_pass(paths, robot))
    assert client.calls.count("tried") == len(paths)
    monkeypatch.setattr(pieces, "SMALL", min(path.stat().st_size for path in paths) - 1)
    assert len(pieces_of(paths[0], each=4.0)) == len(pieces_of(paths[0])) > 5


def test_row_groups_in_a_store_are_read_where_they_lie(logs, tmp_path, small_parts):
    """Pieces of a file in fsspec's memory store leave the runs of the file on disk, and its digest."""
    fsspec = pytest.importorskip("fsspec")
    robot, paths = read_recipe(logs / "recipe.yaml"), written(tmp_path / "logs", table_of(logs))
    fsspec.filesystem("memory").pipe("/pieces/session.parquet", paths[0].read_bytes())
    stored = expand(["memory://pieces/session.parquet"])
    assert len(pieces_of(stored[0])) > 5
    found, wanted = in_pieces(stored, robot), one_pass(paths, robot)
    assert found.files[0].digest == wanted.files[0].digest and found.files[0].rows == wanted.files[0].rows
    for one, other in zip(found.runs, wanted.runs, strict=True):
        assert np.array_equal(one.triangle.factor, other.triangle.factor)


def test_parts_need_no_seam_at_rest(logs, tmp_path, small_parts, monkeypatch):
    """A piece in which the arm never rests is completed by its neighbours."""
    robot = read_recipe(logs / "recipe.yaml")
    monkeypatch.setattr(parts, "PART_ROWS", 60)
    paths = written(tmp_path / "logs", table_of(logs), rows=60)
    reading = Reading(robot, DEFAULTS)
    assert any(reading.piece(piece).is_open for piece in pieces_of(paths[0]))
    assert same(in_pieces(paths, robot), one_pass(paths, robot))


@pytest.mark.parametrize("fault", ["gap", "wrap", "nan", "step"])
def test_what_is_worth_a_note_is_read_as_a_whole(logs, tmp_path, small_parts, fault):
    """Lost samples, a turn of the encoder, rows without a number: notes and runs are those of the whole file."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    if fault == "gap":
        table = pa.concat_tables([table.slice(0, 3 * ROWS), table.slice(3 * ROWS + 200)])
    elif fault == "wrap":
        table = changed(table, "q1", lambda values: np.add(values[2 * ROWS :], 2 * np.pi, out=values[2 * ROWS :]))
    elif fault == "nan":
        table = changed(table, "q2", lambda values: values[700:720].fill(np.nan))
    else:
        table = pa.concat_tables([table.slice(0, 2 * ROWS), table.slice(2 * ROWS - 1)])
    paths = written(tmp_path / "logs", table)
    found, wanted = in_pieces(paths, robot), one_pass(paths, robot)
    assert same(found, wanted)
    assert {note.slug for note in found.notes} & {"gaps", "position-wraps", "bad-samples", "time-repeated"}


def test_other_processes_change_nothing(logs, tmp_path, small_parts):
    """Three processes that read five files leave what one does, to the bit."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    for number in range(5):
        paths = written(tmp_path / "logs", table.slice(number * 700), number=number)
    assert same(in_pieces(paths, robot, mates=2), one_pass(paths, robot))


def test_the_first_file_that_is_refused_is_told(logs, tmp_path):
    """Of two bad files the first is named, whichever process reads it, and no process is left."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    for number in range(6):
        paths = written(tmp_path / "logs", table, number=number)
    for number in (2, 4):
        paths[number].write_bytes(paths[number].read_bytes()[:-50])
    reading = Reading(robot, DEFAULTS)
    with pytest.raises(LogError) as error, started(reading, 2) as mates:
        spread(paths, reading, mates)
    assert "session_2" in str(error.value)
    assert not any(mate.is_alive for mate in mates)


def test_a_process_that_is_killed_loses_nothing(logs, tmp_path):
    """Where another process is gone, this one reads its pieces."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    for number in range(4):
        paths = written(tmp_path / "logs", table, number=number)
    reading = Reading(robot, DEFAULTS)
    with started(reading, 2) as mates:
        os.kill(mates[0].pid, signal.SIGKILL)
        found = spread(paths, reading, mates)
    assert same(found, one_pass(paths, robot))


def test_a_process_is_started_only_where_it_pays(tmp_path):
    """Small logs and pipes are read by one process, 100 MB by as many as there may be."""
    small, large = tmp_path / "small.csv", tmp_path / "large.csv"
    small.write_bytes(b"t\n")
    large.touch()
    os.truncate(large, 100 << 20)
    assert [
        others([small], 8),
        others([large] * 4, 1),
        others([large] * 4, 4),
        others([large, tmp_path / "none"], 4),
    ] == [
        0,
        0,
        3,
        0,
    ]
    assert others([large], 4) == 0  # a text log is one piece


def test_a_process_that_cannot_be_started_is_done_without(logs, tmp_path, monkeypatch):
    """Where the system has no more processes, this one reads everything."""
    robot, table, begun = read_recipe(logs / "recipe.yaml"), table_of(logs), []

    def mate(reading):
        if begun:
            raise OSError(11, "Resource temporarily unavailable")
        begun.append(Mate(reading))
        return begun[0]

    monkeypatch.setattr(cores, "Mate", mate)
    for number in range(3):
        paths = written(tmp_path / "logs", table, number=number)
    with started(Reading(robot, DEFAULTS), 3) as mates:
        assert mates == begun
        assert same(spread(paths, Reading(robot, DEFAULTS), mates), one_pass(paths, robot))


@pytest.mark.parametrize("fault", [MemoryError(), OSError(), EOFError()])
def test_what_another_process_cannot_hand_over_is_read_here(logs, tmp_path, small_parts, fault):
    """Whatever goes wrong between two processes, no piece is lost and nobody waits for ever."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)

    class Broken:
        def ask(self, piece):
            pass

        def take(self):
            raise fault

    for number in range(2):
        paths = written(tmp_path / "logs", table, number=number)
    assert same(spread(paths, Reading(robot, DEFAULTS), [Broken(), Broken()]), one_pass(paths, robot))


@pytest.mark.parametrize("seed", range(12))
def test_however_logs_are_cut_and_joined(logs, tmp_path, small_parts, monkeypatch, seed):
    """Random files with gaps, restarts, rows without a number and no rest, in random pieces, windows and trees."""
    robot, rng = read_recipe(logs / "recipe.yaml"), np.random.default_rng(seed)
    table = table_of(logs).to_pandas()
    monkeypatch.setattr(parts, "PART_ROWS", int(rng.choice([80, 400, 1500, 10**6])))
    monkeypatch.setattr(gathering, "_ENOUGH", int(rng.integers(1, 4)))
    monkeypatch.setattr(pieces, "_ENOUGH", int(rng.choice([1, 4, 100])))
    monkeypatch.setattr(gathering, "SMALL", int(rng.choice([1, 30_000, 10**7])))
    options = SegmentOptions(window=int(rng.choice([2048, 3000, 262_144])))
    cuts = np.unique([0, len(table), *rng.integers(0, len(table), int(rng.integers(1, 12)))])
    for number, (start, stop) in enumerate(pairwise(cuts.tolist())):
        part = table.iloc[start:stop].copy()
        if rng.random() < 0.2 and len(part) > 60:
            part = part.drop(part.index[30 : 30 + int(rng.integers(1, 29))])
        if rng.random() < 0.2:
            part["t"] -= part["t"].iloc[0]
        if rng.random() < 0.1 and len(part) > 100:
            part.iloc[40:44, 1] = np.nan
        if rng.random() < 0.15:
            part = part[part["qd1"].abs() + part["qd2"].abs() > 0.05]
        rows = int(rng.choice([50, 300, 2000]))
        paths = written(tmp_path / "logs", pa.Table.from_pandas(part, preserve_index=False), rows=rows, number=number)
    wanted = segment(Watch(LogReader(paths, robot), robot, refuse=False), robot, options=options)
    assert same(spread(paths, Reading(robot, options), [], refuse=False), wanted)
    assert same(gather(paths, robot, Eager(), options=options, refuse=False), wanted)


def test_only_small_files_are_joined_where_they_lie(logs, tmp_path, monkeypatch):
    """Of hundreds of files some come joined, never more than a message's worth; the runs are those of one pass."""
    robot, table, client = read_recipe(logs / "recipe.yaml"), table_of(logs), Eager()
    for number in range(12):
        paths = written(tmp_path / "logs", table.slice(number * 500, 500), number=number)
    sizes = [path.stat().st_size for path in paths]
    monkeypatch.setattr(gathering, "_ENOUGH", 2)
    monkeypatch.setattr(gathering, "SMALL", 4 * max(sizes))
    assert same(gather(paths, robot, client), one_pass(paths, robot))
    assert 12 / 8 < client.calls.count("joined") < 12 / 2


def test_an_arm_that_never_rests_is_not_kept_waiting(logs, tmp_path):
    """Of file after file without rest this process holds a window of samples, not all of them."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs).to_pandas()
    moving = table[table["qd1"].abs() + table["qd2"].abs() > 0.05].head(400)
    options, step = SegmentOptions(window=2048), moving["t"].iloc[-1] - moving["t"].iloc[0] + 0.01
    reading, whole, held = Reading(robot, options), Whole(robot, options), []
    for number in range(20):
        part = moving.assign(t=moving["t"] + number * step)
        paths = written(tmp_path / "logs", pa.Table.from_pandas(part, preserve_index=False), number=number)
        read = reading.file(paths[-1])
        assert read.is_open
        whole.add(read)
        held.append(len(whole._between._buffer))
    assert max(held) < 2 * options.window < 20 * len(moving)
    assert same(
        whole.evidence(refuse=False),
        segment(Watch(LogReader(paths, robot), robot, refuse=False), robot, options=options),
    )


def test_small_row_groups_go_together():
    """Parts have 150 000 rows at least, the last what is left, and together all groups."""
    found = parts.parts_of_rows([1000] * 400)
    assert [len(part) for part in found] == [150, 250] and parts.parts_of_rows([400_000]) == [range(1)]
    assert [len(part) for part in parts.parts_of_rows([1 << 20] * 3)] == [1, 1, 1]
