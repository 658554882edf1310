"""Records for other programs: entries of JSON documents, and tables of numbers; SI, angles in rad where not stated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pumaid.dataset import Dataset, Reject, Run
from pumaid.estimate import Estimate
from pumaid.estimation.evaluate import TOGETHER, Budget, Comparison
from pumaid.reporting.run_tables import by_reason, samples_read
from pumaid.reporting.text import BUDGET_LIMITS, in_unit, part_share, part_text
from pumaid.results.documents import plain
from pumaid.results.history import History
from pumaid.robot import Robot

if TYPE_CHECKING:
    import pandas as pd

#: Entry of a run -> column of tables of runs; for prismatic joints m stands in place of rad.
RUN_COLUMNS = {
    **{name: name for name in ("run", "file", "last_file", "first_row", "last_row", "joint", "name", "kind")},
    "start": "start_s",
    "duration": "duration_s",
    "speed": "speed_rad_s",
    "ripple": "ripple_rad_s",
    "samples": "samples",
    "temperature": "temperature_degC",
    "heldout": "heldout",
}


def _entries(record: object, names: str) -> dict[str, Any]:
    return {name: getattr(record, name) for name in names.split()}


# Runs


def segments_document(dataset: Dataset, robot: Robot) -> dict[str, Any]:
    """Runs, stretches left out and sums for JSON."""
    return {
        "samples": samples_read(dataset),
        "kept": sum(run.samples for run in dataset.runs),
        "runs": [_run_entry(index, run, robot) for index, run in enumerate(dataset.runs, 1)],
        "left_out": {
            reason: sum(reject.samples for reject in rejects) for reason, rejects in by_reason(dataset.rejects).items()
        },
        "rejects": [
            _entries(reject, "reason text start duration samples joints") | _place(reject) for reject in dataset.rejects
        ],
        "notes": dataset.notes,
    }


def _run_entry(index: int, run: Run, robot: Robot) -> dict[str, Any]:
    return (
        {"run": index, "name": robot.joint(run.joint).name}
        | _place(run)
        | _entries(run, "clock joint kind start duration span speed ripple samples temperature heldout posture")
    )


def _place(record: Run | Reject) -> dict[str, Any]:
    return {"file": record.origin, "last_file": record.origin} | _entries(record, "first_row last_row")


def scores_frame(comparison: Comparison, robot: Robot) -> pd.DataFrame:
    """One row a run in SI, postures in columns ``q1`` to ``qJ``, empty at the moving joint, and how the model does."""
    import pandas as pd

    entries = [plain(_run_entry(index, score.run, robot)) for index, score in enumerate(comparison.runs, 1)]
    frame = pd.DataFrame(
        [[*(entry[name] for name in RUN_COLUMNS), *entry["span"], *entry["posture"]] for entry in entries],
        columns=[*RUN_COLUMNS.values(), "from_rad", "to_rad", *(f"q{joint.number}" for joint in robot.joints)],
    )
    names = {"rmse": "rmse_A", "bias": "bias_A", "largest": "largest_A", "explained": "explained"}
    return frame.assign(
        **{head: [getattr(score, name) for score in comparison.runs] for name, head in names.items()},
        undetermined=[score.undetermined for score in comparison.runs],
    )


# Parameters


def parameters_frame(estimate: Estimate, units: str = "rad") -> pd.DataFrame:
    """One row a parameter, with angles of values and column `unit` in `units` (``rad`` or ``deg``).

    Columns name, symbol, joint, unit, value, std_error, ci_low, ci_high, dof, state, reason, next_run; empty where a
    parameter is not identifiable.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for value in estimate.values:
        scale, unit = in_unit(value.unit, units)
        low, high = value.ci95 if value.ci95 is not None else (None, None)
        amounts = {"value": value.value, "std_error": value.std_error, "ci_low": low, "ci_high": high}
        scaled = {key: None if amount is None else scale * amount for key, amount in amounts.items()}
        rows.append(
            _entries(value, "name symbol joint")
            | {"unit": unit}
            | scaled
            | _entries(value, "dof state reason next_run")
        )
    return pd.DataFrame(rows).astype(
        {**dict.fromkeys(["value", "std_error", "ci_low", "ci_high", "dof"], "float64"), "joint": "Int64"}
    )


# Comparison


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """The entries of a comparison's JSON document after its heading."""
    return {
        "joints": [
            _entries(score, "joint samples rmse bias explained noise_floor noise_floor_reason noise_inside shares")
            | {
                "current_rms": score.rms,
                "not_told_apart": [name.split(TOGETHER) for name in score.shares if TOGETHER in name],
                "heldout": None if score.heldout is None else {"rmse": score.heldout, "runs": score.heldout_runs},
                "undetermined_runs": score.undetermined,
                "budget": None if score.budget is None else budget_document(score.budget),
                "runs": [
                    _entries(item, "rmse bias largest explained undetermined reason")
                    | {"file": run.origin, "rows": [run.first_row, run.last_row], "velocity": run.speed}
                    | _entries(run, "start duration kind posture samples heldout")
                    for item in comparison.of_joint(score.joint)
                    for run in [item.run]
                ],
            }
            for score in comparison.joints
        ],
        "rmse": comparison.rmse,
        "heldout": None if comparison.heldout is None else {"rmse": comparison.heldout},
        "notes": comparison.notes,
    }


def budget_document(budget: Budget) -> dict[str, Any]:
    """A joint's budget in the comparison's JSON document."""
    return _entries(budget, "mean_square noise floor runs replicates") | {
        "parts": [
            _entries(part, "name mean_square p_value against cycles points_to")
            | {
                "share": part_share(budget, part),
                "more_than_noise": part.is_more,
                "cycles_per": part.per or None,
                "cycles_per_motor_turn": part.gearing,
                "text": part_text(budget, part) if part.is_more else None,
            }
            for part in budget.parts
        ],
        "limits": {slug: BUDGET_LIMITS[slug] for slug in budget.limits},
    }


# History


def history_document(history: History) -> dict[str, Any]:
    """The entries of a history's JSON document after its heading."""
    return _entries(history, "folder current notes") | {
        "ladders": [
            _entries(ladder, "robot recipe logs")
            | {
                "apart": ladder.apart or None,
                "path": [rung.number for rung in ladder.path],
                "models": [
                    {"model": rung.number, "sha256": rung.digest, "from": rung.parent, "current": rung.is_current}
                    | {"file": rung.path.name, "effects": rung.estimate.effects}
                    | _entries(rung, "added removed")
                    | rung.whole
                    | {
                        "joints": [
                            _entries(fit, "joint runs samples rmse heldout heldout_runs noise_floor")
                            for fit in rung.estimate.joints
                        ]
                    }
                    for rung in ladder.rungs
                ],
            }
            for ladder in history.ladders
        ]
    }
