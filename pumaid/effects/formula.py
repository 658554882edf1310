"""What an effect sees of a motion, and its formula: one text from which columns, exports and documents are made.

A formula is Python arithmetic with ``sin cos tanh exp sqrt abs sign max`` and comparisons, linear in the effect's
parameters. Parameters and shapes stand in it by their own names. Of the joint whose current it is:

- ``q``, ``qd``, ``qdd`` its position, velocity, acceleration; ``s`` +1 while its shaft turns forward, else -1;
- ``shaft`` the velocity that drives its friction (its own unless gears couple it), ``v`` the size of that;
- ``t``, ``elapsed`` time since the joint's, the arm's first motion; ``path`` travelled since the motion began;
- ``temperature`` in degC, 25 where it was not measured; ``joint`` its number;
- ``load`` gravity's current by the paper's model (and inertia's in blocks), ``load_rate`` how fast it changes,
  ``drawn`` it and Coulomb and viscous friction;
- ``tilt_x``, ``tilt_y`` the derivative of ``load`` by a turn of the base, ``across`` gravity's moment across the axis;
- ``load_owner``, ``slope_owner`` the load of the joint that owns the parameters, the derivative of ``load`` by its
  position; ``friction_owner`` its Coulomb and viscous friction;
- ``owner`` its number, ``shaft_on`` what ``shaft`` is of the joint that the shape ``on`` names;
- ``gamma_p``, ``gamma_x``, ``gamma_y``, ``gamma_z`` what a unit of mass at the origin of the last link's frame draws,
  and a unit of first moment along its axes, in units of the last joint's gain, inertia among it.
"""

import ast
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from types import CodeType
from typing import Any

import numpy as np

from pumaid.maths import Counts, Floats
from pumaid.robot import Robot

#: degC that a joint has where its temperature was not measured; it only shifts Coulomb friction.
REFERENCE = 25.0
#: Positions of a run from which two harmonics of the position are known.
PLACES = 5
#: What a formula may call.
FUNCTIONS = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "abs", "sign")},
    "max": np.maximum,
}

#: Quantities made from the loads that a fit gives; and those that a posture and velocities determine, so that an
#: exported model can have them.
GAMMAS = ("gamma_p", "gamma_x", "gamma_y", "gamma_z")
OF_OWNER = frozenset({"load_owner", "slope_owner", "friction_owner"})
OF_LOADS = frozenset({"load", "load_rate", "drawn", "across", "tilt_x", "tilt_y", *OF_OWNER})
OF_MOTION = OF_LOADS - {"load_rate"} | {*GAMMAS, "q", "v", "s", "shaft", "shaft_on", "joint", "owner"}


_empty = partial(np.zeros, 0)


@dataclass(frozen=True, eq=False, slots=True)
class Loads:
    """What the model fitted so far says at M instants of joint i in motion; all in A of the motor named.

    `tilts` are, of a joint whose ratio to those beyond it is not known, in the gain of the next joint outward whose is.
    """

    moving: Floats  # (M,) gravity's current in joint i
    by_joint: Floats  # (M, J) gravity's current in every joint k at this posture, in its own motor; NaN where not known
    slopes: Floats  # (M, J) A/rad or A/m: derivative of `moving` by each joint's position
    tilts: Floats  # (M, 2) A/rad: derivative of `moving` by a turn of the base about the base frame's x and y
    # (M,) size of gravity's moment across joint i's axis, as the current that it would draw if it lay along it, in the
    # gain of `tilts`; zero for a prismatic joint
    across: Floats
    drawn: Floats  # (M,) the model's whole prediction in joint i
    rate: Floats  # (M,) A/s: how fast `moving` changes, in blocks with what the rotor draws
    # (2, J, 2) Coulomb and viscous friction of each joint (A, and A s/rad or A s/m), forward and backward
    rubs: Floats = field(default_factory=_empty)


