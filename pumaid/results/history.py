"""The models of an experiment: each is archived, with the model it was made from and the error that it left."""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pumaid.errors import Note, PumaidError, ResultError, Where
from pumaid.estimate import Estimate
from pumaid.io.write import locked, write_file
from pumaid.results.documents import as_text, digest_of, plain, read_document
from pumaid.results.model_file import estimate_from, model_document
from pumaid.robot import EffectChoice, Robot

#: The current model in a results folder, and the folder beside it that holds all of them.
CURRENT, FOLDER = "model.json", "models"
#: The entry by which an archived file differs from the model file that it is a copy of.
_LINK = "history"
#: Longest part of a file's name that lists effects.
_LONGEST = 80
_NAME = re.compile(r"(\d+)-.*\.json")


@dataclass(frozen=True, eq=False, slots=True)
class Rung:
    """An archived model: its file, the digests of its content, of its arm and of the model that it was made from.

    `number` counts archived models from 1, `parent` is that of the model it was made from (None: the first, or gone);
    `added` and `removed` are the effects that it has more and less than its parent (of the first, all that are in it).
    """

    number: int
    path: Path
    digest: str
    estimate: Estimate
    arm: str = ""
    before: str | None = None
    parent: int | None = None
    added: tuple[EffectChoice, ...] = ()
    removed: tuple[EffectChoice, ...] = ()
    is_current: bool = False

    @property
    def key(self) -> tuple[object, ...]:
        """Arm, logs and numbers of fitted runs: equal for models whose errors can be compared."""
        fitted = tuple((fit.runs, fit.samples) for fit in self.estimate.joints)
        return self.arm, tuple(sorted(self.estimate.logs.values())), fitted

    @property
    def whole(self) -> dict[str, float | None]:
        """RMSE of the fitted and of the held-out runs, and noise floor of the arm (A), joints weighted by samples.

        None unless known of every fitted joint.
        """
        fitted = [fit for fit in self.estimate.joints if fit.rmse is not None]
        samples = sum(fit.samples for fit in fitted)
        pooled: dict[str, float | None] = {}
        for name in ("rmse", "heldout", "noise_floor"):
            squares = [fit.samples * getattr(fit, name) ** 2 for fit in fitted if getattr(fit, name) is not None]
            pooled[name] = math.sqrt(sum(squares) / samples) if samples and len(squares) == len(fitted) else None
        return pooled


@dataclass(frozen=True, slots=True)
class Ladder:
    """Models, by number, whose errors can be compared: of one arm, one set of logs and the same fitted runs of them.

    `recipe` is the SHA-256 of the recipe of its last model, `logs` are name -> SHA-256; `apart` says why it cannot be
    compared with the current model, and is empty where it can.
    """

    robot: str
    recipe: str
    logs: Mapping[str, str]
    rungs: tuple[Rung, ...]
    apart: str = ""

    @property
    def path(self) -> tuple[Rung, ...]:
        """From the first model to the current one (the last, where none is current), each from the one before."""
        by_number = {rung.number: rung for rung in self.rungs}
        at: Rung | None = next((rung for rung in self.rungs if rung.is_current), self.rungs[-1])
        path: list[Rung] = []
        while at is not None and at not in path:
            path.append(at)
            at = by_number.get(at.parent or 0)
        return tuple(reversed(path))


@dataclass(frozen=True, slots=True)
class History:
    """All models in `folder`: at least one ladder, the one with the current model first; notes on unusable files."""

    folder: str
    ladders: tuple[Ladder, ...]
    current: int | None = None
    notes: tuple[Note, ...] = ()


# Writing


def keep(path: Path, estimate: Estimate, robot: Robot) -> Path:
    """Write the current model `path` of an experiment, and archive it as ``models/NUMBER-EFFECTS.json`` beside it.

    Its parent is the model that was current where one of the two has all effects of the other, else (or where it is an
    earlier one fitted again) the comparable model with most of its effects. A model is archived once. Returns the
    archived file; ResultError [cannot-write] where the system refuses.
    """
    arm = digest_of(plain(replace(robot, effects=(), origin="", digest="")))
    document = model_document(estimate)
    with locked(path.parent / FOLDER):
        before = _archive_current(path, robot.digest, arm)
        archived = _archive(path.parent / FOLDER, (document, estimate), arm=arm, before=before)
        write_file(path, as_text(document))
    return archived


