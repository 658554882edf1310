"""pumaid beside figaroh, aurt and mujoco.sysid on the same logs, in one run; appended to bench/peers.csv.

python tests/bench/peers.py [--rows 20000 100000 500000] [--limit 1200] [--once-limit 3600] [--environments FOLDER]

Each peer is installed from its package into an environment of its own (with --environments they are kept, and so are
logs and aurt's compiled model). Processes run one after another. `seconds` leaves out the start of Python and the
loading of modules, which `start-up` has; `processor` counts all threads and processes. A tool that does not finish a
log in time is not given the longer ones.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
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
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import peer_logs

ROOT = Path(__file__).parents[2]
LOG = ROOT / "bench" / "peers.csv"
DRIVERS = Path(__file__).parent / "drivers"
#: Runs of pumaid, of which the middle one counts: it is over before a machine's moods average out.
TIMES = 5
GIB = 1024**3
#: Last letters of what a tool said before it failed.
SAID = 200


@dataclass(frozen=True, slots=True)
class Peer:
    """A tool: what pip installs, the scripts that run it, kinds of logs, and numbers of joints, best first."""

    name: str
    package: str
    driver: str
    kinds: tuple[str, ...]
    once: str = ""
    joints: tuple[int, ...] = (6,)


ALONE, TOGETHER = "one joint at a time", "all joints at once"
#: aurt's symbolic model of six joints takes long: where it is not done in time, three joints must do.
#: figaroh and aurt take the friction of a joint from the sign of its velocity, which says nothing where it rests: a log
#: in which all joints move shows that they are used as they are meant to be. No engine is at a loss there.
PEERS = (
    Peer("figaroh", "figaroh", "run_figaroh.py", (ALONE, TOGETHER)),
    Peer("mujoco.sysid", "mujoco[sysid]", "run_mujoco.py", (ALONE,)),
    Peer("aurt", "aurt", "run_aurt.py", (ALONE, TOGETHER), once="compile_aurt.py", joints=(6, 3)),
)


@dataclass(frozen=True, slots=True)
class Case:
    """A log of so many rows of an arm with so many joints, in the folder `place`."""

    joints: int
    kind: str
    rows: int
    place: Path


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a process may take: s, s for what is done once for an arm, and GiB of address space."""

    seconds: float
    once: float
    memory: float


def environment(folder: Path, package: str) -> Path:
    """Python of a virtual environment that has a package; one that is there already is used as it is.

    Raises
    ------
    subprocess.CalledProcessError
        pip cannot install it; its standard error says why.
    """
    python = folder / "bin" / "python"
    ready = folder / "ready"
    if not ready.exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        pip = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", package]
        subprocess.run(pip, check=True, capture_output=True, text=True)
        ready.touch()
    return python


def run(python: Path, driver: str, folder: Path, *, bounds: Bounds) -> dict[str, Any]:
    """What a driver told of itself, with the seconds of its whole process; `outcome` is how it ended."""
    told = folder / "told.json"
    told.unlink(missing_ok=True)
    surroundings = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    limit = round(bounds.memory * GIB)
    with (folder / "said.txt").open("w", encoding="utf-8") as said:
        begun = time.perf_counter()
        process = subprocess.Popen(
            [python, DRIVERS / driver, folder],
            stdout=said,
            stderr=subprocess.STDOUT,
            env=surroundings | {"MPLBACKEND": "agg", "PYTHONDONTWRITEBYTECODE": ""},
            start_new_session=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        )
        try:
            failed = process.wait(bounds.seconds) != 0
        except subprocess.TimeoutExpired:
            peak = peak_of(process.pid)
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return {"outcome": f"not done in {bounds.seconds:g} s", "peak MiB": peak}
        whole = time.perf_counter() - begun
    if failed or not told.exists():
        last = (folder / "said.txt").read_text(encoding="utf-8", errors="replace").strip()[-SAID:]
        return {"outcome": "failed: " + " ".join(last.split())}
    return json.loads(told.read_text(encoding="utf-8")) | {"outcome": "done", "whole": whole}


def peak_of(process: int) -> int | str:
    """MiB that a process has had at most."""
    with contextlib.suppress(OSError, IndexError):
        status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
        return int(status.split("VmHWM:")[1].split()[0]) // 1024
    return ""


