"""The models of an experiment, one file each beside the current one: nothing that was fitted is lost."""

from __future__ import annotations

import hashlib
import json
import re
import stat
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pumaid.errors import Note, PumaidError, ResultError, Where
from pumaid.io.result import as_text, model_document, plain, read_model
from pumaid.io.write import locked, write_file
from pumaid.records import Estimate
from pumaid.robot import EffectChoice, Robot

#: The current model's file in a results folder, and the folder beside it that keeps all.
CURRENT, FOLDER = "model.json", "models"
#: The entry by which a kept file differs from the model file that it is a copy of.
_OWN = "history"
#: Longest part of a file's name that tells effects; a longer one is told as a count.
_LONGEST = 80
_NAME = re.compile(r"(\d+)-.*\.json")


@dataclass(frozen=True, slots=True)
class Kept:
    """Number and file of a model in the archive, and whether it was not there before."""

    number: int
    path: Path
    is_new: bool


@dataclass(frozen=True, eq=False, slots=True)
class Entry:
    """One kept model.

    Attributes
    ----------
    number, path
        From 1, and its file.
    document, estimate
        What the file says.
    digest
        SHA-256 of it.
    parent
        Digest of the model that it was made from, or None.
    arm
        Digest of the arm as the recipe stated it, effects apart.
    is_changed
        Whether somebody changed the file since.
    """

    number: int
    path: Path
    document: Mapping[str, Any]
    estimate: Estimate
    digest: str
    parent: str | None
    arm: str
    is_changed: bool = False

    @property
    def key(self) -> tuple[object, ...]:
        """Models with the same one can be compared by their errors: arm, logs, and what of them was fitted."""
        fitted = tuple((fit.runs, fit.samples) for fit in self.estimate.joints)
        return self.arm, tuple(sorted(self.estimate.logs.values())), fitted


def keep(path: Path, estimate: Estimate, robot: Robot) -> Kept:
    """Write the current model of an experiment, and keep it among all the others.

    The copy goes to ``models/`` beside `path` as ``NUMBER-EFFECTS.json``. It remembers the model that it was made from:
    the one that stood at `path` where one of the two has all effects of the other, else (or where it is an earlier one
    fitted again) the one with most of its effects among those fitted to the same runs. A model that is there already is
    not kept twice. Both files are written whole or not at all, and by one run at a time.

    Parameters
    ----------
    path
        ``results/model.json``.
    estimate
        The model.
    robot
        The arm as the recipe states it; models of the same arm stay comparable when only the recipe's effects change.

    Raises
    ------
    ResultError [cannot-write], [results-busy]
        The disk refuses, or another run does not end its writing.
    """
    arm = digest_of(plain(replace(robot, effects=(), origin="", digest="")))
    document = model_document(estimate)
    folder = Path(path).parent / FOLDER
    with locked(folder):
        before = _adopted(Path(path))
        kept = _stored(folder, (document, estimate), arm=arm, before=before)
        write_file(Path(path), as_text(document))
    return kept


def restore(results: Path, number: int) -> Path:
    """Make model `number` of the archive the current one; the one that was current stays in the archive.

    Returns
    -------
    path
        The current model's file.

    Raises
    ------
    ResultError [no-such-model]
        The archive has no such number.
    ResultError [no-history, cannot-write]
        There is no archive, or the disk refuses.
    """
    if not (results / FOLDER).is_dir():
        read_entries(results)
    with locked(results / FOLDER):
        _adopted(results / CURRENT)
        kept, _ = read_entries(results)
        chosen = next((entry for entry in kept if entry.number == number), None)
        if chosen is None:
            there = ", ".join(str(entry.number) for entry in kept)
            what = f"there is no model {number}; there are {there}"
            raise ResultError("no-such-model", what, Where(file=str(results / FOLDER)), "see: pumaid history")
        write_file(results / CURRENT, as_text(_bare(chosen.document)))
    return results / CURRENT


def read_entries(results: Path) -> tuple[list[Entry], list[Note]]:
    """What the archive of a results folder holds, in order of numbers, and what in it cannot be used.

    Raises
    ------
    ResultError [no-history]
        No model was kept.
    """
    kept, notes = _entries(results / FOLDER)
    if not kept:
        what = f"no model was kept in {results / FOLDER}"
        mend = "'pumaid identify LOGS...' makes the first; each later one is kept beside it"
        raise ResultError("no-history", what, Where(file=str(results)), mend)
    return _settled(kept), notes


def read_document(path: Path) -> tuple[dict[str, Any], Estimate]:
    """A model file as JSON and as a model.

    Raises
    ------
    ResultError, or Faults of it
        As `read_model`; [file-refused] where it is no plain file, or the system does not let it be read.
    """
    try:
        mode = path.stat().st_mode if path.exists() else stat.S_IFREG
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):  # a pipe would be waited for, a device never ends
            what = f"{path} is a pipe or device, not a file"
            raise ResultError("file-refused", what, Where(file=str(path)), "remove it from the results folder")
        estimate = read_model(path)
        return json.loads(path.read_text(encoding="utf-8-sig")), estimate
    except OSError as error:
        what = f"{path} cannot be read: {error.strerror or error}"
        raise ResultError("file-refused", what, Where(file=str(path)), "check its permissions") from error


def _bare(document: Mapping[str, Any]) -> dict[str, Any]:
    return {key: held for key, held in document.items() if key != _OWN}