def restore(results: Path, number: int) -> Path:
    """Make model `number` of the archive the current one, and return its file; ResultError [no-history] if it is not.

    A current model that is in no archive is archived first.
    """
    _entries(results / FOLDER, required=True)
    with locked(results / FOLDER):
        _archive_current(results / CURRENT)
        paths = {entry.number: entry.path for entry in _entries(results / FOLDER)[0]}
        if number not in paths:
            what = f"there is no model {number}; there are {', '.join(map(str, paths))}"
            raise ResultError("no-history", what, Where(file=str(results / FOLDER)), "see: pumaid history")
        document, _ = _read(paths[number])
        document.pop(_LINK, None)
        write_file(results / CURRENT, as_text(document))
    return results / CURRENT


def _archive_current(path: Path, recipe: str = "", arm: str = "") -> str | None:
    """Digest of the current model, archived first if it is not; None where there is none.

    `arm` is the digest of the arm of the recipe with the digest `recipe`.
    """
    try:
        document, estimate = _read(path)
    except PumaidError:
        return None
    arm = arm if estimate.recipe_digest == recipe else ""
    _archive(path.parent / FOLDER, (document, estimate), arm=arm, before=None)
    return str(document["sha256"])


def _archive(folder: Path, model: tuple[dict[str, Any], Estimate], *, arm: str, before: str | None) -> Path:
    """Put a model into the archive, once; `before` is the digest of the one that was current."""
    document, estimate = model
    digest = document["sha256"]
    entries, _ = _entries(folder)
    for entry in entries:
        if entry.digest == digest:
            return entry.path
    number = 1 + max((_number(path) for path in folder.glob("*")), default=0)
    word = re.sub(r"[^\w@,+.-]", "_", "+".join(effect_words(estimate.effects)))
    word = word if len(word) <= _LONGEST else f"{len(estimate.effects)}-effects"
    path = folder / f"{number:03d}-{word or 'base'}.json"
    new = Rung(number, path, digest, estimate, arm or estimate.recipe_digest)
    parent = _parent(new, [entry for entry in entries if entry.key == new.key], before)
    write_file(path, as_text(document | {_LINK: {"number": number, "sha256": digest, "parent": parent, "arm": arm}}))
    return path


def _parent(new: Rung, others: Sequence[Rung], before: str | None) -> str | None:
    """Digest of the model that `new` was made from, among those that can be compared with it."""
    effects = _counted(new.estimate.effects)
    within = [entry for entry in others if _counted(entry.estimate.effects) <= effects]
    best = max(within, key=lambda entry: (len(entry.estimate.effects), entry.number), default=None)
    current = next((entry for entry in others if entry.digest == before), best)
    if current is not None and current not in within:
        # A model with more effects is the parent of one from which they were removed, unless that was made before.
        has_twin = best is not None and len(best.estimate.effects) == len(new.estimate.effects)
        current = best if has_twin or not effects <= _counted(current.estimate.effects) else current
    return None if current is None else current.digest


def _counted(effects: Iterable[EffectChoice]) -> Counter[tuple[str, int | None]]:
    """Effects without their shapes, which every fit estimates anew."""
    return Counter((choice.effect, choice.joint) for choice in effects)


def effect_words(effects: Iterable[EffectChoice], n_joints: int = 0) -> list[str]:
    """Effects as on the command line, each kind once: ``stribeck@1,3``, ``spring@all`` of `n_joints`, ``tilt``."""
    joints: dict[str, list[int]] = {}
    for choice in effects:
        joints.setdefault(choice.effect, []).extend([] if choice.joint is None else [choice.joint])
    words = []
    for effect, numbers in joints.items():
        is_everywhere = n_joints > 1 and sorted(numbers) == list(range(1, n_joints + 1))
        where = "all" if is_everywhere else ",".join(map(str, sorted(numbers)))
        words.append(f"{effect}@{where}" if where else effect)
    return words


# Reading


