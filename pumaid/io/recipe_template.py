"""Texts of recipes to start from: a shipped one with remarks, a blank one, or one with another gravity."""

from __future__ import annotations

import io
from pathlib import Path

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

from pumaid.io.recipe import shipped_recipes

_HEAD = """\
# A recipe for pumaid: how the joints of one arm stand to one another, and how its logs are written.
# Started from: {origin}
# Every key is explained in docs/recipes.md; what follows a # is a remark.
# Before you plan motions for a real arm, put its own limits and speeds here, and its gravity where it does not stand
# upright.

"""

_LOG = """
# How the logs are written. These values hold where a line is left out; take away the # of the lines you change.
# {{joint}} counts from 1, {{joint0}} from 0, {{name}} is the joint's name; velocity and temperature may be absent.
# log:
#   time: t
#   position: "q{{joint}}"
#   velocity: "qd{{joint}}"
#   current: "i{{joint}}"
#   temperature: "temp{{joint}}"
#   units: {{time: s, position: rad, velocity: rad/s, current: A}}    # or ms, deg, deg/s, mA ...
#   signs:                                 # -1 where the log counts the other way than this recipe
#     position: [{ones}]
#     current: [{ones}]
"""

_EFFECTS = """
# Physics beyond the paper's model (gravity, Coulomb and viscous friction); pumaid effects lists the names.
# effects:
#   - {effect: NAME, joint: 3}    # a joint's number from 1, its name, or all
"""

_SAFETY = """
# What the arm must not touch when it runs a plan (docs/planning.md); without it only limits and speeds are kept.
# safety:
#   tool: [0, 0, 0.1]    # the tip in the last link's frame, m
#   boxes: [{name: table, min: [-1, -1, -1], max: [1, 1, -0.1]}]    # in axes of the base, m
#   spheres: [{link: 3, centre: [0, 0, 0], radius: 0.08}]    # in the frame of the link, m; link 0 is the base
"""

_BLANK = """\
name: my arm
gravity: [0.0, 0.0, -9.80665]    # m/s2 in axes of the base; this is an arm that stands upright
units: {angle: deg}              # unit of the angles in this file: deg or rad
source: where the numbers below are from

# One line a joint, base to tip, in modified Denavit-Hartenberg parameters (Craig): alpha and a lead from the joint
# before to this one, d and theta belong to this one. From a standard table take alpha and a of the row above.
#   type          revolute or prismatic
#   theta, alpha  angles; theta of a revolute joint is added to the measured position
#   a, d          m; d of a prismatic joint is added to the measured position
#   limits        [lowest, highest] measured position, m for a prismatic joint; may be absent
#   max_velocity  a second, m/s for a prismatic joint; may be absent
#   gear_ratio    motor turns per joint turn; may be absent
joints:
"""
_BLANK_JOINT = (
    "  - {{name: joint{number}, type: revolute, theta: 0, alpha: {alpha}, a: 0.0, d: 0.0, "
    "limits: [-180, 180], max_velocity: 90}}\n"
)


def started_from(name: str) -> str:
    """The text of the shipped recipe `name` with remarks on what to change.

    Raises
    ------
    KeyError
        No recipe of that name is shipped.
    """
    text = shipped_recipes()[name].read_text(encoding="utf-8")
    ones = ", ".join(["1"] * text.count("{name:"))
    log = "" if "log:" in text else _LOG.format(ones=ones)
    return _HEAD.format(origin=f"pumaid init {name}") + text.rstrip() + "\n" + log + _EFFECTS + _SAFETY


def blank(n_joints: int) -> str:
    """The text of a recipe for an arm of `n_joints` revolute joints with made-up twists, to be filled in."""
    lines = [_BLANK_JOINT.format(number=n, alpha=0 if n == 1 else -90 * (-1) ** n) for n in range(1, n_joints + 1)]
    return remarked(_BLANK + "".join(lines), n_joints, origin=f"pumaid init blank --joints {n_joints}")


def remarked(body: str, n_joints: int, *, origin: str) -> str:
    """A recipe's text with the remarks above and below that tell what else it may hold.

    Parameters
    ----------
    body
        Name, gravity and joints, without a block for logs or effects.
    n_joints
        How many joints it has.
    origin
        What it was started from, one line.
    """
    log = _LOG.format(ones=", ".join(["1"] * n_joints))
    return _HEAD.format(origin=origin) + body + log + _EFFECTS + _SAFETY


def with_gravity(path: Path, gravity: tuple[float, float, float]) -> str:
    """A recipe's text with its gravity replaced; comments and order stay.

    Parameters
    ----------
    path
        The recipe, which can be read.
    gravity
        m/s2, in base axes.
    """
    yaml = YAML(typ="rt")
    yaml.preserve_quotes = True
    yaml.width = 4096
    content = yaml.load(path.read_text(encoding="utf-8"))
    values = CommentedSeq(gravity)
    values.fa.set_flow_style()
    content["gravity"] = values
    out = io.StringIO()
    yaml.dump(content, out)
    return out.getvalue()
