"""Arguments and options that several commands share, each written once.

A decorator states the name under which its value arrives: ``logs``, ``recipe``, ``output``, ``results``, ``as_json``,
``seed``, ``units``, ``check``, ``trust``, ``heldout``, ``suspect``, ``reading``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import rich_click as click

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


#: Names of one thing: what the program writes goes where ``-`` goes.
_STDOUT = {"-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"}


class _Place(click.Path):
    """Where something goes; an empty word, which would be the working folder, is no place."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if str(value) == "":
            self.fail("the name is empty; a folder or file has one, the working folder is '.'", param, ctx)
        return super().convert("-" if self.allow_dash and str(value) in _STDOUT else value, param, ctx)


def logs_argument(function: Decorated) -> Decorated:
    """``LOGS...`` as `logs`: tuple of str; files, folders, globs, ``-`` for standard input."""
    return click.argument("logs", nargs=-1, required=True, metavar="LOGS...")(function)


def model_argument(function: Decorated) -> Decorated:
    """``MODEL`` as `model`: Path of a model file, or ``-``."""
    return click.argument("model", type=click.Path(path_type=Path, allow_dash=True), metavar="MODEL")(function)


def recipe_option(function: Decorated) -> Decorated:
    """``--recipe FILE`` as `recipe`: Path or None."""
    told = "The robot's recipe; else recipe.yaml in the logs' folder, beside it, or here."
    return click.option("--recipe", type=click.Path(path_type=Path), metavar="FILE", help=told)(function)


def output_option(told: str) -> Callable[[Decorated], Decorated]:
    """``-o FILE`` as `output`: Path or None; ``-`` is standard output. `told` is its help."""
    kind = _Place(path_type=Path, allow_dash=True)
    return click.option("-o", "--output", type=kind, metavar="FILE", help=told)


def results_option(function: Decorated) -> Decorated:
    """``--results FOLDER`` as `results`: Path or None."""
    told = "Where results go; else results/ beside the recipe."
    return click.option("--results", type=_Place(path_type=Path), metavar="FOLDER", help=told)(function)


def json_option(function: Decorated) -> Decorated:
    """``--json`` as `as_json`: bool."""
    told = "Print one JSON document on standard output and nothing else there."
    return click.option("--json", "as_json", is_flag=True, help=told)(function)


def seed_option(function: Decorated) -> Decorated:
    """``--seed N`` as `seed`: int, 0 or more; 0 where not given."""
    told = "Random numbers start here; the same seed gives the same result."
    kind = click.IntRange(min=0)
    return click.option("--seed", type=kind, default=0, show_default=True, metavar="N", help=told)(function)


def units_option(function: Decorated) -> Decorated:
    """``--units rad|deg`` as `units`: str."""
    told = "Unit of angles in tables; JSON is always in rad."
    kind = click.Choice(["rad", "deg"])
    return click.option("--units", type=kind, default="rad", show_default=True, help=told)(function)


def check_option(function: Decorated) -> Decorated:
    """``--check`` as `check`: bool."""
    told = "Leave with exit code 1 if something asks for attention."
    return click.option("--check", is_flag=True, help=told)(function)


def effect_options(function: Decorated) -> Decorated:
    """``--add`` and ``--remove`` as `add` and `remove`: tuples of str, as `pumaid.choices` reads them."""
    added = (
        "Physics beyond the paper's model, such as stribeck@3; may be repeated. JOINT is a number from 1, a name or"
        " all; a shape that is not given is fitted."
    )
    removed = "Leave out an effect that the recipe switches on, or all of them; may be repeated."
    metavar = "EFFECT[@JOINT]"
    function = click.option("--remove", multiple=True, metavar=metavar, help=removed)(function)
    return click.option("--add", multiple=True, metavar=f"{metavar}[:SHAPE=VALUE,...]", help=added)(function)


def trust_option(function: Decorated) -> Decorated:
    """``--trust`` as `trust`: bool."""
    told = "Go on where the logs look wrong (units, order of joints, dead currents): refusals become notes."
    return click.option("--trust", is_flag=True, help=told)(function)


def reading_options(function: Decorated) -> Decorated:
    """``--jobs N`` and ``--dask ADDRESS`` as `reading`: Reading."""

    @wraps(function)
    def run(*, jobs: int, dask: str, **values: Any) -> Any:
        from pumaid.cli.output import remark
        from pumaid.cli.progress import counted
        from pumaid.experiment import Reading

        return function(reading=Reading(jobs, dask, tell=remark, progress=counted), **values)

    told = "Read the log files with the workers of this dask.distributed scheduler."
    run = click.option("--dask", default="", metavar="ADDRESS|local", help=told)(run)
    told = "Processes that read log files; 0: one a core. The result does not depend on it."
    kind = click.IntRange(min=0)
    return click.option("--jobs", type=kind, default=0, show_default=True, metavar="N", help=told)(run)  # type: ignore[return-value]


def heldout_option(function: Decorated) -> Decorated:
    """``--heldout FILE|posture``, any number of times, as `heldout`: tuple of str."""
    told = (
        "Keep the runs of these logs for judging, unfitted: a file, folder or quoted glob among LOGS; or 'posture':"
        " each joint's last one, of four or more. Repeatable."
    )
    metavar = "FILE|posture"
    return click.option("--heldout", multiple=True, metavar=metavar, callback=_no_empty, help=told)(function)


def _no_empty(context: click.Context, option: click.Parameter, words: tuple[str, ...]) -> tuple[str, ...]:
    """Refuse an empty word: it would mean every log below the working folder."""
    if "" in words:
        raise click.BadParameter("the name is empty; give a file, a folder or a glob among LOGS, or 'posture'")
    return words


def suspect_option(function: Decorated) -> Decorated:
    """``--suspect COLUMN``, any number of times, as `suspect`: tuple of str."""
    told = "A column of the logs that may be the cause (supply voltage, oil temperature ...); repeatable."
    return click.option("--suspect", multiple=True, metavar="COLUMN", help=told)(function)


def effects_option(function: Decorated) -> Decorated:
    """``--effects FILE.py``, any number of times: in the catalogue before the command begins, so no value arrives."""
    told = "A file that holds an effect of your own; it is run, so name only files that you trust. Repeatable."
    kind = click.Path(path_type=Path)
    return click.option(
        "--effects",
        type=kind,
        multiple=True,
        metavar="FILE.py",
        help=told,
        callback=_include,
        expose_value=False,
    )(function)


def _include(context: click.Context, option: click.Parameter, paths: tuple[Path, ...]) -> None:
    if paths:
        context.meta["pumaid.effects"] = paths
        from pumaid.effects import include

        for path in paths:
            include(path)
