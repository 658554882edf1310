"""The command line as a user meets it: help, exit codes, pipes, start-up, and documents for other programs."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from command import answer, run, shell
from menus import write_short_plan

import pumaid
from pumaid.cli import ORDER_OF_WORK, group, output
from pumaid.cli.output import progress
from pumaid.errors import Note, Where

COMMANDS = group.list_commands(None)


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
    """Forty lines of eighty columns hold a line to paste, on a line of its own, and a word on every option."""
    pasted = [line.strip() for line in run(name, "--help", env={"COLUMNS": "80"}).stdout.splitlines()]
    options = [option for option in group.get_command(None, name).params if option.param_type_name == "option"]
    assert len(pasted) <= 40 and [option.name for option in options if not option.help] == []
    examples = pasted[pasted.index("Example:") + 1 :]
    assert all(line.startswith("pumaid ") for line in examples[: examples.index("", 1)])


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (PermissionError(13, "Permission denied", "secret.csv"), 3, "error[file-not-readable]: the system says: "),
        (MemoryError("Unable to allocate 9.50 MiB"), 3, "error[no-memory]: "),
        (ImportError("libarrow.so: failed to map segment from shared object"), 3, "error[no-memory]: "),
        (ZeroDivisionError("by 0"), 4, "bug: pumaid failed with ZeroDivisionError"),
        (KeyboardInterrupt(), 130, "stopped;"),
        (RuntimeError("Error calling __set_name__"), 130, "stopped;"),  # what Python 3.11 makes of Ctrl-C there
    ],
)
def test_failures_have_their_code(monkeypatch, error, code, words):
    """What the system refuses is bad input, Ctrl-C one clean line; our own failure says that it is ours, and where."""
    error.__cause__ = KeyboardInterrupt() if isinstance(error, RuntimeError) else None
    monkeypatch.setattr("pumaid.effects.catalogue", raising(error))
    told = CliRunner().invoke(group, ["effects"])
    assert told.exit_code == code and words in told.stderr
    assert ("Traceback" in told.stderr) == (code == 4) == (f"pumaid {pumaid.__version__}, Python" in told.stderr)


def test_closed_pipe_is_quiet():
    """A reader that leaves early hears nothing more from pumaid."""
    done = shell("for form in --json ''; do pumaid effects $form | true; echo ${PIPESTATUS[0]}; done")
    assert (done.stdout, done.stderr) == ("141\n141\n", "")


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


LINES = {
    "init": "init pendulum2 -o new.yaml",
    "plan": "plan recipe.yaml --minutes 5 -o other.yaml",
    "simulate": "simulate recipe.yaml --plan short.yaml -o virtual --rate 20",
    "segment": "segment logs",
    "identify": "identify logs",
    "compare": "compare results/model.json logs",
    "diagnose": "diagnose results/model.json logs",
    "report": "report results/model.json logs --format=",
    "history": "history",
    "export": "export results/model.json --format c -o arm",
    "effects": "effects",
}
SPEAKERS = [
    name for name in group.list_commands(None) if any(o.name == "as_json" for o in group.get_command(None, name).params)
]


def test_every_command_with_json_is_tried():
    assert sorted(set(SPEAKERS) - set(LINES)) == ["demo"]  # test_demo.py runs it


@pytest.mark.parametrize("name", LINES)
def test_one_document_with_its_head(arm, name):
    """Standard output is one JSON object with kind, format, version, and the SHA-256 of recipe and logs if it has any.

    Entries of a comparison that other programs read stand where interfaces.md puts them.
    """
    write_short_plan(arm / "short.yaml")
    document = answer(LINES[name])
    assert isinstance(document["kind"], str) and document["format"] == 1
    assert document["pumaid"] == pumaid.__version__
    if name in ("segment", "identify", "compare"):
        logs = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in Path("logs").iterdir()}
        assert document["logs"] == logs
        assert document["recipe"]["sha256"] == hashlib.sha256((arm / "recipe.yaml").read_bytes()).hexdigest()
    if name == "compare":
        joint = document["joints"][0]
        assert isinstance(document["rmse"], float)
        assert {"joint", "rmse", "noise_floor", "bias", "explained", "runs"} <= set(joint)
        assert {"file", "start", "velocity", "posture", "rmse", "bias"} <= set(joint["runs"][0])
        text = (arm / "results" / "model.json").read_text(encoding="utf-8")
        assert answer("compare - logs", input=text) == document  # the model from a pipe
