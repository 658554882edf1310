"""What a failure looks like to the user: one place for messages on standard error and exit codes."""

from __future__ import annotations

import os
import platform
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import rich_click as click
from click.exceptions import Exit

from pumaid import __version__
from pumaid.errors import EXIT_BAD_INPUT, EXIT_BUG, PumaidError, ResultError, Where

#: Exit codes of a program that a signal ended, as shells count them.
EXIT_INTERRUPTED, EXIT_PIPE_CLOSED = 128 + 2, 128 + 13

#: Bytes of address space below which numerical libraries, while they are loaded, wait for ever or abort.
_LEAST_SPACE = 512 << 20
#: What the system's loader says where a library finds no memory.
_NOT_LOADED = ("failed to map segment", "annot allocate memory")


@contextmanager
def told() -> Iterator[None]:
    """Turn what goes wrong inside into a message on standard error and the exit code that interfaces fix."""
    try:
        with _flushed():
            yield
    except (Exit, click.ClickException, click.Abort):
        raise
    except PumaidError as error:
        _leave(EXIT_BAD_INPUT, _coloured(str(error)))
    except BrokenPipeError:
        _silence_stdout()
        raise Exit(EXIT_PIPE_CLOSED) from None
    except KeyboardInterrupt:
        _leave(EXIT_INTERRUPTED, "\nstopped; files that were being written are as they were before")
    except OSError as error:
        _leave(EXIT_BAD_INPUT, _coloured(str(_refused(error))))
    except MemoryError as error:
        _leave(EXIT_BAD_INPUT, _coloured(str(_no_memory(error))))
    except Exception as error:
        if isinstance(error, ImportError) and any(words in str(error) for words in _NOT_LOADED):
            _leave(EXIT_BAD_INPUT, _coloured(str(_no_memory(error))))
        _leave(EXIT_BUG, _report(error))


@contextmanager
def _flushed() -> Iterator[None]:
    """What was said is out when the block ends, also where it ends early, as ``--help`` and ``--check`` do."""
    try:
        yield
    except Exit:
        sys.stdout.flush()
        raise
    sys.stdout.flush()


def check_space() -> None:
    """Look whether the libraries can be loaded under the system's limit of address space.

    Raises
    ------
    ResultError [no-memory]
        The limit is too low.
    """
    if sys.platform == "win32":
        return
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < _LEAST_SPACE:
        told = f"{limit >> 20} MiB of address space (ulimit -v) are too few to load numpy, scipy and pyarrow"
        raise ResultError("no-memory", told, mend=f"raise the limit to {2 * _LEAST_SPACE >> 20} MiB or more")


def _leave(code: int, message: str) -> None:
    click.echo(message, err=True)
    raise Exit(code) from None


def _coloured(message: str) -> str:
    """The words ``error[slug]`` in red; click strips the colour where standard error is no terminal."""
    from pumaid.reporting.visible import visible

    message = visible(message)
    head, found, rest = message.partition("]: ")
    return click.style(head + "]", fg="red", bold=True) + ": " + rest if found else message


def _refused(error: OSError) -> ResultError:
    name = None if error.filename is None else str(error.filename)
    mend = "check that the file exists, that its folder may be written and that the disk is not full"
    return ResultError("file-refused", f"the system says: {error.strerror or error}", Where(file=name), mend)


def _no_memory(error: Exception) -> ResultError:
    what = f"the system has no more memory for pumaid: {str(error) or 'it did not say how much was asked for'}"
    mend = "end other programs, raise the limit (ulimit -v), or give --jobs 1: one process holds less than two"
    return ResultError("no-memory", what, mend=mend)


def _report(error: Exception) -> str:
    return "\n".join(
        [
            "".join(traceback.format_exception(error)).rstrip(),
            f"bug: pumaid failed with {type(error).__name__}, which is its fault and not yours",
            f"  at: pumaid {__version__}, Python {platform.python_version()}, {platform.platform()}",
            "  fix: report the lines above with the command that you typed and what 'pumaid doctor' prints",
        ]
    )


def _silence_stdout() -> None:
    """Point standard output at nothing, so that the interpreter's own last flush finds no broken pipe."""
    try:
        descriptor = sys.stdout.fileno()
    except (OSError, ValueError):
        return
    os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
