"""The models of an experiment: each is archived, and stands on a ladder with those whose errors can be compared."""

import hashlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pumaid.errors import Note, PumaidError, ResultError, Where
from pumaid.estimate import Estimate
from pumaid.io.write import locked, write_file
from pumaid.maths import by_key
from pumaid.results.documents import read_model, write_model
from pumaid.robot import EffectChoice

#: The current model in a results folder, and the folder beside it that holds all of them.
CURRENT, FOLDER = "model.json", "models"
#: Longest part of a file's name that lists effects.
_LONGEST = 80
_NAME = re.compile(r"(\d+)-.*\.json")
#: Of each part of a rung's key what models are that have another one.
_APART = ("of another recipe", "fitted to other logs", "fitted to other runs (others were held out)")


@dataclass(frozen=True, eq=False, slots=True)
class Rung:
    """An archived model: its file with the SHA-256, and the model that it extends or changes.

    `number` counts archived models from 1. `parent` is the earlier model of the ladder from which it differs by the
    fewest effects, of several the latest (None: there is no earlier one); `added` and `removed` are the effects that it
    has more and less than its parent (of the first, all that are in it).
    """

    number: int
    path: Path
    digest: str
    estimate: Estimate
    parent: int | None = None
    added: tuple[EffectChoice, ...] = ()
    removed: tuple[EffectChoice, ...] = ()
    is_current: bool = False

    @property
    def key(self) -> tuple[object, ...]:
        """Arm, logs and numbers of fitted runs: equal for models whose errors can be compared."""
        return (
            self.estimate.geometry,
            tuple(sorted(self.estimate.logs.values())),
            tuple((fit.runs, fit.samples) for fit in self.estimate.joints),
        )

    @property
    def whole(self) -> dict[str, float | None]:
        """RMSE of the fitted and of the held-out runs, and noise floor of the arm (A), as `Estimate.pooled`."""
        return {name: self.estimate.pooled(name) for name in ("rmse", "heldout", "noise_floor")}


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
        """From the first model to the current one (the last, where none is current), each with other effects."""
        by_number = {rung.number: rung for rung in self.rungs}
        at: Rung | None = next((rung for rung in self.rungs if rung.is_current), self.rungs[-1])
        path: list[Rung] = []
        while at is not None and at not in path:
            path.append(at)
            at = by_number.get(at.parent or 0)
        return tuple(rung for rung in reversed(path) if rung is path[-1] or rung.added or rung.removed)


@dataclass(frozen=True, slots=True)
class History:
    """All models in `folder`: at least one ladder, the one with the current model first; notes on unusable files."""

    folder: str
    ladders: tuple[Ladder, ...]
    current: int | None = None
    notes: tuple[Note, ...] = ()


# Writing


def keep(path: Path, estimate: Estimate) -> Path:
    """Write the current model `path` of an experiment, and archive it as ``models/NUMBER-EFFECTS.json`` beside it.

    The model that was current before is archived first, if it is not; a model is archived once. Returns the archived
    file; ResultError [cannot-write] where the system refuses.
    """
    with locked(path.parent / FOLDER):
        _archive(path)
        write_model(path, estimate)
        return _archive(path) or path


def _archive(current: Path) -> Path | None:
    try:
        estimate, digest = _read(current)
    except PumaidError:
        return None
    folder = current.parent / FOLDER
    for entry in _entries(folder)[0]:
        if entry.digest == digest:
            return entry.path
    number = 1 + max((_number(path) for path in folder.glob("*")), default=0)
    word = re.sub(r"[^\w@,+.-]", "_", "+".join(effect_words(estimate.effects)))
    word = word if len(word) <= _LONGEST else f"{len(estimate.effects)}-effects"
    path = folder / f"{number:03d}-{word or 'base'}.json"
    write_file(path, current.read_bytes())
    return path


