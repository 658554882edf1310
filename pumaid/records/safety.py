"""What the arm must not touch: forbidden boxes, and spheres that stand for its links."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """A block along the base's axes that the tip and every sphere stay out of: lowest and highest corner, m."""

    name: str
    low: Point
    high: Point


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball fixed to a link: `link` 0 is the base, 1..J what each joint moves; `centre` in the link's frame, m."""

    link: int
    centre: Point
    radius: float


@dataclass(frozen=True, slots=True)
class Safety:
    """The block `safety` of a recipe.

    Attributes
    ----------
    boxes, spheres
        Forbidden space and the arm's own extent; either may be empty.
    tool
        The tip in the last link's frame, m; none is that frame's origin, which is held against boxes only.
    margin
        Distance that must be left, m.
    ignore
        Pairs of links whose spheres are not held against each other; neighbours never are.
    """

    boxes: tuple[Box, ...] = ()
    spheres: tuple[Sphere, ...] = ()
    tool: Point | None = None
    margin: float = 0.02
    ignore: tuple[tuple[int, int], ...] = ()
