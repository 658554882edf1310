"""``pumaid doctor``: what a bug report needs."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import attention, document, say

#: What only some commands need.
EXTRAS = ("mujoco", "distributed", "fsspec")
#: What pumaid's numbers depend on.
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "click", "rich-click", "rich")
#: The arm of the self-check, and the seed of what it hides.
ARM, SEED = "pendulum2", 1


@click.command()
@options.recipe_option
@click.option("--quick", is_flag=True, help="Versions only; leave the self-check out.")
@options.json_option
def command(recipe: Path | None, *, quick: bool, as_json: bool) -> None:
    """Versions, platform, settings and a self-check of some ten seconds: paste it into a bug report.

    The self-check is the demo on a small arm: a robot is simulated, identified from its logs, and what it hides is to
    be found. Exit code 1 where it fails.

    \b
    Example:
      pumaid doctor
      pumaid doctor --quick --recipe my_arm/recipe.yaml
    """
    from pumaid.cli.output import progress
    from pumaid.results.documents import heading

    facts = _facts(recipe)
    if not as_json:
        for name, value in facts.items():
            say(f"{name:10} {_line(value)}")
    passed, text = True, "left out"
    if not quick:
        with progress("checking this installation") as step:
            passed, text = _self_check(lambda line: step(0.0, line))
        if not as_json:
            say(f"{'self-check':10} {'ok' if passed else 'FAILED'}: {text}")
    if as_json:
        document(heading("doctor") | facts | {"self_check": None if quick else {"passed": passed, "text": text}})
    if not passed:
        attention()


def _self_check(tell: Callable[[str], None]) -> tuple[bool, str]:
    """Whether the demo ends as it must, and how it ended."""
    from pumaid.cli.commands import demo
    from pumaid.errors import ResultError

    steps: list[demo.DemoStep] = []
    with tempfile.TemporaryDirectory() as scratch:
        try:
            for step in demo.story(Path(scratch) / "demo", robot=ARM, seed=SEED):
                tell(step.line)
                steps.append(step)
        except ResultError as error:
            return False, error.what
    diagnosis = next(step.answer for step in steps if step.answer["kind"] == "diagnosis")
    hidden = demo.hidden(seed=SEED, joints=2)
    is_found = any(demo.place(finding) == hidden for finding in demo.findings(diagnosis))
    return is_found, f"the hidden {hidden} is {'found' if is_found else 'not found'}"


def _facts(recipe: Path | None) -> dict[str, object]:
    """Names and what is found."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from pumaid import __version__
    from pumaid.effects import catalogue
    from pumaid.io.recipe import shipped_recipes

    def installed(name: str) -> str:
        try:
            return version(name)
        except PackageNotFoundError:
            return "-"

    facts: dict[str, object] = {
        "pumaid": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "libraries": {name: installed(name) for name in LIBRARIES},
        "extras": {name: installed(name) for name in EXTRAS},
        "effects": list(catalogue()),
        "recipes": list(shipped_recipes()),
        "processors": os.cpu_count(),
        "encoding": {"files": sys.getfilesystemencoding(), "output": str(getattr(sys.stdout, "encoding", None))},
    }
    if recipe is not None:
        from pumaid.experiment import Experiment

        robot = Experiment(recipe=recipe).robot
        facts["recipe"] = {"file": robot.origin, "sha256": robot.digest, "joints": robot.n_joints}
    return facts


def _line(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {entry}" for key, entry in value.items())
    return ", ".join(value) if isinstance(value, list) else str(value)
