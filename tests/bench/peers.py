"""pumaid beside figaroh, aurt and mujoco.sysid on the same logs, in one run; appended to bench/peers.csv.

python tests/bench/peers.py [--rows 20000 100000 500000] [--limit 1200]

Each peer is installed from its package into an environment of its own. Processes run one after another. `seconds`
leaves out the start of Python and the loading of modules, which `start-up` has; `processor` counts all threads and
processes. A tool that does not finish a log in time is not given the longer ones.
"""

import argparse
import datetime
import json
import os
import platform
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import peer_logs

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "bench" / "peers.csv"
DRIVERS = Path(__file__).parent / "drivers"
#: Runs of pumaid, of which the median counts; the first, which lists the modules to load, does not.
REPEATS = 5
#: GiB of address space of a process; last letters of a failed tool's output that are kept.
MEMORY, TAIL = 16, 200
ALONE, TOGETHER = "one joint at a time", "all joints at once"
#: Tool -> what pip installs, the script that runs it, its logs, and the joints of its arm. figaroh and aurt take the
#: friction of a joint from the sign of its velocity, which says nothing where it rests: a log in which all joints move
#: shows that they are used as they are meant to be. aurt's symbolic model of six joints is not done in half an hour.
PEERS: dict[str, tuple[str, str, tuple[str, ...], int]] = {
    "figaroh": ("figaroh", "run_figaroh.py", (ALONE, TOGETHER), 6),
    "mujoco.sysid": ("mujoco[sysid]", "run_mujoco.py", (ALONE,), 6),
    "aurt": ("aurt", "run_aurt.py", (ALONE, TOGETHER), 3),
}


@dataclass(frozen=True, slots=True)
class Case:
    """A log of so many rows of an arm with so many joints, in a folder."""

    joints: int
    kind: str
    rows: int
    folder: Path


def environment(folder: Path, package: str) -> Path:
    """Python of a new virtual environment that has a package; pip's error says why there is none."""
    python = folder / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    subprocess.run([python, "-m", "pip", "install", "-q", package], check=True, capture_output=True, text=True)
    return python


def run(python: Path, driver: str, folder: Path, seconds: float) -> dict[str, Any]:
    """The figures of a driver's run, and how it ended (`outcome`)."""
    record = folder / "record.json"
    record.unlink(missing_ok=True)
    variables = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    with (folder / "output.txt").open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            [python, DRIVERS / driver, folder],
            stdout=output,
            stderr=subprocess.STDOUT,
            env=variables | {"MPLBACKEND": "agg", "PYTHONDONTWRITEBYTECODE": ""},
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY * 1024**3,) * 2),
        )
        try:
            code = process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return {"outcome": f"not done in {seconds:g} s"}
    if code or not record.exists():
        text = (folder / "output.txt").read_text(encoding="utf-8", errors="replace")
        return {"outcome": "failed: " + " ".join(text.strip()[-TAIL:].split())}
    return {"outcome": "done", **json.loads(record.read_text(encoding="utf-8"))}


def errors(folder: Path) -> dict[str, float]:
    """RMS errors over the truth's RMS: of gravity in all joints, and of friction in the joint that moves."""
    asked, answers = np.load(folder / "questions.npz"), np.load(folder / "answers.npz")
    moving = np.arange(len(asked["moving"])), asked["moving"]
    friction, answer = (part["whole"][moving] - part["gravity"][moving] for part in (asked, answers))
    pairs = {"gravity off": (answers["gravity"], asked["gravity"]), "friction off": (answer, friction)}
    return {
        name: float(np.sqrt(np.mean((value - truth) ** 2) / np.mean(truth**2)))
        for name, (value, truth) in pairs.items()
    }


