"""Files that people write: YAML with the line of each value, checked by pydantic, every fault told at once."""

import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

from pumaid.errors import Faults, PumaidError, RecipeError, Where, meant

#: Most bytes of a recipe, levels of nesting, and values after aliases are expanded.
MAX_BYTES, MAX_DEPTH, MAX_VALUES = 200_000, 20, 200_000
#: Most faults of one file that are listed; the others are counted.
MOST_FAULTS = 20

#: YAML's tags of plain values.
_TAGS = ("map", "seq", "str", "int", "float", "bool", "null", "timestamp", "merge")

KeyPath = tuple[str | int, ...]
Form = TypeVar("Form", bound=BaseModel)
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class StrictForm(BaseModel):
    """What a mapping may hold: unknown keys are faults, and types are not converted."""

    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _leave_out_empty(cls, data: Any) -> Any:
        """What is empty, as a block whose lines are all commented out, means its default; a quantity may be null."""
        if not isinstance(data, dict):
            return data
        nullable = ("velocity", "temperature")
        return {k: v for k, v in data.items() if v is not None or k not in cls.model_fields or k in nullable}


class Fault(NamedTuple):
    """One fault: path of keys and 0-based indices, slug, sentence, mend."""

    path: KeyPath
    slug: str
    what: str
    mend: str


@dataclass(slots=True)
class Document:
    """A YAML document: `data` in plain values, `lines` (from 1) by path, and faults of keys given twice."""

    data: Any
    lines: dict[KeyPath, int]
    doubled: list[Fault]

    def line_of(self, path: Iterable[str | int]) -> int:
        """Line of the value at `path` (keys and 0-based indices), or of its nearest ancestor that exists."""
        steps = tuple(path)
        while steps not in self.lines:
            steps = steps[:-1]
        return self.lines[steps]


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


def parsed_yaml(content: bytes, file: str, *, kind: type[PumaidError] = RecipeError) -> Document:
    """The one YAML document of a file with this content; `file` is for messages.

    Raises
    ------
    PumaidError [yaml-refused]
        Of type `kind`: it is not UTF-8 or UTF-16 text, not YAML, no mapping, or has tags, several documents, too many
        levels or values.
    """
    document = Document(None, {}, [])
    try:
        text = content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
        text = text.replace("\r\n", "\n").replace("\r", "\n")
        yaml = YAML(typ="safe", pure=True)
        root = yaml.compose(text)
        if not isinstance(root, MappingNode):
            raise _Refused(
                "the file holds no keys and values", 1, "write one with pumaid init (a recipe) or pumaid plan"
            )
        document.data = _value(root, (), document, yaml)
        return document
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        what, mend = f"byte 0x{content[error.start]:02x} is not UTF-8 text", "save the file as UTF-8"
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        line = mark.line + 1 if mark is not None else text[: getattr(error, "position", 0)].count("\n") + 1
        has_tab = "\t" in "".join(text.splitlines()[line - 1 : line])
        mend = "indent with spaces, not tabs" if has_tab else "brackets, quotes, colons and indents must match"
        what = f"this is not YAML: {problem}"
    except RecursionError:
        what, line, mend = f"nested more than {MAX_DEPTH} deep", 1, "a recipe nests four deep"
    except _Refused as error:
        what, line, mend = error.args
    raise kind("yaml-refused", what, Where(file=file, line=line), mend)


class _Refused(Exception):
    """YAML that is not accepted: what, line and mend."""


def _value(node: Any, path: KeyPath, document: Document, yaml: YAML) -> Any:
    """The plain value of a composed node; its lines, and keys given twice, are put into the document."""
    line = node.start_mark.line + 1
    document.lines.setdefault(path, line)
    if len(path) > MAX_DEPTH:
        raise _Refused(f"nested more than {MAX_DEPTH} deep", line, "a recipe nests four deep")
    if len(document.lines) > MAX_VALUES:
        raise _Refused(f"aliases expand to more than {MAX_VALUES} values", line, "write the values themselves")
    if str(node.tag).removeprefix("tag:yaml.org,2002:") not in _TAGS:
        raise _Refused(f"the tag {node.tag} is not accepted", line, "write the plain value without a tag")
    if isinstance(node, SequenceNode):
        return [_value(item, (*path, index), document, yaml) for index, item in enumerate(node.value)]
    if isinstance(node, MappingNode):
        values = {}
        for key_node, value_node in node.value:
            key, line = key_node.value, key_node.start_mark.line + 1
            if not isinstance(key_node, ScalarNode) or not key:
                raise _Refused("a list, a mapping or nothing cannot be a key", line, "write key: value")
            if key in values:
                what = f"the key {key[:60]} is given twice (first on line {document.lines[*path, key]})"
                document.doubled.append(Fault((*path, key), "recipe-bad-key", what, "remove one of them"))
            document.lines[*path, key] = line
            values[key] = _value(value_node, (*path, key), document, yaml)
        return values
    try:
        value = yaml.constructor.construct_object(node)
        float(value if isinstance(value, int) else 0.0)  # a larger number than any float overflows
    except (ValueError, OverflowError) as error:
        what = f"{node.value[:40]} is not a number that can be read"
        raise _Refused(what, line, "write a shorter number") from error
    return value


