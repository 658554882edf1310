"""Logs stream: memory does not grow with a file; `make bench` measures that of identify at two million rows."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pumaid.dataset import Log
from pumaid.io.write import write_log
from pumaid.robot import Joint, Robot

#: What getrusage says begins at the size of the process that started it, so the system's own record is read.
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


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system keeps no such record")
@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_memory_does_not_grow_with_the_log(tmp_path, ending):
    """500 000 rows more (76 MB of numbers that do not compress) cost less than 75 MiB more: runs stay, samples go."""
    robot = Robot("arm", tuple(Joint(k, f"j{k}", "revolute") for k in range(1, 7)))
    rng, peaks = np.random.default_rng(0), []
    phase = np.outer(np.arange(50_000) * 1e-3, 0.2 + 0.1 * np.arange(6))
    for count in (10, 20):
        logs = []
        for number in range(count):
            rows, current = number * len(phase) + np.arange(len(phase)), rng.normal(size=phase.shape)
            logs.append(Log("made", rows + 2, rows * 1e-3, np.sin(phase), np.cos(phase) + current, current))
        path = tmp_path / f"{count}.{ending}"
        write_log(path, logs, robot)
        done = subprocess.run([sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=True)
        read, memory = map(int, done.stdout.split())
        assert read == count * len(phase)
        peaks.append(memory)
    assert peaks[1] - peaks[0] < 75
