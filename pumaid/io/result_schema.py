"""What a model file must hold for this program to use it."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

Floats = NDArray[np.float64]
Faults = Iterator[tuple[str, str]]

#: Beyond all that is measured; the fourth power of it is a number still.
LARGEST = 1e60
#: Share by which numbers may differ that the program wrote as one.
_ROUNDING = 1e-9
#: The same of a covariance across its diagonal, as a share of the errors: sums in other orders.
_LOPSIDED = 1e-6
_RATIO = re.compile(r"gain_ratio\.([1-9]\d{0,3})\.([1-9]\d{0,3})")

Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Size = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=LARGEST)]
Count = Annotated[int, Field(ge=0, le=1 << 53)]
Joint = Annotated[int, Field(ge=1, le=1 << 53)]
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
    std_error: Size | None
    ci95: Annotated[list[Number], Field(min_length=2, max_length=2)] | None
    dof: Size | None = None
    state: Literal["identified", "given", "not_identifiable"]
    reason: str | None
    next_run: str | None = None


class _JointFit(_Strict):
    joint: Joint
    runs: Count
    samples: Count
    rmse: Size | None
    noise_floor: Size | None
    noise_floor_reason: str | None = None
    run_level: Size | None = None
    posture_groups: Count = 0
    kinds: dict[str, Count] = {}
    heldout_runs: Count = 0
    heldout: Size | None = None
    parameters: list[_Value]


class _Effect(_Strict):
    effect: str
    joint: Joint | None
    shape: dict[str, Number]


class _Combination(_Strict):
    terms: dict[str, Number]
    value: Number
    std_error: Size
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
    hold: list[Number]


class _Prediction(_Strict):
    names: list[str]
    solution: list[Number]
    covariance: list[list[Number]]
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
    heldout: Size | None = None
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
    short = re.sub(r"\d{20,}", lambda digits: f"{float(digits[0]):g}", message)
    return f"{short[0].lower()}{short[1:]}, found {str(found)[:40]!r}"


def _misfits(model: _Model) -> Faults:
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
    yield from _of_joints(model)
    for at, values in _all_values(model):
        for number, value in enumerate(values):
            yield from ((f"{at}[{number}]{entry}", what) for entry, what in _of_value(value, n_joints))
    for number, ratio in enumerate(model.ratios):
        if _pair(ratio.name, n_joints) is None:
            yield f"ratios[{number}].name", f"{ratio.name} names no two of the {n_joints} joints"
    shapes: dict[str, tuple[Sequence[Row], int, int]] = {
        "covariance": ([[*row] for row in inner.covariance], p, p),
        "scales": (inner.scales, n_joints, n_joints),
    }
    if len(inner.solution) != p:
        yield "prediction.solution", f"it has {len(inner.solution)} values for {p} names"
        return
    for entry, (rows, height, width) in shapes.items():
        widths = {len(row) for row in rows}
        if len(rows) != height or widths - {width}:
            yield f"prediction.{entry}", f"it has {len(rows)} rows of {sorted(widths)}, not {height} of {width}"
            return
    if len(inner.blind) != p or len({len(row) for row in inner.blind}) > 1:
        yield "prediction.blind", f"it has {len(inner.blind)} rows, or rows of different length, for {p} names"
    yield from _of_names(model)
    yield from _of_covariance(np.array(inner.covariance, dtype=float).reshape(p, p))
    yield from _of_scales(np.array(inner.scales, dtype=float), model.ratios)


def _of_joints(model: _Model) -> Faults:
    """Effects and postures of joints that the arm does not have."""
    n_joints = len(model.joints)
    for number, choice in enumerate(model.effects):
        if choice.joint is not None and choice.joint > n_joints:
            yield f"effects[{number}].joint", f"there is no joint {choice.joint} in an arm of {n_joints}"
    for number, posture in enumerate(model.prediction.stroke_postures):
        at = f"prediction.stroke_postures[{number}]"
        if posture.joint > n_joints:
            yield f"{at}.joint", f"there is no joint {posture.joint} in an arm of {n_joints}"
        if len(posture.hold) != n_joints:
            yield f"{at}.hold", f"it holds {len(posture.hold)} positions, not {n_joints}"


def _all_values(model: _Model) -> Iterator[tuple[str, Sequence[_Value]]]:
    """Every list of parameters, and its path."""
    for number, fit in enumerate(model.joints):
        yield f"joints[{number}].parameters", fit.parameters
    yield from (("arm", model.arm), ("ratios", model.ratios), ("recursive", model.recursive))


def _of_value(value: _Value, n_joints: int) -> Faults:
    """What one parameter says of itself."""
    if (value.value is None) != (value.state == "not_identifiable"):
        found = "none" if value.value is None else f"{value.value:g}"
        yield ".value", f"{value.name} is {value.state}, and its value is {found}"
    if value.value is None and (value.std_error is not None or value.ci95 is not None):
        yield ".std_error", f"{value.name} has an error and no value"
    if value.ci95 is not None and value.ci95[0] > value.ci95[1]:
        yield ".ci95", f"the interval of {value.name} ends ({value.ci95[1]:g}) before it begins ({value.ci95[0]:g})"
    if value.joint is not None and value.joint > n_joints:
        yield ".joint", f"there is no joint {value.joint} in an arm of {n_joints}"


def _pair(name: str, n_joints: int) -> tuple[int, int] | None:
    """The joints (from 1) of which a ratio of gains is, the inner one first."""
    found = _RATIO.fullmatch(name)
    inner, outer = (int(found[1]), int(found[2])) if found else (0, 0)
    return (inner, outer) if inner < outer <= n_joints else None


def _of_names(model: _Model) -> Faults:
    """What the prediction knows of parameters that are told as well."""
    inner = model.prediction
    told = {value.name: value for fit in model.joints for value in fit.parameters}
    told |= {value.name: value for value in model.arm}
    shapes = {(choice.effect, name) for choice in model.effects for name in choice.shape}
    for name, count in Counter(inner.names).items():
        if count > 1:
            yield "prediction.names", f"{name} stands there {count} times"
        elif name not in told:
            yield "prediction.names", f"{name} is none of the model's parameters"
    for number, (name, size) in enumerate(zip(inner.names, inner.solution, strict=True)):
        value = told.get(name)
        # The column of a shape holds what the fit moves it by, not the shape.
        if value is None or value.value is None or value.state != "identified" or _is_shape(name, shapes):
            continue
        if not math.isclose(value.value, size, rel_tol=_ROUNDING):
            yield f"prediction.solution[{number}]", f"it is {size:g}, and the value of {name} is {value.value:g}"
    known = {*inner.names, *inner.order}
    for number, one in enumerate(model.combinations):
        if strange := sorted(one.terms.keys() - known):
            yield f"combinations[{number}].terms", f"{strange[0]} is none of the model's parameters"


def _is_shape(name: str, shapes: Iterable[tuple[str, str]]) -> bool:
    """Whether a column is of an effect's shape; the second time at a joint it is marked ``_2``."""
    effect, last = name.split(".")[0], name.rsplit(".", 1)[-1]
    return any(effect == one and re.fullmatch(rf"{re.escape(shape)}(_\d+)?", last) for one, shape in shapes)


