"""Model files: an estimate as JSON that loses nothing."""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.errors import ModelError, Note, Where
from pumaid.io.write import write_file
from pumaid.records import NOT_IDENTIFIABLE, Combination, Estimate, JointFit, Value
from pumaid.results.documents import FORMAT, Refusals, Unfit, as_text, plain, read_document, record_from
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]
Faults = Iterator[tuple[str, str]]

REFUSALS = Refusals("model", "model-damaged", "pumaid identify LOGS...")
STATES = ("identified", "given", NOT_IDENTIFIABLE)
#: Relative difference of numbers that were written as one.
_ROUNDING = 1e-9
#: Asymmetry of a covariance relative to its standard errors that is round-off.
_LOPSIDED = 1e-6
_RATIO = re.compile(r"gain_ratio\.([1-9]\d{0,3})\.([1-9]\d{0,3})")


@dataclass(frozen=True, kw_only=True)
class JointEntry(JointFit):
    """A joint of the document: its fit and its parameters."""

    parameters: tuple[Value, ...]


@dataclass(frozen=True)
class PostureEntry:
    """Positions (J,) held while `joint` made strokes."""

    joint: int
    hold: tuple[float, ...]


@dataclass(frozen=True)
class PredictionEntry:
    """What is needed to predict; fields as of `Estimate`, `order` names its `values`."""

    names: tuple[str, ...]
    solution: Floats
    covariance: Floats
    scales: Floats
    blind: Floats
    stroke_postures: tuple[PostureEntry, ...]
    order: tuple[str, ...]


@dataclass(frozen=True)
class RecipeEntry:
    """File name and digest of the recipe."""

    file: str
    sha256: str


@dataclass(frozen=True)
class ModelDocument:
    """The document of a model file."""

    pumaid: str
    robot: str
    recipe: RecipeEntry
    logs: dict[str, str]
    method: str
    effects: tuple[EffectChoice, ...]
    joints: tuple[JointEntry, ...]
    arm: tuple[Value, ...]
    ratios: tuple[Value, ...]
    combinations: tuple[Combination, ...]
    recursive: tuple[Value, ...]
    notes: tuple[Note, ...]
    prediction: PredictionEntry
    heldout: float | None = None

    def parameters(self) -> Iterator[tuple[str, Value]]:
        """Every parameter of the model, ratios too, with its path."""
        for number, entry in enumerate(self.joints):
            yield from ((f"joints[{number}].parameters[{k}]", value) for k, value in enumerate(entry.parameters))
        for name in ("arm", "ratios"):
            yield from ((f"{name}[{k}]", value) for k, value in enumerate(getattr(self, name)))


def model_document(estimate: Estimate) -> dict[str, Any]:
    """An estimate as its JSON document."""
    ratios = [value for value in estimate.values if value.name.startswith("gain_ratio.")]
    others = [value for value in estimate.values if value not in ratios]
    return plain(
        {
            "kind": "model",
            "format": FORMAT,
            "pumaid": estimate.version or __version__,
            "robot": estimate.robot,
            "recipe": {"file": estimate.origin, "sha256": estimate.recipe_digest},
            "logs": estimate.logs,
            "method": estimate.method,
            "effects": estimate.effects,
            "joints": [
                plain(fit) | {"parameters": [value for value in others if value.joint == fit.joint]}
                for fit in estimate.joints
            ],
            "arm": [value for value in others if value.joint is None],
            "ratios": ratios,
            "combinations": estimate.combinations,
            "recursive": estimate.recursive,
            "notes": estimate.notes,
            "heldout": estimate.heldout,
            "prediction": {
                "names": estimate.names,
                "solution": estimate.solution,
                "covariance": estimate.covariance,
                "scales": estimate.scales,
                "blind": estimate.blind,
                "stroke_postures": [{"joint": joint, "hold": hold} for joint, hold in estimate.stroke_postures],
                "order": [value.name for value in estimate.values],
            },
        }
    )


def write_model(path: Path, estimate: Estimate) -> None:
    """Write a model file atomically.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses.
    """
    write_file(Path(path), as_text(model_document(estimate)))


