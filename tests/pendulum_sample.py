"""The pendulum's sample log, and what is read and identified from it in other forms."""

from pathlib import Path

import pumaid

ARM = Path(__file__).parents[1] / "sample_logs" / "pendulum"


def robot(folder, log=""):
    """The pendulum, by a recipe in a folder that has this `log` block."""
    recipe = folder / "recipe.yaml"
    recipe.write_text((ARM / "recipe.yaml").read_text(encoding="utf-8") + log, encoding="utf-8")
    return pumaid.read_recipe(recipe)


def numbers(result):
    """Every identified value."""
    values = {name: result[name].value for name in result.record.names}
    return {name: value for name, value in values.items() if value is not None}
