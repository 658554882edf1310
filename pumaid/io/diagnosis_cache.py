"""Diagnoses, kept from one command to the next: the same question is not worked out twice.

A diagnosis is found by all that it is worked out from: the model, the recipe, the runs down to the last number and
which of them are held out, suspected columns, and the program's own text with the versions of numpy and scipy. It is
kept as the document that `pumaid diagnose` writes, under a digest that shows damage; nothing in it is ever executed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from pumaid.errors import ResultError
from pumaid.io.diagnosis import diagnosis_document, diagnosis_of, model_digest
from pumaid.io.evidence_npz import digest_of
from pumaid.io.kept import Shelf, cache_folder, program
from pumaid.io.packing import packed
from pumaid.io.result import as_text
from pumaid.records import Diagnosis, Estimate, Evidence
from pumaid.robot import Robot

#: Rooms of the program by which a diagnosis is made; the first are the modules beside the rooms.
_ROOMS = ("", "clearance", "diagnosis", "effects", "io", "estimation", "maths", "preprocessing", "records", "verbs")
#: Bytes that all kept diagnoses together may have, and one of them.
MOST_BYTES, _MOST_OF_ONE = 128 << 20, 32 << 20
#: What a kept diagnosis begins with.
_HEAD = b'{"pumaid_diagnosis": '


def diagnosis_folder() -> Path | None:
    """Where diagnoses are kept."""
    folder = cache_folder()
    return None if folder is None else folder / "diagnoses"


def diagnosis_shelf(folder: Path | None) -> Shelf:
    """A folder as one of kept diagnoses."""
    return Shelf(folder, ".json", is_ours=_is_ours, most=MOST_BYTES)


class DiagnosisCache:
    """The kept diagnosis of one model on some runs, made with this program's own effects.

    Parameters
    ----------
    estimate, evidence, robot, suspects
        As `pumaid.verbs.diagnose.diagnose` is given them.
    folder
        Where files are kept; the default is in `cache_folder`.
    """

    def __init__(
        self,
        estimate: Estimate,
        evidence: Evidence,
        robot: Robot,
        *,
        suspects: Sequence[str] = (),
        folder: Path | None = None,
    ) -> None:
        self._shelf = diagnosis_shelf(folder or diagnosis_folder())
        self._of = model_digest(estimate), {facts.name: facts.digest for facts in evidence.files}
        made_by = [program(_ROOMS), np.__version__, version("scipy"), repr(robot), list(suspects), self._of[0]]
        made_by.append(digest_of(packed(evidence), "").tobytes().hex())
        whole = hashlib.sha256(json.dumps(made_by).encode()).hexdigest()
        self._name = f"{whole[:16]}-{whole[16:48]}.json"

    def get(self) -> Diagnosis | None:
        """What was kept, or None where it is not as it was put."""
        if self._shelf.folder is None:
            return None
        try:
            path = self._shelf.folder / self._name
            if path.stat().st_size > _MOST_OF_ONE:
                return None
            head, _, body = path.read_bytes().partition(b"\n")
            if head != self._head(body):
                return None
            found = diagnosis_of(json.loads(body), self._name)
        except (OSError, ValueError, RecursionError, MemoryError, ResultError):
            return None
        if (found.model, found.logs) != self._of:
            return None
        self._shelf.used(self._name)
        return found

    def put(self, diagnosis: Diagnosis) -> None:
        """Keep a diagnosis; then remove what is too old and too much."""
        body = as_text(diagnosis_document(diagnosis)).encode()
        if len(body) < _MOST_OF_ONE:
            self._shelf.put(self._name, lambda sink: sink.write(self._head(body) + b"\n" + body))

    def _head(self, body: bytes) -> bytes:
        digest = hashlib.sha256(self._name.encode() + body).hexdigest()
        return _HEAD + json.dumps(digest).encode() + b"}"


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(_HEAD)) == _HEAD
    except OSError:
        return False
