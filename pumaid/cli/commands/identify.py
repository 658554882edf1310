"""``pumaid identify``: from logs to the parameter table and the model file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import rich_click as click

from pumaid.cli.options import (
    Pass,
    effect_options,
    effects_option,
    heldout_option,
    json_option,
    logs_argument,
    output_option,
    pass_options,
    recipe_option,
    results_option,
    trust_option,
    units_option,
)
from pumaid.cli.output import document, notes, remark, table
from pumaid.cli.progress import progress


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
@click.option("--dask", default="", metavar="ADDRESS|local", help="Read the logs on a cluster of dask.distributed.")
@pass_options
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
    how: Pass,
    dask: str,
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
    from pumaid.choices import chosen_by
    from pumaid.cli.reading import read_evidence, read_robot, results_folder
    from pumaid.files.archive import keep
    from pumaid.files.result import model_document, write_model
    from pumaid.show.tables import parameter_table, sums_table
    from pumaid.verbs.identify import identify

    effects = chosen_by(read_robot(recipe, logs), add=add, remove=remove)
    robot, evidence = read_evidence(logs, recipe, trust=trust, heldout=heldout, how=replace(how, dask=dask))
    with progress("identifying", total=robot.n_joints) as step:
        estimate = identify(
            evidence,
            robot,
            effects=effects,
            recursive=recursive,
            progress=lambda joint, text: step(robot.n_joints - joint, text),
        )
    notes(dict.fromkeys((*evidence.notes, *estimate.notes)))
    if as_json or str(output) == "-":
        document(model_document(estimate))
    if str(output) == "-":
        return
    path = output or results_folder(results, recipe, logs) / "model.json"
    write_model(path, estimate) if output else keep(path, estimate, robot)
    if not as_json:
        table(parameter_table(estimate, robot, units))
        if sums := sums_table(estimate, units):
            table("")
            table(sums)
    remark(f"model written to {path}")
