"""Notes for people: what is true of several joints is said once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pumaid.errors import Note


def merged(notes: Iterable[Note]) -> list[Note]:
    """Notes, each once; those that say of one joint after another what begins with ``joint N`` become one.

    Two notes belong together when slug, place (but for the joint) and all behind the first colon are the same.

    Parameters
    ----------
    notes
        In any order.

    Returns
    -------
    fewer
        In the order in which each was first said.

    Examples
    --------
    >>> from pumaid.errors import Where
    >>> two = [Note("few-runs", f"joint {n} has 1 run only: its errors are too small", Where(joint=n)) for n in (2, 3)]
    >>> print(*merged(two))
    note[few-runs]: each of joints 2 and 3 has 1 run only: its errors are too small
    """
    groups: dict[tuple[object, ...], list[Note]] = {}
    for note in dict.fromkeys(notes):
        head, _, tail = note.text.partition(": ")
        of_joint = note.where.joint is not None and head.startswith(f"joint {note.where.joint} ")
        key = (note.slug, replace(note.where, joint=None), tail) if of_joint else (note,)
        groups.setdefault(key, []).append(note)
    return [group[0] if len(group) == 1 else _together(group) for group in groups.values()]


def _together(notes: list[Note]) -> Note:
    """One note of several joints."""
    said: dict[str, list[int]] = {}
    for note in notes:
        head = note.text.partition(": ")[0]
        said.setdefault(head.removeprefix(f"joint {note.where.joint} "), []).append(note.where.joint or 0)
    words = ", ".join(f"{_named(joints)} {what}" for what, joints in said.items())
    _, colon, tail = notes[0].text.partition(": ")
    return Note(notes[0].slug, words + colon + tail, replace(notes[0].where, joint=None))


def _named(joints: list[int]) -> str:
    if len(joints) == 1:
        return f"joint {joints[0]}"
    return f"each of joints {', '.join(str(joint) for joint in joints[:-1])} and {joints[-1]}"