def digest_of(document: Mapping[str, Any]) -> str:
    """SHA-256 of what a model's document says, however it is set and whether it is the kept copy or not."""
    return hashlib.sha256(json.dumps(_bare(document), sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _adopted(path: Path) -> str | None:
    """The digest of the model that is current, which is kept first if it is not; None where there is none."""
    try:
        model = read_document(path)
    except PumaidError:
        return None
    _stored(path.parent / FOLDER, model, arm="", before=None)
    return digest_of(model[0])


def _stored(folder: Path, model: tuple[dict[str, Any], Estimate], *, arm: str, before: str | None) -> Kept:
    """Put a model into the archive; `before` is the digest of the one that was current."""
    document, estimate = model
    kept, _ = _entries(folder)
    digest = digest_of(document)
    for entry in kept:
        if entry.digest == digest:
            return Kept(entry.number, entry.path, is_new=False)
    taken = [int(found[1]) for path in folder.glob("*") if (found := _NAME.fullmatch(path.name))]
    number = max(taken, default=0) + 1
    path = folder / f"{number:03d}-{_file_word(estimate.effects)}.json"
    made = Entry(number, path, document, estimate, digest=digest, parent=None, arm=arm)
    *others, own = _settled([*kept, made])
    parent = _parent(own, [entry for entry in others if entry.key == own.key], before)
    link = {"number": number, "sha256": digest, "parent": parent, "arm": arm}
    write_file(path, as_text(_bare(document) | {_OWN: link}))
    return Kept(number, path, is_new=True)


def _parent(own: Entry, others: Sequence[Entry], before: str | None) -> str | None:
    """Digest of the model that `own` was made from, among those that can be compared with it."""
    mine = counted(own.estimate.effects)
    sets = {entry.digest: counted(entry.estimate.effects) for entry in others}
    within = [entry for entry in others if sets[entry.digest] <= mine]
    best = max(within, key=lambda entry: (sets[entry.digest].total(), entry.number), default=None)
    has_twin = best is not None and sets[best.digest] == mine
    if before in sets and (sets[before] <= mine or (mine <= sets[before] and not has_twin)):
        return before
    return None if best is None else best.digest


def counted(effects: Iterable[EffectChoice]) -> Counter[tuple[str, int | None]]:
    """Effects without their shapes, which every fit finds anew."""
    return Counter((choice.effect, choice.joint) for choice in effects)


def _file_word(effects: Sequence[EffectChoice]) -> str:
    """Effects as part of a file's name: ``stribeck@1,3+tilt``."""
    joints: dict[str, list[int]] = {}
    for choice in effects:
        joints.setdefault(choice.effect, []).extend([choice.joint] if choice.joint else [])
    words = [f"{name}@{','.join(map(str, found))}" if found else name for name, found in joints.items()]
    word = re.sub(r"[^\w@,+.-]", "_", "+".join(words))
    return word if 0 < len(word) <= _LONGEST else f"{len(effects)}-effects" if effects else "base"


def _entries(folder: Path) -> tuple[list[Entry], list[Note]]:
    found: list[Entry] = []
    notes: list[Note] = []
    for path in sorted(folder.iterdir() if folder.is_dir() else (), key=lambda path: (_number(path), path.name)):
        if path.name.startswith("."):
            continue
        try:
            entry = _entry(path)
        except PumaidError as error:
            notes.append(_skipped(path, str(getattr(error, "faults", [error])[0].what)))
            continue
        twin = next((one for one in found if entry.digest == one.digest or entry.number == one.number), None)
        if twin is not None:
            same = "holds the same model as" if entry.digest == twin.digest else "has the number of"
            notes.append(_skipped(path, f"it {same} {twin.path.name}"))
            continue
        if entry.is_changed:
            text = f"{path.name} was changed after it was kept; it is used as it is now"
            notes.append(Note("model-changed", text, Where(file=str(path))))
        found.append(entry)
    return found, notes


def _skipped(path: Path, why: str) -> Note:
    told = why.replace(str(path), "it")
    return Note("model-skipped", f"{path.name} is passed over: {told}", Where(file=str(path)))


def _number(path: Path) -> int:
    found = _NAME.fullmatch(path.name)
    return int(found[1]) if found else 0


def _entry(path: Path) -> Entry:
    """One kept file."""
    where = Where(file=str(path))
    if not _number(path):
        raise ResultError("model-skipped", "it is not named as kept models are (NUMBER-EFFECTS.json)", where)
    document, estimate = read_document(path)
    told = document.get(_OWN)
    own = {key: held for key, held in told.items() if isinstance(held, str)} if isinstance(told, dict) else {}
    digest = digest_of(document)
    return Entry(
        _number(path),
        path,
        document,
        estimate,
        digest=digest,
        parent=own.get("parent"),
        arm=own.get("arm", ""),
        is_changed=own.get("sha256", digest) != digest,
    )


def _settled(kept: Sequence[Entry]) -> list[Entry]:
    """An entry that does not know its arm takes that of another with its recipe, or the recipe stands for it."""
    known = {entry.estimate.recipe_digest: entry.arm for entry in kept if entry.arm}
    recipes = [entry.estimate.recipe_digest for entry in kept]
    return [
        replace(entry, arm=entry.arm or known.get(recipe, recipe)) for entry, recipe in zip(kept, recipes, strict=True)
    ]
