"""Faults of a recipe in the user's words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from pumaid.io.recipe_schema import RecipeForm
from pumaid.io.yaml_lines import nearest


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
    "int": "a whole number",
}


def translated(entry: dict[str, Any]) -> Fault:
    """A pydantic error as (path, slug, what, mend)."""
    path: tuple[str | int, ...] = tuple(entry["loc"])
    kind, value, context = entry["type"], entry["input"], entry.get("ctx", {})
    key = str(path[-1])
    if kind == "pumaid":
        return Fault(
            path, context["slug"], context["what"], context["mend"] or _nearest(context["word"], context["known"])
        )
    if kind == "extra_forbidden":
        mend = "write the values out" if key == "<<" else _nearest(key, _known_keys(path[:-1]))
        return Fault(path, "recipe-unknown-key", f"there is no key {key[:60]}", mend)
    if kind == "missing":
        return Fault(path, "recipe-missing-key", f"the key {key} is missing", f"add {key}: {_EXAMPLES.get(key, '...')}")
    if kind == "literal_error":
        words = context["expected"].replace("'", "").split(" or ")
        what = f"{key} is {told(value)}, not {context['expected']}"
        return Fault(path, "recipe-unknown-word", what, _nearest(value, words))
    if kind in ("too_short", "too_long", "string_too_long"):
        return Fault(path, "recipe-bad-value", *_length_fault(key, value, context))
    if kind == "finite_number":
        return Fault(path, "recipe-bad-value", f"{dotted(path)} is {value}", "write a finite number")
    if kind == "greater_than":
        return Fault(
            path, "recipe-bad-value", f"{key} is {told(value)}", "write a number above 0, or leave the key out"
        )
    wanted = _TYPES.get(kind.split("_")[0], "something else")
    return Fault(
        path, "recipe-wrong-type", f"{dotted(path)} is {told(value)}, not {wanted}", _type_mend(path, wanted, value)
    )


_EXAMPLES = {
    "name": "my arm",
    "gravity": "[0, 0, -9.80665]   (m/s2 in base axes; this is upright)",
    "joints": "a list, base to tip",
    "type": "revolute   (or prismatic)",
    "alpha": "the twist before the joint, modified DH",
    "a": "the length before the joint, m, modified DH",
    "effect": "a name that pumaid effects lists",
    "min": "[x, y, z]   (the lowest corner, m in base axes)",
    "max": "[x, y, z]   (the highest corner, m in base axes)",
    "link": "the link that carries the sphere; 0 is the base",
    "centre": "[x, y, z]   (m, in the link's frame)",
    "radius": "the sphere's radius, m",
}


def without_echoes(faults: list[Fault]) -> list[Fault]:
    """The faults without the missing keys that a misspelt key beside them stands for."""
    meant = {(fault.path[:-1], fault.mend) for fault in faults if fault.slug == "recipe-unknown-key"}
    return [
        fault
        for fault in faults
        if fault.slug != "recipe-missing-key" or (fault.path[:-1], f"did you mean {fault.path[-1]}?") not in meant
    ]


def _nearest(word: Any, known: Sequence[str]) -> str:
    near = nearest(word, known)
    return f"did you mean {near}?" if near else f"known here: {', '.join(known)}"


def _length_fault(key: str, value: Any, context: dict[str, Any]) -> tuple[str, str]:
    if key == "joints" and not value:
        return "the list of joints is empty", "add a joint: - {type: revolute, alpha: 0, a: 0, d: 0}"
    bound = context.get("min_length") or context.get("max_length")
    if isinstance(value, str):
        return f"{key} has {len(value)} characters", f"write at most {bound}"
    return f"{key} has {len(value)} values", f"write {bound}" if key != "joints" else f"at most {bound} joints"


_FORMS = {
    "gravity": "[0, 0, -9.80665]",
    "joints": "a line - {type: revolute, alpha: 0, a: 0, d: 0} for each joint",
    "limits": "[lowest, highest]",
    "effects": "[{effect: NAME, joint: 3}]",
    "position": "[1, -1, ...], a sign for each joint",
    "current": "[1, -1, ...], a sign for each joint",
    "units": "{angle: deg}",
    "signs": "{position: [1, -1, ...]}",
    "log": "its keys below it, indented",
    "shape": "{velocity: 0.1}",
    "safety": "its keys below it, indented: boxes, spheres, tool, margin",
    "boxes": "[{name: table, min: [-1, -1, -1], max: [1, 1, -0.02]}]",
    "spheres": "[{link: 3, centre: [0.2, 0, 0], radius: 0.08}]",
    "min": "[x, y, z], m",
    "max": "[x, y, z], m",
    "centre": "[x, y, z], m",
    "tool": "[x, y, z], m",
    "ignore": "[[4, 6]], pairs of links",
}


def _type_mend(path: Sequence[str | int], wanted: str, value: Any) -> str:
    key = str(path[-1])
    if wanted == "text":
        return f'put it in quotes: "{value}"' if isinstance(value, int | float) else "write a text"
    if wanted == "a number" and isinstance(value, str) and re.fullmatch(r"\s*[-+]?\d+,\d+\s*", value):
        return f"write the decimals after a point: {value.strip().replace(',', '.')}"
    if wanted == "a number":
        return "write a bare number" + (" (pi/2 and the like where the unit is rad)" if key in _ANGLES else "")
    if key in _FORMS:
        return f"write {_FORMS[key]}"
    if path[0] == "effects" and isinstance(value, str):
        return f"write {{effect: {value}}}"
    return f"write {_FORMS['joints']}" if path[0] == "joints" else f"write {wanted}"


_ANGLES = ("alpha", "theta", "limits", "max_velocity")
