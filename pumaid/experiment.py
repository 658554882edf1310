"""An experiment's files: its recipe, its dataset (read from the logs, or kept beside the results), its model."""

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from pumaid import __version__
from pumaid.dataset import Dataset, load_dataset, save_dataset, with_payloads
from pumaid.effect_spec import check_parameters, terms_of
from pumaid.errors import ModelError, PumaidError, RecipeError, ResultError, Where, listed
from pumaid.estimate import Estimate
from pumaid.io.paths import DATASET, LogPath, chosen_logs, expand, is_remote
from pumaid.io.plan_file import find_plan, read_plan
from pumaid.io.recipe import find_recipe, shipped_recipes
from pumaid.io.urdf import read_robot
from pumaid.io.write import write_file
from pumaid.preprocessing.binning import DEFAULTS
from pumaid.preprocessing.hold_out import hold_out, match_with_plan
from pumaid.results.documents import check_same_recipe, read_model
from pumaid.robot import Robot

#: Of an experiment's folder: the logs, and the current model.
LOGS, MODEL = "logs", "results/model.json"


def _silent(*_: object) -> None:
    """What a report is where nobody listens."""


@dataclass(frozen=True)
class Experiment:
    """Logs, with the recipe, the plan and the results around them."""

    logs: tuple[str, ...] = ()  # as the user typed them: files, folders, globs, ``-``
    recipe: Path | None = None  # else near the logs
    results: Path | None = None  # else the folder ``results`` beside the recipe
    heldout: tuple[str, ...] = ()  # logs whose runs are kept for judging
    trust: bool = False  # logs are taken that cannot mean what the recipe says; the refusals become notes
    cell: float | None = None  # s that a cell of a block of any motion lasts; else as the encoder needs
    jobs: int = 0  # processes at most; 0: one a core
    dask: str = ""  # a Dask cluster's scheduler
    is_kept: bool = True  # the dataset is written for whoever reads these logs next
    tell: Callable[[str], None] = _silent  # called with a sentence on what was read or written
    progress: Callable[[int, int], None] = _silent  # called with the number of files done, of how many

    @cached_property
    def recipe_path(self) -> Path:
        """Where the recipe is."""
        try:
            return find_recipe(self.recipe, [Path(log) for log in self.logs])
        except RecipeError:
            if self.logs:  # where they are not there, it is not the recipe beside them that is missing
                expand(self.logs)
            raise

    @property
    def folder(self) -> Path:
        """The folder of the recipe, and so of plan and results; for a shipped recipe the working folder."""
        shipped = {recipe.resolve() for recipe in shipped_recipes().values()}
        return Path() if self.recipe_path.resolve() in shipped else self.recipe_path.parent

    @property
    def results_folder(self) -> Path:
        """Where results go."""
        return self.results or self.folder / "results"

    @cached_property
    def robot(self) -> Robot:
        """The recipe's arm."""
        return read_robot(self.recipe_path, self.tell)

    def model(self, path: Path) -> Estimate:
        """A model of this arm; one of another recipe or with effects that are not known as they were is refused."""
        estimate = read_model(path)
        terms_of(estimate.effects)
        check_same_recipe(estimate, replace(self.robot, origin=str(self.recipe_path)))
        check_parameters(estimate, self.robot)
        return estimate

    def dataset(self, *, extra: Sequence[str] = ()) -> Dataset:
        """The dataset of the logs: what `DATASET` in the results folder holds if it was made of them, else anew.

        Parameters
        ----------
        extra
            Columns of the logs that the user suspects; they arrive in the bins.

        Returns
        -------
        dataset
            Runs that the plan beside the recipe or the user keeps for judging are marked as held out.
        """
        options = replace(DEFAULTS, cell=self.cell)
        paths = expand(self.logs)
        plan = find_plan([self.folder])
        made_from = dataset_inputs(self.robot, plan, options=repr(options), trust=self.trust, columns=list(extra))
        sizes = [path.stat().st_size for path in paths if isinstance(path, Path) and path.is_file()]
        file = self.results_folder / DATASET if len(sizes) == len(paths) else None
        dataset = read_dataset(file, paths, made_from, tell=self.tell) if file else None
        if dataset is None:
            from pumaid.preprocessing.ingest import dask_workers, ingest, local_processes

            with dask_workers(self.dask) if self.dask else local_processes(sizes, self.jobs) as executor:
                dataset = ingest(
                    paths,
                    self.robot,
                    options=options,
                    extra=extra,
                    trust=self.trust,
                    executor=executor,
                    progress=lambda done: self.progress(done, len(paths)),
                )
            if plan is not None:
                dataset = match_with_plan(dataset, read_plan(plan, self.robot), self.robot)
            if self.is_kept and file:
                keep_dataset(file, dataset, made_from, tell=self.tell)
        dataset = with_payloads(dataset, self.robot.payloads)
        if not self.heldout:
            return dataset
        names = [facts.name for facts in dataset.files]
        return hold_out(dataset, [name for word in self.heldout for name in chosen_logs(word, names)])

    def files(self, *inputs: Path | None) -> list[Path]:
        """The files of this machine that a command works from, as far as they are there: what it must not write over.

        These are logs, recipe, the plan beside it, and `inputs`, such as the model.
        """
        paths = [*inputs]
        # What is not there is told when it is read, with more to say about it.
        with suppress(PumaidError):
            paths += [self.recipe_path, find_plan([self.folder])]
        with suppress(PumaidError):
            paths += [Path(path) for path in expand(log for log in self.logs if not is_remote(log))]
        return [path for path in paths if path is not None]


