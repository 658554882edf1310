"""The demo's story: which commands follow each other, and what each showed, in a sentence."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import shlex
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.errors import ResultError, Where
from pumaid.units import number

#: The robot's minutes a joint and Hz of its log: enough to find an effect, little enough for a minute of the user's.
MINUTES, RATE = 20 / 6, 50
#: Effects that are hidden by turns; any joint can have them.
KINDS = ("stribeck", "ripple", "friction_step", "position_friction", "warmup")

Document = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class DemoStep:
    """A command that was run: its line, what it printed with ``--json``, s that it took, and what it showed."""

    line: str
    answer: dict[str, Any]
    seconds: float
    sentence: str


def story(folder: Path, *, robot: str, seed: int) -> Iterator[DemoStep]:
    """Run the commands one after the other; what a step shows decides what the next ones are.

    None of them opens ``logs/truth.json``, in which the robot's secret lies.

    Parameters
    ----------
    folder
        The experiment.
    robot
        Name of a shipped recipe.
    seed
        Of the plan, of the robot and of its secret.
    """
    recipe, logs, model = (str(folder / name) for name in ("recipe.yaml", "logs", "results/model.json"))
    arm = run(["init", robot, "-o", recipe], _arm)
    yield arm
    joints, numbered = arm.answer["joints"], ["--seed", str(seed)]
    yield run(["plan", recipe, "--minutes", str(round(MINUTES * joints)), *numbered], _planned)
    secret = hidden(seed=seed, joints=joints)
    yield run(["simulate", recipe, "--hide", secret, *numbered, "--rate", str(RATE)], _simulated)
    yield run(["identify", logs], _identified)
    yield run(["compare", model, logs], _compared)
    diagnosed = run(["diagnose", model, logs], _diagnosed)
    yield diagnosed
    wanted = additions(diagnosed.answer)
    if wanted:
        yield run(["identify", logs, *(word for spec in wanted for word in ("--add", spec))], _identified)
        yield run(["diagnose", model, logs], _diagnosed)
    yield run(["history", str(folder)], _climbed)
    yield run(["report", model, logs, "--format="], lambda answer: "All of it is on one page, report.html.")


def hidden(*, seed: int, joints: int) -> str:
    """The effect that a demo hides, as ``--hide`` reads it."""
    return f"{KINDS[seed % len(KINDS)]}@{1 + seed * 7 // len(KINDS) % joints}"


def run(words: list[str], sentence: Callable[[Document], str] = lambda answer: "") -> DemoStep:
    """Run ``pumaid`` with some words and ``--json``, in this process.

    Parameters
    ----------
    words
        The command and its arguments, without ``pumaid`` and ``--json``.
    sentence
        Says of the document that the command printed what it showed.

    Raises
    ------
    ResultError [step-failed]
        The command left with another exit code than 0.
    KeyboardInterrupt
        Ctrl-C ended the command: whoever runs it is to end, too.
    """
    from pumaid.cli import group
    from pumaid.cli.failures import EXIT_INTERRUPTED

    line = shlex.join(["pumaid", *words])
    out, err, start = io.StringIO(), io.StringIO(), time.monotonic()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = group.main([*words, "--json"], prog_name="pumaid", standalone_mode=False)
        except click.Abort:
            raise KeyboardInterrupt from None
    if code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    if code:
        lines = err.getvalue().strip().splitlines()
        first = next((text for text in lines if text.startswith("error[")), lines[-1] if lines else "")
        what = f"'{line}' left with exit code {code}: {first}"
        raise ResultError("step-failed", what, Where(), "run the line yourself to see all that it says")
    answer = json.loads(out.getvalue())
    return DemoStep(line, answer, time.monotonic() - start, sentence(answer))


def findings(answer: Document) -> list[Document]:
    """What a diagnosis says should be added, strongest first."""
    return [finding for finding in answer["findings"] if finding["verdict"] == "add"]


def additions(answer: Document) -> list[str]:
    """Words for ``identify --add``, as the findings' own commands have them."""
    words = [shlex.split(finding["command"]) for finding in findings(answer) if finding.get("command")]
    named = (word for line in words for before, word in itertools.pairwise(line) if before == "--add")
    return list(dict.fromkeys(named))


