"""Recordings of ROS 1 and 2 (bag, MCAP, SQLite): joint states, a column for each quantity of each joint of a topic."""

import struct
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from pumaid.errors import LogError, Note, Where, listed
from pumaid.io.formats import Batch, LogColumn, LogSource, refusing
from pumaid.maths import Counts, Flags, Floats

_BAG, _MCAP, _SQLITE = b"#ROSBAG", b"\x89MCAP", b"SQLite format 3"
_JOINT_STATE = "sensor_msgs/msg/JointState"
#: Arrays of a joint state in the order in which they lie in its message.
_ARRAYS = ("position", "velocity", "effort")
#: Messages decoded at a time, and messages of each topic from which the names of its joints are taken.
_BATCH, _PROBE = 16384, 500
#: s; what stands in other messages is interpolated between two that are no farther apart.
_APART = 0.25
#: Bytes in which a message has its stamp (s and ns), in ROS 1 and 2; the name of the frame follows.
_STAMP = slice(4, 12)
#: ns; so long what stands in other messages is waited for.
_SECOND = 10**9
_MEND = (
    "copy it again; a recording that was stopped midway is repaired by 'ros2 bag reindex', 'mcap recover' or 'rosbag"
    " reindex', and one with compressed messages is unpacked by 'ros2 bag convert'"
)


class Layout(NamedTuple):
    """Where a message has what: joints' `names`, the `end` of these, and place and number of each array's values.

    Messages that agree in the (L,) bytes that are `fixed` have the same layout.
    """

    names: tuple[str, ...]
    end: int
    arrays: dict[str, tuple[int, int]]
    fixed: Flags


class BagLog(LogSource):
    """A recording; ``t`` is the stamp of a message in s, or when it was received where a topic has no stamps.

    A column is called ``/joint_states/elbow/effort``; the order of the joints in a message has no meaning. Rows are the
    messages that have the first column asked for, counted from 1; what other messages have is interpolated to their
    times.
    """

    endings = (".bag", ".db3", ".mcap")

    @classmethod
    def sniff(cls, head: bytes) -> bool:
        """By the bytes with which bags, MCAP files and SQLite databases begin."""
        return head.startswith((_BAG, _MCAP, _SQLITE))

    def schema(self) -> Sequence[LogColumn]:
        """The time, and the arrays that the first messages of each topic have.

        Raises
        ------
        LogError [not-a-log, file-not-readable]
            No topic has joint states, the recording is damaged, or the package that reads it is not installed.
        """
        self._columns: dict[str, tuple[str, str, str]] = {}
        self._joined: set[str] = set()
        counts: Counter[str] = Counter()
        with self._opened() as reader:
            for item in reader.connections:
                counts[item.topic] += item.msgcount
                states = reader.messages([item]) if item.msgtype == _JOINT_STATE else iter(())
                for layout in map(self._layout, self._taken(states, _PROBE)):
                    self._columns |= {
                        f"{item.topic}/{name}/{array}": (item.topic, name, array)
                        for name in layout.names
                        for array in layout.arrays
                    }
        topics = {topic for topic, *_ in self._columns.values()}
        rest = sorted({*counts} - topics)
        if not topics:
            raise LogError(
                "not-a-log",
                f"{self.name} has no message of {_JOINT_STATE}; its topics: {listed(rest) or 'none'}",
                Where(file=self.name),
                "record the joints' topic (/joint_states)",
            )
        text = f"{sum(counts[topic] for topic in rest)} messages of other topics are passed over: {listed(rest)}"
        self.notes = [Note("topics", text, Where(file=self.name))] if rest else []
        return [LogColumn("t", "s"), *map(LogColumn, self._columns)]

    def batches(self, names: Sequence[str]) -> Iterator[Batch]:
        """As `LogSource`.

        Raises
        ------
        LogError [file-not-readable]
            It breaks off, or a message is damaged.
        """
        columns = [name for name in names if name in self._columns]
        topics = {self._columns[name][0] for name in columns}
        places = [1 + columns.index(name) if name in self._columns else 0 for name in names]
        pending: list[Any] = []
        n_rows = n_done = 0
        with self._opened() as reader:
            states = [item for item in reader.connections if item.topic in topics and item.msgtype == _JOINT_STATE]
            messages, is_end = reader.messages(states), False
            while not is_end:
                more = self._taken(messages, _BATCH)
                is_end = len(more) < _BATCH
                pending += more
                received = np.array([time for _, time, _ in pending], dtype=np.int64)
                n_ready = len(pending) if is_end else int(np.searchsorted(received, received[-1] - _SECOND))
                if n_ready > n_done:
                    table = self._table(pending, columns, slice(n_done, n_ready))
                    yield Batch(n_rows + 1 + np.arange(table.shape[1]), table[places])
                    cut = 0 if is_end else int(np.searchsorted(received, received[n_ready] - _SECOND))
                    pending, n_rows, n_done = pending[cut:], n_rows + table.shape[1], n_ready - cut
        text = f"{listed(sorted(self._joined))} interpolated to the times of {columns[0]}"
        self.notes += [Note("topics", text, Where(file=self.name))] if self._joined else []

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        with self.path.open("rb") as stream:
            head = stream.read(len(_SQLITE))
        self._is_ros1 = head.startswith(_BAG)
        try:
            from rosbags import rosbag1
            from rosbags.rosbag2.storage_mcap import McapReader
            from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
        except ImportError as error:
            raise LogError(
                "file-not-readable",
                f"{self.name} is a recording of ROS, and the package rosbags, which reads it, is not installed",
                Where(file=self.name),
                "pip install 'pumaid[ros]'",
            ) from error
        with refusing(self.name, mend=_MEND):
            kind: Any = rosbag1.Reader if self._is_ros1 else McapReader if head.startswith(_MCAP) else Sqlite3Reader
            # The name of a database becomes part of an address, in which % and ? have a meaning.
            reader = kind(Path(quote(str(self.path))) if kind is Sqlite3Reader else self.path)
            reader.open()
        with closing(reader):
            yield reader

    def _taken(self, messages: Iterator[Any], count: int) -> list[Any]:
        """The next messages (connection, ns when it was received, bytes), fewer than `count` at the end alone."""
        with refusing(self.name, mend=_MEND):
            return list(islice(messages, count))

    def _layout(self, message: Any) -> Layout:
        with refusing(self.name, (struct.error, ValueError), mend=_MEND):
            return _layout(message[2], is_ros1=self._is_ros1)

    def _table(self, messages: Sequence[Any], columns: Sequence[str], ready: slice) -> Floats:
        table = np.full((1 + len(columns), len(messages)), np.nan)
        is_there = np.zeros(table.shape, dtype=bool)
        for members, layout, data in self._alike(messages):
            topic = messages[members[0]][0].topic
            # In whole nanoseconds, so that 0.575 s is the number that a text log has.
            stamps = data[:, _STAMP].copy().view("<u4").astype(np.int64) @ (_SECOND, 1) / _SECOND
            table[0, members] = stamps if stamps.any() else [messages[k][1] / _SECOND for k in members]
            for row, (wanted, joint, array) in enumerate(map(self._columns.__getitem__, columns), start=1):
                place, count = layout.arrays.get(array, (0, 0))
                index = layout.names.index(joint) if wanted == topic and joint in layout.names else count
                if index < count:
                    numbers = data[:, place + 8 * index : place + 8 * index + 8].copy().view("<f8")
                    table[row, members], is_there[row, members] = numbers[:, 0], True
        rows = np.flatnonzero(is_there[1, ready]) + ready.start
        result = table[:, rows]
        for row in range(2, len(table)):
            absent, places = ~is_there[row, rows], np.flatnonzero(is_there[row])
            if absent.any() and len(places):
                self._joined.add(columns[row - 1])
                result[row, absent] = _interpolated(result[0, absent], table[0, places], table[row, places])
        return result

    def _alike(self, messages: Sequence[Any]) -> Iterator[tuple[Counts, Layout, Any]]:
        pending = list(range(len(messages)))
        while pending:
            end = self._layout(messages[pending[0]]).end
            groups = defaultdict(list)
            for k in pending:
                connection, _, data = messages[k]
                groups[connection.topic, len(data), data[_STAMP.stop : end]].append(k)
            pending = []
            for group in groups.values():
                layout = self._layout(messages[group[0]])
                data = b"".join(messages[k][2] for k in group)
                table, members = np.frombuffer(data, dtype=np.uint8).reshape(len(group), -1), np.array(group)
                is_alike = (table[:, layout.fixed] == table[0, layout.fixed]).all(axis=1)
                yield members[is_alike], layout, table[is_alike]
                pending += members[~is_alike].tolist()


