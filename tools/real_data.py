"""Public recordings of real arms as experiment folders; prints the numbers of docs/validation.md on them.

UR5, UR10, UR10e and Panda are not among them: they were run by hand on their repositories' files. The recordings are
looked for where ``PUMAID_REAL_DATA`` points, else in ``shared/data`` beside the checkout.
"""

import json
import math
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from click.testing import CliRunner, Result

from pumaid.cli import group
from pumaid.dataset import load_dataset
from pumaid.diagnosis.cross_validation import leave_out, replicate_folds
from pumaid.diagnosis.stepwise import Stepwise
from pumaid.effect_spec import EffectTerm
from pumaid.effects import catalogue
from pumaid.io.recipe import read_recipe, shipped_recipes
from pumaid.model import Model

#: Log blocks that are appended to a shipped recipe.
LOG_BLOCKS = {
    "ur3e": """log: {time: timestamp, position: "actual_q_{joint0}", velocity: "actual_qd_{joint0}",
  current: "actual_current_{joint0}"}
""",
    "kinova_gen3": """log: {time: Time, position: "Position{joint}", velocity: "Velocity{joint}", current: "Cur{joint}",
  temperature: "Temp{joint}", units: {time: ms}}
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

#: The UR3e with measured currents: joint 2 alone, eleven strokes of half a turn.
UR3E = "ur3e-aurt/wave_currentData_100v_40a.parquet"
#: The Gen3: one joint alone, a file a joint; and all joints together.
GEN3, TOGETHER = "kinova-gen3-jointwise/joint_[1-7]_trapez.parquet", "kinova-gen3-jointwise/[iv]*ation_*.parquet"
PENDULUM = "dfki-double-pendulum-a0/*.parquet"


def folder() -> Path:
    """Where the recordings are: ``PUMAID_REAL_DATA``, else ``shared/data`` beside the checkout; it may be absent."""
    return Path(os.environ.get("PUMAID_REAL_DATA") or Path(__file__).parents[2] / "shared" / "data")


def files(pattern: str) -> list[Path]:
    """The recordings that a pattern below the folder names."""
    return sorted(folder().glob(pattern))


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
    table = pd.read_parquet(files(UR3E)[0])
    way = np.sign(table["target_qd_1"].to_numpy())
    turns = np.flatnonzero((way[1:] != way[:-1]) & (way[1:] != 0))
    cut = int(turns[np.argmin(np.abs(turns - len(table) // 2))]) + 1
    table.iloc[:cut].to_parquet(place / "logs" / "first.parquet")
    table.iloc[cut:].to_parquet(place / "logs" / "second.parquet")
    return place


def tx40(place: Path, *, is_geared: bool = False) -> Path:
    """The TX40 recording with joint angles instead of motor angles, in the canonical columns.

    Efforts are those of the motors, or where it `is_geared` those at joints, as its publishers count them: the motor of
    joint 6 acts on joint 5, too.
    """
    experiment(place, "staubli_tx40", [])
    table = pd.read_parquet(folder() / "staubli-tx40" / "tx40_excitation.parquet")
    columns = {"t": table["time_s"]}
    for joint, reduction in enumerate(REDUCTIONS, start=1):
        columns[f"q{joint}"] = table[f"motor_pos_rad_Joint_{joint}"] / reduction
        columns[f"i{joint}"] = table[f"motor_cmd_Joint_{joint}"] * (reduction if is_geared else 1.0)
    columns["i5"] = columns["i5"] + columns["i6"] * is_geared
    columns["q6"] = columns["q6"] - columns["q5"]
    pd.DataFrame(columns).to_parquet(place / "logs" / "tx40.parquet")
    return place


def done(place: Path, command: str, *words: str) -> Result:
    """A command on a folder's recipe, logs and model; `words` more."""
    model = [str(place / "results" / "model.json")] if command in ("compare", "diagnose") else []
    logs = [] if command == "history" else [str(place / "logs"), "--recipe", str(place / "recipe.yaml")]
    results = [] if command in ("compare", "segment") else ["--results", str(place / "results")]
    return CliRunner().invoke(group, [command, *model, *logs, *results, *words])


def run(place: Path, command: str, *words: str) -> tuple[int, Any, str]:
    """Exit code, JSON document and standard error of a command."""
    result = done(place, command, *words, "--json")
    return result.exit_code, json.loads(result.stdout) if result.stdout else None, result.stderr


def parameters(model: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Every parameter and ratio of a model document by name."""
    values = [value for joint in model["joints"] for value in joint["parameters"]]
    return {value["name"]: value for value in (*values, *model["ratios"])}


def combination(model: dict[str, Any], text: str) -> dict[str, Any]:
    """The estimable combination whose description holds `text`."""
    return next(entry for entry in model["combinations"] if text in entry["text"])


def ladder(place: Path, heldout: Sequence[Path] = ()) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The error ladder after ``diagnose --apply``, and what that says; `heldout` logs are judged."""
    judged = [word for file in heldout for word in ("--heldout", str(file))]
    run(place, "identify", *judged)
    _, diagnosis, _ = run(place, "diagnose", *judged, "--apply")
    history = run(place, "history")[1]["ladders"][-1]
    models = {model["model"]: model for model in history["models"]}
    return [models[number] for number in history["path"]], diagnosis


#: Recordings of the bare motor at one voltage, and at about one controlled speed.
ROLLING = ("rolling_data", "rolling_data1", "rolling_data2")
SPEED = ("speed_test", "speed_test1", "speed_test_old")


def ladders(scratch: Path) -> Iterator[tuple[str, str, list[dict[str, Any]], dict[str, Any]]]:
    """Recording, what was held out, the models of ``diagnose --apply``, and what that says."""
    for judged in ("first", "second"):
        place = ur3e_halves(scratch / f"ur3e_{judged}")
        yield ("UR3e", f"{judged} half", *ladder(place, [place / "logs" / f"{judged}.parquet"]))
    for names in (ROLLING, SPEED):
        for judged in names:
            place = experiment(scratch / f"motor_{judged}", "motor", motor(*names))
            yield ("bare motor", judged, *ladder(place, [place / "logs" / f"{judged}.parquet"]))
    place = experiment(scratch / "gen3_ladder", "kinova_gen3", files(GEN3))
    yield ("Gen3", "nothing", *ladder(place))


def ladder_row(name: str, judged: str, models: list[dict[str, Any]]) -> str:
    """A row of the ladder table: what was added, and fitted and held-out RMSE (A) of each model."""
    added = [spelled(effect) for model in models[1:] for effect in model["added"]]
    fitted = ", ".join(f"{model['rmse']:.4f}" for model in models)
    heldout = ", ".join("-" if model["heldout"] is None else f"{model['heldout']:.4f}" for model in models)
    return f"| {name} | {judged} | {', '.join(added) or 'nothing'} | {fitted} | {heldout} |"


def spelled(effect: dict[str, Any]) -> str:
    """An effect of a model for the table: ``ripple@1 72.0``."""
    joint = "" if effect["joint"] is None else f"@{effect['joint']}"
    waves = f" {effect['shape']['frequency']:.1f}" if "frequency" in effect["shape"] else ""
    return f"{effect['effect']}{joint}{waves}"


def unseen_by_joint(place: Path, effect: str, owner: int, shape: dict[str, float]) -> dict[int, tuple[float, float]]:
    """By joint that an effect touches: RMSE (A) of its blocks in cells, each left out of the fit, without and with it.

    What comes and goes within a cell, which no fit to cells explains, is not in it.
    """
    dataset, robot = load_dataset(place / "results" / "dataset.npz")[0], read_recipe(place / "recipe.yaml")
    fitted = Stepwise(Model.of_runs(robot, dataset.runs), dataset.runs).fits.solved([])
    term = EffectTerm(catalogue()[effect], owner, shape)
    joints = (owner, int(shape["on"]))
    folds = {joint: leave_out(fitted, (term,), replicate_folds(fitted, [joint])) for joint in joints}
    cells = {joint: fitted.by_bin[joint].bins for joint in joints}
    fast = {joint: float(np.average(bins.inside, weights=bins.count)) for joint, bins in cells.items()}
    return {
        joint: (math.sqrt(fold.before**2 - fast[joint]), math.sqrt(fold.after**2 - fast[joint]))
        for joint, fold in folds.items()
    }


def together(comparison: dict[str, Any]) -> dict[int, float]:
    """RMSE (A) by joint of a comparison document."""
    return {joint["joint"]: joint["rmse"] for joint in comparison["joints"] if joint["rmse"] is not None}


def report(scratch: Path) -> Iterator[str]:
    """The whole report, part by part: what commands print, and the tables made here."""
    yield done(experiment(scratch / "ur3e", "ur3e", files(UR3E)), "identify").output
    gen3 = experiment(scratch / "gen3", "kinova_gen3", files(GEN3))
    yield done(gen3, "identify").output
    unseen = experiment(scratch / "together", "kinova_gen3", files(TOGETHER))
    shutil.copytree(gen3 / "results", unseen / "results")
    yield done(unseen, "compare").output
    yield done(experiment(scratch / "dfki", "pendulum2", files(PENDULUM)), "identify").output
    for is_geared in (False, True):
        place = tx40(scratch / f"tx40_{is_geared}", is_geared=is_geared)
        yield done(place, "identify").output
        for joint, (before, after) in unseen_by_joint(place, "coupling", 6, {"on": 5.0}).items():
            yield f"coupling@6:on=5, joint {joint}: blocks left out {before:.4f}, {after:.4f}"
    for name in ROLLING:
        yield done(experiment(scratch / name, "motor", motor(name)), "identify").output
    yield "| recording | held out | added | fitted (A) | held out (A) |"
    yield "|---|---|---|---|---|"
    for name, judged, models, _ in ladders(scratch):
        yield ladder_row(name, judged, models)


def main() -> None:
    """Print the report."""
    if not folder().is_dir():
        raise SystemExit("the recordings are not there: set PUMAID_REAL_DATA to their folder")
    with TemporaryDirectory() as scratch:
        for line in report(Path(scratch)):
            sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
