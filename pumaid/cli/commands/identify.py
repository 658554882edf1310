"""``pumaid identify``: from logs to the parameter table and the model file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli.options import (
    effect_options,
    effects_option,
    heldout_option,
    json_option,
    logs_argument,
    output_option,
    reading_options,
    recipe_option,
    results_option,
    trust_option,
    units_option,
)
from pumaid.cli.output import document, notes, remark, spare_inputs, table
from pumaid.cli.progress import progress

if TYPE_CHECKING:
    from pumaid.experiment import Reading
    from pumaid.records import Estimate
    from pumaid.robot import Robot


@click.command()
@logs_argument
@recipe_option
@effect_options
@effects_option
@click.option("--recursive", is_flag=True, help="Stop after the n-to-1 recursion; no joint refinement of all rows.")
@output_option("The model file to write; - for standard output. Default: model.json in the results folder.")
@results_option
@units_option
@heldout_option
@trust_option
@reading_options
@json_option
def command(
    *,
    logs: tuple[str, ...],
    recipe: Path | None,
    add: tuple[str, ...],
    remove: tuple[str, ...],
    recursive: bool,
    output: Path | None,
    results: Path | None,
    units: str,
    heldout: tuple[str, ...],
    trust: bool,
    reading: Reading,
    as_json: bool,
) -> None:
    """Identify gravity, friction and gain ratios from logged currents.

    Finds the runs in the logs, solves the joints from the tip to the base, refines all of them together by maximum
    likelihood, prints the parameter table and writes the model. Effects that are added are fitted together with all the
    rest, their nonlinear parameters too.

    \b
    Example:
      pumaid identify logs/
      pumaid identify logs/ --units deg -o results/first.json
      pumaid identify logs/ --add stribeck@3 --add ripple@elbow:frequency=58
      pumaid identify s3://bucket/logs --recipe recipe.yaml --dask tcp://10.0.0.5:8786
      pumaid identify - --recipe recipe.yaml --json < log.csv | jq '.ratios'
    """
    from pumaid.experiment import read_files

    asked: dict[str, Any] = {"add": add, "remove": remove, "recursive": recursive, "heldout": heldout, "trust": trust}
    asked |= {"reading": reading, "results": results}
    spare_inputs([output], read_files(logs, recipe) if output else [])
    robot, estimate = _identified(logs, recipe, asked)
    if str(output) == "-":
        document(_document(estimate))
        return
    path = _written(estimate, robot, (logs, recipe, results), output=output)
    if as_json:
        document(_document(estimate))
    else:
        _shown(estimate, robot, units)
    remark(f"model written to {path}")


def _identified(logs: tuple[str, ...], recipe: Path | None, asked: dict[str, Any]) -> tuple[Robot, Estimate]:
    """One robot's arm and model; notes are told."""
    from pumaid.effect_spec import chosen_by
    from pumaid.experiment import read_dataset, read_robot
    from pumaid.io.paths import expand

    expand(logs)  # where they are not there, it is not the recipe beside them that is missing
    robot = read_robot(recipe, logs)
    effects = chosen_by(robot, add=asked["add"], remove=asked["remove"])
    passed = {name: asked[name] for name in ("trust", "heldout", "reading", "results")}
    _, dataset = read_dataset(logs, recipe, robot=robot, **passed)
    from pumaid.estimation.estimate import identify

    with progress("identifying", total=robot.n_joints) as step:
        estimate = identify(
            dataset,
            robot,
            effects=effects,
            recursive=asked["recursive"],
            progress=lambda joint, text: step(robot.n_joints - joint, text),
        )
    notes(dict.fromkeys((*dataset.notes, *estimate.notes)))
    return robot, estimate


def _document(estimate: Estimate) -> dict[str, Any]:
    from pumaid.results.model_file import model_document

    return model_document(estimate)


def _written(
    estimate: Estimate,
    robot: Robot,
    place: tuple[tuple[str, ...], Path | None, Path | None],
    *,
    output: Path | None,
) -> Path:
    """The model's file: where -o says, else the current model of the results folder, kept among all."""
    from pumaid.experiment import results_folder
    from pumaid.results.history import keep
    from pumaid.results.model_file import write_model

    logs, recipe, results = place
    path = output or results_folder(results, recipe, logs) / "model.json"
    if output:
        write_model(path, estimate)
    else:
        keep(path, estimate, robot)
    return path


def _shown(estimate: Estimate, robot: Robot, units: str) -> None:
    from pumaid.reporting.tables import combination_table, parameter_table

    table(parameter_table(estimate, robot, units))
    if (sums := combination_table(estimate, units)) is not None:
        table("")
        table(sums.columns([0, 2, 3]))
