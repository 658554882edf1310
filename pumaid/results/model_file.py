"""Model files: an estimate as JSON that loses nothing."""

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pumaid import __version__
from pumaid.dataset import BLOCK, STROKE
from pumaid.errors import ModelError, Note, Where
from pumaid.estimate import Estimate
from pumaid.io.write import write_file
from pumaid.results.documents import FORMAT, as_text, plain, read_document, record_from, sealed
from pumaid.robot import Robot


def model_document(estimate: Estimate) -> dict[str, Any]:
    """An estimate as its JSON document."""
    ratios = [value for value in estimate.values if value.name.startswith("gain_ratio.")]
    parameters = [value for value in estimate.values if value not in ratios]
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
                plain(fit)
                | {"strokes": fit.kinds.get(STROKE, 0), "blocks": fit.kinds.get(BLOCK, 0)}
                | {"parameters": [value for value in parameters if value.joint == fit.joint]}
                for fit in estimate.joints
            ],
            "arm": [value for value in parameters if value.joint is None],
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
                "order": [value.name for value in estimate.values],
            },
        }
    )


def write_model(path: Path, estimate: Estimate) -> None:
    """Write a model file atomically; a ResultError [cannot-write] where the system refuses."""
    write_file(Path(path), as_text(model_document(estimate)))


def model_digest(estimate: Estimate) -> str:
    """SHA-256 of the file that `write_model` makes of an estimate, whether it is written or not."""
    notes = tuple(note for note in estimate.notes if note.slug != "model-other-version")
    return hashlib.sha256(as_text(model_document(replace(estimate, notes=notes))).encode("utf-8")).hexdigest()


def read_model(path: Path) -> Estimate:
    """The estimate in a model file, floats bit for bit; ``-`` is standard input.

    A file of another version of pumaid has a note that says so.

    Raises
    ------
    ResultError [file-not-readable], [model-damaged]
        There is no such file, or it may not be read; it is no model file that this version can read, or was changed.
    """
    return read_document(Path(path), "model", estimate_from)


def estimate_from(document: Mapping[str, Any]) -> Estimate:
    """The estimate of a model document."""
    inner = document["prediction"]
    values = [value for joint in document["joints"] for value in joint["parameters"]]
    values += [*document["arm"], *document["ratios"]]
    place = {name: number for number, name in enumerate(inner["order"])}
    entries = {**document, **inner, "version": document["pumaid"]}
    entries |= {"origin": document["recipe"]["file"], "recipe_digest": document["recipe"]["sha256"]}
    entries["values"] = sorted(values, key=lambda value: place[value["name"]])
    estimate: Estimate = record_from(Estimate, entries)
    notes, p = estimate.notes, len(estimate.names)
    if estimate.version != __version__:
        text = f"the model was written by pumaid {estimate.version}, this is {__version__}; the format is the same"
        notes = (*notes, Note("model-other-version", text))
    blind = estimate.blind.reshape(p, -1) if p else np.zeros((0, 0))
    return replace(estimate, covariance=estimate.covariance.reshape(p, p), blind=blind, notes=notes)


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
