"""A command line, as a user types it."""

import json
from typing import Any

from click.testing import CliRunner, Result

from pumaid.cli import group


def run(*words: object, code: int = 0, **more: Any) -> Result:
    """A command line that ends with `code`; Traceback, if any, is never the answer."""
    found = CliRunner().invoke(group, [str(word) for word in words], prog_name="pumaid", **more)
    assert found.exit_code == code, found.output
    assert "Traceback" not in found.stderr
    return found


def answer(line: str, **more: Any) -> dict[str, Any]:
    """The document that a line prints with ``--json``."""
    return json.loads(run(*line.split(), "--json", **more).stdout)
