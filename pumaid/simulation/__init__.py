"""A virtual robot: a truth that is known, and the logs or runs that it would leave.

Nothing here uses the effects that a model is fitted with: gravity comes from masses and potential energy, or from the
paper's own recursion.
"""

from pumaid.simulation import table1
from pumaid.simulation.bench import Bench, runs
from pumaid.simulation.draw import draw
from pumaid.simulation.hidden import Hidden
from pumaid.simulation.links import Links, gravity_load
from pumaid.simulation.recursion import Constants
from pumaid.simulation.session import Session
from pumaid.simulation.truth import Friction, Noise, Truth

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
