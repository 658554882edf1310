"""Public recordings of real arms as experiment folders, and pumaid's commands run on them."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from click.testing import CliRunner

from pumaid.cli import group
from pumaid.io.recipe import shipped_recipes

#: Log blocks that are appended to a shipped recipe.
LOG_BLOCKS = {
    "ur3e": """log:
  time: timestamp
  position: "actual_q_{joint0}"
  velocity: "actual_qd_{joint0}"
  current: "actual_current_{joint0}"
""",
    "kinova_gen3": """log:
  time: Time
  position: "Position{joint}"
  velocity: "Velocity{joint}"
  current: "Cur{joint}"
  temperature: "Temp{joint}"
  units: {time: ms}
""",
    "pendulum2": """log: {time: time, position: "pos{joint}", velocity: "vel{joint}", current: "tau{joint}"}
""",
    "staubli_tx40": "",
}

#: One joint whose axis is vertical: a bare motor on a bench.
MOTOR = """name: motor on a bench
gravity: [0.0, 0.0, -9.80665]
joints:
  - {name: motor, type: revolute, theta: 0, alpha: 0, a: 0.0, d: 0.0}
log: {time: Time, position: Position, velocity: Velocity, current: Iq}
"""

#: Motor turns per joint turn of the TX40, from its provenance.
REDUCTIONS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)


def folder() -> Path:
    """Where the recordings are: ``PUMAID_REAL_DATA``, else ``shared/data`` beside the checkout; it may be absent."""
    return Path(os.environ.get("PUMAID_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data")


def ur3e() -> list[Path]:
    """The UR3e recording with measured currents: joint 2 alone, eleven strokes of half a turn."""
    return [folder() / "ur3e-aurt" / "wave_currentData_100v_40a.parquet"]


def gen3_single() -> list[Path]:
    """The Gen3 recordings in which one joint moves, a file a joint."""
    return [folder() / "kinova-gen3-jointwise" / f"joint_{joint}_trapez.parquet" for joint in range(1, 8)]


def gen3_together() -> list[Path]:
    """The Gen3 recordings in which all joints move."""
    home = folder() / "kinova-gen3-jointwise"
    return [*sorted(home.glob("identification_*.parquet")), *sorted(home.glob("validation_*.parquet"))]


def motor(*names: str) -> list[Path]:
    """Recordings of the bare motor."""
    return [folder() / "laas-odri-cogging" / f"{name}.parquet" for name in names]


def experiment(place: Path, recipe: str, files: Sequence[Path]) -> Path:
    """Make an experiment folder whose logs are links to `files`; `recipe` is a shipped one's name or ``motor``."""
    (place / "logs").mkdir(parents=True, exist_ok=True)
    text = MOTOR if recipe == "motor" else shipped_recipes()[recipe].read_text(encoding="utf-8") + LOG_BLOCKS[recipe]
    (place / "recipe.yaml").write_text(text, encoding="utf-8")
    for file in files:
        (place / "logs" / file.name).symlink_to(file)
    return place


def ur3e_halves(place: Path) -> Path:
    """The UR3e recording as two files, cut where the arm turns round near the middle."""
    experiment(place, "ur3e", [])
    table = pd.read_parquet(ur3e()[0])
    way = np.sign(table["target_qd_1"].to_numpy())
    turns = np.flatnonzero((way[1:] != way[:-1]) & (way[1:] != 0))
    cut = int(turns[np.argmin(np.abs(turns - len(table) // 2))]) + 1
    table.iloc[:cut].to_parquet(place / "logs" / "first.parquet")
    table.iloc[cut:].to_parquet(place / "logs" / "second.parquet")
    return place


def tx40(place: Path) -> Path:
    """The TX40 recording with joint angles instead of motor angles, in the canonical columns."""
    experiment(place, "staubli_tx40", [])
    table = pd.read_parquet(folder() / "staubli-tx40" / "tx40_excitation.parquet")
    columns = {"t": table["time_s"]}
    for joint, reduction in enumerate(REDUCTIONS, start=1):
        columns[f"q{joint}"] = table[f"motor_pos_rad_Joint_{joint}"] / reduction
        columns[f"i{joint}"] = table[f"motor_cmd_Joint_{joint}"]
    columns["q6"] = columns["q6"] - columns["q5"]
    pd.DataFrame(columns).to_parquet(place / "logs" / "tx40.parquet")
    return place


def run(place: Path, command: str, *words: str) -> tuple[int, Any, str]:
    """Exit code, JSON document and standard error of a command on an experiment folder.

    Parameters
    ----------
    place
        The folder.
    command
        ``identify``, ``diagnose`` ...
    words
        Further arguments; the recipe, the logs and the model are given.
    """
    model = [str(place / "results" / "model.json")] if command in ("compare", "diagnose") else []
    reads_logs = command != "history"
    logs = [str(place / "logs"), "--recipe", str(place / "recipe.yaml")] if reads_logs else []
    results = [] if command in ("compare", "segment") else ["--results", str(place / "results")]
    done = CliRunner().invoke(group, [command, *model, *logs, *results, *words, "--json"])
    return done.exit_code, json.loads(done.stdout) if done.stdout else None, done.stderr


def parameters(model: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Every parameter and ratio of a model document by name."""
    values = [value for joint in model["joints"] for value in joint["parameters"]]
    return {value["name"]: value for value in (*values, *model["ratios"])}


def combination(model: dict[str, Any], text: str) -> dict[str, Any]:
    """The estimable combination whose description holds `text`."""
    return next(entry for entry in model["combinations"] if text in entry["text"])


def ladder(place: Path, heldout: Sequence[Path] = ()) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The error ladder after ``diagnose --apply``, and the diagnosis of the base model.

    Parameters
    ----------
    place
        Experiment folder without results.
    heldout
        Files among its logs that are kept for judging.
    """
    judged = [word for file in heldout for word in ("--heldout", str(file))]
    run(place, "identify", *judged)
    _, first, _ = run(place, "diagnose", *judged, "-o", str(place / "first.json"))
    run(place, "diagnose", *judged, "--apply")
    history = run(place, "history")[1]["ladders"][-1]
    models = {model["model"]: model for model in history["models"]}
    return [models[number] for number in history["path"]], first
