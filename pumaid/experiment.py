"""An experiment's files: its recipe, its dataset (read from the logs, or kept beside the results), its model."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
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


@dataclass(frozen=True, slots=True)
class Reading:
    """How logs are read.

    Attributes
    ----------
    jobs, dask
        Processes at most (0: one a core), or a Dask cluster's scheduler (or ``local``).
    is_kept
        Whether the dataset is written for whoever reads these logs next.
    tell
        Called with a sentence on what was read or written.
    progress
        Called with the number of files that are done, of how many.
    """

    jobs: int = 0
    dask: str = ""
    is_kept: bool = True
    tell: Callable[[str], None] = lambda text: None
    progress: Callable[[int, int], None] = lambda done, count: None


#: Here, in as many processes as there are cores, silently.
READING = Reading()


def read_robot(recipe: Path | None, logs: Sequence[str] = ()) -> Robot:
    """The arm of some logs.

    Parameters
    ----------
    recipe
        ``--recipe``, or none: the recipe is looked for near the logs.
    logs
        As the user typed them.
    """
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

    Parameters
    ----------
    estimate, robot
        The model, and the arm that it shall be of.
    near
        ``--recipe`` or none, and the logs: what led to the recipe that is told.
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
    known = set(estimate.logs.values())
    others = [facts for facts in dataset.files if facts.digest not in known]
    if trust or not known or not others:
        return
    shown = ", ".join(facts.name for facts in others[:3]) + (" ..." if len(others) > 3 else "")
    digests = f"(SHA-256 {others[0].digest[:12]}; it knows {', '.join(sorted(digest[:12] for digest in known)[:3])})"
    what = f"the model was not fitted to {len(others)} of these logs: {shown} {digests}"
    mend = "identify with these logs first, or give those of the model; --trust takes them all the same"
    raise ModelError("model-other-logs", what, Where(file=others[0].name), mend)


def read_dataset(
    logs: Sequence[str],
    recipe: Path | None,
    *,
    robot: Robot | None = None,
    trust: bool = False,
    heldout: Sequence[str] = (),
    extra: Sequence[str] = (),
    options: SegmentOptions | None = None,
    reading: Reading = READING,
    results: Path | None = None,
) -> tuple[Robot, Dataset]:
    """The dataset of some logs: what ``dataset.npz`` in the results folder holds if it was made of them, else anew.

    Parameters
    ----------
    logs
        As the user typed them: files, folders, globs, ``-``.
    recipe
        ``--recipe``, or none.
    robot
        The recipe's arm where it was read before: standard input can be read once.
    trust
        Turn refusals of logs that cannot mean what the recipe says into notes.
    heldout
        ``--heldout``: files, folders or globs of logs, or ``posture``.
    extra
        Columns of the logs that the user suspects; they arrive in the bins.
    options
        Thresholds of the segmentation; else its own.
    reading
        By whom the logs are read, and who is told.
    results
        ``--results``, or none.

    Returns
    -------
    robot, dataset
        Runs that the plan beside the recipe or the user keeps for judging are marked as held out.
    """
    from pumaid.io.paths import expand

    paths = expand(logs)
    robot = robot or read_robot(recipe, logs)
    settings = {"options": repr(options), "trust": trust, "columns": list(extra)}
    file = DatasetFile(results_folder(results, recipe, logs) / DATASET_NAME, paths, robot, settings, tell=reading.tell)
    dataset = file.read()
    if dataset is None:
        dataset = _ingested(paths, robot, trust=trust, extra=extra, options=options, reading=reading)
        if reading.is_kept:
            file.write(dataset)
    planned = _with_plan(dataset, robot, experiment_folder(recipe, logs))
    return robot, _with_heldout(planned, heldout) if heldout else planned


def _ingested(
    paths: Sequence[LogPath],
    robot: Robot,
    *,
    trust: bool,
    extra: Sequence[str],
    options: SegmentOptions | None,
    reading: Reading,
) -> Dataset:
    """The logs read and segmented: on a cluster, in several processes where there is enough to read, or here."""
    from pumaid.preprocessing.executors import dask_workers, local_processes
    from pumaid.preprocessing.ingest import ingest
    from pumaid.preprocessing.options import DEFAULTS

    sizes = [path.stat().st_size if isinstance(path, Path) and path.is_file() else 0 for path in paths]
    workers = dask_workers(reading.dask, reading.jobs) if reading.dask else local_processes(sizes, reading.jobs)
    with workers as executor:
        return ingest(
            paths,
            robot,
            options=options or DEFAULTS,
            extra=extra,
            trust=trust,
            executor=executor,
            progress=lambda done: reading.progress(done, len(paths)),
        )


def read_files(logs: Sequence[str], recipe: Path | None, *others: Path | None) -> list[Path]:
    """The files of this machine that a command works from, as far as they are there: what it must not write over.

    Parameters
    ----------
    logs
        As the user typed them; empty where the command reads none.
    recipe
        ``--recipe``, or none.
    others
        Such as the model.

    Returns
    -------
    paths
        Logs, recipe, the plan beside it, `others`.
    """
    from pumaid.io.paths import expand, is_remote
    from pumaid.io.plan_file import find_plan

    found = list(others)
    # What is not there is told when it is read, with more to say about it.
    with suppress(PumaidError):
        found += [recipe_path(recipe, logs), find_plan([experiment_folder(recipe, logs)])]
    for log in logs:
        with suppress(PumaidError):
            found += [path for path in expand([log]) if isinstance(path, Path)] if not is_remote(log) else []
    return [path for path in found if path is not None]


def experiment_folder(recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """The folder that holds the recipe, and so the plan and the results.

    A recipe that ships with pumaid has no experiment around it; then it is the working folder.

    Parameters
    ----------
    recipe
        ``--recipe``, or none.
    logs
        As the user typed them.
    """
    from pumaid.io.recipe import shipped_recipes

    path = recipe_path(recipe, logs)
    shipped = {one.resolve() for one in shipped_recipes().values()}
    return Path() if path.resolve() in shipped else path.parent


def results_folder(results: Path | None, recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """Where results go: what ``--results`` says, else ``results`` beside the recipe.

    Parameters
    ----------
    results
        ``--results``, or none.
    recipe
        ``--recipe``, or none.
    logs
        As the user typed them.
    """
    return results or experiment_folder(recipe, logs) / "results"


def recipe_path(recipe: Path | None, logs: Sequence[str] = ()) -> Path:
    """Where the recipe is: what ``--recipe`` says, else near the logs."""
    from pumaid.io.recipe import find_recipe

    return find_recipe(recipe, [Path(log) for log in logs])


def _with_heldout(dataset: Dataset, wanted: Sequence[str]) -> Dataset:
    """Runs of the files that the user names marked as held out; the word ``posture`` means each joint's last one."""
    from pumaid.io.paths import meant
    from pumaid.preprocessing.hold_out import hold_out

    names = [facts.name for facts in dataset.files]
    files = dict.fromkeys(name for word in wanted if word != POSTURE for name in meant(word, names))
    return hold_out(dataset, files=files, postures=POSTURE in wanted)


def _with_plan(dataset: Dataset, robot: Robot, folder: Path) -> Dataset:
    from pumaid.io.plan_file import find_plan, read_plan

    path = find_plan([folder])
    if path is None:
        return dataset
    from pumaid.preprocessing.hold_out import match_with_plan

    return match_with_plan(dataset, read_plan(path, robot))


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
