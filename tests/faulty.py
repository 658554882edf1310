"""A good experiment that is small and quick to identify, commands run on copies of it, and what came of them.

The logs are made here from formulas, without code of the package: a pendulum of two links, each joint run to and fro
at two speeds in three postures, all of it twice.
"""

import io
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from click.testing import CliRunner

from pumaid.cli import group
from pumaid.io.recipe import shipped_recipes

RATE = 40.0  # Hz
HOLDS = (-1.3, 0.2, 1.1)  # rad, where the other joint stands
SPEEDS = (0.9, 2.2)  # rad/s
REACH = 1.6  # rad, each way
RAMP, REST = 0.3, 0.4  # s
#: A at joints 1 and 2: Coulomb forward and backward, viscous (A s/rad), noise of a sample, of a run's level.
COULOMB, VISCOUS = ((0.5, -0.4), (0.3, -0.35)), (0.12, 0.08)
NOISE, LEVEL = 0.02, 0.006
#: Weights (A) of link 1 at joint 1 and of link 2 at joint 2, and how much more of link 2 joint 1's motor shows.
OWN, OUTER, RATIO = 3.5, 0.9, 0.8
COLUMNS = ("t", "q1", "q2", "qd1", "qd2", "i1", "i2")
RECIPE = shipped_recipes()["pendulum2"].read_text(encoding="utf-8")


@dataclass(frozen=True)
class Fault:
    """One mutation: its class, what it is, and what makes it of a copy of the good experiment."""

    kind: str
    name: str
    change: Callable[[Path], None]


def _leg(start: float, end: float, speed: float) -> np.ndarray:
    """Positions of a motion with cosine ramps, at `RATE`."""
    n = round(RAMP * RATE)
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n)
    flat = max(round((abs(end - start) / speed - RAMP) * RATE), 1)
    velocity = np.concatenate([ramp, np.ones(flat), ramp[::-1], np.zeros(round(REST * RATE))])
    return start + (end - start) * np.cumsum(velocity) / velocity.sum()


def _path() -> tuple[np.ndarray, np.ndarray]:
    """(N, 2) positions of one pass through all runs (rad), and (N,) the number of the motion."""
    where, legs = np.zeros(2), []
    for joint in (1, 0):
        for hold in HOLDS:
            for ends in [(-REACH, speed) for speed in SPEEDS[:1]] + [
                (end, speed) for speed in SPEEDS for end in (REACH, -REACH)
            ]:
                for moving, target, speed in ((1 - joint, hold, 1.5), (joint, *ends)):
                    if abs(target - where[moving]) < 1e-6:
                        continue
                    leg = np.tile(where, (len(one := _leg(where[moving], target, speed)), 1))
                    leg[:, moving] = one
                    where = leg[-1].copy()
                    legs.append(leg)
    return np.concatenate(legs), np.repeat(np.arange(len(legs)), [len(leg) for leg in legs])


@cache
def good(seed: int = 0, *, passes: int = 2) -> tuple[pd.DataFrame, ...]:
    """The logs of the good experiment, one pass each; their times follow one another."""
    rng, found = np.random.default_rng(seed), []
    q, motion = _path()
    speed = np.gradient(q, 1 / RATE, axis=0)
    speed[np.abs(speed) < 1e-9] = 0.0
    for number in range(passes):
        outer = OUTER * np.sin(q[:, 0] + q[:, 1] + 0.3)
        current = np.stack([OWN * np.sin(q[:, 0]) + RATIO * outer, outer], axis=1)
        for joint in (0, 1):
            v = speed[:, joint]
            current[:, joint] += np.where(v > 0, COULOMB[joint][0], COULOMB[joint][1]) * (v != 0) + VISCOUS[joint] * v
        current += LEVEL * rng.normal(size=(motion.max() + 1, 2))[motion] + NOISE * rng.normal(size=q.shape)
        time = np.arange(len(q)) / RATE + number * (len(q) + 40) / RATE
        noisy = q + 2e-4 * rng.normal(size=q.shape)
        rows = np.column_stack([time, noisy, speed + 5e-3 * rng.normal(size=q.shape), current])
        found.append(pd.DataFrame(np.round(rows, 6), columns=list(COLUMNS)))
    return tuple(found)


