"""``pumaid doctor``: what a bug report needs."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import rich_click as click

from pumaid.cli.options import json_option, recipe_option
from pumaid.cli.output import attention, document, say

if TYPE_CHECKING:
    from pumaid.cli.selfcheck import Check

#: What only some commands need.
EXTRAS = ("mujoco", "distributed", "fsspec")
#: What pumaid's numbers depend on.
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "click", "rich-click", "rich")
#: Variables of the environment that change what pumaid does or how fast it is; besides all that begin with ``PUMAID_``.
VARIABLES = (
    *("ARROW_DEFAULT_MEMORY_POOL", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"),
    *("PYTHONIOENCODING", "PYTHONUTF8"),
)


@click.command()
@recipe_option
@click.option("--quick", is_flag=True, help="Versions and places only; leave the self-check out.")
@json_option
def command(recipe: Path | None, *, quick: bool, as_json: bool) -> None:
    """Versions, platform, settings, and a self-check of some ten seconds: paste it into a bug report.

    The self-check simulates a robot whose parameters are known, identifies it from its logs and finds what it hides.
    Exit code 1 where it fails.

    \b
    Example:
      pumaid doctor
      pumaid doctor --quick --recipe my_arm/recipe.yaml
      pumaid doctor --json | jq '.self_check[] | select(.passed | not)'
    """
    from pumaid.cli.progress import progress
    from pumaid.cli.selfcheck import self_check
    from pumaid.results.documents import heading

    facts = _facts(recipe)
    if not as_json:
        for name, found in facts.items():
            say(f"{name:10} {_line(found)}")
    checks: list[Check] = []
    if not quick:
        with progress("checking this installation") as step:
            for check in self_check(lambda name: step(len(checks), name)):
                checks.append(check)
                _tell(check, quietly=as_json)
    if as_json:
        document(heading("doctor") | facts | {"self_check": checks or None})
    if not all(check.passed for check in checks):
        attention()


def _tell(check: Check, *, quietly: bool) -> None:
    if not quietly:
        state = "ok" if check.passed else "FAILED"
        say(f"{'self-check':10} {state}: {check.name}: {check.text} ({check.seconds:.1f} s)")


def _facts(recipe: Path | None) -> dict[str, object]:
    """Names and what is found."""
    import platform
    from importlib.metadata import version

    from pumaid import __version__
    from pumaid.effects import catalogue
    from pumaid.io.recipe import shipped_recipes

    facts: dict[str, object] = {
        "pumaid": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "libraries": {name: version(name) for name in LIBRARIES},
        "extras": {name: _version_or_none(name) for name in EXTRAS},
        "effects": list(catalogue()),
        "recipes": list(shipped_recipes()),
        "processors": _processors(),
        "encoding": _encodings(),
        "variables": _variables(),
    }
    if recipe is not None:
        from pumaid.cli.reading import read_robot

        robot = read_robot(recipe)
        facts["recipe"] = {"file": robot.origin, "sha256": robot.digest, "joints": robot.n_joints}
    return facts


def _processors() -> dict[str, int | None]:
    """Of the machine, and those of it that this process may use."""
    count = os.cpu_count()
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else count
    return {"there": count, "usable": usable}


def _encodings() -> dict[str, str]:
    """How names of files, and text on standard output, are written."""
    return {"files": sys.getfilesystemencoding(), "output": str(getattr(sys.stdout, "encoding", None))}


def _variables() -> dict[str, str]:
    """Those that are set."""
    ours = sorted(name for name in os.environ if name.startswith("PUMAID_"))
    return {name: os.environ[name] for name in (*ours, *VARIABLES) if name in os.environ}


def _version_or_none(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return "-"


def _line(found: object) -> str:
    if isinstance(found, dict):
        return ", ".join(f"{key} {'-' if value is None else value}" for key, value in found.items()) or "-"
    return ", ".join(found) if isinstance(found, list) else str(found)
