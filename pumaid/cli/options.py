"""Arguments and options that several commands share, each written once.

Values arrive under the option's name (``--json`` as ``as_json``); `experiment_options` gathers several as `experiment`.
"""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import rich_click as click

from pumaid.cli.output import counted, remark

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class PathType(click.Path):
    """A path; an empty one, as an unset variable of a script gives, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if str(value) in ("", "="):  # the latter of "-o="
            self.fail("The path is empty.", param, ctx)
        return super().convert(value, param, ctx)


FILE, FILE_OR_PIPE = PathType(path_type=Path), PathType(path_type=Path, allow_dash=True)
EXISTING = PathType(path_type=Path, exists=True, dir_okay=False)
#: Files, folders, globs and URLs, as they were typed.
LOGS = PathType(path_type=str, allow_dash=True)

#: Files, folders, globs, ``-`` for standard input.
logs_argument = click.argument("logs", type=LOGS, nargs=-1, required=True, metavar="LOGS...")
#: A model file, or ``-``.
model_argument = click.argument("model", type=FILE_OR_PIPE, metavar="MODEL")
recipe_option = click.option("--recipe", type=FILE, metavar="FILE", help="The recipe; else by the logs, or here.")
results_option = click.option(
    "--results",
    type=FILE,
    metavar="FOLDER",
    help="Where results go; else by the recipe.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON document, no tables.")
seed_option = click.option("--seed", type=click.IntRange(min=0), default=0, metavar="N", help="Same seed, same result.")
units_option = click.option("--units", type=click.Choice(["rad", "deg"]), default="rad", help="Angle unit of tables.")
check_option = click.option("--check", is_flag=True, help="Exit code 1 if attention is needed.")
force_option = click.option("--force", is_flag=True, help="Replace what is there already.")


def _picture(context: click.Context, option: click.Parameter, path: Path | None) -> Path | None:
    if path is not None and path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise click.BadParameter(f"{path} is no .png, .svg or .pdf", context, option)
    return path


picture_option = click.option(
    "--picture",
    "--figure",
    "picture",
    type=FILE,
    metavar="FILE",
    callback=_picture,
    help="Draw it: .png, .svg or .pdf.",
)


def output_option(text: str) -> Callable[[Decorated], Decorated]:
    """``-o FILE`` as `output`: Path or None; ``-`` is standard output. `text` is its help."""
    return click.option("-o", "--output", type=FILE_OR_PIPE, metavar="FILE", help=text)


def separated(kind: click.ParamType, count: int | None = None) -> Callable[..., tuple[Any, ...] | None]:
    """A click callback that reads words of a kind with commas between, `count` of them where that is given."""

    def read(context: click.Context, option: click.Parameter, text: str | None) -> tuple[Any, ...] | None:
        if text is None:
            return None
        values = tuple(kind.convert(word.strip(), option, context) for word in text.split(",") if word.strip())
        if count not in (None, len(values)):
            raise click.BadParameter(f"{text!r} has {len(values)} numbers, not {count}")
        return values

    return read


heldout_option = click.option(
    "--heldout",
    type=LOGS,
    multiple=True,
    metavar="FILE",
    help="Kept from the fit: logs, whole; repeatable.",
)
#: How logs are read.
READING = (
    click.option("--trust", is_flag=True, help="Take odd logs: refusals become notes."),
    click.option(
        "--cell",
        type=click.FloatRange(0.0, min_open=True),
        metavar="S",
        help="Seconds a cell of any motion lasts.",
    ),
    click.option(
        "--jobs",
        type=click.IntRange(min=0),
        default=0,
        metavar="N",
        help="Processes that read; 0: one a core.",
        show_default=False,
    ),
    click.option(
        "--dask",
        default="",
        show_default=False,
        metavar="ADDRESS",
        help="Dask scheduler whose workers read.",
    ),
)


def _include(context: click.Context, option: click.Parameter, paths: tuple[Path, ...]) -> None:
    if paths:
        context.meta["pumaid.effects"] = paths
        from pumaid.effects import include

        for path in paths:
            include(path)


#: In the catalogue before the command begins, so no value arrives.
effects_option = click.option(
    "--effects",
    type=FILE,
    multiple=True,
    metavar="FILE.py",
    help="Run your own effect's file; repeatable.",
    callback=_include,
    expose_value=False,
)


def together(function: Decorated, *decorators: Callable[[Decorated], Decorated]) -> Decorated:
    """A command with several options, the first of which stands first in its help."""
    for decorate in reversed(decorators):
        function = decorate(function)
    return function


def of_experiment(function: Decorated, *decorators: Callable[[Decorated], Decorated]) -> Decorated:
    """A command with options as in `together`, of which those that tell an experiment arrive as `experiment`."""

    @wraps(function)
    def run(**values: Any) -> Any:
        from pumaid.experiment import Experiment

        names = {"logs", "recipe", "heldout", "results", "trust", "cell", "jobs", "dask"} & set(values)
        asked = {name: values.pop(name) for name in names}
        return function(experiment=Experiment(**asked, tell=remark, progress=counted), **values)

    return together(run, *decorators)  # type: ignore[arg-type, return-value]


def experiment_options(*, has_heldout: bool = True, has_results: bool = True) -> Callable[[Decorated], Decorated]:
    """What tells where an experiment is and how its logs are read, with the argument ``logs`` as `experiment`."""
    choices = [results_option] * has_results + [heldout_option] * has_heldout
    return lambda function: of_experiment(function, recipe_option, *choices, *READING)


def model_on_logs(function: Decorated) -> Decorated:
    """``MODEL LOGS...`` with the options of reading and showing them: what `compare` and `diagnose` are asked alike."""
    reading = (model_argument, logs_argument, effects_option, units_option)
    return together(function, *reading, experiment_options(has_results=False), json_option, check_option)
