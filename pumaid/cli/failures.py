"""What a failure looks like to the user: one place for messages on standard error and exit codes."""

import os
import platform
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import rich_click as click
from click.exceptions import Exit

from pumaid import __version__
from pumaid.cli.output import effect_files
from pumaid.errors import EXIT_BAD_INPUT, EXIT_BUG, ModelError, PumaidError, ResultError, Where, visible

#: Exit codes of a program that a signal ended, as shells count them.
EXIT_INTERRUPTED, EXIT_PIPE_CLOSED = 128 + 2, 128 + 13


@contextmanager
def reported() -> Iterator[None]:
    """Turn what goes wrong inside into a message on standard error and the exit code that interfaces fix."""
    try:
        try:
            yield
        except Exit:
            sys.stdout.flush()
            raise
        sys.stdout.flush()
    except (Exit, click.ClickException, click.Abort):
        raise
    except BrokenPipeError:
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
        click.echo(_bug(error) if refusal is None else words, err=True)
        raise Exit(EXIT_BUG if refusal is None else EXIT_BAD_INPUT) from None


def _refusal(error: Exception) -> PumaidError | None:
    """What is bad input, or of the system's or of a user's effect's making; None for a bug of ours."""
    if isinstance(error, PumaidError):
        return error
    if isinstance(error, OSError):
        name = None if error.filename is None else str(error.filename)
        mend = "check that the file exists, that its folder may be written and that the disk is not full"
        return ResultError("file-refused", f"the system says: {error.strerror or error}", Where(file=name), mend)
    words = str(error)
    is_unmapped = isinstance(error, ImportError) and ("failed to map" in words or "annot allocate memory" in words)
    if isinstance(error, MemoryError) or is_unmapped:
        what = f"the system has no more memory for pumaid: {words or 'it did not say how much was asked for'}"
        mend = "end other programs, raise the limit (ulimit -v), or give --jobs 1: one process holds less than two"
        return ResultError("no-memory", what, mend=mend)
    named = {str(path.resolve()) for path in effect_files()}
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in named]
    if not frames:
        return None
    frame = frames[-1]
    what = f"the effect fails on this robot: {frame.name}() raises {type(error).__name__}: {words}"
    mend = "mend the effect; docs/contributing.md says what it must keep on every robot and every run"
    return ModelError("effect-contract", what, Where(file=frame.filename, row=frame.lineno), mend)


def _bug(error: Exception) -> str:
    return f"""{"".join(traceback.format_exception(error)).rstrip()}
bug: pumaid failed with {type(error).__name__}, which is its fault and not yours
  at: pumaid {__version__}, Python {platform.python_version()}, {platform.platform()}
  fix: report the lines above with the command that you typed and what 'pumaid doctor' prints"""
