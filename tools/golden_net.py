"""The golden net: what commit db27f0f made of 40 experiments, 80 bad inputs and 1000 intervals, and what differs now.

    python tools/golden_net.py inputs  FOLDER --base CHECKOUT        make the inputs with the checkout's own tools
    python tools/golden_net.py freeze  FOLDER --program PUMAID       write tests/golden/net.json
    python tools/golden_net.py compare FOLDER --program PUMAID [--only WORD ...] [--strict]

The inputs come from the virtual worlds and mutations of a frozen checkout, so that they stay what they were. An
estimate may differ by half a standard error, an interval's width by a tenth; states, findings and refusals by nothing.
Without --strict only what no rounding explains counts: a crash, another state, more than a standard error.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HOME = Path(__file__).parents[1]
RECORD = HOME / "tests" / "golden" / "net.json"
REAL = Path(os.environ.get("PUMAID_REAL_DATA") or HOME.parent / "shared" / "data")
#: Effects that are hidden in virtual worlds, a world each, three kinds of arm in turn.
HIDDEN = (
    *("stribeck", "viscous_power", "load_friction", "position_friction", "presliding", "warmup", "friction_step"),
    *("spring", "counterbalance", "ripple", "tilt", "payload", "coupling", "saturation", "zero_offset"),
    *("flexibility", "torque_constant_drift", "side_load_friction", "torque_droop", "thermal_friction", "stribeck"),
)
TABLE1 = 30
SHARE, WIDTH = 0.5, 0.1

MAKER = """
import sys, json, zlib, subprocess
from pathlib import Path
base, out = Path(sys.argv[1]), Path(sys.argv[2])
sys.path[:0] = [str(base / "tools"), str(base / "tests")]
from blind_world.case import Case, drawn
from blind_world.logs import write_experiment
from blind_world.hidden import Unfit
from blind_world.world import sensed
kinds = ("puma", "ur", "stanford")
cases = [Case("clean", (), kinds[k % 3], 0.0, k, 7) for k in range(12)]
cases += [Case("thin", (), kinds[k % 3], 0.0, k, 7) for k in range(3)]
hidden = json.loads(sys.argv[3])
cases += [Case("effect", (name,), kinds[k % 3], 3.0, k, 7) for k, name in enumerate(hidden)]
for case in cases:
    try:
        experiment = drawn(case)
    except Unfit as why:
        print(case.key, why)
        continue
    name = case.key.replace("/", "-")
    state = sensed(experiment.world, experiment.state, experiment.noise)
    write_experiment(out / "worlds" / name, experiment.world, state)
from faulty import make
from faulty_logs import all_logs
from faulty_recipes import all_recipes
faults = all_logs() + all_recipes()
faults.sort(key=lambda fault: zlib.crc32(f"{fault.kind}{fault.name}".encode()))
names = {}
for number, fault in enumerate(faults[:80]):
    folder = make(out / "bad" / f"{number:02d}")
    fault.change(folder)
    names[f"{number:02d}"] = f"{fault.kind}: {fault.name}"
