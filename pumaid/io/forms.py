"""Files that people write, checked by pydantic: every fault at once, with path, line and the nearest right word."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, NoReturn, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import PydanticCustomError

from pumaid.errors import Faults, PumaidError, Where
from pumaid.io.yaml_file import Document, nearest

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
    """How faults of one kind of file are told.

    Attributes
    ----------
    error
        The type of error.
    examples
        Key -> what it looks like.
    slug
        The slug of every fault, or none to use the one of each kind of fault.
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
