"""What can go wrong, said in three lines: what, where, mend."""

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

#: Exit codes of the command line (interfaces: 0 done, 1 asks for attention, 2 misuse, 3 bad input, 4 our bug).
EXIT_DONE, EXIT_ATTENTION, EXIT_USAGE, EXIT_BAD_INPUT, EXIT_BUG = range(5)

#: Control characters but for tab and line end, and letters that turn the direction of writing or end a line unseen.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def visible(text: str) -> str:
    """The text with control characters as Python writes them (``\\x1b``), so that they do not steer a terminal."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


def listed(names: Sequence[str], most: int = 8, *, separator: str = ", ") -> str:
    """Names for a message: the first few of many, long ones cut."""
    text = separator.join(name if len(name) <= 80 else f"{name[:77]}..." for name in names[:most])
    return f"{text} ... ({len(names)} in all)" if len(names) > most else text


def nearest(word: object, names: Iterable[str], *, cutoff: float = 0.6) -> str | None:
    """The name that `word` was probably meant to be, capitals apart, or none."""
    by_lower = {name.lower(): name for name in names}
    close = difflib.get_close_matches(str(word).lower(), by_lower, n=1, cutoff=cutoff)
    return by_lower[close[0]] if close else None


def meant(word: object, names: Sequence[str]) -> str:
    """A mend: the nearest of the names that are known, or what they are."""
    near = nearest(word, names)
    return f"did you mean {near}?" if near else f"known here: {listed(names, 30)}"


@dataclass(frozen=True, slots=True)
class Where:
    """The place a message is about; only the fields that are known are told.

    Rows count as an editor counts lines, header included; joints count from 1; `field` is a path such as
    ``joints[3].alpha``.
    """

    file: str | None = None
    line: int | None = None
    row: int | None = None
    column: str | None = None
    joint: int | None = None
    field: str | None = None

    def __str__(self) -> str:
        return ", ".join(str(value) if name == "file" else f"{name} {value}" for name, value in self.parts().items())

    def parts(self) -> dict[str, object]:
        """The fields that are known."""
        return {name: value for name, value in asdict(self).items() if value is not None}


class PumaidError(Exception):
    """A refusal: `what` is wrong, in a sentence with the value in it, `where`, and what the user can do to `mend` it.

    `slug` is its stable short name, explained in ``docs/messages.md``.
    """

    def __init__(self, slug: str, what: str, where: Where | None = None, mend: str = "") -> None:
        super().__init__(slug, what, where, mend)  # of which a copy, in another process too, is made
        self.slug, self.what, self.where, self.mend = slug, what, where or Where(), mend

    def __str__(self) -> str:
        lines = [f"error[{self.slug}]: {self.what}"]
        if str(self.where):
            lines.append(f"  at: {self.where}")
        if self.mend:
            lines.append(f"  fix: {self.mend}")
        return "\n".join(lines)


class RecipeError(PumaidError):
    """The recipe cannot be used."""


class LogError(PumaidError):
    """A log cannot be used."""


class ModelError(PumaidError):
    """A model, plan or effect choice cannot be used."""


class ResultError(PumaidError):
    """A result file cannot be read or written."""


class Faults(PumaidError):
    """Several refusals of one input, at least one, each printed in full, in the order given."""

    def __init__(self, faults: Iterable[PumaidError]) -> None:
        self.faults = tuple(faults)
        super().__init__(self.faults[0].slug, "; ".join(fault.what for fault in self.faults))
        self.args = (self.faults,)

    def __str__(self) -> str:
        return "\n".join(str(fault) for fault in self.faults)


def refuse(faults: Sequence[PumaidError]) -> None:
    """Raise what there is to refuse: nothing, one error, or several together."""
    if faults:
        raise faults[0] if len(faults) == 1 else Faults(faults)


@dataclass(frozen=True, slots=True)
class Note:
    """Something that a user should know about a result that is not an error: a slug as of errors, and a sentence."""

    slug: str
    text: str
    where: Where = Where()

    def __str__(self) -> str:
        return f"note[{self.slug}]: {self.text}" + (f" ({self.where})" if str(self.where) else "")

    def as_json(self) -> dict[str, object]:
        """As a JSON object: ``{"note": slug, "text": ..., "where": {...}}``."""
        return {"note": self.slug, "text": self.text, "where": self.where.parts()}
