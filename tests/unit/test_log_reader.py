"""Logs in, logs out: whatever the dialect, the cut of the batches, the faults of the recorder and its header."""

import bz2
import gzip
import hashlib
import io
import lzma
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from pumaid.dataset import Log
from pumaid.errors import LogError
from pumaid.io.column_names import guessed, log_block
from pumaid.io.formats import csv_text, floats
from pumaid.io.log_reader import LogReader
from pumaid.io.write import write_log
from pumaid.robot import Joint, LogFormat, Robot


def arm(n_joints: int = 2, *, max_velocity: float | None = 2.0, **log: object) -> Robot:
    """Revolute joints in the default log format unless told otherwise."""
    joints = tuple(Joint(k, f"j{k}", "revolute", alpha=0.5, max_velocity=max_velocity) for k in range(1, n_joints + 1))
    return Robot("test arm", joints, log=LogFormat(**log))  # type: ignore[arg-type]


def motion(n_rows: int = 200, n_joints: int = 2, *, seed: int = 1) -> Log:
    """Slow sines with noisy currents, 100 Hz."""
    rng = np.random.default_rng(seed)
    time = np.round(np.arange(n_rows) * 0.01, 9)
    phase = np.outer(time, 1.0 + np.arange(n_joints) / 3)
    current = np.round(rng.normal(size=phase.shape), 6)
    return Log("made", np.arange(n_rows) + 2, time, np.round(np.sin(phase), 6), np.round(np.cos(phase), 6), current)


def quoted(lines: str) -> str:
    """Cells in quotes, with commas between them."""
    return "".join(",".join(f'"{cell}"' for cell in line.split(";")) + "\n" for line in lines.splitlines())


def text(log: Log, *, delimiter: str = ",", decimal: str = ".") -> str:
    """The log as CSV text by plain Python, independent of the writer under test."""
    n = log.position.shape[1]
    names = ["t", *(f"{q}{k}" for q in ("q", "qd", "i") for k in range(1, n + 1))]
    assert log.velocity is not None
    table = np.column_stack([log.time, log.position, log.velocity, log.current])
    lines = [delimiter.join(names)]
    lines += [delimiter.join(repr(float(x)).replace(".", decimal) for x in row) for row in table]
    return "\n".join(lines) + "\n"


def read(path: Path, robot: Robot) -> tuple[Log, LogReader]:
    """All batches joined, and the reader with its facts and notes."""
    reader = LogReader(path, robot)
    return Log.joined(list(reader)), reader


def same(one: Log, other: Log) -> bool:
    """Bit for bit the same samples."""
    assert one.velocity is not None and other.velocity is not None
    pairs = [(one.time, other.time), (one.position, other.position), (one.velocity, other.velocity)]
    pairs += [(one.current, other.current), (one.rows, other.rows)]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def refusal(path: Path, content: str | bytes, robot: Robot | None = None) -> LogError:
    """The error that a file of this content is refused with."""
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(LogError) as caught:
        list(LogReader(path, robot or arm()))
    return caught.value


