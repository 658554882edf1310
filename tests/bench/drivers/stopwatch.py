"""What every driver tells the benchmark: its times, its own peak of memory, its versions and its answers.

A driver runs in the environment of its tool: this module needs numpy alone. A folder holds what it reads and writes.
"""

import json
import os
import sys
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

#: N m/s2 and the like are SI throughout; gravity as in the recipe.
GRAVITY = 9.80665


class Stopwatch:
    """Time since the driver's first line, split where its tool is loaded and where its work is done."""

    def __init__(self) -> None:
        self._marks = {"begun": time.perf_counter()}
        self.folder = Path(sys.argv[1])

    def loaded(self) -> None:
        """The tool is imported: its work begins."""
        self._marks["loaded"] = time.perf_counter()
        self._marks["spent"] = processor()

    def done(self, *packages: str) -> None:
        """The work is done: tell what it took, and the versions of `packages`, before answers are asked for."""
        now, marks = time.perf_counter(), self._marks
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        record: dict[str, Any] = {
            "versions": " ".join(f"{name} {version(name)}" for name in packages),
            "seconds": now - marks["loaded"],
            "processor": processor() - marks["spent"],
            "start-up": marks["loaded"] - marks["begun"],
            "peak MiB": int(status.split("VmHWM:")[1].split()[0]) // 1024,
        }
        (self.folder / "record.json").write_text(json.dumps(record), encoding="utf-8")

    def questions(self) -> Mapping[str, np.ndarray]:
        """Postures and speeds in which torques are asked for."""
        return dict(np.load(self.folder / "questions.npz"))

    def answer(self, gravity: np.ndarray, whole: np.ndarray) -> None:
        """Keep (N, J) N m at rest without friction, and (N, J) with that of the moving joint."""
        np.savez(self.folder / "answers.npz", gravity=gravity, whole=whole)


def processor() -> float:
    """Seconds of processor time of this process, of all its threads and of processes that it has waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