@dataclass(frozen=True, eq=False, slots=True)
class Samples:
    """M instants of joint `joint` (from 1) in motion."""

    joint: int
    position: Floats  # (M, J) rad or m
    velocity: Floats  # (M, J) rad/s or m/s
    acceleration: Floats = field(default_factory=_empty)  # (M,) rad/s2 or m/s2 of the moving joint
    # (M,) +1 or -1: sign of the motion that the run is in (not of a noisy velocity)
    direction: Floats = field(default_factory=_empty)
    time: Floats = field(default_factory=_empty)  # (M,) s since the joint's first motion in the campaign
    elapsed: Floats = field(default_factory=_empty)  # (M,) s since the arm's first motion, recordings one after another
    travel: Floats = field(default_factory=_empty)  # (M,) rad or m since the motion began
    temperature: Floats = field(default_factory=_empty)  # (M,) degC, NaN where not measured
    run: Floats = field(default_factory=_empty)  # (M,) number of the run that each instant belongs to
    # (M, 10) N m (N) that a unit of each parameter of the last link's body asks: mass, first moments, those of inertia
    bodies: Floats = field(default_factory=partial(np.zeros, (0, 10)))
    loads: Loads | None = None  # what the model so far says of gravity; none where it is not known yet
    # (M, E) columns of the logs that the user suspects, in the logs' own units; none where not asked for
    extra: Floats | None = None

    def __len__(self) -> int:
        return len(self.position)

    def series(self) -> dict[str, Any]:
        """The arrays that have a value an instant, by name; those that are not given left out."""
        named = {item.name: getattr(self, item.name) for item in fields(self) if item.name not in ("joint", "loads")}
        return {name: values for name, values in named.items() if values is not None and len(values) == len(self)}


def loads_of(samples: Samples) -> Loads:
    """The loads at `samples`, which whoever calls an effect with `needs_loads` has filled."""
    assert samples.loads is not None
    return samples.loads


def at(samples: Samples, rows: Counts) -> Samples:
    """The instants `rows` of some samples."""
    chosen = Samples(samples.joint, **{name: values[rows] for name, values in samples.series().items()})
    if samples.loads is None:
        return chosen
    loads = {item.name: getattr(samples.loads, item.name) for item in fields(Loads)}
    return replace(chosen, loads=Loads(**{name: v if name == "rubs" else v[rows] for name, v in loads.items()}))


def swept(samples: Samples, sizes: Counts, table: Callable[[Samples], Floats], *, turns: bool) -> Floats:
    """A table's values (M, F) at all of M instants of R runs of `sizes` instants each, asked for at `PLACES` of each.

    Exact for whatever is a direction of a link, a lever or a load, or a product of two of them, while one joint moves
    (`turns`, or slides) and the others stand: two harmonics of its position, or its square of a slide's. Columns with a
    NaN in a run are NaN in all of it. Where other joints move, too, the table is asked at every instant.
    """
    starts, moving = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64), samples.joint - 1
    is_free = np.logical_or.reduceat(np.delete(samples.velocity, moving, axis=1).any(axis=1), starts)
    free = np.flatnonzero(np.repeat(is_free, sizes))
    if len(free) == len(samples):
        return table(samples)
    if len(free):
        rest = np.flatnonzero(~np.repeat(is_free, sizes))
        alone = swept(at(samples, rest), sizes[~is_free], table, turns=turns)
        out = np.empty((len(samples), alone.shape[1]))
        out[rest], out[free] = alone, table(at(samples, free))
        return out
    places = np.linspace(0.0, 2.0 * np.pi, PLACES, endpoint=False) if turns else np.linspace(-1.0, 1.0, PLACES)
    knots = at(samples, np.repeat(starts, PLACES))
    position = knots.position.copy()
    position[:, moving] = np.tile(places, len(sizes))
    asked = table(replace(knots, position=position))
    live, out = asked.any(axis=0), np.zeros((len(samples), asked.shape[1]))
    parts = np.linalg.pinv(_harmonics(places, turns)) @ asked[:, live].reshape(len(sizes), PLACES, -1)
    basis = np.split(_harmonics(samples.position[:, moving], turns), starts[1:])
    out[:, live] = np.vstack([at_run @ part for at_run, part in zip(basis, parts, strict=True)])
    return out


