"""``pumaid demo``: the whole story on a virtual arm that hides something."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli import options
from pumaid.cli.output import document, say
from pumaid.cli.progress import progress


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
    from pumaid.cli import demo
    from pumaid.errors import ResultError, Where
    from pumaid.io.write import write_file
    from pumaid.results.documents import as_text

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        what = f"{folder} is there already and is not empty"
        raise ResultError("demo-in-the-way", what, Where(file=str(folder)), "name another folder: pumaid demo FOLDER")
    steps: list[demo.DemoStep] = []
    with progress("demo") as step:
        for done in demo.story(folder, robot=robot, seed=seed):
            steps.append(done)
            step(len(steps), done.line)
            if not as_json:
                say(f"$ {done.line}\n  {done.sentence}\n")
    (hidden,) = json.loads((folder / "logs" / "truth.json").read_text(encoding="utf-8"))["hidden"]
    diagnosed = next(done.answer for done in steps if done.answer["kind"] == "diagnosis")
    outcome, sentence = demo.verdict(hidden, diagnosed)
    if not as_json:
        say(f"What was hidden: {demo.place(hidden)}.\n{sentence}")
    content: dict[str, Any] = {
        "kind": "demo",
        "format": 1,
        "folder": str(folder),
        "seed": seed,
        "steps": [{"command": done.line, "told": done.sentence, "seconds": done.seconds} for done in steps],
        "hidden": [hidden],
        "findings": diagnosed["findings"],
        "outcome": outcome,
        "told": sentence,
    }
    write_file(folder / "demo.json", as_text(content, ascii_only=True))
    if as_json:
        document(content)
