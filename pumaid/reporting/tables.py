"""Tables of a model, a comparison, a diagnosis and a history, and what the terminal shows of the last three."""

from collections.abc import Sequence

import numpy as np

from pumaid.effects import catalogue
from pumaid.effects.curve import spoken_form
from pumaid.estimate import IDENTIFIED, Estimate, JointResult, Value
from pumaid.estimation.evaluate import Comparison
from pumaid.reporting.table import Cell, Row, Table
from pumaid.reporting.text import (
    BUDGET_CAPTION,
    BUDGET_LIMITS,
    by_joint,
    changes,
    in_unit,
    is_above_floor,
    is_noise_only,
    is_structural,
    joint_label,
    listed,
    part_share,
    part_text,
    percent,
    posture_text,
    relative_names,
    run_time,
    with_error,
)
from pumaid.results.history import Ladder
from pumaid.robot import Robot
from pumaid.units import number

#: Field of a joint's noise -> its heading and what it is; that of blocks where no run is repeated.
NOISES = {
    "noise_floor": ("noise floor (A)", "Noise floor: from the differences of repeated runs."),
    "noise_inside": ("fast noise (A)", "Fast noise: what comes and goes within 0.1 s, in blocks of motion."),
}
#: Row of the paper's Table I (effect, parameter) -> label, label in LaTeX; rows of other effects follow.
LABELS = {
    ("gravity", "x"): ("k_x·g", r"$k^*_x\,g$"),
    ("gravity", "y"): ("k_y·g", r"$k^*_y\,g$"),
    ("gravity", "mass"): ("m·g", r"$\hat m^*\,g$"),
    ("gain_ratio", ""): ("ηᵢ/ηᵢ₊₁", r"$\eta_i/\eta_{i+1}$"),
    **{
        ("gain_ratio", str(step)): (f"ηᵢ/ηᵢ₊{digit}", rf"$\eta_i/\eta_{{i+{step}}}$")
        for step, digit in enumerate("₂₃₄₅₆₇₈₉", 2)
    },
    ("torque_constant", ""): ("K", r"$K$"),
    ("coulomb", "plus"): ("λ₁⁺", r"$\lambda_{1+}$"),
    ("coulomb", "minus"): ("λ₁⁻", r"$\lambda_{1-}$"),
    ("viscous", "plus"): ("λ₂⁺", r"$\lambda_{2+}$"),
    ("viscous", "minus"): ("λ₂⁻", r"$\lambda_{2-}$"),
    ("inertia", "J"): ("J", r"$J$"),
}
_ORDER = list(LABELS)

#: A mean error below this share of the RMSE is written as 0.
NO_BIAS = 1e-4
#: Terms of a combination below this share of its largest are left out.
SMALLEST_TERM = 1e-3

NONE = Cell("-", tone="absent")

#: Characters of a bar that is the whole residual; what fills it for noise and for a significant part.
BUDGET_BAR, NOISE, SIGNIFICANT = 20, "░", "█"


def amount(value: float | None, tone: str = "", *, beside: float | None = None) -> Cell:
    """A current (A) as a cell; 0 where it is round-off `beside` another one."""
    is_rounding = value is not None and abs(value) < NO_BIAS * (beside or 0.0)
    return NONE if value is None else Cell("0" if is_rounding else number(value, 3), tone=tone)


