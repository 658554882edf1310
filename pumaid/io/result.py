"""Model files: what an identification found, as JSON that loses nothing."""

from __future__ import annotations

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pumaid import __version__
from pumaid.errors import Faults, ModelError, Note, PumaidError, ResultError, Where
from pumaid.io.write import write_file
from pumaid.records import Combination, Estimate, JointFit, Value
from pumaid.robot import EffectChoice, Robot

Floats = NDArray[np.float64]
Record = TypeVar("Record")

#: The format number that this program writes and reads.
FORMAT = 1

#: Most faults of one file that are told; the rest is counted.
MOST_FAULTS = 5
#: Bytes a model file may have; that of six joints with ten effects has half a megabyte.
MOST_BYTES = 200 << 20

_DAMAGED = "the file was changed or damaged: make it again with 'pumaid identify LOGS...'"
#: How JSON may say half of a letter.
_HALF = re.compile(r"\\u[dD][89a-fA-F]")

# A list of nothing but numbers, over several lines; text holds no bare line end in JSON and so is never touched.
_NUMBERS = re.compile(r"\[\n\s*((?:-?\d[^\[\]\"{}]*|null[^\[\]\"{}]*))\]")


def plain(value: Any) -> Any:
    """`value` as JSON knows it: arrays and tuples become lists, records objects, numbers that JSON lacks null."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, str):
        return _text_of(value)
    if value is None or isinstance(value, int):
        return value
    if isinstance(value, Note):
        return plain(value.as_json())
    if isinstance(value, Mapping):
        return {_text_of(str(key)): plain(held) for key, held in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return [plain(held) for held in value]


def _text_of(value: str) -> str:
    """Text that any program can read: bytes of a file's name that are no letters become backslash escapes."""
    return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode("utf-8")


def as_text(document: Mapping[str, Any], *, ascii_only: bool = False) -> str:
    """A document as JSON text, indented, with each row of numbers on one line; `ascii_only` escapes other letters."""
    indented = json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=ascii_only)
    return (
        _NUMBERS.sub(lambda found: "[" + ", ".join(part.strip() for part in found[1].split(",")) + "]", indented) + "\n"
    )


