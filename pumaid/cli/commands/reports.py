"""``pumaid report``, ``history``, ``export`` and ``effects``: what is known, for people and programs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, notes, progress, remark, show, spare_inputs, write_result
from pumaid.errors import ModelError, Note, ResultError, Where, meant

if TYPE_CHECKING:
    from pumaid.experiment import Experiment
    from pumaid.exports import Exported
    from pumaid.reporting.page import ReportContext

FIGURES = ("png", "svg", "pdf")


@click.command()
@click.argument("model", type=options.FILE_OR_PIPE, required=False, metavar="[MODEL]")
@click.argument("logs", type=options.LOGS, nargs=-1, metavar="[LOGS...]")
@options.effects_option
@options.output_option("The page; else results/report.html; - prints it.")
@click.option(
    "--format",
    "forms",
    default="png,svg,pdf",
    callback=options.separated(click.Choice(FIGURES, case_sensitive=False)),
    help="Forms of figures; '' for none.",
)
@options.units_option
@options.experiment_options()
@options.json_option
def report(
    *,
    model: Path | None,
    experiment: Experiment,
    output: Path | None,
    forms: tuple[str, ...],
    units: str,
    as_json: bool,
) -> None:
    """Write the report: one self-contained HTML page, the tables and the figures.

    MODEL is results/model.json beside the recipe, LOGS the folder logs/ there, where they are not given.

    \b
    Example:
      pumaid report
      pumaid report results/model.json new_logs/ -o new.html --units deg
      pumaid report --format pdf
    """
    from pumaid.reporting import page

    if as_json and str(output) == "-":
        raise click.UsageError("--json tells which files a report wrote; -o - wants standard output too.")
    place = str(model.parent.parent / "logs") if model and str(model) != "-" else "logs"
    near = replace(experiment, logs=experiment.logs or (place,))
    source = model or near.folder / "results" / "model.json"
    experiment = replace(near, logs=experiment.logs or (str(near.folder / "logs"),))
    spare_inputs([output], experiment.files(source, source.parent / "diagnosis.json"))
    context = _context(source, experiment, units=units)
    files: list[Path] = []
    with progress("drawing") as step:
        for number, (name, data) in enumerate(page.report_files(context, forms)):
            step(number, name)
            path = near.results_folder / name
            files.append(output or path if name == "report.html" else path)
            write_result(files[-1], data)
    remark(f"report written to {files[-1]}, with {len(files) - 1} tables and figures")
    if as_json:
        document({"files": list(map(str, files))}, "report", robot=context.robot, logs=context.comparison.logs)


def _context(source: Path, experiment: Experiment, *, units: str) -> ReportContext:
    """The model on the logs, the models before it, and the diagnosis beside it unless that cannot be used."""
    from pumaid.diagnosis import compare, records
    from pumaid.reporting.page import ReportContext
    from pumaid.results.history import ladder_of

    estimate = experiment.model(source)
    robot, dataset = experiment.robot, experiment.dataset()
    comparison = compare.compare(estimate, dataset, robot)
    notes((*dataset.notes, *estimate.notes, *comparison.notes))
    context = ReportContext(robot, estimate, dataset, comparison, units, ladder=ladder_of(source))
    path = source.parent / records.DIAGNOSIS_NAME
    if not path.is_file():
        return context
    try:
        diagnosis = records.read_diagnosis(path)
        if len(diagnosis.joints) != robot.n_joints:
            raise ResultError("file-damaged", f"{path} is of another arm", Where(file=str(path)))
    except ResultError as error:
        notes([Note("file-damaged", f"{error.what}; the page leaves it out", error.where)])
        return context
    return replace(context, diagnosis=diagnosis, stale=records.stale(diagnosis, estimate, comparison.logs))


@click.command()
@click.argument("folder", type=options.FILE, default=Path(), metavar="[FOLDER]")
@options.results_option
@options.effects_option
@options.json_option
def history(*, folder: Path, results: Path | None, as_json: bool) -> None:
    """Tell the error ladder of an experiment: each model, what it added, and the error after.

    FOLDER is the experiment's, or its results; the working folder where not given. Every model that identify and
    diagnose --apply wrote is kept in results/models; copy one to results/model.json to go back to it. Errors are those
    of the runs that were fitted and of those that were held out; the noise floor is what repeated runs differ by, which
    no model can pass.

    \b
    Example:
      pumaid history
      pumaid history my_arm
      pumaid history --json | jq '.ladders[0].models[].rmse'
    """
    from pumaid.reporting import documents, table, tables, text
    from pumaid.results import history as archive

    is_results = (folder / "models").is_dir() or folder.name == "results"
    models = archive.read_history(results or (folder if is_results else folder / "results"))
    notes(models.notes)
    if as_json:
        document(documents.history_document(models), "history")
    else:
        units = [text.current_unit(ladder.rungs[-1].estimate.notes) for ladder in models.ladders]
        show(*map(table.renamed, map(tables.history_table, models.ladders), units))


@click.command()
@options.model_argument
@click.option(
    "--format", "form", metavar="FORM", default="", show_default=False, help="c, python, matlab, json, urdf or mjcf."
)
@click.option("--into", type=options.EXISTING, metavar="FILE", help="A URDF or MJCF: a copy with the joints' friction.")
@options.output_option("The file; else beside the model, or FILE; - prints it.")
@click.option("--torque-constants", "constants", metavar="K,K,...", help="N m/A or N/A: of all joints, or JOINT=K,...")
@options.force_option
@options.recipe_option
@options.effects_option
@options.json_option
@options.of_experiment
def export(
    *,
    model: Path,
    form: str,
    into: Path | None,
    output: Path | None,
    constants: str | None,
    force: bool,
    experiment: Experiment,
    as_json: bool,
) -> None:
    """Write a model for other programs: in C, Python, MATLAB or JSON, or as URDF or MJCF.

    What the form does not hold and the data do not tell stands at the head of each file and on standard error.

    \b
    Example:
      pumaid export results/model.json --format c -o puma
      pumaid export results/model.json --format urdf --torque-constants 2=31.5
      pumaid export results/model.json --into arm.xml --torque-constants 2=31.5
    """
    from pumaid import exports
    from pumaid.exports.equivalent_bodies import read_constants
    from pumaid.io.mjcf import with_includes

    to_pipe, forms = output is not None and str(output) == "-", exports.every_form()
    if form not in (forms if into is None else ("",)):
        what = (
            f"{form!r} is not one of {', '.join(sorted(forms))}." if form else f"Which of {', '.join(sorted(forms))}?"
        )
        raise click.BadParameter("It is the form of --into's FILE." if into else what, param_hint="--format")
    if constants is not None and form and not forms[form].has_bodies:
        raise click.UsageError(f"--torque-constants is for forms with masses, such as urdf; {form} is in ampere.")
    if to_pipe and (form == "c" or as_json):
        raise click.UsageError("Two files cannot go to standard output." if form == "c" else "--json prints itself.")
    experiment = replace(experiment, logs=(str(model),))
    estimate, robot = experiment.model(model), experiment.robot
    name, content = "" if output is None or to_pipe or output.is_dir() else output.stem, None
    if into is not None:
        name, content = f"{into.stem}_identified", with_includes(into)
        output = output or into.with_name(name + into.suffix)
    torques = None if constants is None else read_constants(constants, robot.n_joints)
    exported = exports.export(estimate, robot, form=form, name=name, torque_constants=torques, into=content)
    if to_pipe:
        write_result(Path("-"), "".join(exported.files.values()).rstrip("\n") + "\n")
    else:
        files = _places(exported, output, home=Path() if str(model) == "-" else model.parent)
        spare_inputs(files, experiment.files(model), new=() if force else files)
        for path, text in files.items():
            write_result(path, text)
        remark(f"written: {', '.join(map(str, files))}")
        if as_json:
            facts = {name: getattr(exported, name) for name in ("form", "name", "left_out", "undetermined", "remarks")}
            document(facts | {"files": [str(path) for path in files]}, "export", robot=robot, logs=estimate.logs)
    absent = (f"left out: {lack.name}: {lack.reason}" for lack in exported.left_out)
    unclear = (f"not determined by the data: {lack.name}: {lack.reason}" for lack in exported.undetermined)
    for text in (*exported.remarks, *absent, *unclear):
        remark(text)


def _places(exported: Exported, output: Path | None, *, home: Path) -> dict[Path, str]:
    if output is not None and not output.is_dir() and len(exported.files) == 1:
        return {output: next(iter(exported.files.values()))}
    file = output if output is not None and not output.is_dir() else (output or home) / exported.name
    bare = file.with_suffix("") if file.suffix in exported.files else file
    return {  # C includes its header by the model's name
        bare.with_name(bare.name + suffix): text.replace(f'#include "{exported.name}.h"', f'#include "{bare.name}.h"')
        for suffix, text in exported.files.items()
    }


@click.command()
@click.argument("name", required=False)
@options.effects_option
@options.json_option
def effects(*, name: str | None, as_json: bool) -> None:
    """The physics that pumaid knows: all effects, or one explained.

    Explaining one prints its law, parameters, signature and look-alikes, and the command that adds it.

    \b
    Example:
      pumaid effects
      pumaid effects stribeck
      pumaid effects --json | jq '.effects[].equation'
    """
    from pumaid.effect_spec import OWN
    from pumaid.effects import catalogue
    from pumaid.reporting.effects import effect_parts, effects_table, facts

    listing = catalogue()
    if name is not None and name not in listing:
        raise ModelError("unknown-effect", f"there is no effect '{name}'", mend=f"{meant(name, list(listing))}; {OWN}")
    chosen = [facts(effect) for effect in (listing.values() if name is None else [listing[name]])]
    if as_json:
        document({"effects": chosen}, "effects")
    elif name is None:
        show(effects_table(chosen))
    else:
        show(*effect_parts(chosen[0]))