def marked(marks: dict[str, str], text: str | None) -> str:
    """The letters (a, b, ... z, aa, bb, ...) of the note `text` below a table, which `marks` maps; none for no text."""
    count = len(marks)
    return marks.setdefault(text, chr(ord("a") + count % 26) * (count // 26 + 1)) if text else ""


def notes_of(marks: dict[str, str]) -> list[tuple[str, str]]:
    """(letter, text) pairs."""
    return [(letter, text) for text, letter in marks.items()]


# A model


def parameter_table(estimate: Estimate, robot: Robot, units: str = "rad") -> Table:
    """The parameters with links as columns, as in the paper's Table I, and one of the whole arm's where it has some.

    Angles are in `units` (``rad`` or ``deg``).
    """
    rows: dict[tuple[str, str], dict[int, Value]] = {}
    for value in estimate.values:
        rows.setdefault(row_of(value), {})[value.joint or 0] = value
    columns = [*range(1, robot.n_joints + 1), *([0] if any(0 in values for values in rows.values()) else [])]
    marks, structural = dict[str, str](), dict[str, str]()
    gravity = float(np.linalg.norm(robot.gravity))
    unseen = {
        key
        for key, values in rows.items()
        if key[0] in ("inertia", "rotor") and key[1] != "J" and all(value.value is None for value in values.values())
    }
    body: list[Row] = []
    for key in sorted(rows.keys() - unseen, key=lambda key: (_ORDER.index(key) if key in LABELS else len(_ORDER), key)):
        scale = gravity if key[0] == "gravity" else 1.0
        names = ["A" if key[0] == "gravity" else in_unit(value.unit, units)[1] for value in rows[key].values()]
        unit = " | ".join(dict.fromkeys(name for name in names if name))
        text, tex = LABELS.get(key, (" ".join(key).strip(), ""))
        head = Cell(f"{text} ({unit})" if unit else text, latex=f"{tex} ({unit})" if tex and unit else tex)
        body.append([head, *(_value_cell(rows[key].get(n), units, marks, scale=scale) for n in columns)])
        structural |= {value.reason or "": "-" for value in rows[key].values() if is_structural(value)}
    blank = [""] * (len(columns) - robot.n_joints)
    noise = _noise_shown(estimate.joints)
    body += [
        ["RMSE (A)", *(amount(fit.rmse) for fit in estimate.joints), *blank],
        [NOISES[noise][0], *(amount(getattr(fit, noise)) for fit in estimate.joints), *blank],
        ["runs", *(str(fit.runs) for fit in estimate.joints), *blank],
    ]
    extra = dict.fromkeys(effect for effect, name in rows if (effect, name) not in {*LABELS, *unseen})
    titles = {effect: catalogue()[effect].title for effect in extra if effect in catalogue()}
    for choice in estimate.effects:
        if catalogue()[choice.effect].is_free and choice.effect in titles:
            titles[choice.effect] += f", at joint {choice.joint} {spoken_form(choice.shape)}"
    if "inertia" in titles and ("inertia", "J") not in rows:
        titles["inertia"] = "base parameters of the rigid body"
    legend = [
        f"g = {number(gravity, 6)} m/s2",
        *(f"{effect}: {title}" for effect, title in titles.items()),
        *(["n/i: not identifiable from these logs"] if marks else []),
        *([f"{len(unseen)} rows of inertia without any number are left out"] if unseen else []),
    ]
    caption = f"In units of each joint's motor current. {'; '.join(legend)}."
    return Table(
        f"{robot.name}: parameters ± standard error",
        ["link", *(str(column or "arm") for column in columns)],
        body,
        [*notes_of(marks), *((mark, reason) for reason, mark in structural.items())],
        caption,
    )


def row_of(value: Value) -> tuple[str, str]:
    """Row of the parameter table in which a value stands: effect and parameter."""
    parts = value.name.split(".")
    if parts[0] != "gain_ratio":
        return parts[0], "" if parts[0] in ("rotor", "torque_constant") else parts[-1]
    step = int(parts[2]) - int(parts[1])
    return parts[0], "" if step == 1 else str(step)


def _value_cell(value: Value | None, units: str, marks: dict[str, str], *, scale: float = 1.0) -> Cell:
    if value is None or (value.value is None and is_structural(value)):
        return NONE
    if value.value is None:
        reason = value.reason or "these data do not determine it"
        remedy = f". To identify it: {value.next_run}" if value.next_run else ""
        return Cell("n/i", mark=marked(marks, reason.rstrip(".") + remedy), tone="unknown")
    scale *= in_unit(value.unit, units)[0]
    text, error = with_error(value.value * scale, None if value.std_error is None else value.std_error * scale)
    is_weak = value.state == IDENTIFIED and value.ci95 is not None and value.ci95[0] < 0.0 < value.ci95[1]
    return Cell(text, error, tone="weak" if is_weak else "")


def combination_table(estimate: Estimate) -> Table | None:
    """Linear combinations that are identified although their terms are not; None where there is none."""
    rows: list[Row] = []
    for combination in estimate.combinations:
        largest = max(map(abs, combination.terms.values()), default=0.0)
        terms = {name: weight for name, weight in combination.terms.items() if abs(weight) >= SMALLEST_TERM * largest}
        words = " ".join(f"{'−' if x < 0 else '+'} {number(abs(x), 4)}·{name}" for name, x in terms.items())
        value = Cell(*with_error(combination.value, combination.std_error))
        rows.append([combination.text, words.removeprefix("+ "), value, combination.unit])
    return (
        Table(
            "Identified combinations of parameters",
            ("meaning", "combination", "value", "unit"),
            rows,
            caption=f"Weights in SI units; those below {SMALLEST_TERM:g} of the largest are left out.",
            words=(0, 1, 3),
        )
        if rows
        else None
    )


# A comparison


def comparison_table(comparison: Comparison, robot: Robot) -> Table:
    """The model's error by joint, against the noise floor."""
    noise = _noise_shown(comparison.joints)
    rows: list[Row] = []
    for score in comparison.joints:
        tone = "alarm" if is_above_floor(score.rmse, score.noise_floor) else ""
        head: Row = [joint_label(robot, score.joint), str(score.runs), amount(score.rmse, tone)]
        explained = NONE if score.explained is None else percent(score.explained)
        floor, bias = amount(getattr(score, noise)), amount(score.bias, beside=score.rmse)
        rows.append([*head, floor, bias, explained, amount(score.heldout)])
    if comparison.rmse is not None:
        runs = str(sum(score.runs for score in comparison.joints))
        rows.append(["all", runs, amount(comparison.rmse), "", "", "", amount(comparison.heldout)])
    still = "never moves alone in these logs"
    unknown = [(score.joint, score.noise_floor_reason if score.runs else still) for score in comparison.joints]
    texts = [(joint, text) for joint, text in unknown if text]
    notes = [("-", text) for text in by_joint(texts, robot, count=len(comparison.joints))]
    caption = (
        f"{NOISES[noise][1]} Explained: share of the current's variance. Hold-out: RMSE of runs that were not fitted."
    )
    return Table(
        "Model against measurement",
        ["joint", "runs", "RMSE (A)", NOISES[noise][0], "bias (A)", "explained", "hold-out (A)"],
        rows,
        notes,
        caption,
    )


def _noise_shown(joints: Sequence[JointResult]) -> str:
    is_known = all(joint.noise_inside is None or joint.noise_floor is not None for joint in joints)
    return "noise_floor" if is_known else "noise_inside"


def worst_runs_table(comparison: Comparison, robot: Robot, *, count: int = 5, units: str = "rad") -> Table:
    """The `count` runs with the largest error, with file and seconds."""
    marks: dict[str, str] = {}
    rows: list[Row] = []
    worst = comparison.worst(count)
    names = relative_names([score.run.origin for score in worst])
    for rank, score in enumerate(worst, start=1):
        run, mark = score.run, marked(marks, score.reason)
        scale, unit = in_unit(f"{robot.joint(run.joint).position_unit}/s", units)
        where = [
            joint_label(robot, run.joint),
            names[run.origin],
            run_time(run),
            f"{number(run.speed * scale, 3)} {unit}",
        ]
        rmse = Cell(number(score.rmse, 3), mark=mark, tone="unknown" if mark else "")
        posture = posture_text(robot, run.posture.tolist(), units)
        rows.append([str(rank), *where, rmse, amount(score.bias, beside=score.rmse), posture])
    return Table(
        "Runs with the largest error",
        ("", "joint", "file", "time (s)", "speed", "RMSE (A)", "bias (A)", "other joints at"),
        rows,
        notes_of(marks),
        "Sorted by RMSE relative to the joint's noise floor.",
        (0, 1, 2, 3, 7),
    )


def budget_table(comparison: Comparison, robot: Robot) -> Table | None:
    """Parts of each joint's residual, significant ones first; below, what is noise and what the runs cannot separate.

    None where no joint has runs.
    """
    joints = {score.joint: score.budget for score in comparison.joints if score.budget is not None}
    rows: list[Row] = []
    loud = {joint: budget for joint, budget in joints.items() if not is_noise_only(budget)}
    for joint, budget in loud.items():
        parts = [part for part in budget.parts if part.mean_square > 0.0]
        parts.sort(key=lambda part: (not part.is_more, -part.mean_square))
        for part in parts:
            share, head = part_share(budget, part), joint_label(robot, joint) if part is parts[0] else ""
            bar = (SIGNIFICANT if part.is_more else NOISE) * max(round(BUDGET_BAR * share), 1)
            words = [part_text(budget, part), listed(part.points_to if part.is_more else [], "or")]
            rows.append([head, f"{100.0 * share:.1f} %", bar, *words])
    texts = [(joint, "the residual is noise, as far as these runs can show") for joint in joints if joint not in loud]
    texts += [(joint, text) for slug, text in BUDGET_LIMITS.items() for joint in joints if slug in joints[joint].limits]
    notes = [("-", text) for text in by_joint(texts, robot, count=len(joints))]
    header = ("joint", "share", "", "part", "effects with this pattern")
    return (
        Table("Residual budget", header, rows, notes, BUDGET_CAPTION if rows else "", (0, 2, 3, 4)) if joints else None
    )


# The history of models


def history_table(ladder: Ladder) -> Table:
    """One row a model: what it adds to the one it was made from, and the whole arm's errors."""
    rows: list[Row] = []
    for rung in ladder.rungs:
        rmse, heldout, floor = rung.whole.values()
        ratio = Cell(f"{rmse / floor:.2f}") if rmse is not None and floor else NONE
        head: Row = [Cell(str(rung.number), mark="*" if rung.is_current else ""), str(rung.parent or "")]
        rows.append([*head, ", ".join(changes(rung)), *map(amount, (rmse, heldout, floor)), ratio])
    apart = f"Not comparable with the models above: {ladder.apart}. " if ladder.apart else ""
    caption = f"{apart}RMSE of the whole arm's fitted runs. Noise floor: from the differences of repeated runs."
    if all(fit.heldout is None for rung in ladder.rungs for fit in rung.estimate.joints):
        caption += " No run was held out, so nothing shows how the models do on new runs."
    return Table(
        f"{ladder.robot}: error of each model",
        ("model", "from", "change", "RMSE (A)", "hold-out (A)", "noise floor (A)", "RMSE / floor"),
        rows,
        [("*", "current model, results/model.json")] if any(rung.is_current for rung in ladder.rungs) else [],
        caption,
        (0, 1, 2),
    )
