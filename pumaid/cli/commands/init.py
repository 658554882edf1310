"""``pumaid init``: a recipe to start from."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from pumaid.cli.options import json_option, output_option


@click.command()
@click.argument("name", required=False)
@click.option("--list", "listed", is_flag=True, help="List the robots that pumaid knows.")
@click.option(
    "--joints", type=click.IntRange(1, 50), metavar="N", help="Number of joints of a blank recipe.  [default: 6]"
)
@click.option("--force", is_flag=True, help="Replace a recipe that is there already.")
@output_option("Where the recipe goes: a file, a folder, or - to print it.  [default: recipe.yaml]")
@json_option
def command(
    name: str | None, listed: bool, joints: int | None, force: bool, output: Path | None, as_json: bool
) -> None:
    """Write a recipe to start from: a robot that pumaid knows, or a blank one to fill in.

    NAME is a robot's name from --list, or blank.

    \b
    Example:
      pumaid init --list
      pumaid init ur5e -o my_arm/recipe.yaml
      pumaid init blank --joints 4
    """
    from pumaid.cli.output import document, remark, say
    from pumaid.files.recipe import read_recipe, shipped_recipes

    if listed:
        robots = {known: read_recipe(path) for known, path in shipped_recipes().items()}
        rows = [{"name": known, "robot": robot.name, "joints": robot.n_joints} for known, robot in robots.items()]
        if as_json:
            document({"kind": "recipes", "format": 1, "recipes": rows})
        else:
            _show(rows)
        return
    text = _text(name, joints)
    target = Path("recipe.yaml") if output is None else output
    if str(target) == "-":
        if as_json:
            document({"kind": "recipe", "format": 1, "text": text})
        else:
            say(text.rstrip())
        return
    path = _written(target, text, force)
    robot = read_recipe(path)
    if as_json:
        facts = {"file": str(path), "robot": robot.name, "joints": robot.n_joints, "sha256": robot.digest}
        document({"kind": "recipe", "format": 1, **facts})
    else:
        remark(f"wrote {path}: {robot.name}, {robot.n_joints} joints; check it, then: pumaid plan {path}")


def _text(name: str | None, joints: int | None) -> str:
    from pumaid.files.recipe import shipped_recipes
    from pumaid.files.recipe_template import blank, started_from
    from pumaid.files.yaml_lines import nearest

    known = [*shipped_recipes(), "blank"]
    if name is None:
        raise click.UsageError(f"Which robot? One of: {', '.join(known)}.")
    if name not in known:
        near = nearest(name, known)
        raise click.UsageError(f"No robot '{name}'. " + (f"Did you mean '{near}'?" if near else f"{', '.join(known)}."))
    if name == "blank":
        return blank(joints or 6)
    if joints is not None:
        raise click.UsageError(f"--joints is for a blank recipe; {name} has its own.")
    return started_from(name)


def _written(target: Path, text: str, force: bool) -> Path:
    from pumaid.errors import ResultError, Where
    from pumaid.files.atomic import write_whole

    path = target / "recipe.yaml" if target.is_dir() else target
    if path.exists() and not force:
        mend = "write elsewhere with -o FILE, or replace it with --force"
        raise ResultError("file-exists", f"{path} is there already", Where(file=str(path)), mend)
    write_whole(path, text)
    return path


def _show(rows: list[dict[str, object]]) -> None:
    from rich.table import Table

    from pumaid.cli.output import table

    listed = Table("name", "robot", "joints", box=None, pad_edge=False)
    for row in rows:
        listed.add_row(*(str(value) for value in row.values()))
    listed.add_row("blank", "to fill in, any number of joints", "--joints N")
    table(listed)
