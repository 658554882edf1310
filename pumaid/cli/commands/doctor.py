"""``pumaid doctor``: what a bug report needs."""

import os
import sys
from contextlib import suppress

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, say

#: What pumaid's numbers depend on, and what only some commands need.
LIBRARIES = (
    *("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "click", "rich-click", "rich"),
    *("mujoco", "distributed", "fsspec"),
)


@click.command()
@options.json_option
def command(*, as_json: bool) -> None:
    """Versions, platform and settings: paste them into a bug report.

    Whether an installation works is told by: pumaid demo --robot pendulum2 --seed 1

    \b
    Example:
      pumaid doctor
    """
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from pumaid import __version__
    from pumaid.effects import catalogue
    from pumaid.io.recipe import shipped_recipes
    from pumaid.results.documents import heading

    installed = dict.fromkeys(LIBRARIES, "-")
    for name in installed:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    facts: dict[str, object] = {
        "pumaid": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "libraries": installed,
        "effects": list(catalogue()),
        "recipes": list(shipped_recipes()),
        "processors": os.cpu_count(),
        "encoding": {"files": sys.getfilesystemencoding(), "output": str(getattr(sys.stdout, "encoding", None))},
    }
    if as_json:
        document(heading("doctor") | facts)
        return
    for name, value in facts.items():
        entries = [f"{key} {entry}" for key, entry in value.items()] if isinstance(value, dict) else value
        say(f"{name:10} {', '.join(entries) if isinstance(entries, list) else entries}")
