"""``pumaid demo``: the whole story on a virtual arm that hides something."""

from __future__ import annotations

import contextlib
import io
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, progress, say
from pumaid.errors import ResultError, Where

if TYPE_CHECKING:
    from pumaid.diagnosis.records import Finding

#: The robot's minutes a joint and Hz of its log: enough to find an effect, little enough for a minute of the user's.
MINUTES, RATE = 20 / 6, 50
#: Effects that are hidden by turns; any joint can have them.
KINDS = ("stribeck", "ripple", "friction_step", "position_friction", "warmup")


@click.command()
@click.argument("folder", type=options.FILE, default=Path("pumaid_demo"), metavar="[FOLDER]")
@click.option("--robot", default="puma560", metavar="NAME", help="The arm; pumaid init lists them.")
@options.seed_option
@options.json_option
def command(*, folder: Path, robot: str, seed: int, as_json: bool) -> None:
    """Tell the whole story on a virtual arm that hides a physical effect, in under a minute.

    Makes an experiment in FOLDER (pumaid_demo where not given), runs the commands that a user would type there, and
    shows what they print. The effect and its joint follow from the seed; no command but simulate is told. At the end
    the demo says whether diagnosis was right.

    \b
    Example:
      pumaid demo
      pumaid demo my_demo --seed 7
    """
    from pumaid.io.write import write_file
    from pumaid.results.documents import as_text, heading

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = f"{folder} is there already and is not empty"
        raise ResultError("demo-in-the-way", what, Where(file=str(folder)), "name another folder: pumaid demo FOLDER")
    steps: list[dict[str, Any]] = []
    with progress("demo") as step:
        for done in story(folder, robot=robot, seed=seed):
            steps.append(done)
            step(len(steps), done["command"])
            if not as_json:
                say(f"$ {done['command']}\n{done['told']}")
    secret, outcome, sentence = judged(folder)
    if not as_json:
        say(f"What was hidden: {secret}. {sentence}")
    answer = heading("demo") | {"folder": str(folder), "seed": seed, "steps": steps}
    answer |= {"hidden": secret, "outcome": outcome, "told": sentence}
    write_file(folder / "demo.json", as_text(answer, ascii_only=True))
    if as_json:
        document(answer)


def story(folder: Path, *, robot: str, seed: int) -> Iterator[dict[str, Any]]:
    """Run the commands in a new experiment one after the other.

    `robot` is the name of a shipped recipe, `seed` that of the plan, of the robot and of its secret. No command opens
    ``logs/truth.json``, in which the secret lies.
    """
    from pumaid.io.recipe import read_recipe

    recipe, logs, model = (str(folder / name) for name in ("recipe.yaml", "logs", "results/model.json"))
    yield run("init", robot, "-o", recipe)
    joints, numbered = read_recipe(Path(recipe)).n_joints, ["--seed", str(seed)]
    secret = f"{KINDS[seed % len(KINDS)]}@{1 + seed * 7 // len(KINDS) % joints}"
    yield run("plan", recipe, "--minutes", str(round(MINUTES * joints)), *numbered)
    yield run("simulate", recipe, "--hide", secret, *numbered, "--rate", str(RATE))
    yield run("identify", logs)
    yield run("compare", model, logs)
    yield run("diagnose", model, logs, "--apply")
    yield run("report", model, logs, "--format=")


def run(*words: str) -> dict[str, Any]:
    """Run ``pumaid`` with some words, in this process; ResultError [step-failed] where it fails.

    The line that was run, what it printed, and the time (s) that it took.
    """
    from pumaid.cli import group
    from pumaid.cli.failures import EXIT_INTERRUPTED

    line = shlex.join(["pumaid", *words])
    out, err, start = io.StringIO(), io.StringIO(), time.monotonic()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = group.main([*words], prog_name="pumaid", standalone_mode=False)
    if code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt
    lines = err.getvalue().strip().splitlines()
    if code:
        first = next((text for text in lines if text.startswith("error[")), lines[-1] if lines else "")
        what = f"'{line}' left with exit code {code}: {first}"
        raise ResultError("step-failed", what, Where(), "run the line yourself to see all that it says")
    printed = out.getvalue() or f"{lines[-1]}\n"
    return {"command": line, "told": printed, "seconds": time.monotonic() - start}


def judged(folder: Path) -> tuple[str, str, str]:
    """What a demo's robot hides, such as ``stribeck@3``, and the `verdict` on what diagnosis found, added or not."""
    from pumaid.diagnosis.records import ADD, read_diagnosis
    from pumaid.io.write import read_truth

    (secret,) = read_truth(folder / "logs" / "truth.json")["hidden"]
    name, diagnosis = f"{secret['effect']}@{secret['joint']}", read_diagnosis(folder / "results" / "diagnosis.json")
    new = [finding for finding in diagnosis.findings if finding.verdict == ADD]
    return name, *verdict(name, (*diagnosis.applied, *new))


def verdict(secret: str, named: tuple[Finding, ...]) -> tuple[str, str]:
    """Whether what diagnosis named is right about what was hidden, such as ``stribeck@3``.

    The word is ``named``, ``in the set``, ``wrong`` or ``missed``; the sentence says the same for people.
    """
    names = [finding.effect if finding.joint is None else f"{finding.effect}@{finding.joint}" for finding in named]
    false = ", ".join(name for name in names if name != secret)
    rivals = {f"{rival}@{item.joint}": name for item, name in zip(named, names, strict=True) for rival in item.rivals}
    if secret in names:
        return "named", f"Right: diagnosis named {secret}{f'; but it named {false} as well' if false else ''}."
    if secret in rivals:
        return "in the set", f"In the set: these data do not separate {rivals[secret]} from {secret}."
    if names:
        return "wrong", f"Wrong: it is {secret}, and diagnosis named {false}."
    return "missed", f"Missed: {secret} was hidden, and diagnosis named nothing."
