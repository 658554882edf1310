"""The command line: a group that finds its commands by looking into ``commands/``."""

import importlib
import inspect
import os
import pkgutil
import sys
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NoReturn

import rich_click as click
from click.exceptions import Exit

from pumaid import __version__
from pumaid.cli.failures import reported
from pumaid.errors import EXIT_ATTENTION, meant

click.rich_click.TEXT_PARAGRAPH_LINEBREAKS = "\n\n"
click.rich_click.STYLE_HELPTEXT = ""
click.rich_click.PADDING_HELPTEXT_FIRST_LINE = (0, 0, 1, 0)
click.rich_click.MAX_WIDTH = 100

# Matrices here are small: threads of the linear algebra library would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Arrow's own allocator fetches hundreds of megabytes of fresh pages for a short pass; the C library's are used again.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

#: Order in which help lists the commands: the order of work. Commands not named here follow, by name.
ORDER_OF_WORK = "demo init plan simulate segment identify compare diagnose report history export effects doctor"


class Commands(click.RichGroup):
    """A group whose commands are the modules of ``pumaid.cli.commands``, imported when they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        folder = str(Path(__file__).with_name("commands"))
        names = [module.name.replace("_", "-") for module in pkgutil.iter_modules([folder])]
        rank = {name: place for place, name in enumerate(ORDER_OF_WORK.split())}
        return sorted(names, key=lambda name: (rank.get(name, len(rank)), name))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.list_commands(ctx):
            return None
        module = importlib.import_module(f"pumaid.cli.commands.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        command.name = cmd_name
        # rich-click takes the indentation from an example that is all of the help's body; a blank before it keeps it.
        text = inspect.cleandoc(command.help or "")
        command.help = text.replace("\b\nExample", "\b\n \nExample") if text.count("\n\n") == 1 else text
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        names = self.list_commands(ctx)
        if args and args[0] not in names and not args[0].startswith("-"):
            raise click.UsageError(f"There is no command {args[0]}: {meant(args[0], names)}", ctx)
        return super().resolve_command(ctx, args)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        with reported():  # --help and --version print here
            return super().make_context(info_name, args, parent, **extra)

    def invoke(self, ctx: click.Context) -> None:
        with reported():
            if super().invoke(ctx):  # commands tell whether something asks for attention
                raise Exit(EXIT_ATTENTION)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "show_default": True})
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


def main(args: list[str] | None = None) -> NoReturn:
    """Run the command line and leave with its exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a letter shows ? rather than our failure
    group.main(args=args, prog_name="pumaid")
    sys.exit(0)