def heading(kind: str, *, robot: Robot | None = None, logs: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The first entries of every document.

    Parameters
    ----------
    kind
        ``"model"``, ``"comparison"`` ...
    robot
        The arm, whose recipe's digest is told.
    logs
        Name -> SHA-256 of the logs.
    """
    head: dict[str, Any] = {"kind": kind, "format": FORMAT, "pumaid": __version__}
    if robot is not None:
        head |= {"robot": robot.name, "recipe": {"file": Path(robot.origin).name, "sha256": robot.digest}}
    return head if logs is None else head | {"logs": dict(logs)}


def model_document(estimate: Estimate) -> dict[str, Any]:
    """An estimate as the document that interfaces fix; plain values only."""
    ratios = [value for value in estimate.values if _is_ratio(value)]
    own = [value for value in estimate.values if not _is_ratio(value)]
    head = {"kind": "model", "format": FORMAT, "pumaid": estimate.version or __version__, "robot": estimate.robot}
    return plain(
        head
        | {
            "recipe": {"file": estimate.origin, "sha256": estimate.recipe_digest},
            "logs": estimate.logs,
            "method": estimate.method,
            "effects": estimate.effects,
            "joints": [
                plain(fit) | {"parameters": [value for value in own if value.joint == fit.joint]}
                for fit in estimate.joints
            ],
            "arm": [value for value in own if value.joint is None],
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
                "stroke_postures": [{"joint": joint, "hold": hold} for joint, hold in estimate.stroke_postures],
                "order": [value.name for value in estimate.values],
            },
        }
    )


def _is_ratio(value: Value) -> bool:
    return value.name.startswith("gain_ratio.")


def write_model(path: Path, estimate: Estimate) -> None:
    """Write a model file, whole or not at all.

    Parameters
    ----------
    path
        The file; missing folders are made.
    estimate
        The model.

    Raises
    ------
    ResultError [cannot-write]
        The disk refuses.
    """
    write_file(Path(path), as_text(model_document(estimate)))


def read_model(path: Path) -> Estimate:
    """Read a model file; ``-`` is standard input.

    Parameters
    ----------
    path
        What `write_model` wrote.

    Returns
    -------
    estimate
        Equal to the one written; floats bit for bit. A file of another version of pumaid says so in its notes.

    Raises
    ------
    ResultError [model-missing], [model-not-json], [model-wrong-kind], [model-wrong-format]
        It is no model file that this version can read.
    Faults of ResultError [model-damaged]
        Entries are missing, of a wrong type, or do not fit each other; each is told with its path.
    """
    from pumaid.io.result_schema import checked

    name = "standard input" if str(path) == "-" else str(path)
    document = _parsed(_text(Path(path), name), name)
    _check_head(document, name)
    faults = [ResultError("model-damaged", what, Where(file=name, field=at)) for at, what in checked(document)]
    if faults:
        raise _told_together(faults, name)
    return _estimate(document, name)


def check_same_recipe(estimate: Estimate, robot: Robot) -> None:
    """Refuse a model that was identified with another recipe.

    Parameters
    ----------
    estimate
        The model.
    robot
        The arm that it shall be used for. Where one of the two knows no recipe file, names and joints are compared.

    Raises
    ------
    ModelError [model-other-recipe]
        They do not belong together.
    """
    mend = "give the recipe that the model was made with by --recipe, or identify again with this one"
    where = Where(file=robot.origin or None)
    if len(estimate.joints) != robot.n_joints:
        counts = f"the model is of an arm with {len(estimate.joints)} joints, the recipe has {robot.n_joints}"
        raise ModelError("model-other-recipe", counts, where, mend)
    if estimate.recipe_digest and robot.digest and estimate.recipe_digest != robot.digest:
        digests = f"(SHA-256 {estimate.recipe_digest[:12]}, this one {robot.digest[:12]})"
        what = f"the model of '{estimate.robot}' was identified with another recipe {digests}"
        raise ModelError("model-other-recipe", what, where, mend)
    if not (estimate.recipe_digest and robot.digest) and estimate.robot != robot.name:
        what = f"the model is of '{estimate.robot}', the recipe of '{robot.name}'"
        raise ModelError("model-other-recipe", what, where, mend)


def _text(path: Path, name: str) -> str:
    try:
        with nullcontext(sys.stdin.buffer) if str(path) == "-" else path.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
    except FileNotFoundError:
        mend = "make it with 'pumaid identify LOGS...', or give its path"
        raise ResultError("model-missing", f"there is no model file {name}", Where(file=name), mend) from None
    except IsADirectoryError:
        inside = (path / "model.json", path / "results" / "model.json")
        mend = f"give the file in it: {next((found for found in inside if found.is_file()), inside[0])}"
        raise ResultError("model-missing", f"{name} is a folder, not a model file", Where(file=name), mend) from None
    if len(data) > MOST_BYTES:
        raise _no_json(f"{name} has more than {MOST_BYTES >> 20} MiB, which no model has", Where(file=name))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _no_json(f"{name} is not text (byte {error.start} is no UTF-8)", Where(file=name)) from None


def _no_json(what: str, where: Where) -> ResultError:
    is_log = str(where.file).lower().endswith((".csv", ".parquet"))
    mend = (
        "the model comes before the logs: MODEL LOGS..." if is_log else "make it again with 'pumaid identify LOGS...'"
    )
    return ResultError("model-not-json", what, where, mend)


def _parsed(text: str, name: str) -> dict[str, Any]:
    if not text.strip():
        raise _no_json(f"{name} is empty", Where(file=name))
    try:
        found = json.loads(text, object_pairs_hook=partial(_once, name=name))
    except json.JSONDecodeError as error:
        ends = error.pos >= len(text.rstrip())
        what = f"{name} breaks off in the middle" if ends else f"{name} is no JSON: {error.msg}"
        raise _no_json(what, Where(file=name, line=error.lineno)) from None
    except ValueError:
        raise _no_json(f"{name} holds a number of thousands of digits", Where(file=name)) from None
    except RecursionError:
        raise _no_json(f"{name} is no JSON that a program should read: its lists nest too deep", Where(name)) from None
    if _HALF.search(text) and (at := _half_letter(found)) is not None:
        what = f"{name} holds half of a letter, which is no text (an escape such as \\ud800)"
        raise ResultError("model-damaged", what, Where(file=name, field=at or None), _DAMAGED)
    if not isinstance(found, dict):
        raise _no_json(f"{name} holds a {type(found).__name__}, not a document", Where(file=name))
    return found


def _once(pairs: list[tuple[str, Any]], *, name: str) -> dict[str, Any]:
    """An object of JSON, in which each entry stands once; else it is left to chance which one a program reads."""
    found = dict(pairs)
    if len(found) < len(pairs):
        key = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        where = Where(file=name, field=_text_of(key))
        raise ResultError("model-damaged", f"the entry {_text_of(key)!r} stands there twice", where, _DAMAGED)
    return found


def _half_letter(found: Any, path: str = "") -> str | None:
    """Where a text stands that no encoding knows, or None."""
    if isinstance(found, str):
        return path if _text_of(found) != found else None
    inside = found.items() if isinstance(found, dict) else enumerate(found) if isinstance(found, list) else ()
    for key, held in inside:
        at = f"{path}[{key}]" if isinstance(key, int) else f"{path}.{_text_of(key)}".lstrip(".")
        if isinstance(key, str) and _text_of(key) != key:
            return at
        if (deeper := _half_letter(held, at)) is not None:
            return deeper
    return None


def _check_head(document: Mapping[str, Any], name: str) -> None:
    kind, number = document.get("kind"), document.get("format")
    if kind != "model":
        what = f"{name} is not a model: its kind is {kind!r}" if kind else f"{name} is not a model: it has no kind"
        mend = "give the file that 'pumaid identify' wrote (results/model.json)"
        raise ResultError("model-wrong-kind", what, Where(file=name, field="kind"), mend)
    if number != FORMAT or isinstance(number, bool):
        what = f"{name} has format {number!r}, this pumaid ({__version__}) reads format {FORMAT}"
        mend = f"it was written by pumaid {document.get('pumaid')}: use that version, or identify again with this one"
        raise ResultError("model-wrong-format", what, Where(file=name, field="format"), mend)


def _told_together(faults: list[ResultError], name: str) -> PumaidError:
    shown = faults[:MOST_FAULTS]
    more = f" (and {len(faults) - MOST_FAULTS} more faults)" if len(faults) > MOST_FAULTS else ""
    last = ResultError(shown[-1].slug, shown[-1].what + more, shown[-1].where, _DAMAGED)
    return Faults([*shown[:-1], last])


def _estimate(document: Mapping[str, Any], name: str) -> Estimate:
    inner = document["prediction"]
    joints = document["joints"]
    values = [_value(one, joint=fit["joint"]) for fit in joints for one in fit["parameters"]]
    values += [_value(one, joint=one.get("joint")) for one in (*document["arm"], *document["ratios"])]
    place = {value_name: number for number, value_name in enumerate(inner["order"])}
    p = len(inner["names"])
    found = Estimate(
        robot=document["robot"],
        joints=tuple(_record(JointFit, fit) for fit in joints),
        values=tuple(sorted(values, key=lambda value: place.get(value.name, len(place)))),
        names=tuple(inner["names"]),
        solution=_array(inner["solution"]),
        covariance=_array(inner["covariance"]).reshape(p, p),
        scales=_array(inner["scales"]),
        blind=_array(inner["blind"]) if p else np.zeros((0, 0)),
        stroke_postures=tuple((one["joint"], tuple(one["hold"])) for one in inner["stroke_postures"]),
        effects=tuple(_record(EffectChoice, one) for one in document["effects"]),
        combinations=tuple(_record(Combination, one) for one in document["combinations"]),
        recursive=tuple(_value(one, joint=one.get("joint")) for one in document["recursive"]),
        method=document["method"],
        recipe_digest=document["recipe"]["sha256"],
        origin=document["recipe"]["file"],
        logs=dict(document["logs"]),
        notes=tuple(Note(one["note"], one["text"], _record(Where, one["where"])) for one in document["notes"]),
        version=document["pumaid"],
        heldout=document.get("heldout"),
    )
    if found.version == __version__:
        return found
    text = f"{name} was written by pumaid {found.version}, this is {__version__}; the format is the same"
    return replace(found, notes=(*found.notes, Note("model-other-version", text)))


def _array(numbers: list[Any]) -> Floats:
    found = np.array(numbers, dtype=float)
    found.setflags(write=False)
    return found


def _record(kind: type[Record], entries: Mapping[str, Any]) -> Record:
    """A record of its own fields among `entries`; what a later version added is passed over."""
    known = {item.name for item in fields(kind)}  # type: ignore[arg-type]
    return kind(**{key: held for key, held in entries.items() if key in known})


def _value(entries: Mapping[str, Any], *, joint: int | None) -> Value:
    interval = entries.get("ci95")
    return _record(Value, {**entries, "joint": joint, "ci95": None if interval is None else tuple(interval)})