DIALECTS = {
    "plain": lambda log: text(log).encode(),
    "semicolons": lambda log: text(log, delimiter=";").encode(),
    "quoted decimal commas": lambda log: quoted(text(log, delimiter=";", decimal=",")).encode(),
    "two byte order marks": lambda log: ("\ufeff\ufeff" + text(log)).encode(),
    "decimal commas": lambda log: text(log, delimiter=";", decimal=",").encode(),
    "tabs": lambda log: text(log, delimiter="\t").encode(),
    "tabs and decimal commas": lambda log: text(log, delimiter="\t", decimal=",").encode(),
    "spaces": lambda log: text(log, delimiter="   ").encode(),
    "space after comma": lambda log: text(log, delimiter=", ").encode(),
    "byte order mark": lambda log: b"\xef\xbb\xbf" + text(log).encode(),
    "utf-16": lambda log: text(log).encode("utf-16"),
    "windows": lambda log: text(log).replace("\n", "\r\n").encode(),
    "old mac": lambda log: text(log).replace("\n", "\r").encode(),
    "quoted header": lambda log: text(log).replace("t,q1,q2", '"t","q1","q2"', 1).encode(),
    "no last line end": lambda log: text(log).rstrip("\n").encode(),
    "numpy savetxt": lambda log: b"# " + text(log).encode(),
    "plus signs": lambda log: text(log).replace(",0.", ",+0.").encode(),
    "trailing delimiters": lambda log: text(log).replace("\n", ",\n").replace("i2,\n", "i2\n").encode(),
    "gzip": lambda log: gzip.compress(text(log).encode()),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_reads_the_same(tmp_path: Path, dialect: str) -> None:
    """What spreadsheets, MATLAB, Windows and numpy write is read without being asked."""
    (tmp_path / "a.csv").write_bytes(DIALECTS[dialect](motion()))
    log, reader = read(tmp_path / "a.csv", arm())
    assert same(log, motion()) and reader.notes == ()


@pytest.mark.parametrize(
    "before", ["sep=,\n", "# made by a controller\n# on Monday\n", "\n\n", "Robot log v2\nOperator: Ann\n\n"]
)
def test_lines_before_the_header_are_passed_over(tmp_path: Path, before: str) -> None:
    """Excel's separator line, comments and properties stand on top, or pauses inside; rows count as an editor's."""
    (tmp_path / "a.csv").write_text(before + text(motion()))
    log, _ = read(tmp_path / "a.csv", arm())
    assert np.array_equal(log.rows, motion().rows + before.count("\n"))
    assert np.array_equal(log.current, motion().current)
    lines = text(motion(5)).splitlines()
    (tmp_path / "a.csv").write_text("\n".join([*lines[:3], "", "# pause", *lines[3:]]) + "\n\n")
    log, _ = read(tmp_path / "a.csv", arm())
    assert log.rows.tolist() == [2, 3, 6, 7, 8] and np.array_equal(log.current, motion(5).current)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(block=st.integers(150, 5000))
def test_the_cut_of_blocks_changes_nothing(tmp_path: Path, block: int) -> None:
    """Samples, notes and facts of a dirty file are the same for every block size."""
    path = dirty(tmp_path / "a.csv")
    whole, reader = read(path, arm())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(csv_text, "_BLOCK_BYTES", block)
        parts, other = read(path, arm())
    assert same(whole, parts) and other.notes == reader.notes and other.files == reader.files
    slugs = "bad-samples column-absent gaps position-wraps"
    assert sorted({note.slug for note in reader.notes}) == slugs.split()


def dirty(path: Path) -> Path:
    """A file with a missing position and current, a repeated row, a gap and wraps."""
    if path.exists():
        return path
    log = motion(400)
    log.position[:, 0] = np.remainder(np.linspace(0.0, 9.0, 400), 2 * np.pi)
    log.time[150:] += 3.0
    lines = text(log).splitlines()
    for row, place in ((77, -1), (88, 2)):
        cells = lines[row].split(",")
        cells[place] = "nan"
        lines[row] = ",".join(cells)
    lines.insert(100, lines[99])
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("kind", ["float64", "float32", "int", "decimal", "text", "dictionary"])
def test_parquet_of_any_number_type_reads_as_csv_does(tmp_path: Path, kind: str) -> None:
    log = motion(50)
    names = ["t", "q1", "q2", "qd1", "qd2", "i1", "i2"]
    assert log.velocity is not None
    table = np.round(np.column_stack([log.time * 100, log.position, log.velocity, log.current]) * 8) / 8
    column = {
        "float64": lambda x: pa.array(x),
        "float32": lambda x: pa.array(x.astype(np.float32)),
        "int": lambda x: pa.array(np.round(x).astype(np.int32)),
        "decimal": lambda x: pa.array(x).cast(pa.decimal128(12, 4)),
        "text": lambda x: pa.array([str(v) for v in x]),
        "dictionary": lambda x: pa.array([str(v) for v in x]).dictionary_encode(),
    }[kind]
    pq.write_table(pa.table([column(x) for x in table.T], names=names), tmp_path / "a.parquet")
    expected = np.round(table) if kind == "int" else table
    (tmp_path / "a.csv").write_text("\n".join([",".join(names), *(",".join(map(str, row)) for row in expected)]))
    assert same(read(tmp_path / "a.parquet", arm())[0], read(tmp_path / "a.csv", arm())[0])


def test_a_time_stamp_column_is_seconds(tmp_path: Path) -> None:
    """Parquet's own time stamps carry their unit, whatever the recipe says."""
    stamps = pa.array((np.arange(50) * 10_000 + 1_700_000_000_000_000).astype("datetime64[us]"))
    columns = [stamps, pa.array(np.zeros(50)), pa.array(np.ones(50))]
    pq.write_table(pa.table(columns, names=["t", "q1", "i1"]), tmp_path / "a.parquet")
    log, _ = read(tmp_path / "a.parquet", arm(1))
    assert log.time[0] == pytest.approx(1.7e9, abs=1e-3) and np.allclose(np.diff(log.time), 0.01, atol=1e-6)


@pytest.mark.parametrize(("rate", "start"), [(1.5, 0.0), (1e3, 1.7e12), (1.0, 9e8)])
def test_a_second_clock_at_another_rate_is_told(tmp_path: Path, rate: float, start: float) -> None:
    """With what becomes of speeds if it is right; one in another unit or of another day is no other."""
    head, *lines = text(motion()).splitlines()
    rows = [f"{line},{start + rate * float(line.partition(',')[0])!r},noon" for line in lines]
    (tmp_path / "a.csv").write_text("\n".join([f"{head},ros_stamp,time_of_day", *rows]))
    told = [note.text for note in read(tmp_path / "a.csv", arm())[1].notes]
    assert ["1.5 times too large" in text for text in told] == [True] * (rate == 1.5)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_what_is_written_reads_back(tmp_path: Path, ending: str) -> None:
    """Units, signs and names of the recipe are undone on reading."""
    robot = arm(
        time="Clock",
        position="pos {joint0}",
        velocity="v,{joint}",
        current="I{joint}",
        units={"time": "ms", "position": "deg", "velocity": "rpm", "current": "mA"},
        signs={"position": (1, -1), "current": (-1, 1)},
    )
    write_log(tmp_path / f"a.{ending}", [motion()], robot)
    log, _ = read(tmp_path / f"a.{ending}", robot)
    # Nine decimals of values up to 1, after the factor of 57.
    for one, other in ((log.time, motion().time), (log.position, motion().position), (log.current, motion().current)):
        assert np.allclose(one, other, rtol=0, atol=2e-8)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_standard_input_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    """`-` takes CSV and Parquet from a pipe, with the digest of what came."""
    write_log(tmp_path / f"a.{ending}", [motion()], arm())
    data = (tmp_path / f"a.{ending}").read_bytes()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    log, reader = read(Path("-"), arm())
    assert same(log, motion())
    assert (reader.files[0].name, reader.files[0].digest) == ("<stdin>", hashlib.sha256(data).hexdigest())


def test_a_log_without_rows_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("t,q1,q2,i1,i2\n")
    write_log(tmp_path / "a.csv", [motion(50)], arm())
    reader, other = LogReader(tmp_path / "a.csv", arm()), LogReader(tmp_path / "b.csv", arm())
    assert (len(list(reader)), list(other)) == (1, [])
    assert (reader.files[0].rows, other.files[0].rows, [note.slug for note in other.notes]) == (50, 0, ["empty-log"])
    assert reader.files[0].interval == pytest.approx(0.01)


def test_wraps_are_unwrapped_and_nothing_else(tmp_path: Path) -> None:
    """A joint that turns on through 2 pi comes out continuous, noise about zero as one position; a true step stays."""
    log = motion(600, 3)
    turning = np.linspace(0.0, 5.0, 600)
    log.position[:, 0] = np.remainder(turning + 3.0, 2 * np.pi)
    log.position[:, 1] = np.where(np.arange(600) < 300, 0.0, 3.0)
    log.position[:, 2] = np.remainder(np.random.default_rng(3).normal(scale=1e-4, size=600), 2 * np.pi)
    write_log(tmp_path / "a.parquet", [log], arm(3))
    read_back, reader = read(tmp_path / "a.parquet", arm(3))
    assert np.allclose(read_back.position[:, 0], turning + 3.0, atol=1e-12)
    assert np.array_equal(read_back.position[:, 1], log.position[:, 1])
    assert np.ptp(read_back.position[:, 2]) < 1e-3
    (note,) = reader.notes
    assert note.slug == "position-wraps" and "joint 3" in note.text


def test_some_bad_rows_are_left_out_and_told(tmp_path: Path) -> None:
    """Garbage of a recorder costs its rows only; the rows are named."""
    lines = text(motion(300)).splitlines()
    for row, word, place in ((10, "1e298", -1), (11, "", 2), (12, "inf", -1), (13, "-1.#IND", 2)):
        cells = lines[row - 1].split(",")
        cells[place] = word
        lines[row - 1] = ",".join(cells)
    (tmp_path / "a.csv").write_text("\n".join(lines))
    log, reader = read(tmp_path / "a.csv", arm())
    assert len(log) == 296 and not set(range(10, 14)) & set(log.rows.tolist())
    (note,) = reader.notes
    assert note.slug == "bad-samples" and "4 of 300 rows" in note.text
    assert "q2 in 2 (first in row 11); i2 in 2 (first in row 10)" in note.text


def test_garbage_in_other_columns_never_matters(tmp_path: Path) -> None:
    """A column of text and wild numbers beside the robot's is not even read."""
    lines = text(motion(20)).splitlines()
    lines = [lines[0] + ",state", *(line + word for line, word in zip(lines[1:], [",ok", ",1e298"] * 10, strict=True))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    log, reader = read(tmp_path / "a.csv", arm())
    assert same(log, motion(20)) and reader.notes == ()


def test_an_absent_number_keeps_its_row(tmp_path: Path) -> None:
    """A joint without current or temperature, and samples without velocity, are NaN and noted; an absurd one is bad."""
    for content in ("t,q1,q2,i2\n0,0,0,1\n1,0,0,1\n", "t,q1,q2,i1,i2\n0,0,0,,1\n1,0,0,,1\n"):
        (tmp_path / "a.csv").write_text(content)
        log, reader = read(tmp_path / "a.csv", arm())
        assert np.isnan(log.current[:, 0]).all() and log.current[:, 1].tolist() == [1.0, 1.0]
        assert [note.slug for note in reader.notes] == ["column-absent"] and "i1" in reader.notes[0].text
    (tmp_path / "a.csv").write_text("t,q1,i1,temp1\n0,0,1,30\n1,0,1,\n")
    (log,) = list(LogReader(tmp_path / "a.csv", arm(1)))
    assert log.temperature is not None and np.array_equal(log.temperature[:, 0], [30.0, np.nan], equal_nan=True)
    rows = [f"{k / 100},{k / 50},{'nan' if k % 3 else 2},1\n" for k in range(60)]
    (tmp_path / "a.csv").write_text("t,q1,qd1,i1\n" + "".join(rows) + "0.6,1.2,1e298,1\n")
    (log,) = list(reader := LogReader(tmp_path / "a.csv", arm(1)))
    assert len(log) == 60 and log.velocity is not None and np.count_nonzero(np.isnan(log.velocity)) == 40
    texts = {note.slug: note.text for note in reader.notes}
    assert "qd1 in 40" in texts["column-absent"] and "1 of 61 rows" in texts["bad-samples"]


@pytest.mark.parametrize("block", [1 << 22, 700])
@pytest.mark.parametrize("end", ["", "\n", "\n\n \n"])
def test_a_cut_last_row_is_left_out_whatever_follows_and_however_it_is_read(tmp_path, monkeypatch, block, end):
    """An editor, or a copy by lines, puts a line feed behind the last row; long files are read block by block."""
    monkeypatch.setattr(csv_text, "_BLOCK_BYTES", block)
    (tmp_path / "a.csv").write_text(text(motion(40)).rstrip()[:-20] + end)
    log, reader = read(tmp_path / "a.csv", arm())
    assert len(log) == 39 and [note.slug for note in reader.notes] == ["bad-samples"]


def test_a_hole_in_time_is_told(tmp_path: Path) -> None:
    """The note has the length and the place of the gap; a lost packet is no gap."""
    log = motion(300)
    log.time[100:] += 0.02
    log.time[200:] += 0.5
    (tmp_path / "a.csv").write_text(text(log))
    _, reader = read(tmp_path / "a.csv", arm())
    (note,) = reader.notes
    assert note.slug == "gaps" and "0.51 s at 2.01 s" in note.text and note.where.row == 202


REFUSED = {
    "text in a cell": ("t,q1,i1\n0,0,1\n1,x,2\n2,y,3\n", "not-a-number", "column q1 holds 'x', no number"),
    "units line": ("t,q1,i1\ns,gon,A\n0,0,1\n", "not-a-number", "column t holds 's'"),
    "dates": ("t,q1,i1\n2024-01-01 10:00:00,0,1\n", "not-a-number", "2024-01-01"),
    "ragged row": ("t,q1,i1\n0,0,1\n1,0\n2,0,1\n", "not-a-log", "row 3 has 2"),
    "doubled column": ("t,q1,i1,q1\n0,0,1,0\n", "column-missing", "q1 more than once"),
    "no header": ("0,0,1\n1,0,1\n", "not-a-log", "(0,0,1)"),
    "nothing": ("", "not-a-log", "it is empty"),
    "thousands": ("t;q1;i1\n0;0;1,068\n1;0;850\n", "not-a-number", "column i1"),
    "thousands by points": ("t;q1;i1\n0;0;1.068\n1;0;850\n", "not-a-number", "1.068 beside 850"),
    "time back": ("t,q1,i1\n0,0,1\n2,0,1\n1,0,1\n3,0,1\n", "time-not-rising", "from 2 s to 1 s"),
    "time stands": ("t,q1,i1\n" + "".join(f"{k // 10},{k},1\n" for k in range(100)), "bad-samples", "90 of 100"),
    "mostly bad": (
        "t,q1,i1\n" + "".join(f"{k},{'nan' if k % 2 else k},1\n" for k in range(100)),
        "bad-samples",
        "50 of 100",
    ),
    "no time": ("q_0,tau_0\n0,0\n1,0\n", "column-missing", "none of them is a time"),
    "no current": ("t,q1,i1\n0,0,\n1,0,\n", "column-missing", "are empty (i1)"),
    "time of no unit": ("t,q1,i1\n1700000000000000000000,0,1\n1700000000001000000000,0,1\n", "bad-samples", "t in 2"),
    "quantities in different rows": (
        "t,q1,i1\n" + "".join(f"{k},,1\n" if k % 2 else f"{k},{k},\n" for k in range(100)),
        "bad-samples",
        "join them by time",
    ),
    "second header": ("t,q1,i1\n0,0,1\n1,0,1\nt,q1,i1\n0,0,1\n", "not-a-number", "holds 't', no number"),
    "bzip2": (bz2.compress(b"t,q1,i1\n"), "not-a-log", "compressed by bzip2"),
    "xz": (lzma.compress(b"t,q1,i1\n"), "not-a-log", "compressed by xz"),
    "spreadsheet": (b"PK\x03\x04rest", "not-a-log", "spreadsheet"),
    "binary": (b"t,q1\x00\x01", "not-a-log", "binary"),
    "cut parquet": (b"PAR1" + bytes(100), "file-not-readable", "damaged"),
    "cut gzip": (gzip.compress(b"t,q1,i1\n" + b"0,0,1\n" * 9999)[:-20], "file-not-readable", "damaged"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_trusted_is_refused(tmp_path: Path, case: str) -> None:
    """Every fault has its slug, its value, its place and a mend."""
    content, slug, said = REFUSED[case]
    error = refusal(tmp_path / "a.csv", content, arm(1))
    assert error.slug == slug and said in f"{error.what} {error.mend}" and error.mend
    assert error.where.file == str(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("header", "mend"),
    [
        ("time,q1,q2,heat_1,heat_2", "name this file's columns in the recipe's log block (pumaid init shows one)"),
        ("time,Q1,b,current_1,current_2", "the nearest to q1 is Q1; name this file's columns"),
        ("Times,a,b,current_1,current_2", "the nearest to time is Times; name this file's columns"),
    ],
)
def test_only_what_may_be_meant_is_named(tmp_path: Path, header: str, mend: str) -> None:
    """A column that the recipe names is no other quantity, and one that is unlike is none that is meant."""
    robot = arm(2, time="time", position="q{joint}", current="current_{joint}", velocity=None)
    assert refusal(tmp_path / "a.csv", f"{header}\n0,1,2,3,4\n", robot).mend.startswith(mend)


def test_another_number_of_joints_is_told(tmp_path: Path) -> None:
    """A log of a shorter arm is refused with its columns, one of a longer arm is read, with a doubt."""
    for content, which in ((text(motion(20, 2)), "2 of the 3"), ("time,pos_1,current_1\n0,1,2\n1,1,2\n", "1 of the 3")):
        error = refusal(tmp_path / "a.csv", content, arm(3))
        assert error.slug == "column-missing" and f"columns of {which} joints of the recipe" in error.what
    for beyond in ("3", "0"):  # behind the last joint, or before the first
        (tmp_path / "a.csv").write_text(text(motion(20, 3)).replace("q3", f"q{beyond}").replace("i3", f"i{beyond}"))
        _, reader = read(tmp_path / "a.csv", arm(2))
        assert [note.slug for note in reader.notes] == ["more-joints"]
        assert f"q{beyond}, i{beyond}" in reader.notes[0].text


def test_a_second_recording_in_a_file_is_refused(tmp_path: Path) -> None:
    """Time that goes back to its start is another recording: the message has the row at which to split the file."""
    log = motion(200)
    log.time[120:] -= log.time[120]
    error = refusal(tmp_path / "a.csv", text(log))
    assert (error.slug, error.where.row) == ("time-not-rising", 122) and "split" in error.mend


def test_a_log_that_changes_meanwhile_is_refused(tmp_path: Path) -> None:
    """The digest would be of something else than what was read."""
    path = tmp_path / "a.csv"
    path.write_text(text(motion(400)))
    logs = iter(LogReader(path, arm()))
    next(logs)
    path.write_text(text(motion(500)))
    with pytest.raises(LogError, match="changed while it was read"):
        list(logs)


def test_a_quoted_cell_of_two_lines_is_refused(tmp_path: Path) -> None:
    """A note with a line feed, or a lone quote that closes rows later: told with its row, or no quote at all."""
    lines = text(motion(40)).splitlines()
    lines[0] += ",note"
    quoted = [lines[0], *(line + "," for line in lines[1:])]
    quoted[9] += '"gripper\nopened"'
    error = refusal(tmp_path / "a.csv", "\n".join(quoted) + "\n")
    assert error.slug == "not-a-log" and error.where.row == 11 and "quote" in error.mend
    lone = [lines[0], *(line + "," for line in lines[1:])]
    lone[9] += '"5 inch tool'
    lone[20] += '6 inch" tool'
    (tmp_path / "a.csv").write_text("\n".join(lone) + "\n")
    log, _ = read(tmp_path / "a.csv", arm())
    assert same(log, motion(40))


@pytest.mark.parametrize("comments", [0, 60, 3000])
@pytest.mark.parametrize("place", [0, 1])
def test_comments_before_and_behind_the_header_are_no_rows(tmp_path: Path, place: int, comments: int) -> None:
    """A recorder's parameters, more of them than a file's first 64 KiB hold."""
    lines = text(motion(40)).splitlines()
    lines[place:place] = [f"# controller parameter {k:06} = 0.0" for k in range(comments)] + [""] * 90
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    log, reader = read(tmp_path / "a.csv", arm())
    assert same(replace(log, rows=motion(40).rows), motion(40)) and not reader.notes


@pytest.mark.parametrize("missing", [0.0, 0.3, 1.0])
def test_any_slice_has_its_own_numbers(missing):
    """What lacks is told by single bits, which a slice may begin with anywhere."""
    rng = np.random.default_rng(1)
    whole = pa.array(rng.normal(size=70), mask=rng.random(70) < missing)
    for start, stop in np.sort(rng.integers(0, 71, (100, 2)), axis=1).tolist():
        part = whole.slice(start, stop - start)
        wanted = np.array([np.nan if value is None else value for value in part.to_pylist()], dtype=float)
        np.testing.assert_array_equal(floats(part), wanted)


def numbered(*templates: str, n_joints: int = 6, first: int = 0) -> list[str]:
    """Every template for every joint."""
    return [template.format(k + first) for template in templates for k in range(n_joints)]


#: Header, and of the expected block time, position, velocity, current and temperature: UR's RTDE recorder, Kinova's,
#: ROS topics flattened, with a gripper behind the arm.
HEADERS = {
    "rtde": (
        numbered("target_q_{}", "actual_q_{}", "target_qd_{}", "actual_qd_{}", "target_current_{}")
        + numbered("actual_current_{}", "joint_temperatures_{}"),
        ["timestamp", *(f"{x}_{{joint0}}" for x in ("actual_q", "actual_qd", "actual_current", "joint_temperatures"))],
    ),
    "kinova": (
        numbered("Position{}", "Velocity{}", "Torque{}", "TorqueCur{}", "Temp{}", "Cur{}", first=1)
        + numbered("PositionCmptd{}", "VelocityCmptd{}", first=1),
        ["Time", "Position{joint}", "Velocity{joint}", "Cur{joint}", "Temp{joint}"],
    ),
    "ros": (
        numbered("/joint_states/position[{}]", "/joint_states/velocity[{}]", "/motor/current[{}]", n_joints=7),
        ["time", "/joint_states/position[{joint0}]", "/joint_states/velocity[{joint0}]", "/motor/current[{joint0}]"],
    ),
}


@pytest.mark.parametrize("kind", HEADERS)
def test_known_headers_are_recognised(kind: str) -> None:
    """Measured columns are chosen before wanted and computed ones, and the block is YAML."""
    header, names = HEADERS[kind]
    expected = dict(zip(("time", "position", "velocity", "current", "temperature"), names, strict=False))
    log, _ = guessed([names[0], *header], arm(6))
    assert log is not None and YAML(typ="safe").load(log_block(log)) == {"log": expected}


@pytest.mark.parametrize("header", [["a", "b"], ["t", "q1", "q2", "x"], ["q1", "q2", "i1", "i2"]])
def test_what_is_not_recognised_is_not_guessed(header: list[str]) -> None:
    """Without time, positions and currents of all joints there is no block."""
    assert guessed(header, arm(2)) == (None, False)
