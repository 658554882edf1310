"""``pumaid identify``: from logs to the parameter table and the model file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, identified, notes, remark, spare_inputs, tables

if TYPE_CHECKING:
    from pumaid.experiment import Experiment


@click.command()
@options.logs_argument
@options.add_option
@options.remove_option
@options.effects_option
@click.option("--recursive", is_flag=True, help="Stop after the n-to-1 recursion; no joint refinement of all rows.")
@options.output_option("The model file to write; - for standard output. Default: model.json in the results folder.")
@click.option(
    "--motion",
    type=click.Choice(["any", "constant"]),
    default="any",
    show_default=True,
    help="What is fitted: all motion, or constant speed alone.",
)
@options.units_option
@options.experiment_options()
@options.json_option
def command(
    *,
    experiment: Experiment,
    add: tuple[str, ...],
    remove: tuple[str, ...],
    recursive: bool,
    output: Path | None,
    motion: str,
    units: str,
    as_json: bool,
) -> None:
    """Identify gravity, inertia, friction and gain ratios from logged currents.

    Finds what can be fitted in the logs (runs at constant speed, strokes, blocks of any motion), solves the joints from
    the tip to the base, refines all of them together by maximum likelihood, prints the parameter table and writes the
    model. Effects that are added are fitted together with all the rest, their nonlinear parameters too.

    \b
    Example:
      pumaid identify logs/
      pumaid identify logs/ --units deg -o results/first.json
      pumaid identify logs/ --add stribeck@3 --add ripple@elbow:frequency=58
      pumaid identify s3://bucket/logs --recipe recipe.yaml --dask tcp://10.0.0.5:8786
      pumaid identify - --recipe recipe.yaml --json < log.csv | jq '.ratios'
    """
    from pumaid.dataset import CONSTANT
    from pumaid.effect_spec import chosen_by
    from pumaid.reporting.tables import combination_table, parameter_table
    from pumaid.results.history import keep
    from pumaid.results.model_file import model_document, write_model

    spare_inputs([output], experiment.files() if output else [])
    robot = experiment.robot
    effects = chosen_by(robot, add=add, remove=remove)
    dataset = experiment.dataset()
    if motion == CONSTANT:
        dataset = replace(dataset, runs=tuple(run for run in dataset.runs if run.kind == CONSTANT))
    estimate = identified(dataset, robot, effects=effects, recursive=recursive)
    notes(dict.fromkeys((*dataset.notes, *estimate.notes)))
    path = output or experiment.results_folder / "model.json"
    if output is None:
        keep(path, estimate, robot)
    elif str(output) != "-":
        write_model(path, estimate)
    if as_json or str(output) == "-":
        document(model_document(estimate))
    else:
        sums = combination_table(estimate)
        tables(parameter_table(estimate, robot, units), sums and sums.columns([0, 2, 3]))
    if str(output) != "-":
        remark(f"model written to {path}")
