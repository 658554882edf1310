"""Kept models as ladders: which can be compared, what each adds to the one before, and the error after."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from pumaid.errors import Note, PumaidError, ResultError, Where
from pumaid.io.archive import CURRENT, FOLDER, Entry, counted, digest_of, read_document, read_entries
from pumaid.records import Errors, History, JointFit, Ladder, Rung
from pumaid.robot import EffectChoice


def read_history(results: Path) -> History:
    """All models that a results folder keeps, as ladders of those that can be compared.

    Parameters
    ----------
    results
        The folder with the current model, ``model.json``, and the archive, ``models/``.

    Returns
    -------
    history
        Files that cannot be used are told in its notes and passed over.

    Raises
    ------
    ResultError [no-history]
        No model was kept.
    """
    kept, notes = read_entries(results)
    current, more = _current(results / CURRENT, kept)
    groups: dict[tuple[object, ...], list[Entry]] = {}
    for entry in kept:
        groups.setdefault(entry.key, []).append(entry)
    main = next((entry for entry in kept if entry.number == current), kept[-1])
    ordered = sorted(groups.values(), key=lambda group: (group[0].key != main.key, group[0].number))
    ladders = tuple(_ladder(group, main, current) for group in ordered)
    return History(str(results / FOLDER), ladders, current, (*notes, *more))


def ladder_of(model: Path) -> Ladder | None:
    """The ladder that ends at a current model's file; None where no model was kept, or another file is meant."""
    try:
        history = read_history(model.parent)
    except ResultError:
        return None
    return history.ladders[0] if history.current is not None and model.name == CURRENT else None


def _current(path: Path, kept: Sequence[Entry]) -> tuple[int | None, list[Note]]:
    """Number of the model that is current, and a note where it is not in the archive."""
    try:
        digest, why = digest_of(read_document(path)[0]), "is not among the kept ones"
    except PumaidError as error:
        digest, why = "", "is missing" if error.slug == "model-missing" else "is damaged"
    number = next((entry.number for entry in kept if entry.digest == digest), None)
    if number is not None:
        return number, []
    text = f"the current model {path} {why}; the ladder ends at the last that was kept"
    return None, [Note("model-not-kept", text, Where(file=str(path)))]


def _ladder(group: Sequence[Entry], main: Entry, current: int | None) -> Ladder:
    last = group[-1].estimate
    numbers = {entry.digest: entry for entry in group}
    rungs = tuple(_rung(entry, numbers.get(entry.parent or ""), current) for entry in group)
    return Ladder(last.robot, last.recipe_digest, dict(last.logs), rungs, _apart(group[-1], main))


def _rung(entry: Entry, parent: Entry | None, current: int | None) -> Rung:
    before = () if parent is None else parent.estimate.effects
    effects = entry.estimate.effects
    return Rung(
        number=entry.number,
        file=entry.path.name,
        digest=entry.digest,
        parent=None if parent is None else parent.number,
        effects=effects,
        added=_beyond(effects, before),
        removed=_beyond(before, effects),
        joints=entry.estimate.joints,
        whole=_whole(entry.estimate.joints),
        is_current=entry.number == current,
    )


def _whole(joints: Sequence[JointFit]) -> Errors:
    """The arm's errors: every joint weighs as its fitted samples do, so that the three figures can be compared."""
    fitted = [fit for fit in joints if fit.rmse is not None]
    samples = sum(fit.samples for fit in fitted)

    def pooled(values: Sequence[float | None]) -> float | None:
        known = [value for value in values if value is not None]
        if not samples or len(known) < len(fitted):
            return None
        return math.sqrt(sum(fit.samples * value**2 for fit, value in zip(fitted, known, strict=True)) / samples)

    heldout = [fit.heldout for fit in fitted]
    return Errors(pooled([fit.rmse for fit in fitted]), pooled(heldout), pooled([fit.noise_floor for fit in fitted]))


def _apart(entry: Entry, main: Entry) -> str:
    """Why the errors of two models cannot be compared; empty where they can."""
    if entry.arm != main.arm:
        return (
            f"of another recipe ({entry.estimate.origin or 'in memory'}, SHA-256 {entry.estimate.recipe_digest[:12]})"
        )
    ours, theirs = set(main.estimate.logs.values()), set(entry.estimate.logs.values())
    if ours != theirs:
        return f"fitted to other logs ({len(theirs)}, of which the current model has {len(ours & theirs)})"
    return "" if entry.key == main.key else "fitted to other runs of the same logs (others were held out)"


def _beyond(effects: Sequence[EffectChoice], others: Sequence[EffectChoice]) -> tuple[EffectChoice, ...]:
    """The effects that `others` lack."""
    left, found = counted(others), []
    for choice in effects:
        key = (choice.effect, choice.joint)
        if left[key]:
            left[key] -= 1
        else:
            found.append(choice)
    return tuple(found)