def _harmonics(q: Floats, turns: bool) -> Floats:
    """(M, 5) two harmonics of an angle, or (M, 3) powers of a displacement."""
    if turns:
        return np.column_stack([np.ones(len(q)), np.cos(q), np.sin(q), np.cos(2.0 * q), np.sin(2.0 * q)])
    return np.column_stack([np.ones(len(q)), q, q * q])


def _way(robot: Robot, samples: Samples, owner: int) -> Floats:
    """(M,) the sign of a motion; where gears turn the joint's shaft against the joint, that of the shaft."""
    shaft, joint = (v[:, samples.joint - 1] for v in (robot.shaft_velocity(samples.velocity), samples.velocity))
    return np.where(shaft * joint < 0.0, np.sign(shaft), samples.direction)


def _friction(robot: Robot, samples: Samples, joint: int) -> Floats:
    v, (dry, viscous) = robot.shaft_velocity(samples.velocity)[:, joint - 1], loads_of(samples).rubs[:, joint - 1]
    ways = np.column_stack([v > 0.0, v < 0.0])
    return np.asarray(ways @ dry + (ways @ viscous) * v)


#: Name in a formula -> (M,) values at instants of one moving joint, given the owner of the parameters (from 1).
QUANTITIES: Mapping[str, Callable[[Robot, Samples, int], Any]] = {
    "q": lambda robot, samples, owner: samples.position[:, samples.joint - 1],
    "qd": lambda robot, samples, owner: samples.velocity[:, samples.joint - 1],
    "qdd": lambda robot, samples, owner: samples.acceleration,
    "s": _way,
    "shaft": lambda robot, samples, owner: robot.shaft_velocity(samples.velocity)[:, samples.joint - 1],
    "v": lambda robot, samples, owner: np.abs(robot.shaft_velocity(samples.velocity)[:, samples.joint - 1]),
    "t": lambda robot, samples, owner: samples.time,
    "elapsed": lambda robot, samples, owner: samples.elapsed,
    "path": lambda robot, samples, owner: samples.travel,
    "temperature": lambda robot, samples, owner: np.where(
        np.isnan(samples.temperature), REFERENCE, samples.temperature
    ),
    "joint": lambda robot, samples, owner: samples.joint,
    "owner": lambda robot, samples, owner: owner,
    "load": lambda robot, samples, owner: loads_of(samples).moving,
    "load_rate": lambda robot, samples, owner: loads_of(samples).rate,
    "drawn": lambda robot, samples, owner: loads_of(samples).drawn,
    "across": lambda robot, samples, owner: loads_of(samples).across,
    "tilt_x": lambda robot, samples, owner: loads_of(samples).tilts[:, 0],
    "tilt_y": lambda robot, samples, owner: loads_of(samples).tilts[:, 1],
    "load_owner": lambda robot, samples, owner: (
        loads_of(samples).moving if owner == samples.joint else np.nan_to_num(loads_of(samples).by_joint[:, owner - 1])
    ),
    "slope_owner": lambda robot, samples, owner: np.nan_to_num(loads_of(samples).slopes[:, owner - 1]),
    "friction_owner": _friction,
    "shaft_on": lambda robot, samples, on: robot.shaft_velocity(samples.velocity)[:, on - 1],
    "gamma_p": lambda robot, samples, owner: samples.bodies[:, 0],
    "gamma_x": lambda robot, samples, owner: samples.bodies[:, 1],
    "gamma_y": lambda robot, samples, owner: samples.bodies[:, 2],
    "gamma_z": lambda robot, samples, owner: samples.bodies[:, 3],
}


def columns(
    formula: str, names: tuple[str, ...], values: Mapping[str, float], *, motion: tuple[Robot, Samples, int]
) -> Floats:
    """(M, p) derivative of a formula (empty where the effect does not act) by its p linear parameters `names`.

    `values` are shapes by name, `motion` the arm, M instants of one moving joint, and the owner of the parameters (from
    1, 0 for the whole arm).
    """
    robot, samples, owner = motion
    out = np.zeros((len(names), len(samples))).T  # a column in one piece: filters go along it
    if not formula:
        return out
    codes, used = _compiled(formula, names)
    joints = {name: int(values["on"]) if name.endswith("_on") else owner for name in used - set(values)}
    space = {name: _quantity(name, robot, samples, joint) for name, joint in joints.items()}
    for place, code in enumerate(codes):
        if code is not None:
            out[:, place] = eval(code, {"__builtins__": {}, **FUNCTIONS}, space | dict(values))
    return out


