"""The Python face: an arm, the model that is identified of it, and what is asked of both.

Results have the fields of their records and print as the command line's tables.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from rich.console import Console, Group

from pumaid.dataset import Dataset
from pumaid.diagnosis.compare import compare
from pumaid.effect_spec import chosen_by
from pumaid.errors import ResultError, Where, meant
from pumaid.estimate import Estimate, Value
from pumaid.estimation import estimate as fitting
from pumaid.experiment import LOGS, MODEL, Experiment
from pumaid.exports import Exported, export
from pumaid.preprocessing import segment as cutting
from pumaid.reporting.diagnosis import diagnosis_parts
from pumaid.reporting.documents import parameters_frame
from pumaid.reporting.table import renamed
from pumaid.reporting.tables import combination_table, comparison_table, parameter_table
from pumaid.reporting.text import current_unit
from pumaid.results.documents import write_model
from pumaid.robot import Robot

if TYPE_CHECKING:
    from pumaid.reporting.figures.style import Drawing

#: Files, folders and globs of logs.
Logs = str | PathLike[str] | Sequence[str | PathLike[str]]

#: Columns of a printed table.
WIDTH = 100


def load(folder: str | PathLike[str], *, recipe: str | PathLike[str] | None = None) -> Arm:
    """The arm of an experiment's folder, where ``recipe.yaml``, ``logs/`` and ``results/`` are looked for.

    `recipe` is another than the folder's: a file, or the name of a shipped one.
    """
    path = Path(folder)
    if not path.is_dir():
        raise ResultError("file-not-readable", f"{path} is no folder", Where(file=str(path)), "name another")
    return Arm(path, recipe or path)


def read_recipe(recipe: str | PathLike[str]) -> Robot:
    """A robot from a recipe: a file, a folder that holds ``recipe.yaml``, or the name of a shipped one (``ur5e``)."""
    return Experiment(recipe=Path(recipe)).robot


def identify(
    logs: Logs | Dataset, robot: Robot | None = None, *, recipe: str | PathLike[str] | None = None, **options: Any
) -> Any:
    """Identify gravity, friction and gain ratios from logged currents.

    Parameters
    ----------
    logs
        Files, folders, globs: the answer is `Identified`. Or a dataset, with its `robot`: then the bare `Estimate`.
    robot
        The arm of a dataset.
    recipe
        A file, or the name of a shipped one; else it is looked for near the logs.
    options
        As of `Arm.identify`; of a dataset as of `pumaid.estimation.estimate.identify`.
    """
    if isinstance(logs, Dataset) and robot is not None:
        return fitting.identify(logs, robot, **options)
    if isinstance(logs, Dataset) or robot is not None:
        raise TypeError("a dataset needs its robot, files a recipe: identify(dataset, robot), identify(files, recipe=)")
    return Arm(None, recipe).identify(logs, **options)


def segment(
    logs: Any, robot: Robot | None = None, *, recipe: str | PathLike[str] | None = None, **options: Any
) -> Dataset:
    """The runs in logs: in files, folders or globs, by a `recipe` as of `identify`; or in samples (`Log`), with
    their `robot`.

    `options` are those of `Arm.dataset`; of samples those of `pumaid.preprocessing.segment.segment`.
    """
    arm = Arm(None, recipe)
    return arm.dataset(logs, **options) if robot is None else cutting.segment(logs, robot, **options)


class Arm:
    """An arm with its experiment's folder (None where only logs are known) and its recipe (else near the logs)."""

    def __init__(self, folder: Path | None, recipe: str | PathLike[str] | None = None) -> None:
        self.folder, self._recipe = folder, None if recipe is None else Path(recipe)

    def __repr__(self) -> str:
        """Robot and folder."""
        return f"<Arm {self.robot.name}, {self.robot.n_joints} joints, {self.folder or 'no folder'}>"

    @cached_property
    def robot(self) -> Robot:
        """The robot of the recipe."""
        return Experiment(recipe=self._recipe).robot

    def dataset(self, logs: Logs | None = None, *, heldout: Logs = (), trust: bool = False) -> Dataset:
        """The runs of some logs, by default of the folder's ``logs``; `results/dataset.npz` is used where it is theirs.

        `heldout` are logs whose runs are kept for judging; `trust` takes logs that look wrong.
        """
        return self._experiment(logs, heldout=heldout, trust=trust).dataset()

    def identify(
        self,
        logs: Logs | None = None,
        *,
        add: str | Sequence[str] = (),
        recursive: bool = False,
        trust: bool = False,
        **options: Any,
    ) -> Identified:
        """Identify the arm from logs, by default the folder's; nothing is written (see `Identified.save`).

        `add` takes effects as on the command line (``"stribeck@3"``), `recursive` stops after the n-to-1 recursion,
        `trust` takes logs that look wrong, `options` is `heldout` as of `dataset`.
        """
        experiment = self._experiment(logs, trust=trust, **options)
        dataset = experiment.dataset()
        estimate = fitting.identify(
            dataset,
            experiment.robot,
            effects=chosen_by(experiment.robot, _texts(add)),
            recursive=recursive,
            trust=trust,
        )
        return Identified(estimate, experiment.robot, dataset, arm=self)

    def model(self, path: str | PathLike[str] | None = None, *, logs: Logs | None = None) -> Identified:
        """A model file, by default the folder's current one; `logs` are what it is then held against."""
        experiment = self._experiment(logs)
        estimate = experiment.model(Path(path or (self.folder or Path()) / MODEL))
        return Identified(estimate, experiment.robot, experiment.dataset(), arm=self)

    def _experiment(self, logs: Logs | None, *, heldout: Logs = (), trust: bool = False) -> Experiment:
        return Experiment(
            _texts((self.folder or Path()) / LOGS if logs is None else logs),
            self._recipe,
            is_kept=False,
            heldout=_texts(heldout),
            trust=trust,
        )


