"""Logs stream: memory does not grow with the file."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.io.write import write_log
from pumaid.robot import Joint, Robot

#: What getrusage tells begins at the size of the process that started it, so the system's own record is read.
READ = """
import sys
from pathlib import Path
from pumaid.preprocessing.ingest import ingest
from pumaid.robot import Joint, Robot
robot = Robot("arm", tuple(Joint(k, f"j{k}", "revolute") for k in range(1, 7)))
rows = sum(facts.rows for facts in ingest([Path(sys.argv[1])], robot, trust=True).files)
peak = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
print(rows, int(peak) // 1024)
"""


def batches(n_rows: int) -> Iterator[Log]:
    """Six joints at 1 kHz: 19 columns of numbers that do not compress."""
    rng = np.random.default_rng(0)
    for start in range(0, n_rows, 50_000):
        rows = start + np.arange(50_000)
        phase = np.outer(rows * 1e-3, 0.2 + 0.1 * np.arange(6))
        position, velocity = np.sin(phase), np.cos(phase) + rng.normal(size=phase.shape)
        yield Log("made", rows + 2, rows * 1e-3, position, velocity, rng.normal(size=phase.shape))


def peak(path: Path) -> tuple[int, int]:
    """Rows read, and peak memory in MiB of a process that reads and watches the log."""
    done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=True)
    rows, memory = done.stdout.split()
    return int(rows), int(memory)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system keeps no such record")
@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_memory_does_not_grow_with_the_log(tmp_path: Path, ending: str) -> None:
    """600 000 rows more (90 MB of numbers) cost less than 90 MiB more: runs are kept, samples are not."""
    robot = Robot("arm", tuple(Joint(k, f"j{k}", "revolute") for k in range(1, 7)))
    peaks = []
    for n_rows in (600_000, 1_200_000):
        path = tmp_path / f"{n_rows}.{ending}"
        write_log(path, batches(n_rows), robot)
        rows, memory = peak(path)
        assert rows == n_rows
        peaks.append(memory)
    assert peaks[1] - peaks[0] < 90
