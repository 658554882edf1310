"""``results/dataset.npz``: the dataset that commands share, used only if it was made of the same logs."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pumaid import __version__
from pumaid.cli.output import remark
from pumaid.dataset import Dataset, load_dataset, save_dataset
from pumaid.errors import ResultError
from pumaid.io.write import write_file

if TYPE_CHECKING:
    from pumaid.io.paths import LogPath
    from pumaid.robot import Robot

DATASET_NAME = "dataset.npz"
#: What of the package makes a dataset; while pumaid is worked on its version stays the same and these files do not.
_SOURCES = ("dataset.py", "units.py", "maths", "io", "preprocessing", "records")


class DatasetFile:
    """The file of one dataset.

    Parameters
    ----------
    path
        Where it is.
    logs
        The logs; without a file where they are not all plain files.
    robot
        The arm. What counts of its recipe are the name, the joints and the log block.
    settings
        What else the dataset depends on, as JSON can hold it.
    """

    def __init__(self, path: Path, logs: Sequence[LogPath], robot: Robot, settings: Mapping[str, Any]) -> None:
        self._path, self._logs = path, logs
        recipe = hashlib.sha256(repr((robot.name, robot.joints, robot.log)).encode()).hexdigest()
        self._made_from: dict[str, Any] = {
            "program": f"pumaid {__version__} {_program()}",
            "recipe": recipe,
            "options": settings,
        }
        self._is_wanted = all(isinstance(log, Path) and log.is_file() for log in logs)

    def read(self) -> Dataset | None:
        """The dataset; None, with a remark that says why, where it must be made anew."""
        if not self._is_wanted or not self._path.exists():
            return None
        try:
            dataset, made_from = load_dataset(self._path)
        except ValueError as error:
            remark(f"{self._path} is damaged ({error}); the logs are read again")
            return None
        digests = made_from.pop("logs", None)
        differ = [name for name, value in self._made_from.items() if made_from.get(name) != value]
        if not differ and digests != {str(log): _digest(log) for log in self._logs}:
            differ = ["logs"]
        if differ:
            remark(f"{self._path} was made with other {' and '.join(differ)}; the logs are read again")
            return None
        return dataset

    def write(self, dataset: Dataset) -> None:
        """Write the dataset for the next command; a disk that refuses is remarked on."""
        digests = {facts.name: facts.digest for facts in dataset.files}
        if not self._is_wanted or not all(digests.values()):
            return
        content = io.BytesIO()
        save_dataset(content, dataset, {**self._made_from, "logs": digests})
        try:
            write_file(self._path, content.getvalue())
        except ResultError as error:
            remark(f"the dataset is not kept for the next command: {error.what}")
        else:
            remark(f"dataset written to {self._path}")


@cache
def _program() -> str:
    """Digest of the source files by which datasets are made."""
    package, whole = Path(__file__).parents[1], hashlib.sha256()
    for name in _SOURCES:
        path = package / name
        for source in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            whole.update(source.read_bytes())
    return whole.hexdigest()[:16]


def _digest(path: LogPath) -> str:
    with Path(str(path)).open("rb") as stream:
        return hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
