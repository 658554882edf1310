"""Diagnosis files: a diagnosis as JSON, written and read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pumaid import __version__
from pumaid.diagnosis.records import Diagnosis
from pumaid.estimate import Estimate
from pumaid.io.write import write_file
from pumaid.results.documents import as_text, heading, plain, read_document, record_from, sealed
from pumaid.results.model_file import model_digest

#: Its name in a folder of results.
DIAGNOSIS_NAME = "diagnosis.json"


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """A diagnosis as its JSON document; SI, angles in rad."""
    entries = plain(diagnosis)
    for joint in entries["joints"]:
        share = joint["repeats"]
        joint["repeats"] = share and {"share": share[0], "p_value": share[1]}
    entries |= {"recipe": {"sha256": entries.pop("recipe_digest")}, "model": {"sha256": entries["model"]}}
    version = entries.pop("version")
    return sealed(heading("diagnosis") | {"pumaid": version or __version__} | entries)


def write_diagnosis(path: Path, diagnosis: Diagnosis) -> None:
    """Write a diagnosis file atomically.

    Raises
    ------
    ResultError [cannot-write]
        The system refuses.
    """
    write_file(Path(path), as_text(diagnosis_document(diagnosis)))


def read_diagnosis(path: Path) -> Diagnosis:
    """Read a diagnosis file.

    Raises
    ------
    ResultError [file-not-readable], [diagnosis-damaged]
        It is no diagnosis that this version can read, or was changed.
    """
    return read_document(Path(path), "diagnosis", _diagnosis)


def _diagnosis(document: Mapping[str, Any]) -> Diagnosis:
    """The record; entries that it names otherwise are renamed."""
    joints = [
        {**joint, "repeats": joint["repeats"] and tuple(joint["repeats"].values())} for joint in document["joints"]
    ]
    entries = {**document, "version": document["pumaid"], "joints": joints}
    entries |= {"recipe_digest": document["recipe"]["sha256"], "model": document["model"]["sha256"]}
    diagnosis: Diagnosis = record_from(Diagnosis, entries)
    return diagnosis


def stale(diagnosis: Diagnosis, estimate: Estimate, logs: Mapping[str, str]) -> tuple[str, ...]:
    """Why a diagnosis may not hold for a model and logs (name -> SHA-256): sentences, none where it does."""
    out = []
    if diagnosis.model != model_digest(estimate):
        out.append("The diagnosis is of another model than this page.")
    if set(diagnosis.logs.values()) != set(logs.values()):
        out.append("The diagnosis is of other logs than this page.")
    return (*out, "Make it again with: pumaid diagnose MODEL LOGS...") if out else ()
