"""Result documents: records as JSON text, and records read back from it with every entry checked."""

from __future__ import annotations

import hashlib
import json
import math
import re
import sys
from collections import Counter
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError, create_model

from pumaid import __version__
from pumaid.errors import Faults, Note, PumaidError, ResultError, Where
from pumaid.robot import Robot

Record = TypeVar("Record")

#: The format number that this version writes and reads.
FORMAT = 1
#: Most faults of one file that are listed; the others are counted.
MOST_FAULTS = 5
#: Most bytes of a document.
MOST_BYTES = 200 << 20
#: Largest number that is accepted; its fourth power is still finite.
LARGEST = 1e60

#: Fields of records whose entry in a document has another name.
_ENTRIES = {
    "Note": {"slug": "note"},
    "Motion": {"start": "from", "end": "to"},
    "NextRun": {"motions": "runs"},
    "JointDiagnosis": {"limits": "unseen"},
}
#: Fields that cannot be negative.
_SIZES = frozenset(
    ("std_error", "rmse", "noise_floor", "run_level", "heldout", "dof", "runs", "samples", "heldout_runs")
)
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
    """The first entries of a document.

    Parameters
    ----------
    kind
        ``"model"``, ``"comparison"`` ...
    robot
        The arm, whose recipe's digest is stated.
    logs
        Name -> SHA-256 of the logs.
    """
    head: dict[str, Any] = {"kind": kind, "format": FORMAT, "pumaid": __version__}
    if robot is not None:
        head |= {"robot": robot.name, "recipe": {"file": Path(robot.origin).name, "sha256": robot.digest}}
    return head if logs is None else head | {"logs": dict(logs)}


def digest_of(document: Mapping[str, Any]) -> str:
    """SHA-256 of what a document says, apart from its own digest and its place in a history."""
    content = {key: entry for key, entry in document.items() if key not in ("sha256", "history")}
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """A document in plain values with its digest, by which `check_seal` sees that it was edited."""
    content = plain(document)
    return content | {"sha256": digest_of(content)}


@dataclass(frozen=True, slots=True)
class Refusals:
    """Builds the errors of one `kind` of document (``"model"``), with `slug`; `command` makes such a file anew."""

    kind: str
    slug: str
    command: str

    def damaged(self, what: str, where: Where) -> ResultError:
        """The file as a whole cannot be used."""
        return ResultError(self.slug, what, where, f"make it again with '{self.command}'")

    def unfit(self, faults: list[tuple[str, str]], file: str) -> PumaidError:
        """Faults of entries, (path, what), as one error or several; of many the others are counted."""
        listed = faults[:MOST_FAULTS]
        more = f" (and {len(faults) - MOST_FAULTS} more faults)" if len(faults) > MOST_FAULTS else ""
        listed[-1] = (listed[-1][0], listed[-1][1] + more)
        errors = [self.damaged(what, Where(file=file, field=path or None)) for path, what in listed]
        return errors[0] if len(errors) == 1 else Faults(errors)


def read_document(path: Path, refusals: Refusals) -> dict[str, Any]:
    """Read a JSON document of a known kind and format; ``-`` is standard input.

    Raises
    ------
    ResultError [file-not-readable]
        There is no such file, or it may not be read.
    ResultError [the kind's slug]
        It is not such a document.
    """
    name = "standard input" if str(path) == "-" else str(path)
    document = _parsed(_content(path, name, refusals), name, refusals)
    kind, number = document.get("kind"), document.get("format")
    if kind != refusals.kind:
        what = f"{name} is not a {refusals.kind}: its kind is {kind!r}"
        raise refusals.damaged(what, Where(file=name, field="kind"))
    if number != FORMAT or isinstance(number, bool):
        what = f"{name} has format {number!r}, and was written by pumaid {document.get('pumaid')};"
        what += f" this pumaid ({__version__}) reads format {FORMAT}"
        raise refusals.damaged(what, Where(file=name, field="format"))
    return document


def _content(path: Path, name: str, refusals: Refusals) -> bytes:
    try:
        with nullcontext(sys.stdin.buffer) if str(path) == "-" else path.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
    except OSError as error:
        what = f"{name} cannot be read: {error.strerror or error}"
        mend = f"check the path, or make it with '{refusals.command}'"
        if path.is_dir():
            inside = [file for file in (path / "model.json", path / "results" / "model.json") if file.is_file()]
            mend = f"give a file: {inside[0] if inside else path / 'model.json'}"
        raise ResultError("file-not-readable", what, Where(file=name), mend) from error
    if len(data) > MOST_BYTES:
        raise refusals.damaged(f"{name} has more than {MOST_BYTES >> 20} MiB", Where(file=name))
    return data