def model_digest(estimate: Estimate) -> str:
    """SHA-256 of the file that `write_model` makes of an estimate, whether it is written or not."""
    notes = tuple(note for note in estimate.notes if note.slug != "model-other-version")
    return hashlib.sha256(as_text(model_document(replace(estimate, notes=notes))).encode("utf-8")).hexdigest()


def read_model(path: Path) -> Estimate:
    """Read a model file; ``-`` is standard input.

    Returns
    -------
    estimate
        Equal to the one written; floats bit for bit. A file of another version of pumaid has a note that says so.

    Raises
    ------
    ResultError [file-not-readable]
        There is no such file, or it may not be read.
    ResultError [model-damaged], or Faults of several
        It is no model file that this version can read, or entries are missing, of a wrong type, or contradict each
        other; each with its path.
    """
    name = "standard input" if str(path) == "-" else str(path)
    return estimate_from(read_document(Path(path), REFUSALS), name)


def estimate_from(document: Mapping[str, Any], file: str) -> Estimate:
    """The estimate of a model document from `file`; errors as for `read_model`."""
    try:
        model = record_from(ModelDocument, document)
    except Unfit as unfit:
        raise REFUSALS.unfit(unfit.faults, file) from None
    faults = list(contradictions(model))
    if faults:
        raise REFUSALS.unfit(faults, file)
    inner = model.prediction
    p = len(inner.names)
    place = {name: number for number, name in enumerate(inner.order)}
    values = sorted((value for _, value in model.parameters()), key=lambda value: place[value.name])
    notes = model.notes
    if model.pumaid != __version__:
        text = f"{file} was written by pumaid {model.pumaid}, this is {__version__}; the format is the same"
        notes = (*notes, Note("model-other-version", text))
    return Estimate(
        robot=model.robot,
        joints=tuple(_joint_fit(entry) for entry in model.joints),
        values=tuple(values),
        names=inner.names,
        solution=inner.solution,
        covariance=inner.covariance.reshape(p, p),
        scales=inner.scales,
        blind=inner.blind.reshape(p, -1) if p else np.zeros((0, 0)),
        stroke_postures=tuple((posture.joint, posture.hold) for posture in inner.stroke_postures),
        effects=model.effects,
        combinations=model.combinations,
        recursive=model.recursive,
        method=model.method,
        recipe_digest=model.recipe.sha256,
        origin=model.recipe.file,
        logs=model.logs,
        notes=notes,
        version=model.pumaid,
        heldout=model.heldout,
    )


def _joint_fit(entry: JointEntry) -> JointFit:
    return JointFit(**{item.name: getattr(entry, item.name) for item in fields(JointFit)})


def check_same_recipe(estimate: Estimate, robot: Robot) -> None:
    """Refuse a model that was identified with another recipe.

    Where the model or the robot has no recipe file, names and joints are compared.

    Raises
    ------
    ModelError [model-other-recipe]
        They do not belong together.
    """
    what = ""
    if len(estimate.joints) != robot.n_joints:
        what = f"the model is of an arm with {len(estimate.joints)} joints, the recipe has {robot.n_joints}"
    elif estimate.recipe_digest and robot.digest:
        if estimate.recipe_digest != robot.digest:
            digests = f"(SHA-256 {estimate.recipe_digest[:12]}, this one {robot.digest[:12]})"
            what = f"the model of '{estimate.robot}' was identified with another recipe {digests}"
    elif estimate.robot != robot.name:
        what = f"the model is of '{estimate.robot}', the recipe of '{robot.name}'"
    if what:
        mend = "give the recipe that the model was made with by --recipe, or identify again with this one"
        raise ModelError("model-other-recipe", what, Where(file=robot.origin or None), mend)