def errors(folder: Path) -> dict[str, float]:
    """Shares of the truth's root mean square: of gravity in all joints, and of friction in the one that moves."""
    asked, answers = np.load(folder / "questions.npz"), np.load(folder / "answers.npz")
    at = np.arange(len(asked["moving"])), asked["moving"]
    wanted = asked["whole"][at] - asked["gravity"][at]
    rubbed = answers["whole"][at] - answers["gravity"][at] - wanted
    carried = answers["gravity"] - asked["gravity"]

    def share(off: np.ndarray, whole: np.ndarray) -> float:
        return float(np.sqrt(np.mean(off**2) / np.mean(whole**2)))

    return {"gravity off": share(carried, asked["gravity"]), "friction off": share(rubbed, wanted)}


def cases(work: Path, sizes: list[int]) -> list[Case]:
    """All logs, each arm's short one of the other kind first."""
    out = []
    for joints in (6, 3):
        out.append(Case(joints, TOGETHER, sizes[0], work / f"together{joints}_{sizes[0]}"))
        out += [Case(joints, ALONE, rows, work / f"alone{joints}_{rows}") for rows in sizes]
    return out


def prepare(some: list[Case]) -> None:
    """The logs of one arm in all formats, made where they are not there already."""
    if all((case.place / "ready").exists() for case in some):
        return
    recipe = some[0].place.with_name(f"arm{some[0].joints}.yaml")
    recipe.write_text(peer_logs.recipe(some[0].joints), encoding="utf-8")
    truth = peer_logs.arm(recipe)
    logs = peer_logs.session(truth, max(case.rows for case in some))
    everything, asked = peer_logs.in_torque(truth, logs), peer_logs.questions(truth)
    compiled = recipe.with_name(f"aurt_model{some[0].joints}")
    compiled.mkdir(exist_ok=True)
    (compiled / "arm.csv").write_text(peer_logs.mdh_table(truth.robot), encoding="utf-8")
    for case in some:
        shutil.rmtree(case.place, ignore_errors=True)
        case.place.mkdir()
        rows = everything.first(case.rows) if case.kind == ALONE else peer_logs.moving_all(truth, case.rows)
        if case.kind == ALONE:
            peer_logs.write_pumaid(case.place, peer_logs.first_logs(logs, case.rows), truth.robot)
        peer_logs.write_figaroh(case.place, rows)
        peer_logs.write_aurt(case.place, rows)
        peer_logs.write_mujoco(case.place, rows)
        np.savez(case.place / "questions.npz", gain=np.asarray(truth.gain), **asked)
        shutil.copy(recipe, case.place / "recipe.yaml")
        (case.place / "arm.xml").write_text(peer_logs.mujoco_model(truth), encoding="utf-8")
        (case.place / "figaroh.yaml").write_text(peer_logs.figaroh_configuration(truth.robot), encoding="utf-8")
        (case.place / "aurt").symlink_to(compiled)
        (case.place / "ready").touch()


def of_pumaid(some: list[Case], bounds: Bounds) -> Iterator[tuple[Case, dict[str, Any]]]:
    """The middle of several runs; the first, which finds out what there is to load, does not count.

    The first model, too, gives all logs of the arm the URDF that figaroh reads.
    """
    python, urdf = Path(sys.executable), ""
    for case in some:
        if case.kind == ALONE:
            told = [run(python, "run_pumaid.py", case.place, bounds=bounds) for _ in range(TIMES + 1)][1:]
            middle = median(one["work"] for one in told)
            yield case, next(one for one in told if one["work"] == middle)
            urdf = urdf or peer_logs.figaroh_model(case.place / "recipe.yaml", case.place / "model.json")
    for case in some:
        (case.place / "arm.urdf").write_text(urdf, encoding="utf-8")


def line(tool: str, told: dict[str, Any], case: Case | None = None) -> dict[str, object]:
    """A row of the table."""
    done = told["outcome"] == "done"
    off = errors(case.place) if done and case is not None else {}
    return {
        "tool": tool,
        "versions": " ".join(f"{name} {number}" for name, number in told.get("versions", {}).items()),
        "joints": case.joints if case else told.get("joints", ""),
        "log": case.kind if case else "",
        "rows": case.rows if case else "",
        "outcome": told["outcome"],
        "seconds": f"{told['work']:.2f}" if done else "",
        "processor": f"{told['processor']:.2f}" if done else "",
        "start-up": f"{told['import']:.2f}" if done else "",
        "whole process": f"{told['whole']:.2f}" if done else "",
        "peak MiB": told.get("peak MiB", ""),
        "times pumaid": told.get("ratio", ""),
        "its processor": told.get("its ratio", ""),
        **{name: f"{off[name]:.4f}" if name in off else "" for name in ("gravity off", "friction off")},
        "load": f"{os.getloadavg()[0]:.1f}",
    }


