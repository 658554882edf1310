"""``pumaid init``: a recipe to start from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import content, document, notes, remark, spare_inputs, tables
from pumaid.errors import listed, meant

if TYPE_CHECKING:
    from pumaid.io.urdf import UrdfRecipe


_COUNT = click.IntRange(1, 50)


@click.command()
@click.argument("name", required=False)
@click.option("--list", "is_list", is_flag=True, help="List the robots that pumaid knows.")
@click.option("--joints", type=_COUNT, metavar="N", help="Number of joints of a blank recipe.  [default: 6]")
@click.option(
    "--urdf", type=options.FILE_OR_PIPE, metavar="FILE", help="Take the joints of this URDF as they are placed."
)
@click.option(
    "--base", metavar="LINK", help="Where the arm starts in the URDF.  [default: the link that nothing carries]"
)
@click.option("--tip", metavar="LINK", help="Where the arm ends in the URDF.  [default: where it splits]")
@options.force_option
@options.output_option("Where the recipe goes: a file, a folder, or - to print it.  [default: recipe.yaml]")
@options.json_option
def command(
    name: str | None,
    is_list: bool,
    joints: int | None,
    urdf: Path | None,
    base: str | None,
    tip: str | None,
    force: bool,
    output: Path | None,
    as_json: bool,
) -> None:
    """Write a recipe to start from: a robot that pumaid knows, one described by a URDF, or a blank one to fill in.

    NAME is a robot's name from --list, or blank.

    \b
    Example:
      pumaid init --list
      pumaid init ur5e -o my_arm/recipe.yaml
      pumaid init --urdf my_arm.urdf --tip tool0 -o my_arm/recipe.yaml
      pumaid init blank --joints 4
    """
    from pumaid.io.recipe import read_recipe
    from pumaid.io.urdf import recipe_from_urdf
    from pumaid.io.write import refuse_to_replace, write_file
    from pumaid.reporting.run_tables import axes_table

    if is_list:
        _list(as_json)
        return
    target = Path("recipe.yaml") if output is None else output
    spare_inputs([target, target / "recipe.yaml"], [urdf])
    facts: dict[str, Any] = {"kind": "recipe", "format": 1}
    if any(value is not None for value in ((base, tip) if urdf is None else (name, joints))):
        raise click.UsageError(
            "NAME and --joints go without --urdf FILE, --base and --tip with it: these are two recipes."
        )
    if urdf is None:
        text = _text(name, joints)
    else:
        made = recipe_from_urdf(urdf, base=base, tip=tip)
        text = made.text
        facts["urdf"] = _facts(made)
        notes(made.notes if not as_json else ())
    if str(target) == "-":
        document(facts | {"text": text}) if as_json else content(text.rstrip() + "\n")
        return
    path = target / "recipe.yaml" if target.is_dir() else target
    if not force:
        refuse_to_replace(path)
    write_file(path, text)
    robot = read_recipe(path)
    facts |= {"file": str(path), "robot": robot.name, "joints": robot.n_joints, "sha256": robot.digest}
    if as_json:
        document(facts)
        return
    if urdf is not None:
        tables(axes_table(robot))
    remark(f"wrote {path}: {robot.name}, {robot.n_joints} joints; check it, then: pumaid plan {path}")


def _facts(made: UrdfRecipe) -> dict[str, object]:
    """What was made of a URDF, for ``--json``; lengths in m, angles in rad."""
    robot, moving = made.robot, [joint for joint in made.path if joint.moves]
    fields = ("name", "placement", "limits", "max_velocity")
    rows = [{key: getattr(joint, key) for key in fields} for joint in robot.joints]
    return {
        "file": made.urdf.file,
        "sha256": made.urdf.digest,
        "base": made.base,
        "tip": made.tip,
        "joints": [row | {"urdf_type": stated.kind} for row, stated in zip(rows, moving, strict=True)],
        "folded": [joint.name for joint in made.path if not joint.moves],
        "left_out": [joint.name for joint in made.left_out],
        "gravity": robot.gravity,
        "notes": [note.as_json() for note in made.notes],
    }


def _text(name: str | None, joints: int | None) -> str:
    from pumaid.io.recipe import blank, shipped_recipes, started_from

    names = [*shipped_recipes(), "blank"]
    if name not in names:
        raise click.UsageError(
            f"There is no robot {name}: {meant(name, names)}"
            if name
            else f"Which one? {listed(names)}; or --urdf FILE."
        )
    if name != "blank" and joints is not None:
        raise click.UsageError(f"--joints is for a blank recipe; {name} has its own.")
    return blank(joints or 6) if name == "blank" else started_from(name)


def _list(as_json: bool) -> None:
    from pumaid.io.recipe import read_recipe, shipped_recipes
    from pumaid.reporting.table import Table

    robots = {name: read_recipe(path) for name, path in shipped_recipes().items()}
    rows = [{"name": name, "robot": robot.name, "joints": robot.n_joints} for name, robot in robots.items()]
    if as_json:
        document({"kind": "recipes", "format": 1, "recipes": rows})
        return
    lines = [[str(value) for value in row.values()] for row in rows]
    lines.append(["blank", "to fill in, any number of joints", "--joints N"])
    tables(Table("", ("name", "robot", "joints"), lines, words=(0, 1)))