def contradictions(model: ModelDocument) -> Faults:
    """Entries of a well-formed document that contradict each other: path and what is wrong."""
    numbers = [entry.joint for entry in model.joints]
    n_joints = len(numbers)
    if not numbers or numbers != list(range(1, n_joints + 1)):
        yield "joints", f"joints are numbered {numbers}, not 1 to {n_joints}"
    if model.method not in ("joint", "recursive"):
        yield "method", f"there is no method {model.method!r}"
    counts = Counter(value.name for _, value in model.parameters())
    yield from (("joints", f"parameter {name} stands there {n} times") for name, n in counts.items() if n > 1)
    if Counter(model.prediction.order) != counts:
        yield "prediction.order", f"it does not name the {counts.total()} parameters and ratios"
    recursive = ((f"recursive[{number}]", value) for number, value in enumerate(model.recursive))
    for path, value in (*model.parameters(), *recursive):
        yield from ((f"{path}.{entry}", what) for entry, what in _of_value(value))
    yield from _of_joints(model, n_joints)
    yield from _of_numbers(model)
    sizes = list(_of_sizes(model.prediction, n_joints))
    yield from sizes or _of_prediction(model)


def _of_value(value: Value) -> Faults:
    if value.state not in STATES:
        yield "state", f"{value.state!r} is none of {', '.join(STATES)}"
    elif (value.value is None) != (value.state == NOT_IDENTIFIABLE):
        yield "value", f"{value.name} is {value.state}, and its value is {value.value}"
    if value.value is None and (value.std_error is not None or value.ci95 is not None):
        yield "std_error", f"{value.name} has an error and no value"
    if value.ci95 is not None and not value.ci95[0] <= value.ci95[1]:
        yield "ci95", f"the interval of {value.name} is {value.ci95[0]:g} to {value.ci95[1]:g}"


def _of_joints(model: ModelDocument, n_joints: int) -> Faults:
    """Joint numbers beyond the arm's."""
    stated = [(f"effects[{number}]", choice.joint) for number, choice in enumerate(model.effects)]
    stated += [(path, value.joint) for path, value in model.parameters()]
    stated += [(f"recursive[{number}]", value.joint) for number, value in enumerate(model.recursive)]
    for number, posture in enumerate(model.prediction.stroke_postures):
        path = f"prediction.stroke_postures[{number}]"
        stated.append((path, posture.joint))
        if len(posture.hold) != n_joints:
            yield f"{path}.hold", f"it holds {len(posture.hold)} positions, not {n_joints}"
    for path, joint in stated:
        if joint is not None and joint > n_joints:
            yield f"{path}.joint", f"there is no joint {joint} in an arm of {n_joints}"
    for number, ratio in enumerate(model.ratios):
        if _pair(ratio.name, n_joints) is None:
            yield f"ratios[{number}].name", f"{ratio.name} names no two of the {n_joints} joints"


def _of_numbers(model: ModelDocument) -> Faults:
    """Numbers that are null where only a number makes sense."""
    inner = model.prediction
    numbers: dict[str, Iterable[float]] = {
        **{f"prediction.{name}": getattr(inner, name).flat for name in ("solution", "covariance", "blind")},
        **{f"effects[{number}].shape": choice.shape.values() for number, choice in enumerate(model.effects)},
        **{f"prediction.stroke_postures[{k}].hold": posture.hold for k, posture in enumerate(inner.stroke_postures)},
        **{
            f"combinations[{number}]": (one.value, one.std_error, *one.terms.values())
            for number, one in enumerate(model.combinations)
        },
    }
    for path, values in numbers.items():
        if any(math.isnan(value) for value in values):
            yield path, "a number is missing"


def _of_sizes(inner: PredictionEntry, n_joints: int) -> Faults:
    """Arrays of another shape than their names and joints have."""
    p = len(inner.names)
    blind = (p, inner.blind.shape[-1]) if inner.blind.ndim == 2 else (p,)
    shapes = {"solution": (p,), "covariance": (p, p), "scales": (n_joints, n_joints), "blind": blind}
    for name, wanted in shapes.items():
        shape = getattr(inner, name).shape
        if shape != wanted and not (p == 0 and name in ("covariance", "blind") and shape[0] == 0):
            yield f"prediction.{name}", f"it has the shape {shape}, not {wanted}"