def lines(work: Path, sizes: list[int], bounds: Bounds) -> Iterator[dict[str, object]]:
    """Every tool on every log, one after another."""
    everything = cases(work, sizes)
    own: dict[Case, dict[str, Any]] = {}
    for joints in (6, 3):
        some = [case for case in everything if case.joints == joints]
        prepare(some)
        for case, told in of_pumaid(some, bounds):
            own[case] = told
            yield line("pumaid", told, case)
    for peer in PEERS:
        try:
            python = environment(work / peer.name, peer.package)
        except subprocess.CalledProcessError as error:
            yield line(peer.name, {"outcome": f"not installed: {error.stderr.strip()[-SAID:]}"})
            continue
        for joints in peer.joints:
            told = once(peer, python, work / f"{peer.name}_model{joints}", bounds) if peer.once else {}
            if told:
                yield line(f"{peer.name}, once for an arm", told | {"joints": joints})
            if not told or told["outcome"] == "done":
                some = [case for case in everything if case.joints == joints and case.kind in peer.kinds]
                yield from of_peer(peer, python, some, own=own, bounds=bounds)
                break


def once(peer: Peer, python: Path, place: Path, bounds: Bounds) -> dict[str, Any]:
    """What a peer does once for an arm; what is left of an earlier time is used again, with the time that it took."""
    kept = place / "once.json"
    if kept.exists():
        return json.loads(kept.read_text(encoding="utf-8"))
    told = run(python, peer.once, place, bounds=replace(bounds, seconds=bounds.once))
    if told["outcome"] == "done":
        kept.write_text(json.dumps(told), encoding="utf-8")
    return told


def of_peer(
    peer: Peer, python: Path, some: list[Case], *, own: dict[Case, dict[str, Any]], bounds: Bounds
) -> Iterator[dict[str, object]]:
    """A peer on all logs of an arm; one that does not finish a log is given no longer ones."""
    most = max(case.rows for case in some)
    for case in some:
        if case.rows > most:
            yield line(peer.name, {"outcome": "not tried: a shorter log took too long"}, case)
            continue
        told = run(python, peer.driver, case.place, bounds=bounds)
        if told["outcome"] != "done":
            most = case.rows
        if case in own and not told["outcome"].startswith("failed"):
            told |= ratios(told, own[case], bounds)
        yield line(peer.name, told, case)


def ratios(told: dict[str, Any], own: dict[str, Any], bounds: Bounds) -> dict[str, str]:
    """How often pumaid could have done it in the time that a peer took, or was given."""
    if "work" not in told:
        return {"ratio": f"over {bounds.seconds / own['work']:.0f}"}
    return {"ratio": f"{told['work'] / own['work']:.0f}", "its ratio": f"{told['processor'] / own['processor']:.0f}"}


def main() -> None:
    """Measure, print and append."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--rows", type=int, nargs="+", default=[20_000, 100_000, 500_000])
    asked.add_argument("--limit", type=float, default=1200.0, help="s for each run of a peer")
    asked.add_argument("--once-limit", type=float, default=3600.0, help="s for what a peer does once for an arm")
    asked.add_argument("--memory", type=float, default=16.0, help="GiB of address space for each run")
    asked.add_argument("--environments", type=Path, help="folder for environments, logs and models, kept")
    words = asked.parse_args()
    bounds = Bounds(words.limit, words.once_limit, words.memory)
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    about = {"day": day, "commit": commit, "cores": os.cpu_count(), "machine": platform.machine()}
    LOG.parent.mkdir(exist_ok=True)
    with contextlib.ExitStack() as stack:
        work = words.environments or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pumaid-peers-")))
        work = work.resolve()
        work.mkdir(parents=True, exist_ok=True)
        for found in lines(work, sorted(words.rows), bounds):
            whole, is_new = about | found, not LOG.exists()
            with LOG.open("a", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, list(whole))
                if is_new:
                    writer.writeheader()
                writer.writerow(whole)
            sys.stdout.write(", ".join(f"{name} {value}" for name, value in found.items()) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
