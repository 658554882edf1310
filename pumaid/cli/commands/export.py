"""``pumaid export``: the model for other programs."""

from __future__ import annotations

import pkgutil
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import content, document, remark, spare_inputs

if TYPE_CHECKING:
    from pumaid.exports import Exported

#: One file a form; listed, not imported, so that help waits for nothing.
FORMS = sorted(info.name for info in pkgutil.iter_modules([str(Path(__file__).parents[2] / "exports" / "formats")]))


@click.command()
@options.model_argument
@click.option("--format", "form", type=click.Choice(FORMS), required=True, help="What to write; see docs/export.md.")
@options.output_option("The file; - for standard output. Default: named after the robot, beside the model.")
@click.option("--torque-constants", "constants", metavar="K,K,...", help="N m/A or N/A: of all joints, or JOINT=K,...")
@options.force_option
@options.recipe_option
@options.effects_option
@options.json_option
def command(
    *,
    model: Path,
    form: str,
    output: Path | None,
    constants: str | None,
    force: bool,
    recipe: Path | None,
    as_json: bool,
) -> None:
    """Write a model for other programs: gravity and friction in C, Python, MATLAB or JSON, or as URDF or MJCF.

    What the form does not hold and the data do not tell stands at the head of each file and on standard error.

    \b
    Example:
      pumaid export results/model.json --format c -o puma
      pumaid export results/model.json --format python -o arm.py
      pumaid export results/model.json --format urdf --torque-constants 2=31.5 -o arm.urdf
    """
    from pumaid.experiment import Experiment
    from pumaid.exports import every_form, export
    from pumaid.exports.equivalent_bodies import read_constants
    from pumaid.io.write import refuse_to_replace, write_file
    from pumaid.results.documents import heading

    to_pipe = output is not None and str(output) == "-"
    if constants is not None and not every_form()[form].has_bodies:
        raise click.UsageError(f"--torque-constants is for forms with masses, such as urdf; {form} is in ampere.")
    if to_pipe and (form == "c" or as_json):
        raise click.UsageError("Two files cannot go to standard output." if form == "c" else "--json prints itself.")
    experiment = Experiment((str(model),), recipe)
    estimate = experiment.model(model)
    robot = experiment.robot
    name = "" if output is None or to_pipe or output.is_dir() else output.stem
    torques = None if constants is None else read_constants(constants, robot.n_joints)
    exported = export(estimate, robot, form=form, name=name, torque_constants=torques)
    if to_pipe:
        content("".join(exported.files.values()).rstrip("\n") + "\n")
    else:
        files = _places(exported, output, home=Path() if str(model) == "-" else model.parent)
        spare_inputs(files, experiment.files(model))
        for path in files if not force else ():
            refuse_to_replace(path)
        for path, text in files.items():
            write_file(path, text)
        remark(f"written: {', '.join(map(str, files))}")
        if as_json:
            facts = {"form": form, "name": exported.name, "files": [str(path) for path in files]}
            facts |= {name: getattr(exported, name) for name in ("left_out", "undetermined", "remarks")}
            document(heading("export", robot=robot, logs=estimate.logs) | facts)
    lacks = [("left out", lack) for lack in exported.left_out]
    lacks += [("not determined by the data", lack) for lack in exported.undetermined]
    for text in (*exported.remarks, *(f"{what}: {lack.name}: {lack.reason}" for what, lack in lacks)):
        remark(text)


def _places(exported: Exported, output: Path | None, *, home: Path) -> dict[Path, str]:
    """Where each file goes."""
    if output is None or output.is_dir():
        bare = (output or home) / exported.name
    elif len(exported.files) == 1:
        return {output: next(iter(exported.files.values()))}
    else:
        bare = output.with_suffix("") if output.suffix in exported.files else output
    return {bare.with_name(bare.name + suffix): text for suffix, text in exported.files.items()}