def prepare(work: Path, joints: int, sizes: list[int]) -> list[Case]:
    """The logs of one arm in all formats, and what each tool must be told of the arm."""
    cases = [Case(joints, TOGETHER, sizes[0], work / f"together{joints}_{sizes[0]}")]
    cases += [Case(joints, ALONE, rows, work / f"alone{joints}_{rows}") for rows in sizes]
    recipe, compiled = work / f"arm{joints}.yaml", work / f"aurt_model{joints}"
    recipe.write_text(peer_logs.recipe(joints), encoding="utf-8")
    truth = peer_logs.arm(recipe)
    everything, questions = peer_logs.session(truth, max(sizes)), peer_logs.questions(truth)
    compiled.mkdir()
    (compiled / "arm.csv").write_text(peer_logs.mdh_table(truth.robot), encoding="utf-8")
    for case in cases:
        case.folder.mkdir()
        rows = everything.first(case.rows) if case.kind == ALONE else peer_logs.moving_all(truth, case.rows)
        peer_logs.write(case.folder, rows, truth)
        np.savez(case.folder / "questions.npz", gain=np.asarray(truth.gain), **questions)
        shutil.copy(recipe, case.folder / "recipe.yaml")
        (case.folder / "arm.xml").write_text(peer_logs.mujoco_model(truth), encoding="utf-8")
        (case.folder / "figaroh.yaml").write_text(peer_logs.figaroh_configuration(truth.robot), encoding="utf-8")
        (case.folder / "aurt").symlink_to(compiled)
    return cases


def measure_pumaid(cases: list[Case], limit: float) -> dict[Case, dict[str, Any]]:
    """The median of several runs on each log; the first model gives the arm's logs the URDF that figaroh reads."""
    records = {}
    for case in cases:
        if case.kind == ALONE:
            times = [run(Path(sys.executable), "run_pumaid.py", case.folder, limit) for _ in range(REPEATS + 1)][1:]
            records[case] = sorted(times, key=lambda record: record["seconds"])[REPEATS // 2]
    first = next(iter(records)).folder
    urdf = peer_logs.figaroh_model(first / "recipe.yaml", first / "model.json")
    for case in cases:
        (case.folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    return records


def measurements(work: Path, sizes: list[int], limit: float) -> Iterator[dict[str, Any]]:
    """Every tool on every log, one after another."""
    cases = {joints: prepare(work, joints, sizes) for joints in (6, 3)}
    references = {joints: measure_pumaid(cases[joints], limit) for joints in cases}
    for records in references.values():
        yield from (row("pumaid", case, record, record) for case, record in records.items())
    for tool, (package, driver, kinds, joints) in PEERS.items():
        try:
            python = environment(work / tool, package)
        except subprocess.CalledProcessError as error:
            yield {"tool": tool, "outcome": f"not installed: {(error.stderr or '').strip()[-TAIL:]}"}
            continue
        if tool == "aurt":
            record = run(python, "compile_aurt.py", work / f"aurt_model{joints}", 3 * limit)
            yield {"tool": "aurt, once for an arm", "joints": joints, **record}
        longest = max(sizes)
        for case in (case for case in cases[joints] if case.kind in kinds and case.rows <= longest):
            record = run(python, driver, case.folder, limit)
            if record["outcome"] != "done":
                longest = case.rows
            yield row(tool, case, record, references[joints].get(case))


def row(tool: str, case: Case, record: dict[str, Any], reference: dict[str, Any] | None) -> dict[str, Any]:
    """A row of the table; `reference` is pumaid's record of the same log."""
    out = {"tool": tool, "joints": case.joints, "log": case.kind, "rows": case.rows, **record}
    if record["outcome"] == "done":
        out |= errors(case.folder)
        if reference is not None:
            out["times pumaid"] = record["seconds"] / reference["seconds"]
            out["its processor"] = record["processor"] / reference["processor"]
    return out


def main() -> None:
    """Measure, print and append."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=int, nargs="+", default=[20_000, 100_000, 500_000])
    parser.add_argument("--limit", type=float, default=1200.0, help="s for each run of a peer")
    options = parser.parse_args()
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    about = {"day": day, "cores": os.cpu_count(), "machine": platform.machine()}
    table = pd.read_csv(TABLE, dtype=str) if TABLE.exists() else pd.DataFrame()
    with tempfile.TemporaryDirectory(prefix="pumaid-peers-") as work:
        for record in measurements(Path(work), sorted(options.rows), options.limit):
            rounded = {name: f"{value:.4g}" if isinstance(value, float) else value for name, value in record.items()}
            table = pd.concat([table, pd.DataFrame([about | rounded])])
            table.to_csv(TABLE, index=False)
            print(", ".join(f"{name} {value}" for name, value in rounded.items()), flush=True)


if __name__ == "__main__":
    main()
