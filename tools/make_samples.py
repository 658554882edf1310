"""Make ``sample_logs/`` again from its index: ``python tools/make_samples.py [--check]``."""

import argparse
import contextlib
import shlex
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pyarrow.parquet as pq
from click.testing import CliRunner
from ruamel.yaml import YAML

from pumaid.cli import group
from pumaid.io.log_reader import LogReader
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.io.write import write_log

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
    for name in sample["as_csv"]:
        path = folder / "logs" / f"{name}.parquet"
        write_log(path.with_suffix(".csv"), LogReader(path, robot), robot)
        path.unlink()
    (folder / "logs" / "truth.json").rename(folder / "truth.json")
    return folder


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
