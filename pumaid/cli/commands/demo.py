"""``pumaid demo``: the whole story on a virtual arm that hides something."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rich_click as click

from pumaid.cli.options import json_option, seed_option
from pumaid.cli.output import document, say
from pumaid.cli.progress import progress


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("pumaid_demo"), metavar="[FOLDER]")
@click.option("--robot", default="puma560", show_default=True, metavar="NAME", help="The arm; pumaid init lists them.")
@click.option("--effect", metavar="NAME", help="Hide this effect instead of one by chance; joint and size stay open.")
@click.option("--clean", is_flag=True, help="Hide nothing: a good diagnosis leaves such an arm alone.")
@seed_option
@json_option
def command(*, folder: Path, robot: str, effect: str | None, clean: bool, seed: int, as_json: bool) -> None:
    """Tell the whole story on a virtual arm that hides a physical effect, in under a minute.

    Makes an experiment in FOLDER, runs the commands that a user would type there, and says of each what it showed. The
    effect, its joint and its size are drawn from the seed and lie sealed in logs/truth.json, which no command opens;
    at the end the demo does, and says whether diagnosis was right. Every line can be typed again (here they were run
    with --json).

    FOLDER is pumaid_demo where not given; an earlier demo in it is replaced, anything else is left as it is.

    \b
    Example:
      pumaid demo
      pumaid demo my_demo --seed 7
      pumaid demo --effect ripple --seed 2
      pumaid demo --clean --robot ur5e
    """
    from pumaid.cli import demo
    from pumaid.io.write import write_file
    from pumaid.results.documents import as_text

    if clean and effect is not None:
        raise click.UsageError("--clean hides nothing, --effect something: give one of them.")
    demo.check(robot, effect, seed=seed)
    demo.make_room(folder)
    steps: list[demo.Told] = []
    with ExitStack() as ending:
        ending.callback(demo.mark, folder)  # what was made before a demo was ended is the demo's, too
        step = ending.enter_context(progress("demo"))
        for told in demo.story(folder, robot=robot, seed=seed, surprise=None if clean else effect or "any"):
            steps.append(told)
            step(len(steps), told.step.line)
            if not as_json:
                say(f"$ {told.step.line}\n  {told.sentence}\n")
    hidden = demo.secret(folder)
    diagnosed = next(told.step.answer for told in steps if told.step.answer["kind"] == "diagnosis")
    word, sentence = demo.verdict(hidden, diagnosed)
    if not as_json:
        say(f"What was hidden: {_opened(hidden)}.\n{sentence}")
    content: dict[str, Any] = {
        "kind": "demo",
        "format": 1,
        "folder": str(folder),
        "seed": seed,
        "steps": [{"command": t.step.line, "told": t.sentence, "seconds": t.step.seconds} for t in steps],
        "hidden": hidden,
        "findings": diagnosed["findings"],
        "outcome": word,
        "told": sentence,
        "made": demo.made(folder),
    }
    write_file(folder / demo.MARK, as_text(content, ascii_only=True))
    if as_json:
        document(content)


def _opened(hidden: list[dict[str, Any]]) -> str:
    """The secret in words."""
    from pumaid.cli.demo import place
    from pumaid.units import number

    told = [
        f"{place(one)} with {', '.join(f'{key} = {number(value, 3)}' for key, value in one['values'].items())}"
        for one in hidden
    ]
    return "; ".join(told) or "nothing"