def refusal(what: str, mend: str = "", *, slug: str = "recipe-bad-value") -> Exception:
    """A pydantic error with our slug, sentence and mend."""
    return PydanticCustomError("pumaid", "{what}", {"slug": slug, "what": what, "mend": mend})


def validated(
    form: type[Form],
    document: Document,
    file: str,
    *,
    kind: type[PumaidError],
    slug: str = "",
    context: Any = None,
    between: Callable[[Form], Iterable[Fault]] = lambda form: (),
) -> Form:
    """A document's data as a form whose fields' ``examples`` show what they look like.

    A misspelt key is not told as missing too, and a wrong unit of angles once; of many faults the first are told.

    Raises
    ------
    PumaidError, or Faults of several
        Of type `kind`, every fault in the order of the lines with its slug, or all with `slug`; those `between` several
        values where each is good.
    """
    try:
        out = form.model_validate(document.data, context=context)
        faults = [*document.doubled, *between(out)]
        if not faults:
            return out
    except ValidationError as error:
        faults = [*document.doubled, *(_fault(dict(entry), form) for entry in error.errors(include_url=False))]
    degrees = [fault for fault in faults if fault.slug == "recipe-angle-unit"]
    slips = {(fault.path[:-1], fault.mend) for fault in faults}
    errors = []
    for fault in faults:
        path, what = fault.path, fault.what
        is_slip = what.endswith("is missing") and (path[:-1], f"did you mean {path[-1]}?") in slips
        if is_slip or fault in degrees[1:]:
            continue
        joint = path[1] + 1 if len(path) > 1 and path[0] == "joints" and isinstance(path[1], int) else None
        where = Where(file=file, line=document.line_of(path), joint=joint, field=dotted(path) or None)
        errors.append(kind(slug or fault.slug, what, where, fault.mend))
    errors.sort(key=lambda error: error.where.line or 0)
    if len(errors) > MOST_FAULTS:
        last, more = errors[MOST_FAULTS - 1], len(errors) - MOST_FAULTS
        errors[MOST_FAULTS - 1 :] = [kind(last.slug, f"{last.what} (and {more} more faults)", last.where, last.mend)]
    raise errors[0] if len(errors) == 1 else Faults(errors)


def dotted(path: Sequence[str | int]) -> str:
    """``joints[3].alpha`` for ("joints", 2, "alpha"): people count from 1."""
    text = ""
    for step in path:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def shown(value: Any) -> str:
    """A value as a message shows it: short, with its type."""
    if isinstance(value, dict) or value is None:
        return "empty" if value is None else "a mapping"
    text = json.dumps(value, ensure_ascii=False, default=str)
    text = f"the text {text}" if isinstance(value, str) else f"the list {text}" if isinstance(value, list) else text
    return text if len(text) <= 80 else f"{text[:77]}..."


def _fault(entry: dict[str, Any], form: type[BaseModel]) -> Fault:
    """A pydantic error as a fault."""
    path: KeyPath = tuple(step for step in entry["loc"] if step != "[key]")
    kind, value, context = entry["type"], entry["input"], entry.get("ctx", {})
    if kind == "pumaid":
        return Fault(path, context["slug"], context["what"], context["mend"])
    is_short = kind == "missing" and isinstance(path[-1], int)
    path = path[:-1] if is_short else path
    steps = path
    while isinstance(steps[-1], int):  # an entry of a list looks like what the list shows
        steps = steps[:-1]
    fields, key = _fields(form, steps[:-1]), str(steps[-1])
    if kind == "extra_forbidden":
        mend = "write the values out" if key == "<<" else meant(key, list(fields))
        return Fault(path, "recipe-bad-key", f"there is no key {key[:60]}", mend)
    example = next(iter((fields[key].examples if key in fields else None) or []), "")
    if is_short:
        return Fault(path, "recipe-bad-value", f"{dotted(path)} has too few values", f"write {example or 'more'}")
    if kind == "missing":
        return Fault(path, "recipe-bad-key", f"the key {key} is missing", f"add {key}: {example or '...'}")
    message = re.sub("^Input", "it", entry["msg"].partition(" or instance of")[0]).replace("dictionary", "mapping")
    mend = f"write {example or message.removeprefix('it should be ')}"
    if kind == "literal_error":
        mend = meant(value, context["expected"].replace("'", "").split(" or "))
    elif isinstance(value, str) and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", value):
        mend = f"write the decimals after a point: {value.strip().replace(',', '.')}"
    elif kind == "string_type" and isinstance(value, int | float):
        mend = f'put it in quotes: "{value}"'
    return Fault(path, "recipe-bad-value", f"{dotted(path)} is {shown(value)}: {message}", mend)


def _fields(form: Any, path: Sequence[str | int]) -> dict[str, Any]:
    """The fields, by key, that the mapping at `path` may have."""
    for step in (*path, None):
        while not hasattr(form, "model_fields") and get_args(form):
            form = get_args(form)[0]
        fields = {field.alias or name: field for name, field in getattr(form, "model_fields", {}).items()}
        if isinstance(step, str):
            form = fields[step].annotation if step in fields else None
    return fields
