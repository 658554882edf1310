"""A virtual robot: a truth that is known, and the logs or runs that it would leave.

Nothing here uses the effects that a model is fitted with: gravity comes from masses and potential energy, or from the
paper's own recursion.
"""

from pumaid.virtual import table1
from pumaid.virtual.bench import Bench, runs
from pumaid.virtual.draw import draw
from pumaid.virtual.hidden import Hidden
from pumaid.virtual.links import Links, gravity_load
from pumaid.virtual.recursion import Constants
from pumaid.virtual.session import Session
from pumaid.virtual.truth import Friction, Noise, Truth

__all__ = [
    "Bench",
    "Constants",
    "Friction",
    "Hidden",
    "Links",
    "Noise",
    "Session",
    "Truth",
    "draw",
    "gravity_load",
    "runs",
    "table1",
]