def _layout(data: bytes, *, is_ros1: bool) -> Layout:
    """The layout of a message: in ROS 2 numbers lie at multiples of their size, in ROS 1 all parts side by side.

    Source: OMG, DDS Interoperability Wire Protocol 2.5, chapter 10 (CDR with a header of four bytes).
    """
    if not is_ros1 and data[:2] != b"\0\1":
        raise ValueError("a message is not in plain CDR with the last byte of a number first")
    fixed = np.zeros(len(data), dtype=bool)
    place = _STAMP.stop

    def taken(size: int) -> bytes:
        nonlocal place
        fixed[place : place + size] = True
        place += size
        return data[place - size : place]

    def number() -> int:
        nonlocal place
        place += 0 if is_ros1 else -place % 4
        return int(struct.unpack("<I", taken(4))[0])

    def text() -> str:
        return taken(number()).rstrip(b"\0").decode(errors="replace")

    text()
    names = tuple(text() for _ in range(number()))
    end, arrays = place, {}
    for array in _ARRAYS:
        count = number()
        if count:
            place += 0 if is_ros1 else (4 - place) % 8
            arrays[array] = (place, count)
            place += 8 * count
    if place > len(data):
        raise ValueError("a message breaks off")
    return Layout(names, end, arrays, fixed)


def _interpolated(at: Floats, times: Floats, values: Floats) -> Floats:
    """(N,) values at some times between (M,) others, NaN where two of these are too far apart."""
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    after = np.searchsorted(times, at).clip(max=len(times) - 1)
    is_near = (times[after] - times[np.maximum(after - 1, 0)] <= _APART) & (times[0] <= at) & (at <= times[-1])
    return np.where(is_near | (times[after] == at), np.interp(at, times, values), np.nan)