def _of_prediction(model: ModelDocument) -> Faults:
    inner, p = model.prediction, len(model.prediction.names)
    values = {value.name: value for _, value in model.parameters() if value not in model.ratios}
    shapes = {(choice.effect, name) for choice in model.effects for name in choice.shape}
    for name, count in Counter(inner.names).items():
        if count > 1 or name not in values:
            yield "prediction.names", f"{name} is none of the model's parameters, or stands there {count} times"
    for number, (name, size) in enumerate(zip(inner.names, inner.solution, strict=True)):
        value = values.get(name)
        # The column of a shape holds the step that the fit moves it by.
        if value is None or value.value is None or value.state != "identified" or _is_shape(name, shapes):
            continue
        if not math.isclose(value.value, size, rel_tol=_ROUNDING):
            yield f"prediction.solution[{number}]", f"it is {size:g}, and the value of {name} is {value.value:g}"
    known = {*inner.names, *inner.order}
    for number, one in enumerate(model.combinations):
        if strange := sorted(one.terms.keys() - known):
            yield f"combinations[{number}].terms", f"{strange[0]} is none of the model's parameters"
    yield from _of_covariance(inner.covariance.reshape(p, p))
    yield from _of_scales(inner.scales, model.ratios)


def _is_shape(name: str, shapes: Iterable[tuple[str, str]]) -> bool:
    """Whether a column is of an effect's shape; a second effect of a kind at a joint is marked ``_2``."""
    effect, last = name.split(".")[0], name.rsplit(".", 1)[-1]
    return any(effect == of and re.fullmatch(rf"{re.escape(shape)}(_\d+)?", last) for of, shape in shapes)


def _of_covariance(covariance: Floats) -> Faults:
    variance = np.diag(covariance)
    for number in np.flatnonzero(variance < 0.0).tolist():
        yield f"prediction.covariance[{number}][{number}]", f"the variance {variance[number]:g} is negative"
    error = np.sqrt(np.abs(variance))
    odd = np.abs(covariance - covariance.T) > _LOPSIDED * np.outer(error, error)
    for row, column in np.argwhere(np.triu(odd, 1)).tolist():
        yield f"prediction.covariance[{row}][{column}]", "it is not symmetric"


def _of_scales(scales: Floats, ratios: Sequence[Value]) -> Faults:
    """1 on the diagonal, 0 below it, the gain ratios above it, null where they are not determined."""
    n = len(scales)
    for row, column in np.argwhere(np.tril(np.ones((n, n)))).tolist():
        scale, wanted = scales[row, column], float(row == column)
        if scale != wanted and not (row == column and math.isnan(scale)):
            yield f"prediction.scales[{row}][{column}]", f"it is {scale:g}, not {wanted:g}"
    for ratio in ratios:
        inner, outer = _pair(ratio.name, n) or (1, 1)
        scale = scales[inner - 1, outer - 1]
        known = np.isfinite(scales[: inner - 1])
        is_indirect = bool((known[:, inner - 1] & known[:, outer - 1]).any())  # both loads act on an inner joint only
        if ratio.value is None or inner == outer or (math.isnan(scale) and is_indirect):
            continue
        if not math.isclose(scale, ratio.value, rel_tol=_ROUNDING):
            path = f"prediction.scales[{inner - 1}][{outer - 1}]"
            yield path, f"it is {scale:g}, and {ratio.name} is {ratio.value:g}"
    for row, middle, column in ((i, j, k) for k in range(n) for j in range(k) for i in range(j)):
        product, scale = scales[row, middle] * scales[middle, column], scales[row, column]
        if math.isfinite(product) and not math.isclose(scale, product, rel_tol=_ROUNDING):
            yield f"prediction.scales[{row}][{column}]", f"it is {scale:g}, and by joint {middle + 1} {product:g}"


def _pair(name: str, n_joints: int) -> tuple[int, int] | None:
    """The joints (from 1) of a gain ratio, the inner one first."""
    match = _RATIO.fullmatch(name)
    inner, outer = (int(match[1]), int(match[2])) if match else (0, 0)
    return (inner, outer) if inner < outer <= n_joints else None
