"""``pumaid demo``: the whole story on a virtual arm that hides something."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import shlex
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, progress, say
from pumaid.errors import ResultError, Where
from pumaid.units import number

#: The robot's minutes a joint and Hz of its log: enough to find an effect, little enough for a minute of the user's.
MINUTES, RATE = 20 / 6, 50
#: Effects that are hidden by turns; any joint can have them.
KINDS = ("stribeck", "ripple", "friction_step", "position_friction", "warmup")

Document = Mapping[str, Any]


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("pumaid_demo"), metavar="[FOLDER]")
@click.option("--robot", default="puma560", show_default=True, metavar="NAME", help="The arm; pumaid init lists them.")
@options.seed_option
@options.json_option
def command(*, folder: Path, robot: str, seed: int, as_json: bool) -> None:
    """Tell the whole story on a virtual arm that hides a physical effect, in under a minute.

    Makes an experiment in FOLDER (pumaid_demo where not given), runs the commands that a user would type there, and
    says of each what it showed. The effect and its joint follow from the seed; no command but simulate is told. At the
    end the demo says whether diagnosis was right. Every line can be typed again (here they were run with --json).

    \b
    Example:
      pumaid demo
      pumaid demo my_demo --seed 7
    """
    from pumaid.io.write import write_file
    from pumaid.results.documents import as_text

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = f"{folder} is there already and is not empty"
        raise ResultError("demo-in-the-way", what, Where(file=str(folder)), "name another folder: pumaid demo FOLDER")
    steps: list[DemoStep] = []
    with progress("demo") as step:
        for done in story(folder, robot=robot, seed=seed):
            steps.append(done)
            step(len(steps), done.line)
            if not as_json:
                say(f"$ {done.line}\n  {summary(done.answer)}\n")
    (secret,) = json.loads((folder / "logs" / "truth.json").read_text(encoding="utf-8"))["hidden"]
    diagnosis = next(done.answer for done in steps if done.answer["kind"] == "diagnosis")
    outcome, sentence = verdict(secret, diagnosis)
    if not as_json:
        say(f"What was hidden: {place(secret)}.\n{sentence}")
    content: dict[str, Any] = {
        "kind": "demo",
        "format": 1,
        "folder": str(folder),
        "seed": seed,
        "steps": [{"command": done.line, "told": summary(done.answer), "seconds": done.seconds} for done in steps],
        "hidden": [secret],
        "findings": diagnosis["findings"],
        "outcome": outcome,
        "told": sentence,
    }
    write_file(folder / "demo.json", as_text(content, ascii_only=True))
    if as_json:
        document(content)


@dataclass(frozen=True, slots=True)
class DemoStep:
    """A command that was run: its line, what it printed with ``--json``, and s that it took."""

    line: str
    answer: dict[str, Any]
    seconds: float


def story(folder: Path, *, robot: str, seed: int) -> Iterator[DemoStep]:
    """Run the commands in a new experiment one after the other; what a step shows decides what the next ones are.

    `robot` is the name of a shipped recipe, `seed` that of the plan, of the robot and of its secret. No command opens
    ``logs/truth.json``, in which the secret lies.
    """
    recipe, logs, model = (str(folder / name) for name in ("recipe.yaml", "logs", "results/model.json"))
    arm = run("init", robot, "-o", recipe)
    yield arm
    joints, numbered = arm.answer["joints"], ["--seed", str(seed)]
    yield run("plan", recipe, "--minutes", str(round(MINUTES * joints)), *numbered)
    yield run("simulate", recipe, "--hide", hidden(seed=seed, joints=joints), *numbered, "--rate", str(RATE))
    yield run("identify", logs)
    yield run("compare", model, logs)
    diagnosis = run("diagnose", model, logs)
    yield diagnosis
    wanted = additions(diagnosis.answer)
    if wanted:
        yield run("identify", logs, *(word for spec in wanted for word in ("--add", spec)))
        yield run("diagnose", model, logs)
    yield run("history", str(folder))
    yield run("report", model, logs, "--format=")


def hidden(*, seed: int, joints: int) -> str:
    """The effect that a demo hides, as ``--hide`` reads it."""
    return f"{KINDS[seed % len(KINDS)]}@{1 + seed * 7 // len(KINDS) % joints}"


def run(*words: str) -> DemoStep:
    """Run ``pumaid`` with some words and ``--json``, in this process; ResultError [step-failed] where it fails."""
    from pumaid.cli import group
    from pumaid.cli.failures import EXIT_INTERRUPTED

    line = shlex.join(["pumaid", *words])
    out, err, start = io.StringIO(), io.StringIO(), time.monotonic()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = group.main([*words, "--json"], prog_name="pumaid", standalone_mode=False)
        except click.Abort:
            code = EXIT_INTERRUPTED
    if code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    if code:
        lines = err.getvalue().strip().splitlines()
        first = next((text for text in lines if text.startswith("error[")), lines[-1] if lines else "")
        what = f"'{line}' left with exit code {code}: {first}"
        raise ResultError("step-failed", what, Where(), "run the line yourself to see all that it says")
    return DemoStep(line, json.loads(out.getvalue()), time.monotonic() - start)


def findings(answer: Document) -> list[Document]:
    """What a diagnosis says should be added, strongest first."""
    return [finding for finding in answer["findings"] if finding["verdict"] == "add"]


def additions(answer: Document) -> list[str]:
    """Words for ``identify --add``, as the findings' own commands have them."""
    words = [shlex.split(finding.get("command") or "") for finding in findings(answer)]
    return list(dict.fromkeys(word for line in words for before, word in itertools.pairwise(line) if before == "--add"))


