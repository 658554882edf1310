"""Runs of ``pumaid identify`` that are killed, interrupted or made side by side, by a process that has it all loaded.

As a program: ``python tests/killed.py FOLDER --trials 200`` kills that many runs at random instants and tells what each
left behind. Runs are forked from one process before it has read anything, so that a trial takes no start-up time.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import signal
import sys
import time
from pathlib import Path

from pumaid.cli import group
from pumaid.effects import catalogue
from pumaid.io.recipe import read_recipe, shipped_recipes

#: What a run loads when it needs it; loaded before the first fork it costs nothing in each trial.
LOADED = (
    *("pandas", "rich.console", "scipy.optimize", "pumaid.cli.commands.identify", "pumaid.cli.output"),
    *("pumaid.results.history", "pumaid.io.plan_file", "pumaid.io.log_reader"),
    *(
        "pumaid.preprocessing.log_checks",
        "pumaid.reporting.text",
        "pumaid.reporting.tables",
        "pumaid.estimation.estimate",
    ),
    "pumaid.preprocessing.segment",
)


def load() -> None:
    """Load what runs need; nothing here starts a thread, which a fork would lose."""
    for name in LOADED:
        importlib.import_module(name)
    catalogue()
    read_recipe(shipped_recipes()["pendulum2"])


def started(folder: Path, *words: str) -> int:
    """A run in a process of its own; its number."""
    child = os.fork()
    if child:
        return child
    for stream, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(folder / f"{name}.{os.getpid()}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        group.main(list(words), prog_name="pumaid", standalone_mode=True)
    except SystemExit as end:
        sys.stdout.flush()
        os._exit(end.code if isinstance(end.code, int) else 1)
    os._exit(0)


def ended(child: int) -> int:
    """Exit code of a run, or minus the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def whole(results: Path) -> bool:
    """Whether every file that a results folder shows is a whole document, and numbers stand once."""
    shown = [path for path in results.rglob("*.json") if not path.name.startswith(".")]
    numbers = [path.name.split("-")[0] for path in (results / "models").glob("[0-9]*.json")]
    try:
        return all(json.loads(path.read_text())["kind"] == "model" for path in shown) and len(set(numbers)) == len(
            numbers
        )
    except ValueError:
        return False


def killed(folder: Path, trials: int, *, seed: int = 0, number: int = signal.SIGKILL) -> dict[str, int]:
    """Kill runs at random instants; how often what stood after it was ``old``, ``new`` or ``half`` (a fault).

    The runs identify the folder's first and second log in turn, so that every one has something to change. Half of them
    are killed near their end, where they write. Also counted: runs that were ``over`` before, and exit ``codes``.
    """
    rng, logs = random.Random(seed), sorted((folder / "logs").iterdir())
    model, made, spans = folder / "results" / "model.json", [], []
    for log in logs:
        begin = time.monotonic()
        assert ended(started(folder, "identify", str(log))) == 0
        made.append(model.read_bytes())
        spans.append(time.monotonic() - begin)
    found = {"old": 0, "new": 0, "half": 0, "over": 0, "loud": 0}
    for trial in range(trials):
        old, new = model.read_bytes(), made[1] if model.read_bytes() == made[0] else made[0]
        child = started(folder, "identify", str(logs[made.index(new)]))
        time.sleep(rng.uniform(0.0, 1.1 * max(spans)) if trial % 2 else rng.gauss(0.95, 0.08) * min(spans))
        os.kill(child, number)
        code, now = ended(child), model.read_bytes()
        words = (folder / f"err.{child}").read_text()
        found["over"] += code == 0
        found["loud"] += code not in (0, -number, 128 + number) or "Traceback" in words
        found["old" if now == old else "new" if now == new and whole(folder / "results") else "half"] += 1
    found["again"] = ended(started(folder, "identify", str(logs[0])))
    found["current"] = int(model.read_bytes() == made[0] and whole(folder / "results"))
    return found


def side_by_side(folder: Path, rounds: int) -> dict[str, int]:
    """Two runs at once in one folder, several times: exit codes other than 0, and folders that are not whole."""
    found, logs = {"failed": 0, "mixed": 0, "models": 0}, sorted((folder / "logs").iterdir())
    for _ in range(rounds):
        for path in (folder / "results" / "models").glob("*.json"):
            path.unlink()
        (folder / "results" / "model.json").unlink(missing_ok=True)
        children = [started(folder, "identify", str(log)) for log in logs]
        found["failed"] += sum(ended(child) != 0 for child in children)
        found["mixed"] += not whole(folder / "results")
        found["models"] += len(list((folder / "results" / "models").glob("[0-9]*.json")))
    return found


def main() -> None:
    """Kill, interrupt or pair runs as told on the command line, and print what was counted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="an experiment of two logs; tests/faulty.py makes one")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--interrupt", action="store_true", help="Ctrl-C instead of SIGKILL")
    parser.add_argument("--pairs", action="store_true", help="two runs at once instead")
    told = parser.parse_args()
    load()
    if told.pairs:
        print(json.dumps(side_by_side(told.folder, told.trials)))
    else:
        number = signal.SIGINT if told.interrupt else signal.SIGKILL
        print(json.dumps(killed(told.folder, told.trials, seed=told.seed, number=number)))


if __name__ == "__main__":
    main()
