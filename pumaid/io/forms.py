"""Files that people write: YAML with the line of each value, checked by pydantic, every fault told at once."""

from __future__ import annotations

import difflib
import json
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, NoReturn, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

from pumaid.errors import Faults, PumaidError, RecipeError, Where

#: Most bytes of a recipe, levels of nesting, and values after aliases are expanded.
MAX_BYTES, MAX_DEPTH, MAX_VALUES = 200_000, 20, 200_000

Path_ = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Document:
    """A YAML document: `data` in plain values, `lines` (from 1) by path, its bytes, and faults of keys given twice."""

    data: Any
    lines: Mapping[Path_, int]
    content: bytes
    doubled: tuple[PumaidError, ...]

    def line_of(self, path: Iterable[str | int]) -> int:
        """Line of the value at `path` (keys and 0-based indices), or of its nearest ancestor that exists."""
        steps = tuple(path)
        while steps not in self.lines:
            steps = steps[:-1]
        return self.lines[steps]


def nearest(word: object, known: Iterable[str]) -> str | None:
    """The known word that `word` was probably meant to be, or none."""
    by_lower = {name.lower(): name for name in known}
    close = difflib.get_close_matches(str(word).lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[close[0]] if close else None


def yaml_text(text: str) -> str:
    """A text as YAML: bare where that is safe, else in JSON's quotes, which YAML reads too."""
    is_plain = re.fullmatch(r"[A-Za-z][\w./()-]*(?: [\w./()-]+)*", text, re.ASCII) is not None
    words = {"true", "false", "yes", "no", "on", "off", "null", "y", "n"}
    return text if is_plain and text.lower() not in words else json.dumps(text, ensure_ascii=False)


def file_name(path: Path) -> str:
    """A path as messages show it."""
    return "standard input" if str(path) == "-" else str(path)


def read_bytes(path: Path, *, kind: type[PumaidError], most: int) -> bytes:
    """The content of a file of at most `most` bytes; ``-`` is standard input.

    Raises
    ------
    PumaidError [file-not-readable]
        Of type `kind`: there is no such file, it may not be read, or it is larger.
    """
    name = file_name(path)
    try:
        if str(path) == "-":
            content = sys.stdin.buffer.read(most + 1)
        else:
            with Path(path).open("rb") as file:
                content = file.read(most + 1)
    except (OSError, ValueError) as error:
        reason, mend = getattr(error, "strerror", None) or str(error), "check the path and its permissions"
        raise kind("file-not-readable", f"{name} cannot be read: {reason}", Where(file=name), mend) from error
    if len(content) > most:
        what = f"{name} has more than {most} bytes, which no such file has"
        raise kind("file-not-readable", what, Where(file=name), "is this a log?")
    return content


def read_yaml(path: Path, *, kind: type[PumaidError] = RecipeError, max_bytes: int = MAX_BYTES) -> Document:
    """Read one YAML document; ``-`` is standard input.

    Raises
    ------
    PumaidError [file-not-readable, yaml-refused]
        Of type `kind`: it is larger than `max_bytes`, not UTF-8 or UTF-16 text, not YAML, or has tags, several
        documents, too many levels or values.
    """
    content = read_bytes(path, kind=kind, most=max_bytes)
    return _Reader(file_name(path), kind).read(content)


class _Reader:
    """Turns composed YAML nodes into plain values and their lines."""

    def __init__(self, file: str, kind: type[PumaidError]) -> None:
        self.file, self.kind = file, kind
        self.yaml = YAML(typ="safe", pure=True)
        self.lines: dict[Path_, int] = {}
        self.doubled: list[PumaidError] = []

    def read(self, content: bytes) -> Document:
        try:
            text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
            node = self.yaml.compose(text.replace("\r\n", "\n").replace("\r", "\n"))
        except UnicodeDecodeError as error:
            line, byte = content[: error.start].count(b"\n") + 1, content[error.start]
            raise self._refusal(f"byte 0x{byte:02x} is not UTF-8 text", line, "save the file as UTF-8") from error
        except YAMLError as error:
            raise self._syntax(error, text) from error
        except RecursionError as error:
            raise self._refusal(f"nested more than {MAX_DEPTH} deep", None, "a recipe nests four deep") from error
        if node is None:
            raise self._refusal("the file is empty", None, "write one with pumaid init (a recipe) or pumaid plan")
        return Document(self._value(node, ()), self.lines, content, tuple(self.doubled))

    def _refusal(self, what: str, line: int | None, mend: str) -> PumaidError:
        return self.kind("yaml-refused", what, Where(file=self.file, line=line), mend)

    def _syntax(self, error: YAMLError, text: str) -> PumaidError:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        line = mark.line + 1 if mark is not None else text[: getattr(error, "position", 0)].count("\n") + 1
        has_tab = "\t" in "".join(text.splitlines()[line - 1 : line])
        mend = "indent with spaces, not tabs" if has_tab else "brackets, quotes, colons and indents must match"
        return self._refusal(f"this is not YAML: {problem}", line, mend)

    def _value(self, node: Any, path: Path_) -> Any:
        line = node.start_mark.line + 1
        self.lines.setdefault(path, line)
        if len(path) > MAX_DEPTH:
            raise self._refusal(f"nested more than {MAX_DEPTH} deep", line, "a recipe nests four deep")
        if len(self.lines) > MAX_VALUES:
            raise self._refusal(f"aliases expand to more than {MAX_VALUES} values", line, "write the values themselves")
        if isinstance(node, ScalarNode):
            return self._scalar(node, line)
        if str(node.tag) not in ("tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"):
            raise self._refusal(f"the tag {node.tag} is not accepted", line, "write the plain value without a tag")
        if isinstance(node, SequenceNode):
            return [self._value(item, (*path, index)) for index, item in enumerate(node.value)]
        return dict(self._entries(node, path))

    def _entries(self, node: MappingNode, path: Path_) -> Iterator[tuple[str, Any]]:
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, ScalarNode) or not key_node.value:
                raise self._refusal("a list, a mapping or nothing cannot be a key", line, "write key: value")
            key = key_node.value
            if (*path, key) in self.lines:
                what = f"the key {key[:60]} is given twice (first on line {self.lines[*path, key]})"
                self.doubled.append(self.kind("recipe-bad-key", what, Where(self.file, line), "remove one of them"))
            self.lines[*path, key] = line
            yield key, self._value(value_node, (*path, key))

    def _scalar(self, node: ScalarNode, line: int) -> Any:
        tag = self.yaml.resolver.resolve(ScalarNode, node.value, (node.style is None, node.style is not None))
        if str(node.tag) != str(tag):
            raise self._refusal(f"the tag {node.tag} is not accepted", line, "write the plain value without a tag")
        kind = str(tag).rsplit(":", 1)[-1]
        if kind not in ("int", "float", "bool", "null"):
            return node.value
        try:
            value = self.yaml.constructor.construct_object(node)
            if kind == "int":
                float(value)  # an integer beyond all floats overflows
        except (ValueError, OverflowError, YAMLError) as error:
            what = f"{node.value[:40]} is not a number that can be read"
            raise self._refusal(what, line, "write a shorter number") from error
        return value


