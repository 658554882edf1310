"""JSON: all that is needed to evaluate the model in a program of one's own, and postures to check it with."""

import numpy as np

from pumaid.effects.formula import filled
from pumaid.exports.base import Form, Subject
from pumaid.exports.formulas import Lack
from pumaid.results.documents import as_text

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
    " is load_i and load_M that of joint M, drawn is load_i + base_i, slope_M the derivative of load_i by q_M, tilt_x"
    " and tilt_y are (z_i x (g x e)) . F_i with e the base's x or y and F_i = sum over j >= i of felt[i][j] h_j (of a"
    " slide -(z_i . (g x e)) mass_i), across is |M - z_i (z_i . M)| with M = g x F_i (of a slide 0); ** is a power",
    "current": "load_i + base_i + all terms of joint i; at rest only load_i and the terms that are not friction",
    "reference": "postures and velocities with the current of every joint, by the program that identified the model",
}


#: What is said of a joint besides its number and type.
FIELDS = ("name", "theta", "alpha", "a", "d", "placement", "limits", "max_velocity")
#: In the document v has its sign.
SIGNED = {"v": "abs(v)", "shaft": "v"}


def write(subject: Subject) -> tuple[dict[str, str], tuple[Lack, ...]]:
    """A dictionary with the constants, the formulas and what they mean; and what is not in it."""
    formulas, robot = subject.formulas, subject.formulas.robot
    ways = np.random.default_rng(0)
    position = ways.uniform(-1.0, 1.0, (POSTURES, robot.n_joints)) * np.where(robot.is_revolute, np.pi, 1.0)
    velocity = ways.uniform(-1.0, 1.0, (POSTURES, robot.n_joints))
    current = formulas.predicted(position, velocity)
    return {
        ".json": as_text(
            {
                "kind": "currents",
                "format": 1,
                "pumaid": subject.version,
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
                    {"q": q, "qd": qd, "current": i} for q, qd, i in zip(position, velocity, current, strict=True)
                ],
            }
        )
    }, formulas.left_out


FORMS = {"json": Form(write)}