def check_logs(estimate: Estimate, dataset: Dataset, *, trust: bool = False) -> None:
    """Refuse logs that a model was not fitted to; `trust` lets them pass, for a user who knows better."""
    fitted = set(estimate.logs.values())
    unfitted = [facts.name for facts in dataset.files if facts.digest not in fitted]
    if trust or not fitted or not unfitted:
        return
    what = f"the model was not fitted to {len(unfitted)} of these logs: {listed(unfitted, 3)} (by their SHA-256)"
    mend = "identify with these logs first, or give those of the model; --trust takes them all the same"
    raise ModelError("model-other-logs", what, Where(file=unfitted[0]), mend)


def dataset_inputs(robot: Robot, plan: Path | None = None, **options: Any) -> dict[str, Any]:
    """What a dataset depends on beside the logs, as JSON can hold it: of a recipe, name, joints and the log block."""
    recipe = hashlib.sha256(repr((robot.name, robot.joints, robot.log)).encode()).hexdigest()
    return {"program": f"pumaid {__version__}", "recipe": recipe, "plan": plan and _digest(plan), "options": options}


def read_dataset(
    path: Path, logs: Sequence[LogPath], made_from: Mapping[str, Any], *, tell: Callable[[str], None]
) -> Dataset | None:
    """The dataset of `logs` that `keep_dataset` wrote; None, and `tell` hears why, where it must be made anew."""
    if not path.exists():
        return None
    try:
        dataset, before = load_dataset(path)
        differ = [name for name, value in made_from.items() if before.get(name) != value]
        if not differ and before.get("logs") == {str(log): _digest(log) for log in logs}:
            return dataset
        why = f"was made with other {' and '.join(differ or ['logs'])}"
    except ValueError as error:
        why = f"is damaged ({error})"
    tell(f"{path} {why}; the logs are read again")
    return None


def keep_dataset(path: Path, dataset: Dataset, made_from: Mapping[str, Any], *, tell: Callable[[str], None]) -> None:
    """Write the dataset for the next command; `tell` hears of it, and of a disk that refuses."""
    content = io.BytesIO()
    save_dataset(content, dataset, {**made_from, "logs": {facts.name: facts.digest for facts in dataset.files}})
    try:
        write_file(path, content.getvalue())
        tell(f"dataset written to {path}")
    except ResultError as error:
        tell(f"the dataset is not kept for the next command: {error.what}")


def _digest(path: LogPath) -> str:
    with Path(str(path)).open("rb") as stream:
        return hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()
