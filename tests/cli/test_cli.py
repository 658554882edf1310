"""The command line as a user meets it: help, exit codes, pipes, start-up."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from command import run

import pumaid
from pumaid.cli import ORDER_OF_WORK, group, output
from pumaid.cli.output import progress
from pumaid.errors import Note, Where

COMMANDS = group.list_commands(None)


def shell(script: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a line as a user's shell does."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    line = ["bash", "-c", script]
    return subprocess.run(
        line, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False
    )


def raising(error: BaseException):
    """A function that raises `error`."""

    def fail(*_: object) -> None:
        raise error

    return fail


def test_version():
    """``--version`` tells name and version, also as ``python -m pumaid``."""
    done = subprocess.run([sys.executable, "-m", "pumaid", "--version"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"pumaid {pumaid.__version__}\n")


def test_help_lists_commands_in_order_of_work():
    """The group's help names every command, in the order in which one uses them."""
    shown = run("--help").stdout
    assert ORDER_OF_WORK.split() == COMMANDS
    places = [shown.index(f"│ {name} ") for name in COMMANDS]
    assert places == sorted(places)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_fits_a_screen_and_explains(name):
    """Forty lines of a hundred columns hold a line to paste, on a line of its own, and a word on every option."""
    pasted = [line.strip() for line in run(name, "--help", env={"COLUMNS": "100"}).stdout.splitlines()]
    options = [option for option in group.get_command(None, name).params if option.param_type_name == "option"]
    assert len(pasted) <= 40 and [option.name for option in options if not option.help] == []
    assert "Example:" in pasted
    assert any(line.startswith(f"pumaid {name}") for line in pasted[pasted.index("Example:") :])


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (
            PermissionError(13, "Permission denied", "secret.csv"),
            3,
            "error[file-not-readable]: the system says: ",
        ),
        (MemoryError("Unable to allocate 9.50 MiB"), 3, "error[no-memory]: "),
        (ImportError("libarrow.so: failed to map segment from shared object"), 3, "error[no-memory]: "),
        (ZeroDivisionError("by 0"), 4, "bug: pumaid failed with ZeroDivisionError"),
        (KeyboardInterrupt(), 130, "stopped;"),
    ],
)
def test_failures_have_their_code(monkeypatch, error, code, words):
    """What the system refuses is bad input, Ctrl-C one clean line; our own failure says that it is ours, and where."""
    monkeypatch.setattr("pumaid.effects.catalogue", raising(error))
    told = CliRunner().invoke(group, ["effects"])
    assert told.exit_code == code and words in told.stderr
    assert ("Traceback" in told.stderr) == (code == 4) == (f"pumaid {pumaid.__version__}, Python" in told.stderr)


def test_closed_pipe_is_quiet():
    """A reader that leaves early hears nothing more from pumaid."""
    done = shell("pumaid effects --json | true; echo ${PIPESTATUS[0]}")
    assert (done.stdout, done.stderr) == ("141\n", "")


def test_tables_in_a_pipe_are_at_most_100_characters_wide(capsys):
    """A wide table is split where there is no terminal; nothing of it is lost."""
    from pumaid.reporting.table import Table

    output.show(Table("", [f"column {n}" for n in range(30)], [[str(n) * 8 for n in range(10, 40)]]))
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line.rstrip()) for line in lines) <= 100
    assert all(str(n) * 8 in " ".join(lines) for n in range(10, 40))


def test_notes_go_to_standard_error_once(capsys):
    """A note that two steps make is told once, and not among the results."""
    note = Note("few-runs", "joint 2 has 1 run", Where(joint=2))
    output.notes([note, note])
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", "note[few-runs]: joint 2 has 1 run (joint 2)\n")


def test_progress_is_quiet_without_a_terminal(capsys):
    """Nothing is drawn where standard error is a file or a pipe."""
    with progress("working", total=2) as step:
        step(1, "half")
    assert capsys.readouterr().err == ""


def test_terminal_that_lacks_letters():
    """A terminal of another encoding shows replacements rather than a failure."""
    done = shell("PYTHONUTF8=0 PYTHONIOENCODING=ascii LC_ALL=C pumaid --help")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("kind", ["bash", "zsh", "fish"])
def test_shell_completion(kind):
    """The completion script that the README tells to load can be made."""
    assert "pumaid" in shell(f"_PUMAID_COMPLETE={kind}_source pumaid").stdout