def _of_covariance(found: Floats) -> Faults:
    variance = np.diag(found)
    for number in np.flatnonzero(variance < 0.0).tolist():
        yield f"prediction.covariance[{number}][{number}]", f"the variance {variance[number]:g} is negative"
    size = np.sqrt(np.abs(variance))
    odd = np.abs(found - found.T) > _LOPSIDED * np.outer(size, size)
    for row, column in np.argwhere(np.triu(odd, 1)).tolist():
        both = f"{found[row, column]:g} and {found[column, row]:g}"
        yield f"prediction.covariance[{row}][{column}]", f"it is not symmetric: {both}"


def _of_scales(found: Floats, ratios: Sequence[_Value]) -> Faults:
    """1 on the diagonal, 0 left of it, and the ratios right of it; null where the data do not tell."""
    n = len(found)
    for row, column in np.argwhere(np.tril(np.ones((n, n), dtype=bool))).tolist():
        scale, wanted = float(found[row, column]), float(row == column)
        if scale != wanted and not (row == column and math.isnan(scale)):
            yield f"prediction.scales[{row}][{column}]", f"it is {scale:g}, not {wanted:g}"
    for ratio in ratios:
        inner, outer = _pair(ratio.name, n) or (1, 1)
        scale = float(found[inner - 1, outer - 1])
        if ratio.value is None or inner == outer or (math.isnan(scale) and _are_cousins(found, inner - 1, outer - 1)):
            continue
        if not math.isclose(scale, ratio.value, rel_tol=_ROUNDING):
            at = f"prediction.scales[{inner - 1}][{outer - 1}]"
            told = "null" if math.isnan(scale) else f"{scale:g}"
            yield at, f"it is {told}, and {ratio.name} is {ratio.value:g}"
    for row, middle, column in ((i, j, k) for k in range(n) for j in range(k) for i in range(j)):
        product, scale = float(found[row, middle] * found[middle, column]), float(found[row, column])
        if math.isfinite(product) and not math.isclose(scale, product, rel_tol=_ROUNDING):
            yield (
                f"prediction.scales[{row}][{column}]",
                f"it is {scale:g}, and by way of joint {middle + 1} {product:g}",
            )


def _are_cousins(scales: Floats, row: int, column: int) -> bool:
    """Whether two joints are known by a third one further in only, in whose current both loads are seen."""
    known = np.isfinite(scales[:row])
    return bool((known[:, row] & known[:, column]).any())