def place(entry: Document) -> str:
    """``stribeck@3``, or the effect alone where it is the whole arm's."""
    return str(entry["effect"]) + ("" if entry.get("joint") is None else f"@{entry['joint']}")


def _amperes(value: float | None) -> str:
    return "unknown" if value is None else f"{1e3 * value:.3g} mA"


def _arm(answer: Document) -> str:
    return f"The recipe of a {answer['robot']} with {answer['joints']} joints: geometry and limits, nothing else."


def _planned(answer: Document) -> str:
    minutes = number(answer["duration"] / 60.0, 3)
    return f"{len(answer['runs'])} runs in {minutes} minutes of the robot's time; each joint runs alone."


def _simulated(answer: Document) -> str:
    samples = sum(part["samples"] for part in answer["files"])
    return f"A robot with masses and friction of its own made the runs: {samples:,} samples."


def _identified(answer: Document) -> str:
    added = ", ".join(place(effect) for effect in answer.get("effects", ()))
    count = sum(len(joint["parameters"]) for joint in answer["joints"])
    return f"Weight and friction{f', and {added},' if added else ''} in {count} parameters."


def _compared(answer: Document) -> str:
    joints = [joint for joint in answer["joints"] if joint.get("rmse") and joint.get("noise_floor")]
    above = [str(joint["joint"]) for joint in joints if joint["rmse"] > 1.15 * joint["noise_floor"]]
    where = f"joint{'s' if len(above) > 1 else ''} {', '.join(above)}" if above else "no joint"
    return f"Over all runs the model is off by {_amperes(answer['rmse'])}; clearly more than noise at {where}."


def _diagnosed(answer: Document) -> str:
    if findings(answer):
        return "Missing: " + "; ".join(map(_finding, findings(answer))) + "."
    unexplained = [str(joint["joint"]) for joint in answer["joints"] if joint["verdict"] == "unexplained"]
    if unexplained:
        return f"Something is missing at joint {', '.join(unexplained)} that no known effect explains."
    return "Nothing is missing that these data can show."


def _finding(finding: Document) -> str:
    chance, rivals = finding.get("p_value"), [str(rival) for rival in finding.get("rivals") or ()]
    text = place(finding) + ("" if chance is None else f" (by chance alone: {number(max(chance, 1e-4), 2)})")
    return text + (f", which these data cannot tell from {' or '.join(rivals)}" if rivals else "")


def _climbed(answer: Document) -> str:
    models = answer["ladders"][0]["models"]
    ends = [_amperes(models[place].get("heldout") or models[place].get("rmse")) for place in (0, -1)]
    floor = _amperes(models[-1].get("noise_floor"))
    if len(models) == 1:
        return f"One model, and no reason for another; the noise floor is {floor}."
    return f"The error on runs that no fit saw went from {ends[0]} to {ends[1]}; the noise floor is {floor}."


def verdict(secret: Document, answer: Document) -> tuple[str, str]:
    """Whether a diagnosis was right, in a word and in a sentence.

    Parameters
    ----------
    secret
        What ``truth.json`` says was hidden.
    answer
        The document of the first ``pumaid diagnose``.

    Returns
    -------
    word
        ``named``, ``in the set``, ``wrong`` or ``missed``.
    sentence
        The same for people, with what it named beside.
    """
    named, true = [place(finding) for finding in findings(answer)], place(secret)
    others = ", ".join(name for name in named if name != true)
    if true in named:
        return "named", f"Right: diagnosis named {true}{f'; but it named {others} as well' if others else ''}."
    rivals = {
        rival if "@" in rival else place({"effect": rival, "joint": finding["joint"]}): place(finding)
        for finding in findings(answer)
        for rival in finding.get("rivals") or ()
    }
    alike = rivals.get(true)
    if alike is not None:
        return "in the set", f"In the set: diagnosis named {alike} and said that these data cannot tell it from {true}."
    if named:
        return "wrong", f"Wrong: it is {true}, and diagnosis named {others}."
    return "missed", f"Missed: {true} was hidden. {_diagnosed(answer)}"
