"""Diagnoses on disk: what is missing from a model, with the evidence, as the document that interfaces fix."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pumaid import __version__
from pumaid.errors import Note, ResultError, Where
from pumaid.io.rebuilt import Unfit, rebuilt
from pumaid.io.result import FORMAT, MOST_BYTES, as_text, model_document, plain
from pumaid.io.write import write_file
from pumaid.records import Diagnosis, Estimate, Finding, JointDiagnosis, NextRun

#: Its name in a folder of results.
DIAGNOSIS_NAME = "diagnosis.json"

#: Entries of a planned run in a document, and of a `Motion`.
_ROW = {"joint": "joint", "hold": "hold", "from": "start", "to": "end", "velocity": "velocity", "purpose": "purpose"}


def model_digest(estimate: Estimate) -> str:
    """The SHA-256 of the file that `write_model` makes of an estimate, whether it is written or not."""
    own = replace(estimate, notes=tuple(note for note in estimate.notes if note.slug != "model-other-version"))
    return hashlib.sha256(as_text(model_document(own)).encode("utf-8")).hexdigest()


def diagnosis_document(diagnosis: Diagnosis) -> dict[str, Any]:
    """A diagnosis as its JSON document; SI, angles in rad."""
    return plain(
        {
            "kind": "diagnosis",
            "format": FORMAT,
            "pumaid": diagnosis.version or __version__,
            "robot": diagnosis.robot,
            "recipe": {"sha256": diagnosis.recipe_digest},
            "model": {"sha256": diagnosis.model},
            "logs": diagnosis.logs,
            "joints": [_joint(one) for one in diagnosis.joints],
            "findings": [_finding(one) for one in diagnosis.findings],
            "applied": [_finding(one) for one in diagnosis.applied],
            "notes": diagnosis.notes,
        }
    )


def _joint(found: JointDiagnosis) -> dict[str, Any]:
    entries: dict[str, Any] = plain(found)
    share = found.repeats and {"share": found.repeats[0], "p_value": found.repeats[1]}
    limits = entries.pop("limits")
    return entries | {"repeats": share, "unseen": limits}


def _finding(found: Finding) -> dict[str, Any]:
    entries: dict[str, Any] = plain(found)
    return entries | {"next_run": None if found.next_run is None else _next_run(found.next_run)}


def _next_run(run: NextRun) -> dict[str, Any]:
    rows = [{key: getattr(motion, name) for key, name in _ROW.items()} for motion in run.motions]
    return {"text": run.text, "runs": plain(rows), "separation": run.separation, "repeats": run.repeats}


def write_diagnosis(path: Path, diagnosis: Diagnosis) -> None:
    """Write a diagnosis, whole or not at all.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses.
    """
    write_file(Path(path), as_text(diagnosis_document(diagnosis)))


def read_diagnosis(path: Path) -> Diagnosis:
    """Read a diagnosis file.

    Parameters
    ----------
    path
        What `write_diagnosis` wrote.

    Raises
    ------
    ResultError [diagnosis-damaged]
        It is no diagnosis that this version can read; the entry that is wrong is told.
    """
    name = str(path)
    try:
        if Path(path).stat().st_size > MOST_BYTES:
            raise _damaged(f"{name} has more than {MOST_BYTES >> 20} MiB", Where(file=name))
        document = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "it is no JSON"
        raise _damaged(f"{name} cannot be read: {reason}", Where(file=name)) from error
    return diagnosis_of(document, name)


def diagnosis_of(document: object, name: str) -> Diagnosis:
    """A diagnosis from its document.

    Parameters
    ----------
    document
        As `diagnosis_document` makes it.
    name
        Of the file that it came from.

    Raises
    ------
    ResultError [diagnosis-damaged]
        It is no diagnosis that this version can read; the entry that is wrong is told.
    """
    if not isinstance(document, dict) or document.get("kind") != "diagnosis":
        raise _damaged(f"{name} is not a diagnosis", Where(file=name, field="kind"))
    if document.get("format") != FORMAT:
        what = f"{name} has format {document.get('format')!r}, this pumaid ({__version__}) reads format {FORMAT}"
        raise _damaged(what, Where(file=name, field="format"))
    try:
        return _diagnosis(document)
    except Unfit as fault:
        raise _damaged(f"{name} is damaged: {fault.what}", Where(file=name, field=fault.path)) from fault
    except (KeyError, TypeError, AttributeError) as fault:
        raise _damaged(f"{name} is damaged: {fault}", Where(file=name)) from fault


def stale(diagnosis: Diagnosis, estimate: Estimate, logs: Mapping[str, str]) -> tuple[str, ...]:
    """Why a diagnosis may not be true of a model and of logs (name -> SHA-256): sentences, none where it is."""
    out = []
    if diagnosis.model != model_digest(estimate):
        out.append("The diagnosis is of another model than this page.")
    if set(diagnosis.logs.values()) != set(logs.values()):
        out.append("The diagnosis is of other logs than this page.")
    return (*out, "Make it again with: pumaid diagnose MODEL LOGS...") if out else ()


def _damaged(what: str, where: Where) -> ResultError:
    return ResultError("diagnosis-damaged", what, where, "make it again with 'pumaid diagnose MODEL LOGS...'")


def _diagnosis(document: Mapping[str, Any]) -> Diagnosis:
    """From the document's entries, those that a record calls otherwise renamed."""
    joints = [_as_joint(one) for one in document["joints"]]
    found = rebuilt(
        Diagnosis,
        {
            "robot": document["robot"],
            "joints": joints,
            "findings": [_as_finding(one) for one in document["findings"]],
            "applied": [_as_finding(one) for one in document["applied"]],
            "model": document["model"]["sha256"],
            "logs": document["logs"],
            "recipe_digest": document["recipe"]["sha256"],
            "version": document["pumaid"],
        },
    )
    notes = tuple(Note(one["note"], one["text"], rebuilt(Where, one["where"])) for one in document["notes"])
    return replace(found, notes=notes)


def _as_joint(entries: Mapping[str, Any]) -> dict[str, Any]:
    repeats = entries["repeats"]
    return {
        **entries,
        "limits": entries["unseen"],
        "repeats": None if repeats is None else [repeats["share"], repeats["p_value"]],
    }


def _as_finding(entries: Mapping[str, Any]) -> dict[str, Any]:
    run = entries["next_run"]
    if run is None:
        return dict(entries)
    motions = [{_ROW[key]: value for key, value in row.items() if key in _ROW} for row in run["runs"]]
    return {**entries, "next_run": {**run, "motions": motions}}
