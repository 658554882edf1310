"""Notes that repeat from joint to joint are said once."""

from __future__ import annotations

from pumaid.errors import Note, Where
from pumaid.reporting.notes import merged


def few(joint: int, count: str, *, file: str | None = None) -> Note:
    """A note as `identify` makes it."""
    return Note("few-runs", f"joint {joint} has {count} only: its intervals are narrow", Where(file, joint=joint))


def test_one_line_names_all_joints():
    """What is said of seven joints is one line, also where the number differs."""
    notes = [few(joint, "2 runs" if joint == 6 else "1 run") for joint in range(1, 8)]
    (line,) = map(str, merged(notes))
    assert line == (
        "note[few-runs]: each of joints 1, 2, 3, 4, 5 and 7 has 1 run only, joint 6 has 2 runs only:"
        " its intervals are narrow"
    )


def test_a_single_note_keeps_its_place():
    """A note about one joint is left as it is, and a repeated one is said once."""
    assert merged([few(3, "1 run"), few(3, "1 run")]) == [few(3, "1 run")]


def test_other_notes_are_left_alone():
    """Notes of different files, slugs, meaning or without a joint stay apart, in their order."""
    notes = [
        few(1, "1 run", file="a.csv"),
        Note("gap", "0.2 s are missing", Where(file="a.csv", row=7)),
        few(2, "1 run", file="b.csv"),
        Note("few-runs", "joint 1 has 1 run only: else", Where("a.csv", joint=1)),
        Note("friction", "friction of joint 1 falls: odd", Where(joint=1)),
        Note("friction", "friction of joint 2 falls: odd", Where(joint=2)),
    ]
    assert merged(notes) == notes
