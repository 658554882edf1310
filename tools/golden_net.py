"""The golden net: what commit db27f0f made of 40 experiments, 80 bad inputs and 1000 intervals, and what differs now.

    python tools/golden_net.py FOLDER --program PUMAID [--only WORD ...] [--strict]

The inputs were made by `golden_net.py inputs` of commit 3354fcb from virtual worlds and mutations of db27f0f. An
estimate may differ by half a standard error, an interval's width by a tenth; states, findings and refusals by nothing.
Without --strict only what no rounding explains counts: a crash, another state, more than a standard error.
"""

import argparse
import json
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HOME = Path(__file__).parents[1]
RECORD = HOME / "tests" / "golden" / "net.json"
SHARE, WIDTH = 0.5, 0.1


def run(program: str, folder: Path, *words: str) -> tuple[int, dict[str, Any], str]:
    """Exit code, JSON document and standard error of a command."""
    done = subprocess.run([program, *words, "--json"], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else {}, done.stderr


def identified(program: str, folder: Path) -> tuple[int, list[dict[str, Any]], dict[str, Any], str]:
    """Exit code, parameters and ratios, model and standard error of identify, without results of earlier commands."""
    shutil.rmtree(folder / "results", ignore_errors=True)
    code, model, errors = run(program, folder, "identify", "logs")
    values = [] if code else [value for joint in model["joints"] for value in joint["parameters"]] + model["ratios"]
    return code, values, model, errors


def experiment(program: str, folder: Path) -> dict[str, Any]:
    """What identify and diagnose make of an experiment."""
    code, values, model, errors = identified(program, folder)
    record: dict[str, Any] = {"identify": code, "errors": errors[-300:] if code else ""}
    if code:
        return record
    entries = ("value", "std_error", "ci95", "state")
    record["values"] = {v["name"]: [*(v[entry] for entry in entries), bool(v["reason"])] for v in values}
    for entry in ("runs", "rmse"):
        record[entry] = {str(joint["joint"]): joint[entry] for joint in model["joints"]}
    code, diagnosis, errors = run(program, folder, "diagnose", "results/model.json", "logs")
    record["diagnose"] = code
    if code == 0:
        record["findings"] = [[f["effect"], f["joint"], f["verdict"]] for f in diagnosis["findings"]]
        record["verdicts"] = {str(joint["joint"]): joint["verdict"] for joint in diagnosis["joints"]}
    return record


def bad(program: str, folder: Path) -> dict[str, Any]:
    """What becomes of a bad input: refused, by which slug, or numbers with which notes."""
    code, values, _, errors = identified(program, folder)
    slugs = sorted({word.split("]")[0] for line in errors.splitlines() for word in line.split("error[")[1:]})
    notes = sorted({line[5 : line.index("]")] for line in errors.splitlines() if line.startswith("note[")})
    record: dict[str, Any] = {"exit": code, "slugs": slugs, "notes": notes, "crash": "Traceback" in errors}
    if code == 0:
        record["values"] = {v["name"]: [v["value"], *v["ci95"]] for v in values if v["state"] == "identified"}
    return record


def covered(program: str, folder: Path) -> dict[str, Any]:
    """Intervals of a virtual Table I that hold the truth."""
    code, values, _, _ = identified(program, folder)
    if code:
        return {"identify": code}
    truth = json.loads(next(folder.rglob("truth.json")).read_text())
    exact = {**truth["parameters"], **truth.get("ratios", {})} if "parameters" in truth else truth
    judged = [v for v in values if v["state"] == "identified" and isinstance(exact.get(v["name"]), int | float)]
    held = [v["ci95"][0] <= exact[v["name"]] <= v["ci95"][1] for v in judged]
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


def main() -> int:
    """Print what differs from the frozen record; 1 where something does."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=lambda text: Path(text).resolve())
    parser.add_argument("--program", default=str(HOME / ".venv" / "bin" / "pumaid"))
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--strict", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
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


if __name__ == "__main__":
    sys.exit(main())
