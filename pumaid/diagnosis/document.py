"""Diagnosis files: a diagnosis as JSON, written and read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pumaid import __version__
from pumaid.diagnosis.records import Diagnosis
from pumaid.estimate import Estimate
from pumaid.io.write import write_file
from pumaid.results.documents import (
    Refusals,
    Unfit,
    as_text,
    check_seal,
    heading,
    plain,
    read_document,
    record_from,
    sealed,
)
from pumaid.results.model_file import model_digest

#: Its name in a folder of results.
DIAGNOSIS_NAME = "diagnosis.json"
REFUSALS = Refusals("diagnosis", "diagnosis-damaged", "pumaid diagnose MODEL LOGS...")


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
    ResultError [file-not-readable], [diagnosis-damaged], or Faults of several
        It is no diagnosis that this version can read; the entry that is wrong is named.
    """
    document = read_document(Path(path), REFUSALS)
    try:
        diagnosis = record_from(Diagnosis, _entries(document))
    except Unfit as unfit:
        raise REFUSALS.unfit(unfit.faults, str(path)) from None
    check_seal(document, REFUSALS, str(path))
    return diagnosis


def _entries(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document's entries, those that `Diagnosis` names otherwise renamed."""
    entries = {**document, "version": document.get("pumaid")}
    for name, entry in (("recipe_digest", "recipe"), ("model", "model")):
        holder = document.get(entry)
        entries[name] = holder.get("sha256") if isinstance(holder, dict) else holder
    joints = document.get("joints")
    if isinstance(joints, list):
        entries["joints"] = [_joint(joint) for joint in joints]
    return entries


def _joint(entries: Any) -> Any:
    repeats = entries.get("repeats") if isinstance(entries, dict) else None
    if not isinstance(repeats, dict):
        return entries
    return {**entries, "repeats": [repeats.get("share"), repeats.get("p_value")]}


def stale(diagnosis: Diagnosis, estimate: Estimate, logs: Mapping[str, str]) -> tuple[str, ...]:
    """Why a diagnosis may not hold for a model and logs (name -> SHA-256): sentences, none where it does."""
    out = []
    if diagnosis.model != model_digest(estimate):
        out.append("The diagnosis is of another model than this page.")
    if set(diagnosis.logs.values()) != set(logs.values()):
        out.append("The diagnosis is of other logs than this page.")
    return (*out, "Make it again with: pumaid diagnose MODEL LOGS...") if out else ()
