"""``pumaid doctor``: what a bug report needs."""

from __future__ import annotations

from pathlib import Path

import rich_click as click

from pumaid.cli.options import json_option, recipe_option
from pumaid.cli.output import document, say

#: What pumaid's numbers depend on.
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "click", "rich-click", "rich")


@click.command()
@recipe_option
@json_option
def command(recipe: Path | None, as_json: bool) -> None:
    """Versions, platform, effects and recipes found: paste it into a bug report.

    \b
    Example:
      pumaid doctor
      pumaid doctor --recipe my_arm/recipe.yaml
    """
    import platform
    from importlib.metadata import version

    from pumaid import __version__
    from pumaid.effects import catalogue
    from pumaid.files.recipe import shipped_recipes
    from pumaid.files.result import heading

    facts: dict[str, object] = {
        "pumaid": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "libraries": {name: version(name) for name in LIBRARIES},
        "effects": list(catalogue()),
        "recipes": list(shipped_recipes()),
    }
    if recipe is not None:
        from pumaid.cli.reading import read_robot

        robot = read_robot(recipe)
        facts["recipe"] = {"file": robot.origin, "sha256": robot.digest, "joints": robot.n_joints}
    if as_json:
        document(heading("doctor") | facts)
        return
    for name, found in facts.items():
        say(f"{name:10} {_line(found)}")


def _line(found: object) -> str:
    if isinstance(found, dict):
        return ", ".join(f"{key} {value}" for key, value in found.items())
    return ", ".join(found) if isinstance(found, list) else str(found)
