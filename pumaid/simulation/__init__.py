"""A virtual robot: a truth that is known, and the logs or runs that it would leave.

Nothing here uses the effects that a model is fitted with: gravity comes from masses and potential energy, motion from
MuJoCo, and hidden effects have a table of their own.
"""

from pumaid.simulation import table1
from pumaid.simulation.gravity import Constants, Links, gravity_load
from pumaid.simulation.hidden_effects import Hidden
from pumaid.simulation.monte_carlo import Bench, runs
from pumaid.simulation.random_robot import draw
from pumaid.simulation.session import Session, simulate
from pumaid.simulation.virtual_robot import Friction, Noise, Truth

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
    "simulate",
    "table1",
]
