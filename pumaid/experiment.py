"""An experiment's files: its recipe, its dataset (read from the logs, or kept beside the results), its model."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pumaid import __version__
from pumaid.errors import ModelError, PumaidError, ResultError, Where

if TYPE_CHECKING:
    from pumaid.dataset import Dataset
    from pumaid.estimate import Estimate
    from pumaid.io.paths import LogPath
    from pumaid.preprocessing.options import SegmentOptions
    from pumaid.robot import Robot

#: The dataset that commands share, in the results folder.
DATASET_NAME = "dataset.npz"
#: What of the package makes a dataset; while pumaid is worked on its version stays the same and these files do not.
_SOURCES = ("dataset.py", "samples.py", "units.py", "maths", "io", "preprocessing")
#: What ``--heldout`` is given for postures instead of files.
POSTURE = "posture"


def _unheard(*_: object) -> None:
    """What a report is where nobody listens."""


@dataclass(frozen=True)
class Experiment:
    """Logs, with the recipe, the plan and the results around them.

    Attributes
    ----------
    logs
        As the user typed them: files, folders, globs, ``-``.
    recipe
        ``--recipe``; where it is None the recipe is looked for near the logs.
    results
        ``--results``; where it is None, ``results`` beside the recipe.
    heldout
        Files, folders or globs of logs whose runs are kept for judging, or ``posture``: each joint's last one.
    trust
        Whether logs are taken that cannot mean what the recipe says; the refusals become notes.
    jobs, dask
        Processes at most (0: one a core), or a Dask cluster's scheduler (or ``local``).
    is_kept
        Whether the dataset is written for whoever reads these logs next.
    tell
        Called with a sentence on what was read or written.
    progress
        Called with the number of files that are done, of how many.
    """

    logs: tuple[str, ...] = ()
    recipe: Path | None = None
    results: Path | None = None
    heldout: tuple[str, ...] = ()
    trust: bool = False
    jobs: int = 0
    dask: str = ""
    is_kept: bool = True
    tell: Callable[[str], None] = _unheard
    progress: Callable[[int, int], None] = _unheard

    @property
    def folder(self) -> Path:
        """The folder of the recipe, and so of plan and results; for a shipped recipe the working folder."""
        from pumaid.io.recipe import shipped_recipes

        path = recipe_path(self.recipe, self.logs)
        shipped = {recipe.resolve() for recipe in shipped_recipes().values()}
        return Path() if path.resolve() in shipped else path.parent

    @property
    def results_folder(self) -> Path:
        """Where results go."""
        return self.results or self.folder / "results"

    @cached_property
    def robot(self) -> Robot:
        """The recipe's arm."""
        from pumaid.io.paths import expand

        expand(self.logs)  # where they are not there, it is not the recipe beside them that is missing
        return read_robot(self.recipe, self.logs)

    def model(self, path: Path) -> Estimate:
        """A model of this arm."""
        estimate = read_known_model(path)
        check_model(estimate, self.robot, (self.recipe, self.logs))
        return estimate

    def dataset(
        self, *, robot: Robot | None = None, extra: Sequence[str] = (), options: SegmentOptions | None = None
    ) -> Dataset:
        """The dataset of the logs: what ``dataset.npz`` in the results folder holds if it was made of them, else anew.

        Parameters
        ----------
        robot
            The arm where it was read before.
        extra
            Columns of the logs that the user suspects; they arrive in the bins.
        options
            Thresholds of the segmentation; else its own.

        Returns
        -------
        dataset
            Runs that the plan beside the recipe or the user keeps for judging are marked as held out.
        """
        from pumaid.io.paths import expand, meant
        from pumaid.io.plan_file import find_plan, read_plan
        from pumaid.preprocessing.hold_out import hold_out, match_with_plan

        paths = expand(self.logs)
        robot = robot or self.robot
        settings = {"options": repr(options), "trust": self.trust, "columns": list(extra)}
        file = DatasetFile(self.results_folder / DATASET_NAME, paths, robot, settings, tell=self.tell)
        dataset = file.read()
        if dataset is None:
            dataset = self._ingested(paths, robot, extra=extra, options=options)
            if self.is_kept:
                file.write(dataset)
        plan = find_plan([self.folder])
        if plan is not None:
            dataset = match_with_plan(dataset, read_plan(plan, robot))
        if not self.heldout:
            return dataset
        names = [facts.name for facts in dataset.files]
        files = dict.fromkeys(name for word in self.heldout if word != POSTURE for name in meant(word, names))
        return hold_out(dataset, files=files, postures=POSTURE in self.heldout)

    def _ingested(
        self, paths: Sequence[LogPath], robot: Robot, *, extra: Sequence[str], options: SegmentOptions | None
    ) -> Dataset:
        """The logs read and segmented: on a cluster, in several processes where there is enough to read, or here."""
        from pumaid.preprocessing.executors import dask_workers, local_processes
        from pumaid.preprocessing.ingest import ingest
        from pumaid.preprocessing.options import DEFAULTS

        sizes = [path.stat().st_size if isinstance(path, Path) and path.is_file() else 0 for path in paths]
        workers = dask_workers(self.dask, self.jobs) if self.dask else local_processes(sizes, self.jobs)
        with workers as executor:
            return ingest(
                paths,
                robot,
                options=options or DEFAULTS,
                extra=extra,
                trust=self.trust,
                executor=executor,
                progress=lambda done: self.progress(done, len(paths)),
            )

    def files(self, *inputs: Path | None) -> list[Path]:
        """The files of this machine that a command works from, as far as they are there: what it must not write over.

        These are logs, recipe, the plan beside it, and `inputs`, such as the model.
        """
        from pumaid.io.paths import expand, is_remote
        from pumaid.io.plan_file import find_plan

        paths = [*inputs]
        # What is not there is told when it is read, with more to say about it.
        with suppress(PumaidError):
            paths += [recipe_path(self.recipe, self.logs), find_plan([self.folder])]
        for log in self.logs:
            with suppress(PumaidError):
                paths += [path for path in expand([log]) if isinstance(path, Path)] if not is_remote(log) else []
        return [path for path in paths if path is not None]


