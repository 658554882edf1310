"""A model's currents: C99 for controllers, Python with numpy alone and MATLAB by templates, and JSON."""

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from pumaid.effects.curve import SEGMENTS
from pumaid.effects.formula import filled
from pumaid.exports import Form, Subject, head, rendered, title
from pumaid.exports.formulas import Lack
from pumaid.io.column_names import factor_of
from pumaid.maths import Floats
from pumaid.results.documents import as_text

# Source code


@dataclass(frozen=True, slots=True)
class Language:
    """A language of source code, made by `templates` in ``exports/templates``.

    `names` are functions and quantities of a formula -> their text in the language: ``{i}`` is the term's joint;
    ``load_`` is that of all ``load_M``, ``{m}`` being M; others keep their names. `power` is the function x, y -> x to
    the power y (empty where the language writes ``**``), `first` the index of the first joint, and `brackets` what
    stands around the rows of a table and between them.
    """

    templates: tuple[str, ...]
    names: Mapping[str, str]
    power: str = ""
    first: int = 0
    brackets: tuple[str, str, str] = ("[", "]", ",")

    def write(self, subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
        """The files of the model, and the effects that are not in them."""
        formulas, robot = subject.formulas, subject.formulas.robot
        tables = {
            "placed": robot.placements[:, :3, :3].reshape(-1, 9),
            "d": np.array([joint.d for joint in robot.joints]),
            "g": np.array(robot.gravity, dtype=float),
            "offset": robot.placements[:, :3, 3],
            **formulas.arrays(),
        }
        start, end, _ = self.brackets
        kinds: dict[bool, list[dict[str, Any]]] = {False: [], True: []}
        for term in sorted(formulas.terms, key=lambda term: term.joint):
            text = ast.unparse(_Translation(self, term.joint).visit(ast.parse(term.formula, mode="eval")))
            text = text.replace("--", "- -")  # C reads -- as a decrement
            kinds[term.is_friction].append({"joint": term.joint, "effect": term.effect, "text": text})
        values: dict[str, Any] = {name: self._table(table) for name, table in tables.items()} | {
            "name": subject.name,
            "NAME": subject.name.upper(),
            "n": robot.n_joints,
            "title": title(formulas),
            "head": head(subject, formulas.left_out),
            "largest": self._table(np.abs(formulas.predicted(*formulas.states())).max(axis=0)),
            "names": robot.log.names or tuple(joint.name for joint in robot.joints),
            "columns": tuple(robot.log.column("position", joint.number) for joint in robot.joints),
            "logged": {
                quantity: (
                    [factor_of(robot, quantity, joint) for joint in robot.joints],
                    [robot.log.conversion(quantity, joint.number).zero for joint in robot.joints],
                )
                for quantity in ("position", "current")
            },
            "turns": f"{start}{', '.join(str(int(joint.is_revolute)) for joint in robot.joints)}{end}",
            "dynamic": formulas.is_dynamic,
            "segments": SEGMENTS,
            "curved": bool(len(formulas.curves)),
            "geared": bool((formulas.shaft != np.eye(robot.n_joints)).any()),
            "holds": kinds[False],
            "frictions": [(joint, list(group)) for joint, group in groupby(kinds[True], key=itemgetter("joint"))],
        }
        words = " ".join(term.formula for term in formulas.terms)
        values |= {
            f"uses_{name}": bool(re.search(rf"\b{name}(_\w+)?\b", words)) for name in ("slope", "tilt", "across")
        }
        return rendered(self.templates, values), formulas.left_out

    def _table(self, values: Floats) -> str:
        start, end, between = self.brackets
        rows = [", ".join(map(repr, row)) for row in np.atleast_2d(values).tolist()]
        if values.ndim == 1:
            return f"{start}{rows[0]}{end}"
        inner = [f"{start}{row}{end}" for row in rows] if between == "," else rows
        return f"{start}\n    " + f"{between}\n    ".join(inner) + f"\n{end}"


class _Translation(ast.NodeTransformer):
    """Puts the language's names and powers into the formula of a joint."""

    def __init__(self, language: Language, joint: int) -> None:
        self.language, self.joint = language, joint

    def visit_Name(self, node: ast.Name) -> ast.expr:
        first, names = self.language.first, self.language.names
        head, _, number = node.id.rpartition("_")
        text, m = (names[f"{head}_"], int(number)) if number.isdigit() else (names.get(node.id, node.id), 1)
        return ast.Name(text.format(i=self.joint - 1 + first, m=m - 1 + first))

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.Constant(float(node.value))  # type: ignore[arg-type]  # C divides integers as integers

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        is_call = self.language.power and isinstance(node.op, ast.Pow)
        return ast.Call(ast.Name(self.language.power), [node.left, node.right], []) if is_call else node


#: Nothing is allocated and no data changes, so that it runs in an interrupt and on several arms at once.
C = Language(
    templates=("model.h", "model.c", "model_example.c"),
    names={
        "abs": "fabs",
        "max": "fmax",
        "sign": "SIGN",
        "q": "q[{i}]",
        "v": "fabs(v)",
        "shaft": "v",
        "load": "at->load[{i}]",
        "drawn": "(at->load[{i}] + base)",
        "load_": "at->load[{m}]",
        "shaft_": "shaft(qd, {m})",
        "slope_": "slope(at, {i}, {m})",
        "across": "across(at, {i})",
        "tilt_x": "tilt(at, {i}, 0)",
        "tilt_y": "tilt(at, {i}, 1)",
    },
    power="pow",
    brackets=("{", "}", ","),
)
#: Functions of one posture or of many at once.
PYTHON = Language(
    templates=("model.py.txt",),
    names={"curve": "_curve"}
    | {name: f"np.{name}" for name in ("sin", "cos", "tanh", "exp", "sqrt", "abs", "sign")}
    | {
        "max": "np.maximum",
        "q": "q[..., {i}]",
        "v": "np.abs(v)",
        "shaft": "v",
        "load": "at.load[..., {i}]",
        "drawn": "(at.load[..., {i}] + base)",
        "load_": "at.load[..., {m}]",
        "shaft_": "driving[..., {m}]",
        "slope_": "_slope(at, {i}, {m})",
        "across": "_across(at, {i})",
        "tilt_x": "_tilt(at, {i}, 0)",
        "tilt_y": "_tilt(at, {i}, 1)",
    },
)
#: For Simulink's MATLAB Function block too; runs in Octave as well, and needs no toolbox.
MATLAB = Language(
    templates=("model.m.txt",),
    names={
        "q": "q({i})",
        "v": "abs(v)",
        "shaft": "v",
        "load": "load({i})",
        "drawn": "(load({i}) + base)",
        "load_": "load({m})",
        "shaft_": "driving({m})",
        "slope_": "slope(c, z, moment, {i}, {m})",
        "across": "across(c, z, moment, {i})",
        "tilt_x": "tilt(c, z, moment, {i}, 1)",
        "tilt_y": "tilt(c, z, moment, {i}, 2)",
    },
    power="power",
    first=1,
    brackets=("[", "]", ";"),
)

# JSON

#: Postures with currents by the model itself.
POSTURES = 8

#: What each entry means, in the document itself.
MEANING = {
    "joints": "base to tip; frame n is reached from frame n-1 by Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d), q"
    " added to theta where the joint turns, to d where it slides; or by the rows of placement, then Rot_z(q) or"
    " Trans_z(q)",
    "gravity": "free fall g in axes of the base, m/s2",
    "moments": "of each link [k_x, k_y] in A s2/m, of a slide [mass, 0], in the gain of its own joint",
    "ratios": "row i, column j: eta_i / eta_j, by which link j counts in joint i; 0 where it does not",
    "felt": "the same for moments across an axis, which an upright joint counts in the gain of the next one",
    "load": "with h_j = k_x x_j + k_y y_j (of a slide mass d_j z_j) and H_i = sum over j >= i of ratios[i][j] h_j, in"
    " base axes: load_i = (z_i x g) . H_i where joint i turns, -(g . z_i) mass_i where it slides",
    "friction": "base_i = coulomb + viscous v of the joint's direction (first forward, then backward), v = the row of"
    " shaft times the joints' velocities",
    "terms": "added to the current of a joint, friction terms only in motion; s is +1 or -1 with the sign of v, load"
    " is load_i and load_M that of joint M, shaft_M the v of joint M, drawn is load_i + base_i, slope_M the"
    " derivative of load_i by q_M, tilt_x and tilt_y are (z_i x (g x e)) . F_i with e the base's x or y and"
    " F_i = sum over j >= i of felt[i][j] h_j (of a slide -(z_i . (g x e)) mass_i), across is |M - z_i (z_i ."
    " M)| with M = g x F_i (of a slide 0); ** is a power, sign -1, 0 or 1",
    "curves": "learned curves, a row each: lowest and highest value of the variable x, then coefficients a of cubic"
    f" B-splines; curve(row, x) with u = {SEGMENTS} times x's share of the range (0 to 1), i = floor(u) but at most"
    f" {SEGMENTS - 1}, t = u - i, s = 1 - t is (s^3 a_i + (3 t^3 - 6 t^2 + 4) a_i+1 + (3 s^3 - 6 s^2 + 4) a_i+2 + t^3"
    " a_i+3) / 6, a counted from 0",
    "current": "load_i + base_i + all terms of joint i; at rest only load_i and the terms that are not friction",
    "bodies": "of each link mass, first moments, inertia (xx, xy, xz, yy, yz, zz) about its frame's origin and the"
    " rotor's, in the gain of its own joint: inertia_i is the sum over links j >= i of ratios[i][j] times the torque"
    " (of a slide the force) that Newton and Euler ask of joint i for link j alone, without gravity, and rotor qdd_i",
    "reference": "postures and velocities with the current of every joint, by the program that identified the model;"
    " with qdd, where there are bodies, inertia beside it",
}


#: What is said of a joint besides its number and type.
FIELDS = ("name", "theta", "alpha", "a", "d", "placement", "limits", "max_velocity")
#: In the document v has its sign.
SIGNED = {"v": "abs(v)", "shaft": "v"}


def write_json(subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
    """A dictionary with the constants, the formulas and what they mean; and what is not in it."""
    formulas, robot = subject.formulas, subject.formulas.robot
    position, velocity = (part[:POSTURES] for part in formulas.states())
    reference = {"q": position, "qd": velocity, "current": formulas.predicted(position, velocity)}
    if formulas.is_dynamic:
        rng = np.random.default_rng(0)
        acceleration = rng.uniform(-1.0, 1.0, position.shape)
        reference |= {"qdd": acceleration, "inertia": formulas.inertia(position, velocity, acceleration)}
    return {
        ".json": as_text(
            {
                "kind": "currents",
                "format": 1,
                "pumaid": formulas.estimate.version,
                "robot": robot.name,
                "recipe": {"file": robot.origin, "sha256": robot.digest},
                "logs": formulas.estimate.logs,
                "meaning": MEANING,
                "joints": [
                    {"joint": joint.number, "type": joint.kind} | {name: getattr(joint, name) for name in FIELDS}
                    for joint in robot.joints
                ],
                "gravity": robot.gravity,
                **formulas.arrays(),
                "terms": [
                    {
                        "joint": term.joint,
                        "effect": term.effect,
                        "friction": term.is_friction,
                        "formula": filled(term.formula, SIGNED),
                    }
                    for term in formulas.terms
                ],
                "left_out": formulas.left_out,
                "undetermined": formulas.undetermined,
                "reference": [
                    dict(zip(reference, rows, strict=True)) for rows in zip(*reference.values(), strict=True)
                ],
            }
        )
    }, formulas.left_out


FORMS = {
    "c": Form(C.write),
    "python": Form(PYTHON.write),
    "matlab": Form(MATLAB.write),
    "json": Form(write_json),
}
