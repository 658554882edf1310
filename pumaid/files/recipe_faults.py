"""Faults of a recipe in the user's words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from pumaid.files.recipe_schema import RecipeForm
from pumaid.files.yaml_lines import nearest


class Fault(NamedTuple):
    """One fault: path of keys and 0-based indices, slug, sentence, mend."""

    path: tuple[str | int, ...]
    slug: str
    what: str
    mend: str


def told(value: Any) -> str:
    """A value as a message shows it: short, and named by what it is."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return f"the truth value {str(value).lower()}"
    if isinstance(value, dict):
        return "a mapping"
    text = (
        f"the list {value}"
        if isinstance(value, list)
        else f"the text '{value}'"
        if isinstance(value, str)
        else str(value)
    )
    return text if len(text) <= 80 else f"{text[:77]}..."


def dotted(path: Sequence[str | int]) -> str:
    """``joints[3].alpha`` for ("joints", 2, "alpha"): people count from 1."""
    text = ""
    for step in path:
        text += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def _known_keys(path: Sequence[str | int]) -> list[str]:
    """Keys that the mapping at `path` may have."""
    form: Any = RecipeForm
    for step in path:
        if isinstance(step, str):
            form = _form_at(form, step)
    return list(form.model_fields)


def _form_at(form: Any, key: str) -> Any:
    annotation: Any = form.model_fields[key].annotation
    while not hasattr(annotation, "model_fields"):
        annotation = annotation.__args__[0]
    return annotation


_TYPES = {
    "string": "text",
    "float": "a number",
    "list": "a list",
    "dict": "a mapping of keys to values",
    "model": "a mapping of keys to values",
}


def translated(entry: dict[str, Any]) -> Fault:
    """A pydantic error as (path, slug, what, mend)."""
    path: tuple[str | int, ...] = tuple(entry["loc"])
    kind, value, context = entry["type"], entry["input"], entry.get("ctx", {})
    key = str(path[-1])
    if kind == "pumaid":
        near = nearest(context["word"], context["known"]) if "word" in context else None
        mend = context["mend"] or (f"did you mean {near}?" if near else f"one of {', '.join(context.get('known', []))}")
        return Fault(path, context["slug"], context["what"], mend)
    if kind == "extra_forbidden":
        known = _known_keys(path[:-1])
        near = nearest(key, known)
        mend = f"did you mean {near}?" if near else f"known here: {', '.join(known)}"
        return Fault(path, "recipe-unknown-key", f"there is no key {key[:60]}", mend)
    if kind == "missing":
        return Fault(path, "recipe-missing-key", f"the key {key} is missing", f"add {key}: {_EXAMPLES.get(key, '...')}")
    if kind == "literal_error":
        words = context["expected"].replace("'", "").split(" or ")
        near = nearest(value, words)
        mend = f"did you mean {near}?" if near else f"one of {', '.join(words)}"
        return Fault(path, "recipe-unknown-word", f"{key} is {told(value)}, not {context['expected']}", mend)
    if kind in ("too_short", "too_long"):
        return Fault(path, "recipe-bad-value", *_length_fault(key, value, context))
    if kind == "finite_number":
        return Fault(path, "recipe-bad-value", f"{dotted(path)} is {value}", "write a finite number")
    if kind == "greater_than":
        return Fault(
            path, "recipe-bad-value", f"{key} is {told(value)}", "write a number above 0, or leave the key out"
        )
    wanted = _TYPES.get(kind.split("_")[0], "something else")
    return Fault(path, "recipe-wrong-type", f"{dotted(path)} is {told(value)}, not {wanted}", _type_mend(wanted, value))


_EXAMPLES = {
    "name": "my arm",
    "gravity": "[0, 0, -9.80665]   (m/s2 in base axes; this is upright)",
    "joints": "a list, base to tip",
    "type": "revolute   (or prismatic)",
    "alpha": "the twist before the joint, modified DH",
    "a": "the length before the joint, m, modified DH",
    "effect": "a name that pumaid effects lists",
}


def _length_fault(key: str, value: Any, context: dict[str, Any]) -> tuple[str, str]:
    if key == "joints" and not value:
        return "the list of joints is empty", "add a joint: - {type: revolute, alpha: 0, a: 0, d: 0}"
    bound = context.get("min_length") or context.get("max_length")
    if isinstance(value, str):
        return f"{key} has {len(value)} characters", f"write at most {bound}"
    return f"{key} has {len(value)} values", f"write {bound}" if key != "joints" else f"at most {bound} joints"


def _type_mend(wanted: str, value: Any) -> str:
    if wanted == "text" and not isinstance(value, dict | list):
        return f'put it in quotes: "{value}"' if value is not None else "write a text, or leave the key out"
    if wanted == "a number" and isinstance(value, str):
        if "," in value:
            return "write the decimals after a point; write a list in brackets: [1, 2]"
        return "write a bare number; angles may be written as pi/2 where the unit is rad"
    if wanted == "a list":
        return "write it in brackets: [1, 2]"
    if wanted.startswith("a mapping"):
        return "write it as {key: value, ...}"
    return f"write {wanted}"
