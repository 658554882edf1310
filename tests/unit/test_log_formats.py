"""Tables in other files than CSV give what the same samples give as CSV; damaged ones are refused."""

import gzip
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from pendulum_sample import numbers, robot

import pumaid
from pumaid.dataset import Log
from pumaid.errors import LogError
from pumaid.io.formats import arrays, json_lines
from pumaid.io.log_reader import LogReader

STATE = """
log:
  time: timestamp
  position: "observation.state[{joint0}]"
  current: "observation.state[{joint2}]"
"""
BY_NAME = """
log:
  time: stamp.sec
  position: "arm/{name}/position"
  current: "arm/{name}/effort"
"""


def list_columns(folder, table):
    """Parquet with a list for each sample, of fixed or of any length, among columns that are none."""
    q, i = table[["q1", "q2"]].to_numpy(), table[["i1", "i2"]].to_numpy()
    columns = {
        "observation": pa.array(["x"] * len(table)),
        "timestamp": pa.array(table["t"]),
        "observation.state": pa.FixedSizeListArray.from_arrays(pa.array(q.ravel()), 2),
        "action": pa.array([*i[:-1].tolist(), [i[-1, 0], i[-1, 1], 7.0]]),
        "observation.image": pa.array([{"bytes": b"1"}] * len(table)),
    }
    pq.write_table(pa.table(columns), folder / "episode.parquet")
    return STATE.replace("observation.state[{joint2}]", "action[{joint0}]")


def json_by_name(folder, table):
    """Lines with joints in an order of their own, an empty line among them and the last one cut off."""
    rng, lines = np.random.default_rng(8), [""]
    for t, *values in table[["t", "q1", "q2", "i1", "i2"]].to_numpy().tolist():
        order = rng.permutation(2)
        arrays = ([["hip", "knee"][k] for k in order], [values[k] for k in order], [values[2 + k] for k in order])
        arm = dict(zip(("name", "position", "effort"), arrays, strict=True))
        lines.append(json.dumps({"arm": arm, "stamp": {"sec": t}, "mode": None}))
    (folder / "log.jsonl").write_text("\n".join([*lines, lines[-1][:-9]]), encoding="utf-8")
    return BY_NAME


def packed_json(folder, table):
    """Gzipped lines whose arrays are called as the canonical columns are."""
    rows = table[["t", "q1", "q2", "i1", "i2"]].to_numpy().tolist()
    lines = [json.dumps({"t": t, "q": [q1, q2], "i": [i1, i2]}) for t, q1, q2, i1, i2 in rows]
    (folder / "log.jsonl.gz").write_bytes(gzip.compress("\r\n".join(lines).encode()))
    return ""


def numpy_archive(folder, table):
    """Arrays called as canonical columns are: by row, by column, packed and turned; and a dataset, which is no log."""
    q, i = table[["q1", "q2"]].to_numpy(), table[["i1", "i2"]].to_numpy()
    np.savez_compressed(
        folder / "log.npz", t=table["t"], q=np.ascontiguousarray(q), i=np.asfortranarray(i), tool=np.eye(3), name="x"
    )
    (folder / "dataset.npz").write_bytes(b"")
    return ""


def matlab_file(folder, table):
    """A struct beside other variables, whose matrix has a row a joint."""
    log = {"t": table["t"].to_numpy(), "q": table[["q1", "q2"]].to_numpy().T, "i": table[["i1", "i2"]].to_numpy()}
    scipy.io.savemat(folder / "log.mat", {"log": log, "rate": 40.0, "who": "me"}, do_compression=True)
    return """
log: {time: log.t, position: "log.q[{joint0}]", current: "log.i[{joint0}]"}
"""


WRITERS = [list_columns, json_by_name, packed_json, numpy_archive, matlab_file]


@pytest.mark.parametrize("write", WRITERS, ids=lambda write: write.__name__)
def test_a_file_gives_what_its_csv_gives(tmp_path, write, from_csv):
    """Identified from the folder that holds it, to the last digits."""
    table, expected = from_csv
    robot(tmp_path, write(tmp_path, table))
    assert numbers(pumaid.identify(tmp_path)) == pytest.approx(numbers(expected), rel=1e-9, abs=1e-12)


def read(path, arm):
    """All samples, and the notes on them."""
    reader = LogReader(path, arm)
    return Log.joined(list(reader)), reader.notes


