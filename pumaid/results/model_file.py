"""Model files: an estimate as JSON that loses nothing."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import NOT_IDENTIFIABLE, Combination, Estimate, JointFit, Value
from pumaid.io.write import write_file
from pumaid.results.documents import (
    FORMAT,
    Refusals,
    Unfit,
    as_text,
    check_seal,
    plain,
    read_document,
    record_from,
    sealed,
)
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]
Faults = Iterator[tuple[str, str]]

REFUSALS = Refusals("model", "model-damaged", "pumaid identify LOGS...")
STATES = ("identified", "given", NOT_IDENTIFIABLE)


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
    return sealed(
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
    if faults := list(contradictions(model)):
        raise REFUSALS.unfit(faults, file)
    check_seal(document, REFUSALS, file)
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
    """Entries of a well-formed document that do not fit each other: path and what is wrong."""
    numbers, inner = [entry.joint for entry in model.joints], model.prediction
    n_joints = len(numbers)
    if not numbers or numbers != list(range(1, n_joints + 1)):
        yield "joints", f"joints are numbered {numbers}, not 1 to {n_joints}"
    if model.method not in ("joint", "recursive"):
        yield "method", f"there is no method {model.method!r}"
    names = Counter(value.name for _, value in model.parameters())
    if max(names.values(), default=1) > 1 or Counter(inner.order) != names:
        yield "prediction.order", f"it does not name the {names.total()} parameters and ratios, each once"
    for path, value in model.parameters():
        if value.state not in STATES or (value.value is None) != (value.state == NOT_IDENTIFIABLE):
            yield f"{path}.value", f"{value.name} is {value.state}, and its value is {value.value}"
    stated = [(f"effects[{number}]", choice.joint) for number, choice in enumerate(model.effects)]
    stated += [(path, value.joint) for path, value in model.parameters()]
    for number, posture in enumerate(inner.stroke_postures):
        stated.append((f"prediction.stroke_postures[{number}]", posture.joint))
        if len(posture.hold) != n_joints:
            yield f"prediction.stroke_postures[{number}].hold", f"it is not of {n_joints} joints"
    for path, joint in stated:
        if joint is not None and joint > n_joints:
            yield f"{path}.joint", f"there is no joint {joint} in an arm of {n_joints}"
    yield from _of_sizes(inner, n_joints)


def _of_sizes(inner: PredictionEntry, n_joints: int) -> Faults:
    """Arrays of another shape than their names and joints have."""
    p = len(inner.names)
    blind = (p, inner.blind.shape[-1]) if inner.blind.ndim == 2 else (p,)
    shapes = {"solution": (p,), "covariance": (p, p), "scales": (n_joints, n_joints), "blind": blind}
    for name, wanted in shapes.items():
        shape = getattr(inner, name).shape
        if shape != wanted and not (p == 0 and name in ("covariance", "blind") and shape[0] == 0):
            yield f"prediction.{name}", f"it has the shape {shape}, not {wanted}"
        if name != "scales" and np.isnan(getattr(inner, name)).any():
            yield f"prediction.{name}", "a number is missing"
