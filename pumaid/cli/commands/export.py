"""``pumaid export``: the model for other programs."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli import options

if TYPE_CHECKING:
    from pumaid.exports import Exported

#: One file a form; listed, not imported, so that help waits for nothing.
FORMS = sorted(info.name for info in pkgutil.iter_modules([str(Path(__file__).parents[2] / "exports" / "formats")]))


@click.command()
@options.model_argument
@click.option("--format", "form", type=click.Choice(FORMS), required=True, help="What to write; see docs/export.md.")
@options.output_option(
    "The file, without its ending for c (two files); - for standard output. Default: named after the robot, beside the"
    " model."
)
@click.option("--name", help="What functions are called. Default: the file's name, or the robot's.")
@click.option(
    "--torque-constants",
    "constants",
    metavar="K,K,...",
    help="N m/A (of a slide N/A) of every joint, or of some as JOINT=K, or a file of them; urdf and mjcf only. What is"
    " not given follows from the identified ratios.",
)
@click.option("--force", is_flag=True, help="Replace files that are there already.")
@options.recipe_option
@options.effects_option
@options.json_option
def command(
    *,
    model: Path,
    form: str,
    output: Path | None,
    name: str | None,
    constants: str | None,
    force: bool,
    recipe: Path | None,
    as_json: bool,
) -> None:
    """Write a model for other programs: gravity and friction in C, Python, MATLAB or JSON, or as URDF or MJCF.

    The recipe is looked for beside the model, beside its folder, and here. What the form does not hold, and what the
    data did not tell, stands at the head of each file and on standard error.

    \b
    Example:
      pumaid export results/model.json --format c -o puma
      pumaid export results/model.json --format python -o arm.py
      pumaid export results/model.json --format urdf --torque-constants 2=31.5 -o arm.urdf
    """
    from pumaid.cli.output import content, document, spare_inputs
    from pumaid.experiment import check_model, read_files, read_known_model, read_robot
    from pumaid.exports import every_form, export
    from pumaid.exports.equivalent_bodies import read_constants
    from pumaid.results.documents import heading

    if constants is not None and not every_form()[form].has_bodies:
        raise click.UsageError(f"--torque-constants is for forms with masses, such as urdf; {form} is in ampere.")
    to_pipe = output is not None and str(output) == "-"
    if to_pipe and (form == "c" or as_json):
        raise click.UsageError("Two files cannot go to standard output." if form == "c" else "--json prints itself.")
    estimate = read_known_model(model)
    robot = read_robot(recipe, [str(model)])
    check_model(estimate, robot, (recipe, [str(model)]))
    stem = "" if output is None or to_pipe or output.is_dir() else output.stem
    found = export(
        estimate,
        robot,
        form=form,
        name=name or stem,
        torque_constants=None if constants is None else read_constants(constants, robot.n_joints),
    )
    if to_pipe:
        content("".join(found.files.values()).rstrip("\n") + "\n")
        _tell(found)
        return
    files = _places(found, output, home=Path() if str(model) == "-" else model.parent)
    spare_inputs(files, read_files([str(model)], recipe, model, Path(constants) if constants else None))
    _write(files, force=force)
    if as_json:
        named = {"form": form, "name": found.name, "files": [str(path) for path in files]}
        lacks = {"left_out": found.left_out, "undetermined": found.undetermined, "remarks": found.remarks}
        document(heading("export", robot=robot, logs=estimate.logs) | named | lacks)
    _tell(found)


def _places(found: Exported, output: Path | None, *, home: Path) -> dict[Path, str]:
    """Where each file goes."""
    folder = home if output is None else output
    if output is None or output.is_dir():
        return {folder / f"{found.name}{suffix}": text for suffix, text in found.files.items()}
    if len(found.files) == 1:
        return {output: next(iter(found.files.values()))}
    bare = output.with_suffix("") if output.suffix in found.files else output
    return {bare.with_name(bare.name + suffix): text for suffix, text in found.files.items()}


def _write(files: Mapping[Path, str], *, force: bool) -> None:
    """Refuse before the first is written; what is made is whole."""
    from pumaid.cli.output import remark
    from pumaid.errors import ResultError, Where
    from pumaid.io.write import write_file

    for path in files:
        if path.exists() and not force:
            mend = "write elsewhere with -o FILE, or replace it with --force"
            raise ResultError("file-exists", f"{path} is there already", Where(file=str(path)), mend)
    for path, text in files.items():
        write_file(path, text)
    remark(f"written: {', '.join(map(str, files))}")


def _tell(found: Exported) -> None:
    """What is not in it, and what is uncertain of what is."""
    from pumaid.cli.output import remark

    for text in found.remarks:
        remark(text)
    for heading, lacks in (("left out", found.left_out), ("not determined by the data", found.undetermined)):
        for lack in lacks:
            remark(f"{heading}: {lack.name}: {lack.reason}")
