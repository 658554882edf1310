"""Logs read ahead: the same batches, the same errors, and no thread left behind."""

from __future__ import annotations

import threading
from itertools import islice

import numpy as np
import pytest

from pumaid.errors import LogError
from pumaid.io.ahead import Ahead
from pumaid.records import Log


def batches(count, broken=False):
    """Logs of one sample, numbered; with an error behind the last where `broken`."""
    for k in range(count):
        yield Log("a", np.array([k]), np.array([float(k)]), np.zeros((1, 1)), None, np.zeros((1, 1)))
    if broken:
        raise LogError("damaged-log", "cut off")


def readers():
    """Threads that read ahead."""
    return [thread for thread in threading.enumerate() if thread.name.startswith("read-ahead")]


def test_the_same_batches_in_order():
    """Nothing is lost, doubled or moved."""
    assert [int(log.rows[0]) for log in Ahead(batches(50))] == list(range(50))


def test_an_error_comes_where_its_batch_would():
    """All batches before it arrive first."""
    seen = []
    with pytest.raises(LogError, match="cut off"):
        seen.extend(int(log.rows[0]) for log in Ahead(batches(9, broken=True)))
    assert readers() == []


@pytest.mark.parametrize("taken", [0, 1, 7])
def test_a_reader_that_nobody_wants_ends(taken):
    """Whoever gives up in the middle leaves no thread waiting."""
    stream = iter(Ahead(batches(10_000)))
    assert len(list(islice(stream, taken))) == taken
    stream.close()
    assert readers() == []