(out / "bad" / "names.json").write_text(json.dumps(names))
"""


def inputs(options: argparse.Namespace) -> int:
    """Make every input; what is there already is made anew."""
    shutil.rmtree(options.folder, ignore_errors=True)
    options.folder.mkdir(parents=True)
    python = options.base / ".venv" / "bin" / "python"
    made = [str(python), "-c", MAKER, str(options.base), str(options.folder), json.dumps(HIDDEN)]
    subprocess.run(made, check=True, cwd=options.base)
    program = [str(options.base / ".venv" / "bin" / "pumaid")]
    for seed in range(TABLE1):
        folder = options.folder / "table1" / f"{seed:02d}"
        folder.mkdir(parents=True)
        for name in ("recipe.yaml", "plan.yaml"):
            shutil.copy(options.base / "sample_logs" / "puma560" / name, folder)
        words = ["simulate", "--truth", "table1", "--seed", str(500 + seed), "--rate", "25"]
        subprocess.run([*program, *words], cwd=folder, check=True, capture_output=True)
    for name in ("puma560", "pendulum"):
        shutil.copytree(options.base / "sample_logs" / name, options.folder / "samples" / name)
    return real_recordings(options)


def real_recordings(options: argparse.Namespace) -> int:
    """Folders of the public recordings, where they are."""
    script = (
        "import sys; sys.path[:0] = [sys.argv[1]]; from pathlib import Path; from recordings import write_recipe\n"
        "write_recipe(sys.argv[2], Path(sys.argv[3]))"
    )
    wanted = {
        "ur3e": ("ur3e", ["ur3e-aurt/wave_currentData_100v_40a.parquet"]),
        "gen3": ("kinova_gen3", sorted(f"kinova-gen3-jointwise/joint_{k}_trapez.parquet" for k in range(1, 8))),
        "motor": ("motor", ["laas-odri-cogging/speed_test.parquet"]),
    }
    for name, (recipe, files) in wanted.items():
        if not REAL.is_dir():
            continue
        folder = options.folder / "real" / name
        (folder / "logs").mkdir(parents=True)
        python = options.base / ".venv" / "bin" / "python"
        made = [str(python), "-c", script, str(options.base / "tools"), recipe, str(folder)]
        subprocess.run(made, check=True, cwd=options.base)
        (folder / f"{recipe}.yaml").rename(folder / "recipe.yaml")
        for file in files:
            shutil.copy(REAL / file, folder / "logs")
    return 0


def run(program: str, folder: Path, *words: str) -> tuple[int, dict[str, Any], str]:
    """Exit code, JSON document and standard error of a command."""
    done = subprocess.run([program, *words, "--json"], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else {}, done.stderr


def fresh(folder: Path) -> None:
    """Without results of earlier commands."""
    shutil.rmtree(folder / "results", ignore_errors=True)


def experiment(program: str, folder: Path) -> dict[str, Any]:
    """What identify and diagnose make of an experiment."""
    fresh(folder)
    code, model, errors = run(program, folder, "identify", "logs")
    record: dict[str, Any] = {"identify": code, "errors": errors[-300:] if code else ""}
    if code:
        return record
    values = [value for joint in model["joints"] for value in joint["parameters"]] + model["ratios"]
    record["values"] = {
        v["name"]: [v["value"], v["std_error"], v["ci95"], v["state"], bool(v["reason"])] for v in values
    }
    record["runs"] = {str(joint["joint"]): joint["runs"] for joint in model["joints"]}
    record["rmse"] = {str(joint["joint"]): joint["rmse"] for joint in model["joints"]}
    code, told, errors = run(program, folder, "diagnose", "results/model.json", "logs")
    record["diagnose"] = code
    if code == 0:
        record["findings"] = [[f["effect"], f["joint"], f["verdict"]] for f in told["findings"]]
        record["verdicts"] = {str(joint["joint"]): joint["verdict"] for joint in told["joints"]}
    return record


def bad(program: str, folder: Path) -> dict[str, Any]:
    """What becomes of a bad input: refused, by which slug, or numbers with which notes."""
    fresh(folder)
    code, model, errors = run(program, folder, "identify", "logs")
    slugs = sorted({word.split("]")[0] for line in errors.splitlines() for word in line.split("error[")[1:]})
    notes = sorted({line[5 : line.index("]")] for line in errors.splitlines() if line.startswith("note[")})
    record: dict[str, Any] = {"exit": code, "slugs": slugs, "notes": notes, "crash": "Traceback" in errors}
    if code == 0:
        values = [value for joint in model["joints"] for value in joint["parameters"]] + model["ratios"]
        record["values"] = {v["name"]: [v["value"], *v["ci95"]] for v in values if v["state"] == "identified"}
    return record


def covered(program: str, folder: Path) -> dict[str, Any]:
    """Intervals of a virtual Table I that hold the truth."""
    fresh(folder)
    code, model, _ = run(program, folder, "identify", "logs")
    if code:
        return {"identify": code}
    truth = json.loads(next(folder.rglob("truth.json")).read_text())
    known = {**truth["parameters"], **truth.get("ratios", {})} if "parameters" in truth else truth
    values = [value for joint in model["joints"] for value in joint["parameters"]] + model["ratios"]
    told = [v for v in values if v["state"] == "identified" and isinstance(known.get(v["name"]), int | float)]
    held = [v["ci95"][0] <= known[v["name"]] <= v["ci95"][1] for v in told]
    return {"identify": code, "held": sum(held), "told": len(held)}


WORK = {"samples": experiment, "worlds": experiment, "real": experiment, "bad": bad, "table1": covered}


def results(options: argparse.Namespace) -> dict[str, Any]:
    """Every input's record, by name."""
    folders = [path for group in WORK for path in sorted((options.folder / group).glob("*/")) if path.is_dir()]
    names = {path: f"{path.parent.name}/{path.name}" for path in folders}
    chosen = [path for path in folders if not options.only or any(word in names[path] for word in options.only)]
    with ThreadPoolExecutor(options.jobs) as pool:
        records = pool.map(lambda path: WORK[path.parent.name](options.program, path), chosen)
        return {names[path]: record for path, record in zip(chosen, records, strict=True)}