def place(entry: Document) -> str:
    """``stribeck@3``, or the effect alone where it is the whole arm's."""
    return str(entry["effect"]) + ("" if entry.get("joint") is None else f"@{entry['joint']}")


def summary(answer: Document) -> str:
    """What a command's document shows, in a sentence."""
    from pumaid.reporting.formatting import amperes

    match answer["kind"]:
        case "plan":
            return f"{len(answer['runs'])} runs in {number(answer['duration'] / 60.0, 3)} minutes of the robot's time."
        case "model":
            count = sum(len(joint["parameters"]) for joint in answer["joints"])
            return f"{count} parameters: {', '.join(['gravity', 'friction', *map(place, answer['effects'])])}."
        case "comparison":
            return f"RMSE over all runs: {amperes(answer['rmse'])}."
        case "diagnosis":
            return _diagnosed(answer)
        case "history":
            models = answer["ladders"][0]["models"]
            errors = [amperes(model.get("heldout") or model.get("rmse")) for model in models]
            return f"RMSE: {' -> '.join(errors)}; noise floor: {amperes(models[-1].get('noise_floor'))}."
        case kind:
            return f"The {kind} is written."


def _diagnosed(answer: Document) -> str:
    missing = [
        place(finding) + (f" (not separated from {' or '.join(finding['rivals'])})" if finding.get("rivals") else "")
        for finding in findings(answer)
    ]
    if missing:
        return f"Missing: {'; '.join(missing)}."
    unexplained = [str(joint["joint"]) for joint in answer["joints"] if joint["verdict"] == "unexplained"]
    if unexplained:
        return f"Something is missing at joint {', '.join(unexplained)} that no known effect explains."
    return "Nothing is missing that these data can show."


def verdict(secret: Document, answer: Document) -> tuple[str, str]:
    """Whether the document `answer` of a diagnosis is right about `secret`, an entry of ``truth.json``'s ``hidden``.

    The word is ``named``, ``in the set``, ``wrong`` or ``missed``; the sentence says the same for people.
    """
    names, true = [place(finding) for finding in findings(answer)], place(secret)
    if true in names:
        false = ", ".join(name for name in names if name != true)
        return "named", f"Right: diagnosis named {true}{f'; but it named {false} as well' if false else ''}."
    for finding in findings(answer):
        rivals = [place({"effect": rival, "joint": finding["joint"]}) for rival in finding.get("rivals") or ()]
        if true in (*rivals, *(finding.get("rivals") or ())):
            return "in the set", f"In the set: these data do not separate {place(finding)} from {true}."
    if names:
        return "wrong", f"Wrong: it is {true}, and diagnosis named {', '.join(names)}."
    return "missed", f"Missed: {true} was hidden. {_diagnosed(answer)}"
