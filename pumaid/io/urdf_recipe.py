"""A recipe from a URDF: modified DH parameters derived, written as text, read back, and held against the URDF."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pumaid.errors import Note, RecipeError, Where
from pumaid.io.recipe import RECIPE_NAME, read_recipe
from pumaid.io.recipe_schema import LONGEST_LINK
from pumaid.io.urdf import Urdf, read_urdf
from pumaid.io.urdf_agreement import POSTURES, Agreement, agreement
from pumaid.io.urdf_chain import ArmChain, arm_chain
from pumaid.io.urdf_joints import joints_of, notes_on_chain
from pumaid.io.urdf_text import Origin, Rounding, dh_text
from pumaid.maths.chain import SerialChain, placement
from pumaid.maths.dh import DhChain, modified_dh, straightened
from pumaid.robot import Joint, Robot
from pumaid.units import factor, number

#: How well the written recipe must agree with the URDF (rad and m).
TOLERANCE = 1e-8
#: Standard acceleration of free fall, m/s2.
FREE_FALL = 9.80665
#: The first takes away the rounding of angles that a URDF writes with nine decimals, the second only our own.
ROUNDINGS = (Rounding(decimals=9, snap=2.5e-9), Rounding(decimals=14, snap=1e-12))


@dataclass(frozen=True, slots=True)
class UrdfRecipe:
    """A recipe made from a URDF.

    Attributes
    ----------
    text
        What goes into the file.
    robot
        The same, read back.
    urdf, chain
        What it was made from.
    base
        (4, 4) the recipe's frame 0 in the URDF's link `chain.base` (m).
    agreement
        With the URDF as it is written.
    notes
        What the URDF lacks, and what was left out.
    """

    text: str
    robot: Robot
    urdf: Urdf
    chain: ArmChain
    base: NDArray[np.float64]
    agreement: Agreement
    notes: tuple[Note, ...]


def recipe_from_urdf(path: Path, *, base: str | None = None, tip: str | None = None) -> UrdfRecipe:
    """Make a recipe from a URDF.

    Parameters
    ----------
    path
        The URDF; ``-`` is standard input.
    base, tip
        Links between which the arm lies; found where not given (`arm_chain`).

    Raises
    ------
    RecipeError [file-not-readable, urdf-refused, urdf-xacro, urdf-structure, urdf-bad-value]
        The file cannot be used.
    RecipeError [urdf-no-link, urdf-which-chain, urdf-no-chain]
        It is not clear which joints are the arm.
    RecipeError [urdf-not-derived]
        No recipe agrees with the URDF's axes.
    """
    urdf = read_urdf(path)
    chain = arm_chain(urdf, base=base, tip=tip)
    joints, notes = joints_of(chain)
    stated, down = _geometry(chain)
    usable, bent = straightened(stated)
    dh = modified_dh(usable)
    _refuse_far(urdf, joints, dh)
    gravity = dh.base[:3, :3].T @ down * FREE_FALL
    origin = _origin(urdf, chain, is_bent=bool(bent))
    for rounding in ROUNDINGS:
        text = dh_text(dh, joints, gravity, origin=origin, rounding=rounding)
        robot = _read_back(text)
        found = agreement(robot, usable, dh.base)
        off = float(np.linalg.norm(np.array(robot.gravity) - gravity)) / FREE_FALL
        if found.within(TOLERANCE) and off <= TOLERANCE:
            break
    else:
        what = f"the recipe's axes differ from the URDF's by {found.direction:.1e} rad and {found.place:.1e} m"
        raise RecipeError("urdf-not-derived", what, Where(file=urdf.file), "please report it, with the URDF")
    seen = agreement(robot, stated, dh.base)
    if not seen.within(TOLERANCE):
        notes += _note_on_bent(chain, bent, seen)
    return UrdfRecipe(text, robot, urdf, chain, dh.base, seen, (*notes_on_chain(chain), *notes))


def _geometry(chain: ArmChain) -> tuple[SerialChain, NDArray[np.float64]]:
    """The joints' frames and axes, fixed joints folded in, and which way is down in the base (unit vector)."""
    frames, so_far = [], np.eye(4)
    for joint in chain.path:
        so_far = so_far @ placement(*joint.origin)
        if joint.moves:
            frames.append(so_far)
            so_far = np.eye(4)
    base = np.eye(4)
    for joint in chain.before:
        base = base @ placement(*joint.origin)
    axes = np.array([joint.axis for joint in chain.moving])
    slides = np.array([joint.kind == "prismatic" for joint in chain.moving])
    return SerialChain(np.array(frames), axes, slides), -base[2, :3]


def _origin(urdf: Urdf, chain: ArmChain, *, is_bent: bool) -> Origin:
    name = urdf.name.strip() if urdf.name.strip() and urdf.name.isprintable() else "arm"
    agrees = "Nearly parallel axes were made parallel; then all" if is_bent else "All"
    agrees += f" axes agree with the URDF's within {TOLERANCE:g} rad and m in {POSTURES} random postures."
    return Origin(Path(urdf.file).name, urdf.digest, name[:200], chain.base, chain.tip, agrees)


def _read_back(text: str) -> Robot:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / RECIPE_NAME
        path.write_text(text, encoding="utf-8")
        return read_recipe(path)


def _refuse_far(urdf: Urdf, joints: Sequence[Joint], dh: DhChain) -> None:
    """Axes whose common normal lies so far off that no recipe may hold it."""
    for joint, a, d in zip(joints, dh.a, dh.d, strict=True):
        if max(abs(a), abs(d)) > LONGEST_LINK:
            what = f"joint {joint.name} needs a of {a:.4g} m and d of {d:.4g} m, beyond {LONGEST_LINK:g} m"
            mend = "a URDF is in metres; where axes are nearly parallel, write them as parallel"
            raise RecipeError("urdf-not-derived", what, Where(file=urdf.file, joint=joint.number), mend)


def _note_on_bent(chain: ArmChain, bent: dict[int, float], seen: Agreement) -> list[Note]:
    turned = [f"{chain.moving[n - 1].name} by {number(angle / factor('deg'), 2)} deg" for n, angle in bent.items()]
    text = (
        f"nearly parallel axes were made parallel, for their common normal lies anywhere: {', '.join(turned)}; no axis"
        f" is off by more than {number(seen.direction / factor('deg'), 2)} deg and {number(seen.place * 1e3, 2)} mm"
    )
    return [Note("urdf-made-parallel", text)]
