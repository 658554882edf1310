"""Write the generated documents: docs/commands.md, docs/effects.md, and the README's sessions by running them.

``--check`` writes nothing and leaves with 1 where the page of commands or of effects is out of date. Sessions are the
README's ``console`` blocks: each ``$ command`` is run in a scratch copy of the samples, and what it prints stands
below it. The README's pictures are drawn from samples too, one by a session; other versions of the drawing library
draw other bytes, so they are not checked.
"""

import inspect
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from pumaid.cli import group
from pumaid.effects import catalogue
from pumaid.reporting.effects import bounds, facts, merged

ROOT = Path(__file__).parents[1]
COMMANDS, README, PICTURES = ROOT / "docs" / "commands.md", ROOT / "README.md", ROOT / "docs" / "img"
EFFECTS = ROOT / "docs" / "effects.md"
HEAD = """# Commands

Generated from the commands' own help by `make docs`; do not edit.

`LOGS...` is any mix of files, folders and globs; `-` is standard input, or standard output where a file is written.
Tables go to standard output; progress, notes and where files went go to standard error.
"""
HEAD_EFFECTS = """# Effects

Generated from the effects themselves by `make docs`; do not edit.
An effect is linear in its parameters once its shape is given; shapes are searched for, or given.

| name | meaning |
|---|---|
| s | sign of the motion, +1 or -1 |
| q, qd, qdd | the joint's position, velocity, acceleration |
| shaft, v | the velocity that drives its friction (its own unless gears couple it), and the size of that |
| load | gravity's load of the joint by the model fitted so far, A |
| owner, load_owner, friction_owner | the joint that owns the parameters, its load and friction |
| slope_owner, shaft_on | derivative of `load` by its position; `shaft` of joint `on` |
| drawn | the model's whole prediction, A |
| across | gravity's moment across the joint's axis, as the current that it would draw along it |
| tilt_x, tilt_y | the derivative of `load` by a turn of the base about its x and y |
| t, elapsed | time since the joint's, the arm's first motion, s |
| path | what was travelled since the motion began, rad or m |
| temperature | of the motor, degC |
| [condition] | 1 where it holds, else 0 |

Other names are the effect's own parameters and shapes.
Signs are those of [conventions.md](conventions.md); where a motor's current counts against its joint, friction is
negative.
An effect of your own is one file: [contributing.md](contributing.md).

Look-alikes are effects that data may not separate from it; `pumaid diagnose` says whether yours do.
"""
#: Commands from which on an option is explained once for all.
SEVERAL = 3
SESSION = re.compile(r"```console\n(.*?)```", re.DOTALL)


def commands_page() -> str:
    """The manual's page of commands: options of several commands once, then each command with its own."""
    context = click.Context(group, info_name="pumaid")
    commands = {name: command for name in group.list_commands(context) if (command := group.get_command(context, name))}
    uses = Counter(line for command in commands.values() for line in _options(command))
    shared = [line for line, count in uses.items() if count >= SEVERAL]
    sections = [_section(name, command, shared) for name, command in commands.items()]
    return "\n".join([HEAD, "Options of several commands:", "", *shared, "", *sections])


def _options(command: click.Command) -> list[str]:
    """A line for each option of a command."""
    context = click.Context(command)
    records = [option.get_help_record(context) for option in command.get_params(context) if option.name != "help"]
    return [f"- `{row[0]}`: {' '.join(row[1].split())}" for row in records if row and row[1]]


def _section(name: str, command: click.Command, shared: Sequence[str]) -> str:
    usage = " ".join(command.collect_usage_pieces(click.Context(command, info_name=f"pumaid {name}")))
    prose, _, example = inspect.cleandoc(command.help or "").partition("\b\n")
    lines = [line.strip() for line in example.splitlines() if line.strip() not in ("", "Example:")]
    options = _options(command)
    common = [f"`{match[1]}`" for line in options if line in shared and (match := re.match(r".*?(--[\w-]+)", line))]
    paragraphs = [f"## {name}", f"`pumaid {name} {usage}`"]
    paragraphs += [" ".join(part.split("\n")) for part in prose.strip().split("\n\n")]
    paragraphs += ["\n".join(["```sh", *lines, "```"]), "\n".join(line for line in options if line not in shared)]
    paragraphs += [f"Also {', '.join(common)}."] if common else []
    return "\n\n".join(filter(None, paragraphs)) + "\n"


