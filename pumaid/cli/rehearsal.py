"""Commands run inside another one: typed as a user would type them, their answer read as a document."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import time
from dataclasses import dataclass
from typing import Any

import rich_click as click

from pumaid.errors import ResultError, Where


@dataclass(frozen=True, slots=True)
class Step:
    """A command line that was run: the line, its ``--json`` document, what it said beside it, and s that it took."""

    line: str
    answer: dict[str, Any]
    said: str
    seconds: float


def run(words: list[str]) -> Step:
    """Run ``pumaid`` with some words and ``--json``, in this process.

    Parameters
    ----------
    words
        The command and its arguments, without ``pumaid`` and ``--json``.

    Raises
    ------
    ResultError [step-failed]
        The command left with another exit code than 0, or printed no document.
    KeyboardInterrupt
        Ctrl-C ended the command: whoever runs it is to end, too.
    """
    from pumaid.cli import group
    from pumaid.cli.failures import EXIT_INTERRUPTED

    line = shlex.join(["pumaid", *words])
    out, said, start = io.StringIO(), io.StringIO(), time.monotonic()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        try:
            code = group.main([*words, "--json"], prog_name="pumaid", standalone_mode=False)
        except click.ClickException as error:
            raise _failed(line, f"was not understood: {error.format_message()}", "") from error
        except click.Abort:
            raise KeyboardInterrupt from None
    if code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    if code:
        raise _failed(line, f"left with exit code {code}", said.getvalue())
    try:
        answer = json.loads(out.getvalue())
    except ValueError as error:
        raise _failed(line, "printed no JSON document", said.getvalue()) from error
    return Step(line, answer, said.getvalue(), time.monotonic() - start)


def _failed(line: str, what: str, said: str) -> ResultError:
    # The first error is the one to mend; of a bug the exception stands on the line before.
    lines = said.strip().splitlines()
    first = next((k for k, text in enumerate(lines) if text.startswith("error[")), None)
    if first is None:
        first = next((k - 1 for k, text in enumerate(lines) if text.startswith("bug:")), len(lines) - 1)
    told = f": {lines[first].strip()}" if lines else ""
    return ResultError(
        "step-failed", f"'{line}' {what}{told}", Where(), "run the line yourself to see all that it says"
    )
