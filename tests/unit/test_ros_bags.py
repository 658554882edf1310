"""Recordings of ROS 1 and 2 give what the same samples give as CSV, whatever the order of joints, topics and bytes."""

import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
from pendulum_sample import numbers, robot

import pumaid
from pumaid.dataset import Log
from pumaid.errors import LogError
from pumaid.io.formats import ros_bag
from pumaid.io.log_reader import LogReader
from pumaid.io.paths import expand

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="bags are read by rosbags (pip install pumaid[ros])")
rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

#: In other orders than the recipe's.
JOINTS = ["knee", "gripper", "hip"]
LOG = """
log:
  position: "/joint_states/{name}/position"
  velocity: "/joint_states/{name}/velocity"
  current: "/joint_states/{name}/effort"
"""


def message(topic, time, joints, *, frame="base", stamp=True):
    """A joint state: `joints` are (name, position, velocity, effort), None where its array is empty; `time` in s."""
    names, *arrays = zip(*joints, strict=True)
    return topic, time, names, [[] if None in array else array for array in arrays], frame, stamp


def serialised(types, kind, content, **options):
    """The bytes of a message by rosbags' own writer."""
    _, time, names, arrays, frame, stamp = content
    time_type, header, state = (
        types.types[f"{name}"] for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", ros_bag._JOINT_STATE)
    )
    ns = round(1e9 * time) if stamp else 0
    head = header(stamp=time_type(ns // 10**9, ns % 10**9), frame_id=frame, **({"seq": 7} if kind == "bag" else {}))
    body = state(head, list(names), *(np.array(array, dtype=float) for array in arrays))
    return (types.serialize_ros1 if kind == "bag" else types.serialize_cdr)(body, state.__msgtype__, **options)


def write(folder, kind, messages, **options):
    """A recording with these joint states and a chatter; the path to name (a folder in ROS 2)."""
    types = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if kind == "bag" else typesys.Stores.ROS2_HUMBLE)
    path = folder / ("session.bag" if kind == "bag" else "session")
    plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
    writer = rosbag1.Writer(path) if kind == "bag" else rosbag2.Writer(path, version=9, storage_plugin=plugin)
    text = types.types["std_msgs/msg/String"](data="hello")
    with writer:
        chatter = writer.add_connection("/chatter", text.__msgtype__, typestore=types)
        speak = types.serialize_ros1 if kind == "bag" else types.serialize_cdr
        topics = {
            topic: writer.add_connection(topic, ros_bag._JOINT_STATE, typestore=types)
            for topic in dict.fromkeys(content[0] for content in messages)
        }
        for count, content in enumerate(messages):
            if count % 100 == 0:
                writer.write(chatter, round(1e9 * content[1]), bytes(speak(text, text.__msgtype__)))
            raw = serialised(types, kind, content, **options)
            writer.write(topics[content[0]], round(1e9 * content[1]), bytes(raw))
    return path


def read(path, arm):
    """All samples of a recording, and the notes on it."""
    (file,) = expand([path])
    reader = LogReader(file, arm)
    return Log.joined(list(reader)), reader.notes


def motion(times, joints=("hip", "knee")):
    """Straight lines in time, so that what is interpolated is known: joint k is at (k + 1) t, its effort is t - k."""
    return [
        message("/joint_states", t, [(name, (k + 1) * t, None, t - k) for k, name in enumerate(joints)]) for t in times
    ]


@pytest.mark.parametrize("kind", ["db3", "mcap", "bag"])
def test_a_bag_gives_what_its_csv_gives(tmp_path, kind, from_csv):
    """Every message has its joints in an order of its own, and beside them there are a gripper and another topic."""
    table, expected = from_csv
    rng = np.random.default_rng(3)
    rows = table.assign(nothing=0.0)[["t", "q2", "nothing", "q1", "i2", "nothing", "i1"]].to_numpy().tolist()
    messages = []
    for t, *values in rows:
        order = rng.permutation(3)
        messages.append(message("/joint_states", t, [(JOINTS[k], values[k], None, values[3 + k]) for k in order]))
    path = write(tmp_path, kind, messages)
    robot(tmp_path, LOG)
    result = pumaid.identify(path, recipe=tmp_path / "recipe.yaml")
    assert len(result.dataset.runs) == len(expected.dataset.runs) > 20
    assert numbers(result) == pytest.approx(numbers(expected), rel=1e-9, abs=1e-12)
    (note,) = [note for note in result.dataset.notes if note.slug == "topics"]
    assert "171 messages of other topics" in note.text and "/chatter" in note.text


@pytest.mark.parametrize("batch", [16384, 64])
def test_topics_and_publishers_are_merged_by_time(tmp_path, batch, monkeypatch):
    """Positions and currents come in messages of their own; what is between two of them lies on their line."""
    monkeypatch.setattr(ros_bag, "_BATCH", batch)
    times = np.arange(400) * 0.01
    hip, knee = ([message("/joint_states", t, [(name, t, None, None)]) for t in times] for name in ("hip", "knee"))
    later = [t + 0.004 for t in times[:-1] if not 1.0 <= t < 1.5]
    motors = [message("/motors", t, [("knee", None, None, 3 * t), ("hip", None, None, -t)]) for t in later]
    path = write(tmp_path, "mcap", sorted([*hip, *knee, *motors], key=lambda content: content[1]))
    arm = robot(tmp_path, LOG.replace("/joint_states/{name}/effort", "/motors/{name}/effort"))
    log, notes = read(path, arm)
    assert np.array_equal(log.rows, np.arange(1, 401)) and log.time == pytest.approx(times, abs=1e-12)
    is_gap = (times < 0.004) | ((times > 0.995) & (times < 1.503)) | (times > later[-1])
    assert np.array_equal(np.isnan(log.current[:, 0]), is_gap)
    assert log.current[~is_gap] == pytest.approx(np.outer(times[~is_gap], [-1.0, 3.0]), abs=1e-12)
    assert log.position == pytest.approx(np.outer(times, [1.0, 1.0]), abs=1e-12)
    assert any("interpolated" in note.text and "/motors/hip/effort" in note.text for note in notes)


def test_frames_and_stamps_of_any_kind(tmp_path):
    times = np.arange(50) * 0.01 + 5.0
    messages = [(*content[:4], "x" * (k % 7), False) for k, content in enumerate(motion(times))]
    log, _ = read(write(tmp_path, "db3", messages), robot(tmp_path, LOG))
    assert log.time == pytest.approx(times, abs=1e-9)
    assert log.position == pytest.approx(np.outer(times, [1.0, 2.0]), abs=1e-12)
    assert log.current == pytest.approx(np.column_stack([times, times - 1.0]), abs=1e-12)


@pytest.mark.parametrize("kind", ["db3", "mcap", "bag"])
def test_a_damaged_recording_is_refused(tmp_path, kind):
    """Cut anywhere, or with a byte of its index or of a message altered: one message, with a mend, or the numbers."""
    path = next(iter(expand([write(tmp_path, kind, motion(np.arange(300) * 0.01))])))
    arm, whole, rng = robot(tmp_path, LOG), Path(path).read_bytes(), np.random.default_rng(5)
    place = tmp_path / "a # b?"  # as an address would not have it
    cuts = [whole[: int(share * len(whole))] for share in (0.02, 0.3, 0.7, 0.99)]
    altered = [whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :] for at in rng.integers(20, len(whole), 60)]
    slugs = []
    for data in [whole, *cuts, *altered]:
        place.write_bytes(data)
        try:
            log, _ = read(place, arm)
            slugs.append("")
            assert len(log.time) or data is not whole
        except LogError as error:
            slugs.append(error.slug)
            assert error.where.file == str(place) and error.mend
    assert slugs[0] == "" and "file-not-readable" in slugs[1:5]


def test_what_is_no_recording_of_joints_is_refused(tmp_path, monkeypatch):
    """Another database, no joint state, or no package: the message says which, and what to do."""
    connection = sqlite3.connect(tmp_path / "other.db3")
    connection.execute("create table a (b)")
    connection.close()
    with pytest.raises(LogError, match="missing tables"):
        read(tmp_path / "other.db3", robot(tmp_path, LOG))
    bag = write(tmp_path, "bag", [])
    with pytest.raises(LogError, match="sensor_msgs/msg/JointState"):
        read(bag, robot(tmp_path, LOG))
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(LogError) as caught:
        read(bag, robot(tmp_path, LOG))
    assert caught.value.mend == "pip install 'pumaid[ros]'"
