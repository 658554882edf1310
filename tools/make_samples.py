"""Make ``sample_logs/`` again from its index: ``python tools/make_samples.py [--check]``."""

import argparse
import contextlib
import shlex
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
import pyarrow.parquet as pq
from click.testing import CliRunner
from free_motion import picks, reach, recorded
from ruamel.yaml import YAML

from pumaid.cli import group
from pumaid.io.log_reader import LogReader
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.write import write_log
from pumaid.results.documents import as_text
from pumaid.results.truth_file import as_json
from pumaid.robot import Robot
from pumaid.simulation import draw
from pumaid.simulation.hidden_effects import parse

SAMPLES = Path(__file__).parents[1] / "sample_logs"


def index() -> list[dict[str, Any]]:
    """The samples that the index names."""
    found = YAML(typ="safe").load((SAMPLES / "index.yaml").read_text(encoding="utf-8"))
    return list(found["samples"])


def make(sample: dict[str, Any], root: Path) -> Path:
    """Make one sample below `root`: recipe, plan, logs and truth."""
    folder = root / sample["folder"]
    folder.mkdir(parents=True)
    shutil.copyfile(shipped_recipes()[sample["recipe"]], folder / "recipe.yaml")
    with contextlib.chdir(folder):
        for command in sample["commands"]:
            done = CliRunner().invoke(group, shlex.split(command)[1:], prog_name="pumaid")
            if done.exit_code:
                raise SystemExit(f"{command!r} left with {done.exit_code}:\n{done.output}")
    robot = read_recipe(folder / "recipe.yaml")
    if "work" in sample:
        log_work(sample, folder / "logs", robot)
    for name in sample["as_csv"]:
        path = folder / "logs" / f"{name}.parquet"
        write_log(path.with_suffix(".csv"), LogReader(path, robot), robot)
        path.unlink()
    (folder / "logs" / "truth.json").rename(folder / "truth.json")
    return folder


def log_work(sample: dict[str, Any], logs: Path, robot: Robot) -> None:
    """Logs of an arm whose joints all move from place to place, and its truth."""
    truth, rng = draw(robot, sample["seed"]), np.random.default_rng(sample["seed"])
    truth = truth.hiding([parse(text, robot) for text in sample["hide"]])
    logs.mkdir()
    for name, seconds in sample["work"].items():
        log = recorded(truth, picks(rng, seconds, reach(robot)), rng, counts=2e4)
        log = replace(log, position=np.round(log.position, 5), current=np.round(log.current, 3))
        write_log(logs / f"{name}.parquet", [log], robot)
    (logs / "truth.json").write_text(as_text(as_json(truth, seed=sample["seed"])), encoding="utf-8")


def contents(folder: Path) -> dict[str, object]:
    """Every file below a folder but results, by its path: bytes, or the table where a library's version decides."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    files = [path for path in files if "results" not in path.relative_to(folder).parts]
    return {
        str(path.relative_to(folder)): pq.read_table(path) if path.suffix == ".parquet" else path.read_bytes()
        for path in files
    }


def main() -> int:
    """Make all samples, or (``--check``) compare what is there with what would be made."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--check", action="store_true", help="change nothing; exit with 1 if a sample is not current")
    check = options.parse_args().check
    stale = []
    for sample in index():
        with TemporaryDirectory() as scratch:
            made, target = make(sample, Path(scratch)), SAMPLES / sample["folder"]
            if contents(made) == contents(target):
                continue
            stale.append(sample["folder"])
            if not check:
                shutil.rmtree(target, ignore_errors=True)
                shutil.copytree(made, target)
    if stale:
        print(f"{'not current' if check else 'made'}: {', '.join(stale)}", file=sys.stderr)
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