def csv(table: pd.DataFrame, **form: object) -> str:
    """A log as CSV text; `form` as of `DataFrame.to_csv`."""
    return table.to_csv(index=False, **form)  # type: ignore[call-overload,no-any-return]


def parquet(table: pd.DataFrame, **form: object) -> bytes:
    """A log as Parquet; `form` as of `DataFrame.to_parquet`."""
    held = io.BytesIO()
    table.to_parquet(held, index=False, **form)  # type: ignore[call-overload]
    return held.getvalue()


def make(folder: Path) -> Path:
    """The good experiment in an empty folder: recipe and two logs."""
    (folder / "logs").mkdir(parents=True)
    (folder / "recipe.yaml").write_text(RECIPE, encoding="utf-8")
    for number, table in enumerate(good(), start=1):
        (folder / "logs" / f"log_{number}.csv").write_text(csv(table), encoding="utf-8")
    return folder


@cache
def fitted() -> dict:
    """The model of the good experiment, as its JSON document."""
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        found = invoke("identify", str(make(Path(folder) / "arm") / "logs"), "--json")
    assert found.exit_code == 0, found.stderr
    return json.loads(found.stdout)


def invoke(*words: str, stdin: bytes | None = None):
    """A command line in this process."""
    return CliRunner().invoke(group, list(words), prog_name="pumaid", input=stdin)


def intervals(document: dict) -> dict[str, tuple[float, float, float]]:
    """Name -> value and 95 % interval of what a model document has identified."""
    values = [one for joint in document["joints"] for one in joint["parameters"]] + document["ratios"]
    return {one["name"]: (one["value"], *one["ci95"]) for one in values if one["state"] == "identified"}


def slugs_of(stderr: str) -> set[str]:
    """Slugs of the notes on standard error."""
    return set(re.findall(r"^note\[([a-z-]+)\]", stderr, re.MULTILINE))


#: Notes that say of numbers that they may be wrong; others only tell what was left out or is not there.
WARNINGS = {
    "beyond-limits", "clock-jitter", "current-dropouts", "current-frozen",
    "current-saturated", "current-spikes", "few-runs", "friction-falls-with-speed",
    "logs-disagree", "model-misses", "position-coarse", "position-held", "position-wraps", "time-unit",
    "repeats-differ", "run-stands-out", "sign-odd", "units-disagree",
    "velocity-unrelated",
}  # fmt: skip


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder with its bytes, but for the dataset, which belongs to the logs."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "dataset.npz"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def unclear(stderr: str) -> list[str]:
    """What in a refusal is neither a note nor a message with a mend, and messages without one."""
    lines = [line for line in stderr.splitlines() if not line.startswith("note[") and "dataset.npz" not in line]
    text = "\n".join(lines)
    heads, mends = len(re.findall(r"^error\[", text, re.MULTILINE)), text.count("\n  fix: ")
    faults = [] if text.startswith("error[") else [f"it begins with {text[:80]!r}"]
    # Several faults of one file may share the mend that the last of them ends with.
    faults += [] if 1 <= mends <= heads else [f"{heads} messages have {mends} mends"]
    return faults + [word for word in ("Traceback", 'File "', "bug: ") if word in text]


def outcome(found, folder: Path, before: dict[str, bytes]) -> str:
    """``refused``, ``flagged`` or ``agrees``; anything else is a sentence on what is wrong with what was seen."""
    if found.exit_code == 3:
        wrong = unclear(found.stderr)
        wrong += ["words on standard output"] if found.stdout else []
        wrong += ["old results were changed"] if contents(folder / "results") != before else []
        return "; ".join(wrong) or "refused"
    if found.exit_code != 0:
        return f"exit code {found.exit_code}: {found.stderr[-500:]}"
    document = json.loads(found.stdout)
    if json.loads((folder / "results" / "model.json").read_text()) != document:
        return "the model file is not what was printed"
    now, wanted = intervals(document), intervals(fitted())
    both = {name: (now[name], wanted[name]) for name in now.keys() & wanted.keys()}
    # Intervals of 95 % that have nothing in common.
    odd = {name: (a, b) for name, (a, b) in both.items() if a[1] > b[2] or b[1] > a[2]}
    if odd and not slugs_of(found.stderr) & WARNINGS:
        return f"silently wrong: {odd}"
    return "flagged" if odd else "agrees"
