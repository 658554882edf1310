"""Print every number of docs/validation.md on public recordings: ``python tools/real_data.py``.

The recordings are looked for where ``PUMAID_REAL_DATA`` points, else in ``shared/data`` beside the checkout.
"""

from __future__ import annotations

import math
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from recordings import (
    experiment,
    folder,
    gen3_single,
    gen3_together,
    ladder,
    motor,
    parameters,
    run,
    tx40,
    ur3e,
    ur3e_halves,
)

#: Recordings of the bare motor at one voltage, and at about one controlled speed.
ROLLING = ("rolling_data", "rolling_data1", "rolling_data2")
SPEED = ("speed_test", "speed_test1", "speed_test_old")


def ladders(scratch: Path) -> Iterator[tuple[str, str, list[dict[str, Any]], dict[str, Any]]]:
    """Recording, what was held out, the models of ``diagnose --apply``, and the diagnosis of the base model."""
    for judged in ("first", "second"):
        place = ur3e_halves(scratch / f"ur3e_{judged}")
        yield ("UR3e", f"{judged} half", *ladder(place, [place / "logs" / f"{judged}.parquet"]))
    for names in (ROLLING, SPEED):
        for judged in names:
            place = experiment(scratch / f"motor_{judged}", "motor", motor(*names))
            yield ("bare motor", judged, *ladder(place, [place / "logs" / f"{judged}.parquet"]))
    place = experiment(scratch / "gen3_ladder", "kinova_gen3", gen3_single())
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


def identified(title: str, place: Path) -> Iterator[str]:
    """What identify tells of an experiment: values, combinations, or the refusal."""
    code, model, errors = run(place, "identify")
    yield title
    if code:
        yield from (f"  {line}" for line in errors.splitlines() if line.startswith("error["))
        return
    for name, value in parameters(model).items():
        if value["state"] == "identified":
            yield f"  {name} = {value['value']:.4f} +- {value['std_error']:.4f} {value['unit']}"
    for entry in model["combinations"]:
        yield f"  {entry['text']} = {entry['value']:.4f} +- {entry['std_error']:.4f} {entry['unit']}"
    for joint in model["joints"]:
        if joint["runs"]:
            yield f"  joint {joint['joint']}: RMSE {joint['rmse']:.4f} A, noise floor {joint['noise_floor']}"


def outside(comparison: dict[str, Any]) -> dict[int, float]:
    """RMSE (A) by joint outside runs, of a comparison document."""
    squares: dict[int, float] = {}
    samples: dict[int, int] = {}
    for part in comparison["outside"]:
        squares[part["joint"]] = squares.get(part["joint"], 0.0) + part["samples"] * part["rmse"] ** 2
        samples[part["joint"]] = samples.get(part["joint"], 0) + part["samples"]
    return {joint: math.sqrt(square / samples[joint]) for joint, square in sorted(squares.items())}


def report(scratch: Path) -> Iterator[str]:
    """The whole report, line by line."""
    yield from identified("UR3e", experiment(scratch / "ur3e", "ur3e", ur3e()))
    gen3 = experiment(scratch / "gen3", "kinova_gen3", gen3_single())
    yield from identified("Gen3", gen3)
    together = experiment(scratch / "together", "kinova_gen3", gen3_together())
    shutil.copytree(gen3 / "results", together / "results")
    _, score, _ = run(together, "compare")
    yield "  all joints moving at once: " + ", ".join(f"joint {k} {rms:.3f} A" for k, rms in outside(score).items())
    pendulum = sorted((folder() / "dfki-double-pendulum-a0").glob("*.parquet"))
    yield from identified("double pendulum", experiment(scratch / "dfki", "pendulum2", pendulum))
    yield from identified("TX40", tx40(scratch / "tx40"))
    for name in ROLLING:
        yield from identified(f"bare motor, {name}", experiment(scratch / name, "motor", motor(name)))
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