def _parsed(data: bytes, name: str, refusals: Refusals) -> dict[str, Any]:
    repeated: list[str] = []

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        repeated.extend(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        return dict(pairs)

    try:
        document = json.loads(data.decode("utf-8-sig"), object_pairs_hook=once)
        json.dumps(document, ensure_ascii=False).encode("utf-8")
    except UnicodeEncodeError:
        raise refusals.damaged(f"{name} holds half of a surrogate pair, such as \\ud800", Where(file=name)) from None
    except (ValueError, RecursionError) as error:  # not UTF-8, not JSON, too many digits, too deep
        what = f"{name} is not JSON, or breaks off: {str(error)[:80]}"
        if name.lower().endswith((".csv", ".parquet")):
            mend = "the model comes before the logs: MODEL LOGS..."
            raise ResultError(refusals.slug, what, Where(file=name), mend) from None
        raise refusals.damaged(what, Where(file=name, line=getattr(error, "lineno", None))) from None
    if not isinstance(document, dict):
        raise refusals.damaged(f"{name} holds a {type(document).__name__}, not a document", Where(file=name))
    if repeated:
        key = _encodable(repeated[0])
        raise refusals.damaged(f"the entry {key!r} is given twice", Where(file=name, field=key))
    return document


def check_seal(document: Mapping[str, Any], refusals: Refusals, file: str) -> None:
    """Refuse a document that was edited after it was written; earlier versions wrote no digest.

    Raises
    ------
    ResultError [the kind's slug]
        Its digest is not that of its content.
    """
    if document.get("sha256", digest := digest_of(document)) != digest:
        raise refusals.damaged(f"{file} was changed after pumaid wrote it", Where(file=file, field="sha256"))


class Unfit(ValueError):
    """Entries that do not fit a record: `faults` are (path, what)."""

    def __init__(self, faults: list[tuple[str, str]]) -> None:
        super().__init__("; ".join(f"{path}: {what}" for path, what in faults))
        self.faults = faults


def record_from(kind: type[Record], entries: object) -> Record:
    """A record (a dataclass) from JSON entries; entries without a field are ignored.

    Fields may be numbers, text, records, arrays (null is NaN there), and tuples and mappings of these.

    Raises
    ------
    Unfit
        Entries are missing, of a wrong type or impossible.
    """
    try:
        return cast(Record, _adapter(cast(Any, kind)).validate_python(entries))
    except ValidationError as error:
        raise Unfit([(_path(fault["loc"]), _said(fault["msg"], fault["input"])) for fault in error.errors()]) from None


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(_checked_type(kind))


def _checked_type(kind: Any, least: float = -LARGEST) -> Any:
    """The type of a record's field as pydantic checks it: numbers from `least`, lists for tuples and arrays."""
    origin, inside = get_origin(kind), get_args(kind)
    number = Annotated[float, Field(ge=least, le=LARGEST)]
    if is_dataclass(kind):
        make: Any = kind
        return Annotated[_checked_record(kind), AfterValidator(lambda checked: make(**dict(checked)))]
    if origin is np.ndarray:
        return Annotated[list[Any], AfterValidator(_array)]
    if origin in (Union, UnionType):
        inner = next(part for part in inside if part is not type(None))
        return Union[number if inner is float else _checked_type(inner, least), None]  # noqa: UP007 - of a computed type
    if origin is tuple and inside[-1] is Ellipsis:
        return Annotated[list[_checked_type(inside[0], least)], AfterValidator(tuple)]  # type: ignore[misc]
    if origin is tuple:
        length = Field(min_length=len(inside), max_length=len(inside))
        return Annotated[list[_checked_type(inside[0], least)], length, AfterValidator(tuple)]  # type: ignore[misc]
    if origin is not None:  # a mapping
        return dict[str, _checked_type(inside[1], least)]  # type: ignore[misc]
    if kind is float:
        return Annotated[Union[number, None], AfterValidator(lambda value: math.nan if value is None else value)]  # noqa: UP007
    return Annotated[int, Field(ge=max(least, -(2**53)), le=2**53)] if kind is int else kind


def _checked_record(kind: Any) -> Any:
    """The pydantic model of a dataclass."""
    types, names = get_type_hints(kind), _ENTRIES.get(kind.__name__, {})
    entries: dict[str, Any] = {}
    for item in fields(kind):
        least = 0.0 if item.name in _SIZES else 1.0 if item.name == "joint" else -LARGEST
        default: Any = ... if item.default is MISSING else item.default
        if item.default_factory is not MISSING:
            default = item.default_factory()
        field = Field(default, validation_alias=names.get(item.name))
        entries[item.name] = (_checked_type(types[item.name], least), field)
    return create_model(kind.__name__, __config__=ConfigDict(strict=True, extra="ignore"), **entries)


def _array(values: list[Any]) -> np.ndarray[Any, Any]:
    """A read-only array of numbers, null as NaN."""
    try:
        cells = np.array(values, dtype=object)
    except ValueError:
        raise ValueError("its rows differ in length") from None
    numbers = [cell for cell in cells.flat if cell is not None]
    if not all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in numbers):
        raise ValueError("it is not an array of numbers")
    if not all(abs(cell) <= LARGEST for cell in numbers):
        raise ValueError(f"its numbers are not all within {LARGEST:g}")
    array = cells.astype(float)
    array.setflags(write=False)
    return array


def _path(steps: tuple[int | str, ...]) -> str:
    """``("joints", 0, "rmse")`` -> ``joints[0].rmse``."""
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).lstrip(".")


def _said(message: str, value: Any) -> str:
    if message == "Field required":
        return "an entry is missing"
    short = re.sub(r"\d{20,}", lambda digits: f"{float(digits[0]):g}", message)
    return f"{short[0].lower()}{short[1:]}, found {str(value)[:40]!r}"
