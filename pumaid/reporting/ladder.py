"""The error ladder as tables and as one document: what each model added, and the error after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pumaid.records import JointFit
from pumaid.reporting.grid import Cell, Grid, grid
from pumaid.reporting.numbers import amperes
from pumaid.reporting.scores import amount
from pumaid.results.history import Errors, History, Ladder, Rung
from pumaid.robot import EffectChoice

#: The mark of the model that other commands use now.
CURRENT = "*"


def step(rung: Rung) -> list[str]:
    """What a model adds (``+ stribeck@3``) and takes away, a phrase each."""
    if rung.parent is None:
        return ["base model", *(f"+ {name}" for name in names(rung.effects, len(rung.joints)))]
    n_joints = len(rung.joints)
    changes = [f"+ {name}" for name in names(rung.added, n_joints)]
    changes += [f"− {name}" for name in names(rung.removed, n_joints)]
    return changes or ["fitted again"]


def names(effects: Sequence[EffectChoice], n_joints: int) -> list[str]:
    """Effects as the command line writes them, one word a kind: ``stribeck@1,3``, ``spring@all``, ``tilt``."""
    joints: dict[str, list[int | None]] = {}
    for choice in effects:
        joints.setdefault(choice.effect, []).append(choice.joint)
    return [f"{effect}{_at(found, n_joints)}" for effect, found in joints.items()]


def _at(joints: Sequence[int | None], n_joints: int) -> str:
    numbers = sorted(joint for joint in joints if joint is not None)
    if not numbers:
        return ""
    whole = n_joints > 1 and numbers == list(range(1, n_joints + 1))
    return "@all" if whole else f"@{','.join(map(str, numbers))}"


def of_joint(fit: JointFit) -> Errors:
    """The errors of one joint."""
    return Errors(fit.rmse, fit.heldout, fit.noise_floor)


def has_heldout(ladder: Ladder) -> bool:
    """Whether any joint of any model was judged on held-out runs."""
    return any(of_joint(fit).heldout is not None for rung in ladder.rungs for fit in rung.joints)


def ladder_sentence(ladder: Ladder) -> str:
    """How far the error came, and what is left."""
    path = ladder.path
    first, last = path[0].whole, path[-1].whole
    if len(path) == 1:
        words = f"The current model is a first one; {len(ladder.rungs) - 1} more were tried."
    else:
        steps = "one step" if len(path) == 2 else f"{len(path) - 1} steps"
        words = f"In {steps} the error of the fitted runs went from {amperes(first.fitted)} to {amperes(last.fitted)}"
        if first.heldout is not None and last.heldout is not None:
            words += f", that of runs which no fit saw from {amperes(first.heldout)} to {amperes(last.heldout)}"
        words += "."
    if last.noise_floor is not None:
        words += f" Repeated runs differ by {amperes(last.noise_floor)}, which no model can remove."
    return words


def ladder_grid(ladder: Ladder) -> Grid:
    """One row a model: what it adds to the one it was made from, and the whole arm's errors after."""
    with_heldout = has_heldout(ladder)
    rows: list[list[str | Cell]] = []
    for rung in ladder.rungs:
        row: list[str | Cell] = [
            Cell(str(rung.number), mark=CURRENT if rung.is_current else ""),
            "" if rung.parent is None else str(rung.parent),
            ", ".join(step(rung)),
            amount(rung.whole.fitted),
        ]
        row += [amount(rung.whole.heldout)] if with_heldout else []
        rows.append([*row, amount(rung.whole.noise_floor), _times(rung.whole)])
    header = ["model", "from", "what changed", "fitted (A)"] + (["held out (A)"] if with_heldout else [])
    caption = (
        "RMSE of the whole arm, joints weighed by their fitted samples. Noise floor: repeated runs differ by as much."
    )
    if not with_heldout:
        caption += " No run was held out, so nothing shows what the models are worth on runs that no fit saw."
    has_current = any(rung.is_current for rung in ladder.rungs)
    if ladder.apart:
        caption = f"Not to be compared with the models above: {ladder.apart}. {caption}"
    return grid(
        f"{ladder.robot}: error after each addition",
        [*header, "noise floor (A)", "fitted / floor"],
        rows,
        notes=((CURRENT, "the current model, results/model.json"),) if has_current else (),
        caption=caption,
        lefts=(0, 1, 2),
    )


def _times(errors: Errors) -> Cell:
    if errors.fitted is None or not errors.noise_floor:
        return Cell("-", tone="absent")
    return Cell(f"{errors.fitted / errors.noise_floor:.2f}")


def joint_grids(ladder: Ladder) -> list[Grid]:
    """One row a joint, one column a model: errors of fitted runs, and of held-out ones where there are some."""
    parts = [("fitted", "Fitted runs: RMSE (A) by joint and model")]
    parts += [("heldout", "Held-out runs: RMSE (A) by joint and model")] if has_heldout(ladder) else []
    header = ["joint", *(str(rung.number) for rung in ladder.rungs), "noise floor (A)"]
    last = ladder.rungs[-1].joints
    return [
        grid(
            title,
            header,
            [
                [
                    str(fit.joint),
                    *(amount(getattr(of_joint(rung.joints[place]), name)) for rung in ladder.rungs),
                    amount(fit.noise_floor),
                ]
                for place, fit in enumerate(last)
            ],
        )
        for name, title in parts
    ]


def history_document(history: History) -> dict[str, Any]:
    """The entries of a history's JSON document after its heading; SI."""
    return {
        "folder": history.folder,
        "current": history.current,
        "ladders": [_ladder_document(ladder) for ladder in history.ladders],
        "notes": history.notes,
    }


def _ladder_document(ladder: Ladder) -> dict[str, Any]:
    return {
        "robot": ladder.robot,
        "recipe": ladder.recipe,
        "logs": ladder.logs,
        "apart": ladder.apart or None,
        "path": [rung.number for rung in ladder.path],
        "models": [_rung_document(rung) for rung in ladder.rungs],
    }


def _rung_document(rung: Rung) -> dict[str, Any]:
    return {
        "model": rung.number,
        "file": rung.file,
        "sha256": rung.digest,
        "from": rung.parent,
        "current": rung.is_current,
        "effects": rung.effects,
        "added": rung.added,
        "removed": rung.removed,
        "rmse": rung.whole.fitted,
        "heldout": rung.whole.heldout,
        "noise_floor": rung.whole.noise_floor,
        "joints": [
            {
                "joint": fit.joint,
                "runs": fit.runs,
                "samples": fit.samples,
                "rmse": fit.rmse,
                "heldout": of_joint(fit).heldout,
                "heldout_runs": fit.heldout_runs,
                "noise_floor": fit.noise_floor,
            }
            for fit in rung.joints
        ],
    }
