"""A diagnosis for the terminal: sentences first, then the numbers behind them."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.text import Text

from pumaid.records import ADEQUATE, UNEXPLAINED_JOINT, Diagnosis, JointDiagnosis
from pumaid.reporting import findings, verdicts
from pumaid.reporting.evidence import evidence_grid, limits_grid, runs_grid, shape_lines
from pumaid.reporting.forms import READABLE, Shown
from pumaid.robot import Robot


@dataclass(frozen=True, slots=True)
class Told:
    """A paragraph: its text, how far it is set in (characters), a style of the terminal, whether it is a command.

    A command that is longer than a line is continued with backslashes, so that it can be pasted.
    """

    text: str
    indent: int = 0
    style: str = ""
    is_command: bool = False

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        longest = self.indent + max(len(line) for line in self.text.split("\n"))
        return Measurement(20, min(longest, READABLE, options.max_width))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        yield Text("\n".join(self._lines(min(options.max_width, READABLE))), style=self.style)

    def _lines(self, width: int) -> list[str]:
        """The lines of all paragraphs of the text; lines that hold more than one blank in a row stay as they are."""
        before, room = " " * self.indent, max(width - self.indent - 2 * self.is_command, 20)
        out: list[str] = []
        for line in self.text.split("\n"):
            after = before + "  " * self.is_command
            keep = "  " in line or not line
            parts = [line] if keep else textwrap.wrap(line, room, break_long_words=False, break_on_hyphens=False)
            told = [(before if number == 0 else after) + part for number, part in enumerate(parts)]
            out += [f"{part} \\" for part in told[:-1]] + told[-1:] if self.is_command else told
        return out


def diagnosis_shown(diagnosis: Diagnosis, robot: Robot, *, units: str = "rad") -> list[Told | Shown]:
    """Everything that is told of a diagnosis, part after part; empty lines stand between parts where `Told("")` does.

    Parameters
    ----------
    diagnosis
        What was found.
    robot
        Names of joints.
    units
        ``"rad"`` or ``"deg"``: unit of angles.
    """
    parts: list[Told | Shown] = [Told(verdicts.headline(diagnosis, robot), style="bold")]
    for number, found in enumerate(diagnosis.findings, start=1):
        parts += [Told(""), Told(f"{number}. {findings.finding_title(found, robot)}", style="bold")]
        parts += [Told(text, 3) for text in findings.finding_sentences(found, diagnosis, robot, units=units)]
        decision = findings.decision_sentence(found)
        parts += [Told(decision, 3)] if decision else []
        parts += [Told("Add it with:", 3), Told(found.command, 5, is_command=True)] if found.command else []
    for joint in diagnosis.joints:
        parts += _unexplained(joint, robot, units) if joint.verdict == UNEXPLAINED_JOINT else []
    parts += [part for text in verdicts.other_sentences(diagnosis, robot) for part in (Told(""), Told(text))]
    fine = [*verdicts.adequate_sentences(diagnosis, robot), *verdicts.suspect_sentences(diagnosis)]
    fine += verdicts.applied_sentences(diagnosis, robot)
    parts += [Told(""), *(Told(text) for text in fine)] if fine else []
    weak = verdicts.weaknesses(diagnosis, robot)
    parts += [Told(""), Told("What weakens this diagnosis:")] if weak else []
    parts += [Told(f"- {text}", 2) for text in weak]
    return parts + _tables(diagnosis, robot, units)


def _unexplained(joint: JointDiagnosis, robot: Robot, units: str) -> list[Told | Shown]:
    """A joint that lacks something without a name."""
    told = [Told(text, 3) for text in verdicts.unexplained_sentences(joint, units)]
    plot = [Told("\n".join(shape_lines(joint.unexplained, units)), 3)] if joint.unexplained is not None else []
    return [Told(""), Told(verdicts.unexplained_title(joint, robot), style="bold"), *told, *plot]


def _tables(diagnosis: Diagnosis, robot: Robot, units: str) -> list[Told | Shown]:
    """The numbers: what was tried, the runs that would decide, and where nothing was found what would have been."""
    quiet: Sequence[int] = [one.joint for one in diagnosis.joints if one.verdict == ADEQUATE]
    grids = [evidence_grid(diagnosis, robot)]
    grids += [runs_grid(found, robot, units) for found in diagnosis.findings]
    grids += [limits_grid(diagnosis, robot, units=units, joints=quiet)] if quiet else []
    parts: list[Told | Shown] = []
    for table in grids:
        parts += [] if table is None else [Told(""), Shown(table)]
    return parts
