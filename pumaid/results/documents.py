"""Result documents: records as JSON text closed by a digest, and records read back from it."""

import hashlib
import json
import math
import re
import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from pumaid import __version__
from pumaid.errors import Note, ResultError, Where
from pumaid.robot import Robot

Record = TypeVar("Record")

#: The format number that this version writes and reads.
FORMAT = 1
#: Kind of a document that is read -> slug of its refusals, and the command that makes one.
_READ = {
    "model": ("model-damaged", "pumaid identify LOGS..."),
    "diagnosis": ("diagnosis-damaged", "pumaid diagnose MODEL LOGS..."),
}
#: Most bytes of a document.
MOST_BYTES = 200 << 20

#: Fields of records whose entry in a document has another name.
_ENTRIES = {
    "Note": {"slug": "note"},
    "Motion": {"start": "from", "end": "to"},
    "NextRun": {"motions": "runs"},
    "JointDiagnosis": {"limits": "unseen"},
    "Diagnosis": {"version": "pumaid"},
}
#: A list of nothing but numbers over several lines.
_NUMBERS = re.compile(r"\[\n\s*((?:-?\d[^\[\]\"{}]*|null[^\[\]\"{}]*))\]")


def plain(value: Any) -> Any:
    """`value` in JSON's types: arrays and tuples become lists, records objects, non-finite numbers null."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str):
        return _encodable(value)
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, Note):
        return plain(value.as_json())
    if isinstance(value, Mapping):
        return {_encodable(str(key)): plain(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        names = _ENTRIES.get(type(value).__name__, {})
        return {names.get(item.name, item.name): plain(getattr(value, item.name)) for item in fields(value)}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return [plain(item) for item in value]


def _encodable(value: str) -> str:
    """Text without surrogates: bytes of a file name that are not UTF-8 become backslash escapes."""
    return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode("utf-8")


def as_text(document: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """A document as indented JSON text, each row of numbers on one line; `ascii_only` escapes other letters."""
    indented = json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=ascii_only)
    return _NUMBERS.sub(lambda row: "[" + ", ".join(part.strip() for part in row[1].split(",")) + "]", indented) + "\n"


def heading(kind: str, *, robot: Robot | None = None, logs: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The first entries of a document: kind, format, version, the recipe's digest, name -> SHA-256 of the logs."""
    head: dict[str, Any] = {"kind": kind, "format": FORMAT, "pumaid": __version__}
    if robot is not None:
        head |= {"robot": robot.name, "recipe": {"file": Path(robot.origin).name, "sha256": robot.digest}}
    return head if logs is None else head | {"logs": dict(logs)}


def digest_of(document: Mapping[str, Any]) -> str:
    """SHA-256 of what a document says, apart from its own digest and its place in a history."""
    content = {key: entry for key, entry in document.items() if key not in ("sha256", "history")}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document in plain values with its digest, by which `read_document` sees that it was edited."""
    content = plain(document)
    return content | {"sha256": digest_of(content)}


def read_document(path: Path, kind: str, build: Callable[[dict[str, Any]], Record]) -> Record:
    """What `build` makes of a JSON document of `kind` that `sealed` closed; ``-`` is standard input.

    Raises
    ------
    ResultError [file-not-readable]
        There is no such file, or it may not be read.
    ResultError [the kind, -damaged]
        It is not such a document, or was changed since it was written.
    """
    name = "standard input" if str(path) == "-" else str(path)
    slug, command = _READ[kind]
    data = _content(path, name, kind)

    def damaged(what: str, field: str | None = None, line: int | None = None) -> ResultError:
        is_log = name.lower().endswith((".csv", ".parquet"))
        mend = "the model comes before the logs: MODEL LOGS..." if is_log else f"make it again with '{command}'"
        return ResultError(slug, what, Where(file=name, field=field, line=line), mend)

    if len(data) > MOST_BYTES:
        raise damaged(f"{name} has more than {MOST_BYTES >> 20} MiB")
    try:
        document = json.loads(data.decode("utf-8-sig"))
        digest = digest_of(document) if isinstance(document, dict) else ""
    except (ValueError, RecursionError) as error:  # not UTF-8, not JSON, too many digits, too deep
        what = f"{name} is not JSON, or breaks off: {str(error)[:80]}"
        raise damaged(what, line=getattr(error, "lineno", None)) from None
    if not isinstance(document, dict) or document.get("kind") != kind:
        actual = document.get("kind") if isinstance(document, dict) else type(document).__name__
        raise damaged(f"{name} is not a {kind}: its kind is {actual!r}", "kind")
    number = document.get("format")
    if number != FORMAT or isinstance(number, bool):
        what = f"{name} has format {number!r}, and was written by pumaid {document.get('pumaid')!r}"
        raise damaged(f"{what}; this pumaid ({__version__}) reads format {FORMAT}", "format")
    if document.get("sha256") != digest:
        raise damaged(f"{name} was changed after pumaid wrote it", "sha256")
    try:
        return build(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise damaged(f"{name} lacks entries of a {kind}: {error!r:.80}") from None


def _content(path: Path, name: str, kind: str) -> bytes:
    try:
        with nullcontext(sys.stdin.buffer) if str(path) == "-" else path.open("rb") as stream:
            return stream.read(MOST_BYTES + 1)
    except OSError as error:
        command = _READ[kind][1]
        mend = f"check the path, or make it with '{command}'"
        if path.is_dir():
            files = [file for file in (path / f"{kind}.json", path / "results" / f"{kind}.json") if file.is_file()]
            mend = f"give a file: {files[0] if files else path / f'{kind}.json'}"
        what = f"{name} cannot be read: {error.strerror or error}"
        raise ResultError("file-not-readable", what, Where(file=name), mend) from error


def record_from(kind: Any, entry: Any) -> Any:
    """A dataclass, or what a field of one holds, from its JSON entry; null is NaN where a number is asked for."""
    make, origin, inside = kind, get_origin(kind), get_args(kind)
    if is_dataclass(kind):
        return make(**{name: record_from(inner, entry[key]) for name, key, inner in _fields(make) if key in entry})
    if origin in (Union, UnionType):
        return None if entry is None else record_from(inside[0], entry)
    if origin is np.ndarray:
        array = np.array(entry, dtype=float)
        array.setflags(write=False)
        return array
    if origin is tuple:
        kinds = [inside[0]] * len(entry) if inside[-1] is Ellipsis else inside
        return tuple(record_from(inner, item) for inner, item in zip(kinds, entry, strict=True))
    if isinstance(entry, dict):
        return {key: record_from(inside[1], item) for key, item in entry.items()}
    if kind is float:
        return math.nan if entry is None else float(entry)
    return entry


@cache
def _fields(kind: Any) -> list[tuple[str, str, Any]]:
    """Name, entry in documents and type of a dataclass's fields."""
    types, names = get_type_hints(kind), _ENTRIES.get(kind.__name__, {})
    return [(item.name, names.get(item.name, item.name), types[item.name]) for item in fields(kind)]
