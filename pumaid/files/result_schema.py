"""What a model file must hold for this program to use it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

Number = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0)]
Joint = Annotated[int, Field(ge=1)]
Row = list[Number | None]


class _Strict(BaseModel):
    """Entries that are not named pass: a later version of the same format may have more."""

    model_config = ConfigDict(strict=True, extra="ignore")


class _Value(_Strict):
    name: str
    symbol: str
    joint: Joint | None = None
    unit: str
    value: Number | None
    std_error: Number | None
    ci95: Annotated[list[Number], Field(min_length=2, max_length=2)] | None
    dof: Number | None = None
    state: Literal["identified", "given", "not_identifiable"]
    reason: str | None
    next_run: str | None = None


class _JointFit(_Strict):
    joint: Joint
    runs: Count
    samples: Count
    rmse: Number | None
    noise_floor: Number | None
    noise_floor_reason: str | None = None
    run_level: Number | None = None
    posture_groups: Count = 0
    kinds: dict[str, Count] = {}
    heldout_runs: Count = 0
    heldout: Number | None = None
    parameters: list[_Value]


class _Effect(_Strict):
    effect: str
    joint: Joint | None
    shape: dict[str, Number]


class _Combination(_Strict):
    terms: dict[str, Number]
    value: Number
    std_error: Number
    unit: str
    text: str


class _Note(_Strict):
    note: str
    text: str
    where: dict[str, str | int]


class _Recipe(_Strict):
    file: str
    sha256: str


class _Posture(_Strict):
    joint: Joint
    hold: Row


class _Prediction(_Strict):
    names: list[str]
    solution: list[Number]
    covariance: list[Row]
    scales: list[Row]
    blind: list[list[Number]]
    stroke_postures: list[_Posture]
    order: list[str]


class _Model(_Strict):
    pumaid: str
    robot: str
    recipe: _Recipe
    logs: dict[str, str]
    method: Literal["joint", "recursive"]
    effects: list[_Effect]
    joints: Annotated[list[_JointFit], Field(min_length=1)]
    arm: list[_Value]
    ratios: list[_Value]
    combinations: list[_Combination]
    recursive: list[_Value]
    notes: list[_Note]
    heldout: Number | None = None
    prediction: _Prediction


def checked(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Faults of a model document.

    Parameters
    ----------
    document
        As parsed from JSON; kind and format are already right.

    Returns
    -------
    faults
        Path inside the document and what is wrong there; empty where it can be used.
    """
    try:
        model = _Model.model_validate(dict(document))
    except ValidationError as refused:
        return [(_path(error["loc"]), _said(error["msg"], error["input"])) for error in refused.errors()]
    return list(_misfits(model))


def _path(steps: tuple[int | str, ...]) -> str:
    """``("joints", 0, "rmse")`` -> ``joints[0].rmse``, as the JSON file counts."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).lstrip(".")


def _said(message: str, found: Any) -> str:
    if message == "Field required":
        return "an entry is missing"
    return f"{message[0].lower()}{message[1:]}, found {str(found)[:40]!r}"


def _misfits(model: _Model) -> Iterator[tuple[str, str]]:
    """Entries that are well formed and do not fit each other."""
    inner, p, n_joints = model.prediction, len(model.prediction.names), len(model.joints)
    numbers = [fit.joint for fit in model.joints]
    if numbers != list(range(1, n_joints + 1)):
        yield "joints", f"joints are numbered {numbers}, not 1 to {n_joints}"
    names = [value.name for fit in model.joints for value in fit.parameters]
    names += [value.name for value in (*model.arm, *model.ratios)]
    for name, count in Counter(names).items():
        if count > 1:
            yield "joints", f"parameter {name} stands there {count} times"
    if Counter(inner.order) != Counter(names):
        yield "prediction.order", f"it does not name the {len(names)} parameters and ratios"
    shapes = {"covariance": (inner.covariance, p, p), "scales": (inner.scales, n_joints, n_joints)}
    if len(inner.solution) != p:
        yield "prediction.solution", f"it has {len(inner.solution)} values for {p} names"
    for entry, (rows, height, width) in shapes.items():
        widths = {len(row) for row in rows}
        if len(rows) != height or widths - {width}:
            yield f"prediction.{entry}", f"it has {len(rows)} rows of {sorted(widths)}, not {height} of {width}"
    if len(inner.blind) != p or len({len(row) for row in inner.blind}) > 1:
        yield "prediction.blind", f"it has {len(inner.blind)} rows, or rows of different length, for {p} names"
