"""The block `safety` of a recipe: faults that show only when its values are seen together, and the record of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from pumaid.io.recipe_faults import Fault
from pumaid.io.recipe_schema import SafetyForm
from pumaid.robot import Box, Safety, Sphere


def safety_faults(block: Any, n_joints: int) -> Iterator[Fault]:
    """Boxes turned inside out, links that the arm has not, names given twice.

    Parameters
    ----------
    block
        What stands under `safety`, as YAML gave it; values of a wrong type are passed over, the schema tells of them.
    n_joints
        Joints of the recipe.
    """
    block = block if isinstance(block, dict) else {}
    yield from _boxes(_listed(block, "boxes"))
    known = f"links count from 0 (the base) to {n_joints}"
    for index, sphere in enumerate(_listed(block, "spheres")):
        link = sphere.get("link") if isinstance(sphere, dict) else None
        if _is_whole(link) and link not in range(n_joints + 1):
            yield Fault(("safety", "spheres", index, "link"), "recipe-bad-value", f"there is no link {link}", known)
    for index, pair in enumerate(_listed(block, "ignore")):
        links = [link for link in pair if _is_whole(link)] if isinstance(pair, list) else []
        path = ("safety", "ignore", index)
        for link in links:
            if link not in range(n_joints + 1):
                yield Fault(path, "recipe-bad-value", f"there is no link {link}", known)
        if len(links) == 2 and abs(links[0] - links[1]) <= 1:
            what = f"links {links[0]} and {links[1]} are neighbours or one, and never held against each other"
            yield Fault(path, "recipe-bad-value", what, "take the pair away")


def _boxes(boxes: list[Any]) -> Iterator[Fault]:
    seen: dict[str, int] = {}
    for index, box in enumerate(boxes):
        if not isinstance(box, dict):
            continue
        name = _name(index, box.get("name"))
        first = seen.setdefault(name, index)
        if first != index:
            what = f"boxes {first + 1} and {index + 1} are both named {name[:60]}"
            yield Fault(("safety", "boxes", index, "name"), "recipe-duplicate", what, "give each box its own name")
        for axis, least, most in zip("xyz", _listed(box, "min"), _listed(box, "max"), strict=False):
            if _is_number(least) and _is_number(most) and least >= most:
                what = f"along {axis} the box reaches from {least:g} to {most:g} m, so it has no inside"
                mend = "write the lower corner as min and the upper as max"
                yield Fault(("safety", "boxes", index), "recipe-bad-value", what, mend)


def safety_of(form: SafetyForm | None) -> Safety | None:
    """The record of a block without faults; lengths are in m whatever the file's unit of angles."""
    if form is None:
        return None
    boxes = tuple(Box(_name(index, box.name), _point(box.min), _point(box.max)) for index, box in enumerate(form.boxes))
    spheres = tuple(Sphere(one.link, _point(one.centre), one.radius) for one in form.spheres)
    tool = None if form.tool is None else _point(form.tool)
    return Safety(boxes, spheres, tool, form.margin, tuple((min(pair), max(pair)) for pair in form.ignore))


def _point(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return float(x), float(y), float(z)


def _name(index: int, given: Any) -> str:
    return given if isinstance(given, str) else f"box {index + 1}"


def _listed(block: dict[Any, Any], key: str) -> list[Any]:
    found = block.get(key)
    return found if isinstance(found, list) else []


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