def recipe_path(recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """Where the recipe is: what ``--recipe`` says, else near the logs."""
    from pumaid.io.recipe import find_recipe

    return find_recipe(recipe, [Path(log) for log in logs])


def read_robot(recipe: Path | None, logs: Sequence[str] = ()) -> Robot:
    """The arm of some logs; `recipe` is ``--recipe``, or none: it is then looked for near the logs."""
    from pumaid.io.recipe import read_recipe

    return read_recipe(recipe_path(recipe, logs))


def read_known_model(path: Path) -> Estimate:
    """A model, refused before any log is read where the catalogue lacks one of its effects."""
    from pumaid.effect_spec import check_known
    from pumaid.results.model_file import read_model

    estimate = read_model(path)
    check_known(estimate.effects)
    return estimate


def check_model(estimate: Estimate, robot: Robot, near: tuple[Path | None, Sequence[str]]) -> None:
    """Refuse a model of another recipe, or whose effects are no longer what they were.

    `near`, ``--recipe`` or none and the logs, led to the recipe.
    """
    from pumaid.effect_spec import check_parameters
    from pumaid.results.model_file import check_same_recipe

    try:
        check_same_recipe(estimate, robot)
    except ModelError as error:
        raise ModelError(error.slug, error.what, Where(file=str(recipe_path(*near))), error.mend) from error
    check_parameters(estimate, robot)


def check_logs(estimate: Estimate, dataset: Dataset, *, trust: bool = False) -> None:
    """Refuse logs that a model was not fitted to; `trust` lets them pass, for a user who knows better."""
    fitted = set(estimate.logs.values())
    unfitted = [facts.name for facts in dataset.files if facts.digest not in fitted]
    if trust or not fitted or not unfitted:
        return
    shown = ", ".join(unfitted[:3]) + (" ..." if len(unfitted) > 3 else "")
    what = f"the model was not fitted to {len(unfitted)} of these logs: {shown} (by their SHA-256)"
    mend = "identify with these logs first, or give those of the model; --trust takes them all the same"
    raise ModelError("model-other-logs", what, Where(file=unfitted[0]), mend)


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
    tell
        Called with a sentence on why the dataset is not used, and where it went.
    """

    def __init__(
        self,
        path: Path,
        logs: Sequence[LogPath],
        robot: Robot,
        settings: Mapping[str, Any],
        *,
        tell: Callable[[str], None],
    ) -> None:
        self._path, self._logs, self._tell = path, logs, tell
        recipe = hashlib.sha256(repr((robot.name, robot.joints, robot.log)).encode()).hexdigest()
        self._made_from: dict[str, Any] = {
            "program": f"pumaid {__version__} {_program()}",
            "recipe": recipe,
            "options": settings,
        }
        self._is_wanted = all(isinstance(log, Path) and log.is_file() for log in logs)

    def read(self) -> Dataset | None:
        """The dataset; None, and `tell` hears why, where it must be made anew."""
        if not self._is_wanted or not self._path.exists():
            return None
        from pumaid.dataset import load_dataset

        try:
            dataset, made_from = load_dataset(self._path)
        except ValueError as error:
            self._tell(f"{self._path} is damaged ({error}); the logs are read again")
            return None
        digests = made_from.pop("logs", None)
        differ = [name for name, value in self._made_from.items() if made_from.get(name) != value]
        if not differ and digests != {str(log): _digest(log) for log in self._logs}:
            differ = ["logs"]
        if differ:
            self._tell(f"{self._path} was made with other {' and '.join(differ)}; the logs are read again")
            return None
        return dataset

    def write(self, dataset: Dataset) -> None:
        """Write the dataset for the next command; `tell` hears of it, and of a disk that refuses."""
        digests = {facts.name: facts.digest for facts in dataset.files}
        if not self._is_wanted or not all(digests.values()):
            return
        from pumaid.dataset import save_dataset
        from pumaid.io.write import write_file

        content = io.BytesIO()
        save_dataset(content, dataset, {**self._made_from, "logs": digests})
        try:
            write_file(self._path, content.getvalue())
        except ResultError as error:
            self._tell(f"the dataset is not kept for the next command: {error.what}")
        else:
            self._tell(f"dataset written to {self._path}")


@cache
def _program() -> str:
    """Digest of the source files by which datasets are made."""
    package, whole = Path(__file__).parent, hashlib.sha256()
    for name in _SOURCES:
        path = package / name
        for source in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            whole.update(source.read_bytes())
    return whole.hexdigest()[:16]


def _digest(path: LogPath) -> str:
    with Path(str(path)).open("rb") as stream:
        return hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