def freeze(options: argparse.Namespace) -> int:
    """Write the record of the program as it stands; with --only, of these inputs anew."""
    frozen = json.loads(RECORD.read_text("utf-8")) if RECORD.is_file() and options.only else {}
    RECORD.write_text(json.dumps(frozen | results(options), indent=0, sort_keys=True) + "\n", encoding="utf-8")
    return 0


def differences(old: dict[str, Any], new: dict[str, Any], *, is_strict: bool) -> list[str]:
    """How an experiment's record differs from the frozen one."""
    share, width = (SHARE, WIDTH) if is_strict else (2 * SHARE, 3 * WIDTH)
    out = [
        f"{key}: {old.get(key)} -> {new.get(key)}" for key in ("identify", "diagnose") if old.get(key) != new.get(key)
    ]
    if out:
        return [*out, new.get("errors", "")]
    for name, (value, error, ends, state, _) in old.get("values", {}).items():
        if name not in new["values"]:
            out.append(f"{name} is gone")
            continue
        other, _, others, state_now, has_reason = new["values"][name]
        if state != state_now:
            out.append(f"{name}: {state} -> {state_now}")
        elif state == "identified":
            if abs(other - value) > share * error + 1e-9 * abs(value):
                out.append(f"{name}: {value:.6g} -> {other:.6g}, {abs(other - value) / max(error, 1e-300):.2f} errors")
            ratio = (others[1] - others[0]) / max(ends[1] - ends[0], 1e-300)
            if abs(ratio - 1.0) > width:
                out.append(f"{name}: interval {ratio:.2f} times as wide")
        elif state == "not_identifiable" and not has_reason:
            out.append(f"{name}: no reason")
    out += [f"{name} is new" for name in new.get("values", {}) if name not in old["values"]]
    for key in ("findings", "verdicts") if is_strict else ("findings",):
        if sorted(map(str, old.get(key, []))) != sorted(map(str, new.get(key, []))):
            out.append(f"{key}: {old[key]} -> {new[key]}")
    return out


def differences_bad(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """How what becomes of a bad input differs: numbers where there was a refusal, a crash, a silent other number."""
    if new["crash"] or new["exit"] not in (0, 3):
        return [f"exit {new['exit']}, crash: {new['crash']}"]
    if old["exit"] != new["exit"]:
        return [f"exit {old['exit']} {old['slugs']} -> {new['exit']} {new['slugs']} {new['notes']}"]
    if new["exit"] == 3:
        return [] if old["slugs"] == new["slugs"] else [f"{old['slugs']} -> {new['slugs']}"]
    shared = old["values"].keys() & new["values"].keys()
    apart = [n for n in shared if not overlapping(old["values"][n], new["values"][n])]
    notes = [] if old["notes"] == new["notes"] else [f"notes {old['notes']} -> {new['notes']}"]
    return [f"{name}: {old['values'][name][0]:.6g} -> {new['values'][name][0]:.6g}" for name in apart] + notes


def overlapping(first: list[float], second: list[float]) -> bool:
    """Whether two intervals (value, low, high) share anything."""
    return first[1] <= second[2] and second[1] <= first[2]


def compare(options: argparse.Namespace) -> int:
    """Print what differs from the frozen record; 1 where something does."""
    frozen, now, count = json.loads(RECORD.read_text("utf-8")), results(options), 0
    held = [sum(record.get(key, 0) for record in now.values()) for key in ("held", "told")]
    for name, record in now.items():
        group = name.split("/")[0]
        if group == "table1":
            continue
        old = frozen[name]
        lines = differences_bad(old, record) if group == "bad" else differences(old, record, is_strict=options.strict)
        count += bool(lines)
        for line in lines:
            print(f"{name}: {line}")
    print(f"{count} of {len(now)} differ; intervals that hold the truth: {held[0]} of {held[1]}")
    return int(count > 0)


def main() -> int:
    """Make inputs, freeze, or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, work in (("inputs", inputs), ("freeze", freeze), ("compare", compare)):
        command = commands.add_parser(name)
        command.add_argument("folder", type=Path)
        command.add_argument("--base", type=Path, help="checkout of the frozen commit, with .venv")
        command.add_argument("--program", default=str(HOME / ".venv" / "bin" / "pumaid"))
        command.add_argument("--only", nargs="*", default=[])
        command.add_argument("--strict", action="store_true")
        command.add_argument("--jobs", type=int, default=1)
        command.set_defaults(work=work)
    options = parser.parse_args()
    options.folder = options.folder.resolve()
    return int(options.work(options))


if __name__ == "__main__":
    sys.exit(main())
