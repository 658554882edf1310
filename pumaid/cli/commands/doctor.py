"""``pumaid doctor``: what a bug report needs."""

import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, progress, say
from pumaid.errors import ResultError

#: What pumaid's numbers depend on, and what only some commands need.
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "click", "rich-click", "rich")
EXTRAS = ("mujoco", "distributed", "fsspec")
#: The arm of the self-check, and the seed of what it hides.
ARM, SEED = "pendulum2", 1


@click.command()
@options.recipe_option
@click.option("--quick", is_flag=True, help="Versions only; leave the self-check out.")
@options.json_option
def command(recipe: Path | None, *, quick: bool, as_json: bool) -> bool:
    """Versions, platform, settings and a self-check of some ten seconds: paste it into a bug report.

    The self-check is the demo on a small arm: a robot is simulated, identified from its logs, and what it hides is to
    be found. Exit code 1 where it fails.

    \b
    Example:
      pumaid doctor
      pumaid doctor --quick --recipe my_arm/recipe.yaml
    """
    from pumaid.results.documents import heading

    facts = _facts(recipe)
    for name, value in facts.items() if not as_json else ():
        text = ", ".join(f"{key} {entry}" for key, entry in value.items()) if isinstance(value, dict) else value
        say(f"{name:10} {', '.join(text) if isinstance(text, list) else text}")
    passed, text = (True, "left out") if quick else _self_check()
    if as_json:
        document(heading("doctor") | facts | {"self_check": None if quick else {"passed": passed, "text": text}})
    elif not quick:
        say(f"{'self-check':10} {'ok' if passed else 'FAILED'}: {text}")
    return not passed


def _self_check() -> tuple[bool, str]:
    """Whether the demo ends as it must, and how it ended."""
    from pumaid.cli.commands import demo

    with tempfile.TemporaryDirectory() as scratch, progress("checking this installation") as step:
        folder = Path(scratch) / "demo"
        try:
            for done in demo.story(folder, robot=ARM, seed=SEED):
                step(0.0, done["command"])
        except ResultError as error:
            return False, error.what
        secret, outcome, _ = demo.judged(folder)
    return outcome == "named", f"the hidden {secret} is {'found' if outcome == 'named' else 'not found'}"


def _facts(recipe: Path | None) -> dict[str, object]:
    """Names and what is found."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from pumaid import __version__
    from pumaid.effects import catalogue
    from pumaid.experiment import Experiment
    from pumaid.io.recipe import shipped_recipes

    installed = dict.fromkeys((*LIBRARIES, *EXTRAS), "-")
    for name in installed:
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    facts: dict[str, object] = {
        "pumaid": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "libraries": {name: installed[name] for name in LIBRARIES},
        "extras": {name: installed[name] for name in EXTRAS},
        "effects": list(catalogue()),
        "recipes": list(shipped_recipes()),
        "processors": os.cpu_count(),
        "encoding": {"files": sys.getfilesystemencoding(), "output": str(getattr(sys.stdout, "encoding", None))},
    }
    if recipe is not None:
        robot = Experiment(recipe=recipe).robot
        facts["recipe"] = {"file": robot.origin, "sha256": robot.digest, "joints": robot.n_joints}
    return facts