Form = TypeVar("Form", bound="BaseModel")
#: Most faults of one file that are listed; the others are counted.
MOST_FAULTS = 20


class Fault(NamedTuple):
    """One fault: path of keys and 0-based indices, slug, sentence, mend."""

    path: tuple[str | int, ...]
    slug: str
    what: str
    mend: str


#: Unknown keys are faults, and types are not converted.
FORM = ConfigDict(extra="forbid", strict=True)


def refusal(slug: str, what: str, mend: str = "", *, known: Iterable[str] = (), word: object = "") -> Exception:
    """A pydantic error with our slug, sentence and mend; or with the nearest of the `known` words to `word`."""
    texts = {"slug": slug, "what": what, "mend": mend or _meant(word, list(known))}
    return PydanticCustomError("pumaid", "{what}", texts)


Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]


def within(least: float, most: float, *, unit: str, mend: str) -> AfterValidator:
    """A check that the size of a number is between bounds, in `unit`."""

    def check(value: float) -> float:
        if not least <= abs(value) <= most:
            bounds = f"between {least:g} and {most:g}" if least else f"at most {most:g}"
            raise refusal("recipe-bad-value", f"{value:g} {unit}".strip() + f" is not {bounds}", mend)
        return value

    return AfterValidator(check)


@dataclass(frozen=True, slots=True)
class Wording:
    """How faults of one kind of file are told: the type of error, an example of each key's value, and the slug of every
    fault (none: each kind of fault has its own).
    """

    error: type[PumaidError]
    examples: Mapping[str, str]
    slug: str | None = None


def validated(form: type[Form], data: Any, *, wording: Wording, context: Any = None) -> tuple[Form | None, list[Fault]]:
    """The form of plain data, or none, and its faults."""
    try:
        return form.model_validate(data, context=context), []
    except ValidationError as error:
        return None, [_translated(dict(entry), form, wording) for entry in error.errors(include_url=False)]


