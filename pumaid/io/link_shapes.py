"""Capsules about the shapes that a URDF gives its links: what a plan keeps clear of until the user states better."""

import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np

from pumaid.io.forms import yaml_number, yaml_vector
from pumaid.maths import Floats
from pumaid.robot import placement

#: Radius of a link without shapes, as a share of the arm's length, and m at least. Shapes of a link beyond which a
#: single capsule holds all of them; m that no shape of an arm extends, so that its file is in another unit.
GUESSED, THINNEST, MOST_SHAPES, FARTHEST = 0.06, 0.02, 3, 3.0
#: Bytes of a file that is read at most.
LARGEST = 200_000_000
#: Corners of a cube, points of a sphere and of a cylinder's rims, all of which are 1 m wide and high.
_CUBE = np.array([*product((-0.5, 0.5), repeat=3)])
_SPHERE = 0.5 * np.vstack([np.eye(3), -np.eye(3)])
_RIMS = np.array([(0.5 * np.cos(a), 0.5 * np.sin(a), z) for a in np.arange(16) * np.pi / 8.0 for z in (-0.5, 0.5)])
#: A triangle of a binary STL file; a corner's line of an STL or OBJ file of text.
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"^\s*(?:vertex|v)\s+(\S+)\s+(\S+)\s+(\S+)", re.MULTILINE)


def safety_lines(links: Sequence[Sequence[tuple[ElementTree.Element, Floats]]], folder: Path, length: float) -> str:
    """The keys `links` and `capsules` of a recipe's block `safety`, for an arm `length` m long.

    By link, from 0, `links` has the shapes of a URDF in `folder`, each with the frame (4, 4) in which it is placed.
    """
    rods, bare = list[str](), list[str]()
    guess = yaml_number(max(GUESSED * length, THINNEST), 2)
    for number, shapes in enumerate(links):
        read = [_points(shape, folder) @ frame[:3, :3].T + frame[:3, 3] for shape, frame in shapes]
        solids = [points for points in read if len(points) and np.abs(points).max() < FARTHEST]
        for start, end, radius in map(capsule_about, solids if len(solids) <= MOST_SHAPES else [np.vstack(solids)]):
            ends = f"start: {yaml_vector(start, 3)}, end: {yaml_vector(end, 3)}"
            rods.append(f"    - {{link: {number}, {ends}, radius: {yaml_number(radius, 3)}}}")
        bare += [] if solids else [f"{number}: {guess}"]
    lines = ["  capsules:    # about the file's shapes, m, in the frame of the link", *rods] if rods else []
    about = "radii, m: guesses, since the file's shapes of these links cannot be read"
    return "\n".join([f"  links: {{{', '.join(bare)}}}    # {about}"] * bool(bare) + lines)


def capsule_about(points: Floats) -> tuple[Floats, Floats, float]:
    """Ends (3,) and radius (m, up to the next mm) of a capsule that holds (N, 3) points.

    It lies along an axis of the frame or of inertia, whichever gives the least volume.
    """
    middle, tried = (points.min(axis=0) + points.max(axis=0)) / 2.0, list[tuple[float, Floats, Floats, float]]()
    for axis in np.vstack([np.eye(3), np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]]):
        along = (points - middle) @ axis
        away = np.linalg.norm(points - middle - np.outer(along, axis), axis=1)
        radius = float(np.floor(1e3 * away.max()) + 1.0) / 1e3
        cap = np.sqrt(radius**2 - away**2)
        low, high = float(np.min(along + cap)), float(np.max(along - cap))
        low, high = (low, high) if low < high else (0.5 * (low + high),) * 2  # a sphere holds them
        tried.append((radius**2 * (high - low + 4.0 / 3.0 * radius), middle + low * axis, middle + high * axis, radius))
    return min(tried, key=lambda rod: rod[0])[1:]


def _points(shape: ElementTree.Element, folder: Path) -> Floats:
    """(N, 3) m, corners of an element <collision> or <visual> in its link's frame; none where it cannot be read."""
    origin, geometry = shape.find("origin"), [*(shape.find("geometry") or ())]

    def numbers(element: ElementTree.Element | None, word: str, default: str) -> Floats:
        text = default if element is None else element.get(word, default)
        return np.clip(np.array(text.split(), dtype=float), -1e6, 1e6)

    try:
        solid = geometry[0]
        if solid.tag == "mesh":
            points = _corners(solid.get("filename", ""), folder) * numbers(solid, "scale", "1 1 1")
        elif solid.tag == "box":
            points = _CUBE * numbers(solid, "size", "")
        else:
            width, height = 2.0 * numbers(solid, "radius", "")[0], numbers(solid, "length", "0")[0]
            points = width * _SPHERE if solid.tag == "sphere" else _RIMS * [width, width, height]
        frame = placement(numbers(origin, "xyz", "0 0 0"), numbers(origin, "rpy", "0 0 0"))
        return np.asarray(points @ frame[:3, :3].T + frame[:3, 3])
    except (IndexError, ValueError, OSError):
        return np.zeros((0, 3))


def _corners(name: str, folder: Path) -> Floats:
    """(N, 3) corners of a mesh in an STL or OBJ file, which a ROS package that is or lies above `folder` may hold."""
    place = Path(unquote(name.rpartition("://")[2]))
    above = [folder, *folder.parents] if "package:" in name else [folder]
    tried = (around / part for around in above for part in (place, Path(*place.parts[1:])))
    files = [file for file in tried if file.is_file() and file.stat().st_size < LARGEST]
    content = files[0].read_bytes()
    if len(content) == 84 + _TRIANGLE.itemsize * int.from_bytes(content[80:84], "little"):
        return np.frombuffer(content, _TRIANGLE, offset=84)["corners"].reshape(-1, 3).astype(float)
    return np.array(_CORNER.findall(content), dtype=float).reshape(-1, 3)