def effects_page() -> str:
    """The manual's page of effects: a table, then a section each."""
    effects = sorted((facts(effect) for effect in catalogue().values()), key=lambda effect: not effect["base"])
    rows = [
        f"| [{effect['effect']}](#{effect['effect']}) | {_cell(effect['title'])} | `{_cell(effect['equation'])}` |"
        f" {', '.join(effect['look_alikes'])} |"
        for effect in effects
    ]
    table = ["| effect | meaning | current | look-alikes |", "|---|---|---|---|", *rows, ""]
    return "\n".join([HEAD_EFFECTS, *table, *map(_effect, effects)])


def _effect(effect: dict[str, Any]) -> str:
    """The section of one effect."""
    physics = " ".join(effect["physics"].split("\n\n")[0].split("\n"))
    lines = [f"## {effect['effect']}", "", physics, ""]
    for item in (*merged(effect["parameters"]), *merged(effect["shapes"])):
        lines.append(_number(item | ({"owner": "any"} if effect["not_at"] else {})))
    lines.append("")
    lines += [f"Not at a {kind} joint: {reason}." for kind, reason in effect["not_at"].items()]
    lines += [f"Best seen in {effect['seen_in']}."] if effect["seen_in"] else []
    return "\n".join([*lines, f"Source: {effect['source']}.", ""])


def _number(item: dict[str, Any]) -> str:
    limits = bounds(item["low"], item["high"])
    joint = f"{item['owner']} joint: " if item["owner"] in ("revolute", "prismatic") else ""
    unit = ", ".join(
        word for word in (item["unit"] if item["unit"] != "1" else "", limits if limits != "any" else "") if word
    )
    return f"- `{item['name']}`{f' ({joint}{unit})' if unit else ''}: {item['meaning']}"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def run_sessions(text: str, *, pictures: Path | None = None) -> str:
    """The README with what its sessions' commands print now, all run one after the other in one scratch folder.

    Pictures that they draw there are copied to the folder `pictures`.
    """
    with tempfile.TemporaryDirectory() as scratch:
        for name in ("sample_logs", "recipes"):
            shutil.copytree(ROOT / name, Path(scratch) / name, ignore=shutil.ignore_patterns("results"))
        told = SESSION.sub(lambda found: f"```console\n{_session(found[1], scratch)}```", text)
        if pictures is not None:
            for drawn in Path(scratch).glob("*.png"):
                shutil.copy(drawn, pictures)
        return told


def _session(block: str, folder: str) -> str:
    lines = [line for line in block.splitlines() if line.startswith("$ ")]
    return "\n".join(f"{line}\n{_printed(line[2:], folder)}" for line in lines)


def _printed(command: str, folder: str) -> str:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    environment = {**os.environ, "PATH": path, "COLUMNS": "120", "NO_COLOR": "1"}
    shell = ["bash", "-c", command]
    done = subprocess.run(
        shell, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if "Traceback" in done.stdout or "error[" in done.stdout:
        raise RuntimeError(f"a session of the README fails: {command}\n{done.stdout}")
    return "".join(f"{line.rstrip()}\n" for line in done.stdout.splitlines())


def picture() -> bytes:
    """What the sample PUMA's currents are spent on."""
    from pumaid import compare, identify
    from pumaid.experiment import Experiment
    from pumaid.reporting.figures.model import share_figure
    from pumaid.reporting.page import ReportContext

    experiment = Experiment((str(ROOT / "sample_logs" / "puma560"),))
    robot, dataset = experiment.robot, experiment.dataset()
    estimate = identify(dataset, robot)
    context = ReportContext(robot, estimate, dataset, compare(estimate, dataset, robot))
    return share_figure(context).file("png")


def main() -> int:
    """Write, or with ``--check`` only compare."""
    wanted = {COMMANDS: commands_page(), EFFECTS: effects_page()}
    if "--check" not in sys.argv:
        PICTURES.mkdir(exist_ok=True)
        wanted[README] = run_sessions(README.read_text(encoding="utf-8"), pictures=PICTURES)
        (PICTURES / "spent.png").write_bytes(picture())
    stale = [path for path, text in wanted.items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        if "--check" not in sys.argv:
            path.write_text(wanted[path], encoding="utf-8")
        print(f"{path.relative_to(ROOT)}: {'out of date, run make docs' if '--check' in sys.argv else 'written'}")
    return 1 if stale and "--check" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