def effect_words(effects: Iterable[EffectChoice], n_joints: int = 0) -> list[str]:
    """Effects as on the command line, each kind once: ``stribeck@1,3``, ``spring@all`` of `n_joints`, ``tilt``."""
    words = []
    for effect, choices in by_key(effects, lambda choice: choice.effect).items():
        joints = sorted(choice.joint for choice in choices if choice.joint is not None)
        is_everywhere = n_joints > 1 and joints == list(range(1, n_joints + 1))
        where = "all" if is_everywhere else ",".join(map(str, joints))
        words.append(f"{effect}@{where}" if where else effect)
    return words


# Reading


def read_history(results: Path) -> History:
    """All models that a results folder keeps, by ladders; ResultError [no-history] where no model was archived."""
    entries, notes = _entries(results / FOLDER)
    if not entries:
        raise ResultError(
            "no-history",
            f"no model was kept in {results / FOLDER}",
            Where(file=str(results)),
            "'pumaid identify LOGS...' makes the first; each later one is kept beside it",
        )
    path, digest, why = results / CURRENT, "", "is not among the kept ones"
    try:
        digest = _read(path)[1]
    except PumaidError as error:
        why = "is missing" if error.slug == "file-not-readable" else "is damaged"
    current = next((entry.number for entry in entries if entry.digest == digest), None)
    if current is None:
        notes = [
            *notes,
            Note(
                "model-not-kept",
                f"the current model {path} {why}; the ladder ends at the last that was kept",
                Where(file=str(path)),
            ),
        ]
    main = next((entry for entry in entries if entry.number == current), entries[-1])
    groups: dict[tuple[object, ...], list[Rung]] = {main.key: []}
    for entry in entries:
        group, effects = groups.setdefault(entry.key, []), entry.estimate.effects
        changes = [
            (_beyond(effects, x.estimate.effects), _beyond(x.estimate.effects, effects), x.number) for x in group
        ]
        added, removed, parent = min(
            reversed(changes), key=lambda change: len(change[0]) + len(change[1]), default=(effects, (), None)
        )
        group.append(replace(entry, parent=parent, added=added, removed=removed, is_current=entry.number == current))
    ladders = []
    for group in groups.values():
        last, keys = group[-1].estimate, zip(_APART, group[-1].key, main.key, strict=True)
        apart = next((name for name, part, other in keys if part != other), "")
        ladders.append(Ladder(last.robot, last.recipe_digest, dict(last.logs), tuple(group), apart))
    return History(str(results / FOLDER), tuple(ladders), current, tuple(notes))


def ladder_of(model: Path) -> Ladder | None:
    """The ladder that ends at a current model's file; None where no model was archived, or for another file."""
    try:
        history = read_history(model.parent)
    except ResultError:
        return None
    return history.ladders[0] if history.current is not None and model.name == CURRENT else None


def _read(path: Path) -> tuple[Estimate, str]:
    if path.exists() and not path.is_file():
        raise ResultError(
            "file-not-readable",
            f"{path} is not a plain file",
            Where(file=str(path)),
            "remove it from the results folder",
        )
    return read_model(path), hashlib.sha256(path.read_bytes()).hexdigest()


def _number(path: Path) -> int:
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else 0


def _entries(folder: Path) -> tuple[list[Rung], list[Note]]:
    entries: dict[int, Rung] = {}
    notes: list[Note] = []
    for path in sorted(folder.glob("[!.]*"), key=lambda path: (_number(path), path.name)):
        number = _number(path)
        try:
            estimate, digest = _read(path)
            why = "" if number else "it is not named as kept models are (NUMBER-EFFECTS.json)"
            why = "its number is there already" if number in entries else why
        except PumaidError as error:
            why = error.what.replace(str(path), "it")
        if why:
            notes.append(Note("model-not-kept", f"{path.name} is passed over: {why}", Where(file=str(path))))
        else:
            entries[number] = Rung(number, path, digest, estimate)
    return list(entries.values()), notes


def _beyond(effects: Sequence[EffectChoice], others: Sequence[EffectChoice]) -> tuple[EffectChoice, ...]:
    matched, beyond = Counter((choice.effect, choice.joint) for choice in others), []
    for choice in effects:
        matched[choice.effect, choice.joint] -= 1
        beyond += [choice] if matched[choice.effect, choice.joint] < 0 else []
    return tuple(beyond)
