"""Result documents: records as JSON text closed by a digest, and read back from it; model files, which lose nothing."""

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from pumaid import __version__
from pumaid.dataset import BLOCK, STROKE
from pumaid.errors import ModelError, Note, ResultError, Where
from pumaid.estimate import Estimate
from pumaid.io.formats import endings
from pumaid.io.forms import file_name, read_bytes
from pumaid.io.write import write_file
from pumaid.robot import Robot, numbered, worded

Record = TypeVar("Record")

#: The format number that this version writes and reads.
FORMAT = 1
#: Kind of a document that is read -> the command that makes one.
_MADE_BY = {"model": "pumaid identify LOGS...", "diagnosis": "pumaid diagnose MODEL LOGS..."}
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
    if isinstance(value, str):  # bytes of a file name that are not UTF-8 become backslash escapes
        return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode("utf-8")
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, Note):
        return plain(value.as_json())
    if isinstance(value, Mapping):
        return {plain(str(key)): plain(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        names = _ENTRIES.get(type(value).__name__, {})
        parts = {item.name: getattr(value, item.name) for item in fields(value)}
        parts |= {"shape": worded(parts["shape"])} if isinstance(parts.get("shape"), Mapping) else {}
        return {names.get(name, name): plain(part) for name, part in parts.items()}
    return plain(value.tolist()) if hasattr(value, "tolist") else [plain(item) for item in value]


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
    """SHA-256 of what a document says, apart from its own digest."""
    content = {key: entry for key, entry in document.items() if key != "sha256"}
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
        There is no such file, it may not be read, or it is too large.
    ResultError [file-damaged]
        It is not such a document, or was changed since it was written.
    """
    name, mend = file_name(path), f"give a file, or make it with '{_MADE_BY[kind]}'"
    data = read_bytes(path, kind=ResultError, most=MOST_BYTES, mend=mend)

    def damaged(what: str, field: str | None = None, line: int | None = None) -> ResultError:
        is_log = name.lower().endswith(endings())
        mend = "the model comes before the logs: MODEL LOGS..." if is_log else f"make it again with '{_MADE_BY[kind]}'"
        return ResultError("file-damaged", what, Where(file=name, field=field, line=line), mend)

    try:
        document = json.loads(data.decode("utf-8-sig"))
        entries = document if isinstance(document, dict) else {"kind": type(document).__name__}
        digest = digest_of(entries)
    except (ValueError, RecursionError) as error:  # not UTF-8, not JSON, too many digits, too deep
        raise damaged(
            f"{name} is not JSON, or breaks off: {str(error)[:80]}", line=getattr(error, "lineno", None)
        ) from None
    number = entries.get("format")
    if entries.get("kind") != kind:
        raise damaged(f"{name} is not a {kind}: its kind is {entries.get('kind')!r}", "kind")
    if number != FORMAT or isinstance(number, bool):
        what = f"{name} has format {number!r}, and was written by pumaid {entries.get('pumaid')!r}"
        raise damaged(f"{what}; this pumaid ({__version__}) reads format {FORMAT}", "format")
    if entries.get("sha256") != digest:
        raise damaged(f"{name} was changed after pumaid wrote it", "sha256")
    try:
        return build(entries)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise damaged(f"{name} lacks entries of a {kind}: {error!r:.80}") from None


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
        return {key: record_from(inside[1], numbered(key, item)) for key, item in entry.items()}
    return (math.nan if entry is None else float(entry)) if kind is float else entry


@cache
def _fields(kind: Any) -> list[tuple[str, str, Any]]:
    types, names = get_type_hints(kind), _ENTRIES.get(kind.__name__, {})
    return [(item.name, names.get(item.name, item.name), types[item.name]) for item in fields(kind)]


# Model files


def model_document(estimate: Estimate) -> dict[str, Any]:
    """An estimate as its JSON document."""
    ratios = [value for value in estimate.values if value.name.startswith("gain_ratio.")]
    parameters = [value for value in estimate.values if value not in ratios]
    return sealed(
        {
            "kind": "model",
            "format": FORMAT,
            "pumaid": estimate.version or __version__,
            "robot": estimate.robot,
            "recipe": {"file": estimate.origin, "sha256": estimate.recipe_digest},
            "geometry": estimate.geometry,
            "logs": estimate.logs,
            "method": estimate.method,
            "effects": estimate.effects,
            "joints": [
                plain(fit)
                | {"strokes": fit.kinds.get(STROKE, 0), "blocks": fit.kinds.get(BLOCK, 0)}
                | {"parameters": [value for value in parameters if value.joint == fit.joint]}
                for fit in estimate.joints
            ],
            "arm": [value for value in parameters if value.joint is None],
            "ratios": ratios,
            "combinations": estimate.combinations,
            "recursive": estimate.recursive,
            "notes": estimate.notes,
            "heldout": estimate.heldout,
            "prediction": {
                "names": estimate.names,
                "solution": estimate.solution,
                "covariance": estimate.covariance,
                "scales": estimate.scales,
                "blind": estimate.blind,
                "order": [value.name for value in estimate.values],
            },
        }
    )


def write_model(path: Path, estimate: Estimate) -> None:
    """Write a model file atomically; a ResultError [cannot-write] where the system refuses."""
    write_file(Path(path), as_text(model_document(estimate)))


def model_digest(estimate: Estimate) -> str:
    """SHA-256 of the file that `write_model` makes of an estimate, whether it is written or not."""
    notes = tuple(note for note in estimate.notes if note.slug != "model-other-version")
    return hashlib.sha256(as_text(model_document(replace(estimate, notes=notes))).encode("utf-8")).hexdigest()


def read_model(path: Path) -> Estimate:
    """The estimate in a model file, floats bit for bit; ``-`` is standard input.

    A file of another version of pumaid has a note that says so.

    Raises
    ------
    ResultError [file-not-readable], [file-damaged]
        There is no such file, or it may not be read; it is no model file that this version can read, or was changed.
    """
    return read_document(Path(path), "model", estimate_from)


def estimate_from(document: Mapping[str, Any]) -> Estimate:
    """The estimate of a model document."""
    inner = document["prediction"]
    values = [
        *(value for joint in document["joints"] for value in joint["parameters"]),
        *document["arm"],
        *document["ratios"],
    ]
    place = {name: number for number, name in enumerate(inner["order"])}
    entries = {
        **document,
        **inner,
        "version": document["pumaid"],
        "origin": document["recipe"]["file"],
        "recipe_digest": document["recipe"]["sha256"],
        "values": sorted(values, key=lambda value: place[value["name"]]),
    }
    estimate: Estimate = record_from(Estimate, entries)
    notes, p = estimate.notes, len(estimate.names)
    if estimate.version != __version__:
        notes = (
            *notes,
            Note(
                "model-other-version",
                f"the model was written by pumaid {estimate.version}, this is {__version__}; the format is the same",
            ),
        )
    return replace(
        estimate,
        covariance=estimate.covariance.reshape(p, p),
        blind=estimate.blind.reshape(p, -1) if p else np.zeros((0, 0)),
        notes=notes,
    )


def check_same_recipe(estimate: Estimate, robot: Robot) -> None:
    """Refuse a model that was identified with another recipe.

    Where the model or the robot has no recipe file, names and joints are compared.

    Raises
    ------
    ModelError [model-other-recipe]
        They do not belong together.
    """
    what = ""
    if len(estimate.joints) != robot.n_joints:
        what = f"the model is of an arm with {len(estimate.joints)} joints, the recipe has {robot.n_joints}"
    elif estimate.recipe_digest and robot.digest:
        if estimate.recipe_digest != robot.digest:
            digests = f"(SHA-256 {estimate.recipe_digest[:12]}, this one {robot.digest[:12]})"
            what = f"the model of '{estimate.robot}' was identified with another recipe {digests}"
    elif estimate.robot != robot.name:
        what = f"the model is of '{estimate.robot}', the recipe of '{robot.name}'"
    if what:
        raise ModelError(
            "model-other-recipe",
            what,
            Where(file=robot.origin or None),
            "give the recipe that the model was made with by --recipe, or identify again with this one",
        )