def test_json_is_read_in_blocks(tmp_path, monkeypatch):
    """However short the blocks, rows count as lines do; lists that end early and infinity are no numbers."""
    monkeypatch.setattr(json_lines, "_BLOCK_BYTES", 100)
    lines = [f'{{"t": {k}, "q": [{k}, 2.5], "i": [1{", 2" * (k != 3)}]}}' for k in range(9)]
    lines[5] = lines[5].replace("2.5", "NaN")
    (tmp_path / "a.jsonl").write_text("\n".join([lines[0], "", *lines[1:]]), encoding="utf-8")
    with pytest.raises(LogError) as caught:  # one bad row in nine is too much, which tells where it is
        read(tmp_path / "a.jsonl", robot(tmp_path))
    assert (caught.value.slug, caught.value.where.row, caught.value.where.column) == ("bad-samples", 7, "q2")
    (tmp_path / "a.jsonl").write_text("\n".join([*lines[:5], *lines[6:]]) + "\n", encoding="utf-8")
    log, _ = read(tmp_path / "a.jsonl", robot(tmp_path))
    assert log.rows.tolist() == [1, 2, 3, 4, 5, 6, 7, 8] and log.position[:, 0].tolist() == [0, 1, 2, 3, 4, 6, 7, 8]
    assert np.flatnonzero(np.isnan(log.current[:, 1])).tolist() == [3]


@pytest.mark.parametrize(
    ("content", "slug", "row"),
    [
        (b'{"t": 0, "q": [1, 2], "i": [1, 2]}\n{"t": 0, "q": [1, }\n{"t": 1}\n', "not-a-log", 2),
        (b'{"t": 0}\n\n[1, 2]\n', "not-a-log", 3),
        (b'{"t": 0, "q": ["a", "b"], "i": [1, 2]}\n', "not-a-number", None),
        (b'{"t": ' + b"[" * 100_000 + b"]" * 100_000 + b"}\n", "not-a-log", 1),
        (b'{"t": ' + b" " * (9 << 20) + b"0}\n", "not-a-log", None),
        (gzip.compress(b'{"t": 0}\n' * 1000)[:-12], "file-not-readable", None),
        (b'{\n  "t": 0\n}\n', "not-a-log", None),
    ],
    ids=["cut inside", "no object", "texts", "deep", "long", "gzip cut", "one document"],
)
def test_what_is_no_json_lines_is_refused(tmp_path, content, slug, row):
    (tmp_path / "a.jsonl").write_bytes(content)
    with pytest.raises(LogError) as caught:
        read(tmp_path / "a.jsonl", robot(tmp_path))
    assert (caught.value.slug, caught.value.where.row) == (slug, row) and caught.value.mend


def archive(folder, **changes):
    """A small archive of the pendulum's columns, some of them changed."""
    columns = {"t": np.arange(90) * 0.1, "q": np.zeros((90, 2)), "i": np.arange(180.0).reshape(90, 2)}
    np.savez(folder / "log.npz", **{**columns, **changes})
    return folder / "log.npz"


@pytest.mark.parametrize("rows", [7, 90, 1000])
def test_arrays_are_read_in_blocks(tmp_path, rows, monkeypatch):
    monkeypatch.setattr(arrays, "_BATCH_ROWS", rows)
    current = np.arange(180).reshape(2, 90).astype(">i2")
    path = archive(tmp_path, i=current, q=np.asfortranarray(np.ones((90, 2), "f2")))
    log, _ = read(path, robot(tmp_path))
    assert np.array_equal(log.current, current.T) and np.array_equal(log.rows, np.arange(2, 92))
    assert np.array_equal(log.position, np.ones((90, 2)))


def test_damaged_arrays_are_refused(tmp_path):
    """Arrays of other lengths, cut files, altered bytes and MATLAB 7.3: one message, with a mend, or the numbers."""
    arm = robot(tmp_path)
    with pytest.raises(LogError, match="i1 has 91"):
        read(archive(tmp_path, i=np.zeros((91, 2))), arm)
    with pytest.raises(LogError, match="no column i1, i2; it has t, q1, q2"):
        read(archive(tmp_path, i=np.array(["1"] * 90)), arm)
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(90))
    with pytest.raises(LogError, match="save -v7"):
        read(tmp_path / "new.mat", arm)
    rng, place = np.random.default_rng(4), tmp_path / "damaged"
    expected, _ = read(archive(tmp_path), arm)
    columns = {"t": expected.time, "q1": expected.time, "q2": expected.time, "i": expected.current}
    scipy.io.savemat(tmp_path / "log.mat", columns, do_compression=True)
    for path in (tmp_path / "log.npz", tmp_path / "log.mat"):
        whole = path.read_bytes()
        assert np.array_equal(read(path, arm)[0].current, expected.current)
        for at in rng.integers(20, len(whole), 150):
            place.write_bytes(whole[:at] + (bytes([whole[at] ^ 255]) + whole[at + 1 :] if at % 3 else b""))
            try:
                log, _ = read(place, arm)
            except LogError as error:
                assert error.slug in ("file-not-readable", "not-a-log", "column-missing") and error.mend
            else:
                assert np.array_equal(log.current, expected.current)
