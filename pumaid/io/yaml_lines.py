"""YAML text to plain values that remember their lines; no tags, no code, no bombs."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import ScalarNode

from pumaid.errors import ModelError, PumaidError, RecipeError, Where

#: What makes a file that is not empty, by the error that its reader raises.
_EMPTY: dict[type[PumaidError], str] = {
    RecipeError: "write one with: pumaid init puma560 -o recipe.yaml",
    ModelError: "make one with: pumaid plan",
}
#: Bytes a hand-written file may have; the largest recipe shipped has 5 kB.
MAX_BYTES = 200_000
#: Levels of nesting; a recipe has four.
MAX_DEPTH = 20
#: Values a file may expand to through its aliases; stops "billion laughs".
MAX_VALUES = 200_000


@dataclass(slots=True)
class Item:
    """A value of a YAML file and the line (from 1) it stands on.

    `value` is a dict of items, a list of items or a scalar; `key_lines` are the lines of a dict's keys.
    """

    value: Any
    line: int
    key_lines: dict[str, int] = field(default_factory=dict)

    def plain(self) -> Any:
        """The value without lines."""
        if isinstance(self.value, dict):
            return {key: item.plain() for key, item in self.value.items()}
        if isinstance(self.value, list):
            return [item.plain() for item in self.value]
        return self.value

    def line_of(self, path: Iterable[str | int]) -> int:
        """Line of the value at `path` (keys and 0-based indices), or of its nearest ancestor that exists."""
        item, line = self, self.line
        for step in path:
            if isinstance(item.value, dict) and step in item.value:
                item, line = item.value[step], item.key_lines[str(step)]
            elif isinstance(item.value, list) and isinstance(step, int) and step < len(item.value):
                item = item.value[step]
                line = item.line
            else:
                break
        return line


def nearest(word: object, known: Iterable[str]) -> str | None:
    """The known word that `word` was probably meant to be, or none."""
    by_lower = {name.lower(): name for name in known}
    found = difflib.get_close_matches(str(word).lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None


@dataclass(frozen=True, slots=True)
class Document:
    """One YAML document: its values with their lines, the bytes they were read from, and keys that were given twice."""

    root: Item
    content: bytes
    doubled: tuple[PumaidError, ...]


def read_yaml(path: Path, *, kind: type[PumaidError] = RecipeError, max_bytes: int = MAX_BYTES) -> Document:
    """Read one YAML document.

    Parameters
    ----------
    path
        The file; ``-`` is standard input.
    kind
        The error to raise.
    max_bytes
        Refuse a longer file.

    Raises
    ------
    PumaidError [file-not-readable]
        There is no such file, or it may not be read.
    PumaidError [yaml-refused]
        Not text, not YAML, or YAML that a hand-written file has no need of (tags, several documents, too deep, too
        large).
    """
    name = "standard input" if str(path) == "-" else str(path)
    content = _bytes(path, name, kind, max_bytes + 1)
    if len(content) > max_bytes:
        mend = "a recipe or plan is a page of text; is this a log?"
        raise kind("yaml-refused", f"the file has more than {max_bytes} bytes", Where(file=name), mend)
    reader = _Reader(name, kind)
    return Document(reader.read(content), content, tuple(reader.doubled))


def _bytes(path: Path, name: str, kind: type[PumaidError], count: int) -> bytes:
    try:
        if str(path) == "-":
            return sys.stdin.buffer.read(count)
        with path.open("rb") as file:
            return file.read(count)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        mend = "check the path and its permissions"
        raise kind("file-not-readable", f"{name} cannot be read: {reason}", Where(file=name), mend) from error


class _Reader:
    """Builds items from YAML events with an explicit stack, so that no input can exhaust Python's."""

    def __init__(self, file: str, kind: type[PumaidError]) -> None:
        self.file, self.kind = file, kind
        self.yaml = YAML(typ="safe", pure=True)
        self.anchors: dict[str, Item] = {}
        self.sizes: dict[int, int] = {}
        self.doubled: list[PumaidError] = []

    def read(self, content: bytes) -> Item:
        return self._build(self._events(self._text(content)))

    def _refusal(self, what: str, line: int | None, mend: str) -> PumaidError:
        return self.kind("yaml-refused", what, Where(file=self.file, line=line), mend)

    def _text(self, content: bytes) -> str:
        try:
            text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
        except UnicodeDecodeError as error:
            line = content[: error.start].count(b"\n") + 1
            raise self._refusal(
                f"byte 0x{content[error.start]:02x} is not UTF-8 text", line, "save the file as UTF-8"
            ) from error
        return text.replace("\r\n", "\n").replace("\r", "\n")

    def _events(self, text: str) -> Iterator[Any]:
        try:
            yield from self.yaml.parse(text)
        except YAMLError as error:
            mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
            problem = getattr(error, "problem", None) or str(error).splitlines()[0]
            line = mark.line + 1 if mark is not None else text[: getattr(error, "position", 0)].count("\n") + 1
            tab = "\t" in "".join(text.split("\n")[line - 1 : line])
            mend = (
                "indent with spaces, not tabs"
                if tab
                else "see the line; brackets, quotes, colons and indents must match"
            )
            raise self._refusal(f"this is not YAML: {problem}", line, mend) from error

    def _build(self, events: Iterator[Any]) -> Item:
        """One document; `open_items` are the collections not yet ended, with the key that waits for a value."""
        open_items: list[tuple[Item, list[tuple[str, int]], str | None]] = []
        document: Item | None = None
        for event in events:
            kind = type(event).__name__
            line = event.start_mark.line + 1
            if kind in ("StreamStartEvent", "StreamEndEvent", "DocumentStartEvent", "DocumentEndEvent"):
                if kind == "DocumentStartEvent" and document is not None:
                    raise self._refusal("a second document starts here", line, "remove the line ---")
                continue
            if kind.endswith("EndEvent"):
                item, _, anchor = open_items.pop()
                self._count(item, line)
                done = item
                if anchor:
                    self.anchors[anchor] = item
            elif kind in ("MappingStartEvent", "SequenceStartEvent"):
                self._no_tag(event, line)
                if len(open_items) >= MAX_DEPTH:
                    raise self._refusal(f"nested more than {MAX_DEPTH} deep", line, "a recipe nests four deep")
                open_items.append((Item({} if kind[0] == "M" else [], line), [], event.anchor))
                continue
            else:
                done = self._leaf(event, line)
            if not open_items:
                document = done
            else:
                self._put(open_items[-1], done)
        if document is None:
            raise self._refusal("the file is empty", None, _EMPTY.get(self.kind, "give a file with text in it"))
        return document

    def _leaf(self, event: Any, line: int) -> Item:
        if type(event).__name__ == "AliasEvent":
            if event.anchor not in self.anchors:
                raise self._refusal(f"*{event.anchor} names nothing above it", line, "write the value itself")
            return self.anchors[event.anchor]
        self._no_tag(event, line)
        item = Item(self._scalar(event, line), line)
        if event.anchor:
            self.anchors[event.anchor] = item
        return item

    def _no_tag(self, event: Any, line: int) -> None:
        if event.tag is not None:
            raise self._refusal(f"the tag {event.tag} is not accepted", line, "write the plain value without a tag")

    def _scalar(self, event: Any, line: int) -> Any:
        tag = self.yaml.resolver.resolve(ScalarNode, event.value, event.implicit)
        kind = str(tag).rsplit(":", 1)[-1]
        if kind not in ("int", "float", "bool", "null"):
            return event.value
        try:
            value = self.yaml.constructor.construct_object(ScalarNode(tag, event.value))
            if kind == "int":
                float(value)  # an integer that no double can hold overflows here
            return value
        except (ValueError, OverflowError, YAMLError) as error:
            text = event.value[:40]
            raise self._refusal(f"{text} is not a number that can be read", line, "write a shorter number") from error

    def _put(self, place: tuple[Item, list[tuple[str, int]], str | None], item: Item) -> None:
        parent, waiting, _ = place
        if isinstance(parent.value, list):
            parent.value.append(item)
        elif not waiting:
            waiting.append((self._key(item), item.line))
        else:
            key, line = waiting.pop()
            if key in parent.value:
                what = f"the key {key} is given twice (first on line {parent.key_lines[key]})"
                self.doubled.append(self.kind("recipe-duplicate", what, Where(self.file, line), "remove one of them"))
            parent.value[key] = item
            parent.key_lines[key] = line

    def _key(self, item: Item) -> str:
        if isinstance(item.value, dict | list):
            raise self._refusal("a list or mapping cannot be a key", item.line, "quote text that holds { } [ ] or :")
        if item.value is None:
            raise self._refusal("a key is missing before the colon", item.line, "write key: value")
        return str(item.value).lower() if isinstance(item.value, bool) else str(item.value)

    def _count(self, item: Item, line: int) -> None:
        """Bound what aliases expand to: sizes of finished collections add up."""
        inside: Sequence[Item] = list(item.value.values()) if isinstance(item.value, dict) else item.value
        size = 1 + sum(self.sizes.get(id(child), 1) for child in inside)
        self.sizes[id(item)] = size
        if size > MAX_VALUES:
            raise self._refusal(f"aliases expand to more than {MAX_VALUES} values", line, "write the values themselves")