@lru_cache(maxsize=8)  # asked for again with every shape of an effect
def _quantity(name: str, robot: Robot, samples: Samples, owner: int) -> Any:
    return QUANTITIES[name](robot, samples, owner)


@lru_cache(maxsize=512)
def _compiled(formula: str, names: tuple[str, ...]) -> tuple[tuple[CodeType | None, ...], frozenset[str]]:
    """Code of the derivative by each parameter (None where it is zero), and the other names that stand in it."""
    codes: list[CodeType | None] = []
    for name in names:
        text = filled(formula, {other: float(other == name) for other in names})
        codes.append(None if text == "0.0" else compile(text, f"<{formula}>", "eval"))
    return tuple(codes), names_in(formula) - set(names)


def names_in(formula: str) -> frozenset[str]:
    """Names of parameters, shapes and quantities in a formula, not those of functions."""
    return frozenset(re.findall(r"(?<![\w.])[A-Za-z_]\w*\b(?! *\()", formula))


def filled(formula: str, values: Mapping[str, float | str]) -> str:
    """A formula with numbers (none rounded) or other names in place of names; products with zero and one are gone."""
    return ast.unparse(ast.fix_missing_locations(_Filler(values).visit(ast.parse(formula, mode="eval"))))


def at_rest(formula: str) -> tuple[str, str]:
    """The part of a formula that is there at rest, and what motion adds to it; ``0.0`` where there is none."""
    shafts = {name: 0.0 for name in names_in(formula) if name.startswith("shaft")}
    hold = filled(formula, shafts | {"s": 0.0, "v": 0.0, "drawn": "load"})
    if hold == filled(formula, {}):
        return hold, "0.0"
    return hold, filled(f"{formula} - ({hold})", {})


def printed(formula: str) -> str:
    """A formula as documents have it: ``s a exp(-(v/velocity)^exponent)``."""
    text = re.sub(r"\((\w+ [<>=]+ [\w.]+)\)", r"[\1]", formula)
    text = re.sub(r"(\w) / (\w+)(?=[\s)]|$)", r"\1/\2", text)
    return re.sub(r"\s*\*\*\s*", "^", text).replace(" * ", " ").replace("==", "=")


class _Filler(ast.NodeTransformer):
    """Puts values in place of names and leaves out what they make zero or one."""

    def __init__(self, values: Mapping[str, float | str]) -> None:
        self.values = values

    def visit_Call(self, node: ast.Call) -> ast.expr:
        node.args = [self.visit(argument) for argument in node.args]
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        value = self.values.get(node.id, node.id)
        if isinstance(value, str):
            return ast.Name(value)
        size = ast.Constant(abs(float(value)))
        return ast.UnaryOp(ast.USub(), size) if value < 0.0 else size

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        self.generic_visit(node)
        return node.operand if isinstance(node.operand, ast.Constant) and node.operand.value == 0.0 else node

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        self.generic_visit(node)
        if all(isinstance(side, ast.Constant) for side in (node.left, *node.comparators)):
            return ast.Constant(float(eval(ast.unparse(node), {})))
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        match node:
            case ast.BinOp(ast.Constant(0.0), ast.Mult() | ast.Div()) | ast.BinOp(_, ast.Mult(), ast.Constant(0.0)):
                return ast.Constant(0.0)
            case (
                ast.BinOp(ast.Constant(1.0), ast.Mult(), other)
                | ast.BinOp(ast.Constant(0.0), ast.Add(), other)
                | ast.BinOp(other, ast.Mult() | ast.Div(), ast.Constant(1.0))
                | ast.BinOp(other, ast.Add() | ast.Sub(), ast.Constant(0.0))
            ):
                return other
            case ast.BinOp(ast.Constant(0.0), ast.Sub(), other):
                return ast.UnaryOp(ast.USub(), other)
        return node
