"""A command line, as a user types it."""

from __future__ import annotations

from click.testing import CliRunner, Result

from pumaid.cli import group


def run(*words: str, code: int = 0) -> Result:
    """A command line that ends with `code`."""
    found = CliRunner().invoke(group, list(words), prog_name="pumaid")
    assert found.exit_code == code, found.output
    return found