def refuse(file: str, document: Document, faults: Sequence[Fault], *, wording: Wording) -> NoReturn:
    """Raise every fault, in the order of the file's lines; a misspelt key is not told as missing too."""
    meant = {(fault.path[:-1], fault.mend) for fault in faults}
    errors = list(document.doubled)
    for path, slug, what, mend in faults:
        if what.endswith("is missing") and (path[:-1], f"did you mean {path[-1]}?") in meant:
            continue
        joint = path[1] + 1 if len(path) > 1 and path[0] == "joints" and isinstance(path[1], int) else None
        where = Where(file=file, line=document.line_of(path), joint=joint, field=dotted(path) or None)
        errors.append(wording.error(wording.slug or slug, what, where, mend))
    raise_together(sorted(errors, key=lambda error: error.where.line or 0))


def raise_together(errors: Sequence[PumaidError]) -> NoReturn:
    """Raise one error or several; of many the others are counted."""
    listed = list(errors[:MOST_FAULTS])
    if len(errors) > MOST_FAULTS:
        last, more = listed[-1], len(errors) - MOST_FAULTS
        listed[-1] = type(last)(last.slug, f"{last.what} (and {more} more faults)", last.where, last.mend)
    raise listed[0] if len(listed) == 1 else Faults(listed)


def dotted(path: Sequence[str | int]) -> str:
    """``joints[3].alpha`` for ("joints", 2, "alpha"): people count from 1."""
    text = ""
    for step in path:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def shown(value: Any) -> str:
    """A value as a message shows it: short, with its type."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return f"the truth value {str(value).lower()}"
    if isinstance(value, dict):
        return "a mapping"
    text = f"the list {value}" if isinstance(value, list) else str(value)
    text = f"the text '{value}'" if isinstance(value, str) else text
    return text if len(text) <= 80 else f"{text[:77]}..."


_TYPES = {"string": "text", "float": "a number", "list": "a list", "int": "a whole number"}


def _translated(entry: dict[str, Any], form: type[BaseModel], wording: Wording) -> Fault:
    """A pydantic error as a fault."""
    path: tuple[str | int, ...] = tuple(step for step in entry["loc"] if step != "[key]")
    kind, value, context = entry["type"], entry["input"], entry.get("ctx", {})
    key = str(path[-1]) if path else "the file"
    example = wording.examples.get(key)
    if kind == "pumaid":
        return Fault(path, context["slug"], context["what"], context["mend"])
    if kind == "extra_forbidden":
        mend = "write the values out" if key == "<<" else _meant(key, _keys(form, path[:-1]))
        return Fault(path, "recipe-bad-key", f"there is no key {key[:60]}", mend)
    if kind == "missing":
        return Fault(path, "recipe-bad-key", f"the key {key} is missing", f"add {key}: {example or '...'}")
    if kind == "literal_error":
        words = context["expected"].replace("'", "").split(" or ")
        what = f"{key} is {shown(value)}, not {context['expected']}"
        return Fault(path, "recipe-bad-value", what, _meant(value, words))
    if kind in ("too_short", "too_long", "string_too_long"):
        bound = context.get("min_length") or context.get("max_length")
        what = f"{key} has {len(value)} {'characters' if isinstance(value, str) else 'values'}"
        return Fault(path, "recipe-bad-value", what, f"write {example or bound}")
    if kind == "finite_number":
        return Fault(path, "recipe-bad-value", f"{dotted(path)} is {value}", "write a finite number")
    if kind.startswith(("greater_than", "less_than")):
        bound = next(iter(context.values()))
        side = {"greater_than": "above", "less_than": "below"}.get(kind, "from" if kind[0] == "g" else "up to")
        return Fault(path, "recipe-bad-value", f"{key} is {shown(value)}", f"write a number {side} {bound:g}")
    wanted = _TYPES.get(kind.split("_")[0], "a mapping of keys to values")
    what = f"{dotted(path) or key} is {shown(value)}, not {wanted}"
    return Fault(path, "recipe-bad-value", what, _type_mend(value, wanted, example))


def _type_mend(value: Any, wanted: str, example: str | None) -> str:
    if wanted == "text":
        return f'put it in quotes: "{value}"' if isinstance(value, int | float) else "write a text"
    if wanted == "a number" and isinstance(value, str) and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", value):
        return f"write the decimals after a point: {value.strip().replace(',', '.')}"
    if wanted == "a number":
        return "write a bare number"
    return f"write {example or wanted}"


def _meant(word: object, known: Sequence[str]) -> str:
    near = nearest(word, known)
    return f"did you mean {near}?" if near else f"known here: {', '.join(known)}"


def _keys(form: Any, path: Sequence[str | int]) -> list[str]:
    """Keys that the mapping at `path` may have."""
    for step in path:
        if isinstance(step, str):
            by_entry = {field.alias or name: field.annotation for name, field in form.model_fields.items()}
            form = by_entry[step]
            while not hasattr(form, "model_fields"):
                form = form.__args__[0]
    return [field.alias or name for name, field in form.model_fields.items()]