def read_history(results: Path) -> History:
    """All models that a results folder keeps, by ladders; ResultError [no-history] where no model was archived."""
    entries, notes = _entries(results / FOLDER, required=True)
    path, digest, why = results / CURRENT, "", "is not among the kept ones"
    try:
        digest = _read(path)[0]["sha256"]
    except PumaidError as error:
        why = "is missing" if error.slug == "file-not-readable" else "is damaged"
    current = next((entry for entry in entries if entry.digest == digest), None)
    if current is None:
        text = f"the current model {path} {why}; the ladder ends at the last that was kept"
        notes = [*notes, Note("model-not-kept", text, Where(file=str(path)))]
    main = current or entries[-1]
    groups: dict[tuple[object, ...], list[Rung]] = {main.key: []}
    for entry in entries:
        groups.setdefault(entry.key, []).append(entry)
    ladders = tuple(_ladder(group, main, current) for group in groups.values())
    return History(str(results / FOLDER), ladders, current.number if current else None, tuple(notes))


def ladder_of(model: Path) -> Ladder | None:
    """The ladder that ends at a current model's file; None where no model was archived, or for another file."""
    try:
        history = read_history(model.parent)
    except ResultError:
        return None
    return history.ladders[0] if history.current is not None and model.name == CURRENT else None


def _read(path: Path) -> tuple[dict[str, Any], Estimate]:
    """A model file as JSON and as a model; a pipe or device is refused, since reading it might never end."""
    if path.exists() and not path.is_file():
        what = f"{path} is not a plain file"
        raise ResultError("file-not-readable", what, Where(file=str(path)), "remove it from the results folder")
    return read_document(path, "model", lambda document: (document, estimate_from(document)))


def _number(path: Path) -> int:
    """The number in an archived file's name; 0 for another file."""
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else 0


def _entries(folder: Path, *, required: bool = False) -> tuple[list[Rung], list[Note]]:
    """The archive in order of numbers, and what cannot be used; ResultError [no-history] where it is `required`."""
    entries: dict[int, Rung] = {}
    notes: list[Note] = []
    paths = [path for path in folder.iterdir() if path.name[0] != "."] if folder.is_dir() else []
    for path in sorted(paths, key=lambda path: (_number(path), path.name)):
        number, why = _number(path), ""
        try:
            document, estimate = _read(path)
        except PumaidError as error:
            why = error.what.replace(str(path), "it")
        else:
            why = "" if number else "it is not named as kept models are (NUMBER-EFFECTS.json)"
            why = "its number is there already" if number in entries else why
        if why:
            notes.append(Note("model-skipped", f"{path.name} is passed over: {why}", Where(file=str(path))))
            continue
        link = document.get(_LINK)
        texts = {key: text for key, text in link.items() if isinstance(text, str)} if isinstance(link, dict) else {}
        arm = texts.get("arm") or estimate.recipe_digest
        entries[number] = Rung(number, path, document["sha256"], estimate, arm, texts.get("parent"))
    if required and not entries:
        mend = "'pumaid identify LOGS...' makes the first; each later one is kept beside it"
        raise ResultError("no-history", f"no model was kept in {folder}", Where(file=str(folder.parent)), mend)
    return list(entries.values()), notes


def _ladder(group: Sequence[Rung], main: Rung, current: Rung | None) -> Ladder:
    by_digest = {entry.digest: entry for entry in group}
    rungs = []
    for entry in group:
        parent, effects = by_digest.get(entry.before or ""), entry.estimate.effects
        before = () if parent is None else parent.estimate.effects
        links: dict[str, Any] = {"parent": None if parent is None else parent.number, "is_current": entry is current}
        rungs.append(replace(entry, added=_beyond(effects, before), removed=_beyond(before, effects), **links))
    last, apart = group[-1].estimate, ""
    current_logs, logs = set(main.estimate.logs.values()), set(last.logs.values())
    if group[-1].arm != main.arm:
        apart = f"of another recipe ({last.origin or 'in memory'}, SHA-256 {last.recipe_digest[:12]})"
    elif current_logs != logs:
        apart = f"fitted to other logs ({len(logs)}, of which the current model has {len(current_logs & logs)})"
    elif group[-1].key != main.key:
        apart = "fitted to other runs of the same logs (others were held out)"
    return Ladder(last.robot, last.recipe_digest, dict(last.logs), tuple(rungs), apart)


def _beyond(effects: Sequence[EffectChoice], others: Sequence[EffectChoice]) -> tuple[EffectChoice, ...]:
    """The effects that `others` lack, whatever their shapes; of several alike the last ones."""
    lacking, beyond = _counted(effects) - _counted(others), []
    for choice in reversed(effects):
        lacking[choice.effect, choice.joint] -= 1
        beyond += [choice] if lacking[choice.effect, choice.joint] >= 0 else []
    return tuple(reversed(beyond))