def _texts(given: Logs) -> tuple[str, ...]:
    """Several texts or paths, or a single one."""
    return (str(given),) if isinstance(given, str | PathLike) else tuple(map(str, given))


class Answer:
    """A record that prints as the command line's tables (`parts`); its fields are the record's."""

    def __init__(self, record: Any, parts: Iterable[Any], unit: str) -> None:
        self.record, self._parts = record, [renamed(part, unit) for part in parts if part is not None]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["record"], name)

    def __repr__(self) -> str:
        return "\n".join(line.rstrip() for line in self._console().export_text().splitlines())

    def _repr_html_(self) -> str:
        return str(self._console().export_html(inline_styles=True, code_format="<pre>{code}</pre>"))

    def _console(self) -> Console:
        console = Console(file=io.StringIO(), width=WIDTH, record=True, highlight=False)
        console.print(Group(*self._parts))
        return console


class Identified(Answer):
    """An identified model, with its `arm` and the `dataset` that it is held against where no other logs are named."""

    def __init__(self, estimate: Estimate, robot: Robot, dataset: Dataset, *, arm: Arm) -> None:
        self.unit = current_unit(estimate.notes)
        super().__init__(estimate, [parameter_table(estimate, robot), combination_table(estimate)], self.unit)
        self.robot, self.dataset, self._arm = robot, dataset, arm

    def __getitem__(self, name: str) -> Value:
        try:
            return self.record.value(name)
        except KeyError:
            raise KeyError(f"there is no parameter {name}; {meant(name, self.record.names)}") from None

    def to_frame(self, units: str = "rad") -> pd.DataFrame:
        """One row a parameter: name, symbol, joint, unit, value, std_error, ci_low, ci_high, state, reason ...

        `units` of angles are ``"rad"`` or ``"deg"``.
        """
        return parameters_frame(self.record, units)

    def compare(self, logs: Logs | None = None, **options: Any) -> Answer:
        """The model against some logs (by default those that it is fitted to), as `Comparison`."""
        comparison = compare(self.record, self._runs(logs, options), self.robot)
        return Answer(comparison, [comparison_table(comparison, self.robot)], self.unit)

    def diagnose(self, logs: Logs | None = None, **options: Any) -> Answer:
        """Which physical effect the model misses, as `Diagnosis`."""
        from pumaid.diagnosis.diagnose import diagnose

        diagnosis = diagnose(self.record, self._runs(logs, options), self.robot)
        return Answer(diagnosis, diagnosis_parts(diagnosis, self.robot), self.unit)

    def plot(self, name: str = "", *, units: str = "rad") -> Drawing:
        """The first figure of the report whose name begins so (``"residual_j2"``, ``"spent"``); angles in `units`.

        A notebook shows it; `save` writes it as PNG, SVG or PDF.

        KeyError: there is none of this name; the message lists them.
        """
        from pumaid.reporting.page import ReportContext, all_contents, all_figures

        context = ReportContext(self.robot, self.record, self.dataset, self.compare().record, units)
        drawings = list(all_figures(all_contents(context)))
        for drawing in drawings:
            if drawing.name.startswith(name):
                return drawing
        raise KeyError(f"there is no figure {name!r}; there are {', '.join(drawing.name for drawing in drawings)}")

    def export(self, form: str, **options: Any) -> Exported:
        """The model for another program, as `pumaid.export` writes it."""
        return export(self.record, self.robot, form=form, **options)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model file that the command line reads."""
        write_model(Path(path), self.record)

    def _runs(self, logs: Logs | None, options: dict[str, Any]) -> Dataset:
        return self.dataset if logs is None else self._arm.dataset(logs, **options)
