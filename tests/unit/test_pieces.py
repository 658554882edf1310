"""Files in pieces, on several cores: the same as in one pass, to the bit."""

from __future__ import annotations

import gzip
import hashlib
import os
import signal
import time
from itertools import pairwise
from unittest.mock import MagicMock

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sessions import Eager, make_session, same

from pumaid.cluster import cores, desk, pieces
from pumaid.cluster import gather as gathering
from pumaid.cluster.cores import others, spread
from pumaid.cluster.desk import started
from pumaid.cluster.gather import gather
from pumaid.cluster.mate import Mate
from pumaid.cluster.pieces import Reading, pieces_of
from pumaid.cluster.whole import Whole
from pumaid.errors import LogError
from pumaid.io import intervals, parts, text_blocks
from pumaid.io.recipe import read_recipe
from pumaid.io.table import LogReader, expand
from pumaid.preprocessing.options import DEFAULTS, SegmentOptions
from pumaid.preprocessing.suspicion import Watch
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
    monkeypatch.setattr(parts, "TEXT_ROWS", ROWS)
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
    with started(reading.tried, mates) as processes:
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
    assert client.calls.count("_tried") == sum(len(pieces_of(path)) for path in paths) > 10


def test_of_many_files_small_ones_are_not_cut(logs, tmp_path, small_parts, monkeypatch):
    """Where every reader has files enough, only large ones are read in pieces."""
    robot, client = read_recipe(logs / "recipe.yaml"), Eager()
    for number in range(4):
        paths = written(tmp_path / "logs", table_of(logs), number=number)
    assert same(gather(paths, robot, client), one_pass(paths, robot))
    assert client.calls.count("_tried") == len(paths)
    monkeypatch.setattr(pieces, "SMALL", min(path.stat().st_size for path in paths) - 1)
    assert len(pieces_of(paths[0], each=4.0)) == len(pieces_of(paths[0])) > 5
    # Text takes more bytes for the same rows.
    text = as_text(tmp_path / "texts", table_of(logs))
    assert len(pieces_of(text[0])) > 5 and pieces_of(text[0], each=4.0) == text
    monkeypatch.setattr(pieces, "SMALL", text[0].stat().st_size // parts.TEXT_BYTES - 1)
    assert len(pieces_of(text[0], each=4.0)) > 5


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


def taken(paths, robot):
    """What is left of the pieces of one file, and whether it was read once more as a whole."""
    reading, again = Reading(robot, DEFAULTS), []
    cut = pieces_of(paths[0])
    assert len(cut) > 5

    def at_once():
        again.append(True)
        return reading.file(paths[0])

    found = (reading.piece(piece) for piece in cut)
    state = pieces.state_of(paths[0])
    whole = pieces.file_taken(Whole(robot, DEFAULTS), found, len(cut), path=paths[0], state=state, again=at_once)
    return whole.dataset(refuse=True), bool(again)


FAULTS = {
    "gap": ("gaps", False),
    "gap at a border": ("gaps", False),
    "gaps": ("gaps", False),
    "nan": ("bad-samples", False),
    "nan at a border": ("bad-samples", False),
    "no velocity": ("velocity-absent", False),
    "ties": ("time-repeated", False),
    "tie at a border": ("time-repeated", True),
    "wrap": ("position-wraps", True),
    "restart": ("clock-restarts", True),
}


@pytest.mark.parametrize("form", ["parquet", "text"])
@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_worth_a_note(logs, tmp_path, small_parts, fault, form):
    """Of pieces with lost samples, rows without a number and times that repeat notes and runs are those of the whole;
    only turns of the encoder, recordings that begin anew and the like have the file read once more."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    if fault == "gap":
        table = without(table, 3 * ROWS + 100, 300)
    elif fault == "gap at a border":
        table = without(table, 3 * ROWS, 200)
    elif fault == "gaps":
        for start in (700, 2100, 3000, 3100, 4000, 4900):
            table = without(table, start, 40)
    elif fault == "nan":
        table = changed(table, "q2", lambda values: values[700:720].fill(np.nan))
        table = changed(table, "i1", lambda values: values[3000:3020].fill(np.nan))
    elif fault == "nan at a border":
        table = changed(table, "q2", lambda values: values[ROWS - 3 : ROWS + 3].fill(np.nan))
    elif fault == "no velocity":
        table = changed(table, "qd2", lambda values: values[500:4500:3].fill(np.nan))
    elif fault == "ties":
        for start in (650, 2222, 2300, 4700):
            table = changed(table, "t", lambda values, at=start: values.__setitem__(at, values[at - 1]))
    elif fault == "tie at a border":
        for start in range(2 * ROWS - 40, 2 * ROWS + 40):  # a text's borders lie where they lie
            table = changed(table, "t", lambda values, at=start: values.__setitem__(at, values[at - 1 + at % 2]))
    elif fault == "wrap":
        table = changed(table, "q1", lambda values: np.add(values[2 * ROWS :], 2 * np.pi, out=values[2 * ROWS :]))
    else:
        table = changed(table, "t", lambda values: np.subtract(values[3000:], values[3000], out=values[3000:]))
    as_file = written if form == "parquet" else as_text
    paths = as_file(tmp_path / "logs", table)
    found, again = taken(paths, robot)
    assert same(found, one_pass(paths, robot))
    assert FAULTS[fault][0] in {note.slug for note in found.notes}
    if (form, fault) != ("text", "tie at a border"):
        assert again == FAULTS[fault][1]


def without(table: pa.Table, start: int, count: int) -> pa.Table:
    return pa.concat_tables([table.slice(0, start), table.slice(start + count)])


@pytest.mark.parametrize("fault", ["bad", "ties"])
def test_too_much_is_refused_of_the_whole(logs, tmp_path, small_parts, fault):
    """A tenth of all rows has no number, though some pieces lack none; a clock stands still half of the time."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    if fault == "bad":
        table = changed(table, "q2", lambda values: values[4000 : 4000 + len(values) // 10].fill(np.nan))
    else:
        table = changed(table, "t", lambda values: values.__setitem__(slice(None), np.floor(20 * values)))
    paths = written(tmp_path / "logs", table)
    with pytest.raises(LogError) as one:
        one_pass(paths, robot)
    with pytest.raises(LogError) as other:
        in_pieces(paths, robot)
    assert str(one.value) == str(other.value)
    assert one.value.slug == {"bad": "bad-samples", "ties": "clock-too-coarse"}[fault]


def test_a_gap_hangs_on_the_whole_file(logs, tmp_path, small_parts):
    """Slow logs of which one part was sampled faster: what is a gap there by itself is none in the whole file."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    times = table["t"].to_numpy()
    slow = times[0] + 8.0 * (times - times[0])  # 0.16 s apart; a gap is 0.8 s
    slow[2 * ROWS :] -= np.cumsum(np.full(len(slow) - 2 * ROWS, 0.08))  # then 0.08 s apart
    slow[2 * ROWS + 900 :] += 0.5
    paths = written(tmp_path / "logs", table.set_column(0, "t", [slow]))
    found, again = taken(paths, robot)
    assert again and same(found, one_pass(paths, robot))
    assert "gaps" not in {note.slug for note in found.notes}


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
    with pytest.raises(LogError) as error, started(reading.tried, 2) as mates:
        spread(paths, reading, mates)
    assert "session_2" in str(error.value)
    assert not any(mate.is_alive for mate in mates)


def test_a_process_that_is_killed_loses_nothing(logs, tmp_path):
    """Where another process is gone, this one reads its pieces."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    for number in range(4):
        paths = written(tmp_path / "logs", table, number=number)
    reading = Reading(robot, DEFAULTS)
    with started(reading.tried, 2) as mates:
        os.kill(mates[0].pid, signal.SIGKILL)
        found = spread(paths, reading, mates)
    assert same(found, one_pass(paths, robot))


def test_the_others_have_begun_meanwhile(logs, tmp_path):
    """What this process does first does not hold up the others, and what goes wrong in it leaves no process behind."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    for number in range(4):
        paths = written(tmp_path / "logs", table, number=number)
    reading = Reading(robot, DEFAULTS)

    def until_some_are_read():
        deadline = time.monotonic() + 60.0
        while not any(asked) and time.monotonic() < deadline:
            time.sleep(0.01)

    with started(reading.tried, 1) as mates:
        asked = []
        take = mates[0].take
        mates[0].take = lambda: (take(), asked.append(True))[0]
        found = spread(paths, reading, mates, meanwhile=until_some_are_read)
        assert asked
    assert same(found, one_pass(paths, robot))
    with pytest.raises(ZeroDivisionError), started(reading.tried, 1) as mates:
        spread(paths, reading, mates, meanwhile=lambda: 1 // 0)
    assert not mates[0].is_alive


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
    assert others([large], 4) == 0  # no line to cut behind


def test_a_busy_process_has_even_small_logs_read_by_another(tmp_path, monkeypatch):
    """Where one can be forked at once, cores and --jobs allow it, and there is more than a moment's reading."""
    tiny, small, large = tmp_path / "tiny.csv", tmp_path / "small.csv", tmp_path / "large.csv"
    for path, size in ((tiny, 1 << 10), (small, 1 << 20), (large, 100 << 20)):
        path.touch()
        os.truncate(path, size)
    monkeypatch.setattr(cores, "CAN_FORK", True)
    asked = [([tiny], 8), ([small], 8), ([small], 1), ([large] * 4, 4), ([large], 4), ([tmp_path / "none"], 4)]
    assert [others(paths, jobs, is_busy=True) for paths, jobs in asked] == [0, 1, 0, 3, 1, 0]
    monkeypatch.setattr(cores, "CAN_FORK", False)
    assert [others(paths, jobs, is_busy=True) for paths, jobs in asked] == [0, 0, 0, 3, 0, 0]


def test_a_process_that_cannot_be_started_is_done_without(logs, tmp_path, monkeypatch):
    """Where the system has no more processes, this one reads everything."""
    robot, table, begun = read_recipe(logs / "recipe.yaml"), table_of(logs), []

    def mate(reading):
        if begun:
            raise OSError(11, "Resource temporarily unavailable")
        begun.append(Mate(reading))
        return begun[0]

    monkeypatch.setattr(desk, "Mate", mate)
    for number in range(3):
        paths = written(tmp_path / "logs", table, number=number)
    with started(Reading(robot, DEFAULTS).tried, 3) as mates:
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
    """Random files with gaps, restarts, missing numbers and no rest, in random pieces, windows and trees."""
    robot, rng = read_recipe(logs / "recipe.yaml"), np.random.default_rng(seed)
    table = table_of(logs).to_pandas()
    monkeypatch.setattr(parts, "PART_ROWS", int(rng.choice([80, 400, 1500, 10**6])))
    monkeypatch.setattr(parts, "TEXT_ROWS", int(rng.choice([80, 400, 1500, 10**6])))
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
        if rng.random() < 0.3 and len(part) > 60:
            for name in ("i1", "i2", "qd1", "qd2"):
                part.loc[rng.random(len(part)) < rng.choice([0.01, 0.7]), name] = np.nan
        if rng.random() < 0.15:
            part = part[part["qd1"].abs() + part["qd2"].abs() > 0.05]
        rows, as_table = int(rng.choice([50, 300, 2000])), pa.Table.from_pandas(part, preserve_index=False)
        if rng.random() < 0.4:
            paths = as_text(tmp_path / "logs", as_table, number=number)
        else:
            paths = written(tmp_path / "logs", as_table, rows=rows, number=number)
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
        whole.dataset(refuse=False),
        segment(Watch(LogReader(paths, robot), robot, refuse=False), robot, options=options),
    )


def test_small_row_groups_go_together():
    """Parts have 150 000 rows at least, the last what is left, and together all groups."""
    found = parts.parts_of_rows([1000] * 400)
    assert [len(part) for part in found] == [150, 250] and parts.parts_of_rows([400_000]) == [range(1)]
    assert [len(part) for part in parts.parts_of_rows([1 << 20] * 3)] == [1, 1, 1]


def as_text(folder, table: pa.Table, *, number: int = 0, change=lambda text: text):
    """The table as a text, as some program writes it."""
    folder.mkdir(exist_ok=True)
    text = change(table.to_pandas().to_csv(index=False))
    (folder / f"session_{number}.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    return expand([folder])


def with_blanks(text: str) -> str:
    """Empty lines and comments between the rows."""
    lines = text.splitlines()
    return "\n".join([*lines[:900], "", "# a pause", *lines[900:2500], *[""] * 300, *lines[2500:]]) + "\n"


TEXTS = {
    "lines": lambda text: text,
    "windows": lambda text: text.replace("\n", "\r\n"),
    "mark": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "comma": lambda text: text.replace(",", ";").replace(".", ","),
    "spaces": lambda text: text.replace(",", "   "),
    "preamble": lambda text: "# arm 3\n\n# after lunch\n" + text,
    "blanks": with_blanks,
    "blank end": lambda text: text + "\n" * 40_000,
    "no last feed": lambda text: text.rstrip("\n"),
    "cut": lambda text: text[:-30],
}


@pytest.mark.parametrize("form", TEXTS)
def test_pieces_of_a_text_are_the_whole(logs, tmp_path, small_parts, form):
    """A text cut at bytes, wherever they fall, leaves runs, rows, notes and digest of one pass, to the bit."""
    robot = read_recipe(logs / "recipe.yaml")
    paths = as_text(tmp_path / "logs", table_of(logs), change=TEXTS[form])
    wanted, (found, again) = one_pass(paths, robot), taken(paths, robot)
    assert not again and same(found, wanted)
    assert same(in_pieces(paths, robot, mates=1), wanted)
    assert [note.slug for note in wanted.notes] == (["last-row-cut"] if form == "cut" else [])


@pytest.mark.parametrize("change", [lambda text: text.replace("\n", "\r"), lambda text: text.encode("utf-16")])
def test_some_texts_are_one_piece(logs, tmp_path, small_parts, change):
    """Line ends of old Macs and 16-bit letters have no bytes to cut at; they are read at once, as before."""
    robot = read_recipe(logs / "recipe.yaml")
    paths = as_text(tmp_path / "logs", table_of(logs), change=change)
    assert pieces_of(paths[0]) == paths
    plain = as_text(tmp_path / "plain", table_of(logs))
    rows = [sum(facts.rows for facts in in_pieces(each, robot).files) for each in (paths, plain)]
    assert rows[0] == rows[1]


def test_a_gzipped_text_has_the_seams_of_the_plain_one(logs, tmp_path, small_parts):
    """Compressed it is one piece, read at once, and its runs are those of the plain file, to the bit."""
    robot = read_recipe(logs / "recipe.yaml")
    plain = as_text(tmp_path / "plain", table_of(logs))
    packed = tmp_path / "session_0.csv.gz"
    packed.write_bytes(gzip.compress(plain[0].read_bytes()))
    assert pieces_of(packed) == [packed]
    for one, other in zip(in_pieces([packed], robot).runs, in_pieces(plain, robot).runs, strict=True):
        assert np.array_equal(one.triangle.factor, other.triangle.factor)
        assert (one.first_row, one.last_row) == (other.first_row, other.last_row)


@pytest.mark.parametrize("seed", range(8))
def test_a_text_is_cut_behind_lines_only(tmp_path, monkeypatch, seed):
    """Random lines, long ones across several borders and empty ones, cut at random steps: each is in one piece."""
    rng = np.random.default_rng(seed)
    monkeypatch.setattr(parts, "TEXT_ROWS", int(rng.integers(1, 40)))
    monkeypatch.setattr(text_blocks, "BLOCK_BYTES", int(rng.integers(1, 60)))
    body = [b"x" * int(rng.choice([0, 1, 5, 30, 700], p=[0.1, 0.3, 0.3, 0.2, 0.1])) for _ in range(60)]
    path = tmp_path / "a.csv"
    path.write_bytes(b"\n".join([b"t,q", *body]) + (b"\n" if rng.random() < 0.5 else b""))
    found = []
    for piece in pieces_of(path):
        part = None if piece is path else range(piece.first, piece.stop)
        with path.open("rb") as stream:
            found += [block for block, _, _ in text_blocks.TextBlocks(stream, "a.csv", part)]
    assert b"".join(found).rstrip() == path.read_bytes().rstrip()
    assert all(block.endswith(b"\n") for block in found[:-1] if block)
    with path.open("rb") as stream:
        begun = [block for block, begins, _ in text_blocks.TextBlocks(stream, "a.csv") if begins]
    assert len(begun) >= len(pieces_of(path)) - 1 - sum(not block for block in found)


def test_a_text_that_grows_while_it_is_read_is_read_again(logs, tmp_path, small_parts, monkeypatch):
    """A recording that still goes on when its pieces are read: rows and digest are of one state of the file."""
    robot = read_recipe(logs / "recipe.yaml")
    table = table_of(logs)
    paths = as_text(tmp_path / "logs", table.slice(0, 4000))
    longer = table.to_pandas().to_csv(index=False).encode()

    def grows(piece):
        found = Reading.tried(Reading(robot, DEFAULTS), piece)
        paths[0].write_bytes(longer)
        return found

    reading = MagicMock(wraps=Reading(robot, DEFAULTS), robot=robot, options=DEFAULTS, tried=grows)
    found = spread(paths, reading, [])
    assert found.files[0].rows == len(table) and found.files[0].digest == hashlib.sha256(longer).hexdigest()


@pytest.mark.parametrize("form", ["text", "parquet"])
def test_another_file_in_its_place_is_read_by_itself(logs, tmp_path, small_parts, form):
    """A file of the same size takes the log's name while its pieces are read: numbers and digest are of one file."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    as_file = as_text if form == "text" else written
    paths, others = as_file(tmp_path / "logs", table), as_file(tmp_path / "others", table)
    if form == "text":
        rows = [line.rpartition(b",") for line in others[0].read_bytes().split(b"\n")]
        others[0].write_bytes(b"\n".join(start + comma + end.replace(b"1", b"2") for start, comma, end in rows))
    wanted, read = one_pass(others, robot), []

    def replaced(piece):
        if len(read) == 2:
            others[0].replace(paths[0])
        read.append(piece)
        return Reading.tried(Reading(robot, DEFAULTS), piece)

    reading = MagicMock(wraps=Reading(robot, DEFAULTS), robot=robot, options=DEFAULTS, tried=replaced)
    found = spread(paths, reading, [])
    assert len(pieces_of(paths[0])) > 5 and reading.file.call_count == 1
    assert found.files[0].digest == wanted.files[0].digest
    for one, other in zip(found.runs, wanted.runs, strict=True):
        assert np.array_equal(one.triangle.factor, other.triangle.factor)


def test_a_block_without_a_number_behind_a_cut_has_its_seam(logs, tmp_path, small_parts, monkeypatch):
    """Where all rows of the first block of a piece are left out, one pass knows all the same that a piece begins."""
    robot = read_recipe(logs / "recipe.yaml")
    monkeypatch.setattr(text_blocks, "BLOCK_BYTES", 1000)
    paths = as_text(tmp_path / "logs", table_of(logs))
    for piece in pieces_of(paths[0])[2:4]:
        text = paths[0].read_bytes()
        start = text.index(b"\n", piece.first - 1) + 1
        lines = [line.split(b",") for line in text[start : start + 3000].split(b"\n")[:-1]]
        spoilt = b"\n".join(b",".join([bins[0], b"nan".ljust(len(bins[1])), *bins[2:]]) for bins in lines)
        paths[0].write_bytes(text[:start] + spoilt + text[start + len(spoilt) :])
    found, again = taken(paths, robot)
    assert not again and same(found, one_pass(paths, robot))
    assert "bad-samples" in {note.slug for note in found.notes}


def test_a_piece_that_is_refused_is_told_of_the_whole(logs, tmp_path, small_parts):
    """Text in a number far behind: the row that is named is the file's."""
    robot = read_recipe(logs / "recipe.yaml")

    def spoil(text):
        lines = text.splitlines()
        lines[4000] = lines[4000].replace(",", ",x", 1)
        return "\n".join(lines)

    paths = as_text(tmp_path / "logs", table_of(logs), change=spoil)
    with pytest.raises(LogError) as told:
        in_pieces(paths, robot, mates=1)
    assert told.value.slug == "not-a-number" and told.value.where.row == 4001


def test_texts_in_a_store_are_one_piece(logs, tmp_path, small_parts):
    """The digest takes the whole file to one worker; cut, it would come twice over the network."""
    fsspec = pytest.importorskip("fsspec")
    plain = as_text(tmp_path / "plain", table_of(logs))
    fsspec.filesystem("memory").pipe("/pieces/text.csv", plain[0].read_bytes())
    stored = expand(["memory://pieces/text.csv"])
    assert pieces_of(stored[0]) == stored


def test_of_a_file_that_is_read_as_a_whole_no_more_pieces_are_read(logs, tmp_path, small_parts):
    """A wrap in the first piece: the others stay unread, and the next file's are read as ever."""
    robot, table = read_recipe(logs / "recipe.yaml"), table_of(logs)
    wrapped = changed(table, "q1", lambda values: np.add(values[100:], 2 * np.pi, out=values[100:]))
    for number, one in enumerate([wrapped, table.slice(300), wrapped]):
        paths = written(tmp_path / "logs", one, number=number)
    read = []

    def tried(piece):
        read.append(str(piece))
        return Reading.tried(Reading(robot, DEFAULTS), piece)

    reading = MagicMock(wraps=Reading(robot, DEFAULTS), robot=robot, options=DEFAULTS, tried=tried)
    assert same(spread(paths, reading, []), one_pass(paths, robot))
    counts = [read.count(str(path)) for path in paths]
    assert counts[0] <= 3 and counts[2] <= 3 and counts[1] == len(pieces_of(paths[1])) > 5
    assert same(in_pieces(paths, robot, mates=2), one_pass(paths, robot))
