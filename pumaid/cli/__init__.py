"""The command line: a group of the commands in ``commands/``, and what a failure looks like to the user."""

import importlib
import inspect
import os
import pkgutil
import platform
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rich_click as click
from click.exceptions import Exit

from pumaid import __version__
from pumaid.cli.output import effect_files
from pumaid.errors import (
    EXIT_ATTENTION,
    EXIT_BAD_INPUT,
    EXIT_BUG,
    ModelError,
    PumaidError,
    ResultError,
    Where,
    visible,
)

# Matrices here are small: threads of the linear algebra library would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Arrow's own allocator fetches hundreds of megabytes of fresh pages for a short pass; the C library's are used again.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

#: Exit codes of a program that a signal ended, as shells count them.
EXIT_INTERRUPTED, EXIT_PIPE_CLOSED = 128 + 2, 128 + 13
#: Order in which help lists the commands: the order of work. Commands not named here follow.
ORDER_OF_WORK = "demo init plan simulate segment identify compare diagnose report history export effects"


class Commands(click.RichGroup):
    """A group that lists its commands in the order of work, and reports what fails."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(self.commands, key=[*ORDER_OF_WORK.split(), *self.commands].index)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        with reported():  # --help and --version print here
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> None:
        with reported():
            if super().invoke(ctx):  # commands tell whether something asks for attention
                raise Exit(EXIT_ATTENTION)


#: How help looks.
HELP = {
    "text_paragraph_linebreaks": "\n\n",
    "style_helptext": "",
    "padding_helptext_first_line": (0, 0, 1, 0),
    "max_width": 100,
    "options_table_column_types": ["required", "opt_long", "opt_short", "metavar_short", "help"],
}


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True, "rich_help_config": HELP},
)
@click.version_option(__version__, prog_name="pumaid", message="%(prog)s %(version)s")
def group() -> None:
    """Learn from logged motions what a robot arm's motor currents are spent on.

    An experiment is a folder with a recipe (recipe.yaml: the robot) and logs (logs/*.csv, *.parquet).
    Commands find what they need there and write what they make to results/.

    \b
    Example:
      pumaid init puma560 -o my_arm/recipe.yaml
      pumaid identify my_arm/logs/
      pumaid report my_arm/results/model.json my_arm/logs/
    """


@contextmanager
def reported() -> Iterator[None]:
    """Turn what goes wrong inside into a message on standard error and the exit code that interfaces fix."""
    try:
        try:
            yield
        except RuntimeError as error:  # Python 3.11 makes one of Ctrl-C while a class is being made
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise error.__cause__ from None
            raise
        finally:
            sys.stdout.flush()
    except (Exit, click.ClickException, click.Abort):
        raise
    except (BrokenPipeError, SystemExit):  # with which rich leaves where the reader has
        # Python's own last flush of standard output must not meet the broken pipe again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise Exit(EXIT_PIPE_CLOSED) from None
    except KeyboardInterrupt:
        click.echo("\nstopped; files that were being written are as they were before", err=True)
        raise Exit(EXIT_INTERRUPTED) from None
    except Exception as error:
        refusal = _refusal(error)
        head, mark, rest = visible(str(refusal)).partition("]: ")
        # click strips the colour where standard error is no terminal
        words = click.style(head + "]", fg="red", bold=True) + ": " + rest if mark else head
        bug = f"""{"".join(traceback.format_exception(error)).rstrip()}
bug: pumaid failed with {type(error).__name__}, which is its fault and not yours
  at: pumaid {__version__}, Python {platform.python_version()}, {platform.platform()}
  fix: report the lines above with the command that you typed and what 'pip list' prints"""
        click.echo(bug if refusal is None else words, err=True)
        raise Exit(EXIT_BUG if refusal is None else EXIT_BAD_INPUT) from None


def _refusal(error: Exception) -> PumaidError | None:
    """What is bad input, or of the system's or of a user's effect's making; None for a bug of ours."""
    if isinstance(error, PumaidError):
        return error
    if isinstance(error, OSError):
        name = None if error.filename is None else str(error.filename)
        return ResultError(
            "file-not-readable",
            f"the system says: {error.strerror or error}",
            Where(file=name),
            "check that the file exists, that its folder may be written and that the disk is not full",
        )
    words = str(error)
    is_unmapped = isinstance(error, ImportError) and ("failed to map" in words or "annot allocate memory" in words)
    if isinstance(error, MemoryError) or is_unmapped:
        return ResultError(
            "no-memory",
            f"the system has no more memory for pumaid: {words or 'it did not say how much was asked for'}",
            mend="end other programs, raise the limit (ulimit -v), or give --jobs 1: one process holds less than two",
        )
    named = {str(path.resolve()) for path in effect_files()}
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in named]
    if not frames:
        return None
    frame = frames[-1]
    return ModelError(
        "effect-contract",
        f"the effect fails on this robot: {frame.name}() raises {type(error).__name__}: {words}",
        Where(file=frame.filename, row=frame.lineno),
        "mend the effect; docs/contributing.md says what it must keep on every robot and every run",
    )


for _info in pkgutil.iter_modules([str(Path(__file__).with_name("commands"))]):
    for _command in vars(importlib.import_module(f"pumaid.cli.commands.{_info.name}")).values():
        if isinstance(_command, click.Command):
            # rich-click takes the indentation from an example that is all of the help's body; a blank keeps it.
            _text = inspect.cleandoc(_command.help or "")
            _command.help = _text.replace("\b\nExample", "\b\n \nExample") if _text.count("\n\n") == 1 else _text
            group.add_command(_command)
